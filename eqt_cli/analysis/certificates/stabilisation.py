"""Mechanical systems and their stabilisation, for an inertia that may vary in time (§3)."""

from collections.abc import Iterator
from typing import Any, ClassVar

import numpy as np

from eqt_cli.analysis.certificates.base import Identity, LiteralForm
from eqt_cli.analysis.evidence.numbers import (
    UNIT,
    floats,
    granted,
    lifted,
    rate_of,
    value_of,
    with_rate,
)
from eqt_cli.analysis.evidence.sample import Sample
from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.core.arrays import Array, apply_matrix, dot, stack, transpose
from eqt_cli.mechanics.critical_points import critical_sets
from eqt_cli.mechanics.inertia import FactoredInertia, Inertia
from eqt_cli.mechanics.navigation import gradient, potential
from eqt_cli.mechanics.tracking import Tracking

FLAT = 1e-9
"""Eigenvalues of a Hessian below this share of the largest count as 0."""


class Momentum(Identity):
    """P = 𝕀_t V: a state made from poses and velocities at a time t returns them at that time."""

    name: ClassVar[str] = "momentum of a velocity"
    statement: ClassVar[str] = "eq. (6)"
    section: ClassVar[float] = 3.05

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """Compare a law's arguments with the poses and velocities of the state."""
        s, (Q, V, Qd, Vd) = sample.s, sample.drawn
        yield s.Q, Q
        yield s.Qd, Qd
        for tracked, velocity, lost in zip((s.V, s.Vd), (V, Vd), sample.lost, strict=True):
            yield tracked, granted(velocity, lost)


class ReferenceMotion(Identity):
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


class InertiaRate(Identity):
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


class NavigationGradient(Identity):
    """d/dt Υ(Q) = ⟨L*_Q dΥ, V⟩ along Q̇ = Q V^."""

    name: ClassVar[str] = "gradient of Υ"
    statement: ClassVar[str] = "Example 3.4, eq. (13)"
    section: ClassVar[float] = 3.4

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The rate of Υ against the contraction with its gradient."""
        G, K, (Q, P), (V, _) = sample.G, sample.loop.gains.K, sample.states[0], sample.inputs[0]
        along, _ = sample.moving((Q, P), (Q @ G.hat(V), 0 * P))
        yield rate_of(potential(G, K, along)), dot(gradient(G, K, Q), V)


class CriticalPoints(Identity):
    """dΥ = 0 at the known critical points, with the stated Hessian and index."""

    name: ClassVar[str] = "critical points of Υ"
    statement: ClassVar[str] = "Definition 2.1, Example 3.4"
    section: ClassVar[float] = 3.41
    not_rational: ClassVar[str] = "eigenvalues are roots of polynomials"

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The gradient there, and the eigenvalues of its derivative along the group."""
        G, K = sample.G, value_of(sample.loop.gains.K)[0]
        roundings = 16 * len(K) * UNIT * np.linalg.cond(K)
        for each in critical_sets(G, K) or ():
            Q = lifted(each.Q, roundings * np.abs(each.Q).max())
            yield gradient(G, K, Q), np.zeros(G.dimension)
            slopes = [rate_of(gradient(G, K, with_rate(Q, each.Q @ E))) for E in G.basis]
            hessian, _ = value_of(stack(slopes))
            eigenvalues = np.linalg.eigvalsh((hessian + hessian.T) / 2)
            scale = np.abs(eigenvalues).max()
            yield lifted(each.hessian, roundings * len(eigenvalues) * scale), eigenvalues
            falls, flat = eigenvalues < -FLAT * scale, np.abs(eigenvalues) <= FLAT * scale
            yield np.array([each.index, each.nullity]), np.array([falls.sum(), flat.sum()])


class StabilisingControl(LiteralForm):
    """τ = Ṡ*S⁻* P − K_d V − L*_Q d(Υ ∘ R_{Q_target⁻¹}), the gradient term by term from Υ."""

    name: ClassVar[str] = "stabilising control"
    statement: ClassVar[str] = "Theorem 3.2, eq. (11)"
    section: ClassVar[float] = 3.2
    law: ClassVar[str] = "stabilising"

    def torque(self, s: Tracking, law: Any) -> Array:
        """Return the sum of its terms; an option leaves out the feedforward."""
        shaping = stack([_slope(s, E) for E in np.eye(s.G.dimension)])
        feedforward = s.inertia.feedforward(s.V) if law.feedforward else 0.0
        return feedforward - apply_matrix(s.gains.K_d, s.V) - shaping


def _slope(s: Tracking, E: Array) -> Array:
    """d/dε Υ(Q exp(εE) Q_target⁻¹)."""
    Q = with_rate(s.Q, s.Q @ s.G.hat(E))
    return rate_of(potential(s.G, s.gains.K, Q @ s.G.inverse(s.Qd)))
