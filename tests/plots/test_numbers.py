"""The numbers behind the curves of a figure, as a file, and what differs from it."""

import json
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure as Drawing

from eqt_cli.core.errors import EqtError
from eqt_cli.plots.curve_data import MOST_SAMPLES, Curve, curves, plain
from eqt_cli.plots.figures.paper import Paper
from eqt_cli.plots.figures.torque import Torque
from eqt_cli.plots.kept_numbers import TOLERANCE, compare, read, to_json
from eqt_cli.plots.render import check, render

pytestmark = pytest.mark.usefixtures("unarranged")


def curve(y, **changes):
    y = np.array(y, dtype=float)
    made = Curve("lyapunov", "eqt", "t (s)", "L (J)", np.arange(len(y)) / 2, y)
    return replace(made, **changes)


def test_curves_are_the_means_with_their_units(so3, opened):
    results = opened(so3)
    found = {(c.panel, c.name): c for c in curves(Paper().draw([results]))}
    assert list(found) == [
        (panel, name)
        for panel in ("pose_error", "velocity_error", "torque_norm", "lyapunov")
        for name in ("eqt", "gt", "nog", "asym")
    ]
    one = found["velocity_error", "nog"]
    assert (one.across, one.up) == ("t (s)", "‖V - V_d‖ (rad/s)")
    np.testing.assert_array_equal(one.x, results["time"])
    np.testing.assert_array_equal(one.y, results["velocity_error"][2].mean(axis=0))


def test_edges_of_bands_are_quantiles(so3, opened):
    results = opened(so3)
    drawing = Torque(bands="quantiles", share="total").draw([results])
    found = {(c.panel, c.name): c for c in curves(drawing)}
    low, high = np.quantile(results["torque"][1, ..., 2], [0.1, 0.9], axis=0)
    np.testing.assert_array_equal(found["ωz gt", "lower edge gt"].y, low)
    np.testing.assert_array_equal(found["ωz gt", "upper edge gt"].y, high)
    desired = found["ωz gt", "desired"]
    np.testing.assert_array_equal(desired.y, results["desired_torque"][:, 2])
    assert desired.up == "τ_z (N m)"


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


def test_a_file_gives_back_what_was_written(tmp_path):
    written = [curve([1 / 3, np.nan, 2e-20]), curve([], name='"odd"\n')]
    (tmp_path / "paper.json").write_bytes(to_json(written))
    back = read(tmp_path / "paper.json")
    assert [(c.panel, c.name, c.across, c.up) for c in back] == [
        (c.panel, c.name, c.across, c.up) for c in written
    ]
    for one, other in zip(back, written, strict=True):
        np.testing.assert_allclose(one.y, other.y, rtol=5e-9)  # half of the 9th digit
    assert compare(back, written).differences == []


def test_what_lies_within_the_tolerance_agrees():
    found = compare([curve([0, 2 + 1.9 * TOLERANCE])], [curve([0, 2])])
    assert found.differences == []
    assert found.largest == pytest.approx(0.95 * TOLERANCE)


def test_a_component_of_zeros_is_compared_on_the_scale_of_its_panel():
    """Rounding of 0 depends on the processor: 1e-17 on one, 0 on another."""
    baseline = [curve([0, 0]), curve([0, 2], name="gt")]
    rounding = compare([curve([0, 1e-17]), curve([0, 2], name="gt")], baseline)
    assert rounding.differences == []
    assert rounding.largest == pytest.approx(5e-18)
    moved = compare([curve([0, 1e-5]), curve([0, 2], name="gt")], baseline)
    assert len(moved.differences) == 1


def test_a_panel_of_zeros_has_rounding_and_nothing_else():
    assert compare([curve([0, 1e-13])], [curve([0, 0])]).differences == []
    assert len(compare([curve([0, 1e-11])], [curve([0, 0])]).differences) == 1


