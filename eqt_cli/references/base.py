"""What a reference is: the force that drives the desired Lie-Poisson system."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

from eqt_cli.core.arrays import Array
from eqt_cli.core.component import Component
from eqt_cli.core.problems import Problems
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.inertia import Inertia


@dataclass(frozen=True)
class Reference(Component):
    """A desired trajectory, integrated with each run from Q_d(0) and V_d(0).

    A frozen dataclass whose fields are its options in a configuration, beside `pose` and
    `velocity`, which every reference takes.
    """

    keeps_velocity: ClassVar[bool] = False
    """Whether V_d(t) = V_d(0) by construction."""

    @abstractmethod
    def driving_torque(self, G: MatrixLieGroup, inertia: Inertia, t: Any, Pd: Array) -> Array:
        """τ_d at time t, body frame, ``(..., m)``."""

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note what of its options does not fit the group."""
