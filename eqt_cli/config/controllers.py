"""The section controllers: its laws, their gains, and what they know of the plant."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from operator import is_
from typing import Any

import numpy as np

from eqt_cli.base.errors import Problems, alike
from eqt_cli.base.option_types import MISSING, as_section, known_keys, shown
from eqt_cli.base.stored import THRUSTER
from eqt_cli.components.actuators import THRUSTS, Actuator, nominal
from eqt_cli.components.forces import Force
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.inertia import InertiaLaw
from eqt_cli.components.laws import Controller, Designed, OuterLoop, Previews, RunsCode, gains_group
from eqt_cli.components.mechanics import Gains
from eqt_cli.components.motions import PlantModel, only_direction
from eqt_cli.components.references import ClosedReference
from eqt_cli.components.tasks import task_of
from eqt_cli.components.vehicle import ACTUATORS, INNER, Vehicle, is_direct, pushes, with_inner
from eqt_cli.config import sections, tensors
from eqt_cli.config.document import Place, with_data
from eqt_cli.config.schema import Config, GainsSection
from eqt_cli.config.sections import DesiredTrajectory
from eqt_cli.numbers.leaves import with_fields

TAKEN_BY = {
    "rates": "{kind: rate_loop, bandwidth: 40}",
    "dipole": "{kind: magnetorquers, takes: dipole, …}",
    THRUSTS: "{kind: thrusters, …}",
}
"""The actuators of commands other than a torque."""


@dataclass(frozen=True)
class Law:
    """A control law of the configuration.

    Attributes
    ----------
    index
        Its number among `controllers`.
    gains
        Its own gains, as `kp` and `kd`.
    known_forces
        Whether it takes the forces of `model` into account.
    setpoint
        What it knows of the reference, of `SETPOINTS`.
    inner
        The blocks of its own between its command and the actuators.
    written
        The names of the options that are written.
    files, code
        Texts of the data that it reads, and of the code that it executes, by file.
    followed
        The names of the options that follow the gains.
    """

    law: Controller
    index: int
    gains: dict[str, Any]
    known_forces: bool
    setpoint: str
    inner: tuple[Actuator, ...]
    written: tuple[str, ...]
    files: dict[str, str]
    code: dict[str, str]
    followed: tuple[str, ...] = ()

    def with_gains(self, G: MatrixLieGroup, gains: Gains) -> "Law":
        """Return the law with the options that follow the gains, where they are not written."""
        defaults = self.law.defaults(G, gains)
        defaults = {name: value for name, value in defaults.items() if name not in self.written}
        return replace(self, law=with_fields(self.law, **defaults), followed=tuple(defaults))

    @property
    def resolved(self) -> dict[str, Any]:
        """The entry; options that follow the gains stay away, and follow them again."""
        options = as_section(self.law).items()
        section = {name: value for name, value in options if name not in self.followed}
        section |= {"gains": self.gains} if self.gains else {}
        section |= {} if self.known_forces else {"known_forces": False}
        section |= {} if self.setpoint == "full" else {"setpoint": self.setpoint}
        return section | ({INNER: [as_section(one) for one in self.inner]} if self.inner else {})


def laws_of(config: Config, G: MatrixLieGroup, home: Place, problems: Problems) -> dict[str, Law]:
    """Return the control laws by label, checked for the group and the task."""
    task, laws = task_of(config.task), dict[str, Law]()
    for index, entry in enumerate(config.controllers):
        here = problems.at("controllers", index)
        law, files = with_data(entry.law, home, G, here)
        ready, code = law.loaded(home, G, here)
        if ready is None:
            continue
        law = ready
        label = law.name if entry.label is None else entry.label
        if refusal := task.refusal(law, G):
            here.add(refusal)
        elif entry.setpoint != "full" and isinstance(law, Designed | Previews | RunsCode):
            here.at("setpoint").add(
                f"{law.name} reads the whole reference; choose a cascade or a law of given gains"
            )
        elif not isinstance(label, str) or not label.strip() or not label.isprintable():
            here.at("label").add(f"expected text on one line, got {shown(label)}")
        elif same := alike(label, laws):
            also = f" than '{label}': capitals do not count" if same != label else ""
            held = f"an earlier controller has the label '{same}'"
            here.add(f"{held}; give this one another `label`{also}")
        else:
            gains = tensors.kp_and_kd(entry.gains, gains_group(law, G), here.at("gains"))
            keys = gains, entry.known_forces, entry.setpoint, entry.inner, entry.written
            laws[label] = Law(law, index, *keys, files, code)
    return laws


def gains_of(
    config: Config, laws: Mapping[str, Law], G: MatrixLieGroup, problems: Problems
) -> dict[str, Gains]:
    """Return the gains of every law, by label."""
    here = problems.at("gains")
    section = tensors.kp_and_kd(config.gains, G, here)
    if config.gains is not None:
        if not here:
            for name in {"kp", "kd"} - section.keys():
                here.at(name).add(f"{MISSING}: {known_keys(GainsSection, ())[name]}")
    elif any(law.law.reads_gains and len(law.gains) < 2 for law in laws.values()):
        here.add(f"{MISSING}: {known_keys(Config, ())['gains']}")
    shared = cache(partial(tensors.gains_from, section, G, here))
    by_label = {}
    for label, law in laws.items():
        axes = task_of(config.task).axes(law.law)
        at_law = problems.at("controllers", law.index, "gains")
        group = gains_group(law.law, G)
        if group is not G:
            gains = _gains_of_inner(law, group, axes, at_law)
        elif law.gains:
            gains = tensors.gains_from(section | law.gains, G, at_law, axes)
        else:
            gains = shared(axes) or (None if law.law.reads_gains else _unread_gains(G))
        if gains is not None:
            by_label[label] = gains
    return by_label


def _gains_of_inner(law: Law, group: MatrixLieGroup, axes: Any, problems: Problems) -> Gains | None:
    """Return the gains of a law on its own group, or None after noting its problems."""
    outer = law.law.formula
    inner = outer.inner if isinstance(outer, OuterLoop) else law.law
    if not (law.gains or law.law.reads_gains or inner is None or inner.reads_gains):
        return _unread_gains(group)
    for name in {"kp", "kd"} - law.gains.keys():
        problems.at(name).add(
            f"{MISSING}: {law.law.name} needs its own gains, of its law on {group.name}, "
            "such as gains: {kp: 4, kd: 2}"
        )
    return tensors.gains_from(law.gains, group, problems, axes)


def _unread_gains(G: MatrixLieGroup) -> Gains:
    """Return gains for a law that reads none."""
    return Gains(np.eye(G.size), np.eye(G.dimension))


def with_model(
    config: Config,
    laws: Mapping[str, Law],
    gains: Mapping[str, Gains],
    G: MatrixLieGroup,
    inertia: InertiaLaw,
    vehicle: Vehicle,
    forces: tuple[Force, ...],
    desired: DesiredTrajectory,
    problems: Problems,
) -> tuple[dict[str, Law], dict[str, Vehicle], DesiredTrajectory]:
    """Return the laws and the reference with what they know of the plant, and a vehicle for each.

    Its allocation is that of the directions in which the law commands a torque.
    """
    laws, pushed, directions = dict(laws), pushes(vehicle, G), list[Any]()
    vehicles = dict[str, Vehicle]()
    acts = config.plant
    acting = acts is not None and acts.forces and config.known_forces != "plant"
    plant = PlantModel(
        inertia,
        forces,
        pushed,
        is_direct(vehicle) and not acting,
        config.time.duration,
        desired.reference.flat_output(G, 0.0),
        None,
        vehicle.control.period if vehicle.control else None,
        _believed_actuators(G, vehicle),
        isinstance(desired.reference, ClosedReference),
        vehicle,
    )
    for label, entry in laws.items():
        here = problems.at("controllers", entry.index)
        flown = with_inner(vehicle, entry.inner, G)
        of_law = plant if entry.known_forces else plant._replace(forces=())
        of_law = of_law._replace(setpoint=entry.setpoint)
        if flown is not vehicle:
            exact = is_direct(flown) and not acting
            of_law = of_law._replace(
                exact=exact, actuators=_believed_actuators(G, flown), vehicle=flown
            )
            sections.check_inner(flown, here.at(INNER), problems.at(ACTUATORS))
        of_law = of_law._replace(follows=dict.fromkeys(entry.followed, gains[label]))
        laws[label] = replace(entry, law=entry.law.for_plant(G, of_law, here))
        vehicles[label] = flown = with_thrusters_for(laws[label].law, G, flown, here, problems)
        if flown is not of_law.vehicle and not problems:  # what its limits leave depends on that
            of_law = of_law._replace(actuators=_believed_actuators(G, flown), vehicle=flown)
            laws[label] = replace(entry, law=entry.law.for_plant(G, of_law, here))
        _check_taken(laws[label].law, flown, here)
        outer = laws[label].law.formula
        push = outer.direction if isinstance(outer, OuterLoop) else ()
        directions.append(push)
        task_of(config.task).check_push(push, problems.at("task"))
    if problems:
        return laws, vehicles, desired
    along = next(filter(None, directions), None)
    if along is None and pushed is not None:
        along = only_direction(pushed)
    plant = plant._replace(along=along)
    reference = desired.reference.for_plant(G, plant, problems.at("reference"))
    if reference is not desired.reference:
        pose, velocity = reference.initial(G, desired.pose, desired.velocity)
        desired = replace(desired, reference=reference, pose=pose, velocity=velocity)
    return laws, vehicles, desired


def _check_taken(law: Controller, vehicle: Vehicle, problems: Problems) -> None:
    """Note a law that commands something else than its blocks or the actuators take."""
    takes = next((a.takes for a in vehicle.actuators if a.takes != "torque"), "torque")
    if not law.commands or law.commands == takes:
        return
    which = takes if law.commands == "torque" else law.commands
    put, taking = f"only {TAKEN_BY[which]} takes {which}", "actuators"
    blocks = {part.takes for part in vehicle.actuators[: vehicle.inner]}
    if law.commands == "rates":
        put += "; list it in `inner` of this law, or in `actuators` for all laws"
    elif takes == "rates" and takes in blocks:
        put, taking = "remove rate_loop from `inner`, or choose a law that commands rates", "blocks"
    elif takes == "rates":
        put = "move rate_loop from `actuators` to `inner` of each law that commands rates"
    problems.add(f"commands {law.commands}, and {taking} take {takes}; {put}")


def _believed_actuators(G: MatrixLieGroup, vehicle: Vehicle) -> tuple[Any, ...]:
    """Return the actuators as laws know them: of the means, without failures."""
    return tuple(nominal(x).of_run(G, None) for x in (vehicle.configured or vehicle).actuators)


def with_thrusters_for(
    law: Controller, G: MatrixLieGroup, vehicle: Vehicle, at_law: Problems, problems: Problems
) -> Vehicle:
    """Return the vehicle with thrusters that know what a law commands: a torque, or their thrusts.

    The directions of a torque, or a push, decide how it is allocated to them.
    """
    if problems:
        return vehicle
    base, directions = vehicle.configured or vehicle, law.directions(G)
    is_direct, actuators = law.commands == THRUSTS, list[Any](base.actuators)
    for index, part in enumerate(actuators):
        if THRUSTER not in part.members:
            continue
        actuators[index] = thrusters = part.for_law(G, directions, is_direct)
        here = problems.at(ACTUATORS, index - base.inner)
        thrusters.check_order(G, here.at("allocation", "order"))
        if is_direct and base.inner:
            at_law.at(INNER).add("the law commands thrusts, which pass no blocks; remove this key")
        elif is_direct and index:
            here.add(
                "a law commands their thrusts, which pass no other actuator before them; list them "
                "first"
            )
    is_same = all(map(is_, actuators, base.actuators))
    if is_same:
        return vehicle
    return replace(base, actuators=tuple(actuators)).of_run(G)
