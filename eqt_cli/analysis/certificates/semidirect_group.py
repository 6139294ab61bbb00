"""The product (15) makes G × g* a group."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from eqt_cli.analysis.certificates.base import Identity
from eqt_cli.analysis.certificates.sample import Sample
from eqt_cli.core.arrays import Array


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
