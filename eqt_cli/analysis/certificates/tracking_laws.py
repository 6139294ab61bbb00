"""The error system (§5, Lemma 6.1), and tracking laws (§6, §7): Theorem 6.2, the family, L̇."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, ClassVar

from eqt_cli.analysis.certificates.base import Identity, LiteralForm, Row, Verdict, registered_name
from eqt_cli.analysis.evidence.numbers import floats, rate_of, with_rate
from eqt_cli.analysis.evidence.sample import Sample
from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.controllers import Controller
from eqt_cli.controllers.family import Family
from eqt_cli.core.arrays import Array, apply_matrix, dot, transpose
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.lie_poisson import lie_poisson
from eqt_cli.mechanics.navigation import gradient, potential
from eqt_cli.mechanics.semidirect import Semidirect
from eqt_cli.mechanics.tracking import Gains, Tracking


class ErrorDynamics(Identity):
    """Ė = f_{U_E}(E) for E = X X_d⁻¹ and U_E = Ad_{X_d}(U − U_d), with free inputs U and U_d."""

    name: ClassVar[str] = "error dynamics"
    statement: ClassVar[str] = "Lemma 5.1, eq. (18), (19)"
    section: ClassVar[float] = 5.1

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The rate of the error against the vector field of the error input."""
        G, S = sample.G, sample.semidirect
        (X, X_d, _), (U, U_d) = sample.states, sample.inputs
        moving, moving_d = (
            sample.moving(state, lie_poisson(G, *state, *control))
            for state, control in ((X, U), (X_d, U_d))
        )
        rates = map(rate_of, S.error(moving, moving_d))
        U_E = S.error_input(X_d, U, U_d)
        yield from zip(rates, lie_poisson(G, *S.error(X, X_d), *U_E), strict=True)


class ErrorEnergy(Identity):
    """𝕀̄_t V_E = P_E with 𝕀̄_t = Ad*_{Q_d⁻¹} 𝕀_t Ad_{Q_d⁻¹}, and L = ½⟨P_E, V_E⟩ + Υ(Q_E)."""

    name: ClassVar[str] = "error velocity and energy"
    statement: ClassVar[str] = "Lemma 6.1"
    section: ClassVar[float] = 6.1

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """Both equations, with E and V_E as G ⋉ g* gives them."""
        s, G, S = sample.s, sample.G, sample.semidirect
        X_d = s.Qd, s.Pd
        Q_E, P_E = S.error((s.Q, s.P), X_d)
        V_E, _ = S.error_input(X_d, (s.V, s.tau_d), (s.Vd, s.tau_d))
        A = G.Ad_matrix(G.inverse(s.Qd))
        yield apply_matrix(transpose(A) @ s.inertia.matrix @ A, V_E), P_E
        yield s.lyapunov, dot(P_E, V_E) / 2 + potential(G, s.gains.K, Q_E)


class SDot(Identity):
    """Ṡ = −ad_{V_d} S = −S ad_{Ad_{Q_d} V_d}, Ṡ by differentiation along the reference."""

    name: ClassVar[str] = "rate of Ad_{Q_d⁻¹}"
    statement: ClassVar[str] = "eq. (21)"
    section: ClassVar[float] = 6.15

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The derivative against both forms."""
        s, G = sample.s, sample.G
        S = G.Ad_matrix(G.inverse(s.Qd))
        rate = rate_of(S)
        yield rate, -(G.ad_matrix(s.Vd) @ S)
        yield rate, -(S @ G.ad_matrix(G.Ad(s.Qd, s.Vd)))


class TrackingFeedforward(Identity):
    """½⟨P_E, d(𝕀̄_t⁻¹)/dt P_E⟩ = −⟨S̄̇*S̄⁻* P_E, V_E⟩ at fixed P_E, with S̄ = S Ad_{Q_d⁻¹}."""

    name: ClassVar[str] = "feedforward of the error inertia"
    statement: ClassVar[str] = "Theorem 6.2, eq. (22a)"
    section: ClassVar[float] = 6.2

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The rate of the error's kinetic energy at fixed momentum against the power."""
        s, G, P_E = sample.s, sample.G, sample.inputs[0][1]
        V_E = G.Ad(s.Qd, s.inertia.velocity(G.Ad_star(s.Qd, P_E)))
        yield rate_of(dot(P_E, V_E)) / 2, -dot(feedforward(s, P_E), V_E)


