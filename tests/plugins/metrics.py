"""Metrics: of one signal with an option, of a norm that has parts, and of a law's own number."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.extend import Metric, absolute, less, where


@dataclass(frozen=True)
class Outside(Metric):
    """Share of the time in which the pose error is above a limit.

    Attributes
    ----------
    limit
        The limit of ‖I − Q_E‖_F.
    """

    name: ClassVar[str] = "time_outside"
    signals: ClassVar[tuple[str, ...]] = ("pose_error",)
    units: ClassVar[str] = "1"
    better: ClassVar[str] = "lower"
    limit: float = 0.5

    def of(self, over, error):
        return over.mean(where(less(self.limit, error), 1.0, 0.0))


@dataclass(frozen=True)
class Jump(Metric):
    """Largest change of the torque from one sample to the next."""

    name: ClassVar[str] = "torque_jump"
    signals: ClassVar[tuple[str, ...]] = ("torque_norm",)
    units: ClassVar[str] = "{}"
    better: ClassVar[str] = "lower"

    def of(self, over, torque):
        return over.largest(absolute(torque - over.before(torque)))
