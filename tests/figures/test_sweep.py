"""The figures of sweeps."""

from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure
from said import error_of
from scipy.stats import binomtest

from eqt_cli.analysis.intervals import Interval, Resampling, share
from eqt_cli.analysis.maps import NOBODY, compare_map, front
from eqt_cli.extend import EqtError, Forest, Pareto, Settled, ShownSweep, SweepFigure
from eqt_cli.figures import sweep_figures
from eqt_cli.figures.cells import FEW, key_label, number_values
from eqt_cli.figures.layout import hide_crowded
from eqt_cli.results.quantity import SweptKey, briefly

pytestmark = pytest.mark.usefixtures("unarranged")

ONE = [{"grid": {"gains.kd": [0.25, 0.5, 1, 2]}}]
TWO = [{"grid": {"gains.kp": [1, 2, 4]}}, {"grid": {"inertia": [[1.0, 2.0, 3.0], [1.0, 1.0, 1.0]]}}]
BOTH = [{"grid": {"gains.kp": [1, 2], "gains.kd": [0.5, 1]}}]
LINKED = [{"zip": {"gains.kd": [0.5, 1], "gains.kp": [1, 2]}}]


@pytest.fixture
def swept(simulate, opened):
    def of(sweep, **changes):
        return opened(simulate(sweep=sweep, **{"controllers": ["eqt", "gt"]} | changes))

    return of


def test_one_key_gives_curves_of_means_with_bands(swept, picture):
    results = swept(ONE)
    drawing = picture(SweepFigure(metric="effort"), results)
    (panel,) = drawing.axes
    assert panel.get_xscale() == "log"
    assert panel.get_xlabel() == r"$k_d$ $(\mathrm{N\,m\,s})$"
    for controller, line in enumerate(panel.lines):
        np.testing.assert_array_equal(line.get_xdata(), [0.25, 0.5, 1, 2])
        expected = results["effort"][:, controller].mean(axis=-1)
        np.testing.assert_allclose(line.get_ydata(), expected, rtol=1e-14)
    assert len(panel.collections) == 2


def test_bands_over_a_key_are_of_the_two_laws_that_are_compared_first(swept, picture):
    drawing = picture(SweepFigure(), swept(ONE, controllers=["eqt", "gt", "nog"]))
    (panel,) = drawing.axes
    assert [band.get_label() for band in panel.collections] == ["EqT", "GT"]
    assert len(panel.lines) == 3
    assert "Bands are those of EqT and GT." in drawing.get_supxlabel()


def test_few_values_are_the_ticks_and_no_marker_is_cut(swept, picture):
    (panel,) = picture(SweepFigure(), swept(ONE)).axes
    assert [text.get_text() for text in panel.get_xticklabels()] == ["0.25", "0.5", "1", "2"]
    assert panel.get_xticks(minor=True).size == 0
    low, high = panel.get_xlim()
    assert low < 0.25 and high > 2


def test_controllers_have_markers_of_their_own_which_hide_no_other(swept, picture):
    (panel,) = picture(SweepFigure(), swept(ONE)).axes
    assert [line.get_marker() for line in panel.lines] == ["o", "s"]
    assert {line.get_markerfacecolor() for line in panel.lines} == {"none"}


@pytest.mark.parametrize(
    ("values", "texts"),
    [
        ([0.1, 0.11, 5], ["0.1", "0.11", "5"]),
        ([-1, 0, 1], [r"$\mathdefault{-1}$", "0", "1"]),
        ([1e-5, 1], [r"$1 \times 10^{-5}$", "1"]),
    ],
)
def test_few_values_are_written(values, texts):
    axes = Figure().add_subplot()
    number_values(axes, np.array(values, dtype=float))
    assert [text.get_text() for text in axes.get_xticklabels()] == texts
    assert list(axes.get_xticks()) == values


def test_a_value_is_left_out_that_would_cover_the_one_before():
    axes = Figure().add_subplot(xlim=(0, 5.1))
    number_values(axes, np.array([0.1, 0.11, 5]))
    hide_crowded(axes.xaxis)
    assert [text.get_text() for text in axes.get_xticklabels()] == ["0.1", "5"]


