"""What engines share, apart from any of them."""

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from said import error_of

from eqt_cli.components.sensors import Errors
from eqt_cli.engines.engine import (
    Engine,
    Failure,
    Integrator,
    Problem,
    Solution,
    Span,
    SpanResult,
    Status,
    _nearest,
    _note,
    _Reached,
    walked,
)
from eqt_cli.extend import group_named
from eqt_cli.numbers.leaves import STRUCTURE


@pytest.mark.parametrize(
    ("instant", "found"),
    [
        *((0.3 + 1e-16, 0.3), (0.1 * 3, 0.3), (0.3 - 1e-16, 0.3), (0.5, 0.5), (0.0, 0.0)),
        *((1.0, 1.0), (1.0 - 2e-16, 1.0), (0.31, 0.31), (2.0, 2.0)),
        *((0.6 + 1.5e-12, 0.6 + 1.5e-12), (0.6 - 1.5e-12, 0.6 - 1.5e-12), (-1e6 + 5e-7, -1e6)),
        *((-1e6 - 5e-7, -1e6), (-1e6 + 2e-6, -1e6 + 2e-6)),
    ],
)
def test_instants_are_sample_times_but_for_rounding(instant, found):
    """So that no step of rounding's size lies between the two."""
    times = np.array([-1e6, 0.0, 0.3, 0.6, 1.0])
    assert _nearest(np.array([instant]), times).tolist() == [found]


def loop_with_instants(*instants):
    """Stands for a loop with one state, whose field changes at these times."""
    return SimpleNamespace(
        moving_length=1,
        vehicle=SimpleNamespace(control=None),
        instants=lambda until: np.array(instants),
        controller=SimpleNamespace(formula=None),
    )


class Resting(Integrator):
    def begin(self, runs):
        pass

    def hold(self, span):
        pass

    def advance(self, span, states):
        return SpanResult(states, np.repeat(states[:, None], span.later, axis=1), 1)


@dataclass(frozen=True)
class Asked(Engine):
    """Notes the times that it is asked for, and goes no further."""

    name: ClassVar[str] = "asked"

    rtol: float = 1e-9
    times: list = field(default_factory=list)

    def groups(self, problem, threads):
        self.times.append(problem.times.tolist())
        return super().groups(problem, threads)

    def integrator(self, problem):
        return Resting(problem)

    def tightened(self, factor):
        return self


@pytest.mark.parametrize(
    ("states", "samples", "said"),
    [((1, 1), (2, 1, 1), "states of shape (1, 1); expected (2, 1)"),
     ((2, 1), (2, 3, 1), "samples of shape (2, 3, 1); expected (2, 1, 1)")],
)  # fmt: skip
def test_an_engine_that_returns_another_shape_is_named(monkeypatch, states, samples, said):
    result = SpanResult(np.zeros(states), np.zeros(samples), 0)
    monkeypatch.setattr(Resting, "advance", lambda *_: result)
    problem = Problem(loop_with_instants(), np.zeros((2, 1)), np.array([2.0, 12.0]))
    assert f"Resting: advance returned {said}" in error_of(Asked().solve, problem)


@pytest.mark.parametrize("times", [[2.0, 12.0], [2.0, 3.0, 12.0]])
def test_a_billionth_of_the_horizon_is_rehearsed(times):
    engine = Asked()
    engine.rehearse(Problem(loop_with_instants(), np.zeros((1, 1)), np.array(times)))
    assert engine.times == [[2.0, pytest.approx(2 + 1e-8, abs=1e-15)]]


@pytest.mark.parametrize(
    ("start", "stop", "period", "instants"),
    [
        *((0.0, 10.0, 2.0, 5), (3.0, 10.0, 2.0, 3), (4.0, 9.0, 2.0, 3), (-3.0, 3.0, 2.0, 3)),
        *((0.0, 10.0, 0.5, 20), (3.0, 10.0, 0.5, 14)),
    ],
)
def test_control_instants_are_multiples_of_the_period_before_the_end(start, stop, period, instants):
    loop = SimpleNamespace(vehicle=SimpleNamespace(control=SimpleNamespace(tick=period)))
    times = np.array([start, (start + stop) / 2, stop])
    problem = Problem(loop, np.zeros((1, 1)), times)
    assert problem.control_instants == instants


