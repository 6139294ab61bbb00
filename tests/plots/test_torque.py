"""The figure of torque components."""

import numpy as np
import pytest

from eqt_cli.core.errors import EqtError
from eqt_cli.plots.drawing.labels import component
from eqt_cli.plots.figures.torque import Torque


def _grid(drawing, columns):
    return [drawing.axes[k : k + columns] for k in range(0, len(drawing.axes), columns)]


def test_panels_show_mean_band_and_desired_torque(so3, altered, opened):
    status = np.zeros_like(opened(so3)["status"])
    status[2, 0] = 2
    results = altered(so3, status=status)
    for axis, row in enumerate(_grid(Torque().draw([results]), 4)):
        for controller, axes in enumerate(row):
            values = results["torque"][controller, status[controller] == 0, :, axis]
            mean, desired = axes.lines
            np.testing.assert_array_equal(mean.get_ydata(), values.mean(axis=0))
            np.testing.assert_array_equal(desired.get_ydata(), results["desired_torque"][:, axis])
            (band,) = axes.collections
            low, high = np.quantile(values, [0.1, 0.9], axis=0)
            vertices = band.get_paths()[0].vertices[:, 1]
            assert (vertices.min(), vertices.max()) == (low.min(), high.max())


def test_bands_can_be_left_out(so3, opened):
    drawing = Torque(bands="none").draw([opened(so3)])
    assert not any(axes.collections for axes in drawing.axes)
    names = [text.get_text() for text in drawing.legends[0].get_texts()]
    assert names == ["mean", r"$\tau_d$"]


def test_every_axis_has_its_own_unit_and_scale(se3, opened):
    results = opened(se3)
    rows = _grid(Torque().draw([results]), 4)
    units = 3 * [r"$(\mathrm{N\,m})$"] + 3 * [r"$(\mathrm{N})$"]
    assert [row[0].get_ylabel() for row in rows] == [
        "$" + component(r"\tau", axis) + "$ " + unit
        for axis, unit in zip(results["axis"], units, strict=True)
    ]
    assert all(len({axes.get_ylim() for axes in row}) == 1 for row in rows)
    assert [axes.get_title() for axes in rows[0]] == ["EqT", "GT", "nog", "asym"]


def test_factors_of_a_product_have_units_and_glyphs(simulate, opened, caplog):
    product = simulate(
        group="SO2*R1",
        inertia=1.0,
        gains={"kp": [1.0, 1.0], "kd": 0.5},
        reference={"torque": ["cos(t)", "1"]},
        initial={
            "pose": [{"kind": "haar"}, {"kind": "exp_normal", "std": 1.0}],
            "velocity": {"kind": "normal", "std": 1.0},
        },
    )
    drawing = Torque().draw([opened(product)])
    assert [row[0].get_ylabel() for row in _grid(drawing, 4)] == [
        r"$\tau_{\omega_{1}}$ $(\mathrm{N\,m})$",
        r"$\tau_{v 1_{2}}$ $(\mathrm{N})$",
    ]
    assert not caplog.records  # Matplotlib would say which letters its fonts lack


def test_more_controllers_than_fit_are_refused(simulate, opened):
    labels = "abcdefghi"
    path = simulate(
        controllers=[{"kind": "family", "label": label} for label in labels],
        ensemble={"runs": 1, "seed": 1},
    )
    for width, room, remedy in (("column", 4, "take width 'page' or "), ("page", 8, "")):
        with pytest.raises(EqtError) as caught:
            Torque().draw([opened(path)], width)
        assert str(caught.value) == (
            f"{path}: figure 'torque' has a column of panels per controller, and width '{width}' "
            f"has room for {room}, not 9; {remedy}choose some with the option 'controllers'"
        )
    assert len(Torque(controllers=list(labels[:4])).draw([opened(path)]).axes) == 12
