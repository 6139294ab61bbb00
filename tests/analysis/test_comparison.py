"""Comparisons of controllers on results whose numbers are known."""

import math
from dataclasses import replace

import numpy as np
import pytest
from case_tables import refusal
from said import says
from scipy.stats import binomtest

from eqt_cli.analysis.claims import AtMost, judge_at_most, judge_less
from eqt_cli.analysis.compare import compare
from eqt_cli.analysis.comparison import Numbers
from eqt_cli.analysis.comparison_tables import records, text_tables, unsettled
from eqt_cli.analysis.intervals import Resampling, Word, resolved_differences
from eqt_cli.analysis.maps import NOBODY, compare_map
from eqt_cli.extend import EqtError, SampledRuns
from eqt_cli.results.metrics import decay_rate
from eqt_cli.results.origin import Experiment
from eqt_cli.results.quantity import Latex, Plain, Window

RUNS = 40
NOISE = np.random.default_rng(5).normal(size=RUNS)
LEVELS = np.linspace(1.0, 2.0, 8)


def only(rows):
    (row,) = rows
    return row


@pytest.fixture
def torque_claim(make_result):
    """What is claimed of mean torques, which are these of each law."""

    def claimed(*levels, labels=("eqt", "gt")):
        values = make_result.constant(*levels)
        results = make_result([*labels], {"torque_norm": values, "lyapunov": values})
        claims = records(compare(results))["claims"]
        return only([each for each in claims if each["metric"] == "mean_torque"])

    return claimed


@pytest.fixture
def torques(make_result):
    """Two controllers on equal initial states: gt takes 0.5 N m more, and a little by chance."""
    low = 2 + NOISE
    signals = {"torque_norm": make_result.constant(low, low + 0.5 + 0.01 * NOISE**2)}
    return make_result(["eqt", "gt"], signals | {"lyapunov": signals["torque_norm"]})


def test_pairs_are_differences_on_the_same_initial_states(torques):
    pair = only(compare(torques, metrics=["mean_torque"]).pairs)
    expected = 0.5 + 0.01 * (NOISE**2).mean()
    assert pair.difference == pytest.approx(expected, rel=1e-12)
    # The spread of each is 1; that of the differences is a hundredth of it.
    assert pair.low < expected < pair.high < pair.low + 0.02
    assert pair.relative == pytest.approx(expected / pair.values[1].mean(), rel=1e-12)


def test_a_pair_is_shown_in_a_line(torques):
    pair = only(compare(torques, metrics=["mean_torque"]).pairs)
    numbers = f"{pair.difference:.4f} [{pair.low:.4f}, {pair.high:.4f}]"
    assert repr(pair) == f"Pair(gt − eqt, mean_torque 0–20 s: {numbers}, 40 pairs)"


def test_a_mean_of_times_that_lie_beyond_the_horizon_gives_way_to_shares(make_result):
    def shown(latest):
        metrics = {"settling_time": [[0.5, latest], [0.5, 0.5]]}
        levels = compare(make_result(["eqt", "gt"], metrics=metrics)).levels
        return {x.measured.quantity.name: x.mean for x in levels if x.controller == "eqt"}

    assert shown(0.7) == {"settling_time": 0.6}
    assert shown(np.nan) == {"settled": 0.5}


def test_pairs_with_different_lyapunov_functions_are_not_compared_by_them(make_result):
    levels = make_result.constant(*(np.full(RUNS, level) for level in (1.0, 2.0, 3.0)))
    signals = {"lyapunov": np.exp(-levels * make_result.times), "torque_norm": levels}
    results = make_result(["eqt", "gt", "lee2010"], signals)
    results.described = Experiment(functions={"eqt": "L₁", "gt": "L₁", "lee2010": "L₂"})
    pairs = compare(results, metrics=["decay_rate", "mean_torque"]).pairs
    compared = {(pair.first, pair.second, pair.measured.quantity.name) for pair in pairs}
    assert compared == {
        ("gt", "eqt", "decay_rate"),
        ("gt", "eqt", "mean_torque"),
        ("lee2010", "eqt", "mean_torque"),
        ("lee2010", "gt", "mean_torque"),
    }


def test_ties_count_half(make_result):
    signals = {"torque_norm": make_result.constant([1, 1, 1, 1], [1, 1, 2, 0])}
    results = make_result(["a", "b"], signals | {"lyapunov": signals["torque_norm"]})
    assert only(compare(results, metrics=["mean_torque"]).pairs).first_better == 0.5


