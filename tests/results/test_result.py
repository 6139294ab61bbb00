"""What readers ask of a result, on results whose numbers are known."""

import numpy as np
import pytest
from said import error_of, says

from eqt_cli.extend import Status
from eqt_cli.results.quantity import SweptKey, constant_of, with_unit
from eqt_cli.results.result import by_parts, check_stored, mean_over_runs
from eqt_cli.results.summary import check_metrics, endings, headline

RUNS = 6
NORMS = ("pose_error", "velocity_error", "torque_norm", "lyapunov")


@pytest.fixture
def failing(make_result):
    """Two controllers with six runs; two of the first fail, of four with trajectories one."""
    levels = make_result.constant([1.0, 2, 3, 4], [5.0, 6, 7, 8])
    status = np.zeros((2, RUNS))
    status[0, 1], status[0, 5] = Status.STEP_LIMIT, Status.NON_FINITE
    effort = np.arange(2.0 * RUNS).reshape(2, RUNS)
    settled = np.where(effort > 9, np.nan, 1.0)
    metrics = {"effort": effort, "settling_time": settled}
    return make_result(["eqt", "mine"], dict.fromkeys(NORMS, levels), metrics, status, stored=4)


def test_what_was_run(failing):
    assert (failing.title, failing.group_name) == ("made up", "SO3")
    assert (failing.labels, failing.titles) == (["eqt", "mine"], ["EqT", "mine"])
    assert (failing.runs, failing.points, failing.is_sweep) == (RUNS, 1, False)
    assert (failing.horizon, failing.cross_check, failing.provenance) == (20.0, None, {})


def test_good_runs_are_those_that_ended_well(failing):
    assert np.flatnonzero(~failing.good[0]).tolist() == [1, 5]
    assert failing.failed == {"eqt": 2, "mine": 0}
    assert [failing.place(where) for where in failing.failures] == ["eqt run 1", "eqt run 5"]


def test_endings_in_words_the_most_frequent_first(make_result):
    status = [[Status.STEP_LIMIT, 0, Status.NON_FINITE, Status.NON_FINITE, 99, 0]]
    result = make_result(["eqt"], metrics={"effort": np.ones((1, RUNS))}, status=status)
    counted = {"non finite": 2, "step limit": 1, "status 99": 1}
    assert list(endings(result).items()) == list(counted.items())


def test_what_is_kept_cannot_be_written_to(failing):
    with pytest.raises(ValueError, match="read-only"):
        failing.status[0, 0] = 1


def test_trajectories_are_those_of_good_runs(failing):
    assert failing.trajectories("pose_error", 0)[:, 0].tolist() == [1, 3, 4]
    assert failing.trajectories("pose_error", 0, most=2)[:, 0].tolist() == [1, 3]
    assert failing.trajectories("pose_error", 1)[:, 0].tolist() == [5, 6, 7, 8]


def test_one_run_of_all_controllers(failing):
    assert failing.trajectory("torque_norm", 1)[:, 0].tolist() == [2, 6]
    assert error_of(failing.trajectory, "torque_norm", 4) == (
        f"{failing.path}: the trajectory of run 4 is not stored; stored are runs 0 to 3"
    )


def test_who_needs_trajectories_is_told_how_to_get_them(make_result):
    result = make_result(["eqt"], metrics={"effort": np.ones((1, RUNS))})
    assert result.stored_runs.size == 0
    assert says(
        error_of(check_stored, result, "torque_norm", who="figure 'torque' needs"),
        f"{result.path}: figure 'torque' needs the trajectories of…'torque_norm'…",
    )


def test_numbers_of_failed_runs_are_missing(failing):
    assert np.array_equal(failing.metric("effort", 0), [0, np.nan, 2, 3, 4, np.nan], equal_nan=True)
    assert failing.metrics == ["effort", "settling_time", "settled"]


def test_censored_are_good_runs_without_a_number_that_may_lie_beyond(failing):
    assert failing.censored("settling_time").tolist() == [[False] * 6, [False] * 4 + [True] * 2]
    assert not failing.censored("effort").any()


def test_an_unknown_metric(failing):
    said = error_of(failing.metric, "efort")
    assert said.startswith("unknown metric 'efort'; did you mean 'effort'? known here: ")
    assert error_of(check_metrics, failing, ["efort"], who="figure 'pareto'") == (
        f"{failing.path}: figure 'pareto' finds no metric 'efort'; did you mean 'effort'?"
    )


def test_parts_of_norms(make_result):
    levels = make_result.constant([1.0])
    names = ("torque_norm", "torque_norm_rotation", "torque_norm_translation", "lyapunov")
    result = make_result(["eqt"], dict.fromkeys(names, levels))
    assert result.parts("torque_norm") == ["rotation", "translation"]
    assert [q.name for q in by_parts(result, "effort")] == ["effort_rotation", "effort_translation"]


def test_a_point_is_asked_for_itself(make_result):
    status = np.zeros((3, 2, 4))
    status[1, 0, 2] = 1
    result = make_result(
        ["a", "b"], metrics={"effort": np.ones((3, 2, 4))}, status=status, points=3
    )
    assert (result.failed, [result.place(w) for w in result.failures]) == (
        {"a": 1, "b": 0},
        ["point 1 a run 2"],
    )
    assert result.at(0).failed == {"a": 0, "b": 0}
    assert (result.at(1).failed, result.at(1).metrics) == ({"a": 1, "b": 0}, ["effort"])


def test_headline_has_no_means_where_no_run_is_good(make_result):
    names = ("early_torque", "mean_pose_error", "final_pose_error", "final_velocity_error")
    values = np.arange(8.0).reshape(2, 4)
    metrics = dict.fromkeys((*names, "energy_residual"), values)
    result = make_result(["eqt", "gt"], metrics=metrics, status=[[0, 0, 1, 0], [1] * 4])
    first, second = headline(result)
    assert (first["runs"], first["failed"], first["early_torque"]) == (4, 1, 4 / 3)
    assert first["energy_residual"] == 3.0
    assert np.isnan(second["early_torque"]) and np.isnan(second["energy_residual"])


def test_a_swept_key_has_numbers_or_texts():
    numbers = SweptKey("gains.kp", np.array([1.0, 10.0, 100.0]), {})
    texts = SweptKey("group", np.array([1, 0, 1]), {0.0: "SE3", 1.0: "SO3"}, is_number=False)
    assert (numbers.at(1), numbers.value(1), numbers.logarithmic) == ("10", 10.0, True)
    assert (texts.at(0), texts.value(1), texts.logarithmic) == ("SO3", "SE3", False)
    assert texts.levels == [0, 1, 0]
    assert SweptKey("x", np.array([-1.5]), {}).at(0) == "−1.5"
    assert SweptKey("x", np.array([170.0]), {}, unit="deg").at(0) == "170 deg"
    assert [with_unit(text) for text in ("170 deg", "pi/2 ms", "170")] == [
        (170.0, "deg"),
        (np.pi / 2, "ms"),
        None,
    ]
    assert constant_of('"-pi/2"') == (-np.pi / 2, "−π/2")
    assert constant_of("2*pi") == (2 * np.pi, "2π")
    assert constant_of('"SO3"') is None


def test_means_leave_out_what_is_missing():
    found = mean_over_runs(np.array([[1.0, np.nan, 3.0], [np.nan] * 3]))
    assert np.array_equal(found, [2.0, np.nan], equal_nan=True)