def feedforward(s: Tracking, P_E: Array) -> Array:
    """S̄̇*S̄⁻* P_E with S̄ = S Ad_{Q_d⁻¹}: −ad*_{Ad_{Q_d}V_d} P_E, Hampsey et al. (2025), eq. (22a).

    Where the inertia varies by itself, also Ad*_{Q_d⁻¹} Ṡ*S⁻* Ad*_{Q_d} P_E.
    """
    G = s.G
    transport = -G.ad_star(G.Ad(s.Qd, s.Vd), P_E)
    if s.inertia.change is None:
        return transport
    velocity = s.inertia.velocity(G.Ad_star(s.Qd, P_E))
    own = s.inertia.feedforward(velocity) + 0 * P_E
    return transport + G.Ad_star(G.inverse(s.Qd), own)


Point = tuple[Any, Any, Any, Any, str, str]
"""(g, c, n, q), the frame of the errors and the frame of the damping."""

MEMBERS: dict[str | None, Point] = {
    "eqt": (1.0, 1.0, 0.0, 0.0, "spatial", "spatial"),
    "gt": (0.5, 0.5, 0.5, 0.0, "spatial", "body"),
    "nog": (0.0, 1.0, 0.0, 0.0, "spatial", "spatial"),
    "asym": (1.0, 0.5, 0.5, 0.0, "spatial", "spatial"),
}
"""Points of the paper's laws in the family, by registered name; not read from the laws."""


def claimed_point(law: Controller) -> Point | None:
    """Return the point of the family that a law claims: the paper's by its name, or its options.

    None for a law outside the family, or one that overrides the family's torque.
    """
    if (named := MEMBERS.get(registered_name(law))) is not None:
        return named
    if not isinstance(law, Family) or type(law).torque is not Family.torque:
        return None
    weights = law.gyroscopic, law.transport, law.connection, law.quadratic
    return *weights, law.error, str(law.damping)


def seen_from_body(s: Tracking) -> Tracking:
    """Return the motion in the errors Q_L = Q_d⁻¹Q and V − ξ, with ξ from matrices and its rate ξ̇.

    It has (Q_L, P) for its state and (I, 𝕀ξ), driven by 𝕀ξ̇ + 𝕀̇ξ − ad*_ξ 𝕀ξ, for its reference.
    """
    Q_L = s.G.inverse(s.Qd) @ s.Q
    P_xi = s.inertia.momentum(transported(s))
    tau_xi = rate_of(P_xi) - coadjoint(s.G, transported(s), P_xi)
    return replace(s, Q=Q_L, Qd=s.G.identity, Pd=P_xi, tau_d=tau_xi)


def transported(s: Tracking) -> Array:
    """ξ = (Q⁻¹Q_d V_d^ Q_d⁻¹Q)^∨, the desired velocity in the frame of the body."""
    Q_L = s.G.inverse(s.Qd) @ s.Q
    return s.G.vee(s.G.inverse(Q_L) @ s.G.hat(s.Vd) @ Q_L)


def tracking_control(s: Tracking) -> Array:
    """τ = τ_d + Ad^τ_{X_d⁻¹}(V_E, τ_E), Hampsey et al. (2025), eq. (20) and (22).

    It is written in the error's own variables and shares no formula with the controllers, which are
    written in the body frame.
    """
    S, X_d = Semidirect(s.G), (s.Qd, s.Pd)
    Q_E, P_E = S.error((s.Q, s.P), X_d)
    V_E, _ = S.error_input(X_d, (s.V, s.tau_d), (s.Vd, s.tau_d))
    feedback = -apply_matrix(s.gains.K_d, V_E) - gradient(s.G, s.gains.K, Q_E)
    return S.closed_loop_input(X_d, s.tau_d, (V_E, feedforward(s, P_E) + feedback))


