"""Evaluates a law at many states, possibly with changed gains, inputs or memory."""

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
    """A law and the states at which its torque is computed.

    Attributes
    ----------
    loop
        The loop, with the law as a formula.
    inputs, memory
        Inputs and memory of the law, one row per state.
    """

    loop: ClosedLoop
    inputs: LawInput
    memory: Mapping[str, Array]

    def torque(
        self,
        *,
        law: Controller | None = None,
        inputs: LawInput | None = None,
        K: float = 1.0,
        K_d: float = 1.0,
        memory: Mapping[str, Array] | None = None,
    ) -> Array:
        """Return the torque of this or another law with scaled gains, ``(rows, m)``."""
        loop, inputs = self.loop, inputs or self.inputs
        gains = Gains(K * loop.gains.K, K_d * loop.gains.K_d)
        kept = self.memory if memory is None else memory
        s = inputs.tracking(loop.group, loop.inertia, gains, kept)
        with np.errstate(all="ignore"):
            found: Array = (law or loop.controller).torque(s) + 0.0 * inputs.velocity
        return found

    @property
    def forgetful(self) -> dict[str, Array]:
        """The memory set to 0."""
        return {name: 0 * values for name, values in self.memory.items()}

    @cached_property
    def frame(self) -> Frame:
        """Frame of the errors of the law."""
        found: Frame = getattr(self.loop.controller, "error", "body")
        return found
