"""What every engine must do, whoever wrote it.

The problem is a harmonic oscillator per run, x'' = −ω²x, with ω a parameter: its solution is known.
"""

import dataclasses
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from eqt_cli.components.laws import Controller, controllers
from eqt_cli.components.sensors import Errors, Noise
from eqt_cli.components.vehicle import Vehicle
from eqt_cli.components.vehicle_parts import Sampling
from eqt_cli.engines.choice import unavailable
from eqt_cli.extend import (
    ClosedReference,
    ConstantReference,
    Force,
    Gains,
    Inertia,
    Problem,
    Status,
    less,
    where,
)

RUNS, SAMPLES, DURATION, RTOL = 5, 9, 4.0, 1e-6
SHORT = 1.0
# Over 4 s, at frequencies up to 2 rad/s, errors of a step add up and are not damped; measured over
# all engines: 0.1 to 40 rtol.
ERROR = 200 * RTOL


@pytest.fixture
def engine(make, engine_class):
    if why := unavailable(engine_class):
        pytest.skip(why)
    return dataclasses.replace(make(engine_class), rtol=RTOL)


@pytest.fixture
def problem(loop_with, states):
    """Runs of a closed loop with a gain that differs from run to run."""
    loop = loop_with("SO3", controllers.get("family")())
    varying = {"gains.K_d": np.linspace(0.5, 1.5, RUNS)[:, None, None] * loop.gains.K_d}
    return Problem(loop, states(loop, (RUNS,)), np.linspace(0.0, SHORT, SAMPLES), varying)


@dataclass(frozen=True)
class Spring(Controller):
    """A spring on R1, ẍ = −k x − d ẋ + V̇_d, whose force is infinite from some time on."""

    name = "spring"
    title = "spring"

    stiffness: float = 1.0
    damping: float = 0.0
    fails_after: float = field(default=1e9)

    def torque(self, s):
        x = s.Q[..., 0, 1:]
        blown = 1e200 * (1 + x * x * x * x)
        force = s.tau_d - self.stiffness * x - self.damping * s.V
        return where(less(s.t, self.fails_after), force, blown * blown)


def masses(loop_with, **parts):
    """Runs on R1 from x = 1 at rest, of unit mass; other parts of the loop may be given."""
    loop = dataclasses.replace(loop_with("R1", Spring(), ConstantReference()), **parts)
    unit = np.eye(1)
    loop = dataclasses.replace(loop, inertia=Inertia(unit, unit), gains=Gains(np.eye(2), unit))
    G = loop.group
    Q = np.broadcast_to(G.exp(np.ones(1)), (RUNS, 2, 2))
    still = np.zeros((RUNS, 1))
    y = loop.initial_state(Q, still, np.broadcast_to(G.identity, Q.shape), still)
    return Problem(loop, y, np.linspace(0.0, DURATION, SAMPLES))


STIFFNESS = np.linspace(0.5, 2.0, RUNS)[:, None] ** 2


@pytest.fixture
def oscillators(loop_with):
    """Oscillators, and what becomes of them."""
    problem = masses(loop_with)
    expected = np.cos(np.sqrt(STIFFNESS) * problem.times)
    return dataclasses.replace(problem, varying={"controller.stiffness": STIFFNESS}), expected


def thrown(times, ends, pushes, x=1.0, v=0.0):
    """x at some times under a push that is held from each end to the next, ``(runs, times)``."""
    found = np.empty((len(pushes), len(times)))
    for (start, stop), push in zip(pairwise(ends), pushes.T, strict=True):
        here, s = (times >= start) & (times <= stop), stop - start
        after = (times[here] - start)[:, None]
        found[:, here] = (x + v * after + push * after**2 / 2).T
        x, v = x + v * s + push * s**2 / 2, v + push * s
    return found


PERIOD = 0.3