def test_many_values_get_round_numbers():
    axes = Figure().add_subplot()
    values = np.linspace(0.123, 1, FEW + 1)
    number_values(axes, values)
    assert values[0] not in axes.get_xticks()


def test_two_keys_give_a_map_per_controller_on_one_scale(swept, picture):
    results = swept(TWO)
    drawing = picture(SweepFigure(), results)
    maps = [axes.collections[0] for axes in drawing.axes[:2]]
    for controller, image in enumerate(maps):
        found = results["mean_attitude_error"][:, controller].mean(axis=-1).reshape(3, 2)
        np.testing.assert_allclose(np.asarray(image.get_array()).reshape(2, 3), found.T)
    assert maps[0].get_clim() == maps[1].get_clim()
    assert [tick.get_text() for tick in drawing.axes[0].get_yticklabels()] == [
        "[1, 2, 3]",
        "[1, 1, 1]",
    ]


def test_numbers_in_cells_keep_their_colours_in_a_report(swept, picture):
    """A report takes white for the background and black for the text of its page."""
    figure = picture(SweepFigure(), swept(TWO))
    written = {text.get_color() for panel in figure.axes for text in panel.texts}
    assert written and not written & {"white", "black"}


def test_keys_that_change_together_are_one_axis(swept):
    assert [axis.key for axis in ShownSweep(swept(LINKED), "sweep").axes] == ["gains.kd"]


def test_pareto_shows_every_point_and_the_front(swept, picture):
    results = swept(ONE)
    (panel,) = picture(Pareto(), results).axes
    cost = results["effort"].mean(axis=-1)
    np.testing.assert_allclose(panel.collections[0].get_offsets()[:, 0], cost[:, 0], rtol=1e-14)
    assert len(panel.lines) == 2


def test_the_front_is_what_none_betters():
    cost = np.array([3.0, 1.0, 2.0, 2.5, np.nan, 4.0])
    error = np.array([1.0, 3.0, 2.0, 2.5, 0.0, 1.0])
    assert front(cost, error).tolist() == [1, 2, 0]


def test_pareto_is_of_design_choices(swept):
    results = swept(NEAR_A_HALF_TURN, **STARTS)
    assert error_of(Pareto().draw, [results]) == (
        f"{results.path}: figure 'pareto' shows a trade-off between design choices, which are "
        "gains and options of laws; here is swept: initial.pose.angle, initial.velocity.speed"
    )


@pytest.mark.parametrize(
    ("texts", "words"),
    [
        (['{"torque": [0, 1]}', '{"torque": ["cos(t)", -1]}'], ["[0, 1]", "[cos(t), −1]"]),
        (['[{"kind": "lag", "time_constant": 0.1}]', "[]"], ["lag, time constant 0.1", "none"]),
        (['[{"kind": "lag", "k": 1}]', '[{"kind": "lag", "k": 2}]'], ["1", "2"]),
        (["ideal", "limit"], ["ideal", "limit"]),
    ],
)
def test_swept_mappings_are_in_words(texts, words):
    assert briefly(texts) == words


@pytest.mark.parametrize("figure", [SweepFigure(), Pareto()])
def test_a_single_experiment_is_refused(figure, so3, opened):
    with pytest.raises(EqtError, match="shows sweeps, and this is a single experiment"):
        figure.draw([opened(so3)])


def test_more_keys_than_two_are_refused(swept):
    three = [{"grid": {"gains.kp": [1, 2], "gains.kd": [1, 2], "ensemble.seed": [1, 2]}}]
    results = swept(three, ensemble={"runs": 1}, time={"duration": 0.1, "samples": 3})
    with pytest.raises(EqtError, match=r"one or two swept keys, and here are 3 \("):
        SweepFigure().draw([results])


def altered_sweep(swept, altered, sweep=TWO, **arrays):
    """A sweep some of whose numbers are replaced."""
    results = swept(sweep)
    changed = {name: change(results[name].copy()) for name, change in arrays.items()}
    return altered(results.path, **changed)


def failed(status, place=(1, 0, 0)):
    """Of one run at the second point."""
    status[place] = 1
    return status


def unsettled(settling):
    """At the first point one run settles, and sooner than any other run; at the others all do."""
    settling[:] = 0.5
    settling[0] = np.nan
    settling[0, :, 0] = 0.1
    return settling


