"""The sections of a configuration that become a trajectory and a vehicle."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import Problems, parse_key
from eqt_cli.base.option_types import Written, as_section, has_unit, number_of, seconds, with_values
from eqt_cli.base.stored import WHEEL
from eqt_cli.components import vehicle_parts
from eqt_cli.components.accelerometer import Lever
from eqt_cli.components.actuators import Actuator, VariesInTime
from eqt_cli.components.forces import Force, currents, follows_mass, in_currents, mass_of, weighed
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.inertia import Inertia, InertiaLaw
from eqt_cli.components.laws import Controller, RunsCode
from eqt_cli.components.matrix_groups import rigid_motions
from eqt_cli.components.mechanics import TimeVarying
from eqt_cli.components.pose_notation import pose_from
from eqt_cli.components.references import ConstantReference, Reference
from eqt_cli.components.sensors import TIMING, DynamicSensor, Sensor, depth_of
from eqt_cli.components.tasks import Point, task_of
from eqt_cli.components.vehicle import ACTUATORS, CONTROL, INNER, SIGNALS, Vehicle, navigates
from eqt_cli.components.vehicle_parts import check_period, common_divisor
from eqt_cli.config import schema
from eqt_cli.config.document import Place, with_data
from eqt_cli.config.marks import Section
from eqt_cli.config.schema import Config
from eqt_cli.config.tensors import JUMP, inertia_from

# The sections `reference` and `target`: the desired trajectory Q_d, V_d ---------------------------


@dataclass(frozen=True)
class DesiredTrajectory:
    """The desired trajectory of the loop.

    Attributes
    ----------
    reference
        The reference.
    pose, velocity
        Q_d(0) and V_d(0).
    resolved
        The complete section of the configuration.
    files
        Contents of the files with data, by their names.
    """

    reference: Reference
    pose: Array
    velocity: Array
    resolved: dict[str, Any]
    files: dict[str, str] = field(default_factory=dict)


def desired_from(
    config: Config, G: MatrixLieGroup, home: Place, problems: Problems
) -> DesiredTrajectory | None:
    """Return the desired trajectory of a configuration, or None after noting its problems."""
    task, entry = task_of(config.task), config.reference
    at_reference, at_target = problems.at("reference"), problems.at("target")
    if task.kind == "stabilise":
        if entry is not None:
            at_reference.add("is a key of task: track; give a target for task: stabilise")
        target = (config.target or schema.TargetSection()).pose
        if (pose := pose_from(target, G, at_target.at("pose"))) is None:
            return None
        section = {"target": {"pose": _as_floats(target)}}
        return DesiredTrajectory(ConstantReference(target), pose, np.zeros(G.dimension), section)
    if config.target is not None:
        at_target.add("is a key of task: stabilise; give a reference for task: track")
    if isinstance(task, Point) and task.at:
        if entry is not None or task.along:
            problems.at("task", "at").add("excludes `along` and a reference; remove these, or it")
        if G.dimension != 3:  # as is said of every law
            return None
        return DesiredTrajectory(ConstantReference(task.pose.tolist()), task.pose, np.zeros(3), {})
    if entry is None:
        what = "task: track" if task.is_whole else "task: point without `at`"
        at_reference.add(f"missing; {what} needs a reference to follow")
        return None
    reference, texts = with_data(entry.reference, home, G, at_reference)
    if at_reference:
        return None
    section = as_section(reference) | entry.starts
    section |= {key: _as_floats(section[key]) for key in schema.DEFAULTS if key in section}
    pose, velocity = reference.initial(G, entry.pose, entry.velocity)
    return DesiredTrajectory(reference, pose, velocity, {"reference": section}, texts)


def check_horizon(
    data: TimeVarying, key: str, G: MatrixLieGroup, duration: float, problems: Problems
) -> None:
    """Note runs that start before the data of a key over time, outlast them, or meet a gap."""
    place, (first, last) = problems.at(*parse_key(key)), data.ends(G)
    if first > 0:
        place.add(f"begins at {first:g} s, but runs begin at 0 s; shift its times")
    if last < duration:
        what = key if key == "reference" else f"recording of {key}"
        problems.at("time", "duration").add(
            f"expected at most {last:g} s, the end of the {what}, got {duration:g}"
        )
    within = [gap for gap in data.gaps(G) if gap[0] < duration and sum(gap) > 0]
    for begin, length in within[:1]:
        place.add(
            f"has a gap of {length:.4g} s after t = {begin:.6g} s, within the run; end the run "
            f"there, `time: {{duration: {begin:.6g}}}`, or begin after it, `mapping: {{time: "
            "{begin: …, offset: first}}`"
        )


def _as_floats(value: Any) -> Any:
    """Convert integers to floats, so that 0 and 0.0 describe the same experiment."""
    return with_values(value, lambda x: float(x) if isinstance(x, int) else x)


# The section `controllers`: when a law is called --------------------------------------------------


def check_calls(law: Controller, calls: bool, problems: Problems) -> None:
    """Note code that needs a control period, or that an engine, unless it `calls`, cannot call.

    It is called of loops without a control period.
    """
    kind = type(law)
    if kind.answer is not Controller.answer and kind.memory_rate is Controller.memory_rate:
        problems.add("answers at control instants only; set control.period, at which it is called")
    elif isinstance(law, RunsCode) and law.code.memory:
        problems.at("memory").add(
            "advances by a period at every call; set control.period, at which the code is called"
        )
    elif isinstance(law, RunsCode) and not calls:
        problems.add(
            "engine native compiles the law into the loop, and code is called; set "
            "control.period, at which it is called, or use engine solve_ivp"
        )


# The sections `plant`, `actuators`, `control`, `sensors` and `estimator`: the vehicle -------------


def check_sensors(
    signal: str, sensors: Sequence[Sensor], G: MatrixLieGroup, problems: Problems
) -> None:
    """Note unknown parts, impossible timing, and entries of a signal that contradict each other."""
    names = [part.name for part in (depth_of(G) if signal == "depth" else G.parts)]
    if signal == "accelerometer" and sensors:
        names = [part.name for part in G.parts if not part.turns]
        if not rigid_motions(G):
            problems.add(f"needs group SE2 or SE3, got {G.name}; remove this key")
            return
    for index, sensor in enumerate(sensors):
        place = problems.at(index)
        if isinstance(sensor, Lever) and signal != "accelerometer":
            instead = "move it to sensors.accelerometer"
            if signal == "pose":
                instead = "poses are measured at the origin of the body: move an antenna's there"
            place.add(f"lever is of an accelerometer; {instead}")
        elif signal not in ("velocity", "accelerometer") and isinstance(sensor, DynamicSensor):
            place.add(f"{sensor.name} measures velocities; move it to sensors.velocity")
        if sensor.of is not None and sensor.of not in names:
            parts = ", ".join(names)
            place.at("of").add(f"{G.name} has no part '{sensor.of}'; choose one of {parts}")
        if sensor.dropout is not None and not 0 <= sensor.dropout < 1:
            place.at("dropout").add(
                f"expected a probability of at least 0 and less than 1, got {sensor.dropout:g}"
            )
    for part in names:
        _check_agreement(sensors, part, problems)


def _check_agreement(sensors: Sequence[Sensor], part: str, problems: Problems) -> None:
    """Note timing in which two entries of one part differ, and a second place of a sensor."""
    levers = [(k, sensor.at) for k, sensor in enumerate(sensors) if isinstance(sensor, Lever)]
    for k, at in levers[1:]:  # their terms would add to that of one lever at r₁ + r₂
        expected = f"expected one place of the accelerometer, {levers[0][1]} or {at}"
        problems.at(k, "at").add(f"{expected}; remove one lever")
    for name in TIMING:
        of_part = [k for k, sensor in enumerate(sensors) if sensor.of in (None, part)]
        values = {k: x for k in of_part if (x := getattr(sensors[k], name)) is not None}
        for k, value in values.items():
            first, expected = next(iter(values.items()))
            if value != expected:
                problems.at(k, name).add(
                    f"entries of one part share their {name}: {problems.at(first).path} gives "
                    f"{expected:g} for the {part}, and this entry {value:g}; give it at one of them"
                )


def check_estimator(
    vehicle: Vehicle, G: MatrixLieGroup, without_clock: bool, problems: Problems
) -> None:
    """Note an estimator without a clock or without fixes, and its wrong options."""
    place, estimator = problems.at("estimator"), vehicle.estimator
    assert estimator is not None
    if without_clock:
        place.add("acts at control instants; set control.period")
    if not vehicle.pose_sensors and not problems.at("sensors"):
        place.add(
            "no sensor measures the pose, so its error grows without bound; add an entry to "
            "sensors.pose"
        )
    if vehicle.control is None or problems.at("sensors") or problems.at("control") or place:
        return
    estimator.check_sensors(vehicle.schedule(G), vehicle.deviations(G), place)


T = TypeVar("T")

MOST_DELAY = 1000
"""Largest number of ticks of a delay; each needs a state for its command or measurement."""

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
    clocked = CONTROL, "sensors", ACTUATORS, "controllers"
    if section.partition("[")[0] not in clocked or control is None:
        return False
    if name == "period":
        if section == CONTROL:
            parts: Any = *vehicle.actuators, *vehicle.sensors().values()
            return any(part.period is not None for part in parts)
        times = (number_of(Written(value, ["s"])) if has_unit(value) else value for value in listed)
        return not math.isclose(common_divisor([control.period, *times]), control.period)
    return name in (*TIMING, "tick")


def vehicle_from(
    config: Config, G: MatrixLieGroup, problems: Problems, model: InertiaLaw | None = None
) -> Vehicle:
    """Return the vehicle of the sections and of the model's inertia; problems are noted."""
    plant = config.plant or schema.PlantSection.model_construct()
    measured = config.sensors or schema.SensorsSection.model_construct()
    clock, horizon, at_plant = config.control, config.time.duration, problems.at("plant")
    inertia: vehicle_parts.TrueInertia | None = None
    if plant.inertia is not None:
        inertia = _inertia(plant.inertia, G, horizon, at_plant.at("inertia"))
    at_sensors, at_actuators = problems.at("sensors"), problems.at("actuators")
    of_laws, forces = config.known_forces, plant.forces
    if forces is None and isinstance(of_laws, list):
        forces = of_laws
    if isinstance(of_laws, list) and of_laws and forces == []:
        at_plant.at("forces").add(
            "is empty, and laws counteract the forces of model; list what acts, such as "
            "{kind: constant, force: 0}, or remove this key"
        )
    acting = config.actuators or []
    sensing = {name: list(getattr(measured, name) or ()) for name in SIGNALS}
    field = sensing["magnetometer"]
    field[:] = [replace(sensor, of=G.parts[0].name) for sensor in field]
    entries: list[Entry] = [(at_actuators.at(k), part) for k, part in enumerate(acting)]
    entries += inner_clocks(config, problems)
    for name, errors in sensing.items():
        entries += [(at_sensors.at(name, k), part) for k, part in enumerate(errors)]
    section = "model" if plant.forces is None else "plant"
    _check_loads(inertia, model, forces or (), problems.at(section, "forces"))
    if model is not None and not problems:
        _check_jumps(model, inertia, G, horizon, problems)
        _check_weights(forces or (), model, inertia, G, problems.at(section, "forces"))
        of_model = of_laws if isinstance(of_laws, list) else ()
        _check_weights(of_model, model, None, G, problems.at("model", "forces"))
    vehicle = Vehicle(
        inertia,
        tuple(forces or ()),
        tuple(acting),
        None if clock is None else _sampling(clock, entries, horizon, problems.at("control")),
        tuple(sensing["pose"]),
        tuple(sensing["velocity"]),
        config.estimator,
        model=model,
        more_sensors=(tuple(field), tuple(sensing["accelerometer"]), tuple(sensing["depth"])),
    )
    _check_readers(vehicle, at_sensors)
    _check_currents(vehicle.forces, problems.at(section, "forces"))
    if vehicle.measures and clock is None:
        at_sensors.add("act at control instants; set control.period")
    _check_order(acting, clock is None, at_actuators)
    _check_until(horizon, acting, at_actuators)
    pulsed = any(getattr(part, "jets", None) for part in acting) and clock is not None
    if pulsed and config.time.samples <= (ticks := round(horizon / vehicle.tick)):
        means = f"means over pulses need a sample at each tick; give {ticks + 1} or more"
        problems.at("time", "samples").add(means)
    for name, parts in sensing.items():
        check_sensors(name, parts, G, at_sensors.at(name))
    if vehicle.estimator is not None:
        check_estimator(vehicle, G, clock is None, problems)
    return vehicle if problems else vehicle.of_run(G)


