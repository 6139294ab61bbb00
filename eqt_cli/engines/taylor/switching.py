"""Exact switching of the comparisons in a traced law; it knows no law and no group.

A Taylor step across a kink would follow one branch to its end, unseen by step-size control. A
comparison is decided at the start of a step, for the whole step, and an event ends the step as soon
as a - b has passed zero by a width far below any tolerance: the next step begins on the other side,
no crossing is missed by rounding, and two equal quantities do not switch forever.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.program import Program

WIDTH = 1e-12
"""Width by which a - b passes zero before a step ends, relative to its scale."""

AT_ONCE = 1e-6
"""Step length, s, below which a step is a mere return to the side just left."""

MOST_RETURNS = 10
"""Number of returns in a row, each doubling the width, that counts as a sliding mode."""

SIDE, FACTOR, SCALE = range(3)
NUMBERS = 3
"""Number of parameters of a comparison: its side, -1 if a < b when last evaluated, else 1; the
factor of its width; and its scale, the largest of 1 and all noted min(|a|, |b|)."""


def comparisons(program: Program) -> dict[tuple[int, int], bool]:
    """Return the pairs (a, b) of values that a law compares, each crossing once.

    Each maps to whether its side changes at events only, and not also with the form of a smooth
    function. A comparison that only chooses such a form needs no event.
    """
    formed = program.following_from("smooth_less")
    found: dict[tuple[int, int], bool] = {}
    for a, b in program.operands_of("less"):
        if (b, a) not in found:  # the same crossing must not be an event twice
            found[a, b] = formed.isdisjoint((a, b))
    return found


def margin(heyoka: ModuleType, a: Any, b: Any, first: int) -> Any:
    """Return the event of a comparison, e / (1 + e²/64) with e = |a - b| / scale + factor · width.

    The absolute value continues across 0 on the branch on which the step began. The margin is
    bounded, because heyoka chooses steps by the largest of states and events: a large event would
    leave the states inaccurate.

    Parameters
    ----------
    first
        Index of the first of its `NUMBERS` parameters.
    """
    e = (a - b) / heyoka.par[first + SCALE]
    e = heyoka.select(heyoka.lt(a, b), -e, e) + heyoka.par[first + FACTOR] * WIDTH
    return e / (1.0 + e * e / 64.0)


@dataclass(frozen=True)
class Switchboard:
    """The sides of the comparisons in every lane of an integrator, so that no switch is missed.

    Attributes
    ----------
    first
        Index of the first parameter of the comparisons.
    steady
        Whether the side of each comparison changes at events only.
    evaluate
        Compiled function: every a, then every b, of all lanes.
    """

    first: int
    steady: Array
    evaluate: Any

    def start(self, integrator: Any) -> None:
        """Note sides and scales at the initial states."""
        integrator.pars[self.first :] = 1.0
        self.note(integrator, slice(None))

    def cross(self, integrator: Any, index: int, lane: int) -> bool:
        """Continue after the event of a comparison; return False if it only chatters."""
        factors = integrator.pars[self.first + FACTOR :: NUMBERS, lane]
        if integrator.last_h[lane] > AT_ONCE:
            factors[:] = 1.0
        factors[index] *= 2.0
        self.note(integrator, slice(lane, lane + 1))
        return bool(factors[index] < 2**MOST_RETURNS)

    def check(self, integrator: Any) -> bool:
        """Return False if, after a step, a side has become wrong without an event.

        heyoka detects no event where the series of a comparison is not finite.
        """
        wrong = self._wrong(integrator)
        if not (wrong > 0).any():
            return True
        if (wrong > WIDTH).any():
            return False
        for lane in np.flatnonzero((wrong > 0).any(axis=0)):
            self.note(integrator, slice(lane, lane + 1))  # a step ended on a crossing, to rounding
        return True

    def is_right(self, integrator: Any) -> bool:
        """Return whether no side is wrong."""
        return not self.steady.any() or not (self._wrong(integrator) > 0).any()

    def _wrong(self, integrator: Any) -> Array:
        """Return how far each comparison is past its width on the wrong side, ``(…, lanes)``."""
        a, b = self._values(integrator)
        numbers = integrator.pars[self.first :].reshape(len(a), NUMBERS, -1)
        with np.errstate(invalid="ignore"):  # of infinite quantities
            margins = (a - b) / numbers[:, SCALE] * numbers[:, SIDE]
        wrong: Array = -(margins + WIDTH * numbers[:, FACTOR])[self.steady]
        return wrong

    def note(self, integrator: Any, lanes: slice) -> None:
        """Update sides and scales."""
        a, b = self._values(integrator)[..., lanes]
        integrator.pars[self.first + SIDE :: NUMBERS, lanes] = np.where(a < b, -1.0, 1.0)
        # The smaller of |a| and |b|, which are equal where they cross. A larger scale widens the
        # band about 0 in which no step ends, so it makes no side wrong.
        size = np.fmin(abs(a), abs(b))
        scales = integrator.pars[self.first + SCALE :: NUMBERS, lanes]
        np.maximum(scales, size, out=scales, where=np.isfinite(size))

    def _values(self, integrator: Any) -> Array:
        """Return all a and b, ``(2, comparisons, lanes)``."""
        used = integrator.pars[: self.evaluate.nparams]
        values: Array = self.evaluate(
            np.ascontiguousarray(integrator.state), pars=used, time=integrator.time
        )
        return values.reshape(2, -1, integrator.batch_size)


@dataclass(frozen=True)
class Crossing:
    """The callback of an integrator at the event of comparison `index`."""

    board: Switchboard
    index: int

    def __call__(self, integrator: Any, direction: int, lane: int) -> bool:
        """Continue on the other side of the event, unless it only chatters."""
        return self.board.cross(integrator, self.index, lane)
