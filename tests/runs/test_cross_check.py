"""What the cross-check repeats, told by counts, and what it finds."""

from dataclasses import replace

import numpy as np
import pytest
from small_experiment import mapping

from eqt_cli import load_experiment
from eqt_cli.engines import extrapolation
from eqt_cli.extend import Native, Problem, SolveIvp
from eqt_cli.runs import batches as checking
from eqt_cli.runs.batches import batches, cross_check, independent


def study(**changes):
    changes = {"time": {"duration": 20, "samples": 401}, **changes}
    return load_experiment(
        mapping(**{"solver": {"engine": "native"}, "controllers": ["eqt"], **changes})
    )


@pytest.fixture(scope="module")
def states():
    """The states of three runs of a law with a reference that depends on time."""
    (batch,) = batches(study(), "eqt", np.arange(3))
    return SolveIvp(rtol=1e-10).solve(batch.problem).states


METHODS = {
    Native(rtol=1e-7): "extrapolation",
    SolveIvp(rtol=1e-7): "LSODA",
    SolveIvp(rtol=1e-7, method="Radau"): "LSODA",
    SolveIvp(rtol=1e-7, method="LSODA"): "Radau",
    SolveIvp(rtol=1e-7, method="BDF"): "Radau",
}


@pytest.mark.parametrize("engine", METHODS, ids=lambda each: getattr(each, "method", each.name))
def test_the_check_is_of_another_kind_of_method_and_as_accurate(engine, states):
    """Radau compares means, the others largest errors, so they get √B times the tolerance."""
    other = independent(engine)
    assert other.method == METHODS[engine]
    if engine.name == "native" or engine.method == "LSODA":
        (batch,) = batches(study(), "eqt", np.arange(3))
        problem = Problem(batch.problem.loop, batch.problem.states, batch.problem.times[:21])
        again = other.solve(problem).states
        assert 1e-13 < np.abs(again - states[:, :21]).max() < 100 * engine.rtol


@pytest.mark.parametrize("limit", [0.01, 0.3, 0.9])
def test_the_check_sees_a_rate_that_ends(limit):
    """ẏ = 1 up to a limit, as an integral has it; the rows alone agree on y + h / 2."""
    solved = extrapolation.solve(
        lambda t, y: np.where(y < limit, 1.0, 0.0),
        (0.0, 1.0),
        np.zeros(1),
        t_eval=None,
        events=lambda t, y: 1.0,
        first_step=None,
        max_step=np.inf,
        rtol=1e-9,
        atol=1e-9,
    )
    assert solved.y[0, -1] == pytest.approx(limit, abs=1e-8)


@pytest.mark.parametrize("kink", [0.5, 0.95, 0.99])
def test_the_check_sees_a_limit_that_is_reached_anywhere_in_a_step(kink):
    """ẏ = max(t − a, 0), also where a is in the last part of the first step, which is the span."""
    solved = extrapolation.solve(
        lambda t, y: np.array([max(t - kink, 0.0)]),
        (0.0, 1.0),
        np.zeros(1),
        t_eval=None,
        events=lambda t, y: 1.0,
        first_step=None,
        max_step=np.inf,
        rtol=1e-9,
        atol=1e-9,
    )
    assert solved.y[0, -1] == pytest.approx((1.0 - kink) ** 2 / 2, abs=1e-8)


def test_a_check_that_costs_little_is_of_the_whole_horizon(monkeypatch, states):
    """Of few runs of many steps, or of so many runs that it takes less than a fifth of theirs."""
    short = study(time={"duration": 2, "samples": 41})
    check = cross_check(short, {0: {"eqt": [states[:, :41]]}}, {0: {"eqt": 35.0}})
    assert (check.method, check.runs) == ("extrapolation", 3)
    assert 0 < check.difference < check.bound / 100
    many = study(ensemble={"runs": 12_000})
    monkeypatch.setattr(checking, "chosen_entries", lambda piece: np.arange(3))
    check = cross_check(many, {0: {"eqt": [states]}}, {0: {"eqt": 235.0}})
    assert (check.method, check.runs) == ("extrapolation", 3)