def test_a_horizon_is_cut_at_instants_and_samples_belong_to_the_span_behind_them():
    """A field that changes at an end is evaluated inside the span."""
    loop = loop_with_instants(-1.0, 0.0, 0.5, 1.5, 2.0, 3.0)
    problem = Problem(loop, np.zeros((1, 1)), np.array([0.0, 0.5, 1.0, 1.2, 2.0]))
    one, two, three = problem.spans
    assert [(span.start, span.stop) for span in (one, two, three)] == [
        (0, 0.5),
        (0.5, 1.5),
        (1.5, 2),
    ]
    assert [span.grid.tolist() for span in (one, two, three)] == [
        [0.0, 0.5],
        [0.5, 1.0, 1.2, 1.5],
        [1.5, 2.0],
    ]
    assert [(span.first, span.later) for span in (one, two, three)] == [(1, 0), (2, 2), (4, 1)]
    assert [span.sampled_start for span in (one, two, three)] == [True, True, False]
    assert [span.within for span in (one, two, three)] == [
        (0.0, np.nextafter(0.5, 0)),
        (np.nextafter(0.5, 1), np.nextafter(1.5, 0)),
        (np.nextafter(1.5, 2), 2.0),
    ]
    assert [span.tick for span in (one, two, three)] == [None] * 3


def test_spans_know_the_control_instant_that_they_begin_with():
    vehicle = SimpleNamespace(control=SimpleNamespace(tick=0.8))
    loop = SimpleNamespace(vehicle=vehicle, instants=lambda until: np.array([1.0]))
    problem = Problem(loop, np.zeros((1, 1)), np.array([0.5, 1.6, 2.0]))
    assert [(span.start, span.tick) for span in problem.spans] == [
        (0.5, None),
        (0.8, 1),
        (1.0, None),
        (1.6, 2),
    ]
    assert problem.control_instants == 2


def test_numbers_of_ends_of_runs_never_change():
    """They stand in result files."""
    assert {end.name: end.value for end in Status} == {
        "STOPPED": -1,  # which no file holds
        "OK": 0,
        "SOLVER_FAILED": 1,
        "NON_FINITE": 2,
        "STEP_LIMIT": 3,
        "ACCURACY": 4,
        "WORKER_LOST": 5,
        "ESTIMATE_LOST": 6,
        "DIVERGED": 7,
        "BY_ROUNDING": 8,
        "NO_ANSWER": 9,
        "BOUND_CROSSED": 10,
    }


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


# Runs of several problems -------------------------------------------------------------------------


@dataclass(frozen=True)
class Moving:
    """Stands for a loop with one number."""

    speed: float = 2.0
    group: object = field(default=group_named("SO3"), metadata=STRUCTURE)


def errors_of(*runs):
    """Errors at two instants, which tell the run and the instant."""
    velocity = np.array(runs)[:, None, None] + np.array([0.0, 0.25])[:, None]
    shape = (len(runs), 2)
    return Errors(np.zeros((*shape, 3)), velocity, np.empty((*shape, 0)))


TIMES = np.array([0.0, 1.0])


@pytest.mark.parametrize("measured", [False, True])
def test_runs_of_several_problems_are_those_of_one(measured):
    one = Problem(Moving(), np.zeros((2, 1)), TIMES, errors=errors_of(1, 2) if measured else None)
    varying = {"speed": np.array([[5.0]])}
    other = Problem(
        Moving(3.0), np.ones((1, 1)), TIMES, varying, errors_of(3) if measured else None
    )
    both = Problem.joined([one, other])
    assert both.states.ravel().tolist() == [0, 0, 1]
    assert both.varying["speed"].ravel().tolist() == [2, 2, 5]
    assert both.times is TIMES
    assert (both.errors is not None) == measured
    chosen = both.select(np.array([2, 0]))
    assert chosen.states.ravel().tolist() == [1, 0]
    assert chosen.varying["speed"].ravel().tolist() == [5, 2]
    if measured:
        assert both.errors.velocity[:, 0, 0].tolist() == [1, 2, 3]
        assert chosen.drawn(slice(1, 2)).velocity[:, 0, 0].tolist() == [1]
        assert chosen.drawn().velocity[..., 0].tolist() == [[3, 3.25], [1, 1.25]]
    else:
        assert chosen.errors is None
        assert chosen.drawn() is None


def test_a_single_problem_can_be_joined():
    alone = Problem.joined([Problem(Moving(4.0), np.ones((2, 1)), TIMES)])
    assert alone.runs == 2
    assert (alone.loop.speed, alone.varying) == (4.0, {})  # nothing differs from run to run


def test_numbers_of_runs_have_an_axis_for_samples():
    problem = Problem(Moving(), np.zeros((3, 1)), TIMES)
    assert problem.batched_loop() is problem.loop
    varying = {"speed": np.array([1.0, 2.0, 3.0])[:, None]}
    problem = Problem(problem.loop, problem.states, TIMES, varying)
    assert problem.batched_loop().speed.shape == (3, 1)
    assert problem.batched_loop(extra_axes=1).speed.shape == (3, 1, 1)
    assert problem.batched_loop(extra_axes=2).speed.shape == (3, 1, 1, 1)


