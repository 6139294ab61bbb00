"""Laws of quadrotors after publications: attitude laws for a cascade, and two cascades.

Which paper or code each was read from is in its docstring. The commit of the public comparison is
1d067d5 of https://github.com/fdcl-gwu/decoupled-yaw-controller-comparison.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from eqt_cli.components.classic_laws import Goodarzi2013
from eqt_cli.components.laws import EachAxis
from eqt_cli.extend import (
    Array,
    Cascade,
    Controller,
    Jet,
    MatrixLieGroup,
    Positive,
    Problems,
    Real,
    Tracking,
    absolute,
    apply_matrix,
    clip,
    cross,
    dot,
    less,
    maximum,
    minimum,
    norm,
    sqrt,
    stack,
    transpose,
    where,
)

E1, E3 = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class OfAttitude(Controller):
    """A law of SO(3) with gains of its own, of which nothing is claimed."""

    theorem: ClassVar[str] = ""
    reads_gains: ClassVar[bool] = False

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note other groups."""
        if G.name != "SO3":
            problems.add(f"{self.name} is a law of SO3, got {G.name}")


def _to_body(s: Tracking) -> Array:
    """RᵀR_d."""
    return transpose(s.Q) @ s.Qd


@dataclass(frozen=True)
class DecoupledYaw(OfAttitude):
    """Geometric adaptive control with decoupled yaw: b₃ on the sphere, b₁ by an angle.

    Read from the public code (`attitude_control.m`) of "Geometric Adaptive Controls of a Quadrotor
    UAV with Decoupled Attitude Dynamics", which takes J₁ = J₂; the paper was not read. The estimate
    of the unknown torque is its memory.

    Attributes
    ----------
    kR, kW
        Gains of b₃, N m and N m s.
    ky, kwy
        Gains of the yaw.
    gamma, c2, c3
        Of the estimate θ̂, whose rate is γ (e_ω + c₂ e_b) of b₃ and γ (e_ωy + c₃ e_y) of the yaw.
    """

    name: ClassVar[str] = "decoupled_yaw"
    title: ClassVar[str] = "decoupled yaw"

    kR: Positive = 6.0
    kW: Positive = 2.0
    ky: Positive = 2.0
    kwy: Positive = 0.8
    gamma: Real = 0.0
    c2: Real = 0.0
    c3: Real = 0.0

    def memory(self, G: MatrixLieGroup) -> Mapping[str, int]:
        """The estimate of the torque."""
        return {"estimate": 3}

    def memory_rate(self, s: Tracking) -> Mapping[str, Array]:
        """Return its rate."""
        tilt, rate = self._errors(s)
        weight = np.array([1.0, 1.0, 0.0])
        return {"estimate": self.gamma * (rate + (self.c2 * weight + self.c3 * E3) * tilt)}

    def _errors(self, s: Tracking) -> tuple[Array, Array]:
        """(e_b, e_y) and (e_ω, e_ωy), body frame."""
        E, wx = _to_body(s), s.Vd[..., 0]
        b3 = E[..., 2]
        error = stack([b3[..., 1], -b3[..., 0], -E[..., 1, 0]])
        across = apply_matrix(E, stack([wx, s.Vd[..., 1], 0.0 * wx]))
        about = apply_matrix(E, s.Vd)[..., 2]
        return error, s.V - stack([across[..., 0], across[..., 1], about])

    def torque(self, s: Tracking) -> Array:
        """Return feedback, feedforward, and the estimate."""
        E, J = _to_body(s), s.inertia.matrix
        wx, wy, wz = (s.Vd[..., k] for k in range(3))
        ax, ay = s.Vd_dot[..., 0], s.Vd_dot[..., 1]
        Wx, Wy, Wz = (s.V[..., k] for k in range(3))
        J1, J3 = J[..., 0, 0], J[..., 2, 2]
        error, rate = self._errors(s)
        along = apply_matrix(E, stack([wx, wy, 0.0 * wx]))[..., 2]  # b₃·ω_d
        d = apply_matrix(E, stack([ax - wz * wy, ay + wz * wx, 0.0 * wx]))
        desired = apply_matrix(E, s.Vd)
        yaw = apply_matrix(E, s.Vd_dot)[..., 2] + Wy * desired[..., 0] - Wx * desired[..., 1]
        ahead = stack(
            [
                J1 * (d[..., 0] - along * Wy) + J3 * Wz * Wy,
                J1 * (d[..., 1] + along * Wx) - J3 * Wz * Wx,
                J3 * yaw,
            ]
        )
        tilt = np.array([1.0, 1.0, 0.0])
        feedback = (self.kR * tilt + self.ky * E3) * error + (self.kW * tilt + self.kwy * E3) * rate
        return ahead - feedback - s.memory["estimate"]


