"""The figure of single runs."""

import numpy as np
import pytest

from eqt_cli.extend import RunsFigure
from eqt_cli.figures import run_figures

unarranged = pytest.mark.usefixtures("unarranged")


@unarranged
def test_every_good_run_is_a_line_under_the_median(so3, altered, opened):
    values = opened(so3)["pose_error"]
    status = np.zeros_like(opened(so3)["status"])
    status[0, 4] = 1
    drawing = RunsFigure().draw([altered(so3, status=status)])
    for index, axes in enumerate(drawing.axes):
        good = values[index][status[index] == 0]
        *single, median = axes.lines
        np.testing.assert_array_equal([line.get_ydata() for line in single], good)
        np.testing.assert_array_equal(median.get_ydata(), np.median(good, axis=0))
    assert [axes.get_title() for axes in drawing.axes] == ["EqT", "GT", "nog", "asym"]


@unarranged
def test_only_the_first_of_many_runs_are_drawn(so3, opened, monkeypatch):
    monkeypatch.setattr(run_figures, "MOST_LINES", 2)
    values = opened(so3)["pose_error"]
    drawing = RunsFigure().draw([opened(so3)])
    *single, median = drawing.axes[0].lines
    np.testing.assert_array_equal([line.get_ydata() for line in single], values[0, :2])
    np.testing.assert_array_equal(median.get_ydata(), np.median(values[0], axis=0))
    names = [text.get_text() for text in drawing.legends[0].get_texts()]
    assert names == ["first 2 runs", "median over runs"]


@pytest.mark.ci("draws many panels")
@unarranged
def test_the_common_scale_holds_every_run(so3, altered, opened):
    values = opened(so3)["velocity_error"]
    values[3] *= 10  # in the last panel
    drawing = RunsFigure(signal="velocity_error", log=False).draw(
        [altered(so3, velocity_error=values)]
    )
    limits = {axes.get_ylim() for axes in drawing.axes}
    assert len(limits) == 1
    ((low, high),) = limits
    assert low == 0
    assert high > values.max()


@pytest.mark.ci("computes runs that span decades")
def test_errors_that_span_a_decade_have_a_logarithmic_scale(so3, altered, opened):
    falling = np.broadcast_to(np.geomspace(1, 0.01, 41), opened(so3)["pose_error"].shape)
    for factor, scale in ((falling, "log"), (0.5 + 0.5 * falling, "linear")):
        results = altered(so3, pose_error=np.ones_like(falling) * factor)
        assert {axes.get_yscale() for axes in RunsFigure().draw([results]).axes} == {scale}
        assert RunsFigure(log=False).draw([results]).axes[0].get_yscale() == "linear"
        torque = altered(so3, torque_norm=np.ones_like(falling) * factor)
        assert RunsFigure(signal="torque_norm").draw([torque]).axes[0].get_yscale() == "linear"


@unarranged
def test_parts_have_columns_and_scales_of_their_own(se3, opened, picture):
    results = opened(se3)
    drawing = picture(RunsFigure(signal="torque_norm"), results)
    assert [axes.get_title() for axes in drawing.axes[:3]] == ["EqT", "", "GT"]
    assert [axes.get_ylabel() for axes in drawing.axes[:2]] == [
        r"$\|\tau\|$ $(\mathrm{N\,m})$",
        r"$\|f\|$ $(\mathrm{N})$",
    ]
    np.testing.assert_array_equal(
        drawing.axes[3].lines[0].get_ydata(), results["torque_norm_translation"][1, 0]
    )
    rotation, translation = (drawing.axes[k::2] for k in (0, 1))
    assert len({axes.get_ylim() for axes in rotation}) == 1
    assert len({axes.get_ylim() for axes in translation}) == 1
    assert rotation[0].get_ylim() != translation[0].get_ylim()


@unarranged
def test_the_lyapunov_function_has_no_parts(se3, opened, picture):
    drawing = picture(RunsFigure(signal="lyapunov", log=True), opened(se3))
    assert [axes.get_title() for axes in drawing.axes] == ["EqT", "GT", "nog", "asym"]
    assert {axes.get_yscale() for axes in drawing.axes} == {"log"}


@unarranged
def test_an_odd_number_of_controllers_leaves_a_place_empty(so3, opened, picture):
    drawing = picture(RunsFigure(controllers=["eqt", "gt", "nog"]), opened(so3))
    assert [axes.get_title() for axes in drawing.axes] == ["EqT", "GT", "nog"]
    numbered = [len(axes.get_xticklabels()) > 0 for axes in drawing.axes]
    assert numbered == [False, True, True]


def test_a_single_controller_fills_the_width(so3, opened, picture):
    (axes,) = picture(RunsFigure(controllers=["gt"]), opened(so3)).axes
    assert axes.get_position().width > 0.8


@unarranged
def test_a_shared_scale_has_numbers_for_the_widest_of_its_panels(so3, altered, opened):
    """The last law spans a decade, and the first nine."""
    values = np.ones_like(opened(so3)["pose_error"])
    values[0] = np.logspace(0, -9, values.shape[-1])
    values[-1] = np.logspace(0, -1.5, values.shape[-1])
    panel = RunsFigure(log=True).draw([altered(so3, pose_error=values)]).axes[0]
    low, high = panel.get_ylim()
    assert low < 1e-2  # nine decades but for the error of the solver
    assert np.count_nonzero((low <= panel.get_yticks()) & (panel.get_yticks() <= high)) >= 2