CHECKED = {
    "samples": ("2.45", {}, 232.0),  # 49 of 400 intervals, as 1000 of 8,040 evaluations
    "steps": ("1.25", {}, 1060.0),  # 25, as 1000 of 15,940
    "evaluations": ("2.8", {"solver": {"engine": "solve_ivp"}}, 3480.0),
    "instants": ("2.25", {"control": {"period": 1.0}}, 181.0),  # as 1000 of 8,800
    "one interval at least": ("0.05", {}, 500_000.0),
}


@pytest.mark.parametrize(("seconds", "changes", "longest"), CHECKED.values(), ids=CHECKED)
def test_the_beginning_is_checked_that_the_counts_of_the_longest_run_allow(
    states, seconds, changes, longest
):
    loaded = study(**changes)
    (batch,) = batches(loaded, "eqt", np.arange(3))
    found = SolveIvp(rtol=1e-10).solve(batch.problem).states if "control" in changes else states
    check = cross_check(loaded, {0: {"eqt": [found]}}, {0: {"eqt": longest}})
    method = "LSODA" if "solver" in changes else "extrapolation"
    assert check.method == f"{method} over the first {seconds} of 20 s"
    assert check.difference < check.bound / 10


def test_another_number_of_runs_is_checked_over_the_whole_horizon(states):
    asked = study(solver={"engine": "native", "cross_check": 2})
    chosen = checking.chosen_entries(asked)
    check = cross_check(asked, {0: {"eqt": [states[chosen]]}}, {0: {"eqt": 1e9}})
    assert (check.method, check.runs) == ("extrapolation", 2)


def test_a_wrong_state_shows(states):
    (batch,) = batches(study(), "eqt", np.arange(3))
    wrong = states.copy()
    wrong[1, 7, batch.problem.loop.layout.slices["momentum"]] += 1e-3
    check = cross_check(study(), {0: {"eqt": [wrong]}}, {0: {"eqt": 235.0}})
    assert 1e-4 < check.difference < 1e-2
    assert not check.holds


def wrong_gain(problem):
    gains = replace(problem.loop.gains, K=problem.loop.gains.K * 1.0001)
    return SolveIvp(rtol=1e-10).solve(replace(problem, loop=replace(problem.loop, gains=gains)))


def wrong_time(problem):
    """Samples that are interpolated at a time behind their own."""
    later = problem.times + 1e-4 * (problem.times > 0)
    return SolveIvp(rtol=1e-10).solve(replace(problem, times=later))


FAULTS = {
    "a gain": wrong_gain,
    "the times of samples": wrong_time,
    "a step that is too long": SolveIvp(rtol=1e-4, method="RK23").solve,
}


@pytest.mark.parametrize("fault", FAULTS.values(), ids=FAULTS)
def test_a_planted_fault_is_found_in_the_part_that_is_checked(fault):
    (batch,) = batches(study(), "eqt", np.arange(3))
    states = fault(batch.problem).states
    check = cross_check(study(), {0: {"eqt": [states]}}, {0: {"eqt": 235.0}})
    assert "of 20 s" in check.method and not check.holds


@pytest.mark.parametrize("engine", [Native(), SolveIvp()], ids=["native", "solve_ivp"])
def test_at_limits_the_check_is_as_accurate_as_elsewhere(engine):
    """Estimates of two columns overlook the kinks: they gave errors 400 times as large."""
    limits = [{"kind": "limit", "limit": 0.3}]
    loaded = study(actuators=limits, control={"period": 0.5})
    (batch,) = batches(loaded, "eqt", np.arange(3))
    problem = replace(batch.problem, times=batch.problem.times[:41])
    again, expected = (each.solve(problem).states for each in (independent(engine), Native()))
    assert np.abs(again - expected).max() < 100 * engine.rtol


@pytest.mark.parametrize(
    ("seconds", "longest", "why"),
    [
        (10.0, 1e7, "up to the first sample it takes about 4e+05 evaluations"),
        (-1.0, 100.0, "it takes more than -3 s of the processor"),
    ],
)
def test_a_check_that_takes_too_long_is_skipped(monkeypatch, states, seconds, longest, why):
    monkeypatch.setattr(checking, "MOST_SECONDS", seconds)
    check = cross_check(study(), {0: {"eqt": [states]}}, {0: {"eqt": longest}})
    assert check.described == f"cross-check skipped: {why}"
    assert check.holds
