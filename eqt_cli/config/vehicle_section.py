"""The sections `plant`, `actuators`, `control`, `sensors` and `estimator`: the vehicle."""

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, TypeVar

from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import (
    Written,
    check_period,
    common_divisor,
    has_unit,
    number_of,
    seconds,
)
from eqt_cli.components import vehicle_parts
from eqt_cli.components.actuators import Actuator
from eqt_cli.components.forces import Force, currents, in_currents
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.inertia import InertiaLaw
from eqt_cli.components.sensors import TIMING, Sensor
from eqt_cli.components.vehicle import ACTUATORS, CONTROL, Vehicle
from eqt_cli.config import schema
from eqt_cli.config.sections import inertia_from


def check_sensors(sensors: Mapping[int, Sensor], G: MatrixLieGroup, problems: Problems) -> None:
    """Note unknown parts, impossible timing, and entries that contradict each other.

    Parameters
    ----------
    sensors
        Sensors of the pose or of the velocity, by the numbers of their entries.
    """
    known = [part.name for part in G.parts]
    for index, sensor in sensors.items():
        here = problems.at(index)
        if sensor.of is not None and sensor.of not in known:
            parts = ", ".join(known)
            here.at("of").add(f"{G.name} has no part '{sensor.of}'; choose one of {parts}")
        if sensor.dropout is not None and not 0 <= sensor.dropout < 1:
            here.at("dropout").add(
                f"expected a probability of at least 0 and less than 1, got {sensor.dropout:g}"
            )
    for part in known:
        _check_agreement(sensors, part, problems)


def _check_agreement(sensors: Mapping[int, Sensor], part: str, problems: Problems) -> None:
    """Note timing in which two entries of one part differ."""
    for name in TIMING:
        first: tuple[int, Any] | None = None
        for index, sensor in sensors.items():
            value = getattr(sensor, name)
            if value is None or sensor.of not in (None, part):
                continue
            if first is None:
                first = index, value
            elif first[1] != value:
                problems.at(index, name).add(
                    f"entries of one part share their {name}: {problems.at(first[0]).path} gives "
                    f"{first[1]:g} for the {part}, and this entry {value:g}; give it at one of them"
                )


def check_estimator(
    vehicle: Vehicle, G: MatrixLieGroup, without_clock: bool, problems: Problems
) -> None:
    """Note an estimator without a clock or without fixes, and what is wrong with it for them."""
    here, estimator = problems.at("estimator"), vehicle.estimator
    assert estimator is not None
    if without_clock:
        here.add("acts at control instants; set control.period")
    if not vehicle.pose_sensors and not problems.at("sensors"):
        here.add(
            "nothing measures the pose, so that its error grows without bound; add an entry to "
            "sensors.pose"
        )
    if vehicle.control is None or problems.at("sensors") or problems.at("control") or here:
        return
    estimator.check_sensors(vehicle.schedule(G), vehicle.deviations(G), here)


T = TypeVar("T")

MOST_INSTANTS = 1_000_000
"""Largest number of control instants of a run."""


def decides_parts(key: str, values: Iterable[Any], vehicle: Vehicle) -> bool:
    """Whether values of a key in these sections can change the parts or the number of states.

    Plain numbers do not, with some exceptions. Each tick of a delay adds a waiting command or
    measurement, and without a dropout, a sensor need not hold measurements. Other times of clocks
    change the tick, but for periods that are whole numbers of control periods.
    """
    listed = list(values)
    if not all(isinstance(value, int | float) or has_unit(value) for value in listed):
        return True
    section, _, option = key.partition(".")
    name, control = option.rpartition(".")[2], vehicle.control
    if section.partition("[")[0] not in (CONTROL, "sensors", ACTUATORS) or control is None:
        return False
    if name == "period":
        if section == CONTROL:
            parts: Any = *vehicle.actuators, *vehicle.sensors().values()
            return any(part.period is not None for part in parts)
        times = (number_of(Written(value, ["s"])) if has_unit(value) else value for value in listed)
        return not math.isclose(common_divisor([control.period, *times]), control.period)
    return name in (*TIMING, "tick")


