"""Identities of the paper, checked at random states."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from eqt_cli.base.arrays import Array, Arrays, apply_matrix, dot, stack, transpose
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.inertia import FactoredInertia, Inertia, critical_sets
from eqt_cli.components.laws import Controller, Family
from eqt_cli.components.mechanics import Semidirect, Tracking, gradient, lie_poisson, potential
from eqt_cli.extensions.proofs import certificates
from eqt_cli.extensions.proofs.exact import UNIT, floats, lifted, rate_of, value_of, with_rate
from eqt_cli.extensions.proofs.sample import Sample
from eqt_cli.loop.closed_loop import ClosedLoop

# The group, its algebra and their duals (§2), and the semidirect product G ⋉ g* (§4) --------------


CLOSED_FORM_ROUNDINGS = 64
"""Allowed error of `exp`, `log` and `drift` in unit roundoffs of 1 plus the largest coordinate. On
all groups of eqt they err by fewer than 15 (measured)."""

TERMS = 14
"""Number of terms of the series of exp at a sixteenth of a random velocity, down to rounding."""

PUSH = 1e-3
"""Relative scaling of a rotation that `drift` must detect."""


class DualAdjoint(certificates.Identity):
    """⟨Ad*_Q P, U⟩ = ⟨P, Q U^ Q⁻¹⟩, and Q Q⁻¹ = I."""

    name: ClassVar[str] = "Ad* is the dual of conjugation"
    statement: ClassVar[str] = "eq. (1)"
    section: ClassVar[float] = 2.0

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """Both contractions, and the inverse that they use."""
        G, (U, P) = sample.G, sample.inputs[0]
        Q = sample.states[0][0]
        yield dot(G.Ad_star(Q, P), U), dot(P, G.vee(Q @ G.hat(U) @ G.inverse(Q)))
        yield Q @ G.inverse(Q), G.identity


class DualBracket(certificates.Identity):
    """⟨ad*_V P, U⟩ = ⟨P, V^U^ − U^V^⟩, which fixes the sign of ad*."""

    name: ClassVar[str] = "ad* is the dual of the bracket"
    statement: ClassVar[str] = "eq. (2)"
    section: ClassVar[float] = 2.1

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """Both contractions."""
        G, ((V, P), (U, _)) = sample.G, sample.inputs
        yield dot(G.ad_star(V, P), U), dot(P, G.vee(G.hat(V) @ G.hat(U) - G.hat(U) @ G.hat(V)))


class Exponential(certificates.Identity):
    """exp V = Σ V^ᵏ/k! near 0, exp(V/2)² = exp V further out, and log exp V = V."""

    name: ClassVar[str] = "exp and log"
    statement: ClassVar[str] = "§2"
    section: ClassVar[float] = 2.2
    not_rational: ClassVar[str] = "exp and log are not rational"

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The closed forms against the series, against themselves, and against each other."""
        G, (V, _) = sample.G, value_of(sample.inputs[0][0])
        step, series = G.hat(lifted(V / 16)), G.identity
        for k in range(TERMS, 0, -1):
            series = G.identity + step @ series / k
        yield _near(G.exp(V / 16), V), series
        for parts in (8, 4, 2, 1):
            half = _near(G.exp(V / parts / 2), V)
            yield half @ half, _near(G.exp(V / parts), V)
        yield _near(G.log(G.exp(V / 4)), V), V / 4


class Drift(certificates.Identity):
    """A scaled rotation is not in the group, whichever part of the pose it is."""

    name: ClassVar[str] = "drift of every part"
    statement: ClassVar[str] = "eq. (5)"
    section: ClassVar[float] = 2.3
    not_rational: ClassVar[str] = "a distance is a square root"

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """Check that the drift detects it, and that a pose in the group has no drift."""
        G, Q = sample.G, floats(sample.drawn[0])
        yield _near(G.drift(Q), np.zeros(1)), np.zeros(len(Q))
        for part in G.parts:
            if part.velocity_unit == "rad/s":
                pushed = Q.copy()
                pushed[(..., *part.entries)] *= 1 + PUSH
                yield (G.drift(pushed) > PUSH / 2).astype(float), np.ones(len(Q))


