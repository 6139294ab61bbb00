"""Fixes over a radio that fails for a while."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from eqt_cli.extend import Array, MatrixLieGroup, Numbers, Problems, Real, Sensor


@dataclass(frozen=True)
class Radio(Sensor):
    """White noise, and losses that come in bursts.

    Attributes
    ----------
    std
        Standard deviation of a fix; one number, or a list.
    fails, recovers
        The probabilities that a radio that works fails by the next fix, and that one that has
        failed works again.
    """

    name: ClassVar[str] = "radio"
    departs: ClassVar[str] = "fixes over a radio that fails"

    std: Numbers
    fails: Real = 0.1
    recovers: Real = 0.3

    @property
    def loses(self) -> bool:
        """Where it can fail."""
        return self.fails > 0

    def errors(
        self, G: MatrixLieGroup, instants: int, period: float, random: np.random.Generator
    ) -> Array:
        """std · N(0, 1) along each coordinate that it measures."""
        part = self.drawn(random)
        normals = random.standard_normal((instants, self.coordinates(G)))
        return self.entries(part.std, G) * normals

    def lost(self, measurements: int, random: np.random.Generator) -> Array:
        """Every fix while the radio has failed."""
        losses, failed = np.zeros(measurements, dtype=bool), False
        for k, number in enumerate(random.random(measurements)):
            failed = number >= self.recovers if failed else number < self.fails
            losses[k] = failed
        return losses

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """A negative deviation, a wrong count, probabilities that are none."""
        self.check_entries(self.std, G, problems.at("std"), deviations=True)
        for name in ("fails", "recovers"):
            if not 0 <= getattr(self, name) <= 1:
                problems.at(name).add("expected a probability")
