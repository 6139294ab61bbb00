"""PID loops inside one another: position, velocity, Euler angles, rates; as in the Crazyflie."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import AfterValidator

from eqt_cli.base.arrays import Array, Arrays, absolute, apply, clip, cos, less, sin, sqrt, where
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import Positive, Real, Scale, Unit
from eqt_cli.base.registry import Keys
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.laws import CountsInstants, EachAxis, check_each_axis
from eqt_cli.components.matrix_groups import rigid, rigid_motions
from eqt_cli.components.mechanics import Tracking
from eqt_cli.components.motions import PlantModel, check_rigid_body
from eqt_cli.components.vehicle_parts import check_period
from eqt_cli.numbers.leaves import with_fields

_Gain = Annotated[
    Real | list[Real],
    Scale("gain"),
    AfterValidator(lambda k: np.array(k, dtype=float) if isinstance(k, list) else k),
]
LEFT, ASKED = "left", "asked"
"""States: the time until the outer loops are computed again, s; roll, pitch and push as they ask
for them."""


@dataclass(frozen=True)
class OuterGains(Keys):
    """Gains and limits of one of the outer loops, along the heading, across it, and upwards.

    Attributes
    ----------
    kp, ki
        k_p and k_i: one, or three.
    i_limit
        Largest integral of the error, likewise.
    limit
        Largest output, likewise.
    """

    kp: _Gain
    ki: _Gain = 0.0
    i_limit: Annotated[EachAxis | None, Scale("limit of the integral")] = None
    limit: Annotated[EachAxis | None, Scale("limit of the output")] = None

    def check(self, problems: Problems) -> None:
        """Note gains that are negative or not for each axis."""
        for name in ("kp", "ki", "kd", "i_limit", "limit"):
            value: Any = getattr(self, name, None)
            check_each_axis(value, 3, problems.at(name))
            if value is not None and (least := float(np.min(value))) < 0:
                problems.at(name).add(f"expected at least 0, got {least:g}")

    def step(self, e: Array, integral: Array, period: Any, slope: Any = 0.0) -> tuple[Any, Any]:
        """Return the output for an error, and the integral, which counts this error already."""
        ki: Any = self.ki
        integral = where(less(0.0, ki + 0.0 * e), integral + period * e, 0.0 * e)
        if self.i_limit is not None:
            integral = clip(integral, 0.0 * e - self.i_limit, self.i_limit + 0.0 * e)
        u: Any = self.kp * e + ki * integral + slope
        return u if self.limit is None else clip(u, 0.0 * e - self.limit, self.limit + 0.0 * e), (
            integral
        )


@dataclass(frozen=True)
class InnerGains(OuterGains):
    """Gains and limits of one of the inner loops, about the three axes of the body.

    Attributes
    ----------
    kd
        k_d, on the difference of the measured angle or rate.
    """

    kd: _Gain = 0.0


@dataclass(frozen=True)
class PidCascade(CountsInstants):
    """PID loops inside one another, at instants, as the Crazyflie flies by default; SE3, FLU.

    In the frame that is turned by the yaw ψ alone,

    v_c = PI(p_d − p),  (θ_c, −φ_c, a_z) = PI(v_c − v),  push = T₀ + m a_z within its limits

    along the third axis of the body, whatever the tilt is. The setpoint is a position and a
    heading: its velocity is not read. At every control instant, on roll, pitch and yaw,

    ω_c = PID(φ_c − φ, θ_c − θ, ψ_d − ψ),  τ = PID(ω_c − ω),

    with differences of measurements for D, and integrals that count the error of the same instant.
    Each integral and each output has its limit.

    The Crazyflie's controller_pid.c, position_controller_pid.c, attitude_pid_controller.c and pid.c
    (crazyflie-firmware, commits 1346ecde to 47f59998), in SI units. Left out: integers, and the
    filters of D. It is not defined at a pitch of 90 deg. Nothing is claimed.

    Attributes
    ----------
    position
        From m to m/s: `kp` in 1/s, `ki` in 1/s²; `limit` is a speed.
    velocity
        From m/s to the pitch and roll, rad, and to a_z, m/s²: three numbers each; the first two of
        `limit` are those of the tilt.
    attitude
        From rad to rad/s.
    rate
        From rad/s to N m.
    period
        Of the two outer loops, s: a whole number of control periods. Default: the control period.
    hover
        T₀, N. Default: the weight in `model.forces`.
    least, most
        Limits of the push, N.
    """

    name: ClassVar[str] = "pid_cascade"
    title: ClassVar[str] = "PID cascade"
    tasks: ClassVar[tuple[str, ...]] = ()
    theorem: ClassVar[str] = ""
    reads_flat_output: ClassVar[bool] = True
    reads_gains: ClassVar[bool] = False

    position: OuterGains
    velocity: OuterGains
    attitude: InnerGains
    rate: InnerGains
    period: Annotated[Positive | None, Scale("period of the outer loops", "s")] = None
    hover: Annotated[Positive | None, Unit("N")] = None
    least: Annotated[Real | None, Unit("N")] = None
    most: Annotated[Positive | None, Unit("N")] = None
    tick: Any = field(default=0.0, init=False, repr=False)  # the control period

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note groups other than SE3, and numbers that are not for each axis."""
        if not rigid_motions(G) or G.space != 3:
            problems.add(f"pid_cascade is a law for SE3, got {G.name}")
            return
        for name in ("position", "velocity", "attitude", "rate"):
            getattr(self, name).check(problems.at(name))
        if self.most is not None and (self.least or 0.0) >= self.most:
            problems.at("least").add(f"expected less than most, {self.most:g} N")

    def for_plant(self, G: MatrixLieGroup, plant: PlantModel, problems: Problems) -> "PidCascade":
        """Return the law with its periods and the push that hovers; note what does not fit."""
        if plant.flat is None:
            problems.add("needs a reference with a position and a heading: flat or setpoints")
        elif plant.flat.heading is None:
            problems.add("needs a heading; give the reference one in place of free")
        if plant.period is None:
            problems.add("answers at control instants; set control.period, at which it is called")
        elif self.period is not None:
            check_period(self.period, plant.period, problems.at("period"))
        check_rigid_body(G, plant.inertia, problems)
        weights = [force.weight_alone for force in plant.forces if hasattr(force, "weight_alone")]
        if self.hover is None and not weights:
            problems.at("hover").add("missing; give it in N, or the weight in model.forces")
        if problems:
            return self
        hover, still = self.hover, np.zeros(6)
        if hover is None:
            hover = -float(sum(force.in_body(G, 0.0, np.eye(4), still)[5] for force in weights))
        if hover <= 0:
            problems.at("hover").add("the weight points up; write the model with z upwards (FLU)")
        return with_fields(self, hover=hover, period=self.period or plant.period, tick=plant.period)

    def directions(self, G: MatrixLieGroup) -> Array:
        """Return the axes of all torques, and that of the push."""
        return np.eye(6)[[0, 1, 2, 5]]

    def cycle(self, period: float) -> Sequence[Mapping[str, float]]:
        """Return no time that is left at the first instant, and some at the others."""
        return [{LEFT: 0.0}] + [{LEFT: period}] * (round((self.period or period) / period) - 1)

    def memory(self, G: MatrixLieGroup) -> Mapping[str, int]:
        """Return the lengths of the integrals, of what was measured last, and of what is held."""
        names = ("position", "velocity", "attitude", "rate", "angles", "rates", ASKED)
        return {**dict.fromkeys(names, 3), LEFT: 1}

    def initial_memory(self, s: Tracking) -> Arrays:
        """Return the measurements, so that their first differences are 0."""
        return {"angles": self._angles(s), "rates": s.V[..., :3]}

    def memory_rate(self, s: Tracking) -> Arrays:
        """Return 0: the states change at instants."""
        return {name: 0.0 * z for name, z in s.memory.items()}

    def torque(self, s: Tracking) -> Array:
        """Return torque and push of an instant."""
        return self.answer(s, self.tick)[0]

    def answer(self, s: Tracking, period: Any) -> tuple[Array, Arrays]:
        """Return torque and push, and the memory a period later."""
        assert s.flat is not None
        memory, angles, w = s.memory, self._angles(s), s.V[..., :3]
        is_due = less(memory[LEFT], period / 2)
        outputs, outer = self._outer_loops(s)
        later = {name: where(is_due, z, memory[name]) for name, z in outer.items()}
        outputs = later[ASKED] = where(is_due, outputs, memory[ASKED])
        slow: Any = self.period
        later[LEFT] = where(is_due, slow + 0.0 * memory[LEFT], memory[LEFT]) - period
        psi = s.flat.heading[..., :1]  # type: ignore[index]
        apart = np.concatenate([outputs[..., :2] - angles[..., :2], psi - angles[..., 2:]], axis=-1)
        turned = _wrapped(angles - memory["angles"])
        slope: Any = self.attitude.kd * -turned / period
        wanted, later["attitude"] = self.attitude.step(
            _wrapped(apart), memory["attitude"], period, slope
        )
        slope = self.rate.kd * (memory["rates"] - w) / period
        torque, later["rate"] = self.rate.step(wanted - w, memory["rate"], period, slope)
        later |= {"angles": angles + 0.0 * w, "rates": w + 0.0 * angles}
        still = 0.0 * outputs[..., :2]
        return np.concatenate([torque, still, outputs[..., 2:]], axis=-1), later

    def _outer_loops(self, s: Tracking) -> tuple[Array, Arrays]:
        """Return roll, pitch and push of the outer loops, and their integrals."""
        assert s.flat is not None
        G, m = rigid(s.G), s.inertia.matrix[..., 3, 3, None]
        R, p = G.rotation(s.Q), G.translations(s.Q)[..., 0]
        v = (R @ s.V[..., 3:, None])[..., 0]
        ahead = R[..., :2, 0] / sqrt(R[..., 0, 0] ** 2 + R[..., 1, 0] ** 2)[..., None]

        def turned(x: Any) -> Array:
            c, s, x, y, z = ahead[..., :1], ahead[..., 1:], x[..., :1], x[..., 1:2], x[..., 2:]
            return np.concatenate([c * x + s * y, c * y - s * x, z + 0.0 * c], axis=-1)

        error = turned(s.flat.position[..., 0, :] - p)
        wanted, far = self.position.step(error, s.memory["position"], self.period)
        u, fast = self.velocity.step(wanted - turned(v), s.memory["velocity"], self.period)
        push = self.hover + m * u[..., 2:]
        push = push if self.least is None else where(less(push, self.least), self.least, push)
        push = push if self.most is None else where(less(self.most, push), self.most, push)
        outputs = np.concatenate([-u[..., 1:2], u[..., :1], push], axis=-1)
        return outputs, {"position": far, "velocity": fast}

    def _angles(self, s: Tracking) -> Array:
        """Return roll, pitch and yaw."""
        R = rigid(s.G).rotation(s.Q)
        roll, yaw = _angle(R[..., 2:, 1], R[..., 2:, 2]), _angle(R[..., 1:2, 0], R[..., :1, 0])
        return np.concatenate([roll, -apply("asin", clip(R[..., 2:, 0], -1.0, 1.0)), yaw], axis=-1)


def _angle(y: Any, x: Any) -> Any:
    """Return the angle of (x, y) from the x axis."""
    half = apply("atan", y / (sqrt(x * x + y * y) + absolute(x)))
    behind = where(less(y, 0.0 * y), -np.pi - 2.0 * half, np.pi - 2.0 * half)
    return where(less(x, 0.0 * x), behind, 2.0 * half)


def _wrapped(angles: Array) -> Array:
    """Return angles from −π to π."""
    return _angle(sin(angles), cos(angles))