def _near(closed_form: Array, V: Array) -> Array:
    """Return the value of a closed form with its allowed rounding error."""
    size = np.abs(closed_form).max() + np.abs(V).max() + 1
    return lifted(closed_form, CLOSED_FORM_ROUNDINGS * UNIT * size)


class SemidirectGroup(certificates.Identity):
    """(X Y) Z = X (Y Z), X X⁻¹ = (I, 0), and the error gives X back: E X_d = X."""

    name: ClassVar[str] = "product and inverse of G ⋉ g*"
    statement: ClassVar[str] = "eq. (15), (17)"
    section: ClassVar[float] = 4.0

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """Associativity, inverse, error; poses and momenta."""
        S, (X, Y, Z) = sample.semidirect, sample.states
        identity = tuple(np.broadcast_to(part, X[k].shape) for k, part in enumerate(S.identity))
        yield from zip(S.compose(S.compose(X, Y), Z), S.compose(X, S.compose(Y, Z)), strict=True)
        yield from zip(S.compose(X, S.inverse(X)), identity, strict=True)
        yield from zip(S.compose(S.error(X, Y), Y), X, strict=True)


class LeftInvariance(certificates.Identity):
    """f_U(X) = DL_X[U], where DL_X[U] is the rate of X·(exp(tV), tτ) at t = 0."""

    name: ClassVar[str] = "left invariance"
    statement: ClassVar[str] = "Theorem 4.1"
    section: ClassVar[float] = 4.1

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The vector field against the derivative of the product."""
        X, (V, tau), G = sample.states[0], sample.inputs[0], sample.G
        identity = 0 * G.hat(V) + G.identity, np.zeros(tau.shape)
        curve = sample.moving(identity, (G.hat(V), tau))  # (exp(tV), tτ) to first order
        moved, field = sample.semidirect.compose(X, curve), lie_poisson(G, *X, V, tau)
        yield from zip(field, map(rate_of, moved), strict=True)


class Equivariance(certificates.Identity):
    """DR_Y f_U(X) = f_{Ad_{Y⁻¹}U}(X Y), the left side as the rate of X(t)·Y along Ẋ = f_U(X)."""

    name: ClassVar[str] = "equivariance"
    statement: ClassVar[str] = "Theorem 4.1"
    section: ClassVar[float] = 4.1

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The pushed-forward vector field against the field of the transformed input."""
        S, (X, Y, _), U = sample.semidirect, sample.states, sample.inputs[0]
        along = sample.moving(X, lie_poisson(sample.G, *X, *U))
        pushed = map(rate_of, S.compose(along, Y))
        field = lie_poisson(sample.G, *S.compose(X, Y), *S.Ad(S.inverse(Y), U))
        yield from zip(pushed, field, strict=True)


# The error system (§5, Lemma 6.1), and tracking laws (§6, §7): Theorem 6.2, the family, L̇ --------


class ErrorDynamics(certificates.Identity):
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


class ErrorEnergy(certificates.Identity):
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


class SDot(certificates.Identity):
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


class TrackingFeedforward(certificates.Identity):
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
    of_reference = s.inertia.feedforward(s.inertia.velocity(G.Ad_star(s.Qd, P_E))) + 0 * P_E
    return transport + G.Ad_star(G.inverse(s.Qd), of_reference)


Point = tuple[Any, Any, Any, Any, str, str]
"""(g, c, n, q), the frame of the errors and the frame of the damping."""

