"""Control laws of other papers, each after its source."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any, ClassVar, Self

import numpy as np

from eqt_cli.base.arrays import Array, Arrays, absolute, dot, exp, log, stack, tanh
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import POSE, STIFFNESS, TORQUE, VELOCITY, Positive, Real, Unit
from eqt_cli.components.actuators import EXCESS, AntiWindup, excess, unwound
from eqt_cli.components.groups import HasHalfTurns, MatrixLieGroup, log_force
from eqt_cli.components.laws import (
    BODY_ENERGY,
    Controller,
    EachAxisOrZero,
    ReadsLimits,
    check_each_axis,
    published,
)
from eqt_cli.components.mechanics import Gains, Tracking, hessian_at_identity
from eqt_cli.components.motions import PlantModel
from eqt_cli.numbers.leaves import with_fields

# Base class of laws that shape an energy of the body error and cancel all other forces ------------


@dataclass(frozen=True)
class CancellingLaw(Controller):
    """τ = 𝕀ξ̇ + 𝕀̇ξ − ad*_V 𝕀V − K_d e − force, and + Ṡ*S⁻* 𝕀e where the inertia varies.

    Here ξ = Ad_{Q_L⁻¹}V_d, e = V − ξ and Q_L = Q_d⁻¹Q. It leaves d(𝕀e)/dt = −K_d e − force, and
    where the force is the gradient of an energy U, L = ½⟨𝕀e, e⟩ + U falls at the rate ⟨K_d e, e⟩.
    """

    matched: ClassVar[bool | None] = True
    claims_decrease: ClassVar[bool | None] = True

    def torque(self, s: Tracking) -> Array:
        """τ, body frame."""
        r = s.relative
        return r.cancelling_feedforward - r.body_damping - self.force(r)

    def lyapunov(self, s: Tracking) -> Array:
        """½⟨𝕀e, e⟩ + U."""
        return s.relative.kinetic_error + self.potential(s.relative)

    def velocity_error(self, s: Tracking) -> Array:
        """The error e."""
        return s.relative.V_tilde

    def dissipation(self, s: Tracking) -> Array | None:
        """⟨K_d e, e⟩."""
        return dot(s.relative.body_damping, s.relative.V_tilde)

    @abstractmethod
    def force(self, r: Tracking) -> Array:
        """Return the force of the pose error, body frame; `r` has the errors of the body frame."""

    @abstractmethod
    def potential(self, r: Tracking) -> Array:
        """Return the energy U of the pose error."""


# Feedback alone: what the laws with a feedforward are compared with -----------------------------


@dataclass(frozen=True)
class Pd(Controller):
    """Proportional-derivative control without feedforward, after Koditschek (1989), on every group.

    τ = −K_d e − L*_{Q_L}dΥ(Q_L) with e = V − Ad_{Q_L⁻¹}V_d and Q_L = Q_d⁻¹Q: the potential Υ of the
    pose error and damping, here of any reference. It reads no inertia. At rest, V_d = 0, the total
    energy L = ½⟨𝕀e, e⟩ + Υ(Q_L) falls at the rate ⟨K_d e, e⟩ if the inertia is constant; a moving
    reference leaves an error, and nothing is claimed. Contemporary Mathematics 97, 131-157, of
    which only the abstract was read.
    """

    name: ClassVar[str] = "pd"
    title: ClassVar[str] = "PD"
    energy: ClassVar[str] = BODY_ENERGY
    theorem: ClassVar[str] = ""
    bibtex: ClassVar[str] = published("koditschek1989application")
    matched: ClassVar[bool | None] = True
    weight = "body"

    def torque(self, s: Tracking) -> Array:
        """τ, body frame."""
        return -s.relative.body_damping - s.relative.gradient

    def feedforward_torque(self, s: Tracking) -> Array:
        """Return 0."""
        return 0 * s.V

    def lyapunov(self, s: Tracking) -> Array:
        """½⟨𝕀e, e⟩ + Υ(Q_L)."""
        return s.relative.lyapunov

    def velocity_error(self, s: Tracking) -> Array:
        """The error e."""
        return s.relative.V_tilde

    def dissipation(self, s: Tracking) -> Array | None:
        """⟨K_d e, e⟩, and the power of the feedforward that it lacks."""
        r = s.relative
        return dot(r.body_damping + r.cancelling_feedforward, r.V_tilde)


# Proportional action on the logarithm of the body error; the feedforward cancels the rest ---------


@dataclass(frozen=True)
class Logarithmic(CancellingLaw):
    """Logarithmic PD after Johnson and Beard (2021), on every group.

    force = J_r⁻ᵀ(x) H x with x = log(Q_d⁻¹Q), J_r the right Jacobian and H the Hessian of Υ at I,
    which gives it the stiffness of the other laws for small errors; the energy is ½⟨H x, x⟩. The
    paper, arXiv 2109.07025, was not read; the form is that of the design of eqt.

    The torque does not vanish towards an error angle of π and changes its sign there, where both
    opposite rotations are equally short. The energy is continuous there, so that L keeps falling:
    always for rotations, and with translations if H weighs these equally in every direction.
    """

    name: ClassVar[str] = "logarithmic"
    energy: ClassVar[str] = "½⟨𝕀e, e⟩ + ½⟨H log Q_L, log Q_L⟩"
    theorem: ClassVar[str] = "after Johnson, Beard (2021)"
    bibtex: ClassVar[str] = published("johnson2021globally")

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note a group without the derivative of its logarithm."""
        with problems.catching():
            log_force(G, np.zeros(G.dimension), np.zeros(G.dimension))

    def force(self, r: Tracking) -> Array:
        """J_r⁻ᵀ(x) H x."""
        x = r.G.log(r.Q)
        return log_force(r.G, x, r.linear_gradient(x))

    def potential(self, r: Tracking) -> Array:
        """½⟨H x, x⟩."""
        x = r.G.log(r.Q)
        return dot(r.linear_gradient(x), x) / 2


