"""A law that is asked for its torque at many states, perhaps without some of what it has."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.closed_loop.law_input import LawInput
from eqt_cli.controllers import Controller
from eqt_cli.controllers.family import Frame
from eqt_cli.core.arrays import Array
from eqt_cli.mechanics.tracking import Gains


@dataclass(frozen=True)
class Question:
    """A law that is asked for its torque at many states.

    Attributes
    ----------
    loop
        With the law as a formula.
    told, memory
        What it is told, and what it remembers, a row each.
    """

    loop: ClosedLoop
    told: LawInput
    memory: Mapping[str, Array]

    def torque(
        self,
        *,
        law: Controller | None = None,
        told: LawInput | None = None,
        K: float = 1.0,
        K_d: float = 1.0,
        memory: Mapping[str, Array] | None = None,
    ) -> Array:
        """The torque of the law or another, perhaps with its gains scaled, ``(rows, m)``."""
        loop, told = self.loop, told or self.told
        gains = Gains(K * loop.gains.K, K_d * loop.gains.K_d)
        kept = self.memory if memory is None else memory
        s = told.tracking(loop.group, loop.inertia, gains, kept)
        with np.errstate(all="ignore"):
            found: Array = (law or loop.controller).torque(s) + 0.0 * told.velocity
        return found

    @property
    def forgetful(self) -> dict[str, Array]:
        """The memory at 0."""
        return {name: 0 * values for name, values in self.memory.items()}

    @cached_property
    def frame(self) -> Frame:
        """Of the errors that the law is about."""
        found: Frame = getattr(self.loop.controller, "error", "body")
        return found