def test_what_differs_by_rounding_is_equal(make_result):
    low = 2 + NOISE
    values = make_result.constant(low, low * (1 - 1e-9))
    results = make_result(["eqt", "gt"], {"torque_norm": values, "lyapunov": values})
    comparison = compare(results, metrics=["mean_torque"])
    pair = only(comparison.pairs)
    assert (pair.difference, pair.low, pair.high, pair.first_better) == (0, 0, 0, 0.5)
    assert pair.runs_to_decide is None
    assert [j.verdict for j in comparison.judgements if j.pair] == ["undecided"]


def test_more_of_a_rate_is_better(make_result):
    fast, slow = np.exp(-2 * make_result.times), np.exp(-make_result.times)
    results = make_result(["a", "b"], {"lyapunov": np.array([[fast] * 3, [slow] * 3])})
    comparison = compare(results, metrics=["decay_rate"])
    assert only(comparison.pairs).first_better == 0.0
    assert [level.mean for level in comparison.levels] == pytest.approx([1.0, 0.5], rel=1e-12)


def test_a_failed_run_takes_its_pair_along(make_result):
    values = make_result.constant(np.arange(8.0), np.arange(8.0) + 1)
    values[0, 3] = np.nan
    status = np.zeros((2, 8))
    status[0, 3] = status[1, 5] = 1
    results = make_result(["a", "b"], {"torque_norm": values, "lyapunov": values}, status=status)
    comparison = compare(results, metrics=["mean_torque"])
    pair = only(comparison.pairs)
    assert (pair.pairs, pair.failed, pair.undefined) == (6, 2, 0)
    assert [(x.runs, x.failed, x.undefined) for x in comparison.levels] == [(7, 1, 0), (7, 1, 0)]
    assert comparison.failed == {"a": 1, "b": 1}
    assert pair.difference == 1.0


def test_a_run_without_a_value_is_undefined_and_not_failed(make_result):
    efforts = [[1.0, np.nan, np.nan, 4.0, 5.0], [2.0, 3.0, np.nan, 4.5, np.nan]]
    results = make_result(["a", "b"], metrics={"effort": efforts}, status=[[0] * 5, [0] * 4 + [1]])
    comparison = compare(results, metrics=["effort"])
    assert [(x.runs, x.failed, x.undefined) for x in comparison.levels] == [(3, 0, 2), (3, 1, 1)]
    pair = only(comparison.pairs)
    assert (pair.pairs, pair.failed, pair.undefined) == (2, 1, 2)
    assert pair.values.tolist() == [[2.0, 4.5], [1.0, 4.0]]


def test_the_spread_of_runs_and_of_their_differences(make_result):
    """Of 2, 4, 9 and 3, 3, 3 runs; the differences are 1, −1 and −6."""
    efforts = [[2.0, 4.0, 9.0], [3.0, 3.0, 3.0]]
    comparison = compare(make_result(["a", "b"], metrics={"effort": efforts}), metrics=["effort"])
    found = [(level.median, level.standard_deviation) for level in comparison.levels]
    assert found == [(4.0, pytest.approx(np.sqrt(13))), (3.0, 0.0)]
    pair, other = only(comparison.pairs), only(comparison.against("b"))
    assert pair.cohen_d == pytest.approx(-2 / np.sqrt(13))
    assert (pair.relative, pair.first_better) == (pytest.approx(-2 / 5), pytest.approx(2 / 3))
    assert (other.first, other.difference) == ("a", -pair.difference)
    assert (other.relative, other.first_better) == (pytest.approx(2 / 3), pytest.approx(1 / 3))


def test_one_run_has_no_spread_and_none_has_no_mean(make_result):
    efforts = [[2.0, np.nan], [np.nan, np.nan]]
    comparison = compare(make_result(["a", "b"], metrics={"effort": efforts}), metrics=["effort"])
    one, none = comparison.levels
    assert (one.mean, one.median) == (2.0, 2.0)
    assert np.isnan([one.standard_deviation, none.mean, none.median]).all()
    pair = only(comparison.pairs)
    assert np.isnan([pair.difference, pair.relative, pair.first_better, pair.cohen_d]).all()


def test_identical_runs_are_one_and_none_of_them_is_undefined(make_result):
    pose = np.broadcast_to(np.eye(3), (2, 6, 41, 3, 3))
    results = make_result(["a", "b"], metrics={"effort": [[2.0] * 6, [3.0] * 6]},
        more={"initial_pose": pose})  # fmt: skip
    levels = compare(results, metrics=["effort"]).levels
    assert [(x.mean, x.runs, x.undefined) for x in levels] == [(2.0, 1, 0), (3.0, 1, 0)]
    assert np.isnan([x.low for x in levels]).all()