def vehicle_from(
    sections: dict[str, Any],
    G: MatrixLieGroup,
    horizon: float,
    problems: Problems,
    model: InertiaLaw | None = None,
) -> Vehicle:
    """Return the vehicle of the sections and of the model's inertia; problems are noted."""
    plant = sections["plant"] or schema.PlantSection()
    at_plant = problems.at("plant")
    inertia = None
    if plant.inertia is not None:
        inertia = _inertia(plant.inertia, G, horizon, at_plant.at("inertia"))
    clock, measured = sections["control"], sections["sensors"] or schema.SensorsSection()
    at_sensors, at_actuators = problems.at("sensors"), problems.at("actuators")
    known, pushing = sections["model"] and sections["model"].forces, plant.forces
    if pushing is None and isinstance(known, list):
        pushing = known
    acting = _right(sections["actuators"])
    sensing = {"pose": _right(measured.pose), "velocity": _right(measured.velocity)}
    entries: list[Entry] = [(at_actuators.at(k), part) for k, part in acting.items()]
    for name, errors in sensing.items():
        entries += [(at_sensors.at(name, k), part) for k, part in errors.items()]
    vehicle = Vehicle(
        inertia,
        tuple(_right(pushing).values()),
        tuple(acting.values()),
        None if clock is None else _sampling(clock, entries, horizon, problems.at("control")),
        tuple(sensing["pose"].values()),
        tuple(sensing["velocity"].values()),
        sections["estimator"],
        model=model,
    )
    at_forces = (
        at_plant.at("forces") if plant.forces is not None else problems.at("model", "forces")
    )
    _check_currents(currents(vehicle.forces), at_forces)
    without_clock = clock is None and not problems.at("control")
    if vehicle.measures and without_clock:
        at_sensors.add("act at control instants; set control.period")
    _check_order(acting, without_clock, at_actuators)
    for index, sensor in sensing["pose"].items():
        if sensor.states(G):
            at_sensors.at("pose", index).add(
                f"{sensor.name} measures velocities; move it to sensors.velocity"
            )
    for name, parts in sensing.items():
        check_sensors(parts, G, at_sensors.at(name))
    if vehicle.estimator is not None:
        check_estimator(vehicle, G, without_clock, problems)
    if any(map(problems.at, schema.marked(schema.VEHICLE))):
        return Vehicle()
    return vehicle.of_run(G)


Entry = tuple[Problems, Sensor | Actuator]
"""A sensor or an actuator, with its place."""


def _sampling(
    control: schema.ControlSection, entries: Iterable[Entry], horizon: float, problems: Problems
) -> vehicle_parts.Sampling:
    """Return tick and clock of the law; times that are no whole numbers of ticks are noted."""
    times = list(_times(control, entries, problems))
    tick = control.tick or common_divisor([control.period, *(time for _, time, _ in times)])
    every = check_period(control.period, tick, problems.at("period"), "ticks")
    for here, time, below in times:
        if not 0 <= time < below:
            here.add(f"expected at least 0 s and less than the period, {below:g} s, got {time:g} s")
        elif time:
            check_period(time, tick, here, "ticks")
    if not problems and horizon / tick > MOST_INSTANTS:
        key, what = ("period", "control instants") if every == 1 else ("tick", "ticks")
        problems.at(key).add(
            f"expected at least {horizon / MOST_INSTANTS:g} s, which makes {MOST_INSTANTS:,} "
            f"{what} in {horizon:g} s, got {tick:g}"
        )
    sampling = vehicle_parts.Sampling(control.period, 0, vehicle_parts.Clock(every or 1))
    if problems:
        return sampling
    clock = sampling.clock_of(None, control.offset)
    return vehicle_parts.Sampling(control.period, sampling.ticks_of(control.delay), clock)


