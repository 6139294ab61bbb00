"""The sections `plant` and `actuators`: what is between the laws and the motion."""

from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

from eqt_cli.config.schema import (
    Config,
    FactoredInertiaSection,
    PlantSection,
    PrescribedInertiaSection,
    RelativeInertiaSection,
    SensorsSection,
)
from eqt_cli.core.problems import Problems
from eqt_cli.core.registry import Registry
from eqt_cli.core.validation import as_section, component
from eqt_cli.experiment.inertia import inertia_from
from eqt_cli.experiment.sensors import check_sensors
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle import Vehicle
from eqt_cli.vehicle.actuators import Actuator, actuators
from eqt_cli.vehicle.forces import forces
from eqt_cli.vehicle.inertia import (
    ConstantInertia,
    RelativeInertia,
    TrueInertia,
    VaryingInertia,
)
from eqt_cli.vehicle.numbers import Distribution, check_numbers, drawn
from eqt_cli.vehicle.sampling import Sampling
from eqt_cli.vehicle.sensors import sensors
from eqt_cli.vehicle.vehicle import CONTROL

T = TypeVar("T")

MOST_INSTANTS = 1_000_000
"""Of a run, at which a law is evaluated."""

SECTIONS = ("plant", "actuators", "control", "sensors")
"""The sections that say what is between the laws and the motion."""


def decides_parts(key: str, values: Iterable[Any]) -> bool:
    """Whether values of a key in these sections may differ in parts, or in how many states it has.

    Plain numbers do not, but for a delay, each period of which is a command or a measurement on its
    way, and for a dropout: with none, a sensor need not hold anything.
    """
    numbers = all(isinstance(value, int | float) for value in values)
    section, _, option = key.partition(".")
    late = section in (CONTROL, "sensors") and option.rpartition(".")[2] in ("delay", "dropout")
    return not numbers or late


def vehicle_from(
    sections: dict[str, Any], G: MatrixLieGroup, horizon: float, problems: Problems
) -> Vehicle:
    """The vehicle that the sections describe; what is wrong with them is noted."""
    plant = sections["plant"] or PlantSection()
    at_plant = problems.at("plant")
    inertia = None
    if plant.inertia is not None:
        inertia = _inertia(plant.inertia, G, horizon, at_plant.at("inertia"))
    clock, told = sections["control"], sections["sensors"] or SensorsSection()
    at_sensors, at_actuators = problems.at("sensors"), problems.at("actuators")
    acting = _parts(actuators, sections["actuators"], G, at_actuators)
    sensing = {
        name: _parts(sensors, getattr(told, name), G, at_sensors.at(name))
        for name in ("pose", "velocity")
    }
    found = Vehicle(
        inertia,
        tuple(_parts(forces, plant.forces, G, at_plant.at("forces")).values()),
        tuple(acting.values()),
        None if clock is None else Sampling(clock.period, clock.delay),
        tuple(sensing["pose"].values()),
        tuple(sensing["velocity"].values()),
    )
    without_clock = clock is None and not problems.at("control")
    if found.measures and without_clock:
        at_sensors.add("act at control instants; set control.period")
    _check_order(acting, without_clock, at_actuators)
    for name, parts in sensing.items():
        check_sensors(parts, G, None if clock is None else clock.period, at_sensors.at(name))
    if clock is not None and horizon / clock.period > MOST_INSTANTS:
        problems.at("control").at("period").add(
            f"expected at least {horizon / MOST_INSTANTS:g} s, which makes {MOST_INSTANTS:,} "
            f"control instants in {horizon:g} s, got {clock.period:g}"
        )
    if any(problems.at(name) for name in SECTIONS):
        return Vehicle()
    return found.of_run(G)


def resolved(vehicle: Vehicle, config: Config) -> dict[str, Any]:
    """The sections with every default written out; those that are not given stay away."""
    vehicle = vehicle.configured or vehicle
    dumped = config.model_dump(include=set(SECTIONS), exclude_none=True, warnings="none")
    if "plant" in dumped and vehicle.forces:
        dumped["plant"]["forces"] = [as_section(force) for force in vehicle.forces]
    if vehicle.actuators:
        dumped["actuators"] = [as_section(actuator) for actuator in vehicle.actuators]
    told = ("pose", vehicle.pose_sensors), ("velocity", vehicle.velocity_sensors)
    for name, found in told:
        if found:
            dumped["sensors"][name] = [as_section(sensor) for sensor in found]
    return dumped


def _check_order(parts: Mapping[int, Actuator], without_clock: bool, problems: Problems) -> None:
    """Note actuators that act at instants only, where there are none, or no held command."""
    moving, driven = "", False
    for index, actuator in parts.items():
        if actuator.sampled and without_clock:
            problems.at(index).add(
                f"{actuator.acting_at_instants} acts at control instants; set control.period"
            )
        elif actuator.sampled and moving:
            problems.at(index).add(
                f"{actuator.acting_at_instants} acts on a held command; put it before {moving}"
            )
        if actuator.thruster_names and driven:
            problems.at(index).add(
                "a vehicle has one entry with thrusters; put all of them in the first one"
            )
        driven = driven or bool(actuator.thruster_names)
        moving = actuator.name if actuator.moves else moving


def _parts(
    registry: Registry[T], entries: list[Any] | None, G: MatrixLieGroup, problems: Problems
) -> dict[int, T]:
    """Those that are right, by the number of their entry."""
    found = {
        index: component(registry, entry, problems.at(index), group=G)
        for index, entry in enumerate(entries or ())
    }
    return {index: part for index, part in found.items() if part is not None}


def _inertia(
    section: Any, G: MatrixLieGroup, horizon: float, problems: Problems
) -> TrueInertia | None:
    if isinstance(section, FactoredInertiaSection | PrescribedInertiaSection):
        law = inertia_from(section, G, horizon, problems)
        return None if law is None else VaryingInertia(law)
    if isinstance(section, RelativeInertiaSection):
        _check_relative(section.relative, problems.at("relative"))
        return RelativeInertia(section.relative)
    check_numbers(section, problems)
    if problems or inertia_from(drawn(section, None), G, horizon, problems) is None:
        return None
    return ConstantInertia(section)


def _check_relative(value: float | Distribution, problems: Problems) -> None:
    check_numbers(value, problems)
    if not problems and drawn(value, None) <= -1:
        problems.add(f"expected a number greater than -1, got {drawn(value, None):g}")
