"""The extended Lie-Poisson system is equivariant under right translation."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from eqt_cli.analysis.bounded import rate_of
from eqt_cli.analysis.certificates.base import Identity
from eqt_cli.analysis.certificates.sample import Sample
from eqt_cli.core.arrays import Array
from eqt_cli.mechanics.lie_poisson import lie_poisson


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
