"""The figure of torque components."""

import numpy as np
import pytest
from said import error_of, says

from eqt_cli.extend import ShownRuns
from eqt_cli.figures.layout import EMPTY
from eqt_cli.figures.time_figures import Torque, _places

pytestmark = pytest.mark.usefixtures("unarranged")


def _drawn(axes):
    return {line.get_label(): line.get_ydata() for line in axes.lines}


def test_panels_show_the_root_mean_square_of_every_law_and_the_desired_torque(so3, altered, opened):
    status = np.zeros_like(opened(so3)["status"])
    status[2, 0] = 2
    results = altered(so3, status=status)
    for axis, axes in enumerate(Torque().draw([results]).axes):
        drawn = _drawn(axes)
        assert list(drawn) == ["eqt", "gt", "nog", "asym", "desired"]
        for controller, label in enumerate(results.labels):
            values = results["torque"][controller, status[controller] == 0, :, axis]
            expected = np.linalg.norm(values, axis=0) / np.sqrt(len(values))
            np.testing.assert_allclose(drawn[label], expected, rtol=1e-14)
        np.testing.assert_array_equal(drawn["desired"], abs(results["desired_torque"][:, axis]))
        assert axes.get_ylim()[0] == 0
        assert axes.get_ylabel() == rf"rms $\tau_{{{'xyz'[axis]}}}$ $(\mathrm{{N\,m}})$"


@pytest.mark.parametrize(
    ("group", "share"),
    [
        ("so3", "total"),
        pytest.param("se3", "feedback", marks=pytest.mark.ci("draws six panels twice")),
    ],
)
def test_units_of_a_user_change_what_is_drawn_and_nothing_else(group, share, request, opened):
    result = opened(request.getfixturevalue(group))
    usual, other = (
        Torque(share=share).draw([one]).axes for one in (result, result.in_units(["mN m", "deg/s"]))
    )
    for before, after in zip(usual, other, strict=True):
        turns = "N m" in before.get_ylabel().replace(r"\ ", " ").replace(r"\,", " ")
        assert turns == ("mN" in after.get_ylabel())
        for label, values in _drawn(before).items():
            drawn = _drawn(after)[label]
            np.testing.assert_allclose(drawn, (1e3 if turns else 1) * values, rtol=1e-12)


def test_of_a_single_run_the_torque_itself_is_drawn(so3, altered, opened):
    status = np.ones_like(opened(so3)["status"])
    status[:, 3] = 0
    drawing = Torque(controllers=["eqt"]).draw([altered(so3, status=status)])
    for axis, axes in enumerate(drawing.axes):
        np.testing.assert_array_equal(_drawn(axes)["eqt"], opened(so3)["torque"][0, 3, :, axis])
        np.testing.assert_array_equal(
            _drawn(axes)["desired"], opened(so3)["desired_torque"][:, axis]
        )
    assert drawing.get_supxlabel().splitlines()[-1] == "Curves: 1 run."


@pytest.mark.parametrize("share", ["total", "feedback"])
def test_of_many_runs_the_first_ones_are_drawn_and_the_caption_says_so(
    so3, opened, picture, monkeypatch, share
):
    whole = _drawn(Torque(share=share).draw([opened(so3)]).axes[0])
    monkeypatch.setattr("eqt_cli.figures.time_figures._MOST_RUNS", 4)
    drawing = Torque(share=share).draw([opened(so3)])
    assert "over the first 4 runs." in drawing.get_supxlabel()
    drawn = _drawn(drawing.axes[0])["eqt"]
    assert not np.array_equal(drawn, whole["eqt"])
    if share == "total":
        torque = opened(so3)["torque"][0, :4, :, 0]
        np.testing.assert_allclose(drawn, np.sqrt((torque**2).mean(axis=0)), rtol=1e-14)


def test_feedback_and_feedforward_add_up_to_the_torque(so3, altered, opened):
    status = np.ones_like(opened(so3)["status"])
    status[:, 2] = 0  # of one run, whose torque is drawn with its sign
    alone = altered(so3, status=status)
    whole, forward, back = (
        _drawn(Torque(share=share).draw([alone]).axes[1])
        for share in ("total", "feedforward", "feedback")
    )
    assert "desired" not in back
    for label in ("eqt", "gt", "nog", "asym"):
        assert np.abs(back[label]).max() > 0.1
        np.testing.assert_allclose(forward[label] + back[label], whole[label], atol=1e-14)


