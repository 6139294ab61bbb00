"""The laws of other papers in the form of their sources, and the response of all to small errors.

Rates such as ξ̇ are those of the motion itself, so that no formula for them comes from the laws.
"""

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from eqt_cli.analysis.certificates.base import Identity, LiteralForm, Row, Verdict
from eqt_cli.analysis.certificates.stabilisation import RigidBodyForm, is_rotations_of_space, vee
from eqt_cli.analysis.certificates.tracking_laws import bracket, coadjoint, transported
from eqt_cli.analysis.evidence.numbers import floats, rate_of, with_rate
from eqt_cli.analysis.evidence.sample import Sample
from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.controllers import Controller
from eqt_cli.core.arrays import Array, apply_matrix, cross, dot, sqrt, stack, tanh, transpose
from eqt_cli.mechanics.navigation import gradient
from eqt_cli.mechanics.tracking import Tracking


class Body:
    """A motion in the body errors, in the symbols that the laws share."""

    def __init__(self, s: Tracking) -> None:
        self.s, self.G, self.momentum = s, s.G, s.inertia.momentum  # 𝕀V of a velocity
        self.V, self.P = s.V, self.momentum(s.V)
        self.Q_L = s.G.inverse(s.Qd) @ s.Q
        self.xi = transported(s)
        self.e = s.V - self.xi
        self.force = gradient(s.G, s.gains.K, self.Q_L)
        self.e_R = s.G.vee(self.Q_L)

    def damping(self, V: Array) -> Array:
        """K_d V."""
        return apply_matrix(self.s.gains.K_d, V)

    def momentum_rate(self, V: Array) -> Array:
        """d(𝕀V)/dt."""
        return rate_of(self.momentum(V))

    def change(self, V: Array) -> Array:
        """Ṡ*S⁻* 𝕀V."""
        return self.s.inertia.feedforward(V) + 0 * V

    def covariant(self, V: Array, W: Array) -> Array:
        """𝕀∇_V W of the Levi-Civita connection, ½(𝕀[V, W] − ad*_V 𝕀W − ad*_W 𝕀V)."""
        coadjoints = coadjoint(self.G, V, self.momentum(W)) + coadjoint(self.G, W, self.momentum(V))
        return (self.momentum(bracket(self.G, V, W)) - coadjoints) / 2


class BulloMurrayForm(LiteralForm):
    """d(𝕀ξ)/dt + 𝕀∇_V ξ − K_d e − L*dΥ(Q_L), by the transported velocity ξ and the connection."""

    name: ClassVar[str] = "Bullo–Murray by the connection"
    statement: ClassVar[str] = "after Bullo, Murray (1999)"
    section: ClassVar[float] = 8.1
    law: ClassVar[str] = "bullo_murray"

    def torque(self, s: Tracking, law: Any) -> Array:
        """The sum of its terms."""
        b = Body(s)
        forward = b.momentum_rate(b.xi) + b.covariant(b.V, b.xi) + b.change(b.e)
        return forward - b.damping(b.e) - b.force


class GoodarziForm(LiteralForm):
    """𝕀Ad_{Q_L⁻¹}V̇_d + 𝕀̇ξ − ad*_ξ 𝕀ξ − K_d e − L*dΥ(Q_L) − k_I b tanh(e_I/b)."""

    name: ClassVar[str] = "Goodarzi, Lee, Lee"
    statement: ClassVar[str] = "after Goodarzi, Lee, Lee (2013)"
    section: ClassVar[float] = 8.2
    law: ClassVar[str] = "goodarzi2013"

    def torque(self, s: Tracking, law: Any) -> Array:
        """The sum of its terms."""
        b = Body(s)
        moved = bracket(b.G, b.e, b.xi)  # ξ̇ = Ad_{Q_L⁻¹}V̇_d − [e, ξ]
        desired = b.momentum_rate(b.xi) + b.momentum(moved)
        forward = desired - coadjoint(b.G, b.xi, b.momentum(b.xi)) + b.change(b.e)
        integral = s.memory["integral"]
        limited = integral if law.bound is None else law.bound * tanh(integral / law.bound)
        return forward - b.damping(b.e) - b.force - law.ki * limited


