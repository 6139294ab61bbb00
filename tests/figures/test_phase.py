"""The figure of the phase plane of the error."""

import numpy as np
import pytest

from eqt_cli.base.errors import EqtError
from eqt_cli.figures.render import curves, figure_from
from eqt_cli.figures.run_figures import PhaseFigure

pytestmark = pytest.mark.usefixtures("unarranged")

HALF_TURN = 2 * np.sqrt(2)  # ‖I − R‖_F² = 2 tr(I − R) = 4 (1 − cos π)


def marks(axes):
    """Where the triangles are."""
    return [line.get_xdata()[0] for line in axes.lines if line.get_marker() == "*"]


def test_every_good_run_is_a_path_with_start_and_end(so3, altered, opened):
    results = opened(so3)
    status = np.zeros_like(results["status"])
    status[0, 2] = 1
    drawing = PhaseFigure().draw([altered(so3, status=status)])
    lines = {line.get_label(): line for line in drawing.axes[0].lines}
    assert [name for name in lines if name.startswith("run")] == [
        f"run {k}" for k in (0, 1, 3, 4, 5)
    ]
    np.testing.assert_array_equal(lines["run 3"].get_xdata(), results["pose_error"][0, 3])
    np.testing.assert_array_equal(lines["run 3"].get_ydata(), results["velocity_error"][0, 3])
    good = status[0] == 0
    for name, at in (("start", 0), ("end", -1)):
        np.testing.assert_array_equal(lines[name].get_xdata(), results["pose_error"][0, good, at])


def test_only_the_first_runs_are_drawn_and_the_legend_says_so(so3, opened, picture):
    drawing = picture(PhaseFigure(runs=2), opened(so3))
    for axes in drawing.axes:
        assert [line.get_label() for line in axes.lines][:4] == ["run 0", "run 1", "start", "end"]
    texts = [text.get_text() for text in drawing.legends[0].get_texts()]
    assert texts[0] == "first 2 runs"


def test_a_shade_shows_where_all_runs_pass_and_is_no_number_to_keep(so3, opened, picture):
    shaded = picture(PhaseFigure(runs=1), opened(so3))
    (cells,) = shaded.axes[0].collections
    assert 0 < np.ma.max(cells.get_array()) <= 1
    plain = picture(PhaseFigure(runs=1, density=False), opened(so3))
    assert not plain.axes[0].collections
    assert [c.name for c in curves(shaded)] == [c.name for c in curves(plain)]


def test_paths_have_arrows(so3, opened, picture):
    axes = picture(PhaseFigure(runs=3), opened(so3)).axes[0]
    assert len([text for text in axes.texts if text.arrow_patch is not None]) == 6


def test_panels_share_scales_that_start_at_zero(so3, opened, picture):
    drawing = picture(PhaseFigure(), opened(so3))
    (across,) = {axes.get_xlim() for axes in drawing.axes}
    (up,) = {axes.get_ylim() for axes in drawing.axes}
    assert (across[0], up[0]) == (0, 0)
    assert up[1] > opened(so3)["velocity_error"].max()


def test_parts_have_columns_and_half_turns_are_rotations(se3, altered, opened):
    error = opened(se3)["pose_error_rotation"]
    error *= 2.8 / error.max()
    drawing = PhaseFigure().draw([altered(se3, pose_error_rotation=error)])
    rotation, translation = drawing.axes[0::2], drawing.axes[1::2]
    assert drawing.axes[1].get_title() == "EqT, translation"
    assert [axes.get_xlabel() for axes in drawing.axes[:2]] == [
        r"$\|I - R_{\mathrm{E}}\|_{\mathrm{F}}$",
        r"$\|p_{\mathrm{E}}\|$ $(\mathrm{m})$",
    ]
    for axes in rotation:
        np.testing.assert_allclose(marks(axes), [HALF_TURN], rtol=1e-12)
    assert not any(marks(axes) for axes in translation)


def test_half_turns_are_marked_only_where_the_scale_reaches_them(so3, altered, opened):
    far = opened(so3)["pose_error"]
    far *= 2.75 / far.max()
    drawing = PhaseFigure().draw([altered(so3, pose_error=far)])
    assert [len(marks(axes)) for axes in drawing.axes] == [1] * 4
    assert [text.get_text() for text in drawing.legends[0].get_texts()][-1] == "unstable equilibria"
    drawing = PhaseFigure().draw([altered(so3, pose_error=far / 2)])
    assert not any(marks(axes) for axes in drawing.axes)
    assert [text.get_text() for text in drawing.legends[0].get_texts()][-1] == "where runs pass"


def test_logarithmic_scales(so3, opened, picture):
    for axes in picture(PhaseFigure(log=True), opened(so3)).axes:
        assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")


@pytest.mark.parametrize("make", [PhaseFigure, lambda **options: figure_from("phase", options)])
def test_a_figure_of_no_runs_is_refused(make, so3, opened):
    with pytest.raises(EqtError) as caught:
        make(runs=0).draw([opened(so3)])
    assert str(caught.value) == "figure 'phase': runs: expected a whole number of at least 1, got 0"