def test_feedback_is_what_the_gains_give(simulate, opened, picture):
    # Without errors there is none: the run starts on the reference.
    path = simulate(
        initial={
            "pose": {"kind": "fixed", "coordinates": [0.0, 0.0, 0.0]},
            "velocity": {"kind": "fixed", "coordinates": [0.0, 0.0, 0.0]},
        },
        ensemble={"runs": 1, "seed": 1},
        solver={"rtol": 1e-9, "atol": 1e-12, "cross_check": 0, "error_estimate": False},
        time={"duration": 1.0, "samples": 11},
    )
    drawn = _drawn(picture(Torque(share="feedback"), opened(path)).axes[0])
    assert max(np.abs(values).max() for values in drawn.values()) < 1e-6


def test_a_law_that_does_not_say_what_is_feedforward_is_refused(simulate, opened):
    path = simulate(controllers=["eqt", "logarithmic"])
    assert says(
        error_of(Torque(share="feedback").draw, [opened(path)]),
        f"{path}: figure 'torque' cannot separate the…: the law does not say which of its terms…",
    )


@pytest.mark.parametrize("share", ["feedback", "feedforward"])
def test_a_torque_about_the_only_axis_has_no_name_of_an_axis(
    simulated_once, opened, share, picture
):
    wheel = {"group": "SO2", "inertia": 1.0, "reference": {"kind": "constant"}}
    result = opened(simulated_once("so2", **wheel, controllers=["eqt"]))
    [panel] = picture(Torque(share=share), result).axes
    assert panel.get_ylabel().startswith(rf"rms {share} $\tau$")


def test_torques_and_forces_have_their_own_symbols_units_and_panels(se3, opened, picture):
    labels = [
        axes.get_ylabel()
        for axes in picture(Torque(share="feedback"), opened(se3), width="page").axes
    ]
    assert labels == [
        *(rf"rms feedback $\tau_{{{axis}}}$ $(\mathrm{{N\,m}})$" for axis in "xyz"),
        *(rf"rms feedback $f_{{{axis}}}$ $(\mathrm{{N}})$" for axis in "xyz"),
    ]


@pytest.mark.parametrize(
    ("width", "places"),
    [("page", [["ω", EMPTY], ["vx", "vy"]]), ("column", [["ω", "vx"], [EMPTY, "vy"]])],
)
def test_parts_of_different_size_leave_places_empty(width, places, simulate, opened):
    plane = simulate(
        group="SE2",
        inertia=1.0,
        reference={"torque": ["cos(t)", "1", "0"]},
        ensemble={"runs": 1, "seed": 1},
        controllers=["eqt"],
    )
    assert _places(dict(ShownRuns([opened(plane)], "torque").axes), width) == places


def test_factors_of_a_product_have_units_and_glyphs(simulate, opened, caplog, picture):
    product = simulate(
        group="SO2*R1",
        inertia=1.0,
        gains={"kp": [1.0, 1.0], "kd": 0.5},
        reference={"torque": ["cos(t)", "1"]},
        initial={
            "pose": [{"kind": "haar"}, {"kind": "exp_normal", "std": 1.0}],
            "velocity": {"kind": "normal", "std": 1.0},
        },
        controllers=["eqt"],
    )
    assert [
        axes.get_ylabel() for axes in picture(Torque(share="feedback"), opened(product)).axes
    ] == [r"rms feedback $\tau_{1}$ $(\mathrm{N\,m})$", r"rms feedback $f_{1,2}$ $(\mathrm{N})$"]
    assert not caplog.records  # Matplotlib would say which letters its fonts lack


def test_an_axis_along_which_nothing_pushes_has_no_panel_unless_asked(se3, altered, opened):
    torque = opened(se3)["torque"].copy()
    torque[..., 3:5] = 0.0
    pushed = altered(se3, torque=torque)
    drawing = Torque().draw([pushed])
    assert [axes.get_label() for axes in drawing.axes] == ["ωx", "vz", "ωy", "ωz"]
    assert "Nothing pushes along $f_{x}$, $f_{y}$." in drawing.get_supxlabel()
    (asked,) = Torque(panels=["vx"]).draw([pushed]).axes
    assert asked.get_label() == "vx"


def test_a_torque_that_diverges_does_not_set_the_scale(so3, altered, opened):
    torque = opened(so3)["torque"].copy()
    others = np.abs(torque[[0, 2, 3], ..., 2]).max()
    torque[1, ..., 2] = 10.0 ** np.linspace(-2, 6, 41)
    drawing = Torque().draw([altered(so3, torque=torque)])
    assert max(np.abs(drawing.axes[2].get_ylim())) < 2 * others
    assert "Cut off where it leaves the reference: “GT”." in drawing.get_supxlabel()
    (gone,) = (line for line in drawing.axes[2].lines if line.get_label() == "gt")
    assert np.isnan(gone.get_ydata()[-1])
