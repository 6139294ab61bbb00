"""A vector field as its program: equal to the field, and only where nothing else decides."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from ci_cases import mostly_ci

from eqt_cli.config import shipped
from eqt_cli.config.document import read_config
from eqt_cli.config.preflight import build
from eqt_cli.engines.solve_ivp import COMPARED, WORTH_TRACING, TracedField
from eqt_cli.extend import Problem
from eqt_cli.loop.closed_loop import ReferenceSystem
from eqt_cli.numbers.leaves import STRUCTURE, leaves

Random, RUNS, EVALUATIONS = np.random.default_rng, 5, WORTH_TRACING + COMPARED + 3


@dataclass(frozen=True, eq=False)
class Loop:
    """Stands for a closed loop whose place is held between instants."""

    rates: Callable = field(metadata=STRUCTURE)
    speed: np.ndarray = field(default_factory=lambda: np.array([2.0]))
    place: np.ndarray | None = None
    moving_length = 2

    def holding(self, t):
        return replace(self, place=np.array([t, t * t]))

    @property
    def held_leaves(self):
        return leaves(self, ["place"])

    def vector_field(self, t, states):
        return self.rates(self, t, states)


def states(seed):
    return np.random.default_rng(seed).standard_normal((RUNS, 2))


def evaluated(rates, evaluations=EVALUATIONS, **varying):
    """What a field gives, evaluated at so many states in turn."""
    found = TracedField(Problem(Loop(rates), states(0), np.array([0.0, 1.0]), varying))
    found.hold(0.5)
    return [found(0.1 * k, states(k)) for k in range(evaluations)]


@mostly_ci("name", shipped.names(), ["paper", "se3_survey"], "builds an experiment")
def test_every_shipped_loop_equals_its_program(name):
    """At another state and with other held numbers than those at which it was traced."""
    experiment, random = build(read_config(shipped.folder() / f"{name}.yaml")), Random(3)
    loops = [*experiment.loops.values()]
    for loop in (*loops, ReferenceSystem.of(loops[0])):
        if not loop.moving_length:
            continue
        vectors = 0.5 * random.standard_normal((4, RUNS, loop.group.dimension))
        Q, Qd = map(loop.group.exp, vectors[:2])
        y = loop.initial_state(Q, vectors[2], Qd, vectors[3])[:, : loop.moving_length]
        found = TracedField(Problem(loop, y, np.array([0.0, 1.0])))
        found.hold(0.0)
        for _ in range(EVALUATIONS):
            found(0.1, y)
        assert found._program is not None
        other = y * random.uniform(0.9, 1.1, y.shape)
        found.hold(1.0)
        expected = loop.holding(1.0).vector_field(1.0, other)
        # Rates of actuators are differences of numbers of this size; 90 roundings of it.
        size = max(np.abs(expected).max(), np.abs(other).max())
        np.testing.assert_allclose(found(1.0, other), expected, rtol=0, atol=2e-14 * size)


def branching_on_time(loop, t, y):
    return -y if t < 2.0 else y


def branching_on_states(loop, t, y):
    return -y if y.max() > 0 else y


def branching_on_a_held_number(loop, t, y):
    return -y if loop.place[..., 0] > 0 else y


def inverting(loop, t, y):
    return y @ np.linalg.inv(np.eye(2) + 0 * y[:2])


def with_a_large_matrix(loop, t, y):
    matrix = Random(1).standard_normal((2, 1000))
    return (y @ matrix) @ matrix.T


REFUSED = [
    branching_on_time,
    branching_on_states,
    branching_on_a_held_number,
    inverting,
    with_a_large_matrix,
]


@pytest.mark.parametrize("rates", REFUSED)
def test_what_is_no_program_is_evaluated_as_it_is_written(rates):
    held = Loop(rates).holding(0.5)
    expected = [rates(held, 0.1 * k, states(k)) for k in range(EVALUATIONS)]
    np.testing.assert_array_equal(evaluated(rates), expected)


def test_a_field_that_depends_on_more_than_it_is_given_is_no_program():
    called = []

    def counting(loop, t, y):
        called.append(t)
        return len(called) * 1e-3 + y

    found = evaluated(counting)
    for k, rates in enumerate(found):  # to trace it is one more call
        calls = k + 1 + (k >= WORTH_TRACING)
        np.testing.assert_array_equal(rates, calls * 1e-3 + states(k))


@pytest.mark.parametrize(("gap", "traced"), [(5e-11, True), (2e-10, False)])
def test_a_program_may_differ_by_rounding(gap, traced):
    """Relative to the largest finite entry; what is no number is none in both."""

    def rates(loop, t, y):
        symbolic = y.dtype == object
        return 1e3 * np.array([1.0 + gap * symbolic, np.nan]) + 0 * y

    with np.errstate(invalid="ignore"):  # as engines evaluate it
        last = evaluated(rates)[-1]
    expected = 1e3 * (1.0 + gap) if traced else 1e3
    np.testing.assert_array_equal(last, [[expected, np.nan]] * RUNS)


def test_a_program_goes_on_with_held_numbers_and_those_of_each_run():
    called, speed = [], np.arange(1.0, RUNS + 1)[:, None]

    def rates(loop, t, y):
        called.append(t)
        return loop.speed * t * y + loop.place

    loop = Loop(rates)
    found = TracedField(Problem(loop, states(0), np.array([0.0, 1.0]), {"speed": speed}))
    for k in range(3 * WORTH_TRACING):
        found.hold(k)
        expected = speed * (0.1 * k) * states(k) + np.array([k, k * k])
        np.testing.assert_array_equal(found(0.1 * k, states(k)), expected)
    assert len(called) == WORTH_TRACING + COMPARED + 1
