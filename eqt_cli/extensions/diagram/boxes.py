"""What a loop consists of, as boxes: one or more for each block of the walk, with their words.

A block of a class that is not known here, such as one of a later version, is a box with its name.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, singledispatch
from typing import Any

from eqt_cli.base.errors import parse_key
from eqt_cli.base.option_types import INERTIA, POSE, VELOCITY, UnitPlace, plain_data
from eqt_cli.base.reporting import brief, count_of
from eqt_cli.base.units import base_of
from eqt_cli.components.actuators import THRUSTS
from eqt_cli.components.blocks import (
    Actuated,
    Arrived,
    Block,
    Burning,
    Clocks,
    Commands,
    Estimating,
    Feeling,
    Forces,
    Held,
    Noisy,
    Reading,
)
from eqt_cli.components.forces import Force
from eqt_cli.components.laws import Controller, OuterLoop
from eqt_cli.components.sensors import TIMING, Channel, DynamicSensor, Sensor
from eqt_cli.components.vehicle import (
    ACTUATORS,
    CLOCKS,
    ESTIMATOR,
    FORCES,
    INNER,
    exactly_measured,
    place_of,
)
from eqt_cli.components.vehicle import VELOCITY as VELOCITY_SENSORS
from eqt_cli.extensions.diagram.wires import Wire, observed
from eqt_cli.extensions.diagram.wording import (
    option_texts,
    time_text,
    unit_text,
    value_text,
    with_units,
)
from eqt_cli.loop.closed_loop import ClosedLoop, Law

REFERENCE, LAW, ACTUATION, PLANT, SENSING, ESTIMATION = STAGES = (
    "reference",
    "law",
    "actuators",
    "plant",
    "sensors",
    "estimator",
)
"""The stages of a loop, in the order of its signals."""


SIGNAL_PORTS = "command", "arrived", "output"
"""The ports with the signal that passes actuators one after the other."""


@dataclass(frozen=True)
class Box:
    """A box of the diagram.

    Attributes
    ----------
    place
        Where it stands in the configuration, or the name of its block.
    title, lines
        Its words.
    blocks
        The names of the blocks that it stands for.
    is_ideal
        Whether it leaves signals as they are.
    beside
        Whether signals do not pass it one after the other, as with forces.
    gives
        Symbol and unit of its output.
    """

    place: str
    title: str
    lines: tuple[str, ...] = ()
    blocks: tuple[str, ...] = ()
    is_ideal: bool = False
    beside: bool = False
    gives: tuple[str, ...] = ()


@dataclass(frozen=True)
class Loop:
    """A loop with what is written about it.

    Attributes
    ----------
    config
        Its configuration as it is written; may be empty.
    index
        The number of its law among `controllers`.
    gains
        The gains of the law, in words.
    varied
        Options of the law that other laws of its class have otherwise.
    """

    loop: ClosedLoop
    config: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    index: int = 0
    gains: tuple[str, ...] = ()
    varied: frozenset[str] = frozenset()

    @cached_property
    def walk(self) -> tuple[dict[str, Block], list[Wire]]:
        """The blocks by name, and the wires."""
        return observed(self.loop)

    @property
    def blocks(self) -> dict[str, Block]:
        """The blocks by name, in the order of the walk."""
        return self.walk[0]

    def written(self, place: str) -> Any:
        """Return what the configuration says at a place; None if nothing."""
        section: Any = self.config
        path = parse_key(place)
        for key in ("controllers", self.index, *path) if path[0] == INNER else path:
            try:
                section = section[key]
            except (KeyError, IndexError, TypeError):
                return None
        return section

    def configured(self, place: str, part: Any) -> Any:
        """Return the part at a place with its distributions, or the part itself."""
        vehicle = self.loop.vehicle.configured or self.loop.vehicle
        return vehicle.parts.get(place, part)

    def options(self, place: str, part: Any, **more: Any) -> list[str]:
        """Return the options of a part in words."""
        whole = self.configured(place, part)
        if not dataclasses.is_dataclass(whole):
            return []
        return option_texts(whole, self.loop.group, self.written(place), **more)

    def stages(self) -> dict[str, list[Box]]:
        """Return all boxes by stage, in the order of the signals."""
        stages: dict[str, list[Box]] = {stage: [] for stage in STAGES}
        stages[REFERENCE] = [_reference(self)]
        stage = ACTUATION
        for block in self.blocks.values():
            of_block = boxes_of(block, self)
            if isinstance(block, Forces):
                stage = PLANT
            place = LAW if isinstance(block, Law) else stage
            stages[ESTIMATION if isinstance(block, Estimating) else place] += of_block
            stage = SENSING if stage == PLANT else stage
        _note_other_wires(stages, self.walk[1])
        if not stages[ACTUATION]:
            lines = ("the command acts at once", "no limits, no lag")
            stages[ACTUATION] = [Box(ACTUATORS, "ideal", lines, is_ideal=True)]
        return stages


def _note_other_wires(stages: dict[str, list[Box]], wires: Sequence[Wire]) -> None:
    """Add to boxes what they read of actuators other than the signal that passes them."""
    titles = {name: box.title for box in stages[ACTUATION] for name in box.blocks}
    for stage in (ACTUATION, PLANT):
        for k, box in enumerate(stages[stage]):
            for wire in wires:
                key = wire.port.partition(".")[2]
                is_other = wire.reader in box.blocks and wire.block in titles
                if is_other and wire.block not in box.blocks and key not in SIGNAL_PORTS:
                    words = f"reads {key.replace('_', ' ')} of {titles[wire.block]}"
                    box = dataclasses.replace(box, lines=(*box.lines, words))
            stages[stage][k] = box


def force_units(loop: ClosedLoop) -> str:
    """Return the units of a torque on a group: ``N m, N``."""
    return ", ".join(dict.fromkeys(unit_text(part.force_unit) for part in loop.group.parts))


def _reference(loop: Loop) -> Box:
    task, reference = loop.loop.task, loop.loop.reference
    written = loop.config.get("reference") or loop.config.get("target")
    lines = [] if task.kind == "track" else [f"task: {task.kind}"]
    lines += option_texts(reference, loop.loop.group, written)
    if reference.starts_from:
        lines.append("integrated with the loop")
    is_flat = loop.loop.controller.reads_flat_output
    gives = ("p_d, ψ_d",) if is_flat else ("Q_d, V_d",)
    return Box(REFERENCE, reference.name.replace("_", " "), tuple(lines), gives=gives)


# A box for each kind of block ---------------------------------------------------------------------


@singledispatch
def boxes_of(block: Block, loop: Loop) -> list[Box]:
    """Return the boxes of a block; here of one of any other class."""
    words = (type(block).__doc__ or "").strip().partition("\n")[0].rstrip(".")
    is_passed = any(wire.block == block.name for wire in loop.walk[1])
    lines = (words,) if words else ()
    return [Box(block.name, block.name, lines, (block.name,), beside=not is_passed)]


@boxes_of.register
def _law(block: Law, loop: Loop) -> list[Box]:
    law, gives = loop.loop.controller, _command(loop)
    boxes = _boxes_of_law(law, "law", loop)
    taken = tuple(f"takes off {name.replace('_', ' ')}" for name in _forces_in_law(loop))
    boxes[0] = dataclasses.replace(boxes[0], lines=(*boxes[0].lines, *taken))
    more = []
    memory = law.memory(loop.loop.group)
    if memory:
        states = ", ".join(name.replace("_", " ") for name in memory)
        more.append(f"memory: {states}")
    more += [] if loop.loop.vehicle.control else ["acts continuously"]
    last = boxes[-1]
    boxes[-1] = dataclasses.replace(last, lines=(*last.lines, *more), gives=gives)
    return [dataclasses.replace(box, blocks=(block.name,)) for box in boxes]


def _forces_in_law(loop: Loop) -> list[str]:
    """Return the names of the forces that the law takes off; a cascade does so by itself."""
    forces = [*loop.loop.known_forces]
    for name in ("known_forces", "across"):
        taken = getattr(loop.loop.controller, name, ())  # of a plugin, it may be anything
        forces += [x for x in taken if isinstance(x, Force)] if isinstance(taken, tuple) else []
    return [*dict.fromkeys(force.name for force in forces)]


def _boxes_of_law(law: Controller, place: str, loop: Loop) -> list[Box]:
    """Return a law, and the laws inside it, in the order in which they act."""
    inside = {
        field.name: value
        for field in dataclasses.fields(law)
        if isinstance(value := getattr(law, field.name), Controller)
    }
    names = {inner.name for inner in inside.values()}
    described = [
        field.name
        for field in dataclasses.fields(law)
        if field.init and _kind_of(getattr(law, field.name)) in names
    ]
    group = loop.loop.group
    written = loop.written(f"controllers[{loop.index}]") if place == "law" else None
    varied = loop.varied if place == "law" else ()
    lines = option_texts(law, group, written, without=described, always=varied)
    gains = () if inside else loop.gains if law.reads_gains else ()
    box = Box(place, law.title, (*gains, *lines))
    boxes: list[Box] = []
    for name, inner in inside.items():
        boxes += _boxes_of_law(inner, f"{place}.{name}", loop)
    if isinstance(law, OuterLoop) and "inner" in inside:
        box = dataclasses.replace(box, lines=("position loop", *lines), gives=("R_c, Ω_c",))
        boxes[0] = dataclasses.replace(boxes[0], lines=("attitude law", *boxes[0].lines))
        return [box, *boxes]
    if inside and inner.commands == "torque":
        boxes[-1] = dataclasses.replace(boxes[-1], gives=("τ",))
    return [*boxes, box]


def _kind_of(option: Any) -> Any:
    """Return the kind that an option names, if it describes a component."""
    option = option.get("kind") if isinstance(option, Mapping) else option
    return option if isinstance(option, str) else None


def _command(loop: Loop) -> tuple[str, ...]:
    """Return symbol and unit of what the law commands."""
    law, vehicle = loop.loop.controller, loop.loop.vehicle
    if any(part.takes == THRUSTS for part in vehicle.actuators):
        return ("thrusts", "N")
    if law.commands == "rates":
        return ("ω_c", "rad/s")
    return ("m", "A m²") if law.commands == "dipole" else ("τ", force_units(loop.loop))


@boxes_of.register
def _commands(block: Commands, loop: Loop) -> list[Box]:
    control = loop.loop.vehicle.control
    assert control is not None  # without sampling, there is no such block
    lines = [f"every {time_text(control.period)} ({brief(1 / control.period, 3)} Hz)"]
    if control.delay:
        lines.append(f"arrives {time_text(control.delay * control.tick)} later")
    names = [block.name]
    if CLOCKS in loop.blocks:
        lines.append(f"tick of the loop: {time_text(control.tick)}")
        names.append(CLOCKS)
    return [Box(block.name, "sample and hold", tuple(lines), tuple(names), gives=_command(loop))]


@boxes_of.register
def _clocks(block: Clocks, loop: Loop) -> list[Box]:
    return []  # of the box of the commands


@boxes_of.register
def _actuated(block: Actuated, loop: Loop) -> list[Box]:
    place = place_of(loop.loop.vehicle, int(block.name.rpartition("_")[2]))
    part = loop.configured(place, block.part)
    title = part.name.replace("_", " ")
    lines = []
    for of, names in block.part.members.items():
        words = count_of(len(names), of)
        title = words if title == f"{of}s" else title
        lines += [words] if words != title else []
    if allocation := getattr(part, "allocation", None):
        lines.append(f"allocation: {value_text(plain_data(allocation)).replace('_', ' ')}")
    if part.period is not None:
        lines.append(f"acts every {time_text(part.period)}")
    elif block.held:
        lines.append("acts at ticks")
    lines += loop.options(place, part, without=("allocation", "thrusters", "period"))
    gives = ("τ", force_units(loop.loop))
    if place.startswith(INNER):
        lines.insert(0, "block of the law")
    return [Box(place, title, tuple(lines), (block.name,), gives=gives)]


@boxes_of.register
def _held(block: Held, loop: Loop) -> list[Box]:
    gives = ("τ", force_units(loop.loop))
    return [Box(block.name, "hold", ("until the next tick",), (block.name,), gives=gives)]


@boxes_of.register
def _burning(block: Burning, loop: Loop) -> list[Box]:
    return [Box(block.name, "propellant", ("burnt by the thrusters",), (block.name,), beside=True)]


@boxes_of.register
def _forces(block: Forces, loop: Loop) -> list[Box]:
    names, boxes = _forces_in_law(loop), []
    for k, force in enumerate(loop.loop.vehicle.forces):
        place = f"{FORCES}[{k}]"
        lines = loop.options(place, force)
        lines += ["the law knows such a force"] if force.name in names else []
        boxes.append(Box(place, force.name.replace("_", " "), tuple(lines), beside=True))
    if not boxes:
        boxes = [Box(FORCES, "no disturbance", is_ideal=True, beside=True)]
    lines = [f"inertia {_inertia(loop)}"]
    if loop.loop.vehicle.inertia is None:
        lines.append("as the law believes")
    else:
        place = "plant.inertia"
        true = ", ".join(loop.options(place, loop.loop.vehicle.inertia)) or "another one"
        lines = [f"believed {lines[0]}", f"true inertia: {true}"]
    plant = Box(
        "plant", f"body on {loop.loop.group.name}", tuple(lines), (block.name,), gives=("Q, V",)
    )
    return [*boxes, plant]


def _inertia(loop: Loop) -> str:
    inertia, G = loop.loop.inertia.at(0.0), loop.loop.group
    matrix, units = plain_data(inertia.matrix), UnitPlace(G).units(INERTIA)
    diagonal = [row[k] for k, row in enumerate(matrix)]
    named = [(unit_text(base_of(unit)), axes) for unit, axes in units.values()]
    text = with_units(diagonal, named)
    off = any(x for i, row in enumerate(matrix) for k, x in enumerate(row) if i != k)
    varies = type(loop.loop.inertia) is not type(inertia)
    return text + (", coupled" if off else "") + (", varies in time" if varies else "")


@boxes_of.register
def _reading(block: Reading, loop: Loop) -> list[Box]:
    place = _places_of_moving(loop)[int(block.name.rpartition("_")[2])]
    lines = loop.options(place, block.sensor, measured=VELOCITY, without=TIMING)
    return [Box(place, f"{block.sensor.name} of the velocity", tuple(lines), (block.name,))]


def _places_of_moving(loop: Loop) -> list[str]:
    """Return the places of the sensors of the velocity whose states follow the motion."""
    sensors = loop.loop.vehicle.sensors().items()
    moving = [place for place, sensor in sensors if isinstance(sensor, DynamicSensor)]
    return [place for place in moving if place.startswith(VELOCITY_SENSORS)]


@boxes_of.register
def _feeling(block: Feeling, loop: Loop) -> list[Box]:
    return []  # of the box of the accelerometer


@boxes_of.register
def _noisy(block: Noisy, loop: Loop) -> list[Box]:
    vehicle, G = loop.loop.vehicle, loop.loop.group
    names = block.name, *(x.name for x in loop.blocks.values() if isinstance(x, Arrived | Feeling))
    if not vehicle.measures:
        true = ("the law reads the true pose and velocity",)
        return [Box("sensors", "exact", true, names, is_ideal=True, gives=("Q, V",))]
    boxes, measured = [], dict[tuple[str, ...], list[Channel]]()
    moving = _places_of_moving(loop)  # which have blocks
    sensors = {place: x for place, x in vehicle.sensors().items() if place not in moving}
    for channel in vehicle.channels(G):
        at = [place for place, sensor in sensors.items() if _measures(sensor, place, channel)]
        measured.setdefault((channel.signal, *at), []).append(channel)
    for (signal, *places), channels in measured.items():
        parts = [channel.part.name for channel in channels]
        is_part = signal in (POSE, VELOCITY) and len(parts) < len(G.parts)
        title = f"{signal}: {', '.join(parts)}" if is_part else signal
        lines = _timing(channels[0], [sensors[place] for place in places], loop)
        for place in places:
            sensor, name = sensors[place], sensors[place].name.replace("_", " ")
            options = loop.options(place, sensor, measured=signal, without=(*TIMING, "of"))
            lines.append(f"{name}: {', '.join(options)}" if options else name)
        boxes.append(Box(f"sensors.{title}", title, tuple(lines), names, beside=True))
    if exact := exactly_measured(G, vehicle):
        boxes.append(Box("sensors", f"exact: {exact}", (), names, is_ideal=True, beside=True))
    return [dataclasses.replace(box, gives=("Q_m, V_m",)) for box in boxes]


def _measures(sensor: Sensor, place: str, channel: Channel) -> bool:
    return place.partition("[")[0] == f"sensors.{channel.signal}" and sensor.of in (
        None,
        channel.part.name,
    )


def _timing(channel: Channel, sensors: Sequence[Sensor], loop: Loop) -> list[str]:
    """Return when something is measured, and how late that arrives."""
    control = loop.loop.vehicle.control
    assert control is not None  # sensors need it
    lines = [f"every {time_text(channel.every * control.tick)}"]
    if channel.delay:
        lines.append(f"arrives {time_text(channel.delay * control.tick)} later")
    lines += [f"{brief(100 * sensor.dropout)} % lost" for sensor in sensors if sensor.dropout]
    return [", ".join(lines)]


@boxes_of.register
def _arrived(block: Arrived, loop: Loop) -> list[Box]:
    return []  # of the boxes of the sensors


@boxes_of.register
def _estimating(block: Estimating, loop: Loop) -> list[Box]:
    estimator = loop.configured(ESTIMATOR, block.estimator)
    lines = [*loop.options(ESTIMATOR, estimator)]
    if block.estimator.has_covariance:
        lines.append("with its covariance")
    return [Box(ESTIMATOR, estimator.name, tuple(lines), (block.name,), gives=("Q̂, V̂",))]