# Proportional action on the quaternion of the body error, for rotations of space ------------------


@dataclass(frozen=True)
class Quaternion(CancellingLaw):
    """Quaternion feedback after Wie, Weiss and Arapostathis (1989), on SO(3).

    force = 2 H q with q = sin(θ/2) u the vector part of the unit quaternion of Q_d⁻¹Q whose scalar
    part is q₀ ≥ 0, and H the Hessian of Υ at I: the paper's D is K_d, its K is 2H. The paper has a
    reference at rest and cancels ω × Jω; the feedforward here does so for a moving one. J.
    Guidance, Control, and Dynamics 12, 375-380, which was not read.

    With H = h I, L = ½⟨𝕀e, e⟩ + 4h(1 − q₀) falls. With another H the force has no potential, and
    nothing is claimed. The choice q₀ ≥ 0 takes the shorter rotation, without unwinding; the
    torque is largest at an error angle of π, where it changes its sign.
    """

    name: ClassVar[str] = "quaternion"
    energy: ClassVar[str] = "½⟨𝕀e, e⟩ + 4h(1 − q₀)"
    theorem: ClassVar[str] = "after Wie, Weiss, Arapostathis (1989)"
    bibtex: ClassVar[str] = published("wie1989quaternion")

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note groups other than the rotations of space."""
        if not (G.compact and G.dimension == G.size == 3):
            problems.add(f"{self.name} is a law for SO3 only; this experiment has group {G.name}")

    def claims(self, G: MatrixLieGroup, gains: Gains) -> bool | None:
        """Return the claim, which needs the same stiffness about every axis."""
        H = hessian_at_identity(G, gains.K)
        homogeneous = np.abs(H - H[0, 0] * np.eye(len(H))).max() <= 1e-12 * np.abs(H).max()
        return self.claims_decrease if homogeneous else None

    def force(self, r: Tracking) -> Array:
        """2 H q."""
        _, twice_q = self._half_turn(r)
        return r.linear_gradient(twice_q)

    def potential(self, r: Tracking) -> Array:
        """4h(1 − q₀) with h the mean stiffness."""
        scalar, _ = self._half_turn(r)
        return (4 * (1 - stack([scalar])) * self._mean(r))[..., 0]

    def dissipation(self, s: Tracking) -> Array | None:
        """⟨K_d e, e⟩, plus the power of stiffness that differs between axes."""
        r = s.relative
        _, twice_q = self._half_turn(r)
        uneven = r.linear_gradient(twice_q) - self._mean(r) * twice_q
        return dot(r.body_damping + uneven, r.V_tilde)

    def _half_turn(self, r: Tracking) -> tuple[Array, Array]:
        """q₀ and 2q."""
        assert isinstance(r.G, HasHalfTurns)
        return r.G.half_turn(r.Q)

    def _mean(self, r: Tracking) -> Array:
        """h, ``(..., 1)``."""
        H = r.stiffness
        return (H[..., 0, :1] + H[..., 1, 1:2] + H[..., 2, 2:]) / 3


# Base class of laws that drive the variable s = V − V_r to zero, with their own V_r ---------------


@dataclass(frozen=True)
class SlidingVariable(Controller):
    """τ = 𝕀V̇_r + 𝕀̇V_r − ad*_{V_r} 𝕀V + Ṡ*S⁻* 𝕀s − reaching(s), s = V − V_r.

    V_r = ξ − Λ L*dΥ(Q_L) with Q_L = Q_d⁻¹Q, ξ = Ad_{Q_L⁻¹}V_d and Λ = slope · I, from g* to g. Then
    d½⟨𝕀s, s⟩/dt = −⟨reaching(s), s⟩, and where s is 0 the potential Υ(Q_L) falls at the rate
    ⟨L*dΥ, Λ L*dΥ⟩. For small errors all modes are real: no choice of gains gives the stiffness and
    damping of the other laws.

    Attributes
    ----------
    slope
        Λ, the commanded velocity per unit of force of Υ: rad/s per N m.
    """

    energy: ClassVar[str] = "½⟨𝕀s, s⟩"
    matched: ClassVar[bool | None] = False
    claims_decrease: ClassVar[bool | None] = True
    weight = "body"

    slope: Positive = 0.5

    def torque(self, s: Tracking) -> Array:
        """τ, body frame."""
        r = self._sliding(s)
        return r.Pd_dot - s.G.ad_star(r.Vd, r.P) + r.inertia_force - self.reaching(r)

    def lyapunov(self, s: Tracking) -> Array:
        """½⟨𝕀s, s⟩."""
        return self._sliding(s).kinetic_error

    def velocity_error(self, s: Tracking) -> Array:
        """The variable s."""
        return self._sliding(s).V_tilde

    def dissipation(self, s: Tracking) -> Array | None:
        """⟨reaching(s), s⟩."""
        r = self._sliding(s)
        return dot(self.reaching(r), r.V_tilde)

    @abstractmethod
    def reaching(self, r: Tracking) -> Array:
        """Return the force against s, which is `r.V_tilde`."""

    def _sliding(self, s: Tracking) -> Tracking:
        """Return the motion with V_r as the velocity of its reference."""
        r = s.relative
        Vr = r.Vd - self.slope * r.gradient
        return r.following(Vr, r.Vd_dot - self.slope * r.gradient_rate)


@dataclass(frozen=True)
class Sliding(SlidingVariable):
    """Sliding mode with a smooth boundary layer; uses its own gains (not matched).

    reaching = gain · tanh(s / layer), coordinate by coordinate: after Slotine and Li (1991), sec.
    7.2, with tanh in place of their saturation: the same slope at 0 and bounds, without corners.
    The book was not read. `gains.kd` is not used.

    Attributes
    ----------
    gain
        Largest force against s, N m (translations: N).
    layer
        Thickness of the boundary layer, rad/s (translations: m/s).
    """

    name: ClassVar[str] = "sliding"
    title: ClassVar[str] = "sliding mode"
    theorem: ClassVar[str] = "after Slotine, Li (1991), section 7.2"
    bibtex: ClassVar[str] = published("slotine1991applied")

    gain: Annotated[Positive, Unit(TORQUE)] = 0.5
    layer: Annotated[Positive, Unit(VELOCITY)] = 0.5

    def reaching(self, r: Tracking) -> Array:
        """gain · tanh(s / layer)."""
        return self.gain * tanh(r.V_tilde / self.layer)


@dataclass(frozen=True)
class SlotineLi(SlidingVariable):
    """After Slotine and Li (1987), with known inertia; uses its own slope (gains not matched).

    reaching = K_d s. Int. J. Robotics Research 6 (3), 49-59, written for manipulators; the form on
    groups is that of the design of eqt, and the paper was not read.
    """

    name: ClassVar[str] = "slotine_li"
    title: ClassVar[str] = "Slotine–Li"
    theorem: ClassVar[str] = "after Slotine, Li (1987)"
    bibtex: ClassVar[str] = published("slotine1987adaptive")

    def reaching(self, r: Tracking) -> Array:
        """K_d s."""
        return r.body_damping


# State feedback after Maithripala, Berg and Dayawansa (2006), damped by the kinetic energy --------


@dataclass(frozen=True)
class Maithripala2006(Controller):
    """After Maithripala, Berg and Dayawansa (2006); uses its own damping (gains not matched).

    τ = 𝕀(V̇_d + ∇_V V_d) − Ad*_{Q_d} L*dΥ(Q_E) − k_d 𝕀Ṽ: the damping is proportional to the
    momentum error, ∇ the Levi-Civita connection of 𝕀. IEEE Trans. Automatic Control 51 (2),
    216-225, of which only the abstract was read; the form is that of the design of eqt.

    Damping by k_d 𝕀 is not that by K_d: the stiffness is matched, the damping is not. `gains.kd` is
    not used.

    Attributes
    ----------
    damping_rate
        k_d, 1/s.
    """

    name: ClassVar[str] = "maithripala2006"
    title: ClassVar[str] = "Maithripala 2006"
    theorem: ClassVar[str] = "after Maithripala, Berg, Dayawansa (2006)"
    bibtex: ClassVar[str] = published("maithripala2006almost")
    matched: ClassVar[bool | None] = False
    claims_decrease: ClassVar[bool | None] = True
    weight = "spatial"

    damping_rate: Annotated[Positive, Unit("1/s")] = 0.5

    def torque(self, s: Tracking) -> Array:
        """τ, body frame."""
        damping = self.damping_rate * s.P_tilde
        return s.feedforward(0.5, 0.5, 0.5) - damping - s.G.Ad_star(s.Qd, s.gradient)

    def dissipation(self, s: Tracking) -> Array | None:
        """k_d⟨𝕀Ṽ, Ṽ⟩."""
        return dot(self.damping_rate * s.P_tilde, s.V_tilde)


# The attitude law of Goodarzi, Lee and Lee (2013) with integral action, on any group --------------


@dataclass(frozen=True)
class Goodarzi2013(ReadsLimits):
    """Geometric PID after Goodarzi, Lee and Lee (2013), on every group; stiffer, so not matched.

    τ = τ_ξ + 𝕀 ad_e ξ − L*dΥ(Q_L) − K_d e − k_I b tanh(e_I / b), ė_I = e + c₂ e_R, e_I(0) = 0.
    On SO(3): −k_R e_R − k_Ω e_Ω − k_I e_I + (RᵀR_dΩ_d) × J(RᵀR_dΩ_d) + JRᵀR_dΩ̇_d with
    K = (k_R/2) I and K_d = k_Ω I. There e_R = ½(R_dᵀR − RᵀR_d)^∨; on every group it is the
    projection of Q_L onto the algebra. Geometric nonlinear PID control of a quadrotor UAV on SE(3),
    European Control Conference 2013, of which only the abstract was read. The smooth bound b is an
    addition of eqt; without it, the integral is not bounded.

    The integral of e is the small error itself, so that k_I adds to the stiffness H of Υ: it is
    2.2 and not 2.0 N m/rad on SO(3) with K = I and k_I = 0.2. So gains are not matched.

    Without disturbances, L = ½⟨𝕀e, e⟩ + Υ(Q_L) + c₂⟨𝕀e, e_R⟩ + k_I Σ b² log cosh(e_I/b) falls near
    the reference if c₂ is small enough. The paper's bound on c₂ was not available, and none is
    computed, so nothing is claimed for any c₂.

    Attributes
    ----------
    ki
        k_I, N m/rad: a number, or one for each axis; 0 leaves the integral out. Default: a tenth of
        the least stiffness H of Υ, 0.2 on SO(3) with K = I.
    c2
        c₂, 1/s. Default: offsets decay at k_I c₂/(k_I + H) = ¼ min(H/K_d, K_d/𝕀), along the axis
        where this is least; a quarter of what loses stability or less.
    bound
        b, bound of the integral in the torque, rad. Default: none.
    anti_windup
        At actuator limits that the law knows: `clamp` stops the integral along each axis where it
        would grow further beyond the limit, `{back_calculation: 1 s}` reduces it with this time
        constant, `none` does nothing.
    """

    name: ClassVar[str] = "goodarzi2013"
    title: ClassVar[str] = "Goodarzi 2013"
    energy: ClassVar[str] = "½⟨𝕀e, e⟩ + Υ(Q_L) + c₂⟨𝕀e, e_R⟩ + ½k_I|e_I|²"
    matched: ClassVar[bool | None] = False
    theorem: ClassVar[str] = "after Goodarzi, Lee, Lee (2013)"
    bibtex: ClassVar[str] = published("goodarzi2013geometric")

    ki: Annotated[EachAxisOrZero, Unit(STIFFNESS)] = 0.2
    c2: Annotated[Real, Unit("1/s")] = 0.5
    bound: Annotated[Positive | None, Unit(POSE)] = None
    anti_windup: AntiWindup = field(default="none", kw_only=True)
    acting: Any = field(default=(), init=False, repr=False)

    def defaults(self, G: MatrixLieGroup, gains: Gains) -> Mapping[str, float]:
        """k_I = 0.1 min H: a fixed one would be too strong for a light body. c₂ follows later."""
        least = float(np.linalg.eigvalsh(hessian_at_identity(G, gains.K)).min())
        return {"ki": 0.1 * least, "c2": 0.5}  # c2 until the inertia is known

    def for_plant(self, G: MatrixLieGroup, plant: PlantModel, problems: Problems) -> Self:
        """Return the law with c₂, where it is not written, and the limits that it reads."""
        law = super().for_plant(G, plant, problems)
        if (gains := (plant.follows or {}).get("c2")) is None or not np.all(law.ki):
            return law
        J, D = map(np.diagonal, (plant.inertia.at(0.0).matrix, gains.K_d))
        H = np.diagonal(hessian_at_identity(G, gains.K))
        rate = float(np.minimum(H / D, D / J).min()) / 4
        return with_fields(law, c2=rate * (1 + float(np.min(H.min() / law.ki))))

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note gains of the integral that are not for each axis."""
        super().check(G, problems)
        check_each_axis(self.ki, G.dimension, problems.at("ki"))
        if np.min(self.ki) < 0 or (np.min(self.ki) == 0 and self.anti_windup != "none"):
            problems.at("ki").add(
                f"expected 0 or more, and more than 0 with an anti-windup, got {self.ki}"
            )

    output_units: ClassVar[Mapping[str, str]] = {"integral": "rad"}

    def memory(self, G: MatrixLieGroup) -> Mapping[str, int]:
        """Return the length of the integral e_I."""
        return {"integral": G.dimension}

    def memory_rate(self, s: Tracking) -> Arrays:
        """ė_I = e + c₂ e_R, and what an anti-windup makes of it."""
        rate = self.velocity_error(s)
        if self.anti_windup == "none":
            return {"integral": rate}
        x = s.once(EXCESS, lambda s: excess(s.G, self.acting, s.command(self.torque(s))))
        return {"integral": unwound(self.anti_windup, rate, x, self.ki)}

    def torque(self, s: Tracking) -> Array:
        """τ, body frame."""
        r = s.relative
        shaping = r.gradient + self.ki * self._bounded(s)
        return r.feedforward(0.0, 0.0, 1.0) - r.body_damping - shaping

    def lyapunov(self, s: Tracking) -> Array:
        """Return the paper's function without disturbances."""
        r = s.relative
        return r.lyapunov + dot(self.c2 * r.P_tilde, self._e_R(r)) + self._stored(s)

    def velocity_error(self, s: Tracking) -> Array:
        """e + c₂ e_R."""
        r = s.relative
        return r.V_tilde + self.c2 * self._e_R(r)

    def dissipation(self, s: Tracking) -> Array | None:
        """−dL/dt: ⟨K_d e, e⟩ and the rate of the mixed term c₂⟨𝕀e, e_R⟩."""
        r = s.relative
        G, e, P = r.G, r.V_tilde, r.P_tilde
        # d(𝕀e)/dt = Ṗ − d(𝕀ξ)/dt.
        force = G.ad_star(r.V, r.P) + self.torque(s) - G.ad_star(r.Vd, r.Pd) - r.tau_d
        # Without that of the integral.
        moved = dot(self.c2 * (force + self.ki * self._bounded(s)), self._e_R(r))
        mixed = dot(r.body_damping, e) - moved - dot(self.c2 * P, G.vee(r.Q @ G.hat(e)))
        if s.inertia.leaves:  # with this, ½⟨𝕀̇y, y⟩ is the rate of L
            mixed = mixed + dot(self.c2**2 / 2 * s.inertia.leaving(self._e_R(r)), self._e_R(r))
        if self.anti_windup == "none":
            return mixed
        changed = self.memory_rate(s)["integral"] - self.velocity_error(s)
        return mixed - dot(self.ki * self._bounded(s), changed)

    def memory_gradient(self, s: Tracking) -> Arrays:
        """∂L/∂e_I, k_I times the bounded integral."""
        return {"integral": self.ki * self._bounded(s)}

    def _e_R(self, r: Tracking) -> Array:
        return r.G.vee(r.Q)

    def _bounded(self, s: Tracking) -> Array:
        """Return the integral, bounded smoothly by b."""
        integral = s.memory["integral"]
        return integral if self.bound is None else self.bound * tanh(integral / self.bound)

    def _stored(self, s: Tracking) -> Array:
        """Return the energy of the integral, whose gradient is k_I `_bounded`."""
        integral = s.memory["integral"]
        if self.bound is None:
            return dot(self.ki * integral, integral) / 2
        size = absolute(integral / self.bound)
        stored = size + log(1 + exp(-2 * size)) - log(2.0)  # log cosh without overflow
        return (self.ki * self.bound**2 * stored).sum(axis=-1)


