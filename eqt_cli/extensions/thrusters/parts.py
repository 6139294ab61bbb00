"""What thrusters are described by: each one, its jets, failures and noise, and an order."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from eqt_cli.base.arrays import Array, exp, less, norm, where
from eqt_cli.base.option_types import Positive, Real, Scale, Unit
from eqt_cli.base.registry import Keys
from eqt_cli.components.matrix_groups import EuclideanGroup
from eqt_cli.components.vehicle_parts import Number


@dataclass(frozen=True)
class Thruster(Keys):
    """One thruster of SE2 or SE3, in the body frame.

    Attributes
    ----------
    at
        Point at which the thrust acts, m.
    along
        The direction of its thrust; the length does not matter.
    turns
        The torque about `along` for each N of thrust, from the drag of its propeller, m; SE3 only.
        With a `moment_constant` k_m, this torque is turns · k_m · speed²: 1, or −1 for a rotor that
        spins counter-clockwise seen from where it pushes to.
    name
        What figures call it; `thruster 1`, … if left out.
    """

    at: Annotated[list[Number], Unit("m")]
    along: list[Number]
    turns: Annotated[Real, Unit("m")] = 0.0
    name: str = ""

    def wrench(self, G: EuclideanGroup, ratio: float = 1.0) -> Array:
        """Return torque and force of a unit thrust, ``(m,)``: ⟨f, V⟩ is the power at the point.

        `ratio` is that of `turns`.
        """
        along = np.array(self.along, dtype=float)
        along = along / norm(along)
        point = np.append(np.array(self.at, dtype=float), 1.0)
        wrench = np.einsum("a,iab,b->i", along, G.basis[:, : G.space], point)
        if G.space == G.rotations:
            wrench[: G.rotations] += ratio * self.turns * along
        return wrench


@dataclass(frozen=True)
class Failure(Keys):
    """The failure of one thruster.

    Attributes
    ----------
    rotor
        Number, from 1, or name of the thruster.
    at
        When, s.
    to
        The share of its commanded thrust that is left.
    """

    rotor: int | str
    at: Annotated[Number, Scale("time of the failure", "s")]
    to: Annotated[Real, Scale("thrust left to the rotor", "1")] = 0.0


@dataclass(frozen=True)
class Noise(Keys):
    """Noise of motors: of the speed of a rotor, or the thrust of another thruster.

    That of each thruster is a sum of sines with the spectrum 2σ²T/(1 + ω²T²), as of a `gust`.

    Attributes
    ----------
    std
        σ, rad/s of rotors, else N.
    time_constant
        T, s, after which the correlation is about 1/e; 0.31 with these sines.
    """

    std: Annotated[Number, Unit("rad/s")]
    time_constant: Annotated[Number, Scale("time constant of the noise", "s")]


@dataclass(frozen=True)
class Waves(Keys):
    """The noise of a run: frequencies ω ``(sines,)``, a cos φ and a sin φ ``(sines, k)``."""

    frequency: Any
    sine: Any
    cosine: Any


@dataclass(frozen=True)
class Priority(Keys):
    """Directions of a command by their priority, for `allocation: {kind: priority, order: …}`.

    Attributes
    ----------
    order
        Groups of directions, the most important first: a name such as torque z, or a list. The
        word force is all forces along which the thrusters push, torque all torques.
    """

    kind: Literal["priority"]
    order: list[str | Annotated[list[str], Field(min_length=1)]]


@dataclass(frozen=True)
class Jets(Keys):
    """Thrusters that are on, at `high`, or off; each by its share r of `high` that is asked.

    Their valves switch at the instants of the thrusters' `period`, where engines end a step, so
    that a pulse has the impulse of its width. With `every`, a jet is on for r · every from the
    beginning of each such time, or off where that is below the minimum (pulse width, rounded to
    whole instants). Else pulse-width pulse-frequency modulation (Wie, Space Vehicle Dynamics and
    Control; Sidi, Spacecraft Dynamics and Control, chapter 9): a filter T ẋ = K (r − s) − x with
    the state s of the jet, 1 or 0, and a Schmitt trigger, s = 1 once x > `on`, and 0 once x <
    `off`.

    Attributes
    ----------
    minimum
        The shortest time for which a jet is on, s, rounded to whole instants: its impulse bit over
        its thrust.
    every
        Time from the start of one pulse to the start of the next, s; without the keys below.
    gain
        K.
    time_constant
        T, s.
    on, off
        Levels of the trigger.
    """

    minimum: Annotated[Positive, Scale("shortest pulse of the jets", "s")]
    every: Annotated[Positive | None, Scale("period of the pulses", "s")] = None
    gain: Annotated[Positive, Scale("gain of the pulse modulator")] = 4.5
    time_constant: Annotated[Positive, Scale("time constant of the pulse modulator", "s")] = 0.15
    on: Annotated[Positive, Scale("level that opens the jets")] = 0.45
    off: Annotated[Positive, Scale("level that closes the jets")] = 0.15

    def after(self, share: Array, x: Array, period: float) -> Array:
        """Return s, the time that is left of a pulse or its period, and the level, for a period."""
        was, left, level = np.split(x, 3, axis=-1)
        if self.every is not None:
            begins = less(left, 0.5 * period)
            width = where(less(share * self.every, self.minimum), 0.0, share * self.every)
            level, left = where(begins, width, level), where(begins, self.every, left)
            on = where(less(0.5 * period, level), 1.0, 0.0)
            return np.concatenate([on, left - period, level - period], axis=-1)
        free = where(less(self.on, level), 1.0, where(less(level, self.off), 0.0, was))
        on = where(less(0.5 * period, left), 1.0, free)
        left = where(less(was, on - 0.5), self.minimum, left)
        fall = exp(-period / self.time_constant)
        level = fall * level + (1.0 - fall) * self.gain * (share - on)
        return np.concatenate([on, left - period, level], axis=-1)
