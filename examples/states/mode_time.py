"""How long the mode of the hybrid law is positive."""

from dataclasses import dataclass
from typing import Any, ClassVar

from eqt_cli.extend import Array, Metric, SampledRuns, less, where


@dataclass(frozen=True)
class ModeTime(Metric):
    """Time with a positive mode."""

    name: ClassVar[str] = "mode_time"
    signals: ClassVar[tuple[str, ...]] = ("mode",)
    units: ClassVar[str] = "s"
    better: ClassVar[str] = "neither"

    def of(self, over: SampledRuns, mode: Any) -> Array:
        """∫ [h > 0] dt."""
        return over.integral(where(less(0.0, mode), 1.0, 0.0))
