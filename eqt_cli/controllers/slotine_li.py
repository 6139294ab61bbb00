"""The law of Slotine and Li without its adaptation, on any group."""

from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.controllers.sliding_variable import SlidingVariable
from eqt_cli.core.arrays import Array
from eqt_cli.mechanics.tracking import Tracking


@dataclass(frozen=True)
class SlotineLi(SlidingVariable):
    """Slotine and Li (1987) on a group, with known inertia; a slope of its own, not matched.

    reaching = K_d s. Int. J. Robotics Research 6 (3), 49-59, written for manipulators; the form on
    groups is that of the design of eqt, and the paper could not be opened where this was written.
    """

    name: ClassVar[str] = "slotine_li"
    title: ClassVar[str] = "Slotine–Li"
    theorem: ClassVar[str] = "Slotine, Li (1987)"

    def reaching(self, r: Tracking) -> Array:
        """K_d s."""
        return r.body_damping