def test_a_point_of_which_one_run_settles_is_not_the_best(swept, altered):
    results = altered_sweep(swept, altered, settling_time=unsettled)
    runs, horizon = results.runs, results.horizon
    drawing = SweepFigure(metric="settling_time").draw([results])
    cells = np.asarray(drawing.axes[0].collections[0].get_array()).reshape(2, 3)
    assert cells[0, 0] == pytest.approx((0.1 + (runs - 1) * horizon) / runs)
    assert cells[0, 0] == cells.max() > 0.5
    count = 2 * (runs - 1)
    assert drawing.get_supxlabel().replace("\n", " ") == (
        f"Mean at each point over {runs} runs. settling_time: {count} runs unsettled at "
        f"{horizon:g} s count as {horizon:g} s; means are lower bounds."
    )


def test_a_point_at_which_a_run_failed_has_no_mean(swept, altered):
    results = altered_sweep(swept, altered, status=failed)
    drawing = SweepFigure().draw([results])
    first, second = (
        np.ma.filled(axes.collections[0].get_array(), np.nan) for axes in drawing.axes[:2]
    )
    assert (np.isnan(first).sum(), np.isnan(second).sum()) == (1, 0)
    assert drawing.get_supxlabel().splitlines()[1] == "1 run failed; 1 of 12 means left out."
    results = altered_sweep(swept, altered, BOTH, status=failed)
    offsets = Pareto().draw([results]).axes[0].collections[0].get_offsets()
    assert np.ma.count_masked(np.ma.masked_invalid(offsets)) == 2


def test_curves_leave_out_points_at_which_a_run_failed(swept, altered):
    (panel,) = SweepFigure().draw([altered_sweep(swept, altered, ONE, status=failed)]).axes
    assert [np.isnan(line.get_ydata()).tolist() for line in panel.lines] == [
        [False, True, False, False],
        [False] * 4,
    ]


def test_a_sweep_in_which_runs_fail_everywhere_has_no_figure(swept, altered):
    results = altered_sweep(swept, altered, status=lambda status: failed(status, (..., 0)))
    with pytest.raises(
        EqtError, match="finds no point at which every run has a mean_attitude_error"
    ):
        SweepFigure().draw([results])


# Names, marks and winners -------------------------------------------------------------------------


def test_a_range_that_asks_for_a_logarithmic_scale_gets_one(swept, picture):
    axes = {"gains.kd": {"low": 0.1, "high": 1, "scale": "log"}}
    (panel,) = picture(SweepFigure(), swept([{"lhs": {"points": 3, "axes": axes}}])).axes
    assert panel.get_xscale() == "log"


def test_a_logarithmic_colour_scale_has_plain_numbers(swept):
    drawing = SweepFigure(log=True, metric="mean_pose_error").draw([swept(BOTH)])
    (scale,) = (axes for axes in drawing.axes if axes.get_label() == "<colorbar>")
    low, high = scale.get_ylim()
    numbers = [float(scale.yaxis.get_major_formatter()(at)) for at in scale.get_yticks()]
    assert sum(low <= number <= high for number in numbers) >= 2


def test_cells_with_failed_runs_are_hatched(swept, altered):
    results = swept(BOTH)
    best = int(results["mean_pose_error"][:, 0].mean(axis=-1).argmin())
    status = np.zeros_like(results["status"])
    status[best, 0, 0] = 1
    changed = altered(results.path, status=status)
    panel = SweepFigure().draw([changed]).axes[0]
    hatched = [patch for patch in panel.patches if patch.get_hatch()]
    assert [patch.get_hatch() for patch in hatched] == ["xxxx"]


@pytest.mark.needs("sweeps")
def test_winners_are_those_of_the_comparison(swept, altered, picture):
    from eqt_cli.extend import Winners

    results = swept(TWO, **MORE_RUNS)
    effort = results["effort"].copy()
    effort[1, 0] /= 100
    effort[4, 1] /= 100
    results = altered(results.path, effort=effort)
    found = compare_map(results, "effort", Resampling(confidence=0.9, resamples=999))
    assert [cell.winner for cell in found.cells] == [NOBODY, 0, NOBODY, NOBODY, 1, NOBODY]
    image = picture(Winners(metric="effort", confidence=0.9), results).axes[0].collections[0]
    drawn = np.asarray(image.get_array()).reshape(2, 3)
    assert drawn.T.ravel().tolist() == [cell.winner + 1 for cell in found.cells]
    legend = [text.get_text() for text in image.figure.legends[0].get_texts()]
    assert legend == ["undecided: 4", "EqT: 1", "GT: 1"]


