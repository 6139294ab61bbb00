"""Initial poses of a product of groups, from one distribution per factor."""

from dataclasses import dataclass

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.ensemble.poses import PoseDistribution
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.groups.product import ProductGroup


@dataclass(frozen=True)
class FactorPoses(PoseDistribution):
    """Independent draws for each factor, in their order."""

    factors: tuple[PoseDistribution, ...]

    def draw(self, G: MatrixLieGroup, generator: np.random.Generator) -> Array:
        """The numbers of all factors."""
        return np.concatenate([own.draw(factor, generator) for own, factor in self._by_factor(G)])

    def place(self, G: MatrixLieGroup, numbers: Array) -> Array:
        """The poses of all factors as blocks."""
        assert isinstance(G, ProductGroup)
        pairs = self._by_factor(G)
        lengths = [len(own.draw(factor, np.random.default_rng(0))) for own, factor in pairs]
        columns = np.split(numbers, np.cumsum(lengths)[:-1], axis=1)
        blocks = zip(pairs, columns, strict=True)
        return G.assemble([own.place(factor, part) for (own, factor), part in blocks])

    def _by_factor(self, G: MatrixLieGroup) -> list[tuple[PoseDistribution, MatrixLieGroup]]:
        assert isinstance(G, ProductGroup)  # the configuration gives it no other
        return list(zip(self.factors, G.factors, strict=True))
