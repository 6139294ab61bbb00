"""The figure of commands, and what figures say of a loop that is not the paper's."""

import numpy as np
import pytest
from matplotlib.figure import Figure
from said import error_of, says

from eqt_cli.extend import EqtError
from eqt_cli.figures import time_figures
from eqt_cli.figures.time_figures import Commands, Summary

pytestmark = pytest.mark.usefixtures("unarranged")

FLIES = {
    "actuators": [{"kind": "limit", "limit": 1.0}, {"kind": "lag", "time_constant": 0.1}],
    "control": {"period": 0.1},
    "controllers": ["eqt", "gt"],
}


@pytest.fixture
def flown(simulate, opened):
    return opened(simulate(**FLIES))


def test_what_is_asked_is_drawn_over_what_is_given(flown):
    drawing = Commands(run=2).draw([flown])
    axes = {panel.get_label(): panel for panel in drawing.axes}
    for k, name in enumerate(["ωx", "ωy", "ωz"]):
        given, asked = axes[f"{name} gt"].lines[-2:]
        np.testing.assert_array_equal(given.get_ydata(), flown["torque"][1, 2, :, k])
        np.testing.assert_array_equal(asked.get_ydata(), flown["command"][1, 2, :, k])


def test_held_commands_are_steps(flown, simulate, opened):
    (axes, *_) = Commands().draw([flown]).axes
    given, asked = axes.lines[-2:]
    assert (given.get_drawstyle(), asked.get_drawstyle()) == ("default", "steps-post")
    continuous = simulate(actuators=FLIES["actuators"], controllers=["eqt"])
    (axes, *_) = Commands().draw([opened(continuous)]).axes
    assert axes.lines[-1].get_drawstyle() == "default"


def test_limits_are_in_all_panels_of_a_row_or_in_none(flown, altered):
    torque = flown["torque"].copy()
    torque[0] *= 1e-3  # far below its limit in the first column, not in the second
    torque[1] *= [1, 1, 1e-3]
    drawing = Commands().draw([altered(flown.path, torque=torque)])
    drawn = {
        axes.get_label(): sum("limit" in line.get_label() for line in axes.lines)
        for axes in drawing.axes
    }
    assert [drawn[f"{axis} eqt"] for axis in ("ωx", "ωy", "ωz")] == [2, 2, 0]
    assert [drawn[f"{axis} gt"] for axis in ("ωx", "ωy", "ωz")] == [2, 2, 0]


@pytest.mark.parametrize(("size", "text"), [(1.0, "30 N m"), (1e-5, "300 µN m")])
def test_a_brief_peak_does_not_set_the_scale_and_stands_as_a_number(flown, altered, size, text):
    torque = 0.1 * size * np.sin(np.arange(flown["torque"][0, 0, :, 0].size) / 3)
    torque = np.broadcast_to(torque[:, None], flown["torque"].shape).copy()
    command = torque.copy()
    command[1, 0, 0, 0] = 29.6 * size
    drawing = Commands().draw([altered(flown.path, torque=torque, command=command)])
    axes = {panel.get_label(): panel for panel in drawing.axes}
    assert 0.1 * size <= axes["ωx gt"].get_ylim()[1] < 0.3 * size
    assert [peak.get_text() for peak in axes["ωx gt"].texts] == [text]
    assert not axes["ωx eqt"].texts and "brief peaks" in drawing.get_supxlabel()
    assert axes["ωx eqt"].get_ylim() == axes["ωx gt"].get_ylim()


def test_an_axis_along_which_nothing_pushes_has_no_row_unless_asked(flown, altered):
    torque, command = flown["torque"].copy(), flown["command"].copy()
    torque[..., 1], command[..., 1] = 1e-15, 0.0
    pushed = altered(flown.path, torque=torque, command=command)
    drawing = Commands().draw([pushed])
    assert {axes.get_label().split()[0] for axes in drawing.axes} == {"ωx", "ωz"}
    assert r"Nothing pushes along $\tau_{y}$." in drawing.get_supxlabel()
    asked = Commands(panels=["wy"]).draw([pushed]).axes
    assert {axes.get_label().split()[0] for axes in asked} == {"ωy"}


def shaded(panel, times):
    """At which samples a panel is shaded."""
    inside = np.zeros(len(times), dtype=bool)
    for patch in panel.patches:
        start, end = patch.get_x(), patch.get_x() + patch.get_width()
        inside |= (times >= start) & (times <= end)
    return inside


