"""The parts of a closed loop: their places in a configuration and their names in messages."""

from typing import Any, NamedTuple

from eqt_cli.closed_loop.system import ClosedLoop
from eqt_cli.core.errors import KeyPath, parse_key
from eqt_cli.core.registry import is_foreign
from eqt_cli.vehicle.actuators import Actuator
from eqt_cli.vehicle.estimators import Estimator
from eqt_cli.vehicle.forces import Force
from eqt_cli.vehicle.sensors import Sensor


class LoopPart(NamedTuple):
    """A part of a closed loop.

    Attributes
    ----------
    path
        Its place in the configuration.
    name
        Its name in messages, ``controller 'eqt'``; its place if it has no name.
    """

    part: Any
    path: KeyPath
    name: str

    @property
    def is_foreign(self) -> bool:
        """Whether the part is the user's own code."""
        return is_foreign(type(self.part).__module__)


def parts_of(loop: ClosedLoop, index: int = 0) -> list[LoopPart]:
    """Return the parts of a loop; the first is its law, number `index` of the controllers."""
    law, reference, group = loop.controller, loop.reference, loop.group
    return [
        LoopPart(law, ("controllers", index), f"controller '{law.name}'"),
        LoopPart(reference, ("reference",), f"reference '{reference.name}'"),
        LoopPart(group, ("group",), f"group '{group.name}'"),
        *vehicle_parts(loop),
    ]


def vehicle_parts(loop: ClosedLoop) -> list[LoopPart]:
    """Return the parts of the vehicle, between the law and the motion."""
    return [
        LoopPart(part, parse_key(place), _name(part, place))
        for place, part in loop.vehicle.parts.items()
    ]


def _name(part: Any, place: str) -> str:
    kind = next(
        (kind for kind in (Force, Actuator, Sensor, Estimator) if isinstance(part, kind)), None
    )
    return f"'{place}'" if kind is None else f"{kind.__name__.lower()} '{part.name}'"
