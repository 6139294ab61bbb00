"""The group, its algebra and their duals (§2), and the semidirect product G ⋉ g* (§4)."""

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from eqt_cli.analysis.certificates.base import Identity
from eqt_cli.analysis.evidence.numbers import UNIT, floats, lifted, rate_of, value_of
from eqt_cli.analysis.evidence.sample import Sample
from eqt_cli.core.arrays import Array, dot
from eqt_cli.mechanics.lie_poisson import lie_poisson

CLOSED_FORM_ROUNDINGS = 64
"""Allowed error of `exp`, `log` and `drift` in unit roundoffs of 1 plus the largest coordinate. On
all groups of eqt they err by fewer than 15 (measured)."""

TERMS = 14
"""Number of terms of the series of exp at a sixteenth of a random velocity, down to rounding."""

PUSH = 1e-3
"""Relative scaling of a rotation that `drift` must detect."""


class DualAdjoint(Identity):
    """⟨Ad*_Q P, U⟩ = ⟨P, Q U^ Q⁻¹⟩, and Q Q⁻¹ = I."""

    name: ClassVar[str] = "Ad* is the dual of conjugation"
    statement: ClassVar[str] = "eq. (1)"
    section: ClassVar[float] = 2.0

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """Both contractions, and the inverse that they use."""
        G, (U, P) = sample.G, sample.inputs[0]
        Q = sample.states[0][0]
        conjugate = G.vee(Q @ G.hat(U) @ G.inverse(Q))
        yield dot(G.Ad_star(Q, P), U), dot(P, conjugate)
        yield Q @ G.inverse(Q), G.identity


class DualBracket(Identity):
    """⟨ad*_V P, U⟩ = ⟨P, V^U^ − U^V^⟩, which fixes the sign of ad*."""

    name: ClassVar[str] = "ad* is the dual of the bracket"
    statement: ClassVar[str] = "eq. (2)"
    section: ClassVar[float] = 2.1

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """Both contractions."""
        G, ((V, P), (U, _)) = sample.G, sample.inputs
        bracket = G.hat(V) @ G.hat(U) - G.hat(U) @ G.hat(V)
        yield dot(G.ad_star(V, P), U), dot(P, G.vee(bracket))


class Exponential(Identity):
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


class Drift(Identity):
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


class SemidirectGroup(Identity):
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


class LeftInvariance(Identity):
    """f_U(X) = DL_X[U], where DL_X[U] is the rate of X·(exp(tV), tτ) at t = 0."""

    name: ClassVar[str] = "left invariance"
    statement: ClassVar[str] = "Theorem 4.1"
    section: ClassVar[float] = 4.1

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The vector field against the derivative of the product."""
        X, U = sample.states[0], sample.inputs[0]
        moved = sample.semidirect.compose(X, sample.near_identity(U))
        field = lie_poisson(sample.G, *X, *U)
        yield from zip(field, map(rate_of, moved), strict=True)


class Equivariance(Identity):
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
