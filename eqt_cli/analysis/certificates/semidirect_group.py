"""The semidirect product G ⋉ g* and the symmetries of the Lie-Poisson system (§4, §9)."""

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from eqt_cli.analysis.certificates.base import Identity
from eqt_cli.analysis.evidence.numbers import rate_of
from eqt_cli.analysis.evidence.sample import Sample
from eqt_cli.core.arrays import Array
from eqt_cli.mechanics.lie_poisson import lie_poisson


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


class AppendixTranslations(Identity):
    """DL_Y[U] and DR_Y[U] as the rates of Y·(exp(tV), tτ) and (exp(tV), tτ)·Y."""

    name: ClassVar[str] = "translations of G ⋉ g*"
    statement: ClassVar[str] = "eq. (25), (26)"
    section: ClassVar[float] = 9.1

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The closed forms against the derivatives of products."""
        S, Y, U = sample.semidirect, sample.states[0], sample.inputs[0]
        curve = sample.near_identity(U)
        yield from zip(S.left(Y, U), map(rate_of, S.compose(Y, curve)), strict=True)
        yield from zip(S.right(Y, U), map(rate_of, S.compose(curve, Y)), strict=True)


class AppendixAdjoint(Identity):
    """Ad_Y U as the rate of Y·(exp(tV), tτ)·Y⁻¹, and ad_W U as that of Ad along W."""

    name: ClassVar[str] = "Ad and ad of G ⋉ g*"
    statement: ClassVar[str] = "eq. (27), (28)"
    section: ClassVar[float] = 9.2

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The closed forms against derivatives; a matrix rate is compared as a matrix."""
        S, Y, (U, W) = sample.semidirect, sample.states[0], sample.inputs
        conjugate = S.compose(S.compose(Y, sample.near_identity(U)), S.inverse(Y))
        V, tau = S.Ad(Y, U)
        yield rate_of(conjugate[0]), sample.G.hat(V)
        yield rate_of(conjugate[1]), tau
        rates = map(rate_of, S.Ad(sample.near_identity(W), U))
        yield from zip(S.ad(W, U), rates, strict=True)