@pytest.mark.parametrize(("runs", "runs_needed"), [(4, None), (5, 10)])
def test_five_pairs_are_enough_to_say_how_many_would_decide(make_result, runs, runs_needed):
    """(1.96 + 0.84)²/d² + 1.96²/2 runs; the differences 0, 2, 0, 2 and 1 have d = 1."""
    first = np.array([0.0, 2.0, 0.0, 2.0, 1.0])[:runs] + np.arange(runs)
    second = np.arange(runs, dtype=float)
    results = make_result(["a", "b"], metrics={"effort": [first, second]})
    assert only(compare(results, metrics=["effort"]).pairs).runs_to_decide == runs_needed


def test_shares_are_compared_on_the_runs_that_neither_law_has_failed(make_result):
    """Of five pairs, one has settled under the first law only; p is ½ from either side."""
    settled = [[1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0], [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]]
    status = [[0, 0, 0, 0, 0, 0, 1], [0, 0, 0, 0, 0, 1, 0]]
    results = make_result(["a", "b"], metrics={"settled": settled}, status=status)
    comparison = compare(results, metrics=["settled"])
    pair = only(comparison.pairs)
    assert (pair.pairs, pair.difference, pair.p_value) == (5, -0.2, 1.0)
    assert [level.mean for level in comparison.levels] == [3 / 6, 1 / 6]
    assert pair.low < -0.2 < pair.high
    # Beside a number whose ties speak for neither law: of seven runs, two are worse.
    beside = compare(make_result(["a", "b"], metrics={"effort": settled}), metrics=["effort"])
    assert only(beside.pairs).p_value == 1.0


def test_runs_that_never_settle_count_as_the_horizon(make_result):
    times = [[3.0, 4.0, np.nan, 5.0, np.nan, 6.0], [4.0, np.nan, np.nan, 4.0, 7.0, 7.0]]
    results = make_result(["a", "b"], metrics={"settling_time": times})
    comparison = compare(results, metrics=["settling_time"])
    pair = only(comparison.pairs)
    assert (pair.pairs, pair.censored, pair.undefined) == (6, 3, 0)
    assert [level.censored for level in comparison.levels] == [2, 2]
    assert comparison.levels[0].mean == pytest.approx((3 + 4 + 20 + 5 + 20 + 6) / 6)
    # Earlier in two runs, later in three, and both beyond the horizon in one.
    assert pair.first_better == pytest.approx(2.5 / 6)


def test_windows_cut_the_signals(make_result):
    ramp = np.broadcast_to(make_result.times, (1, 6, 41)).copy()
    results = make_result(["a"], {"torque_norm": ramp, "lyapunov": ramp})
    windows = [Window(0, 5), Window(5, 10), Window(0.3, 1.1)]
    levels = compare(results, metrics=["mean_torque"], windows=windows).levels
    assert [level.mean for level in levels] == pytest.approx([2.5, 7.5, 0.7], rel=1e-12)


def test_stored_metrics_are_used_where_they_are_the_same_number(make_result):
    # The stored metric knows samples that the stored trajectories may have left out.
    signals = {
        "torque_norm": make_result.constant([1.0] * 6),
        "lyapunov": make_result.constant([1] * 6),
    }
    results = make_result(["a"], signals, {"early_torque": [[7.0] * 6]})
    windows = [Window(0, 5), Window(0, 4)]
    levels = compare(results, metrics=["mean_torque"], windows=windows).levels
    assert [level.mean for level in levels] == [7.0, 1.0]


def test_results_without_trajectories_have_their_metrics(make_result):
    metrics = {"early_torque": [[1.0] * 6, [2.0] * 6], "settling_time": [[1.0] * 6] * 2}
    comparison = compare(make_result(["eqt", "gt"], metrics=metrics))
    assert [level.measured.quantity.name for level in comparison.levels[::2]] == [
        "mean_torque",
        "settling_time",
    ]
    assert comparison.missing == [
        "No trajectories are stored, so only stored metrics are compared: no other windows, no "
        "parts of other norms, no integral that is not among them, and no test that L never rises. "
        "Set store.trajectories to all for these."
    ]
    assert [judgement.verdict for judgement in comparison.judgements] == ["supported"]


