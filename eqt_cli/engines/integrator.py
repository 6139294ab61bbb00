"""The base class of integrators, which take some runs through one span."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.core.arrays import Array
from eqt_cli.engines.problem import Problem, Span, Status
from eqt_cli.vehicle.sensors.channels import Errors

NO_LONGER_FINITE = "the state or its derivative is no longer finite"


@dataclass(frozen=True)
class Failure:
    """The reason why a run ends before its horizon.

    Attributes
    ----------
    t
        Its time, s; NaN if only the last sample before it is known.
    """

    status: Status = Status.NON_FINITE
    reason: str = NO_LONGER_FINITE
    t: float = np.nan


@dataclass(frozen=True)
class SpanResult:
    """The results of some runs in a span.

    Attributes
    ----------
    states : (runs, n)
        States at its stop. A run whose state is not finite there has failed.
    samples : (runs, later, n)
        States at its sample times after its start; NaN from where a run failed.
    steps : (runs,)
        Work, as the engine counts it.
    failed
        The runs that end, by their index here, and why; None for a run that others may have
        stopped. It is integrated once more, alone.
    """

    states: Array
    samples: Array
    steps: Array | int
    failed: Mapping[int, Failure | None] = field(default_factory=dict)


class Integrator(ABC):
    """Integrates runs of a problem from span to span; it may keep data, such as step sizes.

    The walk calls `begin` for some runs, and then in every span `hold`, `at_instant` where a
    sampled law is evaluated at its start, and `advance`.

    Attributes
    ----------
    problem
        All runs.
    runs : (runs,)
        The current runs.
    loop
        Their closed loop, with their own parameters.
    vector_field
        Time derivatives of states ``(runs, n)`` at a time t of the current span.
    samples : (runs, samples, n) or None
        The samples of the current runs, to be filled in, if these runs are neighbours.
    reached
        May be called with a time that the runs have reached, to show progress.
    """

    runs: Array
    loop: ClosedLoop
    vector_field: Callable[[float, Array], Array]
    samples: Array | None
    reached: Callable[[float], None]

    def __init__(self, problem: Problem) -> None:
        self.problem = problem

    def begin(self, runs: Array) -> None:
        """Begin these runs, at their initial states."""
        self.loop = self.problem.select(runs).batched_loop()

    def at_instant(self, t: float, states: Array, errors: Errors | None) -> Array:
        """Return the states after a control instant, with these measurement errors."""
        return self.loop.after_instant(t, states, errors)

    def hold(self, span: Span) -> None:
        """Set the numbers that the loop holds in a span."""
        loop = self.loop.holding(span.start)
        self.vector_field = lambda t, states: loop.vector_field(span.inside(t), states)

    def room(self, span: Span) -> Array:
        """Return an array for the samples of a span; what is written there need not be copied."""
        if self.samples is None:
            return np.empty((len(self.runs), span.later, self.problem.loop.moving_length))
        return self.samples[:, span.first : span.first + span.later]

    @abstractmethod
    def advance(self, span: Span, states: Array) -> SpanResult:
        """Integrate from the states at the start of a span, ``(runs, n)``, to its stop.

        Steps are chosen by the tolerance: no step ends at a sample for its sake. A run does not
        depend on its neighbours.
        """