@pytest.mark.needs("sweeps")
def test_a_map_without_a_winner_is_refused(swept):
    from eqt_cli.extend import Winners

    with pytest.raises(EqtError, match=r"with 6 runs nobody can.*ensemble\.runs=8"):
        Winners(metric="effort").draw([swept(TWO)])
    with pytest.raises(EqtError, match=r"at any of 6 points \(undecided 6\); draw 'forest'"):
        Winners(metric="effort").draw([swept(TWO, **MORE_RUNS)])


@pytest.mark.needs("sweeps")
def test_cells_over_one_key_are_as_high_as_the_panel(swept, altered, picture):
    from eqt_cli.extend import Winners

    results = swept(ONE, **MORE_RUNS)
    effort = results["effort"].copy()
    effort[1, 0] /= 100  # somebody wins somewhere
    panel = picture(Winners(metric="effort"), altered(results.path, effort=effort)).axes[0]
    box = panel.collections[0].get_window_extent()
    assert box.height == pytest.approx(panel.get_window_extent().height, rel=1e-3)


@pytest.mark.parametrize("width", ["column", "page"])
def test_a_forest_of_twenty_rows_is_at_most_124_mm_high(width, swept):
    points = [{"cases": {f"case {k}": {"gains.kp": 0.1 * k} for k in range(1, 21)}}]
    results = swept(points, ensemble={"runs": 2, "seed": 1})
    drawing = Forest(metric="effort").draw([results], width, captions=[])
    assert 25.4 * drawing.get_figheight() <= 124


CASES = [{"cases": {"ideal": {}, "soft": {"gains.kp": 0.5}, "stiff": {"gains.kp": 4}}}]
MORE_RUNS = {"ensemble": {"runs": 8, "seed": 1}, "settling_threshold": "40 deg"}


def test_a_forest_has_a_row_for_each_case_with_differences_and_shares(swept, altered, picture):
    results = swept(CASES, **MORE_RUNS)
    effort = results["effort"].copy()
    effort[1, 0] = 0.8 * effort[1, 1]
    results = altered(results.path, effort=effort)
    drawing = picture(Forest(metric="effort", confidence=0.5), results)
    left, right = drawing.axes
    (notes,) = (text.get_text() for text in drawing.texts if "per row" in text.get_text())
    assert notes.startswith("8 runs per row. Left of 0: EqT is better. Intervals of 50 %, each by")
    assert [text.get_text() for text in left.get_yticklabels()] == ["ideal", "soft", "stiff"]
    assert left.get_ylim()[0] > left.get_ylim()[1]  # the first case is on top
    # Of eight runs, ranks 3 and 6 have 1 − 2 · (1 + 8 + 28)/2⁸ = 71 %, and 4 and 5 less than 50 %.
    shares = np.sort((effort[:, 0] - effort[:, 1]) / effort[:, 1])
    expected = [Interval(float(np.median(row)), row[2], row[5]) for row in shares]
    drawn = {
        y: x
        for line in left.lines
        if line.get_marker() == "D"
        for x, y in zip(line.get_xdata(), line.get_ydata(), strict=True)
    }
    np.testing.assert_allclose([drawn[k] for k in range(3)], [100 * e.value for e in expected])
    (bars,) = left.collections
    ends = np.array(bars.get_segments())[:, :, 0]
    np.testing.assert_allclose(ends, [[100 * e.low, 100 * e.high] for e in expected])
    (filled,) = (line for line in left.lines if line.get_label() == "EqT − GT, decided")
    # As on maps: a sign test, times three points, and in the mean.
    fewer = (effort[:, 0] < effort[:, 1]).sum(axis=-1)
    p_values = np.array([3 * binomtest(count, 8).pvalue for count in fewer.tolist()])
    agree = (fewer > 4) == (effort[:, 0].mean(axis=-1) < effort[:, 1].mean(axis=-1))
    expected_rows = np.flatnonzero((p_values <= 0.5) & agree)
    assert 0 < len(expected_rows) < 3
    assert list(filled.get_ydata()) == expected_rows.tolist()
    settled = np.isfinite(results["settling_time"]).mean(axis=-1)
    assert 0 < settled.min() < settled.max()
    for law, line in enumerate(right.lines[:2]):
        np.testing.assert_allclose(line.get_xdata(), settled[:, law])