def test_another_window_takes_trajectories(make_result):
    results = make_result(["eqt"], metrics={"early_torque": [[1.0] * 6]})
    assert says(
        refusal(EqtError, compare, results, metrics=["mean_torque"], windows=[Window(1, 2)]),
        f"{results.path}: cannot compute mean_torque over 1:2 s: it…'torque_norm'…",
    )


def test_some_trajectories_of_many(make_result):
    some = make_result.constant([1.0, 2, 3, 4, 5])
    results = make_result(
        ["a"], {"torque_norm": some, "lyapunov": some}, {"effort": [[9.0] * 8]}, stored=5
    )
    comparison = compare(results, metrics=["mean_torque", "effort"])
    assert [level.runs for level in comparison.levels] == [5, 8]
    assert comparison.missing == [
        "Trajectories are stored of the first 5 of 8 runs; numbers that take trajectories are "
        "about those."
    ]


def test_unknown_metric(make_result):
    results = make_result(["a"], metrics={"effort": [[1.0] * 6]})
    with pytest.raises(EqtError, match=r"^unknown metric 'efort'; did you mean 'effort'\? known"):
        compare(results, metrics=["efort"])


def test_norms_with_mixed_units_are_compared_by_their_parts(make_result):
    values = make_result.constant(1 + NOISE**2, 2 + NOISE**2)
    names = ("torque_norm", "torque_norm_rotation", "torque_norm_translation")
    units = dict(zip(names, ("mixed", "N m", "N"), strict=True))
    results = make_result(
        ["eqt", "gt"], dict.fromkeys(names, values) | {"lyapunov": values}, units=units
    )
    comparison = compare(results)
    early = [level.measured for level in comparison.levels[::2]][:4]
    assert [(s.quantity.name, s.unit) for s in early if s.window.stop == 5] == [
        ("mean_torque_rotation", "N m"),
        ("mean_torque_translation", "N"),
    ]
    assert [
        (r["metric"], r["verdict"]) for r in records(comparison)["claims"] if "held" not in r
    ] == [("mean_torque_rotation", "supported"), ("mean_torque_translation", "supported")]


def test_claims_about_attitude_leave_translations_out(make_result):
    values = make_result.constant(1 + NOISE**2, 2 + NOISE**2)
    names = ("pose_error", "pose_error_rotation", "pose_error_translation")
    results = make_result(["gt", "eqt"], dict.fromkeys(names, values) | {"lyapunov": values})
    claimed = [r["metric"] for r in records(compare(results))["claims"] if "held" not in r]
    assert claimed == ["mean_pose_error_rotation"]


def test_too_few_pairs_decide_nothing(torque_claim):
    claim = torque_claim([1.0, 2, 3, 4], [2.0, 3.5, 4, 5])
    assert (claim["verdict"], claim["runs_to_decide"]) == ("undecided", None)
    assert np.isnan(claim["low"])


def test_claims_turn_pairs_as_they_need_them(torque_claim):
    claim = torque_claim(NOISE**2 + 2, NOISE**2 + 1, labels=("gt", "eqt"))
    assert (claim["first"], claim["second"]) == ("eqt", "gt")
    assert claim["difference"] == pytest.approx(-1, rel=1e-12)
    assert claim["low"] <= claim["difference"] <= claim["high"]


def test_claims_go_by_kind_and_not_by_label(make_result):
    values = make_result.constant(NOISE**2 + 1, NOISE**2 + 2)
    signals = {"torque_norm": values, "lyapunov": values}
    results = make_result(["mine", "gt"], signals, kinds=["eqt", "gt"])
    assert [r["first"] for r in records(compare(results))["claims"] if "held" not in r] == ["mine"]


def test_no_claims_about_other_controllers(make_result):
    values = make_result.constant(NOISE**2 + 1, NOISE**2 + 2)
    results = make_result(
        ["eqt", "gt"], {"torque_norm": values, "lyapunov": values}, kinds=["a", "b"]
    )
    assert compare(results).judgements == []


@pytest.mark.parametrize(
    ("runs", "rising", "verdict"),
    [(60, 0, "supported"), (58, 0, "undecided"), (60, 1, "not supported")],
)
def test_claims_on_every_run(make_result, runs, rising, verdict):
    falling = np.exp(-make_result.times)
    values = np.tile(falling, (1, runs, 1))
    values[0, :rising, 5] = 1.1
    (claim,) = records(compare(make_result(["eqt"], {"lyapunov": values})))["claims"]
    assert (claim["verdict"], claim["held"]) == (verdict, runs - rising)