def _check_loads(
    inertia: vehicle_parts.TrueInertia | None,
    model: InertiaLaw | None,
    forces: Sequence[Force],
    problems: Problems,
) -> None:
    """Note forces that carry a mass, whose momentum is kept, beside mass that leaves."""
    law = inertia.law if isinstance(inertia, vehicle_parts.VaryingInertia) else model
    for index, force in enumerate(forces):
        if isinstance(force, vehicle_parts.CarriesMass) and getattr(law, "leaves", False):
            said = "keeps the momentum, and the mass of the inertia leaves at the velocity"
            problems.at(index).add(f"{said} of the body; write `leaves: false`, or remove one")


def _check_weights(
    forces: Sequence[Force],
    model: InertiaLaw,
    true: vehicle_parts.TrueInertia | None,
    G: MatrixLieGroup,
    problems: Problems,
) -> None:
    """Note weights that follow from a mass that is not one number."""
    body = model
    if isinstance(true, vehicle_parts.VaryingInertia):
        body = true.law
    elif true is not None:
        body = true.of_run(G, None).at(model.at(0.0), 0.0)
    for index in (k for k, force in enumerate(forces) if follows_mass(force)):
        place = problems.at(index, "gravity")
        if not isinstance(body, Inertia):
            place.add("needs a constant inertia; write the weight m(t) g as kind: expression")
        elif mass_of(G, body) is None or (body.added is None and model.at(0.0).added is not None):
            place.add(
                "needs the mass of the body alone, and the inertia has another one by axis; write "
                "it as {rigid: …, added: …}, and the inertia of the plant relative to it"
            )


