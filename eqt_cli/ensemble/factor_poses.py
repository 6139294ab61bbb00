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
        """Return the numbers of all factors."""
        return np.concatenate([each.draw(factor, generator) for each, factor in self._by_factor(G)])

    def place(self, G: MatrixLieGroup, numbers: Array) -> Array:
        """Return the poses of all factors as blocks."""
        assert isinstance(G, ProductGroup)
        pairs = self._by_factor(G)
        lengths = [len(each.draw(factor, np.random.default_rng(0))) for each, factor in pairs]
        columns = np.split(numbers, np.cumsum(lengths)[:-1], axis=1)
        blocks = zip(pairs, columns, strict=True)
        return G.assemble([each.place(factor, part) for (each, factor), part in blocks])

    def _by_factor(self, G: MatrixLieGroup) -> list[tuple[PoseDistribution, MatrixLieGroup]]:
        assert isinstance(G, ProductGroup)  # checked where the configuration is read
        return list(zip(self.factors, G.factors, strict=True))
