"""The closed loop: group, mechanics, reference and controller as one differential equation."""

from eqt_cli.closed_loop.error_system import ErrorSystem
from eqt_cli.closed_loop.layout import StateLayout
from eqt_cli.closed_loop.own_starts import OwnStarts
from eqt_cli.closed_loop.reference_system import ReferenceSystem
from eqt_cli.closed_loop.system import ClosedLoop

__all__ = ["ClosedLoop", "ErrorSystem", "OwnStarts", "ReferenceSystem", "StateLayout"]