def _check_jumps(
    model: InertiaLaw,
    true: vehicle_parts.TrueInertia | None,
    G: MatrixLieGroup,
    horizon: float,
    problems: Problems,
) -> None:
    """Note a time at which an inertia jumps, and a body keeps something else than a run does.

    A run keeps 𝕀V of the model. A body keeps that of the true inertia, or V where mass leaves.
    """
    if true is None and not model.at(0.0).leaves:
        return
    times, near = {"inertia": model.instants(G, horizon)}, 1e-9 * horizon
    if true is not None:
        true = true.of_run(G, None)
        times["plant.inertia"] = true.instants(G, horizon)
    for key, t in [(key, t) for key, of_key in times.items() for t in of_key]:
        models = [model.at(at) for at in (t - near, t + near)]
        bodies = models
        if true is not None:
            bodies = [true.at(x, at) for x, at in zip(models, (t - near, t + near), strict=True)]
        by_run, by_body = (after.inverse @ before.matrix for before, after in (models, bodies))
        leaves = bodies[0].leaves
        if leaves:
            by_body = np.eye(G.dimension)
        if np.abs(by_run - by_body).max() > JUMP:
            quantity = "velocity" if leaves else "momentum"
            remedy = f"write smoothstep(t, {t:g}, {t + 0.01:g})"
            if key != "inertia":
                remedy += ", or `leaves: true` to keep the velocity"
            problems.at(*key.split(".")).add(
                f"jumps at t = {t:g} s, and a run does not keep the {quantity} of the body there; "
                f"{remedy}"
            )
            return


