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
"""How far a - b passes zero before a side changes, relative to max(1, |a|, |b|) at the start."""

AT_ONCE = 1e-6
"""A step that is shorter, s, is no more than the return to a side that was just left."""

MOST_RETURNS = 10
"""So many returns in a row, each of which doubles the width, are no motion but a sliding mode."""

recording: ContextVar[Comparisons] = ContextVar("recording")
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
        ``first + 2k``, negative where a < b, and its width.
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
        """a - b + side · width for every comparison; it has the sign of the side or is 0."""
        par = self.heyoka.par
        return [
            a - b + par[self.first + 2 * index] * par[self.first + 2 * index + 1]
            for (a, b), index in self.pairs.items()
        ]


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
        """Choose sides and widths at the initial states."""
        sides, widths = integrator.pars[self.first :: 2], integrator.pars[self.first + 1 :: 2]
        sides[:], widths[:] = 1.0, WIDTH
        a, b, _ = self._values(integrator)
        widths *= np.maximum(1.0, np.fmax(abs(a), abs(b)))
        self.settle(integrator)

    def settle(self, integrator: Any) -> None:
        """Change every side whose margin has the other sign.

        A comparison may depend on those before it, so there may be a change behind every change.
        """
        sides = integrator.pars[self.first :: 2]
        for _ in sides:
            _, _, margins = self._values(integrator)
            wrong = margins * sides < 0
            if not wrong.any():
                return
            sides[wrong] *= -1

    def _values(self, integrator: Any) -> Array:
        values: Array = self.evaluate(
            np.ascontiguousarray(integrator.state), pars=integrator.pars, time=integrator.time
        )
        return values.reshape(3, -1, integrator.batch_size)


@dataclass(frozen=True)
class Crossing:
    """What an integrator calls when comparison `index` crosses in a lane."""

    board: Switchboard
    index: int

    def __call__(self, integrator: Any, direction: int, lane: int) -> bool:
        """Change the side; False stops a lane that only goes back and forth."""
        sides = integrator.pars[self.board.first :: 2, lane]
        if integrator.last_h[lane] > AT_ONCE:
            sides[:] = np.sign(sides)
        sides[self.index] *= -2
        self.board.settle(integrator)
        return bool(abs(sides[self.index]) < 2**MOST_RETURNS)
