"""Initial poses of a product of groups, from one distribution per factor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

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
        return np.concatenate([draw(generator) for draw in self._draws(G)])

    def place(self, G: MatrixLieGroup, numbers: Array) -> Array:
        """The poses of all factors as blocks."""
        assert isinstance(G, ProductGroup)
        lengths = [len(draw(np.random.default_rng(0))) for draw in self._draws(G)]
        columns = np.split(numbers, np.cumsum(lengths)[:-1], axis=1)
        return G.assemble(
            [
                distribution.place(factor, part)
                for distribution, factor, part in zip(self.factors, G.factors, columns, strict=True)
            ]
        )

    def _draws(self, G: MatrixLieGroup) -> list[Callable[[np.random.Generator], Array]]:
        assert isinstance(G, ProductGroup)  # the configuration gives it no other
        return [
            partial(distribution.draw, factor)
            for distribution, factor in zip(self.factors, G.factors, strict=True)
        ]
