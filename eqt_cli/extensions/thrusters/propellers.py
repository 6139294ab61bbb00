"""Propellers that turn both ways."""

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Self

import numpy as np

from eqt_cli.base.arrays import Array, Arrays, absolute, clip, less, maximum, sqrt, where
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import Scale, Unit
from eqt_cli.base.stored import THRUSTER, Signal, signal
from eqt_cli.components.actuators import Actuator, of_each
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.vehicle_parts import Numbers
from eqt_cli.extensions.thrusters.thrusters import SPEEDS, THRUST, Thrusters
from eqt_cli.numbers.leaves import with_fields

CURVE = ("thrust_constant", "astern", "dead_speed", "neutral")
"""Options of the static curve, with a number for each propeller."""

SPEED = signal("propeller_speed", "rad/s", "n", dims=(THRUSTER,), words="speed of each propeller")

NEUTRAL = 0.01
"""Default of `neutral`, relative to the largest thrust."""


@dataclass(frozen=True)
class Propellers(Thrusters):
    """The torque B f of propellers that turn both ways, with speeds n that lag: T ṅ = n_c − n.

    The static curve gives the thrust of each

        f(n) = k (n² − n_0²) for n > n_0,  −a k (n² − n_0²) for n < −n_0,  else 0,

    as Bessa, Dutra and Kreuzer (ABCM Symposium Series in Mechatronics 2, 2006) have it, and the
    simulators uuv_simulator and stonefish. B⁺ of the command gives thrusts; the speeds n_c are the
    inverse of the curve at these. As it jumps from −n_0 to n_0 at no thrust, n_c |n_c| has instead
    a line there, for thrusts up to `neutral`.

    Attributes
    ----------
    thrust_constant
        k, N s²/rad².
    time_constant
        T of the speeds, s.
    low_speed, high_speed
        Smallest and largest speed, rad/s; astern is below 0. Or `low`, `high`.
    astern
        a, the thrust astern relative to that ahead at the same speed.
    dead_speed
        n_0, the largest speed without thrust, rad/s. Default: no dead band.
    neutral
        Thrust from which the allocation is the exact inverse, N. Default: 1 % of the largest.
    """

    name: ClassVar[str] = "propellers"
    departs: ClassVar[str] = "propellers"
    positive: ClassVar[tuple[str, ...]] = (*Thrusters.positive, *CURVE[1:])
    one_way: ClassVar[bool] = False

    astern: Annotated[Numbers, Scale("thrust of propellers astern")] = 1.0
    dead_speed: Annotated[Numbers | None, Scale("dead band of propellers", "rad/s")] = None
    neutral: Annotated[Numbers | None, Unit("N")] = None

    @property
    def linear_part(self) -> Actuator:
        """Thrusters whose thrusts lag: of propellers that turn beyond the dead band."""
        if self.thrust_constant is None:
            return self
        return with_fields(super().linear_part, thrust_constant=None)

    @property
    def shows(self) -> tuple[Signal, ...]:
        """Thrusts and speeds."""
        return THRUST, SPEED

    def signals(self, G: MatrixLieGroup, V: Array, command: Array, x: Array) -> Arrays:
        """Return f and n."""
        return {**super().signals(G, V, command, x), "propeller_speed": x[..., -self.count :]}

    def with_allocation(self, G: MatrixLieGroup) -> Self:
        """Return propellers with the limits of their thrusts."""
        options = of_each(self, ("low", "high", *SPEEDS, *CURVE), self.count)
        part = with_fields(self, **options)
        if part.low_speed is not None:
            ends = {"low": part.pushed(part.low_speed), "high": part.pushed(part.high_speed)}
            part = with_fields(part, **ends, **dict.fromkeys(SPEEDS))
        neutral = NEUTRAL * np.array(part.high) if part.neutral is None else part.neutral
        return super(Propellers, with_fields(part, neutral=neutral)).with_allocation(G)

    def pushed(self, speed: Any) -> Array:
        """Return the thrusts at some speeds."""
        k: Any = self.thrust_constant
        square = speed * speed
        if self.dead_speed is not None:
            square = maximum(square - self.dead_speed * self.dead_speed, 0.0)
        return where(less(speed, 0.0), -self.astern * k * square, k * square)

    def followed(self, thrusts: Array) -> Array:
        """Return the speeds that the allocation asks for, or the thrusts of the linear part."""
        if self.thrust_constant is None:
            return thrusts
        k: Any = self.thrust_constant
        size, back = absolute(thrusts), less(thrusts, 0.0)
        square = size / where(back, self.astern * k, k + 0.0 * thrusts)
        if self.dead_speed is not None:
            band = self.dead_speed * self.dead_speed
            square = square + band * clip(size / self.neutral, 0.0, 1.0)
        speed = sqrt(sqrt(square * square))  # native steps past an end of a choice, see `Thrusters`
        return where(back, -speed, speed)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note invalid places and numbers, and limits that do not push both ways."""
        for name, example in (("thrust_constant", "4.5e-4"), ("time_constant", "0.1 s")):
            if getattr(self, name) is None:
                problems.at(name).add(f"missing; propellers need it, for example {example}")
        super().check(G, problems)
        part: Any = self if problems else self.of_run(G, None)
        if not problems and not np.all((part.low < 0.0) & (part.high > 0.0)):
            got = f"{np.max(part.low) + 0.0:g} to {np.min(part.high):g} N"
            problems.add(f"expected limits beyond the dead band, to both sides; got {got}")
