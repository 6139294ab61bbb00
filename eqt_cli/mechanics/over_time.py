"""What is given over time, in files and in pieces; it knows no kind of component."""

from collections.abc import Mapping
from typing import Any, Self

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup


class GivenOverTime:
    """A component of a loop of which some is given over time: in a file, or piece by piece."""

    def ends(self, G: MatrixLieGroup) -> tuple[float, float]:
        """The times, s, between which it is given."""
        return -np.inf, np.inf

    def gaps(self, G: MatrixLieGroup) -> list[tuple[float, float]]:
        """Where it is not: when a gap begins, and how long it is, s."""
        return []

    # Files that hold a part of it.

    @property
    def files(self) -> dict[str, str]:
        """The files that it needs, relative to the configuration, by the option that names each."""
        return {}

    def with_files(self, texts: Mapping[str, str]) -> Self:
        """The same with the contents of its files, by their names."""
        return self

    # Instants that are known in advance, at which it goes on in another way.

    def instants(self, G: MatrixLieGroup) -> Array:
        """The times, s, at which an engine ends a step and begins anew; in order."""
        return np.empty(0)

    def held(self, G: MatrixLieGroup, t: Any) -> dict[str, Array]:
        """The numbers by which it goes on from time t to the next instant, by name."""
        return {}

    def holding(self, held: Mapping[str, Array]) -> Self:
        """The same between two instants, by the numbers of `held`, which may be symbols."""
        return self
