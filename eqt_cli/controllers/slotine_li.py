"""A law after Slotine and Li without their adaptation, on any group."""

from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.controllers.sliding_variable import SlidingVariable
from eqt_cli.core.arrays import Array
from eqt_cli.mechanics.tracking import Tracking


@dataclass(frozen=True)
class SlotineLi(SlidingVariable):
    """After Slotine and Li (1987), with known inertia; uses its own slope (gains not matched).

    reaching = K_d s. Int. J. Robotics Research 6 (3), 49-59, written for manipulators; the form on
    groups is that of the design of eqt, and the paper was not read.
    """

    name: ClassVar[str] = "slotine_li"
    title: ClassVar[str] = "Slotine–Li"
    theorem: ClassVar[str] = "after Slotine, Li (1987)"
    bibtex: ClassVar[str] = """\
@article{slotine1987adaptive,
  author  = {Slotine, Jean-Jacques E. and Li, Weiping},
  title   = {On the Adaptive Control of Robot Manipulators},
  journal = {The International Journal of Robotics Research},
  volume  = {6},
  number  = {3},
  pages   = {49--59},
  year    = {1987}
}"""

    def reaching(self, r: Tracking) -> Array:
        """K_d s."""
        return r.body_damping