class GoodarziIntegral(Identity):
    """ė_I = e + c₂ e_R; a sampled law adds one period of this rate to e_I at every instant."""

    name: ClassVar[str] = "integral of the errors"
    statement: ClassVar[str] = "after Goodarzi, Lee, Lee (2013)"
    section: ClassVar[float] = 8.21
    per_law: ClassVar[bool] = True

    def applies(self, loop: ClosedLoop) -> bool:
        """Whether the law has this integral."""
        return GoodarziForm().applies(loop)

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """Compare the rate of the memory, or its increase over a period, with the formula."""
        s, loop = sample.s, sample.loop
        b, control = Body(s), loop.vehicle.control
        rate = b.e + getattr(loop.controller, "c2", None) * b.e_R
        if control is None:
            yield rate_of(s.memory["integral"]), rate
        else:
            later = loop.tracking(sample.times, loop.after_instant(sample.times, sample.flat))
            yield later.memory["integral"], s.memory["integral"] + control.period * rate


class MaithripalaForm(LiteralForm):
    """d(𝕀V_d)/dt + 𝕀∇_V V_d − Ad*_{Q_d}L*dΥ(Q_E) − k_d 𝕀Ṽ."""

    name: ClassVar[str] = "Maithripala, Berg, Dayawansa"
    statement: ClassVar[str] = "after Maithripala, Berg, Dayawansa (2006)"
    section: ClassVar[float] = 8.3
    law: ClassVar[str] = "maithripala2006"

    def torque(self, s: Tracking, law: Any) -> Array:
        """The sum of its terms."""
        b, V_tilde = Body(s), s.V - s.Vd
        forward = b.momentum_rate(s.Vd) + b.covariant(s.V, s.Vd) + b.change(V_tilde)
        shaping = s.G.Ad_star(s.Qd, gradient(s.G, s.gains.K, s.Q @ s.G.inverse(s.Qd)))
        return forward - shaping - law.damping_rate * b.momentum(V_tilde)


class SlidingVariableForm(LiteralForm):
    """d(𝕀V_r)/dt − ad*_{V_r}𝕀V + Ṡ*S⁻*𝕀s − reaching(s), V_r = ξ − slope L*dΥ(Q_L)."""

    def torque(self, s: Tracking, law: Any) -> Array:
        """The sum of its terms."""
        b = Body(s)
        V_r = b.xi - law.slope * b.force
        sliding = b.V - V_r
        forward = b.momentum_rate(V_r) - coadjoint(b.G, V_r, b.P) + b.change(sliding)
        return forward - self.reaching(b, sliding, law)

    @abstractmethod
    def reaching(self, b: Body, sliding: Array, law: Any) -> Array:
        """The force against s."""


class SlotineLiForm(SlidingVariableForm):
    """d(𝕀V_r)/dt − ad*_{V_r}𝕀V + Ṡ*S⁻*𝕀s − K_d s, V_r = ξ − slope L*dΥ(Q_L)."""

    name: ClassVar[str] = "Slotine–Li"
    statement: ClassVar[str] = "after Slotine, Li (1987)"
    section: ClassVar[float] = 8.4
    law: ClassVar[str] = "slotine_li"

    def reaching(self, b: Body, sliding: Array, law: Any) -> Array:
        """K_d s."""
        return b.damping(sliding)


class SlidingForm(SlidingVariableForm):
    """d(𝕀V_r)/dt − ad*_{V_r}𝕀V + Ṡ*S⁻*𝕀s − gain tanh(s/layer), V_r = ξ − slope L*dΥ(Q_L)."""

    name: ClassVar[str] = "sliding mode"
    statement: ClassVar[str] = "after Slotine, Li (1991), section 7.2"
    section: ClassVar[float] = 8.5
    law: ClassVar[str] = "sliding"

    def reaching(self, b: Body, sliding: Array, law: Any) -> Array:
        """gain · tanh(s / layer)."""
        return law.gain * tanh(sliding / law.layer)