@dataclass(frozen=True)
class TiltPrioritised(OfAttitude):
    """Tilt-prioritised quaternion law of Brescianini and D'Andrea (2018).

    Read from the public comparison (`attitude_control_brescianini.m`); of the paper, IEEE
    Transactions on Control Systems Technology, doi 10.1109/TCST.2018.2873224, only the title.

    Attributes
    ----------
    kp_xy, kp_z, kd_xy, kd_z
        Gains of tilt and yaw, N m and N m s.
    backward
        Carry the desired rates by R_dᵀR for RᵀR_d, as the public comparison does.
    """

    name: ClassVar[str] = "tilt_prioritised"
    title: ClassVar[str] = "tilt-prioritised"

    kp_xy: Positive = 24.0
    kp_z: Positive = 0.7
    kd_xy: Positive = 0.8
    kd_z: Positive = 0.3
    backward: bool = False

    def torque(self, s: Tracking) -> Array:
        """τ = kp_xy q̃_red + kp_z sgn(q₀) q̃_yaw + K_d ω̃ + feedforward."""
        E, J = _to_body(s), s.inertia.matrix
        carried = transpose(E) if self.backward else E
        desired = apply_matrix(carried, s.Vd)
        rate = desired - s.V
        ahead = apply_matrix(J, apply_matrix(carried, s.Vd_dot) - cross(s.V, desired))
        gyroscopic = cross(s.V, apply_matrix(J, s.V))
        square = (1.0 + E[..., 2, 2]) / 2.0  # q₀² + q₃²
        tilt, zero = 0.5 / sqrt(square), 0.0 * square
        turn = (E[..., 0, 0] + E[..., 1, 1]) / (2.0 * square)  # cos ψ
        half = sqrt(maximum((1.0 + turn) / 2.0, 1e-30))  # |cos ψ/2|
        sine = (E[..., 1, 0] - E[..., 0, 1]) / (4.0 * square * half)  # sgn(q₀) sin ψ/2
        red = stack([-tilt * E[..., 1, 2], tilt * E[..., 0, 2], zero])
        yaw = stack([zero, zero, sine])
        xy = np.array([1.0, 1.0, 0.0])
        damping = (self.kd_xy * xy + self.kd_z * E3) * rate
        return self.kp_xy * red + self.kp_z * yaw + damping + ahead + gyroscopic


@dataclass(frozen=True)
class SphereAndCircle(OfAttitude):
    """Attitude control on S² × S¹ after Kooijman, Schoellig and Antunes (2019).

    Read from the public comparison (`position_control_kooijman.m`); the paper is ECC 2019, doi
    10.23919/ECC.2019.8795755. A kinematic law gives Ω̄: along the shortest arc to b̄₃, and about b₃
    to the heading that this arc carries along. Its derivative is exact here, with Ω̇ of the tilt
    taken for that of Ω̄.

    Attributes
    ----------
    k1, k2
        Of the arc and of the heading, 1/s.
    kW, kwy
        Gains of the rates, N m s.
    """

    name: ClassVar[str] = "sphere_and_circle"
    title: ClassVar[str] = "S² × S¹"

    k1: Positive = 6.0
    k2: Positive = 2.0
    kW: Positive = 8.0
    kwy: Positive = 1.0

    def torque(self, s: Tracking) -> Array:
        """τ = −K (Ω − Ω̄) + Ω × JΩ + JΩ̄̇."""
        E, J, W = _to_body(s), s.inertia.matrix, s.V
        arc = self._along_arc(s, E)
        zero = 0.0 * W[..., 0]
        turning = stack([-arc.derivative(1)[..., 1], arc.derivative(1)[..., 0], zero])
        about = self._about(s, E, turning)
        desired = stack([-arc.value[..., 1], arc.value[..., 0], about.value])
        rate = stack([turning[..., 0], turning[..., 1], about.derivative(1)])
        gains = self.kW * np.array([1.0, 1.0, 0.0]) + self.kwy * E3
        return cross(W, apply_matrix(J, W)) + apply_matrix(J, rate) - gains * (W - desired)

    def _along_arc(self, s: Tracking, E: Array) -> Any:
        """The rate of b₃ in body coordinates, as a series of order 1."""
        turn = cross(s.Vd, E3 + 0.0 * s.Vd)
        moved = apply_matrix(E, turn)  # the rate of b̄₃
        second = apply_matrix(E, cross(s.Vd, turn) + cross(s.Vd_dot, E3 + 0.0 * s.Vd))
        b: Any = Jet.of([E[..., 2], moved - cross(s.V, E[..., 2])])
        ahead: Any = Jet.of([moved, second - cross(s.V, moved)])
        cosine = b[..., 2]
        below = less(cosine, 0.0)
        sine = sqrt(where(below, 1.0 - cosine * cosine, 1.0 + 0.0 * cosine))
        carried = ahead - (ahead[..., 2] / (1.0 + cosine))[..., None] * (b + E3)
        return self.k1 * (b / sine[..., None]) + carried

    def _about(self, s: Tracking, E: Array, turning: Array) -> Any:
        """Ω̄₃ as a series of order 1."""

        def course(axis: Array) -> Any:
            """An axis of R_c in body coordinates, to second order."""
            once = cross(s.Vd, axis + 0.0 * s.Vd)
            twice = cross(s.Vd, once) + cross(s.Vd_dot, axis + 0.0 * s.Vd)
            now, moved = apply_matrix(E, axis + 0.0 * s.Vd), apply_matrix(E, once)
            rate = moved - cross(s.V, now)
            second = apply_matrix(E, twice) - cross(s.V, moved + rate) - cross(turning, now)
            return Jet.of([now, rate, second])

        b1, b3 = course(E1), course(E3)
        carried = b1 - (b1[..., 2] / (1.0 + b3[..., 2]))[..., None] * (b3 + E3)
        x, y = carried[..., :1], carried[..., 1:2]
        spin = x.to_order(1) * y.rate - y.to_order(1) * x.rate + s.V[..., 2:]
        behind = where(less(y, 0.0), -1.0 + 0.0 * y, 1.0 + 0.0 * y)
        found: Any = self.k2 * where(less(x, 0.0), behind, y).to_order(1) + spin
        return found[..., 0]