def _check_readers(vehicle: Vehicle, problems: Problems) -> None:
    """Note sensors of what there is not, or nobody reads."""
    field, _, depth = vehicle.more_sensors
    if field and not vehicle.magnet:
        problems.at("magnetometer").add("needs the field of magnetorquers; add them to actuators")
    if depth and not navigates(vehicle):
        problems.at("depth").add("is read by `estimator: {kind: navigation}` alone; remove it")


Entry = tuple[Problems, Sensor | Actuator]
"""A sensor or an actuator, with its place."""


def inner_clocks(config: Config, problems: Problems) -> list[Entry]:
    """Return the blocks of all laws that have clocks of their own."""
    return [
        (problems.at("controllers", index, INNER, k), block)
        for index, entry in enumerate(config.controllers)
        for k, block in enumerate(entry.inner)
        if block.period is not None or block.offset is not None
    ]


def check_inner(vehicle: Vehicle, problems: Problems, at_actuators: Problems) -> None:
    """Note blocks of a law that cannot stand where they do, before the actuators of all laws."""
    parts, count = (vehicle.configured or vehicle).actuators, vehicle.inner
    _check_order(parts[:count], vehicle.control is None, problems)
    if problems:
        return
    rates = [index for index, part in enumerate(parts) if part.takes == "rates"]
    if len(rates) > 1 and rates[0] < count:
        k = rates[1]
        other = (at_actuators.at(k - count) if k >= count else problems.at(k)).path
        problems.at(rates[0]).add(f"makes a torque of rates, and so does {other}; remove one")
    moving = next((part.name for part in parts[:count] if part.moves or part.changes), "")
    for index, part in enumerate(parts[count:] if moving else ()):
        if part.sampled or part.period is not None:
            remedy = "fly this law on a vehicle without that actuator"
            problems.add(
                f"{at_actuators.at(index).path}, {part.name}, acts on a held command, and {moving} "
                f"changes it at all times; {remedy if part.sampled else 'remove its period'}"
            )