class LogarithmicForm(LiteralForm):
    """d(𝕀ξ)/dt − ad*_V 𝕀V − K_d e − the differential of ½⟨H log Q_L, log Q_L⟩."""

    name: ClassVar[str] = "logarithmic"
    statement: ClassVar[str] = "after Johnson, Beard (2021)"
    section: ClassVar[float] = 8.6
    law: ClassVar[str] = "logarithmic"

    def torque(self, s: Tracking, law: Any) -> Array:
        """The sum of its terms, the force by differentiation along every axis."""
        b = Body(s)
        forward = b.momentum_rate(b.xi) - coadjoint(b.G, b.V, b.P) + b.change(b.e)
        force = stack([self._slope(b, axis) for axis in range(b.G.dimension)])
        return forward - b.damping(b.e) - force

    def _slope(self, b: Body, axis: int) -> Array:
        """d/dε ½⟨H x, x⟩ at x = log(Q_L exp(εE))."""
        x = b.G.log(with_rate(b.Q_L, b.Q_L @ b.G.basis[axis]))
        H = stiffness(b.s)
        return rate_of(dot(apply_matrix(H, x), x) / 2)


class QuaternionForm(LiteralForm):
    """Jξ̇ + ω × Jω − K_d e − 2Hq with q = vee(R_L − R_Lᵀ) / 4q₀ and q₀ = ½√(1 + tr R_L)."""

    name: ClassVar[str] = "quaternion feedback"
    statement: ClassVar[str] = "after Wie, Weiss, Arapostathis (1989)"
    section: ClassVar[float] = 8.7
    law: ClassVar[str] = "quaternion"

    def is_written_for(self, loop: ClosedLoop) -> bool:
        """Rotations of space."""
        return is_rotations_of_space(loop.group)

    def torque(self, s: Tracking, law: Any) -> Array:
        """The sum of its terms."""
        b = Body(s)
        scalar = sqrt(1 + sum(b.Q_L[..., k, k] for k in range(3))) / 2
        vector = vee(b.Q_L - transpose(b.Q_L)) / (4 * scalar[..., None])
        forward = b.momentum_rate(b.xi) + cross(b.V, b.P) + b.change(b.e)
        return forward - b.damping(b.e) - 2 * apply_matrix(stiffness(s), vector)


class LeeOnSO3(RigidBodyForm):
    """An attitude law of Lee and others in the symbols R, Ω, J."""

    def torque(self, s: Tracking, law: Any) -> Array:
        """−k_R e_R − k_Ω e_Ω and the paper's feedforward, with ½k_R I = K and k_Ω I = K_d."""
        to_body = transpose(s.Q) @ s.Qd
        weighted = s.gains.K @ transpose(to_body)
        k_R_e_R = vee(weighted - transpose(weighted))
        desired, rate = apply_matrix(to_body, s.Vd), apply_matrix(to_body, rate_of(s.Vd))
        e_Omega = s.V - desired
        feedback = -k_R_e_R - apply_matrix(s.gains.K_d, e_Omega)
        return feedback + self.forward(s, desired, rate)

    @abstractmethod
    def forward(self, s: Tracking, desired: Array, rate: Array) -> Array:
        """The feedforward, from RᵀR_dΩ_d and RᵀR_dΩ̇_d."""


class Lee2010OnSO3(LeeOnSO3):
    """−k_R e_R − k_Ω e_Ω + Ω × JΩ − J(Ω̂RᵀR_dΩ_d − RᵀR_dΩ̇_d)."""

    name: ClassVar[str] = "Lee 2010 on SO(3)"
    statement: ClassVar[str] = "arXiv 1003.2005v4, eq. (6), (8), (9), (11)"
    section: ClassVar[float] = 8.01
    law: ClassVar[str] = "lee2010"

    def forward(self, s: Tracking, desired: Array, rate: Array) -> Array:
        """Ω × JΩ − J(Ω̂RᵀR_dΩ_d − RᵀR_dΩ̇_d)."""
        gyroscopic = cross(s.V, s.inertia.momentum(s.V))
        return gyroscopic - s.inertia.momentum(cross(s.V, desired) - rate)