def _times(
    control: schema.ControlSection, entries: Iterable[Entry], problems: Problems
) -> Iterator[tuple[Problems, float, float]]:
    """Yield the times of all clocks with their places, and what they must be less than, s."""
    yield problems.at("offset"), control.offset, control.period
    late: list[tuple[Problems, int | str]] = [(problems.at("delay"), control.delay)]
    for here, part in entries:
        if part.period is not None:
            yield here.at("period"), part.period, math.inf
        if part.offset is not None:
            yield here.at("offset"), part.offset, part.period or control.period
        if isinstance(part, Sensor):
            late.append((here.at("delay"), part.delay or 0))
    for here, delay in late:
        if isinstance(delay, str):
            yield here, seconds(delay), math.inf


def known_forces(
    sections: dict[str, Any], vehicle: Vehicle, G: MatrixLieGroup
) -> tuple[Force, ...]:
    """Return the forces that laws with a model know, with their mean numbers."""
    known = sections["model"] and sections["model"].forces
    if known == "plant":
        return vehicle.forces
    known_parts = tuple(part.of_run(G, None) for part in _right(known).values())
    return in_currents(G, known_parts, vehicle.model)


def _check_currents(moving: Mapping[int, Any], problems: Problems) -> None:
    """Note a second current that would move the masses."""
    for index, drag in moving.items():
        first = next(iter(moving))
        if drag.current != moving[first].current:
            problems.at(index, "current").add(
                f"forces[{first}] has another current, and the added mass moves with one; write "
                "`drag_only: true` beside that of the air"
            )


def _check_order(parts: Mapping[int, Actuator], without_clock: bool, problems: Problems) -> None:
    """Note actuators that act at control instants without a clock or without a held command."""
    moving, driven, steered = "", False, False
    for index, actuator in parts.items():
        sampled = actuator.sampled or actuator.period is not None
        if sampled and without_clock:
            problems.at(index).add(
                f"{actuator.acting_at_instants} acts at control instants; set control.period"
            )
        elif sampled and moving:
            problems.at(index).add(
                f"{actuator.acting_at_instants} acts on a held command; put it before {moving}"
            )
        elif actuator.offset is not None and actuator.period is None:
            problems.at(index, "offset").add("belongs to a period; give period, too")
        if steered:
            problems.at(index).add("acts behind the wheels, whose torque is final; put it before")
        steered = steered or bool(actuator.wheel_names)
        if actuator.thruster_names and driven:
            problems.at(index).add(
                "a vehicle has one entry with thrusters; put all of them in the first one"
            )
        driven = driven or bool(actuator.thruster_names)
        moving = actuator.name if actuator.moves else moving


def _right(entries: Iterable[T] | None) -> dict[int, T]:
    """Return the parts without wrong ones, by the numbers of their entries."""
    return {index: part for index, part in enumerate(entries or ()) if part is not None}


def _inertia(
    section: Any, G: MatrixLieGroup, horizon: float, problems: Problems
) -> vehicle_parts.TrueInertia | None:
    if isinstance(section, schema.RelativeInertiaSection):
        value, here = section.relative, problems.at("relative")
        vehicle_parts.check_numbers(value, here)
        if not here and vehicle_parts.drawn(value, None) <= -1:
            here.add(f"expected a number greater than -1, got {vehicle_parts.drawn(value, None):g}")
        return vehicle_parts.RelativeInertia(value)
    if isinstance(section, schema.Section):
        law = inertia_from(section, G, horizon, problems)  # type: ignore[arg-type]
        return None if law is None else vehicle_parts.VaryingInertia(law)
    vehicle_parts.check_numbers(section, problems)
    if problems or inertia_from(vehicle_parts.drawn(section, None), G, horizon, problems) is None:
        return None
    return vehicle_parts.ConstantInertia(section)