def _sampling(
    control: schema.ControlSection, entries: Sequence[Entry], horizon: float, problems: Problems
) -> vehicle_parts.Sampling:
    """Return tick and clock of the law; times that are no whole numbers of ticks are noted."""
    times = list(_times(control, entries, problems))
    divisor = common_divisor([control.period, *(time for _, time, _ in times)])
    tick = control.tick or control.period / round(control.period / divisor)
    every = check_period(control.period, tick, problems.at("period"), "ticks")
    for place, time, below in times:
        if not 0 <= time < below:
            place.add(
                f"expected at least 0 s and less than the period, {below:g} s, got {time:g} s"
            )
        elif time:
            check_period(time, tick, place, "ticks")
    period, least = control.period, horizon / MOST_INSTANTS
    odd = [x for x in times if x[1] > period >= least > common_divisor([period, x[1]])]
    for place, time, _ in odd:
        check_period(time, period, place, "control periods")
    if not problems and not odd and tick < least:
        most = f"{MOST_INSTANTS:,} {'control instants' if every == 1 else 'ticks'} in {horizon:g} s"
        problems.at("period" if every == 1 else "tick").add(
            f"expected at least {least:g} s, which makes {most}, got {tick:g}"
        )
    sampling = vehicle_parts.Sampling(control.period, 0, vehicle_parts.Clock(every or 1))
    if problems or odd:
        return sampling
    for place, part in [(problems, control), *entries]:
        ticks = sampling.ticks_of(getattr(part, "delay", None) or 0)
        if ticks > MOST_DELAY:
            place.at("delay").add(f"expected at most {MOST_DELAY:,} ticks, got {ticks:,}")
    clock = sampling.clock_of(None, control.offset)
    return vehicle_parts.Sampling(control.period, sampling.ticks_of(control.delay), clock)