def test_each_axis_is_shaded_at_its_own_limit(flown):
    drawing = Commands().draw([flown])
    axes = {panel.get_label(): panel for panel in drawing.axes}
    asked, found = flown["command"][0, 0], []
    for k, name in enumerate(["ωx", "ωy", "ωz"]):
        panel = axes[f"{name} eqt"]
        found.append(shaded(panel, flown.times))
        np.testing.assert_array_equal(found[-1], np.abs(asked[:, k]) >= 1.0)
        ends = [line.get_ydata()[0] for line in panel.lines if "limit" in line.get_label()]
        assert ends == ([-1.0, 1.0] if np.abs(flown["torque"][0, 0, :, k]).max() >= 0.5 else [])
    assert len({each.tobytes() for each in found}) > 1
    assert drawing.get_supxlabel().endswith("Run 0.")


def test_laws_without_room_are_named(simulate, opened, picture):
    """The default figures of a result with five laws are drawn, whatever the width."""
    result = opened(simulate(**FLIES | {"controllers": ["eqt", "gt", "nog", "asym", "lee2010"]}))
    drawing = picture(Commands(), result)
    assert {panel.get_label().split()[-1] for panel in drawing.axes} == {"eqt", "gt", "nog", "asym"}
    assert "The first 4 laws; no room for “Lee 2010”." in drawing.get_supxlabel()
    assert "no room" not in Commands().draw([result], "page").get_supxlabel()


def test_a_limit_of_another_kind_shades_all_axes(simulate, opened, picture):
    limit = {"kind": "limit", "limit": 1.0, "norm": True}
    result = opened(simulate(actuators=[limit], controllers=["eqt"]))
    at_limit = result["at_limit"][0, 0] > 0
    assert at_limit.any() and not at_limit.all()
    for panel in picture(Commands(controllers=["eqt"]), result).axes:
        np.testing.assert_array_equal(shaded(panel, result.times), at_limit)


def test_a_loop_without_actuators_is_refused(so3, opened):
    assert says(
        error_of(Commands().draw, [opened(so3)]),
        f"{so3}: figure 'commands' finds no actuators in this…",
    )


def test_a_run_that_failed_is_named(flown, altered):
    status = flown["status"].copy()
    status[1, 3] = 1
    with pytest.raises(EqtError, match="cannot show run 3 of gt, which failed"):
        Commands(run=3).draw([altered(flown.path, status=status)])


def test_a_run_that_is_not_stored_is_named(flown):
    with pytest.raises(EqtError, match="the trajectory of run 9 is not stored; stored are runs 0"):
        Commands(run=9).draw([flown])


def test_a_figure_says_what_the_loop_contains(flown):
    assert (
        Summary()
        .draw([flown])
        .get_supxlabel()
        .replace("\n", " ")
        .startswith("Loop: sampled every 0.1 s; actuators: limit, lag. ")
    )


def test_of_the_papers_loop_there_is_nothing_to_say(so3, opened, picture):
    remark = picture(Summary(), opened(so3)).get_supxlabel()
    assert "Loop" not in remark and remark.endswith("quartiles of EqT and GT, 6 runs.")


THRUSTERS = {
    "kind": "thrusters",
    "matrix": [[1, 0, 0, 0.5], [0, 1, 0, 0.5], [0, 0, 1, 0.5]],
    "low": [-1, -1, -1, -0.5],
    "high": {"uniform": [1.0, 2.0]},
    "time_constant": 0.1,
}


@pytest.mark.ci("flies a vehicle with thrusters")
@pytest.mark.needs("thrusters")
def test_thrusts_are_drawn_within_the_limits_of_the_run(simulate, opened, picture):
    result = opened(simulate(actuators=[THRUSTERS]))
    drawing = picture(Commands(run=2, thrusters=True), result)
    axes = {panel.get_label(): panel for panel in drawing.axes}
    highs = set()
    for k in range(4):
        panel = axes[f"thruster {k + 1} eqt"]
        *limits, line = panel.lines
        assert len(limits) == 2
        np.testing.assert_array_equal(line.get_ydata(), result["thrust"][0, 2, :, k])
        for limit in limits:
            end = limit.get_ydata()[0]
            if end < 0:
                assert end == (-0.5 if k == 3 else -1.0)
            else:
                highs.add(end)
        assert panel.get_ylabel() == rf"thruster {k + 1} $(\mathrm{{N}})$"
    assert len(highs) == 1 and 1.0 < highs.pop() < 2.0


def test_without_thrusters_the_figure_says_so(flown):
    assert error_of(Commands(thrusters=True).draw, [flown]).removeprefix(str(flown.path)) == (
        ": figure 'commands' finds no thrusters on this vehicle; leave out the option 'thrusters'"
    )