def test_a_forest_is_of_two_laws(swept):
    results = swept(CASES, **MORE_RUNS)
    with pytest.raises(EqtError, match="figure 'forest' compares two laws, and here is one: EqT"):
        Forest(controllers=["eqt"]).draw([results])


@pytest.mark.needs("sweeps")
def test_winners_say_what_they_are_where_runs_failed_too(swept, altered):
    from eqt_cli.extend import Winners

    results = swept(TWO, **MORE_RUNS)
    status, effort = results["status"].copy(), results["effort"].copy()
    status[0, 0, 0] = 1
    effort[1, 0] /= 100
    changed = altered(results.path, status=status, effort=effort)
    drawing = Winners(metric="effort").draw([changed])
    first, *_ = drawing.get_supxlabel().split("\n")
    assert first.startswith("Law and number: the better mean, and the median difference")
    assert "1 run failed; 1 of 12 means left out." in drawing.get_supxlabel()


def test_cases_are_not_joined_by_lines(swept, picture):
    (panel,) = picture(SweepFigure(), swept(CASES, **MORE_RUNS)).axes
    assert {line.get_linestyle() for line in panel.lines} == {"None"}
    first, second = (line.get_xdata() for line in panel.lines)
    assert (second > first).all()  # side by side
    assert panel.get_xlim() == (-0.5, 2.5)  # no name of three leaves the figure


@pytest.mark.parametrize(("metric", "best"), [("effort", np.argmin), ("settled", np.argmax)])
def test_good_is_the_bright_end_of_every_scale(metric, best, swept, picture):
    results = swept(TWO, **MORE_RUNS)
    image = picture(SweepFigure(metric=metric), results).axes[0].collections[0]
    light = np.sum(image.cmap(image.norm(image.get_array()))[..., :3], axis=-1)
    assert np.argmax(light) == best(image.get_array())


def test_angles_are_in_degrees_on_every_scale(swept, picture):
    angles = [{"grid": {"initial.pose.angle": [1.0, 2.0, 3.0]}}]
    (panel,) = picture(SweepFigure(), swept(angles, **STARTS)).axes
    assert panel.get_xlabel() == r"initial angle $(\mathrm{deg})$"
    np.testing.assert_allclose(panel.lines[0].get_xdata(), np.degrees([1.0, 2.0, 3.0]))


# Shares of runs.

FLIES = {"actuators": [{"kind": "lag", "time_constant": 0.1}], "settling_threshold": 1.0}
LAGS = [{"grid": {"actuators[0].time_constant": [0.05, 0.2, 1.0]}}]


def settled_by(results, time):
    """How many runs have, ``(points, controllers)``."""
    return (results["settling_time"] <= time).sum(axis=-1)


@pytest.mark.ci("computes a sweep of its own")
def test_curves_of_shares_have_their_intervals(swept, picture):
    results = swept(LAGS, **FLIES)
    (panel,) = picture(Settled(), results).axes
    counts = settled_by(results, np.inf)
    assert counts.min() < counts.max()  # else the figure would show nothing
    for controller, line in enumerate(panel.lines):
        np.testing.assert_array_equal(line.get_xdata(), [0.05, 0.2, 1.0])
        np.testing.assert_allclose(line.get_ydata(), 100 * counts[:, controller] / 6)
        edges = panel.collections[controller].get_paths()[0].vertices[:, 1]
        ends = [share(int(n), 6, 0.95)[1:] for n in counts[:, controller]]
        np.testing.assert_allclose(
            [edges.min(), edges.max()], 100 * np.array([np.min(ends), np.max(ends)])
        )


