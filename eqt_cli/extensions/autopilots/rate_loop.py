"""The rate loop of an autopilot, whose command is an angular velocity."""

from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from eqt_cli.base.arrays import Array, absolute, apply_matrix, cross, less, maximum, where
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import Scale
from eqt_cli.components.actuators import Actuator
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.matrix_groups import check_turns_in_space
from eqt_cli.components.vehicle_parts import Number, Numbers, check_numbers, lowest
from eqt_cli.numbers.leaves import STRUCTURE

LARGE = np.pi / 180 * 400
"""Error at which PX4's rate loop no longer integrates, rad/s."""


@dataclass(frozen=True)
class RateLoop(Actuator):
    """The rate loop of an autopilot: it makes a torque of the command ω_c, and passes a force f.

    τ = 𝕁 b (ω_c − ω) + ω × 𝕁ω with a bandwidth b and the inertia 𝕁 of laws, or K (ω_c − ω), from
    the true ω at all times; SO3 and SE3. Put limits and thrusters after it.

    With a `cutoff`, it is PX4's PID in continuous time (src/lib/rate_control/rate_control.cpp,
    commit 0155b3a8) on its filters (src/modules/sensors/vehicle_angular_velocity): Butterworth of
    second order for the gyro, and first order for the derivative of what this gives,

        τ = K e + z − k_d α + k_ff ω_c,  e = ω_c − ω̂,  ż = max(0, 1 − (e/400°s⁻¹)²) k_i e,
        ω̂'' = w² (ω − ω̂) − √2 w ω̂',  w = 2π f,  α̇ = 2π f_d (ω̂' − α),

    along each axis; |z| has a limit. At t = 0, ω̂ = ω, and all else is 0. Without a `cutoff`, ω̂ is
    ω, and α follows from ω̇. With `derivative: error`, α is that of ω − ω_c, so that a step of the
    command kicks, as in the PID of textbooks. It hears nothing of rotors at their limits. Gains of
    PX4's parameters give its normalised torque; a `scale` after the loop makes N m of it.

    Attributes
    ----------
    bandwidth
        b about each axis, rad/s: ω follows ω_c with a lag of 1/b.
    gains
        Instead: K, N m s (per rad), for a 𝕁 that the laws do not know exactly.
    cutoff
        f of the gyro filter, Hz; PX4's `IMU_GYRO_CUTOFF`. Needs `gains`. Default: no filter.
    ki
        k_i of the integral z, N m (per rad).
    kd
        k_d, N m s² (per rad).
    feedforward
        k_ff, N m s (per rad).
    i_limit
        Largest |z|, N m. Default: no limit.
    d_cutoff
        f_d of the filter of the D term, Hz; PX4's `IMU_DGYRO_CUTOFF`.
    derivative
        What the D term differentiates: the measured `rate`, or the `error`.
    """

    name: ClassVar[str] = "rate_loop"
    departs: ClassVar[str] = "rate loop"
    positive: ClassVar[tuple[str, ...]] = ("bandwidth", "gains", "cutoff", "i_limit", "d_cutoff")
    changes: ClassVar[bool] = True
    takes: ClassVar[str] = "rates"

    bandwidth: Annotated[Numbers | None, Scale("bandwidth of the rate loop", "rad/s")] = None
    gains: Annotated[Numbers | None, Scale("gains of the rate loop", "N m s")] = None
    cutoff: Annotated[Number | None, Scale("cutoff of the gyro", "Hz")] = None
    ki: Annotated[Numbers, Scale("integral gains of the rate loop", "N m")] = 0.0
    kd: Annotated[Numbers, Scale("D gains of the rate loop", "N m s^2")] = 0.0
    feedforward: Annotated[Numbers, Scale("feedforward of the rate loop", "N m s")] = 0.0
    i_limit: Annotated[Numbers | None, Scale("limit of the integral", "N m")] = None
    d_cutoff: Annotated[Number, Scale("cutoff of the D term", "Hz")] = 20.0
    derivative: Literal["rate", "error"] = field(default="rate", metadata=STRUCTURE)
    has_terms: bool = field(default=False, init=False, repr=False, metadata=STRUCTURE)

    def __post_init__(self) -> None:
        terms = self.ki, self.kd, self.feedforward
        has_any = self.cutoff is not None or any(not isinstance(x, float) or x != 0 for x in terms)
        object.__setattr__(self, "has_terms", has_any)

    @property
    def moves(self) -> bool:
        """Whether it has a filter or an integral."""
        return self.has_terms

    @property
    def _omega(self) -> Any:
        return self.moving[0].V[..., :3] if self.moving else 0.0

    def states(self, G: MatrixLieGroup) -> int:
        """Return the number of states: ω̂, its derivative, α and z, each 3; or what α follows, z."""
        return 0 if not self.moves else 6 if self.cutoff is None else 12

    def started(self, G: MatrixLieGroup, V: Array) -> Array | None:
        """Return the filter at the angular velocity, and all else 0."""
        omega = V[..., :3]
        rest = [0.0 * omega] * (self.states(G) // 3 - 1)
        return np.concatenate([omega, *rest], axis=-1) if self.moves else None

    def state_rate(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return the rates of filters and integral."""
        w_d, z = 2 * np.pi * self.d_cutoff, x[..., -3:]
        measured = self._omega if self.cutoff is None else x[..., :3]
        e = command[..., :3] - measured
        rate = maximum(1.0 - (e / LARGE) ** 2, 0.0) * self.ki * e
        if self.i_limit is not None:
            outward = where(less(0.0, rate * z), 0.0 * rate, rate)
            rate = where(less(absolute(z), self.i_limit + 0.0 * z), rate, outward)
        if self.cutoff is None:
            return np.concatenate([self._slope(command, x), rate], axis=-1)
        w: Any = 2 * np.pi * self.cutoff
        slope, alpha = x[..., 3:6], x[..., 6:9]
        slopes = w**2 * (self._omega - measured) - np.sqrt(2) * w * slope
        return np.concatenate([slope, slopes, w_d * (slope - alpha), rate], axis=-1)

    def _slope(self, command: Array, x: Array) -> Any:
        """Return α."""
        if self.cutoff is not None:
            return x[..., 6:9]
        of = self._omega - (command[..., :3] if self.derivative == "error" else 0.0)
        return 2 * np.pi * self.d_cutoff * (of - x[..., :3])

    def output(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return τ and f; without a state, of a body at rest."""
        omega, torque_command = self._omega, command[..., :3]
        torque: Any = torque_command - (omega if self.cutoff is None else x[..., :3])
        if self.bandwidth is None:
            torque = self.gains * torque
        else:
            J = self.moving[0].inertia.matrix[..., :3, :3]
            torque = apply_matrix(J, self.bandwidth * torque) + cross(omega, apply_matrix(J, omega))
        if self.moves:
            torque = torque + x[..., -3:] - self.kd * self._slope(command, x)
            torque = torque + self.feedforward * torque_command
        return np.concatenate([torque, command[..., 3:]], axis=-1)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note groups without one attitude in space, and numbers that are missing or too many."""
        check_turns_in_space(self.name, G, problems)
        if (self.bandwidth is None) == (self.gains is None):
            problems.add("expected either bandwidth or gains; for example bandwidth: 40")
        elif self.cutoff is not None and self.gains is None:
            problems.at("cutoff").add("needs gains in place of bandwidth; for example gains: 0.15")
        if self.derivative == "error" and self.cutoff is not None:
            problems.at("derivative").add("applies without cutoff only; remove one of them")
        if self.i_limit is not None and isinstance(self.ki, float) and self.ki == 0:
            problems.at("i_limit").add("applies to the integral only; add ki")
        terms = ("ki", "kd", "feedforward", "i_limit")
        for name in (*self.positive, *terms[:3]):
            value, here = getattr(self, name), problems.at(name)
            check_numbers([] if value is None else value, here, name in self.positive)
            if isinstance(value, list) and len(value) != 3:
                here.add(f"expected a number, or 3 of them, got {len(value)}")
            elif name in terms and value not in (None, 0.0) and self.gains is None:
                here.add("needs gains in place of bandwidth; for example gains: 0.15")
            entries = value if isinstance(value, list) else [value or 0.0]
            if name in terms and not here and (least := min(map(lowest, entries))) < 0:
                here.add(f"expected a number of at least 0, got {least:g}")