def _times(
    control: schema.ControlSection, entries: Sequence[Entry], problems: Problems
) -> Iterator[tuple[Problems, float, float]]:
    """Yield the times of all clocks with their places, and what they must be less than, s."""
    yield problems.at("offset"), control.offset, control.period
    for place, part in entries:
        if part.period is not None:
            yield place.at("period"), part.period, math.inf
        if part.offset is not None:
            yield place.at("offset"), part.offset, part.period or control.period
    for place, late in [(problems, control), *entries]:
        if isinstance(delay := getattr(late, "delay", None), str):
            yield place.at("delay"), seconds(delay), math.inf


def known_forces(config: Config, vehicle: Vehicle, G: MatrixLieGroup) -> tuple[Force, ...]:
    """Return the forces that laws with a model know, with their mean numbers and its mass."""
    forces = config.known_forces
    if forces == "plant":
        return weighed(G, vehicle.forces, vehicle.model)
    known_parts = tuple(part.of_run(G, None) for part in forces or ())
    return in_currents(G, known_parts, vehicle.model) if known_parts else ()


def _check_currents(forces: tuple[Force, ...], problems: Problems) -> None:
    """Note a second current that would move the masses."""
    moving = currents(forces) if forces else {}
    for index, drag in moving.items():
        first = next(iter(moving))
        if drag.current != moving[first].current:
            problems.at(index, "current").add(
                f"forces[{first}] has another current, but the added mass follows only one; "
                "set `drag_only: true` in the force with the wind"
            )


def _check_until(horizon: float, parts: Sequence[Actuator], problems: Problems) -> None:
    """Note what actuators cannot do until the end of the runs."""
    for index, part in enumerate(parts):
        if isinstance(part, VariesInTime):
            part.check_until(horizon, problems.at(index))


def _check_order(parts: Sequence[Actuator], without_clock: bool, problems: Problems) -> None:
    """Note actuators that act at control instants without a clock or without a held command."""
    moving, before = "", set[str]()
    for index, part in enumerate(parts):
        place, name = problems.at(index), getattr(part, "acting_at_instants", part.name)
        sampled, dump = part.sampled or part.period is not None, getattr(part, "dump", None)
        if sampled and without_clock:
            place.add(f"{name} acts at control instants; set control.period")
        elif sampled and moving:
            remedy = f"put it before {moving}"
            if not part.sampled:
                remedy = f"remove its period: {moving} changes its input at all times"
            place.add(f"{name} acts on a held command; {remedy}")
        elif part.offset is not None and part.period is None:
            place.at("offset").add("applies with a period only; add period")
        if WHEEL in before and not dump:
            place.add("the torque of wheels is final; put it before, or give dump")
        if dump and WHEEL not in before:
            place.at("dump").add("takes the momentum of wheels; put wheels before it")
        for member in before & {*part.members} - {WHEEL}:
            place.add(f"a vehicle has one entry with {member}s; put all of them in the first one")
        before |= {*part.members}
        moving = part.name if part.moves or part.changes else moving


def _inertia(
    section: Any, G: MatrixLieGroup, horizon: float, problems: Problems
) -> vehicle_parts.TrueInertia | None:
    if isinstance(section, schema.RelativeInertiaSection):
        value, place = section.relative, problems.at("relative")
        vehicle_parts.check_numbers(value, place)
        vehicle_parts.check_still(value, place)
        if not place and vehicle_parts.drawn(value, None) <= -1:
            place.add(
                f"expected a number greater than -1, got {vehicle_parts.drawn(value, None):g}"
            )
        return vehicle_parts.RelativeInertia(value)
    if isinstance(section, Section):
        law = inertia_from(section, G, horizon, problems)
        return None if law is None else vehicle_parts.VaryingInertia(law)
    vehicle_parts.check_numbers(section, problems)
    vehicle_parts.check_still(section, problems)
    if problems or inertia_from(vehicle_parts.drawn(section, None), G, horizon, problems) is None:
        return None
    return vehicle_parts.ConstantInertia(section)
