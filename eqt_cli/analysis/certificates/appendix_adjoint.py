"""The adjoint map of G ⋉ g* and its derivative, the bracket."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from eqt_cli.analysis.bounded import rate_of
from eqt_cli.analysis.certificates.base import Identity
from eqt_cli.analysis.certificates.sample import Sample
from eqt_cli.core.arrays import Array


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