class Lee2012OnSO3(LeeOnSO3):
    """−k_R e_R − k_Ω e_Ω + (RᵀR_dΩ_d) × J(RᵀR_dΩ_d) + JRᵀR_dΩ̇_d."""

    name: ClassVar[str] = "Lee 2012 on SO(3)"
    statement: ClassVar[str] = "after arXiv 1109.4457"
    section: ClassVar[float] = 8.02
    law: ClassVar[str] = "lee2012"

    def forward(self, s: Tracking, desired: Array, rate: Array) -> Array:
        """(RᵀR_dΩ_d) × J(RᵀR_dΩ_d) + JRᵀR_dΩ̇_d."""
        return cross(desired, s.inertia.momentum(desired)) + s.inertia.momentum(rate)


class SmallErrors(Identity):
    """Near a pose at rest the torque is −H x − K_d v: H the Hessian of Υ at I, v the velocity.

    The inertia is held constant, so that the compensation of its change does not count as damping.
    A memory is part of the law: its change on the way to x counts as stiffness, and its change
    while the body stays at x must not affect the torque.
    """

    name: ClassVar[str] = "stiffness and damping of small errors"
    statement: ClassVar[str] = "Υ and K_d to first order"
    section: ClassVar[float] = 8.9
    per_law: ClassVar[bool] = True

    def applies(self, loop: ClosedLoop) -> bool:
        """Whether the law states if its gains are matched."""
        return loop.controller.matched is not None

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """Compare the derivatives of the torque by pose and velocity errors with the gains.

        With τ = A x + B v + C z and ż = D x + E v + F z, the memory adds C (s − F)⁻¹(D + E s) to A.
        In powers of 1/s this is C E, then C Fᵏ(D + F E), which is 0 for all k if it is 0 for as
        many k as z has entries.
        """
        s, law, x = sample.resting, sample.loop.controller, sample.drawn[1]
        still = sample.lifted(0 * x)
        identity = sample.lifted(0 * sample.drawn[0] + sample.G.identity)
        at_rest = replace(
            s,
            t=sample.times,
            inertia=replace(sample.loop.inertia.at(sample.times), change=None),
            Q=identity,
            P=still,
            Qd=identity,
            Pd=still,
            tau_d=still,
            memory={name: sample.lifted(0 * floats(z)) for name, z in s.memory.items()},
        )
        turned = replace(at_rest, Q=with_rate(identity, sample.G.hat(x)))
        moved = replace(at_rest, P=with_rate(still, at_rest.inertia.momentum(x)))
        taken_up = _memory_rates(law, moved)
        there = _with_memory_rates(turned, taken_up)
        yield rate_of(law.torque(there)), -apply_matrix(stiffness(s), x)
        yield rate_of(law.torque(moved)), -apply_matrix(s.gains.K_d, x)
        taken_up = _memory_rates(law, there)
        for _ in range(sum(sample.loop.controller.memory(sample.G).values())):
            staying = _with_memory_rates(at_rest, taken_up)
            yield rate_of(law.torque(staying) + still), still
            taken_up = _memory_rates(law, staying)

    def check(self, sample: Sample) -> list[Row]:
        """Check a law with matched gains; for any other law nothing is claimed."""
        if sample.loop.controller.matched:
            return super().check(sample)
        remark = "not matched: the law has gains of its own"
        return [self.row(Verdict.UNCLAIMED, remark=remark, controller=sample.label)]


def _memory_rates(law: Controller, s: Tracking) -> dict[str, Array]:
    """Return the derivatives of the rates of a law's memory."""
    rates = law.memory_rate(s)
    return {name: rate_of(rates[name] + 0 * z) for name, z in s.memory.items()}


def _with_memory_rates(s: Tracking, rates: Mapping[str, Array]) -> Tracking:
    return replace(s, memory={name: with_rate(z, rates[name]) for name, z in s.memory.items()})


def stiffness(s: Tracking) -> Array:
    """H_ij = tr(E_i K E_jᵀ), entry by entry."""
    E = s.G.basis
    return stack([stack([_trace(A @ s.gains.K @ B.T) for A in E]) for B in E])


def _trace(matrix: Array) -> Any:
    return (matrix * np.eye(matrix.shape[-1])).sum(axis=(-2, -1))
