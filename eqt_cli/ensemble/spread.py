"""Independent normals, which several distributions are made of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.numbers import Real
from eqt_cli.core.problems import Problems


@dataclass(frozen=True)
class Spread:
    """Independent normals around 0.

    Attributes
    ----------
    std
        Standard deviation of every entry, or one per entry; in the unit of what is drawn.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid", "strict": True}

    std: Real | list[Real] = 1.0

    def draw(self, length: int, generator: np.random.Generator) -> Array:
        """`length` independent normals."""
        return np.asarray(self.std) * generator.standard_normal(length)

    def check(self, length: int, problems: Problems) -> None:
        """Note a wrong number of standard deviations, or a negative one."""
        problems = problems.at("std")
        if isinstance(self.std, list) and len(self.std) != length:
            got = f"got a list of {len(self.std)}"
            problems.add(f"expected a number or a list of {length}, {got}")
        elif np.min(self.std) < 0:
            problems.add(f"expected no negative standard deviation, got {np.min(self.std):g}")
