"""The closed loop: group, mechanics, reference and controller as one differential equation."""

from eqt_cli.closed_loop.layout import StateLayout
from eqt_cli.closed_loop.reference_system import ReferenceSystem
from eqt_cli.closed_loop.system import ClosedLoop, OwnStarts

__all__ = ["ClosedLoop", "OwnStarts", "ReferenceSystem", "StateLayout"]
