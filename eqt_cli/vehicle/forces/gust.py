"""Gusts: a smooth random force, a sum of sines whose phases each run draws."""

from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Self

import numpy as np

from eqt_cli.core.arrays import Array, as_array, sin
from eqt_cli.core.errors import Problems
from eqt_cli.core.leaves import with_fields
from eqt_cli.core.option_types import TORQUE, Scale, Unit
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.component import Number, Numbers, check_deviations, check_numbers
from eqt_cli.vehicle.forces.base import Force

SINES = 12
"""Number of sines per coordinate; each carries the same part of the variance."""

SHARES = np.tan(np.pi / 2 * (np.arange(SINES) + 0.5) / SINES)
"""ωT in the middle of each part of the spectrum of an Ornstein-Uhlenbeck process."""


@dataclass(frozen=True)
class Gust(Force):
    """A force with the spectrum of an Ornstein-Uhlenbeck process, its coordinates independent.

    Each coordinate is a sum of sines of equal amplitude, with frequencies that divide the spectrum
    2σ²T / (1 + ω²T²) into equal parts, and with phases that each run draws: its variance is σ².

    Attributes
    ----------
    std
        σ of every coordinate, or a list of m.
    time_constant
        T, s: after this time the correlation has come down to 1/e.
    """

    name: ClassVar[str] = "gust"
    departs: ClassVar[str] = "gusts"
    vectors: ClassVar[tuple[str, ...]] = ("std",)
    positive: ClassVar[tuple[str, ...]] = ("time_constant",)

    std: Annotated[Numbers, Unit(TORQUE)]
    time_constant: Annotated[Number, Scale("time constant of the gust", "s")]
    amplitude: Any = field(default=None, init=False, repr=False)
    frequency: Any = field(default=None, init=False, repr=False)
    phase: Any = field(default=None, init=False, repr=False)

    @property
    def varies(self) -> bool:
        """Whether numbers differ from run to run: the phases always do."""
        return True

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return the gust with its sines: amplitude ``(m,)``, frequency and phase.

        Frequencies are ``(sines, 1)``, phases ``(sines, m)``.
        """
        part, m = self.drawn(random), G.dimension
        shape = SINES, m
        return with_fields(
            part,
            std=None,
            time_constant=None,
            amplitude=np.sqrt(2 / SINES) * np.broadcast_to(np.array(part.std, dtype=float), (m,)),
            frequency=(SHARES / part.time_constant)[:, None],
            phase=np.zeros(shape) if random is None else random.uniform(0.0, 2 * np.pi, shape),
        )

    def acting(self, G: MatrixLieGroup, t: Any, Q: Array, V: Array) -> Array:
        """Return Σ a sin(ω t + φ)."""
        frequency, phase = self.frequency, self.phase
        waves = [sin(frequency[..., k, :] * _column(t, V) + phase[..., k, :]) for k in range(SINES)]
        return self.amplitude * sum(waves)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note negative deviations, a time constant that is not positive, and a wrong length."""
        check_deviations(self.std, G, problems.at("std"))
        check_numbers(self.time_constant, problems.at("time_constant"), positive=True)


def _column(t: Any, V: Array) -> Any:
    """Return times ``(samples,)`` as a column that broadcasts with V; one time as it is."""
    times = as_array(t)
    return times[..., None] if times.ndim else t
