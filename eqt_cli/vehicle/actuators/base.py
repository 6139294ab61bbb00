"""The base class of actuators; it knows no law, plant or engine."""

from abc import abstractmethod
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

import numpy as np

from eqt_cli.core.arrays import Array, where
from eqt_cli.core.leaves import STRUCTURE
from eqt_cli.core.option_types import Offset, Positive, Scale
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.component import VehiclePart


@dataclass(frozen=True)
class Actuator(VehiclePart):
    """One of the actuators through which a command passes in order.

    Its output depends on its input command, and on its own states if any.

    Attributes
    ----------
    period
        Time between two instants at which it takes its input, s, a whole number of ticks of
        `control`. If left out, it acts at every tick.
    offset
        Time of the first of them, s, a whole number of ticks.
    """

    period: Annotated[Positive | None, Scale("period of the actuator", "s")] = field(
        default=None, kw_only=True, metadata=STRUCTURE
    )
    offset: Offset | None = field(default=None, kw_only=True, metadata=STRUCTURE)

    limited: ClassVar[str] = ""
    """Prefix of its limit in messages: ``a rate of``; empty for a limit of torques."""

    # Most actuators give these by a class variable.

    @property
    def limits(self) -> bool:
        """Whether the actuator can be at a limit."""
        return False

    @property
    def moves(self) -> bool:
        """Whether the actuator has states that change between instants, by `state_rate`."""
        return False

    @property
    def runs(self) -> bool:
        """Whether its states at the start of a run follow from the first command, and are not 0."""
        return False

    @property
    def sampled(self) -> bool:
        """Whether the actuator acts at control instants only, on a held command.

        An actuator that also `moves` takes the command in `step` at an instant.
        """
        return False

    @property
    def solves(self) -> bool:
        """Whether `step` takes the result of `solution`, which no engine compiles."""
        return False

    @property
    def acting_at_instants(self) -> str:
        """The name in messages of what acts at control instants."""
        return self.name

    @property
    def thruster_names(self) -> tuple[str, ...]:
        """Names of the thrusters, if any."""
        return ()

    @property
    def wheel_names(self) -> tuple[str, ...]:
        """Names of the wheels, if any."""
        return ()

    @property
    def linear_part(self) -> "Actuator":
        """The actuator without limits, steps and dead zones; `PassThrough` if nothing is left."""
        return self

    def states(self, G: MatrixLieGroup) -> int:
        """Return the number of states."""
        return 0

    @abstractmethod
    def output(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return the output for a command and the states x, ``(..., m)``."""

    def started(self, G: MatrixLieGroup) -> Array | None:
        """Return the states at t = 0; None where all are 0, or where it `runs`."""
        return None

    def reaction(self, G: MatrixLieGroup, V: Array, x: Array) -> tuple[Array, Array] | None:
        """Return a force on the body that depends on its velocity, and the rates that go with it.

        They add to output and `state_rate`; None without such a force.
        """
        return None

    def running(self, G: MatrixLieGroup, command: Array) -> Array:
        """Return the states at the start of a run with this first command, if it `runs`."""
        return 0.0 * command[..., :1]

    def state_rate(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return the time derivative of the states."""
        return x

    def step(self, G: MatrixLieGroup, command: Array, x: Array, period: float) -> Array:
        """Return the states after a control instant, for an actuator that is `sampled`."""
        return x

    def solution(self, G: MatrixLieGroup, command: Array) -> Array:
        """Return the solution ``(runs, n)`` for commands ``(runs, m)`` at an instant."""
        return command

    def thrust(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return the thrust of each thruster, ``(..., k)``."""
        return command[..., :0]

    def at_limit(self, G: MatrixLieGroup, command: Array, x: Array) -> Array | None:
        """Return where a command is beyond the limit, ``(...)``; None without a limit.

        For most limits, that is where output and command differ by more than rounding.
        """
        if not self.limits:
            return None
        short = np.abs(command - self.output(G, command, x)) > 1e-12 * (1 + np.abs(command))
        return np.array(short.any(axis=-1))

    @property
    def allocation_matrix(self) -> tuple[Array, Array | None, Array | None] | None:
        """B⁺, ``(k, m)``, and the limits behind it; None for any other allocation, or none."""
        return None

    def torque_range(self, G: MatrixLieGroup) -> tuple[Array, Array] | None:
        """Return the least and the largest torque along each axis, ``(m,)``, in a run.

        None if it does not limit axes one by one.
        """
        return None

    def most(self, G: MatrixLieGroup, times: Array, torque: Array) -> tuple[Array, Array] | None:
        """Return how much of the `limited` quantity a torque needs, and its limit, ``(n, k)`` each.

        Each row is at one of the last n times; None where this does not follow from a torque.
        """
        return None

    def remarks(self, G: MatrixLieGroup, wanted: Array) -> Iterator[str]:
        """Yield remarks for the user before a run, none of which is an error.

        `wanted` are the directions in which a law asks for a torque, ``(k, m)``.
        """
        yield from ()


def of_each(part: Actuator, names: Iterable[str], count: int) -> dict[str, Any]:
    """Return the options that are given, of these names, with a number for each of k members."""
    given = {name: getattr(part, name) for name in names}
    return {name: np.full(count, x, dtype=float) for name, x in given.items() if x is not None}


class PassThrough(Actuator):
    """An actuator that passes the command unchanged."""

    def output(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return the command."""
        return command


def against(values: Array, low: Any, high: Any) -> tuple[Array, Array]:
    """Return the magnitudes of values, and of the limits on their side of 0."""
    below = values < 0
    return where(below, 0.0 - values, values), where(below, 0.0 - low, high)
