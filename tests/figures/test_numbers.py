"""The numbers behind the curves of a figure, as a file, and what differs from it."""

import importlib.util
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure as Drawing

from eqt_cli.figures.render import MOST_SAMPLES, Curve, curves, plain, render, to_json
from eqt_cli.figures.time_figures import Paper, Summary, Torque

pytestmark = pytest.mark.usefixtures("unarranged")


def curve(y, **changes):
    y = np.array(y, dtype=float)
    made = Curve("lyapunov", "eqt", "t (s)", "L (J)", np.arange(len(y)) / 2, y)
    return replace(made, **changes)


def test_curves_are_the_means_with_their_units(so3, opened, picture):
    results = opened(so3)
    found = {(c.panel, c.name): c for c in curves(picture(Paper(), results))}
    assert list(found) == [
        (panel, name)
        for panel in ("pose_error", "velocity_error", "torque_norm", "lyapunov")
        for name in ("eqt", "gt", "nog", "asym")
    ]
    one = found["velocity_error", "nog"]
    assert (one.across, one.up) == ("t (s)", "‖V - V_d‖ (rad/s)")
    np.testing.assert_array_equal(one.x, results["time"])
    np.testing.assert_array_equal(one.y, results["velocity_error"][2].mean(axis=0))


def test_edges_of_bands_are_quartiles(so3, opened, picture):
    results = opened(so3)
    found = {(c.panel, c.name): c for c in curves(picture(Summary(), results))}
    low, high = np.quantile(results["torque_norm"][1], [0.25, 0.75], axis=0)
    np.testing.assert_array_equal(found["torque_norm", "lower edge gt"].y, low)
    np.testing.assert_array_equal(found["torque_norm", "upper edge gt"].y, high)
    found = {(c.panel, c.name): c for c in curves(picture(Torque(), results))}
    desired = found["ωz", "desired"]
    np.testing.assert_array_equal(desired.y, np.abs(results["desired_torque"][:, 2]))
    assert desired.up == "rms τ_z (N m)"


def test_maps_and_points_are_cells_and_points_and_colour_scales_nothing():
    drawing = Drawing()
    left, right = drawing.subplots(1, 2)
    drawing.colorbar(left.pcolormesh([[1, 2], [3, np.nan]]))
    right.scatter([1, 2], [3, 4], label="eqt")
    cells, points = curves(drawing)
    assert (cells.panel, cells.name, points.panel) == ("panel 1", "cells 1", "panel 2")
    np.testing.assert_array_equal(cells.y, [1, 2, 3, np.nan])
    assert points.name == "points eqt"
    np.testing.assert_array_equal(points.y, [3, 4])


@pytest.mark.parametrize("samples", [1, 100, 101, 102, 401, 1000])
def test_few_samples_are_kept_with_both_ends(samples):
    drawing = Drawing()
    drawing.subplots().plot(np.arange(samples), np.zeros(samples))
    (kept,) = curves(drawing)
    assert len(kept.x) <= MOST_SAMPLES
    assert (kept.x[0], kept.x[-1]) == (0, samples - 1)
    assert samples > MOST_SAMPLES or len(kept.x) == samples


@pytest.mark.parametrize(
    ("label", "text"),
    [
        (r"$\|I - Q_E\|_{\mathrm{F}}$", "‖I - Q_E‖_F"),
        (r"$\tau_{\omega x}$ $(\mathrm{N\,m})$", "τ_ωx (N m)"),
        (r"$\tau_{\lambda}$", "τ_λ"),
        (r"$\mathcal{L}$ $(\mathrm{J})$", "L (J)"),
        ("mean effort (N^2)", "mean effort (N^2)"),
    ],
)
def test_labels_in_plain_text(label, text):
    assert plain(label) == text


# Compared with kept numbers -----------------------------------------------------------------------

SCRIPT = Path(__file__).parents[2] / "docs" / "figures" / "compare.py"
SPEC = importlib.util.spec_from_file_location("compare", SCRIPT)
compare = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(compare)


def beyond(found, kept):
    found, kept = (json.loads(to_json(curves)) for curves in (found, kept))
    every = compare.differences(found, kept)
    return [text for text, off in every if not off <= compare.TOLERANCE]


def test_what_lies_within_the_tolerance_agrees():
    kept = [curve([0, 2, np.nan])]
    assert beyond([curve([0, 2 + 1.9e-6, np.nan])], kept) == []
    assert beyond([curve([0, 2 + 2.1e-6, np.nan])], kept) != []


def test_a_component_of_zeros_is_compared_on_the_scale_of_its_panel():
    """Rounding of 0 depends on the processor: 1e-17 on one, 0 on another."""
    kept = [curve([0, 0]), curve([0, 2], name="gt")]
    assert beyond([curve([0, 1e-17]), curve([0, 2], name="gt")], kept) == []
    assert len(beyond([curve([0, 1e-5]), curve([0, 2], name="gt")], kept)) == 1
    assert beyond([curve([0, 1e-13])], [curve([0, 0])]) == []
    assert len(beyond([curve([0, 1e-11])], [curve([0, 0])])) == 1


@pytest.mark.parametrize(
    ("new", "sentence"),
    [
        ([], "panel 'lyapunov', curve 'eqt': is missing"),
        ([curve([1, 2]), curve([1], name="gt")], "curve 'gt': is not kept"),
        ([curve([1, 2], up="L")], "L: has another length or scale"),
        ([curve([1, 2], x=np.array([0, 0.6]))], "t (s): sample 1: got 0.6, expected 0.5"),
        ([curve([1, 2.1])], "L (J): sample 1: got 2.1, expected 2"),
        ([curve([1, np.nan])], "sample 1: got nan, expected 2"),
    ],
)
def test_a_difference_says_where(new, sentence):
    assert sentence in beyond(new, [curve([1, 2])])[0]


@pytest.mark.ci("computes and draws another result")
def test_a_gain_that_is_1_percent_larger_differs(simulate, so3, opened, tmp_path, capsys):
    render([opened(so3)], "paper", tmp_path / "kept", ["json"])
    other = simulate(gains={"kp": 1.01, "kd": 0.5})
    render([opened(other)], "paper", tmp_path / "other", ["json"])
    assert compare.main(tmp_path / "kept", tmp_path / "kept") == 0
    assert capsys.readouterr().out == "paper: agrees; largest difference 0\n"
    assert compare.main(tmp_path / "other", tmp_path / "kept") == 4
