"""The rate of S = Ad_{Q_d⁻¹} along the reference."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from eqt_cli.analysis.bounded import rate_of
from eqt_cli.analysis.certificates.base import Identity
from eqt_cli.analysis.certificates.sample import Sample
from eqt_cli.core.arrays import Array


class SDot(Identity):
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