MEMBERS: dict[str, Point] = {
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
    if (named := MEMBERS.get(law.name)) is not None:
        return named
    if not isinstance(law, Family) or type(law).torque is not Family.torque:
        return None
    weights = law.gyroscopic, law.transport, law.connection, law.quadratic
    return *weights, law.error, law.damping or law.error


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


class FamilyForm(certificates.LiteralForm):
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


class FeedforwardPower(certificates.Identity):
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
        loose = replace(sample.s, gains=replace(gains, K=0 * gains.K, K_d=0 * gains.K_d))
        s = seen_from_body(loose) if error == "body" else loose
        transport = (c + n) * dot(s.P_tilde, bracket(s.G, s.V, s.Vd))
        inertia = dot(s.inertia_force + 0 * s.P, s.V_tilde)
        yield dot(sample.loop.controller.torque(loose) - s.tau_d, s.V_tilde), transport + inertia


class LyapunovRate(certificates.Identity):
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

    def check(self, sample: Sample) -> list[certificates.Row]:
        """Add the theorem and the function L of the law to the rows."""
        law = sample.loop.controller
        remark = "" if law.energy == Controller.energy else f"L = {law.energy}"
        return [
            replace(row, statement=law.theorem, remark=row.remark or remark)
            for row in super().check(sample)
        ]


ONE, UP, LOW = np.eye(3), np.eye(6)[:, :3], np.eye(6)[:, 3:]
HAT = np.cross(ONE[:, None], ONE).swapaxes(1, 2)
"""e_i × v = HAT[i] v."""


def weights_of(point: Sequence[Any], k: Any, k_d: Any, inertia: Any) -> tuple[Any, ...]:
    """Return k, k_d, 𝕀, 1 − g, 1 − c, n, 1 − q and 1 − c − n of a law at (g, c, n, q, …)."""
    g, c, n, q, *_ = point
    return k, k_d, inertia, 1 - g, 1 - c, n, 1 - q, 1 - c - n


def forms_of_W(x: Any, Vd: Any, law: Sequence[Any], N: Any, M: Any) -> tuple[Any, Any]:
    """Return (1 + x²)V and (1 + x²)T, ``(…, 6, 6)``, with W = zᵀVz, Ẇ = zᵀTz and z = (e, Ṽ).

    On SO(3), W = L + eᵀN𝕀Ṽ + ½eᵀMe with R_dᵀR = exp(θ n^) and e = sin θ · n. T is affine in V_d,
    and both are polynomials in x = tan(θ/2) n. All vectors are columns, ``(…, 3, 1)``; `law` has
    the numbers of `weights_of`.
    """
    k, k_d, J, g, c, n, q, off = law
    scale = x.mT @ x + 1.0
    B = _hat(x) + ONE + -1.0 * (x @ x.mT)  # (1 + x²)(ė − e × V_d) = BṼ
    turn, NJ = _hat(Vd), N @ J
    ew = turn @ NJ + N @ (_hat(J @ Vd) * g + -1.0 * (turn @ J * c + J @ turn * n + ONE * k_d))
    ee = scale * (-2.0 * (N * k) + -1.0 * (M @ turn))
    ww = (_hat(2.0 * (N.mT @ x)) @ J) * q + B.mT @ NJ + -1.0 * scale * (ONE * k_d + turn @ J * off)
    V = _whole(scale * (scale * ONE * k + 0.5 * M), scale * NJ, scale * (0.5 * J))
    return V, _whole(ee, scale * ew + M @ B, ww)


def _hat(v: Any) -> Any:
    return sum(HAT[i] * (ONE[i : i + 1] @ v) for i in range(3))


def _whole(ee: Any, ew: Any, ww: Any) -> Any:
    whole = UP @ (ee @ UP.T + ew @ LOW.T) + LOW @ (ww @ LOW.T)
    return 0.5 * (whole + whole.mT)


def sides_of_W(sample: Sample) -> Iterator[tuple[Array, Array]]:
    """W = zᵀVz and Ẇ = zᵀTz for any N and M, W differentiated exactly; with K = kI, K_d = k_d I.

    They are times 1 + x², and hold for the laws (g, c, n, q) on SO(3) with errors in space.
    `eqt margins --from` proves them for a law before it proves a rate by these forms.
    """
    gains, (u, v), G = sample.loop.gains, sample.inputs[0], sample.G
    law, k, k_d = sample.loop.controller, gains.K[:1, :1], gains.K_d[:1, :1]
    s = replace(sample.resting, gains=replace(gains, K=ONE * k, K_d=ONE * k_d))
    moving = replace(sample.s, gains=s.gains, P=with_rate(s.P, G.ad_star(s.V, s.P) + law.torque(s)))

    def sine(s: Tracking) -> Array:
        R = transpose(s.Qd) @ s.Q
        return G.vee(R - transpose(R)) / 2

    def W(s: Tracking) -> Array:
        e = sine(s)
        return s.lyapunov + dot(e, u) * (dot(v, s.P_tilde) + dot(u, e) / 2)

    x = 2 * sine(s) / (1 + np.trace(transpose(s.Qd) @ s.Q, axis1=-2, axis2=-1))[..., None]
    z = np.concatenate([sine(s), s.V_tilde], axis=-1)[..., None]
    N, M = (u[..., None] * vector[..., None, :] for vector in (v, u))
    numbers = weights_of(claimed_point(law) or (), k, k_d, s.inertia.matrix)
    forms = forms_of_W(x[..., None], s.Vd[..., None], numbers, N, M)
    for value, form in zip((W(s), rate_of(W(moving))), forms, strict=True):
        yield (1 + dot(x, x)) * value, (z.mT @ form @ z)[..., 0, 0]


class SmallErrors(certificates.Identity):
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

    def check(self, sample: Sample) -> list[certificates.Row]:
        """Check a law with matched gains; for any other law nothing is claimed."""
        if sample.loop.controller.matched:
            return super().check(sample)
        remark = "not matched: the law has its own gains"
        return [self.row(certificates.Verdict.UNCLAIMED, remark=remark, controller=sample.label)]


def _memory_rates(law: Controller, s: Tracking) -> dict[str, Array]:
    """Return the derivatives of the rates of a law's memory."""
    rates = law.memory_rate(s)
    return {name: rate_of(rates[name] + 0 * z) for name, z in s.memory.items()}


def _with_memory_rates(s: Tracking, rates: Arrays) -> Tracking:
    return replace(s, memory={name: with_rate(z, rates[name]) for name, z in s.memory.items()})


def bracket(G: MatrixLieGroup, U: Array, V: Array) -> Array:
    """[U, V] as the commutator of matrices."""
    return G.vee(G.hat(U) @ G.hat(V) - G.hat(V) @ G.hat(U))


def coadjoint(G: MatrixLieGroup, V: Array, P: Array) -> Array:
    """ad*_V P by its definition, ⟨ad*_V P, E⟩ = ⟨P, V^E − EV^⟩, with P as a matrix."""
    matrix, transposed = G.hat(P / (G.basis**2).sum(axis=(-2, -1))), transpose(G.hat(V))
    return G.contract(transposed @ matrix - matrix @ transposed)


# Mechanical systems and their stabilisation, for an inertia that may vary in time (§3) ------------


FLAT = 1e-9
"""Eigenvalues of a Hessian below this share of the largest count as 0."""


class Momentum(certificates.Identity):
    """P = 𝕀_t V: a state made from poses and velocities at a time t returns them at that time."""

    name: ClassVar[str] = "momentum of a velocity"
    statement: ClassVar[str] = "eq. (6)"
    section: ClassVar[float] = 3.05

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """Compare a law's arguments with the poses and velocities of the state."""
        s, (Q, _, Qd, _) = sample.s, sample.drawn
        yield s.Q, Q
        yield s.Qd, Qd
        yield from zip((s.V, s.Vd), sample.velocities, strict=True)


class ReferenceMotion(certificates.Identity):
    """The reference obeys eq. (5) with its own torque: Q̇_d = Q_d V_d^, Ṗ_d = ad*_{V_d} P_d + τ_d.

    If the reference keeps its velocity, V̇_d = 0.
    """

    name: ClassVar[str] = "motion of the reference"
    statement: ClassVar[str] = "eq. (5)"
    section: ClassVar[float] = 3.06

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """Check the rates of the reference; none for one that is integrated from a torque."""
        G, reference = sample.G, sample.reference
        if "velocity" in reference.starts_from:
            return
        reference = reference.held(G, floats(sample.times)) or reference
        t = with_rate(sample.times, 1.0)
        inertia = sample.loop.inertia.at(t)
        _, _, Qd, _ = sample.drawn
        desired = reference.desired(G, inertia, t, Qd, None)
        Vd = inertia.velocity(desired.P)
        yield rate_of(desired.P), G.ad_star(Vd, desired.P) + desired.tau
        if not reference.starts_from:
            yield rate_of(desired.Q), desired.Q @ G.hat(Vd)
        if reference.keeps_velocity:
            yield rate_of(Vd), np.zeros(Vd.shape)


class InertiaRate(certificates.Identity):
    """∂h/∂t = ½⟨P, d(𝕀⁻¹)/dt P⟩ = −⟨Ṡ*S⁻* P, 𝕀⁻¹P⟩, and the inertia law states d𝕀/dt correctly.

    If the configuration gives the factor S, also Ṡ*S⁻* P = Ṡ* 𝕀_0 S V with S* 𝕀_0 S V = P.
    """

    name: ClassVar[str] = "feedforward of a varying inertia"
    statement: ClassVar[str] = "Theorem 3.2, eq. (10)"
    section: ClassVar[float] = 3.2

    def applies(self, loop: ClosedLoop) -> bool:
        """Whether the inertia varies."""
        return not isinstance(loop.inertia, Inertia)

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The power of the feedforward, and the rate of the tensor."""
        now, (_, P) = sample.s.inertia, sample.inputs[0]
        V = now.velocity(P)
        feedforward = now.feedforward(V) + 0 * V
        yield rate_of(dot(P, V)) / 2, -dot(feedforward, V)
        yield apply_matrix(rate_of(now.matrix), V), now.rate_force(V) + 0 * V
        law = sample.loop.inertia
        if isinstance(law, FactoredInertia):
            S = law.factor_at(sample.s.t)
            image = apply_matrix(law.initial @ S, V)
            yield apply_matrix(transpose(S), image), P
            yield feedforward, apply_matrix(transpose(rate_of(S)), image)


class NavigationGradient(certificates.Identity):
    """d/dt Υ(Q) = ⟨L*_Q dΥ, V⟩ along Q̇ = Q V^."""

    name: ClassVar[str] = "gradient of Υ"
    statement: ClassVar[str] = "Example 3.4, eq. (13)"
    section: ClassVar[float] = 3.4

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The rate of Υ against the contraction with its gradient."""
        G, K, (Q, P), (V, _) = sample.G, sample.loop.gains.K, sample.states[0], sample.inputs[0]
        along, _ = sample.moving((Q, P), (Q @ G.hat(V), 0 * P))
        yield rate_of(potential(G, K, along)), dot(gradient(G, K, Q), V)


class CriticalPoints(certificates.Identity):
    """dΥ = 0 at the known critical points, with the stated Hessian and index."""

    name: ClassVar[str] = "critical points of Υ"
    statement: ClassVar[str] = "Definition 2.1, Example 3.4"
    section: ClassVar[float] = 3.41
    not_rational: ClassVar[str] = "eigenvalues are roots of polynomials"

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The gradient there, and the eigenvalues of its derivative along the group."""
        G, K = sample.G, value_of(sample.loop.gains.K)[0]
        roundings = 16 * len(K) * UNIT * (np.linalg.cond(K) if sample.loop.task.is_whole else 1.0)
        for critical_set in critical_sets(G, K) or ():
            Q = lifted(critical_set.Q, roundings * np.abs(critical_set.Q).max())
            yield gradient(G, K, Q), np.zeros(G.dimension)
            slopes = [rate_of(gradient(G, K, with_rate(Q, critical_set.Q @ E))) for E in G.basis]
            hessian, _ = value_of(stack(slopes))
            eigenvalues = np.linalg.eigvalsh((hessian + hessian.T) / 2)
            scale = np.abs(eigenvalues).max()
            yield lifted(critical_set.hessian, roundings * len(eigenvalues) * scale), eigenvalues
            falls, flat = eigenvalues < -FLAT * scale, np.abs(eigenvalues) <= FLAT * scale
            yield (
                np.array([critical_set.index, critical_set.nullity]),
                np.array([falls.sum(), flat.sum()]),
            )


class StabilisingControl(certificates.LiteralForm):
    """τ = Ṡ*S⁻* P − K_d V − L*_Q d(Υ ∘ R_{Q_target⁻¹}), the gradient term by term from Υ."""

    name: ClassVar[str] = "stabilising control"
    statement: ClassVar[str] = "Theorem 3.2, eq. (11)"
    section: ClassVar[float] = 3.2
    law: ClassVar[str] = "stabilising"

    def torque(self, s: Tracking, law: Any) -> Array:
        """Return the sum of its terms; an option leaves out the feedforward."""
        G, K, moved = s.G, s.gains.K, (with_rate(s.Q, s.Q @ E) for E in s.G.basis)
        # d/dε Υ(Q exp(εE) Q_target⁻¹).
        shaping = stack([rate_of(potential(G, K, Q @ G.inverse(s.Qd))) for Q in moved])
        feedforward = s.inertia.feedforward(s.V) if law.feedforward else 0.0
        return feedforward - apply_matrix(s.gains.K_d, s.V) - shaping
