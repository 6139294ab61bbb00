"""Actuators: between the commanded and the acting torque."""

from abc import abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Literal, Protocol, Self, TypeAlias, runtime_checkable

import numpy as np

from eqt_cli.base.arrays import Array, Arrays, absolute, clip, less, norm, outside, where
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import TORQUE, TORQUE_RATE, Offset, Positive, Scale, Unit
from eqt_cli.base.registry import Keys, Registry
from eqt_cli.base.stored import Signal
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.mechanics import Tracking
from eqt_cli.components.vehicle_parts import (
    Numbers,
    VehiclePart,
    check_limits,
    check_numbers,
    drawn,
)
from eqt_cli.numbers.leaves import STRUCTURE, with_fields

# The base class of actuators; it knows no law, plant or engine ------------------------------------


THRUSTS = "thrusts"
"""What a law commands, and thrusters take, where the law allocates by itself."""

Needed: TypeAlias = tuple[Array, Any, Any, str]
"""Values that a torque needs, with their limits, and what these are of: ``a rate of``, or ""."""


@dataclass(frozen=True)
class Actuator(VehiclePart):
    """One of the actuators through which a command passes in order.

    Its output depends on its input command, and on its own states if any.

    Attributes
    ----------
    period
        Time between samples of its input, s, a whole number of ticks of `control`. Default: every
        tick.
    offset
        Time of the first sample, s, a whole number of ticks.
    """

    period: Annotated[Positive | None, Scale("period of the actuator", "s")] = field(
        default=None, kw_only=True, metadata=STRUCTURE
    )
    offset: Offset | None = field(default=None, kw_only=True, metadata=STRUCTURE)

    moving: Any = field(default=None, init=False, repr=False, metadata=STRUCTURE)
    """Of one that `changes`: the motion or what it reads of it, and the momentum of wheels."""

    # Most actuators give these by a class variable.

    @property
    def limits(self) -> bool:
        """Whether the actuator can be at a limit."""
        return False

    @property
    def moves(self) -> bool:
        """Whether the actuator has states that change between instants, by `state_rate`."""
        return False

    takes: ClassVar[str] = "torque"
    """What its command is: a torque, rates, a dipole, or thrusts behind a torque."""

    changes: ClassVar[bool] = False
    """Whether it is another one at each time or state, see `at`."""

    def at(self, s: Tracking, stored: Any = None) -> Self:
        """Return the actuator at a time and a state, with the momentum that wheels store."""
        return with_fields(self, moving=(s, stored)) if self.changes else self

    @property
    def sampled(self) -> bool:
        """Whether the actuator acts at control instants only, on a held command.

        An actuator that also `moves` takes the command in `step` at an instant.
        """
        return False

    @property
    def members(self) -> Mapping[str, tuple[str, ...]]:
        """Names of its members, by the dimension of their signals: ``thruster``, ``wheel``."""
        return {}

    @property
    def shows(self) -> tuple[Signal, ...]:
        """The rows of its `signals`."""
        return ()

    @property
    def ranges(self) -> Mapping[str, tuple[Any, Any]]:
        """Least and largest values by its limits, of signals by name; in a run."""
        return {}

    def signals(self, G: MatrixLieGroup, V: Array, command: Array, x: Array) -> Arrays:
        """Return its signals over time by name; `(..., members)`, or `(...)`."""
        return {}

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

    def started(self, G: MatrixLieGroup, V: Array) -> Array | None:
        """Return the states at t = 0; None where all are 0, or follow from the first command."""
        return None

    def reaction(self, G: MatrixLieGroup, V: Array, x: Array) -> tuple[Array, Array] | None:
        """Return a force on the body that depends on its velocity, and the rates that go with it.

        They add to output and `state_rate`; None without such a force.
        """
        return None

    def state_rate(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return the time derivative of the states."""
        return x

    def step(self, G: MatrixLieGroup, command: Array, x: Array, period: float) -> Array:
        """Return the states after a control instant, for an actuator that is `sampled`."""
        return x

    def within(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return what the limits leave of a command, before any lag."""
        return self.output(G, command, x) if self.limits else command

    def allowed(self, G: MatrixLieGroup, command: Array) -> Array | None:
        """Return what the limits leave of a command; None if that depends on more, or on none."""
        stateless = self.limits and not self.states(G)
        return self.within(G, command, command[..., :0]) if stateless else None

    def at_limit(self, G: MatrixLieGroup, command: Array, x: Array) -> Array | None:
        """Return 1 where a command is beyond the limit, else 0, ``(...)``; None without a limit.

        For most limits, that is where output and command differ by more than rounding.
        """
        if not self.limits:
            return None
        most = 1e-12 * (1 + absolute(command))
        short: Array = outside(command - self.output(G, command, x), -most, most)
        return short

    @property
    def allocation_matrix(self) -> tuple[Array, Array | None, Array | None] | None:
        """B⁺, ``(k, m)``, and the limits behind it; None for any other allocation, or none."""
        return None

    def needed(self, G: MatrixLieGroup, times: Array, torque: Array) -> Needed | None:
        """Return how much of what is limited a torque needs, with the limits, ``(n, k)``.

        Each row is at one of the last n times; None where this does not follow from a torque.
        """
        return None

    def remarks(self, G: MatrixLieGroup, wanted: Array) -> Iterator[str]:
        """Yield remarks for the user before a run, none of which is an error.

        `wanted` are the directions in which a law asks for a torque, ``(k, m)``.
        """
        yield from ()


def nominal(actuator: Actuator) -> Actuator:
    """Return the actuator that does not change over time, which laws know."""
    healthy: Actuator = getattr(actuator, "nominal", actuator)
    return healthy


class Solving(Actuator):
    """An actuator whose `step` may take the result of a `solution`, which no engine compiles."""

    @property
    @abstractmethod
    def solves(self) -> int:
        """The number of values that it solves for; 0 where `step` takes the command."""

    @abstractmethod
    def solution(self, G: MatrixLieGroup, command: Array) -> Array:
        """Return the solution ``(runs, n)`` for commands ``(runs, m)`` at an instant."""


class Running(Actuator):
    """An actuator whose states at the start of a run may follow from the first command."""

    @property
    @abstractmethod
    def runs(self) -> bool:
        """Whether they do, and are not 0."""

    @abstractmethod
    def running(self, G: MatrixLieGroup, command: Array) -> Array:
        """Return these states."""


def any_runs(parts: Iterable[Actuator]) -> bool:
    """Return whether the states of any actuator follow from the first command."""
    return any(isinstance(part, Running) and part.runs for part in parts)


def of_each(part: Actuator, names: Iterable[str], count: int) -> dict[str, Any]:
    """Return the options that are given, of these names, with a number for each of k members."""
    options = {name: getattr(part, name) for name in names}
    return {name: np.full(count, x, dtype=float) for name, x in options.items() if x is not None}


def check_members(
    part: Actuator, count: int, member: str, names: Iterable[str], free: str, problems: Problems
) -> None:
    """Note numbers of these names that are wrong or not one for each member; `free` may be ≤ 0."""
    for name in names:
        here, value = problems.at(name), getattr(part, name)
        if value is not None:
            check_numbers(value, here, name not in free.split())
        if isinstance(value, list) and len(value) != count:
            here.add(f"expected {count} entries, one for each {member}, got {len(value)}")


# What a law with an integral is told of limits ----------------------------------------------------


EXCESS = "excess"
"""What limits take from the command of a law, as it is told them; of a state, computed once."""


TINY = 1e-13
"""Less than any excess but 0. Compared with 0 itself, an excess of 0 would be on either side."""


@dataclass(frozen=True)
class BackCalculation(Keys):
    """An integral is taken back where limits cut the command, `{back_calculation: 1 s}`.

    Attributes
    ----------
    back_calculation
        T, the time constant by which what is cut falls, s.
    """

    back_calculation: Annotated[Positive, Scale("time constant of the anti-windup", "s")]


AntiWindup: TypeAlias = Literal["none", "clamp"] | BackCalculation
"""What an integral does where limits cut the command."""


def limited_parts(G: MatrixLieGroup, plant: Any, problems: Problems) -> tuple[Any, ...]:
    """Return the actuators of a `PlantModel` whose limits an anti-windup reads; note if none."""
    steady = () if any(part.changes for part in plant.actuators) else plant.actuators
    parts = [part for part in steady if part.allowed(G, np.zeros(G.dimension)) is not None]
    if not parts:
        problems.at("anti_windup").add(
            "needs limits that follow from the command alone: of limit, of the torque of wheels, "
            "or of thrusters without allocation: bounded; give some, or remove this key"
        )
    return tuple(parts)


def excess(G: MatrixLieGroup, parts: Iterable[Actuator], command: Array) -> Array:
    """Return what limits take from a command, ``(..., m)``; 0 if it is of the size of rounding."""
    left: Any = command
    for part in parts:
        left = part.allowed(G, left)
    apart = command - left
    return where(less(1e-12 * (1 + absolute(command)), absolute(apart)), apart, 0.0 * apart)


def unwound(kind: AntiWindup, rate: Array, excess: Array, ki: Any) -> Array:
    """Return İ of an integral I in a command −k_i I, of which limits take an excess x.

    `clamp`: 0 where x k_i İ < 0, along each axis, as I would go further beyond the limit;
    `{back_calculation: T}`: İ + x/(k_i T), so that x falls with the time constant T.
    """
    if isinstance(kind, BackCalculation):
        return rate + excess / (ki * kind.back_calculation)
    pulled, rest = ki * rate, 0.0 * rate
    above = where(less(pulled, 0.0), rest, rate)
    below = where(less(0.0, pulled), rest, rate)
    return where(less(TINY, excess), above, where(less(excess, -TINY), below, rate))


class PassThrough(Actuator):
    """An actuator that passes the command unchanged."""

    def output(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return the command."""
        return command


@runtime_checkable
class VariesInTime(Protocol):
    """An actuator with options that vary over the horizon."""

    def check_until(self, end: float, problems: Problems) -> None:
        """Note what it cannot do until `end`, s."""


actuators = Registry("actuator", "actuators", Actuator, ("components.actuators",))


@dataclass(frozen=True)
class Scaled(Actuator):
    """A factor along each axis, as of commands without a unit or of a weak actuator.

    Attributes
    ----------
    factor
        Torque or force per unit of command.
    curve
        Share f of the square in the thrust curve factor · ((1 − f) u + f |u| u), as PX4's
        `THR_MDL_FAC`.
    """

    name: ClassVar[str] = "scale"
    departs: ClassVar[str] = "torque scaled"
    vectors: ClassVar[tuple[str, ...]] = ("factor", "curve")

    factor: Numbers
    curve: Numbers | None = None

    def output(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return the scaled command."""
        u = command
        if self.curve is not None:
            u = u + self.curve * (absolute(u) - 1.0) * u
        scaled: Array = self.factor * u
        return scaled

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note shares of a curve that are not between 0 and 1."""
        super().check(G, problems)
        if problems:  # a distribution without its two numbers has no mean
            return
        shares = drawn(self.curve, None)
        for share in shares if isinstance(shares, list) else [shares]:
            if share is not None and not 0 <= share <= 1:
                problems.at("curve").add(f"expected a share from 0 to 1, got {share:g}")


@dataclass(frozen=True)
class Deadband(Actuator):
    """Commands that are smaller than a width give 0 along their axis; all others pass.

    Attributes
    ----------
    width
        Width along each axis.
    """

    name: ClassVar[str] = "deadband"
    departs: ClassVar[str] = "deadband"
    linear_part: ClassVar[Actuator] = PassThrough()
    vectors: ClassVar[tuple[str, ...]] = ("width",)
    positive: ClassVar[tuple[str, ...]] = ("width",)
    sampled: ClassVar[bool] = True

    width: Annotated[Numbers, Unit(TORQUE)]

    def output(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return the command, or 0 within the width."""
        return where(less(absolute(command), self.width + 0 * command), 0 * command, command)


@dataclass(frozen=True)
class Lag(Actuator):
    """A lag of first order: ẋ = (command − x) / T, from x = 0.

    Attributes
    ----------
    time_constant
        T, s; 0 along an axis: its command passes at once.
    """

    name: ClassVar[str] = "lag"
    departs: ClassVar[str] = "torque lags"
    vectors: ClassVar[tuple[str, ...]] = ("time_constant",)

    moves: ClassVar[bool] = True

    time_constant: Annotated[Numbers, Scale("time constant of the actuators", "s")]
    lags: Any = field(default=None, init=False, repr=False, metadata=STRUCTURE)  # axes, if not all

    @property
    def positive(self) -> tuple[str, ...]:  # type: ignore[override]  # a constant of others
        """The time constant, unless some are 0."""
        return ("time_constant",) if self.lags is None else ()

    def __post_init__(self) -> None:
        if isinstance(self.time_constant, list) and any(x == 0 for x in self.time_constant):
            axes = tuple(k for k, x in enumerate(self.time_constant) if x != 0)
            object.__setattr__(self, "lags", axes or None)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note time constants that are wrong."""
        super().check(G, problems)
        lags: Any = self.time_constant
        for k in self.lags or ():
            check_numbers(lags[k], problems.at("time_constant", k), True)

    def states(self, G: MatrixLieGroup) -> int:
        """Return the number of states, one along each axis that lags."""
        return G.dimension if self.lags is None else len(self.lags)

    def output(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return the state, and the command along axes without a lag."""
        if self.lags is None:
            return x
        y = command + 0.0 * command
        y[..., list(self.lags)] = x
        return y

    def state_rate(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return (command − x) / T."""
        if self.lags is None:
            return (command - x) / self.time_constant
        axes = list(self.lags)
        return (command[..., axes] - x) / self.time_constant[..., axes]


# A hard limit of the torque -----------------------------------------------------------------------


@dataclass(frozen=True)
class Limit(Actuator):
    """No more than a limit, along each axis or in all.

    Attributes
    ----------
    limit
        Largest value along each axis, in both directions.
    norm
        Limit the Euclidean norm instead, relative to the limits of the axes; the direction is kept.
        Only with `limit`.
    low, high
        Instead of `limit`: smallest and largest value along each axis.
    """

    name: ClassVar[str] = "limit"
    departs: ClassVar[str] = "torque limited"
    linear_part: ClassVar[Actuator] = PassThrough()
    vectors: ClassVar[tuple[str, ...]] = ("limit", "low", "high")
    positive: ClassVar[tuple[str, ...]] = ("limit",)
    limits: ClassVar[bool] = True

    limit: Annotated[Numbers | None, Scale("limit of the torque", TORQUE)] = None
    norm: bool = False
    low: Annotated[Numbers | None, Unit(TORQUE)] = None
    high: Annotated[Numbers | None, Unit(TORQUE)] = None

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return the actuator with limits in both directions, or with the limit of the norm."""
        part = super().of_run(G, random)
        if part.norm or part.limit is None:
            return part
        return with_fields(part, limit=None, low=-part.limit, high=part.limit)

    def output(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return the saturated command."""
        if not self.norm:
            return clip(command, self.low, self.high)
        size = norm(command / self.limit)[..., None]
        return where(less(1.0, size), command / size, command)

    def at_limit(self, G: MatrixLieGroup, command: Array, x: Array) -> Array | None:
        """Return 1 where the command is beyond the limits, else 0."""
        if self.norm:
            return outside(norm(command / self.limit)[..., None], 0.0, 1.0)
        return outside(command, self.low, self.high)

    @property
    def ranges(self) -> Mapping[str, tuple[Any, Any]]:
        """The least and largest torque along each axis, ``(m,)``, but not for a norm."""
        return {} if self.norm else {"torque": (self.low, self.high)}

    def needed(self, G: MatrixLieGroup, times: Array, torque: Array) -> Needed | None:
        """Return the torque, or its norm times the largest limit, with the limits."""
        if not self.norm:
            return torque, self.low, self.high, ""
        limit: Any = self.limit
        largest = limit.max()
        return norm(torque / limit)[..., None] * largest, -largest, largest, ""

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note limits given in both ways or in none, and limits with nothing between them."""
        ends: Any = [name for name in ("low", "high") if getattr(self, name) is not None]
        if self.limit is not None and ends:
            problems.add(f"expected limit, or low and high, got limit and {' and '.join(ends)}")
        elif self.limit is None and not ends:
            problems.add("expected limit, or low and high, got neither; add limit: 1.0")
        elif self.norm and ends:
            problems.at("norm").add("needs limit, got low and high; use limit, or remove this key")
        super().check(G, problems)
        if not problems:
            check_limits(self.low, self.high, problems)


SHIFT = 1.5 * 2.0**52
"""A size at which doubles are whole numbers: adding it rounds to the nearest, half to even."""


@dataclass(frozen=True)
class Quantisation(Actuator):
    """The nearest multiple of a step along each axis, for up to 2⁵¹ steps.

    Attributes
    ----------
    resolution
        Step along each axis.
    """

    name: ClassVar[str] = "quantisation"
    departs: ClassVar[str] = "torque in steps"
    linear_part: ClassVar[Actuator] = PassThrough()
    vectors: ClassVar[tuple[str, ...]] = ("resolution",)
    positive: ClassVar[tuple[str, ...]] = ("resolution",)
    sampled: ClassVar[bool] = True

    resolution: Annotated[Numbers, Unit(TORQUE)]
    # Fields, so that a compiler cannot cancel them.
    up: float = field(default=SHIFT, init=False, repr=False)
    down: float = field(default=SHIFT, init=False, repr=False)

    def output(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return the step times the rounded number of steps."""
        rounded: Array = (command / self.resolution + self.up) - self.down
        return self.resolution * rounded


@dataclass(frozen=True)
class RateLimit(Actuator):
    """From one instant at which it acts to the next, a change of at most rate · time, from 0.

    Attributes
    ----------
    rate
        Largest rate along each axis, per second.
    """

    name: ClassVar[str] = "rate_limit"
    departs: ClassVar[str] = "rate of torque limited"
    linear_part: ClassVar[Actuator] = PassThrough()
    vectors: ClassVar[tuple[str, ...]] = ("rate",)
    positive: ClassVar[tuple[str, ...]] = ("rate",)
    limits: ClassVar[bool] = True
    sampled: ClassVar[bool] = True

    rate: Annotated[Numbers, Scale("limit of the torque's rate", TORQUE_RATE)]

    def states(self, G: MatrixLieGroup) -> int:
        """Return the number of states: the torque along each axis."""
        return G.dimension

    def step(self, G: MatrixLieGroup, command: Array, x: Array, period: float) -> Array:
        """Return the torque nearest to the command that it can reach in one period."""
        most = self.rate * period
        return x + clip(command - x, -most, most)

    def output(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return the state."""
        return x

    def needed(self, G: MatrixLieGroup, times: Array, torque: Array) -> Needed | None:
        """Return the rate in the step before each time, with its limits, by axis."""
        rate = np.diff(torque, axis=0) / np.diff(times)[:, None]
        return rate, -self.rate, self.rate, "a rate of "
