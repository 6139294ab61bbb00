"""The derivatives of the translations of G ⋉ g*."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from eqt_cli.analysis.bounded import rate_of
from eqt_cli.analysis.certificates.base import Identity
from eqt_cli.analysis.certificates.sample import Sample
from eqt_cli.core.arrays import Array


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
