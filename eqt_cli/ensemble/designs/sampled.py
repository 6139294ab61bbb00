"""Base class of designs that map points of the unit cube to ranges."""

from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from eqt_cli.core.arrays import Array
from eqt_cli.core.option_types import CountOrNone, Points
from eqt_cli.core.problems import KeyPath, Problems
from eqt_cli.ensemble.axes import SampledAxis
from eqt_cli.ensemble.designs.base import Design


@dataclass(frozen=True, kw_only=True)
class Sampled(Design):
    """Points in the unit cube, mapped to the axes.

    Attributes
    ----------
    points
        The number of points.
    seed
        The seed of the design's random stream.
    axes
        The range or the choices of each key.
    """

    points: Points
    seed: CountOrNone = 0
    axes: Annotated[dict[str, SampledAxis], Field(min_length=1)]

    @cached_property
    def keys(self) -> tuple[str, ...]:  # type: ignore[override]  # derived
        """The keys of the axes."""
        return tuple(self.axes)

    def check(self, problems: Problems) -> None:
        """Note invalid ranges."""
        for key, axis in self.axes.items():
            axis.check(problems.at("axes", key))

    @abstractmethod
    def shares(self, generator: np.random.Generator) -> Array:
        """Return all points in the unit cube, ``(points, axes)``."""

    @cached_property
    def _shares(self) -> Array:
        return self.shares(np.random.Generator(np.random.PCG64DXSM(self.seed)))

    def __getstate__(self) -> dict[str, Any]:
        return {"points": self.points, "seed": self.seed, "axes": self.axes}

    def __len__(self) -> int:
        return self.points

    def values(self, point: int) -> tuple[Any, ...]:
        shares = self._shares[point].tolist()
        return tuple(axis.at(share) for axis, share in zip(self.axes.values(), shares, strict=True))

    def place(self, point: int, key: str) -> KeyPath:
        return ("axes", key)
