"""The closed loop: group, mechanics, reference and controller as one differential equation."""

from eqt_cli.closed_loop.error_system import ErrorSystem
from eqt_cli.closed_loop.layout import StateLayout
from eqt_cli.closed_loop.system import ClosedLoop

__all__ = ["ClosedLoop", "ErrorSystem", "StateLayout"]
