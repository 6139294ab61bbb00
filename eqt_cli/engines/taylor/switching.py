"""The comparisons in a traced law and where they change, exactly; it knows no law and no group.

A Taylor step across a kink would follow one branch to its end, and no step-size control could see
it. So each ``a < b`` becomes an event that ends the step, and a parameter of each lane says on
which side it is. A side changes only when a - b has passed zero by a width far below any tolerance:
then no crossing is missed for rounding, and two equal quantities do not switch forever.
"""

from __future__ import annotations

from contextvars import ContextVar
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array

WIDTH = 1e-12
"""How far a - b passes zero before a side changes, relative to its scale."""

AT_ONCE = 1e-6
"""A step that is shorter, s, is no more than the return to a side that was just left."""

MOST_RETURNS = 10
"""So many returns in a row, each of which doubles the width, are no motion but a sliding mode."""

recording: ContextVar[Comparisons | AtOnce] = ContextVar("recording")
"""Where the comparisons go of the law that is being traced."""


@dataclass
class Comparisons:
    """Every comparison that a law makes, as expressions of heyoka.

    Attributes
    ----------
    heyoka
        The module.
    first
        Index of the first parameter behind the law's own. Comparison k has two: its side at
        ``first + 2k``, negative where a < b, and its scale: 1, or what a and b have come to.
    """

    heyoka: ModuleType
    first: int
    pairs: dict[tuple[Any, Any], int] = field(default_factory=dict)

    def less(self, a: Any, b: Any) -> Any:
        """The condition a < b."""
        symbol, par = self.heyoka.expression, self.heyoka.par
        a, b = (value if isinstance(value, symbol) else symbol(float(value)) for value in (a, b))
        if (b, a) in self.pairs:  # the same crossing must not be an event twice
            return self.heyoka.gt(par[self.first + 2 * self.pairs[b, a]], 0.0)
        index = self.pairs.setdefault((a, b), len(self.pairs))
        return self.heyoka.lt(par[self.first + 2 * index], 0.0)

    def margins(self) -> list[Any]:
        """The events, e / (1 + e²/64) with e = (a - b) / scale + side · width.

        A margin has the sign of the side, or is 0. It is bounded, because heyoka chooses steps by
        the largest of states and events: a large event would leave the states inaccurate.
        """
        par, margins = self.heyoka.par, []
        for (a, b), index in self.pairs.items():
            side, scale = par[self.first + 2 * index], par[self.first + 2 * index + 1]
            e = (a - b) / scale + side * WIDTH
            margins.append(e / (1.0 + e * e / 64.0))
        return margins


@dataclass(frozen=True)
class AtOnce:
    """The comparisons of what is evaluated at one instant: each is decided there and then."""

    heyoka: ModuleType

    def less(self, a: Any, b: Any) -> Any:
        """The condition a < b."""
        return self.heyoka.lt(a, b)


@dataclass(frozen=True)
class Switchboard:
    """Holds the sides of every lane of an integrator true to its state.

    Attributes
    ----------
    first
        Index of the first side among the parameters.
    evaluate
        Compiled: every a, then every b, then every margin, of all lanes.
    """

    first: int
    evaluate: Any

    def start(self, integrator: Any) -> None:
        """Choose sides and scales at the initial states."""
        integrator.pars[self.first :] = 1.0
        self._settle(integrator, slice(None))

    def cross(self, integrator: Any, index: int, direction: int, lane: int) -> bool:
        """Change a side where its event has happened.

        False if it only goes back and forth, or if the side was wrong: a margin that comes back
        has left without an event.
        """
        sides = integrator.pars[self.first :: 2, lane]
        if integrator.last_h[lane] > AT_ONCE:
            if direction * sides[index] > 0:
                return False
            sides[:] = np.sign(sides)
        sides[index] *= -2
        self._settle(integrator, slice(lane, lane + 1))
        return bool(abs(sides[index]) < 2**MOST_RETURNS)

    def check(self, integrator: Any) -> bool:
        """After a step: False if a side has become wrong without an event.

        heyoka looks for none where the series of a comparison is not finite.
        """
        wrong = self._wrong(integrator)
        if not (wrong > 0).any():
            return True
        if (wrong > WIDTH).any():
            return False
        for lane in np.flatnonzero((wrong > 0).any(axis=0)):
            self._settle(integrator, slice(lane, lane + 1))  # it ended on a crossing, to rounding
        return True

    def is_right(self, integrator: Any) -> bool:
        """Whether no side is wrong."""
        return not (self._wrong(integrator) > 0).any()

    def _wrong(self, integrator: Any) -> Array:
        """How far each margin is on the other side, ``(comparisons, lanes)``."""
        margins = self._values(integrator)[2]
        wrong: Array = -margins * np.sign(integrator.pars[self.first :: 2])
        return wrong

    def _settle(self, integrator: Any, lanes: slice) -> None:
        """Let the scales follow, and change every side whose margin has the other sign.

        A comparison may depend on those before it, so there may be a change behind every change.
        """
        sides = integrator.pars[self.first :: 2, lanes]
        scales = integrator.pars[self.first + 1 :: 2, lanes]
        for _ in sides:
            a, b, margins = self._values(integrator)[..., lanes]
            # The smaller of |a| and |b|, which are equal where they cross. Growth widens the band
            # about 0 in which no side changes, so it makes no side wrong.
            size = np.fmin(abs(a), abs(b))
            np.maximum(scales, size, out=scales, where=np.isfinite(size))
            wrong = margins * sides < 0
            if not wrong.any():
                return
            sides[wrong] *= -1

    def _values(self, integrator: Any) -> Array:
        """All a, b and margins, ``(3, comparisons, lanes)``."""
        values: Array = self.evaluate(
            np.ascontiguousarray(integrator.state), pars=integrator.pars, time=integrator.time
        )
        return values.reshape(3, -1, integrator.batch_size)


@dataclass(frozen=True)
class Crossing:
    """What an integrator calls at the event of comparison `index`."""

    board: Switchboard
    index: int

    def __call__(self, integrator: Any, direction: int, lane: int) -> bool:
        """Go on from the event on its other side, if that leads anywhere."""
        return self.board.cross(integrator, self.index, direction, lane)