@pytest.mark.ci("computes an experiment several times")
def test_a_share_may_be_that_of_an_earlier_time(swept, picture):
    results = swept(LAGS, **FLIES)
    (panel,) = picture(Settled(by=2.0), results).axes
    np.testing.assert_allclose(panel.lines[0].get_ydata(), 100 * settled_by(results, 2.0)[:, 0] / 6)
    assert panel.get_ylabel() == "share settled by 2 s (%)"


def test_a_failed_run_has_not_settled(swept, altered):
    results = swept(LAGS, **FLIES)
    status, times = results["status"].copy(), results["settling_time"].copy()
    times[:] = 0.0
    status[0, 0, 0] = 1
    drawing = Settled().draw([altered(results.path, status=status, settling_time=times)])
    assert drawing.axes[0].lines[0].get_ydata()[0] == pytest.approx(500 / 6)
    assert "1 run failed; counted as not settled." in drawing.get_supxlabel()


def test_runs_are_not_asked_beyond_their_end(swept):
    with pytest.raises(EqtError, match="option 'by': the runs last 4 s, got 5"):
        Settled(by=5.0).draw([swept(ONE)])


STARTS = {
    "initial": {
        "pose": {"kind": "angle", "angle": 1.0},
        "velocity": {"kind": "speed", "speed": 0.0},
    },
    "settling_threshold": "60 deg",
}
NEAR_A_HALF_TURN = [
    {"grid": {"initial.pose.angle": ["90 deg", "179 deg"], "initial.velocity.speed": [0, 1, 3]}}
]


def test_a_map_has_the_share_that_settles_in_every_cell_with_its_interval(swept, picture):
    results = swept(NEAR_A_HALF_TURN, **STARTS)
    drawing = picture(Settled(), results)
    # Counted directly, from the errors at the end: ‖I − R‖_F is 2√2 sin(θ/2).
    within = results["final_pose_error"] <= 2 * np.sqrt(2) * np.sin(np.radians(30))
    counts = within.sum(axis=-1)
    assert len(np.unique(counts)) > 2
    for law, panel in enumerate(drawing.axes[:2]):
        drawn = np.asarray(panel.collections[0].get_array()).reshape(3, 2)
        np.testing.assert_allclose(drawn.T.ravel(), 100 * counts[:, law] / 6)
        texts = [text.get_text() for text in panel.texts if "\n" in text.get_text()]
        ends = [share(int(n), 6, 0.95)[1:] for n in counts[:, law]]
        expected = [
            f"{100 * n / 6:.0f}\n{np.floor(100 * low):.0f}–{np.ceil(100 * high):.0f}"
            for n, (low, high) in zip(counts[:, law], ends, strict=True)
        ]
        assert texts == expected
    top, bottom, _ = drawing.axes
    assert [text.get_text() for text in bottom.get_xticklabels()] == ["90", "179"]
    assert (bottom.get_xlabel(), bottom.get_ylabel()) == (
        "initial angle $(\\mathrm{deg})$",
        "initial angular speed $(\\mathrm{rad/s})$",
    )
    assert (top.get_title(), bottom.get_title()) == ("EqT", "GT")
    said = "A cell per tested value, of 6 runs; below the share, its 95 % Wilson interval."
    assert drawing.get_supxlabel() == said


@pytest.mark.parametrize("figure", [Settled(), SweepFigure()])
def test_the_lowest_map_of_each_column_is_numbered(simulate, opened, figure):
    results = opened(
        simulate(sweep=BOTH, controllers=["eqt", "gt", "nog"], ensemble={"runs": 2, "seed": 1})
    )
    panels = figure.draw([results]).axes[:3]  # two, and one below the first
    written = [
        [text.get_text() for text in axes.get_xticklabels() if text.get_visible()]
        for axes in panels
    ]
    assert written == [[], ["0.5", "1"], ["0.5", "1"]]
    assert [axes.xaxis.label.get_visible() for axes in panels] == [False, True, True]


@pytest.mark.needs("proofs")
@pytest.mark.ci("solves SDPs")
def test_shares_may_stand_beside_what_is_proved(simulate, opened, monkeypatch):
    from eqt_cli.extensions.proofs import certified

    pytest.importorskip("clarabel", reason="the extra certify is not installed")
    monkeypatch.setattr(certified, "proved", lambda *_: (1, True))  # which takes seconds
    laws = {"controllers": ["eqt", "lee2010"], "ensemble": {"runs": 2, "seed": 1}}
    drawing = Settled(certified=60.0).draw([opened(simulate(sweep=ONE, **STARTS, **laws))])
    said = drawing.get_supxlabel().replace("\n", " ")
    of = "proved for the loop and the reference of the first point: "
    assert f"EqT, {of}from every start within 60° at rest" in said
    assert f"Lee 2010, {of}has no proved region: only laws" in said