def test_one_point_of_a_sweep(make_result):
    effort = np.arange(24.0).reshape(3, 2, 4)
    results = make_result(["a", "b"], metrics={"effort": effort}, points=3)
    comparison = compare(results.at(2), metrics=["effort"])
    assert [level.mean for level in comparison.levels] == [17.5, 21.5]


def test_sweeps_need_a_point(make_result):
    results = make_result(["a"], metrics={"effort": np.ones((3, 1, 4))}, points=3)
    assert refusal(EqtError, compare, results) == (
        f"{results.path}: controllers are compared within one experiment, and this is a sweep of "
        "3 points; choose one of 0 to 2 with point=…, as "
        f"`eqt show {results.path.parent} --table metrics` lists them"
    )


def test_decay_rate_of_an_oscillating_decay():
    times = np.linspace(0, 20, 401)
    lyapunov = np.exp(-0.6 * times) * (1 + 0.1 * np.cos(7 * times))
    # The oscillation moves the slope by its amplitude over the number of radians, 0.1/140.
    assert decay_rate(SampledRuns(times), lyapunov[None])[0] == pytest.approx(0.3, abs=1e-3)


def test_differences_that_solvers_cannot_tell_are_none():
    first = np.array([1.0, 1.0, -2.0, 0.0, 0.0])
    second = np.array([1 + 1e-7, 1 + 1e-5, -2 - 1e-6, 0.0, -1e-9])
    expected = [0.0, -1e-5, 0.0, 0.0, 1e-9]
    assert resolved_differences(first, second) == pytest.approx(expected, rel=1e-6, abs=0)
    # Relative to the larger one, whichever that is, and whatever its sign.
    edge = 1 + 1.0000005e-6
    for sign in (1.0, -1.0):
        one, other = np.array([sign, sign * edge]), np.array([sign * edge, sign])
        assert not resolved_differences(one, other).any()


@pytest.mark.parametrize(("unit", "claimed"), [("1", ["mean_pose_error"]), ("m", [])])
def test_claims_about_attitude_are_tested_on_errors_that_are_rotations(make_result, unit, claimed):
    values = make_result.constant(1 + NOISE**2, 2 + NOISE**2)
    units = {"pose_error": unit, "mean_pose_error": unit}
    signals = {"pose_error": values, "lyapunov": values}
    metrics = {"mean_pose_error": values[..., 0]}
    results = make_result(["gt", "eqt"], signals, metrics, units=units)
    found = [r["metric"] for r in records(compare(results))["claims"] if "held" not in r]
    assert found == claimed


def test_the_horizon_is_from_the_first_sample_to_the_last(make_result):
    make_result.times = np.linspace(3.0, 23.0, 41)
    torques = make_result.constant([1.0] * 6, [2.0] * 6)
    results = make_result(["a", "b"], {"torque_norm": torques, "lyapunov": torques})
    assert compare(results, metrics=["mean_torque"]).horizon == 20.0


def test_a_comparison_of_some_laws_is_about_these_only(make_result):
    levels = [[k + 1.0] * 4 for k in range(3)]
    status = [[0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 1]]
    results = make_result(["a", "b", "c"], metrics={"effort": levels}, status=status)
    results.described = Experiment(not_matched=["b", "c"])
    some = compare(results, metrics=["effort"], labels=["c", "a"])
    assert some.labels == list(some.titles) == list(some.kinds) == ["a", "c"]
    assert some.failed == {"a": 0, "c": 2}
    assert some.not_matched == ["c"]
    assert [(level.controller, level.mean) for level in some.levels] == [("a", 1.0), ("c", 3.0)]
    assert [(pair.first, pair.second, pair.pairs) for pair in some.pairs] == [("c", "a", 2)]
    whole = compare(results, metrics=["effort"])
    assert (whole.labels, whole.not_matched) == (["a", "b", "c"], ["b", "c"])
    assert len(whole.pairs) == 3


@pytest.mark.parametrize(("estimate", "judged"), [(1e-9, False), (1e-13, True)])
def test_errors_within_their_estimate_are_not_judged(make_result, estimate, judged):
    """Four times the error in each of 40 runs is better for sure, if it is more than rounding."""
    errors = 1e-12 * (2 + 0.1 * np.sin(np.arange(40.0)))
    estimates = np.full((2, 40), estimate)
    metrics = {"mean_pose_error": [errors, 4 * errors], "error_estimate": estimates}
    compared = compare(make_result(["eqt", "gt"], metrics=metrics), metrics=["mean_pose_error"])
    [pair] = compared.rows()
    assert pair.word is (Word.WORSE if judged else Word.UNDECIDED)
    said = "not judged, as both are within the error estimate of 1e-09: mean ‖I − Q_E‖"
    assert (said in compared.answer()) == (not judged)


