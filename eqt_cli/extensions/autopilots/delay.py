"""Delays of commands along single axes, as of thrust and of attitude."""

from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import Scale
from eqt_cli.components.actuators import Actuator
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.numbers.leaves import STRUCTURE

MOST = 1000
"""Most ticks of a delay."""


@dataclass(frozen=True)
class Delay(Actuator):
    """The command of some ticks before, along each axis; 0 until then.

    It acts at ticks: put it before actuators that move between them, such as `rate_loop` and `lag`.
    `control.delay` is the same along all axes, and begins with the first command.

    Attributes
    ----------
    ticks
        The delay along each axis in ticks of `control`; 0: none.
    """

    name: ClassVar[str] = "delay"
    departs: ClassVar[str] = "commands delayed"
    sampled: ClassVar[bool] = True

    ticks: Annotated[int | list[int], Scale("delay along each axis")] = field(metadata=STRUCTURE)

    def _ticks_by_axis(self, G: MatrixLieGroup) -> Any:
        return np.broadcast_to(self.ticks, G.dimension)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note delays that are none, too long, or not one for each axis."""
        here = problems.at("ticks")
        if isinstance(self.ticks, list) and len(self.ticks) != G.dimension:
            here.add(f"expected a number, or {G.dimension} of them, got {len(self.ticks)}")
        elif not 0 <= np.min(self.ticks) <= np.max(self.ticks) <= MOST:
            here.add(f"expected whole numbers from 0 to {MOST}, got {self.ticks}")
        elif not np.any(self.ticks):
            here.add("expected a delay above 0 along an axis; remove a delay of 0")

    def states(self, G: MatrixLieGroup) -> int:
        """Return the number of states: the last commands, as many as the longest delay and one."""
        return G.dimension * (int(np.max(self.ticks)) + 1)

    def step(self, G: MatrixLieGroup, command: Array, x: Array, period: float) -> Array:
        """Return the last commands, the new one first."""
        return np.concatenate([command, x[..., : -G.dimension]], axis=-1)

    def output(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return along each axis the command that has waited."""
        m = G.dimension
        return np.concatenate(
            [
                x[..., m * d + k : m * d + k + 1]
                for k, d in enumerate(self._ticks_by_axis(G).tolist())
            ],
            axis=-1,
        )
