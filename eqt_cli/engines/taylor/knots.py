"""Piecewise references: at a knot, a lane of an integrator takes the numbers of the next piece.

A knot is a time event: it ends a step in the lane that reaches it, and no other lane waits.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextvars import ContextVar
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.core.arrays import Array
from eqt_cli.engines.problem import ROUNDING, Problem, Span
from eqt_cli.engines.taylor.switching import Switchboard
from eqt_cli.engines.traced_loop import held_rows

SCALE = 1e-10
"""Scale of the event of a knot: heyoka chooses steps by the largest of states and events, and the
event must not matter."""

pieces: ContextVar[Mapping[float, Array]] = ContextVar("pieces")
"""`held_from` of the problem that is being solved."""


def passes_knots(loop: ClosedLoop) -> bool:
    """Return whether a batch integrates through knots: not if the law is sampled.

    It would have to look for a knot in every step, and many steps end at control instants anyway.
    """
    return loop.vehicle.control is None and loop.holds


def spans_of(problem: Problem) -> list[Span]:
    """Return the horizon, cut where all runs of a batch end a step: not at knots that it passes."""
    if passes_knots(problem.loop):
        return problem.spans_between(problem.loop.breaks)
    return problem.spans


def held_from(problem: Problem) -> dict[float, Array]:
    """Return the numbers that a loop holds, by the time, s, at which a span or a piece begins.

    The time of the next knot follows them, if knots are passed.
    """
    loop, spans = problem.loop, spans_of(problem)
    times, stop = np.array([span.start for span in spans]), spans[-1].stop
    if not passes_knots(loop):
        return dict(zip(times.tolist(), held_rows(loop, times), strict=True))
    margin = ROUNDING * max(1.0, abs(stop))
    inner = loop.knots[(loop.knots > times[0] + margin) & (loop.knots < stop - margin)]
    times = np.union1d(times, inner)
    behind_the_end = stop + 1.0
    ahead = np.append(inner, behind_the_end)[np.searchsorted(inner, times + margin)]
    rows = np.column_stack([held_rows(loop, times), ahead])
    return dict(zip(times.tolist(), rows, strict=True))


def event(heyoka: ModuleType, knot: int, board: Switchboard | None) -> Any:
    """Return the event at the time of the next knot, which is parameter `knot`."""
    margin = (heyoka.time - heyoka.par[knot]) * SCALE
    return heyoka.t_event_batch(margin, callback=NextPiece(knot, board), cooldown=0.0)


@dataclass(frozen=True)
class NextPiece:
    """The callback of an integrator at a knot.

    Attributes
    ----------
    knot
        Index of the parameter that is the time of the next knot, after the held numbers.
    board
        Switchboard of the law's comparisons, if it makes any.
    """

    knot: int
    board: Switchboard | None

    def __call__(self, integrator: Any, direction: int, lane: int) -> bool:
        """Continue with the numbers of the next piece."""
        row = pieces.get()[float(integrator.pars[self.knot, lane])]
        integrator.pars[self.knot + 1 - len(row) : self.knot + 1, lane] = row
        if self.board is not None:
            self.board.note(integrator, slice(lane, lane + 1))
        return True