class FamilyForm(LiteralForm):
    """τ(g, c, n, q) is the control of Theorem 6.2 with other weights, and K_d in its own frame.

    The paper's laws are compared at the weights of the paper, other members at their options.
    """

    name: ClassVar[str] = "weights (g, c, n, q) of the law"
    statement: ClassVar[str] = "Theorem 6.2, eq. (20), (22), §7"
    section: ClassVar[float] = 6.21
    law: ClassVar[str] = "family"

    def applies(self, loop: ClosedLoop) -> bool:
        """Whether the law claims a point of the family."""
        return claimed_point(loop.controller) is not None

    def torque(self, s: Tracking, law: Any) -> Array:
        """Return the theorem's control with the changes due to other weights and another frame."""
        point = claimed_point(law)
        assert point is not None
        g, c, n, q, error, frame = point
        s = seen_from_body(s) if error == "body" else s
        gyroscopic = (1 - g) * coadjoint(s.G, s.V_tilde, s.Pd)
        transport = (1 - c) * coadjoint(s.G, s.Vd, s.P_tilde)
        connection = n * s.inertia.momentum(bracket(s.G, s.V, s.Vd))
        quadratic = -q * coadjoint(s.G, s.V_tilde, s.P_tilde)
        tau = tracking_control(s) + gyroscopic + transport + connection + quadratic
        if frame == "spatial":
            return tau
        spatial = s.G.Ad_star(s.Qd, apply_matrix(s.gains.K_d, s.G.Ad(s.Qd, s.V_tilde)))
        return tau + spatial - apply_matrix(s.gains.K_d, s.V_tilde)


class FeedforwardPower(Identity):
    """⟨τ_ff − τ_d, Ṽ⟩ = (c + n)⟨𝕀Ṽ, [V, V_d]⟩ + ⟨Ṡ*S⁻* 𝕀Ṽ, Ṽ⟩, whatever the weight g."""

    name: ClassVar[str] = "power of the feedforward"
    statement: ClassVar[str] = "§7, power of τ_ff − τ_d"
    section: ClassVar[float] = 7.3
    per_law: ClassVar[bool] = True

    def applies(self, loop: ClosedLoop) -> bool:
        """Whether the law is a member of the family."""
        return claimed_point(loop.controller) is not None

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The power of the torque without gains against that of the transport."""
        gains, point = sample.s.gains, claimed_point(sample.loop.controller)
        assert point is not None
        _, c, n, _, error, _ = point
        loose = replace(sample.s, gains=Gains(0 * gains.K, 0 * gains.K_d))
        s = seen_from_body(loose) if error == "body" else loose
        transport = (c + n) * dot(s.P_tilde, bracket(s.G, s.V, s.Vd))
        inertia = dot(s.inertia_force + 0 * s.P, s.V_tilde)
        yield dot(sample.loop.controller.torque(loose) - s.tau_d, s.V_tilde), transport + inertia


class LyapunovRate(Identity):
    """dL/dt = −dissipation + ⟨δ, Ṽ⟩ along the closed loop, L differentiated exactly.

    δ is the force unknown to the law; it is 0 in an ideal loop.
    """

    name: ClassVar[str] = "rate of L"
    statement: ClassVar[str] = "Theorems 3.2, 6.2"
    section: ClassVar[float] = 6.25
    per_law: ClassVar[bool] = True

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """Compare the derivative of L along the flow with the dissipation of the law, if known."""
        loop = sample.loop
        if loop.dissipation(sample.resting) is not None:
            s = sample.s
            outflow: Any = loop.outflow(s, loop.acting_and_rates(s)[0])
            yield rate_of(loop.lyapunov(s)), -outflow

    def check(self, sample: Sample) -> list[Row]:
        """Add the theorem and the function L of the law to the rows."""
        law = sample.loop.controller
        remark = "" if law.energy == Controller.energy else f"L = {law.energy}"
        return [
            replace(row, statement=law.theorem, remark=row.remark or remark)
            for row in super().check(sample)
        ]


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
        yield rate_of(law.torque(there)), -apply_matrix(s.stiffness, x)
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


def bracket(G: MatrixLieGroup, U: Array, V: Array) -> Array:
    """[U, V] as the commutator of matrices."""
    return G.vee(G.hat(U) @ G.hat(V) - G.hat(V) @ G.hat(U))


def coadjoint(G: MatrixLieGroup, V: Array, P: Array) -> Array:
    """ad*_V P by its definition, ⟨ad*_V P, E⟩ = ⟨P, V^E − EV^⟩, with P as a matrix."""
    matrix, transposed = G.hat(P / (G.basis**2).sum(axis=(-2, -1))), transpose(G.hat(V))
    return G.contract(transposed @ matrix - matrix @ transposed)