def test_a_window_is_cut_where_the_runs_end_and_says_so(torques):
    windows = [Window(0, 30), Window(5), Window(0, 20), Window(1.5, 20.5)]
    found = compare(torques, metrics=["mean_torque"], windows=windows)
    assert found.missing == [
        "Window 0:30 is cut to 0:20, since the runs last 20 s.",
        "Window 1.5:20.5 is cut to 1.5:20, since the runs last 20 s.",
    ]


def test_windows_do_not_cut_what_is_of_whole_runs(make_result):
    metrics = {"settling_time": [[1.0] * 6], "early_torque": [[2.0] * 6]}
    torques = make_result.constant([3.0] * 6)
    results = make_result(["a"], {"torque_norm": torques, "lyapunov": torques}, metrics)
    names = ["settling_time", "mean_torque", "early_torque"]
    found = compare(results, metrics=names, windows=[Window(5, 10)])
    assert found.missing[0] == (
        "Windows do not apply to settling_time, early_torque, which have their own windows."
    )
    assert [(x.measured.quantity.name, x.mean) for x in found.levels] == [
        ("settling_time", 1.0),
        ("mean_torque", 3.0),
        ("early_torque", 2.0),
    ]
    assert found.levels[0].measured.window == Window(0, 20)
    assert compare(results, metrics=names).missing == []
    found = compare(results, metrics=names[:1], windows=[Window(0, 5)])
    assert found.missing == ["Windows do not apply to settling_time, which has its own window."]


def test_windows_without_metrics_are_taken_of_the_usual_ones_that_they_fit(make_result):
    torques, metrics = make_result.constant([3.0] * 6), {"mean_pose_error": [[0.5] * 6]}
    results = make_result(["a"], {"torque_norm": torques, "lyapunov": torques}, metrics)
    found = compare(results, windows=[Window(5, 10), Window(0, 20)])
    shown = [(level.measured.quantity.name, str(level.measured.window)) for level in found.levels]
    assert ("mean_torque", "5:10") in shown and ("mean_torque", "0:20") in shown
    assert ("mean_pose_error", "0:20") in shown and ("mean_pose_error", "5:10") not in shown


@pytest.mark.parametrize(
    ("ends", "verdict"),
    [
        *(((-1.0, -0.5), "supported"), ((-1.0, 0.0), "undecided"), ((-1.0, 1.0), "undecided")),
        *(((0.0, 0.0), "undecided"), ((0.0, 1.0), "not supported")),
        *(((0.5, 1.0), "not supported"), ((np.nan, np.nan), "undecided")),
    ],
)
def test_less_is_an_interval_below_0(torques, ends, verdict):
    pair = only(compare(torques, metrics=["mean_torque"]).pairs)
    low, high = ends
    judged = judge_less(replace(pair, low=low, high=high, median_low=low, median_high=high))
    assert judged.verdict == verdict
    if verdict != "undecided":  # the median must be on the same side
        mixed = replace(pair, low=low, high=high, median_low=-1.0, median_high=1.0)
        assert judge_less(mixed).verdict == "undecided"
    assert (judged.runs_to_decide, judged.held, judged.runs) == (pair.runs_to_decide, 0, 0)


def test_a_claim_about_every_run_is_held_at_its_bound(make_result):
    """The share of runs is at least 0.05^(1/n) if all n hold it; Clopper and Pearson, one-sided."""
    measured = np.array([[0.5] * 60, [0.5] * 59 + [0.6], [0.6] * 60, [np.nan] + [0.1] * 59])
    results = make_result(list("abcd"), metrics={"effort": measured})
    per_run = results.per_run(results.quantity("effort"))
    row = AtMost("a", "effort", 0.5, "it is small")
    numbers = Numbers(list("abcd"), results.good, [per_run], Resampling(resamples=9))
    found = [judge_at_most(row, numbers, 0, law) for law in "abcd"]
    assert [(x.verdict, x.held, x.runs) for x in found] == [
        ("supported", 60, 60),
        ("not supported", 59, 60),
        ("not supported", 0, 60),
        ("supported", 59, 59),
    ]
    exact = binomtest(59, 60).proportion_ci(0.9, method="exact").low
    expected = [0.05 ** (1 / 60), exact, 0.0, 0.05 ** (1 / 59)]
    assert [x.low for x in found] == pytest.approx(expected, rel=1e-9)
    assert {x.runs_to_decide for x in found} == {59}