class _Compensation(Controller):
    feedforward: bool

    @cached_property
    def compensation(self) -> float:
        """The feedforward as a number, so that one compiled law serves both."""
        return 1.0 if self.feedforward else 0.0


@dataclass(frozen=True)
class Stabilising(_Compensation):
    """Energy shaping at a target pose with inertia feedforward, Theorem 3.2 of the paper.

    τ = Ṡ*S⁻* P − K_d V − L*_Q d(Υ(Q Q_target⁻¹)), Hampsey et al. (2025), eq. (11). The desired
    state is the target at rest, so that V_d = 0 and τ_d = 0.

    Attributes
    ----------
    feedforward
        Whether to add Ṡ*S⁻* P, which compensates the change of the inertia.
    """

    name: ClassVar[str] = "stabilising"
    tasks: ClassVar[tuple[str, ...]] = ("stabilise",)
    matched: ClassVar[bool | None] = True
    weight = "spatial"

    feedforward: bool = True
    compensation: float = field(init=False, repr=False)

    @property
    def claims_decrease(self) -> bool | None:  # type: ignore[override]  # by its options
        """True with the feedforward; without it, a changing inertia may raise L."""
        return self.feedforward

    def torque(self, s: Tracking) -> Array:
        """τ, body frame."""
        return self.compensation * s.inertia_force - s.body_damping - s.G.Ad_star(s.Qd, s.gradient)

    def dissipation(self, s: Tracking) -> Array | None:
        """⟨K_d V, V⟩, and without feedforward also the power of the changing inertia."""
        return dot(s.body_damping + (1 - self.compensation) * s.inertia_force, s.V_tilde)