# Ends and progress of runs ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("t", "blown", "first", "known", "message"),
    [
        (2.0, 9, 1, 3, "t = 12 s: step limit"),
        (2.5, 9, 1, 3, "t = 12.5 s: step limit"),
        (4.0, 9, 1, 5, "t = 14 s: step limit"),
        (3.5, 1, 1, 1, "t = 13.5 s: step limit"),
        (np.nan, 3, 1, 3, "after t = 12 s: step limit"),
        (np.nan, 9, -2, 2, "after t = 11 s: step limit"),
        (np.nan, 0, 1, 0, "after t = 10 s: step limit"),
        (0.0, 0, 1, 0, "t = 10 s: step limit"),
    ],
    ids=[
        *("at a sample", "between two", "at the last sample", "not finite before"),
        *("at an unknown time", "before the span ends", "from the start", "at the start"),
    ],
)
def test_a_run_that_fails_has_no_sample_behind_its_failure(t, blown, first, known, message):
    """Nor behind the first one that is not finite, nor behind the span in which it has failed."""
    times = np.linspace(10.0, 14.0, 5)
    problem = Problem(None, np.zeros((3, 2)), times)
    states = np.ones((3, 5, 2))
    states[1, blown : blown + 1, 1] = np.inf
    solution = Solution(states, np.zeros(3, dtype=int), np.zeros(3), [""] * 3)
    span = Span(10.0, 14.0, (10.0, 14.0), times, first, 4, True)
    _note(solution, problem, 1, span, Failure(Status.STEP_LIMIT, "step limit", 10.0 + t))
    assert np.isnan(states[1, known:]).all()
    assert (states[1, :known] == 1).all()
    assert (states[[0, 2]] == 1).all()
    assert solution.messages == ["", message, ""]
    assert solution.status.tolist() == [0, Status.STEP_LIMIT, 0]


def test_progress_is_reported_in_runs_from_one_fiftieth_on():
    reports = []
    reached = _Reached(SimpleNamespace(times=np.array([2.0, 5.0, 10.0])), 4, reports.append)
    for t in (2.1, 4.0, 4.1, 6.0):
        reached(t)
    assert reports == [1.0, 1.0]
    reached.finish()
    reached.finish()
    assert reports == [1.0, 1.0, 2.0]


class Counting(Resting):
    """States grow by 1 in every span, which takes a run 2, 3, 4, … steps; some of them fail."""

    failed: ClassVar[dict] = {}

    def advance(self, span, states):
        steps = 2 + self.runs
        failed = {
            place: failure if len(self.runs) == 1 else asked
            for place, run in enumerate(self.runs.tolist())
            for asked, failure in [self.failed.get((run, span.start), (None, None))]
            if failure
        }
        samples = np.repeat(states[:, None] + 1, span.later, axis=1)
        return SpanResult(states + 1, samples, steps, failed)


def counted(failed, groups, threads=1):
    """The solution of four runs through two spans, with a sample at each end and within."""
    problem = Problem(loop_with_instants(1.0), np.zeros((4, 1)), np.array([0.0, 0.5, 1.0, 2.0]))
    integrator = Counting(problem)
    integrator.failed = failed
    reports = []
    solution = walked(integrator, [np.array(g) for g in groups], reports.append, threads)
    assert sum(reports) == 4
    return solution


LATE = Failure(Status.STEP_LIMIT, "step limit", 1.5)


@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize("groups", [[[0, 1, 2, 3]], [[0, 2], [1, 3]], [[0, 1], [2, 3]]])
@pytest.mark.parametrize("alone", [False, True])
def test_steps_and_samples_of_a_run_end_with_it(groups, threads, alone):
    """Run 1 fails in the first span, and run 2 in the second: known there, or only alone."""
    early = Failure(Status.NON_FINITE, "not finite", 0.2)
    failed = {
        (1, 0.0): (None if alone else early, early),
        (2, 1.0): (None if alone else LATE, LATE),
    }
    solution = counted(failed, groups, threads)
    nan = np.nan
    np.testing.assert_array_equal(
        solution.states[..., 0], [[0, 1, 1, 2], [0, nan, nan, nan], [0, 1, 1, nan], [0, 1, 1, 2]]
    )
    assert solution.steps.tolist() == [4, 3, 8, 10]
    assert solution.status.tolist() == [0, Status.NON_FINITE, Status.STEP_LIMIT, 0]
    assert solution.messages == ["", "t = 0.2 s: not finite", "t = 1.5 s: step limit", ""]


@pytest.mark.parametrize("groups", [[[0, 1, 2, 3]], [[0], [1], [2], [3]]])
def test_runs_that_all_fail_are_not_carried_on(groups):
    failed = {(run, 0.0): (LATE, LATE) for run in range(4)}
    assert counted(failed, groups).steps.tolist() == [2, 3, 4, 5]


def test_an_error_in_a_thread_is_raised():
    with pytest.raises(TypeError):
        counted({(3, 0.0): 1}, [[0, 1], [2, 3]], threads=2)
