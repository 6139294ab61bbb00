"""The tracking laws on every group (§6, §7): Theorem 6.2, the (g, c, n) family, the rate of L."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, ClassVar

from eqt_cli.analysis.certificates.base import Identity, LiteralForm, registered_name
from eqt_cli.analysis.certificates.error_system import feedforward
from eqt_cli.analysis.evidence.running_error import rate_of
from eqt_cli.analysis.evidence.sample import Sample
from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.controllers import Controller
from eqt_cli.controllers.family import Family
from eqt_cli.core.arrays import Array, apply_matrix, dot, transpose
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.navigation import gradient
from eqt_cli.mechanics.semidirect import Semidirect
from eqt_cli.mechanics.tracking import Gains, Tracking

Point = tuple[Any, Any, Any, str]
"""(g, c, n) and the frame of the damping."""

MEMBERS: dict[str | None, Point] = {
    "eqt": (1.0, 1.0, 0.0, "spatial"),
    "gt": (0.5, 0.5, 0.5, "body"),
    "nog": (0.0, 1.0, 0.0, "spatial"),
    "asym": (1.0, 0.5, 0.5, "spatial"),
}
"""Where the paper's laws lie in the family, by registered name; never read from the laws."""


def claimed_point(law: Controller) -> Point | None:
    """Which point of the family a law claims to be: the paper's, by its name, or its own options.

    None for a law that is not of the family, or that overrides the family's torque.
    """
    if (named := MEMBERS.get(registered_name(law))) is not None:
        return named
    if not isinstance(law, Family) or type(law).torque is not Family.torque:
        return None
    return law.gyroscopic, law.transport, law.connection, law.damping


class MemberForm(LiteralForm):
    """The form of one of the paper's laws; also of a point of the family that a user sets there."""

    def applies(self, loop: ClosedLoop) -> bool:
        """To whatever claims to be this point."""
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
    """τ(g, c, n) is the control of Theorem 6.2 with other weights, and K_d in its own frame.

    The paper's laws are asked at the paper's weights, any other member at its options.
    """

    name: ClassVar[str] = "weights (g, c, n) of the law"
    statement: ClassVar[str] = "Theorem 6.2, §7"
    section: ClassVar[float] = 6.21
    law: ClassVar[str] = "family"

    def applies(self, loop: ClosedLoop) -> bool:
        """To whatever claims to be a point of the family."""
        return claimed_point(loop.controller) is not None

    def torque(self, s: Tracking, law: Any) -> Array:
        """The theorem's control, and what the other weights and the other frame change."""
        point = claimed_point(law)
        assert point is not None
        g, c, n, frame = point
        gyroscopic = (1 - g) * _coadjoint(s.G, s.V_tilde, s.Pd)
        transport = (1 - c) * _coadjoint(s.G, s.Vd, s.P_tilde)
        connection = n * s.inertia.momentum(_bracket(s.G, s.V, s.Vd))
        tau = tracking_control(s) + gyroscopic + transport + connection
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
        """To members of the family."""
        return claimed_point(loop.controller) is not None

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The power of the torque without gains against that of the transport."""
        gains, point = sample.s.gains, claimed_point(sample.loop.controller)
        assert point is not None
        _, c, n, _ = point
        s = replace(sample.s, gains=Gains(0 * gains.K, 0 * gains.K_d))
        transport = (c + n) * dot(s.P_tilde, _bracket(s.G, s.V, s.Vd))
        inertia = dot(s.inertia_force + 0 * s.P, s.V_tilde)
        yield dot(sample.loop.controller.torque(s) - s.tau_d, s.V_tilde), transport + inertia


class LyapunovRate(Identity):
    """dL/dt = −dissipation + ⟨δ, Ṽ⟩ along the closed loop, L differentiated exactly.

    δ is the force that the law does not know of; it is 0 where the loop holds nothing else.
    """

    name: ClassVar[str] = "rate of L"
    statement: ClassVar[str] = "Theorems 3.2, 6.2"
    section: ClassVar[float] = 6.25
    per_law: ClassVar[bool] = True

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The derivative of L along the flow against the law's own dissipation, if it says it."""
        loop, s = sample.loop, sample.s
        outflow = loop.outflow(s, loop.acting_and_rates(s)[0])
        if outflow is not None:
            yield rate_of(s.lyapunov), -outflow


def _bracket(G: MatrixLieGroup, U: Array, V: Array) -> Array:
    """[U, V] as the commutator of matrices."""
    return G.vee(G.hat(U) @ G.hat(V) - G.hat(V) @ G.hat(U))


def _coadjoint(G: MatrixLieGroup, V: Array, P: Array) -> Array:
    """ad*_V P by its definition, ⟨ad*_V P, E⟩ = ⟨P, V^E − EV^⟩, with P as a matrix."""
    matrix, transposed = G.hat(P / (G.basis**2).sum(axis=(-2, -1))), transpose(G.hat(V))
    return G.contract(transposed @ matrix - matrix @ transposed)