def test_a_difference_says_where_and_how_much():
    found = compare([curve([0, 2.00001, 4.1, 3])], [curve([0, 2, 4, 3])])
    assert found.differences == [
        "panel 'lyapunov', curve 'eqt': 2 of 4 samples differ, from t = 0.5 s to t = 1 s; most at "
        "t = 1 s: got 4.1, expected 4 within 4e-06"
    ]
    assert found.largest == pytest.approx(0.025)


@pytest.mark.parametrize(
    ("new", "sentence"),
    [
        ([], "panel 'lyapunov', curve 'eqt': is missing"),
        ([curve([1, 2]), curve([1], name="gt")], "curve 'gt': is not in the baseline"),
        ([curve([1, 2], up="L")], "the scale is named 'L', expected 'L (J)'"),
        ([curve([1, 2, 3])], "has 3 samples over 0 to 1, expected 2 over 0 to 0.5"),
        (
            [curve([1, 2], x=np.array([0, 0.6]))],
            "curve 'eqt': 1 of 2 samples lie elsewhere across; most number 2: got t = 0.6 s, "
            "expected t = 0.5 s within 5e-07",
        ),
        ([curve([1, 2], x=np.array([0, np.nan]))], "1 of 2 samples lie elsewhere across"),
        ([curve([1, np.nan])], "1 of 2 samples differ"),
    ],
)
def test_curves_that_cannot_be_compared_differ(new, sentence):
    (difference,) = compare(new, [curve([1, 2])]).differences
    assert sentence in difference


@pytest.mark.parametrize("kept", ["{", "[1]", '[{"panel": "p"}]', "3"])
def test_a_file_of_something_else_is_refused(kept, tmp_path):
    path = tmp_path / "paper.json"
    path.write_text(kept)
    with pytest.raises(EqtError) as caught:
        read(path)
    assert str(caught.value) == (
        f"{path}: does not hold the numbers of a figure; `eqt plot RESULT --figure NAME --format "
        "json --out DIR` writes numbers to compare with"
    )


def test_a_file_that_is_not_there_is_named(so3, opened, tmp_path):
    with pytest.raises(EqtError, match=r"paper\.json: cannot be read: no such file or directory"):
        check([opened(so3)], "paper", tmp_path)


@pytest.fixture(scope="module")
def kept(so3, tmp_path_factory):
    """The numbers of two figures of the small experiment."""
    from eqt_cli.results.result import open_result

    folder = tmp_path_factory.mktemp("kept")
    with open_result(so3) as results:
        for name in ("paper", "torque"):
            render([results], name, folder, ["json"])
    return folder


@pytest.mark.parametrize("name", ["paper", "torque"])
def test_a_figure_agrees_with_its_own_numbers(name, so3, opened, kept):
    found = check([opened(so3)], name, kept)
    assert (found.differences, found.curves) == ([], {"paper": 16, "torque": 12}[name])
    assert found.largest < 5.1e-9  # half of the 9th digit
    assert all(
        isinstance(one["y"], list) for one in json.loads((kept / f"{name}.json").read_text())
    )


@pytest.mark.parametrize(("name", "gain"), [("paper", "kp"), ("torque", "kd")])
def test_a_gain_that_is_1_percent_larger_differs(gain, name, simulate, opened, kept):
    gains = {"kp": 1.0, "kd": 0.5}
    gains[gain] *= 1.01
    found = check([opened(simulate(gains=gains))], name, kept)
    assert found.largest > 100 * TOLERANCE  # it shows far above what is tolerated
    assert len(found.differences) >= 12


@pytest.mark.slow("computes with both engines")
def test_both_engines_agree_to_the_tolerance(simulate, opened, tmp_path):
    pytest.importorskip("heyoka")
    solver = {"rtol": 1e-9, "atol": 1e-12}
    time = {"duration": 2.0, "samples": 21}
    first = simulate(solver=solver | {"engine": "solve_ivp"}, time=time)
    render([opened(first)], "paper", tmp_path / "kept", ["json"])
    second = simulate(solver=solver | {"engine": "taylor"}, time=time)
    found = check([opened(second)], "paper", tmp_path / "kept")
    assert found.differences == []