@pytest.fixture
def sampled(loop_with):
    """A spring and damper that is evaluated at instants, from what noisy sensors tell."""
    sensors = {"pose_sensors": (Noise(std=0.1),), "velocity_sensors": (Noise(std=0.1),)}
    problem = masses(loop_with, vehicle=Vehicle(control=Sampling(period=PERIOD), **sensors))
    instants, random = problem.control_instants, np.random.default_rng(5)
    pose, velocity = random.normal(0.0, 0.1, (2, RUNS, instants, 1))
    varying = {"controller.stiffness": STIFFNESS, "controller.damping": np.full((RUNS, 1), 0.4)}
    errors = Errors(pose, velocity, np.empty((RUNS, instants, 0)))
    x, v, pushes = np.ones(RUNS), np.zeros(RUNS), []
    for k in range(instants):
        told, speed = x + pose[:, k, 0], v + velocity[:, k, 0]
        pushes.append(-STIFFNESS[:, 0] * told - 0.4 * speed)
        x = x + v * PERIOD + pushes[-1] * PERIOD**2 / 2
        v = v + pushes[-1] * PERIOD
    ends = np.append(PERIOD * np.arange(instants), DURATION)
    expected = thrown(problem.times, ends, np.array(pushes).T)
    return dataclasses.replace(problem, varying=varying, errors=errors), expected


CHANGES, PUSHES = np.array([0.7, 1.5, 2.9]), np.array([1.0, -2.0, 0.5, 3.0])


def held_from(t):
    return PUSHES[np.searchsorted(CHANGES, t, side="right")]


@dataclass(frozen=True)
class Gusts(Force):
    """A force that jumps at known instants; two of them are no sample times."""

    def acting(self, G, t, Q, V):
        push = sum(
            jump * where(less(t, at), 0.0, 1.0)
            for at, jump in zip(CHANGES, np.diff(PUSHES), strict=True)
        )
        return (PUSHES[0] + push) * (1.0 + 0.0 * V)

    def instants(self, G, until):
        return CHANGES


@dataclass(frozen=True)
class Jolts(ClosedReference):
    """A reference by whose acceleration the loop goes on from instant to instant."""

    acceleration: Any = None

    def motion(self, G, t):
        if self.acceleration is None:
            return self.held(G, t).motion(G, t)
        still = np.zeros(1)
        return G.identity, still, self.acceleration

    def instants(self, G, until):
        return CHANGES

    def held(self, G, t):
        return Jolts(held_from(t)[..., None])


def positions(problem, solution):
    return np.stack(
        [[problem.loop.tracking(0.0, y).Q[0, 1] for y in run] for run in solution.states]
    )


def test_it_solves_oscillators_to_its_tolerance(engine, oscillators):
    problem, expected = oscillators
    solution = engine.solve(problem)
    assert not solution.status.any()
    assert solution.steps.min() > 0
    np.testing.assert_allclose(positions(problem, solution), expected, rtol=0, atol=ERROR)


def test_between_steps_a_mode_that_is_fast_beside_them_is_as_exact(engine, loop_with):
    """ẍ = −d x − d ẋ: behind the fast mode, steps are as long as it is stable.

    At samples within them, dense output erred by 1e-6 in `native`, and by 2e-5 in `solve_ivp`.
    """
    if engine.name not in ("native", "solve_ivp"):
        pytest.skip("engines of examples are simpler")
    d = np.linspace(40.0, 100.0, RUNS)[:, None]
    varying = {"controller.stiffness": d, "controller.damping": d}
    times = np.linspace(0.0, SHORT, 101)
    problem = dataclasses.replace(masses(loop_with), varying=varying, times=times)
    solution = dataclasses.replace(engine, rtol=1e-9).solve(problem)
    velocities = solution.states[..., problem.loop.layout.slices["momentum"]][..., 0]
    a, b = (sign * np.sqrt(d**2 - 4 * d) / 2 - d / 2 for sign in (1, -1))
    expected = a * b * (np.exp(b * times) - np.exp(a * times)) / (a - b)
    np.testing.assert_allclose(velocities, expected, rtol=0, atol=1e-3 * ERROR)


def test_a_tightened_engine_is_more_accurate(engine, oscillators):
    problem, expected = oscillators
    loose = dataclasses.replace(engine, rtol=1e-3)
    tight = loose.tightened(1e-3)
    assert type(tight) is type(engine)
    one, other = (
        np.abs(positions(problem, each.solve(problem)) - expected).max() for each in (loose, tight)
    )
    assert other < one / 10


def test_a_tightened_engine_takes_other_steps_where_samples_are_dense(engine, oscillators):
    """An estimate of the error would be 0 if samples, not tolerances, ruled the steps."""
    if engine.name == "rk4_fixed":
        pytest.xfail("it takes a step per sample at least")
    problem, _ = oscillators
    loose = dataclasses.replace(engine, rtol=1e-4)
    problem = dataclasses.replace(problem, times=np.linspace(0.0, DURATION, 2001))
    one, other = (each.solve(problem).states for each in (loose, loose.tightened(0.1)))
    changed = (one[:, 1:] != other[:, 1:]).any(axis=-1)
    assert changed.any(axis=-1).all()


