"""What every engine must do, whoever wrote it.

The problem is a harmonic oscillator per run, x'' = −ω²x, with ω a parameter: its solution is known.
"""

import dataclasses
from dataclasses import dataclass, field

import numpy as np
import pytest

from eqt_cli.controllers import Controller, controllers
from eqt_cli.core.arrays import less, where
from eqt_cli.engines import Problem, Status

RUNS, SAMPLES, DURATION, RTOL = 5, 9, 4.0, 1e-7
SHORT = 1.0
# Over 4 s, at frequencies up to 2 rad/s, errors of a step add up and are not damped; measured over
# all engines: 0.1 to 40 rtol.
ERROR = 200 * RTOL


@pytest.fixture
def engine(make, engine_class):
    if engine_class.unavailable():
        pytest.skip(engine_class.unavailable())
    return dataclasses.replace(make(engine_class), rtol=RTOL)


@pytest.fixture
def problem(loop_with, states):
    """Runs of a closed loop with a gain that differs from run to run."""
    loop = loop_with("SO3", controllers.get("family")())
    varying = {"kd": np.linspace(0.5, 1.5, RUNS)[:, None, None] * loop.gains.K_d}
    return Problem(loop, states(loop, (RUNS,)), np.linspace(0.0, SHORT, SAMPLES), varying)


def quiet(runs):
    """Report to nobody."""


@dataclass(frozen=True)
class Spring(Controller):
    """A spring on R1, ẍ = −k x, whose force is infinite from some time on."""

    name = "spring"
    title = "spring"

    stiffness: float = 1.0
    fails_after: float = field(default=1e9)

    def torque(self, s):
        x = s.Q[..., 0, 1:]
        blown = 1e200 * x * x * x * x
        return where(less(s.t, self.fails_after), -self.stiffness * x, blown * blown)


@pytest.fixture
def oscillators(loop_with):
    """Oscillators on R1 from x = 1 at rest, and what becomes of them."""
    loop = loop_with("R1", Spring())
    unit = np.eye(1)
    loop = loop.with_parameters(
        loop.parameters | {"inertia": unit, "inertia_inverse": unit, "kp": np.eye(2), "kd": unit}
    )
    G = loop.group
    Q = np.broadcast_to(G.exp(np.ones(1)), (RUNS, 2, 2))
    still = np.zeros((RUNS, 1))
    y = loop.initial_state(Q, still, np.broadcast_to(G.identity, Q.shape), still)
    omega, times = np.linspace(0.5, 2.0, RUNS), np.linspace(0.0, DURATION, SAMPLES)
    varying = {"controller.stiffness": omega[:, None] ** 2}
    expected = np.cos(omega[:, None] * times)
    return Problem(loop, y, times, varying), expected


def positions(problem, solution):
    return np.stack(
        [[problem.loop.tracking(0.0, y).Q[0, 1] for y in run] for run in solution.states]
    )


def test_it_solves_oscillators_to_its_tolerance(engine, oscillators):
    problem, expected = oscillators
    solution = engine.solve(problem, quiet)
    assert not solution.status.any()
    assert solution.steps.min() > 0
    np.testing.assert_allclose(positions(problem, solution), expected, rtol=0, atol=ERROR)


def test_a_tightened_engine_is_more_accurate(engine, oscillators):
    problem, expected = oscillators
    loose = dataclasses.replace(engine, rtol=1e-4)
    tight = loose.tightened(1e-4)
    assert type(tight) is type(engine)
    one, other = (
        np.abs(positions(problem, each.solve(problem, quiet)) - expected).max()
        for each in (loose, tight)
    )
    assert other < one / 10


def test_a_tightened_engine_takes_other_steps_where_samples_are_dense(engine, oscillators):
    """An estimate of the error would be 0 if samples, not tolerances, ruled the steps."""
    if engine.name == "rk4_fixed":
        pytest.xfail("it takes a step per sample at least")
    problem, _ = oscillators
    loose = dataclasses.replace(engine, rtol=1e-4)
    problem = dataclasses.replace(problem, times=np.linspace(0.0, DURATION, 2001))
    one, other = (each.solve(problem, quiet).states for each in (loose, loose.tightened(0.1)))
    changed = (one[:, 1:] != other[:, 1:]).any(axis=-1)
    assert changed.any(axis=-1).all()


def test_the_first_sample_is_the_initial_state(engine, problem):
    solution = engine.solve(problem, quiet)
    np.testing.assert_array_equal(solution.states[:, 0], problem.states)
    assert solution.states.shape == (RUNS, SAMPLES, problem.states.shape[1])


def test_progress_sums_up_to_the_number_of_runs(engine, problem):
    seen = []
    engine.solve(problem, seen.append)
    assert sum(seen) == pytest.approx(RUNS, abs=1e-9)  # rounding of a few hundred fractions


def test_the_number_of_threads_changes_no_bit(engine, problem):
    one, many = (engine.solve(problem, quiet, workers=workers).states for workers in (1, 4))
    np.testing.assert_array_equal(one, many)


def test_runs_given_together_change_no_bit(engine, problem):
    """`runs_at_once` says in which portions runs may be given."""
    portion = engine.runs_at_once(2)
    whole = engine.solve(problem, quiet).states
    parts = [
        engine.solve(problem.select(slice(k, k + portion)), quiet).states
        for k in range(0, RUNS, portion)
    ]
    np.testing.assert_array_equal(whole, np.concatenate(parts))


def test_a_failing_run_gets_a_status_and_harms_no_other(engine, oscillators):
    problem, expected = oscillators
    fails = np.full((RUNS, 1), 1e9)
    fails[2] = 1.7
    problem = dataclasses.replace(
        problem, varying={**problem.varying, "controller.fails_after": fails}
    )
    solution = engine.solve(problem, quiet)
    assert [bool(status) for status in solution.status] == [k == 2 for k in range(RUNS)]
    assert Status(solution.status[2])
    assert solution.messages[2]
    others = [0, 1, 3, 4]
    assert not any(solution.messages[k] for k in others)
    assert np.isnan(solution.states[2, -1]).any()
    np.testing.assert_allclose(
        positions(problem, solution)[others], expected[others], rtol=0, atol=ERROR
    )


def test_its_default_options_have_no_problems(engine, noted):
    assert noted(engine) == []
