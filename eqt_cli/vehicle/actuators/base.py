"""What an actuator is: what becomes of a command; it knows no law, no plant and no engine."""

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from eqt_cli.core.arrays import Array, where
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.component import VehiclePart


@dataclass(frozen=True)
class Actuator(VehiclePart):
    """One of the actuators through which a command goes, in their order.

    It takes the command that it is given, and its own states where it has any, which start at 0.
    """

    has_closed_form: ClassVar[bool] = False
    """Whether `after` says where a held command leads its states."""

    limited: ClassVar[str] = ""
    """What its limit is one of, for messages: ``a rate of``; nothing where it is one of torques."""

    # Most actuators give these by a class variable.

    @property
    def limits(self) -> bool:
        """Whether it can be at a limit."""
        return False

    @property
    def moves(self) -> bool:
        """Whether it has states that change between instants, by a `state_rate`."""
        return False

    @property
    def sampled(self) -> bool:
        """Whether it acts at control instants only, on a command that is held.

        One that also `moves` takes the command by its `step` at an instant.
        """
        return False

    @property
    def solves(self) -> bool:
        """Whether `solution` says what its `step` is given; no engine compiles that."""
        return False

    @property
    def acting_at_instants(self) -> str:
        """What of it acts at control instants, as a message calls it."""
        return self.name

    @property
    def thruster_names(self) -> tuple[str, ...]:
        """The names of its thrusters, where it has any."""
        return ()

    @property
    def linear_part(self) -> "Actuator":
        """It without limits, steps and dead zones; `PassThrough` where nothing is left of it."""
        return self

    def states(self, G: MatrixLieGroup) -> int:
        """How many states it has."""
        return 0

    @abstractmethod
    def output(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """What it makes of a command, ``(..., m)``; x are its states."""

    def state_rate(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """The time derivative of its states."""
        return x

    def after(self, G: MatrixLieGroup, command: Array, x: Array, duration: Array) -> Array:
        """Its states after a command was held for so long, where it has a closed form.

        What changes at instants only stands in front of its states, and is left out.
        """
        return x

    def step(self, G: MatrixLieGroup, command: Array, x: Array, period: float) -> Array:
        """Its states after a control instant, of an actuator that is `sampled`."""
        return x

    def solution(self, G: MatrixLieGroup, command: Array) -> Array:
        """What it finds for commands ``(runs, m)`` at an instant, ``(runs, n)``, by any code."""
        return command

    def thrust(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """What each of its thrusters gives, ``(..., k)``."""
        return command[..., :0]

    def at_limit(self, G: MatrixLieGroup, command: Array, x: Array) -> Array | None:
        """Where a command is beyond its limit, ``(...)``; None where it has none.

        Of most limits, that is where the output falls short of the command by more than rounding.
        """
        if not self.limits:
            return None
        short = np.abs(command - self.output(G, command, x)) > 1e-12 * (1 + np.abs(command))
        return np.array(short.any(axis=-1))

    def torque_range(self, G: MatrixLieGroup) -> tuple[Array, Array] | None:
        """The least and the largest torque along each axis, ``(m,)``, of what flies.

        None where it has no limit along an axis by itself.
        """
        return None

    def most(self, G: MatrixLieGroup, times: Array, torque: Array) -> tuple[Array, Array] | None:
        """How much of what is `limited` a torque takes, and what there is, ``(n, k)`` each.

        Each row is at one of the last n times; None where a torque does not tell.
        """
        return None

    def remarks(self, G: MatrixLieGroup) -> Iterator[str]:
        """What a user should know of it before it is run, and no error is."""
        yield from ()


class PassThrough(Actuator):
    """No actuator: the command as it is."""

    def output(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """The command."""
        return command


def against(values: Array, low: Any, high: Any) -> tuple[Array, Array]:
    """The sizes of values, and the limits on their side of 0."""
    below = values < 0
    return where(below, 0.0 - values, values), where(below, 0.0 - low, high)