def test_the_first_sample_is_the_initial_state(engine, problem):
    solution = engine.solve(problem)
    np.testing.assert_array_equal(solution.states[:, 0], problem.states)
    assert solution.states.shape == (RUNS, SAMPLES, problem.states.shape[1])


def test_progress_sums_up_to_the_number_of_runs(engine, problem):
    seen = []
    engine.solve(problem, progress=seen.append)
    assert sum(seen) == pytest.approx(RUNS, abs=1e-9)  # rounding of a few hundred fractions


def test_the_number_of_threads_changes_no_bit(engine, problem):
    one, many = (engine.solve(problem, workers=workers).states for workers in (1, 4))
    np.testing.assert_array_equal(one, many)


def test_runs_given_together_change_no_bit(engine, problem):
    """`runs_per_block` says in which portions runs may be given."""
    portion = max(2, getattr(engine, "runs_per_block", 1))
    whole = engine.solve(problem).states
    parts = [
        engine.solve(problem.select(slice(k, k + portion))).states for k in range(0, RUNS, portion)
    ]
    np.testing.assert_array_equal(whole, np.concatenate(parts))


def test_a_failing_run_gets_a_status_and_harms_no_other(engine, oscillators):
    problem, expected = oscillators
    fails = np.full((RUNS, 1), 1e9)
    fails[2] = 1.7
    problem = dataclasses.replace(
        problem, varying={**problem.varying, "controller.fails_after": fails}
    )
    solution = engine.solve(problem)
    assert [bool(status) for status in solution.status] == [k == 2 for k in range(RUNS)]
    assert Status(solution.status[2])
    assert solution.messages[2]
    others = [0, 1, 3, 4]
    assert not any(solution.messages[k] for k in others)
    assert np.isnan(solution.states[2, -1]).any()
    np.testing.assert_allclose(
        positions(problem, solution)[others], expected[others], rtol=0, atol=ERROR
    )


def test_a_sampled_law_is_evaluated_at_its_instants_with_their_errors(engine, sampled):
    """Its command is held from one instant to the next; samples are at instants and between."""
    problem, expected = sampled
    solution = engine.solve(problem)
    assert not solution.status.any()
    np.testing.assert_allclose(positions(problem, solution), expected, rtol=0, atol=ERROR)
    half = dataclasses.replace(problem, times=problem.times[: len(problem.times) // 2 + 1])
    # Each span is counted once, so that twice as many take about twice the work.
    assert (solution.steps < 3 * engine.solve(half).steps).all()


def test_a_run_that_fails_at_an_instant_harms_no_other(engine, sampled):
    """The law is evaluated at 1.5 s and then at 1.8 s, where its force is infinite."""
    problem, expected = sampled
    fails = np.full((RUNS, 1), 1e9)
    fails[2] = 1.7
    varying = {**problem.varying, "controller.fails_after": fails}
    problem = dataclasses.replace(problem, varying=varying)
    solution = engine.solve(problem)
    assert solution.status.tolist() == [0, 0, Status.NON_FINITE, 0, 0]
    known = problem.times < 1.8
    assert np.isnan(solution.states[2, ~known]).all()
    expected[2, ~known] = np.nan
    np.testing.assert_allclose(positions(problem, solution), expected, rtol=0, atol=ERROR)
    alone = engine.solve(problem.select(slice(2, 3)))
    # None behind its failure; runs that solve_ivp takes together share their steps.
    assert solution.steps[2] <= alone.steps[0]


@pytest.mark.parametrize("kind", ["of a force", "that are held"])
def test_the_field_changes_at_instants(engine, loop_with, kind):
    """A force that jumps, and a reference that goes on by other numbers."""
    parts = (
        {"vehicle": Vehicle(forces=(Gusts(),))} if kind == "of a force" else {"reference": Jolts()}
    )
    problem = masses(loop_with, **parts)
    problem = dataclasses.replace(problem, varying={"controller.stiffness": np.zeros((RUNS, 1))})
    solution = engine.solve(problem)
    assert not solution.status.any()
    ends = np.array([0.0, *CHANGES, DURATION])
    expected = thrown(problem.times, ends, np.tile(PUSHES, (RUNS, 1)))
    np.testing.assert_allclose(positions(problem, solution), expected, rtol=0, atol=ERROR)


def test_its_default_options_have_no_problems(engine, noted):
    assert noted(engine) == []
