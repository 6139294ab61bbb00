"""The extended Lie-Poisson system is left-invariant on G ⋉ g*."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from eqt_cli.analysis.bounded import rate_of
from eqt_cli.analysis.certificates.base import Identity
from eqt_cli.analysis.certificates.sample import Sample
from eqt_cli.core.arrays import Array
from eqt_cli.mechanics.lie_poisson import lie_poisson


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
