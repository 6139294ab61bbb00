"""Error estimates of every run, their limit, and which runs the cross-check redoes."""

from dataclasses import replace

import numpy as np
import pytest

from eqt_cli.config.study import Study
from eqt_cli.extend import Problem, Solution, Status, TaskContext
from eqt_cli.runs.batches import chosen_entries, distance
from eqt_cli.runs.compute_part import (
    LARGEST_TORQUE,
    _find_undefined,
    _judge,
    compute_part,
    shared_reference,
)

NATIVE = "{engine: native, rtol: 1.0e-6, atol: 1.0e-6, cross_check: 0}"


def simulate(experiment):
    """Every variable of a small experiment, ``(controller, run, …)``; a part per law."""
    study = Study(None, experiment)
    shared = shared_reference(study)
    assert len(study.plan) == len(experiment.loops)
    first, *others = (
        compute_part(study, study.plan.part(number), shared, TaskContext()).data
        for number in range(len(study.plan))
    )
    start = {name: first.pop(name) for name in ("initial_pose", "initial_velocity")}
    return start | {name: np.array([first[name], *(x[name] for x in others)]) for name in first}


@pytest.fixture
def estimated(experiment):
    """Forty runs of each controller by the compiled engine, on which it estimates errors."""
    return experiment("ensemble.runs=40", "time.duration=5", solver=NATIVE)


def test_estimates_are_the_errors(estimated):
    """max over samples of max(‖ΔQ‖_F, ‖ΔV‖), to a factor 2 for nearly all runs.

    The tighter solve has an error of its own, on average a tenth of what it measures.
    """
    simulated = simulate(estimated)
    Q, V = (simulated[name] for name in ("initial_pose", "initial_velocity"))
    for index, loop in enumerate(estimated.loops.values()):
        start = loop.initial_state(Q, V, estimated.desired.pose, estimated.desired.velocity)
        problem = Problem(loop, start, estimated.times)
        found, exact = (
            estimated.engine.tightened(factor).solve(problem).states for factor in (1, 1e-6)
        )
        error = distance(loop, estimated.times, found, exact)
        ratio = simulated["error_estimate"][index] / error
        assert np.mean((ratio > 0.5) & (ratio < 2)) > 0.9


def test_only_runs_over_the_limit_are_marked(estimated, experiment):
    unlimited = simulate(estimated)
    estimate = unlimited["error_estimate"]
    limit = float(np.median(estimate))
    limited = simulate(
        experiment(
            "ensemble.runs=40", "time.duration=5", f"solver.max_error={limit}", solver=NATIVE
        )
    )
    status = limited["status"]
    assert (status == np.where(estimate > limit, Status.ACCURACY, Status.OK)).all()
    messages = limited["message"]
    assert ((messages != "") == (estimate > limit)).all()
    np.testing.assert_array_equal(limited["pose"], unlimited["pose"])


def test_a_torque_that_steps_miss_ends_a_run():
    solution = Solution(np.zeros((3, 1, 1)), np.array([0, 0, 1]), np.zeros(3, int), [""] * 3)
    peaks = {LARGEST_TORQUE: np.array([1.0, np.nan, np.nan])}
    _find_undefined(replace(solution, numbers=peaks))
    assert solution.status.tolist() == [Status.OK, Status.NON_FINITE, 1]
    assert solution.messages[1].startswith("the torque is not finite at a sample, between steps")


def test_a_run_whose_error_is_not_known_is_marked():
    steps = status = np.zeros(3, dtype=int)
    solution = Solution(np.zeros((3, 1, 1)), status, steps, [""] * 3)
    _judge(solution, np.array([1e-9, np.nan, 1e-3]), 1e-6)
    assert solution.status.tolist() == [Status.OK, Status.ACCURACY, Status.ACCURACY]
    assert solution.messages[1] == (
        "no error estimate for solver.max_error = 1e-06: the second solve failed"
    )


def test_chosen_runs_are_a_fixed_function_of_seed_and_number(experiment):
    def chosen(*overrides, runs=50, **changes):
        found = experiment(f"ensemble.runs={runs}", *overrides, **changes)
        return chosen_entries(Study(None, found)).tolist()

    solver = "{cross_check: 4}"
    first = chosen(solver=solver)
    assert first == sorted(set(first))
    assert len(first) == 4
    assert 0 <= first[0] <= first[-1] < 50
    # Nothing else matters,
    assert chosen(solver="{cross_check: 4, rtol: 1.0e-3}", controllers="[nog]") == first
    # but these do.
    assert chosen("ensemble.seed=2", solver=solver) != first
    assert chosen(runs=51, solver=solver) != first


def test_no_more_runs_are_chosen_than_there_are(experiment):
    def chosen(solver):
        return chosen_entries(Study(None, experiment(solver=solver))).tolist()

    assert chosen("{cross_check: 9}") == [0, 1, 2]
    assert chosen("{cross_check: 0}") == []
