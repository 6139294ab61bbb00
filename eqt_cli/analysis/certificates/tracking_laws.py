"""The tracking laws on every group (§6, §7): Theorem 6.2, the (g, c, n) family, the rate of L."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, ClassVar

from eqt_cli.analysis.certificates.base import Identity, LiteralForm, Row, registered_name
from eqt_cli.analysis.certificates.error_system import feedforward
from eqt_cli.analysis.evidence.numbers import rate_of
from eqt_cli.analysis.evidence.sample import Sample
from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.controllers import Controller
from eqt_cli.controllers.family import Family
from eqt_cli.core.arrays import Array, apply_matrix, dot, transpose
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.navigation import gradient
from eqt_cli.mechanics.semidirect import Semidirect
from eqt_cli.mechanics.tracking import Gains, Tracking

Point = tuple[Any, Any, Any, Any, str, str]
"""(g, c, n, q), the frame of the errors and the frame of the damping."""

MEMBERS: dict[str | None, Point] = {
    "eqt": (1.0, 1.0, 0.0, 0.0, "spatial", "spatial"),
    "gt": (0.5, 0.5, 0.5, 0.0, "spatial", "body"),
    "nog": (0.0, 1.0, 0.0, 0.0, "spatial", "spatial"),
    "asym": (1.0, 0.5, 0.5, 0.0, "spatial", "spatial"),
    "lee2010": (1.0, 1.0, 0.0, 1.0, "body", "body"),
    "lee2012": (0.0, 0.0, 1.0, 0.0, "body", "body"),
    "bullo_murray": (0.5, 0.5, 0.5, 0.0, "body", "body"),
}
"""Points of named laws in the family, by registered name; not read from the laws."""


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


class MemberForm(LiteralForm):
    """The form of one of the paper's laws, and of a family member with the same options."""

    def applies(self, loop: ClosedLoop) -> bool:
        """Whether the law claims this point and the formula covers the loop."""
        return claimed_point(loop.controller) == MEMBERS[self.law] and self.is_written_for(loop)


class EquivariantControl(MemberForm):
    """τ_d + Ad^τ_{X_d⁻¹}(V_E, τ_E) is the torque of (g, c, n) = (1, 1, 0) with spatial damping."""

    name: ClassVar[str] = "control through G ⋉ g*"
    statement: ClassVar[str] = "Theorem 6.2, eq. (20), (22)"
    section: ClassVar[float] = 6.2
    law: ClassVar[str] = "eqt"

    def torque(self, s: Tracking, law: Any) -> Array:
        """The theorem's control."""
        return tracking_control(s)


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

    Named laws are compared at the weights of their papers, other members at their options.
    """

    name: ClassVar[str] = "weights (g, c, n, q) of the law"
    statement: ClassVar[str] = "Theorem 6.2, §7"
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
        loop, s = sample.loop, sample.s
        outflow = loop.outflow(s, loop.acting_and_rates(s)[0])
        if outflow is not None:
            yield rate_of(loop.lyapunov(s)), -outflow

    def check(self, sample: Sample) -> list[Row]:
        """Add the theorem and the function L of the law to the rows."""
        law = sample.loop.controller
        remark = "" if law.energy == Controller.energy else f"L = {law.energy}"
        return [
            replace(row, statement=law.theorem, remark=row.remark or remark)
            for row in super().check(sample)
        ]


def bracket(G: MatrixLieGroup, U: Array, V: Array) -> Array:
    """[U, V] as the commutator of matrices."""
    return G.vee(G.hat(U) @ G.hat(V) - G.hat(V) @ G.hat(U))


def coadjoint(G: MatrixLieGroup, V: Array, P: Array) -> Array:
    """ad*_V P by its definition, ⟨ad*_V P, E⟩ = ⟨P, V^E − EV^⟩, with P as a matrix."""
    matrix, transposed = G.hat(P / (G.basis**2).sum(axis=(-2, -1))), transpose(G.hat(V))
    return G.contract(transposed @ matrix - matrix @ transposed)
