"""What a distribution of initial velocities is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup


@dataclass(frozen=True)
class VelocityDistribution(ABC):
    """A distribution on g: a frozen dataclass whose fields are its options.

    Run k starts at V(0) = V_d(0) + draw.
    """

    name: ClassVar[str]
    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid", "strict": True}

    @abstractmethod
    def draw(self, G: MatrixLieGroup, generator: np.random.Generator) -> Array:
        """Algebra coordinates of one element of g, ``(m,)``."""

    def problems(self, G: MatrixLieGroup) -> list[tuple[str, str]]:
        """What of its options does not fit the group, as (option, message)."""
        return []