@pytest.mark.parametrize(
    ("figure", "said"),
    [
        (Settled(certified=180.0), "certified: expected a number less than 180, got 180"),
        (Settled(by=-1.0), "by: expected a number of at least 0, got -1"),
        (Forest(confidence=1.5), "confidence: expected a number less than 1, got 1.5"),
    ],
)
def test_options_have_bounds(figure, said, swept):
    with pytest.raises(EqtError, match=said):
        figure.draw([swept(ONE)])


def test_shares_of_cases_are_beside_each_other(swept, picture):
    (panel,) = picture(Settled(), swept(CASES, **MORE_RUNS)).axes
    assert {line.get_linestyle() for line in panel.lines} == {"None"}


@pytest.mark.parametrize(
    ("share", "said"), [(0, "0"), (0.04, "0.04"), (49.6, "50"), (99.96, "99.96"), (100, "100")]
)
def test_a_share_of_nearly_all_runs_is_not_that_of_all(share, said):
    assert sweep_figures._per_cent(share) == said


def test_an_interval_in_a_cell_is_no_narrower_than_it_is():
    found = [
        sweep_figures._interval(*ends) for ends in ((94.55, 99.82), (0.0, 3.2), (99.98, 99.99))
    ]
    assert found == ["94–100", "0–4", "99.98–99.99"]


def test_bands_of_a_share_are_its_intervals(swept, picture):
    results = swept(LAGS, **FLIES)
    (panel,) = picture(SweepFigure(metric="settled"), results).axes
    counts = settled_by(results, np.inf)[:, 0]
    edges = panel.collections[0].get_paths()[0].vertices[:, 1]
    assert edges.max() == pytest.approx(100 * max(share(int(n), 6, 0.95).high for n in counts))


@pytest.mark.needs("proofs")
def test_certified_rates_are_curves_from_the_rate_at_rest(opened, simulate, picture):
    from eqt_cli.extensions.proofs.figures import Rates

    pytest.importorskip("clarabel", reason="the extra certify is not installed")
    results = opened(simulate(controllers=["eqt", "lee2010"]))
    (panel,) = picture(Rates(velocity=1.0, bounds=3), results).axes
    assert [line.get_label() for line in panel.lines] == [
        "EqT, proved",
        "Lee 2010, proved",
        "EqT, constant",
        "Lee 2010, constant",
    ]
    for proved, constant in zip(panel.lines[:2], panel.lines[2:], strict=True):
        assert proved.get_xdata().tolist() == [0, 0.5, 1]
        rates, bounds = proved.get_ydata(), constant.get_ydata()
        assert (np.diff(rates) <= 0).all() and (rates < bounds).all()
        assert rates[0] == pytest.approx(bounds[0], rel=2e-4)  # what is spared, and rounding


@pytest.mark.needs("proofs")
def test_a_figure_without_any_certified_rate_says_why(opened, simulate, picture):
    from eqt_cli.extensions.proofs.figures import Rates

    pytest.importorskip("clarabel", reason="the extra certify is not installed")
    results = opened(simulate(controllers=["eqt"], gains={"kp": [1.0, 2.0, 3.0], "kd": 0.5}))
    with pytest.raises(EqtError, match="has nothing to show: EqT has a stiffness or damping in"):
        picture(Rates(velocity=1.0), results)


def test_two_keys_of_one_name_are_named_by_themselves():
    lag, other = (
        SweptKey(key, np.zeros(2), {}, label="time constant", unit_of_key="s")
        for key in ("actuators[0].time_constant", "actuators[1].time_constant")
    )
    results = SimpleNamespace(swept_keys=[lag, other], labels=["eqt"], titles=["EqT"])
    assert "actuators[1].time_constant" in key_label(results, other)
    results.swept_keys = [lag]
    assert key_label(results, lag).startswith("time constant $")
