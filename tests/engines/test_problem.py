"""What engines share, apart from any of them."""

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from eqt_cli.engines import Engine, Problem, Status
from eqt_cli.engines.integrator import Integrator
from eqt_cli.engines.problem import Solution, Span, _nearest


@pytest.mark.parametrize(
    ("instant", "found"),
    [
        (0.3 + 1e-16, 0.3),
        (0.1 * 3, 0.3),
        (0.3 - 1e-16, 0.3),
        (0.5, 0.5),
        (0.0, 0.0),
        (1.0, 1.0),
        (1.0 - 2e-16, 1.0),
        (0.31, 0.31),
        (2.0, 2.0),
    ],
)
def test_instants_are_sample_times_but_for_rounding(instant, found):
    """So that no step of rounding's size lies between the two."""
    times = np.array([0.0, 0.3, 0.6, 1.0])
    assert _nearest(np.array([instant]), times).tolist() == [found]


def test_without_instants_there_is_nothing_to_move():
    assert _nearest(np.empty(0), np.array([0.0])).size == 0


class Resting(Integrator):
    def begin(self, runs):
        pass

    def advance(self, span, states):
        raise NotImplementedError


@dataclass(frozen=True)
class Asked(Engine):
    """Notes the times that it is asked for, and goes no further."""

    name: ClassVar[str] = "asked"

    rtol: float = 1e-9
    times: list = field(default_factory=list)

    def spans(self, problem):
        self.times.append(problem.times.tolist())
        return []

    def integrator(self, problem):
        return Resting(problem)

    def tightened(self, factor):
        return self


@pytest.mark.parametrize("times", [[2.0, 12.0], [2.0, 3.0, 12.0]])
def test_a_billionth_of_the_horizon_is_rehearsed(times):
    engine = Asked()
    engine.rehearse(Problem(SimpleNamespace(moving_length=1), np.zeros((1, 1)), np.array(times)))
    assert engine.times == [[2.0, pytest.approx(2 + 1e-8, abs=1e-15)]]


@pytest.mark.parametrize(
    ("start", "stop", "period", "instants"),
    [(0.0, 10.0, 2.0, 5), (3.0, 10.0, 2.0, 3), (4.0, 9.0, 2.0, 3), (-3.0, 3.0, 2.0, 3)],
)
def test_control_instants_are_multiples_of_the_period_before_the_end(start, stop, period, instants):
    loop = SimpleNamespace(vehicle=SimpleNamespace(control=SimpleNamespace(period=period)))
    problem = Problem(loop, np.zeros((1, 1)), np.array([start, stop]))
    assert problem.control_instants == instants


def test_numbers_of_ends_of_runs_never_change():
    """They stand in result files; an empty solution has the good one."""
    assert {end.name: end.value for end in Status} == {
        "OK": 0,
        "SOLVER_FAILED": 1,
        "NON_FINITE": 2,
        "STEP_LIMIT": 3,
        "ACCURACY": 4,
        "WORKER_LOST": 5,
        "ESTIMATE_LOST": 6,
    }
    problem = Problem(None, np.zeros((2, 1)), np.arange(3.0))
    assert Solution.empty(problem).status.tolist() == [Status.OK] * problem.runs


@pytest.mark.parametrize(
    ("t", "later", "stop"), [(0.0, 0, 0.0), (0.4, 1, 0.25), (0.5, 2, 0.5), (2.0, 3, 0.75)]
)
def test_a_span_can_end_at_its_last_sample_before_a_time(t, later, stop):
    span = Span(0.0, 1.0, (0.0, np.nextafter(1.0, 0.0)), np.linspace(0.0, 1.0, 5), 1, 3, True)
    shorter = span.until(t)
    assert (shorter.start, shorter.stop, shorter.later) == (0.0, stop, later)
    np.testing.assert_array_equal(shorter.grid, span.grid[: later + 1])
    assert shorter.within == (0.0, stop)


def test_times_at_an_end_where_the_field_changes_are_inside():
    span = Span(0.0, 1.0, (0.0, np.nextafter(1.0, 0.0)), np.array([0.0, 1.0]), 1, 0, True)
    assert [span.inside(t) for t in (0.0, 0.5, 1.0)] == [0.0, 0.5, np.nextafter(1.0, 0.0)]