def test_a_claim_is_judged_by_its_own_number_whether_runs_settle_or_not(make_result):
    values = make_result.constant(NOISE**2 + 1, NOISE**2 + 2)
    signals = {"torque_norm": values, "lyapunov": values}
    for late in (0, 1, RUNS):
        settled = {"settled": np.array([np.arange(RUNS) >= late, np.ones(RUNS)], float)}
        compared = compare(
            make_result(["eqt", "gt"], signals, settled), how=Resampling(resamples=99)
        )
        assert only(each for each in compared.judgements if each.pair).verdict == "supported"
        said = f"runs that did not settle, by law: EqT {late} of {RUNS}"
        assert list(unsettled(compared)) == [said] * bool(late)


def test_the_claim_about_the_first_5_seconds_is_judged_over_these(torques):
    found = compare(torques, how=Resampling(resamples=99)).judgements
    assert [str(each.pair.measured.window) for each in found if each.pair] == ["0:5"]


@pytest.mark.parametrize(
    ("mean", "low", "high", "written"),
    [
        (-0.000009, -0.000033, 0.000013, "-9e-06 [-3.3e-05, 1.3e-05]"),
        (-1.9e-05, -3.04e-05, -1.06e-05, "-1.90e-05 [-3.04e-05, -1.06e-05]"),
        (0.5, 0.5 - 1.2e-9, 0.5 + 1.2e-9, "0.5000000000 [0.4999999988, 0.5000000012]"),
        (2e-05, math.nan, math.nan, "2.00e-05"),
        (1.23e300, math.nan, math.nan, "1.23e+300"),
        (0.0, 0.0, 0.0, "0.000 [0.000, 0.000]"),
        (0.0, -0.16, 0.16, "0.00 [-0.16, 0.16]"),
        (math.nan, math.nan, math.nan, "-"),
    ],
)
def test_a_number_and_its_interval_have_one_form(mean, low, high, written):
    assert Plain().interval(mean, low, high) == written


@pytest.mark.parametrize(
    ("text", "written"),
    [
        ("-3.63e-05", r"$-$3.63$\cdot10^{-5}$"),
        ("1.7e+12", r"1.7$\cdot10^{12}$"),
        ("3.18e-10", r"3.18$\cdot10^{-10}$"),
        ("-0.283", "$-$0.283"),
    ],
)
def test_a_power_of_ten_is_one_in_latex_too(text, written):
    assert Latex().number(text) == written


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_other_law_as_the_base_has_the_interval_of_the_inverse_ratio(make_result, sign):
    """Fieller's interval holds the ratios that a paired test does not reject, from either side."""
    random = np.random.default_rng(3)
    first, second = sign * random.lognormal(0.0, 0.3, (2, RUNS))
    ends = ("difference", "low", "high", "relative", "relative_low", "relative_high")

    def compared(*efforts):
        result = make_result(["a", "b"], metrics={"effort": efforts})
        return compare(result, metrics=["effort"])

    turned = only(compared(first, second).against("b"))
    wanted = only(compared(second, first).pairs)
    # The resamples of the difference are the same; what BCa makes of them is not, by rounding.
    for name in ends:
        assert getattr(turned, name) == pytest.approx(getattr(wanted, name), rel=0.02), name


def test_no_law_has_more_than_all_of_a_mean_less(make_result):
    """An interval that divides by the mean as if it were known reaches below −100 % here."""
    large = np.random.default_rng(1).lognormal(0.0, 2.0, 12)
    results = make_result(["a", "b"], metrics={"effort": [large, 0.1 * large[::-1]]})
    pair = only(compare(results, metrics=["effort"]).pairs)
    assert pair.low / pair.values[1].mean() < -1 <= pair.relative_low < pair.relative


def test_one_law_is_the_base_of_all_percentages(make_result):
    results = make_result(["a", "b", "c"], metrics={"effort": [LEVELS, LEVELS + 1, LEVELS + 2]})
    comparison = compare(results, metrics=["effort"])

    def pairs(*bases):
        return [(pair.first, pair.second) for pair in comparison.against(*bases)]

    assert pairs() == [("b", "a"), ("c", "a"), ("c", "b")]
    assert pairs("c") == [("a", "c"), ("b", "c"), ("b", "a")]
    [*_, row] = records(comparison, "c")["pairs"]
    assert (row["first"], row["second"], row["word"]) == ("b", "a", "worse")
    assert row["relative"] == pytest.approx(1 / LEVELS.mean())