def test_a_signal_too_fast_for_its_panel_is_a_range_and_a_mean():
    times = np.linspace(0, 10, 4001)
    slow, fast = np.sin(times), np.sin(times) + 0.5 * (-1.0) ** np.arange(4001)
    for values, expected in ((slow, False), (slow + 1e-3 * (fast - slow), False), (fast, True)):
        axes = Figure().add_subplot()
        assert time_figures._draw(axes, times, values, color="k", label="given") == expected
        assert len(axes.collections) == expected
    low, high = np.ptp(axes.collections[0].get_paths()[0].vertices[:, 1]), np.ptp(fast)
    assert low == pytest.approx(high)
    np.testing.assert_allclose(
        axes.lines[0].get_ydata(), np.sin(axes.lines[0].get_xdata()), atol=0.1
    )


def test_samples_between_which_commands_change_are_noted(simulate, opened, altered):
    """Samples at 12.5 ms of commands at 5 ms may show any frequency."""
    control = {"control": {"period": 0.005}, "controllers": ["gt"], "ensemble": {"runs": 1}}
    path = simulate(**FLIES | control, time={"duration": 0.5, "samples": 41})
    torque = opened(path)["torque"] * 0 + (-1.0) ** np.arange(41)[:, None]
    drawing = Commands().draw([altered(path, torque=torque, command=torque)])
    words = "Stored every 0.0125 s, commanded every 0.005 s: faster motion is not seen."
    assert words in drawing.get_supxlabel()


LOADED = {
    "kind": "thrusters",
    "matrix": [[1, 0, 0, 1, 0], [0, 1, 0, 0, 1], [0, 0, 1, 0, 0]],
    "low": -1.0,
    "high": 2.0,
}


@pytest.mark.ci("flies a vehicle with thrusters")
@pytest.mark.needs("paths", "thrusters")
def test_a_map_shows_when_each_of_many_thrusters_is_at_its_limit(simulate, opened, altered):
    """Of gt, from 1 s to 3 s, thruster 2 pushes back with 0.6 N of 1 N and thruster 4 with 2 N."""
    path = simulate(**FLIES | {"actuators": [LOADED]})
    thrust = 0 * opened(path)["thrust"]
    between = (opened(path).times > 1) & (opened(path).times < 3)
    thrust[1, 0, between, 1], thrust[1, 0, between, 3] = -0.6, 2.0
    drawing = Commands(thrusters=True).draw([altered(path, thrust=thrust)])
    eqt, gt = drawing.axes
    assert [axes.get_title() for axes in (eqt, gt)] == ["EqT", "GT"]
    assert [text.get_text() for text in gt.texts] == ["0 %", "60 %", "0 %", "100 %", "0 %"]
    assert "limits −1 and 2 N" in drawing.get_supxlabel().replace("\n", " ")
    bars = [bars for bars in gt.collections if bars.get_paths()]
    assert not any(bars.get_paths() for bars in eqt.collections)
    for bar, row in zip(bars, (1, 3), strict=True):
        (left, low), (right, high) = bar.get_paths()[0].get_extents().get_points()
        assert (low + high) / 2 == pytest.approx(row)
        assert (left, right) == pytest.approx((1, 3), abs=0.11)  # a sample
    few = Commands(thrusters=True, panels=["thruster 2"]).draw([opened(path)])
    assert [len(axes.lines) for axes in few.axes] == [3, 3]


def test_many_axes_and_laws_are_norms_of_parts(simulate, opened, altered):
    changes = {"group": "SE3", "inertia": 1.0, "actuators": [{"kind": "limit", "limit": 1.0}]}
    laws = {"controllers": ["eqt", "gt", "nog"], "ensemble": {"runs": 1}}
    path = simulate(**FLIES | changes | laws, reference={"torque": ["cos(t)", 0, 0, 1, 0, 0]})
    drawing = Commands().draw([opened(path)])
    first, other = (axes.get_ylabel() for axes in drawing.axes if axes.get_ylabel())
    assert len(drawing.axes) == 6 and r"\tau" in first and "|f" in other
    given, asked = drawing.axes[4].lines
    for line, signal in ((given, "torque"), (asked, "command")):
        wanted = np.sqrt(np.sum(opened(path)[signal][1, 0, :, 3:] ** 2, axis=1))
        np.testing.assert_allclose(line.get_ydata(), wanted, rtol=1e-12)
    beyond = np.abs(opened(path)["command"][1, 0]).max(axis=1) >= 1.0
    np.testing.assert_array_equal(shaded(drawing.axes[4], opened(path).times), beyond)
    assert len(Commands(panels=["wx", "vz"]).draw([opened(path)]).axes) == 6