@dataclass(frozen=True)
class WeightedPID(Goodarzi2013):
    """`goodarzi2013` with another k_R about b₃ on e_R, as firmware has it.

    Attributes
    ----------
    yaw
        k_R about b₃, relative to that about b₁ and b₂.
    """

    name: ClassVar[str] = "weighted_pid"
    title: ClassVar[str] = "weighted PID"
    theorem: ClassVar[str] = ""

    yaw: Positive = 1.0

    def torque(self, s: Tracking) -> Array:
        """Return the law with diag(k_R) e_R."""
        r = s.relative
        shaping = np.array([1.0, 1.0, 0.0]) * r.gradient + self.yaw * E3 * r.gradient
        return r.feedforward(0.0, 0.0, 1.0) - r.body_damping - shaping - self.ki * self._bounded(s)

    def dissipation(self, s: Tracking) -> None:
        """Nothing is claimed."""
        return


@dataclass(frozen=True)
class Firmware(OfAttitude):
    """The attitude part that public code has of Lee's law: no Ω̇_d, and what its options say.

    τ = −k_R e_R − k_Ω (Ω − T Ω_d), and Ω × JΩ where the code has it.

    Attributes
    ----------
    kR, kW
        k_R, N m, and k_Ω, N m s: a number, or one for each axis.
    carried
        T: `right` RᵀR_d, `backward` R_dᵀR, `not` I.
    gyroscopic
        Whether Ω × JΩ is there.
    """

    name: ClassVar[str] = "firmware"
    title: ClassVar[str] = "firmware"

    kR: EachAxis = 2.0
    kW: EachAxis = 0.4
    carried: Literal["right", "backward", "not"] = "right"
    gyroscopic: bool = True

    def torque(self, s: Tracking) -> Array:
        """Return feedback, and the gyroscopic torque."""
        E = _to_body(s)
        odd = transpose(E) - E
        error = 0.5 * stack([odd[..., 2, 1], odd[..., 0, 2], odd[..., 1, 0]])
        desired = s.Vd
        if self.carried != "not":
            desired = apply_matrix(E if self.carried == "right" else transpose(E), s.Vd)
        torque = -(self.kR * error) - self.kW * (s.V - desired)
        if self.gyroscopic:
            torque = torque + cross(s.V, apply_matrix(s.inertia.matrix, s.V))
        return torque


@dataclass(frozen=True)
class WholePush(Cascade):
    """A cascade that pushes with all of |F|, and not with its part along the body axis.

    Kooijman's thrust; for Lee's, see `cascade`.
    """

    name: ClassVar[str] = "whole_push"
    title: ClassVar[str] = "whole push"

    def push(self, asked: Any, b: Any) -> Any:
        """|F/m|."""
        return norm(asked)


@dataclass(frozen=True)
class TiltFirst(Cascade):
    """A cascade whose command always fits four rotors in a cross: tilt first, then push, then yaw.

    The saturation that the public comparison uses for Brescianini's law only (`saturate_fM.m`).

    Attributes
    ----------
    arm, ratio
        Distance of a rotor from the centre, and its torque for each N of thrust, m.
    low, high
        Limits of a rotor, N.
    """

    name: ClassVar[str] = "tilt_first"
    title: ClassVar[str] = "tilt first"

    arm: Positive = 0.169
    ratio: Positive = 0.0135
    low: Positive = 0.1
    high: Positive = 8.0

    def wrench(self, s: Tracking, torque: Array) -> Array:
        """Return the command within the limits."""
        axis = np.array(self.direction)
        asked = super().wrench(s, torque)
        most = (self.high - self.low) * self.arm
        x, y = (clip(asked[..., k : k + 1], -most, most) for k in range(2))
        a, b = absolute(x) / self.arm, absolute(y) / self.arm
        push = dot(asked[..., 3:], axis + 0.0 * asked[..., 3:])[..., None]
        push = minimum(maximum(push, 4.0 * self.low + a + b), 4.0 * self.high - a - b)
        over, under = push - 4.0 * self.low, 4.0 * self.high - push
        least = self.ratio * maximum(2.0 * a - over, 2.0 * b - under)
        largest = self.ratio * minimum(under - 2.0 * a, over - 2.0 * b)
        z = minimum(maximum(asked[..., 2:3], least), largest)
        return np.concatenate([x, y, z, push * axis], axis=-1)