def test_shares_are_compared_in_points(make_result):
    """Of the time, too: from nothing to 5 % of it are 5 points, and no share of 0."""
    results = make_result(["a", "b"], metrics={"saturated_share": [0 * LEVELS, 0.05 + 0 * LEVELS]})
    [pair] = compare(results, metrics=["saturated_share"]).against()
    assert (pair.percent, pair.word) == ("+5 points [+5, +5]", "worse")


def test_a_median_is_of_the_differences_of_runs_relative_to_either_law(make_result):
    """Of the ratios 2, 1.9, …, 1.3 the interval of eight runs spans all; no base of 0 matters."""
    ratios = np.linspace(1.3, 2.0, 8)
    first = np.r_[LEVELS[:-1], 0.0]
    results = make_result(["a", "b"], metrics={"effort": [first, np.r_[(ratios * first)[:-1], 1]]})
    compared = compare(results, metrics=["effort"])
    [pair], [other] = compared.against(), compared.against("b")
    assert (pair.median, pair.median_low, pair.median_high) == pytest.approx((0.65, 0.3, math.inf))
    ends = (1 / 2 * (1 / 1.6 + 1 / 1.7) - 1, -1.0, 1 / 1.3 - 1)
    assert (other.median, other.median_low, other.median_high) == pytest.approx(ends)
    assert (pair.percent, pair.word, other.word) == ("+65 %", "worse", "better")


def test_a_run_that_failed_is_worse_and_a_law_that_fails_more_is_not_better(make_result):
    """The same on a map: of ten runs, b is better in eight, and fails in the two others."""
    effort = np.tile([[2.0], [1.0]], 20) * np.linspace(1, 2, 20)
    status = np.zeros((2, 20))
    status[1, :2] = 1
    effort[1, :2] = np.nan
    results = make_result(["a", "b"], metrics={"effort": effort}, status=status)
    compared = compare(results, metrics=["effort"])
    [pair] = compared.rows()
    assert (pair.better_in, pair.runs, pair.word) == ((18, 2), 20, "undecided")
    assert pair.adjusted_p == pytest.approx(2 * binomtest(18, 20, alternative="greater").pvalue)
    assert "b: effort −50 % [−50, −50] ?" in compared.answer()
    assert "b: effort better in 18 of 20, but with more failed runs" in compared.answer()


@pytest.mark.parametrize("metric", ["effort", "settled"])
def test_a_point_of_a_sweep_has_the_word_of_its_map(make_result, metric):
    """Of laws that differ by much, by a little, in the mean only, in failures, and in few runs."""
    random = np.random.default_rng(4)
    base, runs = random.lognormal(0, 0.3, (40, 30)), np.arange(30)
    factors = np.linspace(0.6, 1.2, 40)[:, None] * random.lognormal(0, 0.1, base.shape)
    factors[:5] = 1.001
    factors[5:10] = np.where(runs < 3, 30.0, 0.9)
    factors[10:15] = np.where(runs < 16, 1.0, 0.5)
    factors[20:25] = 3.0
    values, status = np.stack([base, factors * base], axis=1), np.zeros((40, 2, 30))
    status[15:20, 1, :2] = 1
    if metric == "settled":
        values = (values < 1.0).astype(float)  # and fewer of b than of a from 20 on
    values = np.where(status == 0, values, np.nan)
    results = make_result(["a", "b"], metrics={metric: values}, status=status, points=40)
    on_map, seen = compare_map(results, metric, Resampling(resamples=9), settling=0), set()
    for cell in on_map.cells:
        view = results.at(cell.point)
        view.out_of = results.points
        [pair] = compare(view, metrics=[metric], how=Resampling(resamples=9)).rows()
        word = pair.word
        winner = {NOBODY: word, 0: Word.WORSE, 1: Word.BETTER}[cell.winner]
        assert winner is word
        alike = on_map.verdict(cell) == Word.ALIKE
        assert alike == (word is Word.ALIKE)
        seen.add(word)
    assert seen >= {Word.WORSE, Word.UNDECIDED}


def test_the_closing_window_is_named_as_it_is(make_result):
    results = make_result(["a", "b"], metrics={"closing_pose_error": [LEVELS, LEVELS]})
    comparison = compare(results, metrics=["closing_pose_error"])
    table = text_tables(comparison, Plain())["controllers"]
    assert [row[0] for row in table.rows] == ["closing rms of ‖I − Q_E‖, 15–20 s"]
    assert records(comparison)["pairs"][0]["window_start"] == 15.0
