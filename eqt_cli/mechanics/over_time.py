"""Base class of components that are given over time, in a file or in pieces."""

from collections.abc import Mapping
from typing import Any, Self

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup


class GivenOverTime:
    """A component of a loop that may be given over time, in a file or in pieces."""

    def ends(self, G: MatrixLieGroup) -> tuple[float, float]:
        """Return the times between which it is given, s."""
        return -np.inf, np.inf

    def gaps(self, G: MatrixLieGroup) -> list[tuple[float, float]]:
        """Return the begin and the length of each gap, s."""
        return []

    # Files of the component.

    @property
    def files(self) -> dict[str, str]:
        """The files that it needs, relative to the configuration, by the options that name them."""
        return {}

    def with_files(self, texts: Mapping[str, str]) -> Self:
        """Return the component with the contents of its files, given by their names."""
        return self

    # Instants, known in advance, at which it changes.

    def instants(self, G: MatrixLieGroup, until: float) -> Array:
        """Return the sorted times up to `until` at which an engine must end a step, s."""
        return np.empty(0)

    def held(self, G: MatrixLieGroup, t: Any) -> Any:
        """Return the component from time t to the next instant, with that piece's numbers.

        None if no number changes at the instants.
        """
        return None
