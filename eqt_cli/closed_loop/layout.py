"""The layout of a flat state: named stretches of numbers, one after the other."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array


@dataclass(frozen=True)
class StateLayout:
    """Names and lengths of the stretches of a flat state, in order.

    A part of the loop that has states adds a stretch.

    Attributes
    ----------
    lengths
        Length of each stretch.
    """

    lengths: Mapping[str, int]

    @property
    def length(self) -> int:
        """The number of entries of a flat state."""
        return sum(self.lengths.values())

    @cached_property
    def slices(self) -> dict[str, slice]:
        """The slice of each stretch in a flat state."""
        pairs = zip(self.lengths.items(), accumulate(self.lengths.values()), strict=True)
        return {name: slice(end - length, end) for (name, length), end in pairs}

    def split(self, state: Array) -> dict[str, Array]:
        """Split flat states ``(..., length)`` into their stretches."""
        return {name: state[..., where] for name, where in self.slices.items()}

    def join(self, stretches: Mapping[str, Any], like: Array) -> Array:
        """Join stretches to flat states, of the shape and type of `like`; undoes `split`.

        Stretches that the layout does not have are left out.
        """
        state = np.empty_like(like)
        for name, where in self.slices.items():
            state[..., where] = stretches[name]
        return state
