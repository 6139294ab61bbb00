"""The sections `plant`, `actuators`, `control` and `sensors`, which describe the vehicle."""

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
from eqt_cli.experiment.estimator import check_estimator
from eqt_cli.experiment.inertia import inertia_from
from eqt_cli.experiment.sensors import check_sensors
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle import Vehicle
from eqt_cli.vehicle.actuators import Actuator, actuators
from eqt_cli.vehicle.estimators import Estimator, estimators
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
"""Largest number of control instants of a run."""

SECTIONS = ("plant", "actuators", "control", "sensors", "estimator")
"""Sections that describe the vehicle between the laws and the motion."""


def decides_parts(key: str, values: Iterable[Any]) -> bool:
    """Whether values of a key in these sections can change the parts or the number of states.

    Plain numbers do not, with two exceptions. Each period of a delay adds a waiting command or
    measurement, and without a dropout, a sensor need not hold measurements.
    """
    numbers = all(isinstance(value, int | float) for value in values)
    section, _, option = key.partition(".")
    late = section in (CONTROL, "sensors") and option.rpartition(".")[2] in ("delay", "dropout")
    return not numbers or late


def vehicle_from(
    sections: dict[str, Any], G: MatrixLieGroup, horizon: float, problems: Problems
) -> Vehicle:
    """Return the vehicle of the sections; problems are noted."""
    plant = sections["plant"] or PlantSection()
    at_plant = problems.at("plant")
    inertia = None
    if plant.inertia is not None:
        inertia = _inertia(plant.inertia, G, horizon, at_plant.at("inertia"))
    clock, measured = sections["control"], sections["sensors"] or SensorsSection()
    at_sensors, at_actuators = problems.at("sensors"), problems.at("actuators")
    acting = _parts(actuators, sections["actuators"], G, at_actuators)
    sensing = {
        name: _parts(sensors, getattr(measured, name), G, at_sensors.at(name))
        for name in ("pose", "velocity")
    }
    found = Vehicle(
        inertia,
        tuple(_parts(forces, plant.forces, G, at_plant.at("forces")).values()),
        tuple(acting.values()),
        None if clock is None else Sampling(clock.period, clock.delay),
        tuple(sensing["pose"].values()),
        tuple(sensing["velocity"].values()),
        _estimator(sections["estimator"], G, problems.at("estimator")),
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
    if found.estimator is not None:
        check_estimator(found, G, without_clock, problems)
    if any(problems.at(name) for name in SECTIONS):
        return Vehicle()
    return found.of_run(G)


def _estimator(section: Any, G: MatrixLieGroup, problems: Problems) -> Estimator | None:
    return None if section is None else component(estimators, section, problems, group=G)


def resolved(vehicle: Vehicle, config: Config) -> dict[str, Any]:
    """Return the sections with all defaults; missing sections stay missing."""
    vehicle = vehicle.configured or vehicle
    dumped = config.model_dump(include=set(SECTIONS), exclude_none=True, warnings="none")
    if "plant" in dumped and vehicle.forces:
        dumped["plant"]["forces"] = [as_section(force) for force in vehicle.forces]
    if vehicle.actuators:
        dumped["actuators"] = [as_section(actuator) for actuator in vehicle.actuators]
    by_signal = ("pose", vehicle.pose_sensors), ("velocity", vehicle.velocity_sensors)
    for name, found in by_signal:
        if found:
            dumped["sensors"][name] = [as_section(sensor) for sensor in found]
    if vehicle.estimator is not None:
        dumped["estimator"] = as_section(vehicle.estimator)
    return dumped


def _check_order(parts: Mapping[int, Actuator], without_clock: bool, problems: Problems) -> None:
    """Note actuators that act at control instants without a clock or without a held command."""
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
    """Return the valid parts by the number of their entry."""
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
