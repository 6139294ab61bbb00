"""An experiment: what the sections of a configuration describe, and how it is solved.

It is built from the data of a configuration, with everything wrong reported at once: every section
is built even where another is broken, and what depends on a broken section is skipped.
"""

import json
import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, partial
from hashlib import sha256
from itertools import repeat
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import InputError, KeyPath, Problems, alike, closest
from eqt_cli.base.option_types import (
    MISSING,
    Kind,
    as_section,
    fields_of,
    known_keys,
    option_names,
    shown,
    unknown_key,
    validated,
)
from eqt_cli.base.registry import blamed
from eqt_cli.components.groups import MatrixLieGroup, group_named
from eqt_cli.components.inertia import InertiaLaw, not_rigid
from eqt_cli.components.initial_states import (
    ListedPoses,
    ListedVelocities,
    PoseDistribution,
    VelocityDistribution,
    pose_distributions,
)
from eqt_cli.components.laws import Controller, check_calls, controllers, distinct_titles
from eqt_cli.components.log_table import MAPPING, LogMapping, MappingError
from eqt_cli.components.matrix_groups import FARTHEST, turn_of_distance
from eqt_cli.components.mechanics import Gains
from eqt_cli.components.motions import PlantModel, only_direction
from eqt_cli.components.pose_notation import ANGLES, many_turns
from eqt_cli.components.recording import read_starts
from eqt_cli.components.references import ClosedReference
from eqt_cli.components.vehicle import ACTUATORS, Vehicle
from eqt_cli.config import schema
from eqt_cli.config.schema import WORDS, Config, GainsSection, InitialSection, marked, marks_of
from eqt_cli.config.sections import (
    DesiredTrajectory,
    check_horizon,
    desired_from,
    gains_from,
    inertia_from,
    known_forces,
    kp_and_kd,
    vehicle_from,
)
from eqt_cli.config.source import ConfigSource, data_file, load_plugins, with_data
from eqt_cli.engines.engine import Engine, SolverChecks, engines
from eqt_cli.engines.horizon import MOST_EVALUATIONS, Horizon, reference_over_horizon
from eqt_cli.engines.native import Native
from eqt_cli.engines.solve_ivp import SolveIvp
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.loop.linearised import designed
from eqt_cli.loop.signals import Metric, metrics
from eqt_cli.numbers.leaves import with_fields

# The sections `solver` and `settling`: the engine of the runs, and when a run has settled ---------


def check_thresholds(
    thresholds: Mapping[str, float], G: MatrixLieGroup, problems: Problems
) -> None:
    """Note unknown parts, and angles beyond a half-turn, among thresholds by part."""
    parts = {part.name: part for part in G.parts}
    for name, threshold in thresholds.items():
        here = problems.at(name)
        if name not in parts and not (name == "rate" and G.parts[0].turns):
            here.add(unknown_key(name, parts))
        elif name in parts and parts[name].turns and threshold > math.pi:
            here.add(f"expected an angle of at most 180 deg, got {math.degrees(threshold):.6g} deg")


@dataclass(frozen=True)
class Solver:
    """The engine and the judgement of its accuracy.

    Attributes
    ----------
    engine
        The engine that integrates the runs.
    judgement
        Settings of error estimates and cross-checks.
    resolved
        The complete section.
    """

    engine: Engine
    judgement: SolverChecks
    resolved: dict[str, Any]

    @property
    def estimates_errors(self) -> bool:
        """Whether every run is solved twice to estimate its error."""
        wanted = self.judgement.error_estimate
        return self.engine.estimates_errors if wanted is None else wanted


def solver_from(section: dict[str, Any], chosen: bool, problems: Problems) -> Solver | None:
    """Return the solver of a section, or None after noting its problems.

    Parameters
    ----------
    chosen
        Whether its engine was chosen; then other keys must be those of all that can be.
    """
    name = section.get("engine")
    with problems.catching("engine"):
        if not isinstance(name, str):
            raise InputError(f"expected the name of an engine, got {shown(name)}")
        if unavailable := engines.get(name).unavailable():
            raise InputError(unavailable)
    kinds = engines.core()
    if all(kind.name != name for kind in kinds) or set(section) - set(_keys(kinds)):
        kinds = engines.all()
    owners: list[type[Any]] = [SolverChecks, *kinds]
    known = _keys(kinds)
    for key in section:
        if key not in known:
            problems.at(key).add(unknown_key(key, known))
    for key in section if chosen else ():
        having = {kind.name for kind in kinds if key in option_names(kind)}
        if having and not having >= {Native.name, SolveIvp.name}:
            problems.at(key).add(f"is a key of engine {min(having)}; add engine: {min(having)}")
    data = ({key: section[key] for key in option_names(kind) if key in section} for kind in owners)
    judgement, *built = map(validated, owners, data, repeat(problems))
    engine = next((entry for entry in built if entry and entry.name == name), None)
    if engine is not None:
        engine.check(problems)
    if engine is None or problems:
        return None
    keys = {**section, **asdict(engine), **asdict(judgement), "engine": name}
    values = {key: value for key, value in keys.items() if value is not None}
    return Solver(engine, judgement, {"engine": name} | values)


def _keys(kinds: Iterable[type[Engine]]) -> list[str]:
    """Return the keys of the section, where these are the engines."""
    owners: list[type[Any]] = [SolverChecks, *kinds]
    return ["engine", *dict.fromkeys(key for owner in owners for key in option_names(owner))]


# A checked experiment: the loops of its laws, the initial states, and the solver ------------------


SAMPLES = 2001
"""Number of times at which the reference is evaluated, besides both sides of known instants."""

MOST_WRITTEN = 1_000
"""Characters of a configuration above which the number of evaluations is reduced."""


@dataclass(frozen=True)
class Experiment:
    """A checked experiment with everything that a run needs.

    Attributes
    ----------
    config
        The validated sections.
    resolved
        The configuration with all defaults; running it gives equal numbers.
    loops
        The closed loops by controller label.
    initial_pose, initial_velocity
        Q_d(0) and V_d(0).
    poses, velocities
        Distributions of the initial poses and velocities.
    source
        The configuration with the text of each plugin, from which it can be built again anywhere.
    files
        Contents of the files with data, by their names in the configuration.
    """

    config: Config
    resolved: dict[str, Any]
    group: MatrixLieGroup
    loops: dict[str, ClosedLoop]
    initial_pose: Array
    initial_velocity: Array
    poses: PoseDistribution
    velocities: VelocityDistribution
    solver: Solver
    source: ConfigSource
    files: dict[str, str]

    @property
    def name(self) -> str:
        """Name of the experiment."""
        return str(self.config.name)

    def of_runs(self, most: int) -> "Experiment":
        """Return the experiment with its first runs only."""
        runs = min(most, self.config.ensemble.runs)
        ensemble = self.config.ensemble.model_copy(update={"runs": runs})
        return replace(self, config=self.config.model_copy(update={"ensemble": ensemble}))

    @property
    def loop(self) -> ClosedLoop:
        """The loop of the first law; all have the same group, reference and vehicle."""
        return next(iter(self.loops.values()))

    @property
    def metrics(self) -> list[Metric]:
        """The metrics of the user's own."""
        return self.config.metrics or []

    @property
    def engine(self) -> Engine:
        """The engine that integrates the runs."""
        return self.solver.engine

    @property
    def titles(self) -> dict[str, str]:
        """Display names of the controllers by label, such as EqT for ``eqt``.

        If a label starts with the name of its law, the title replaces the name: "EqT, start" for
        "eqt, start". Other labels are unchanged.
        """
        titles = {}
        for label, loop in self.loops.items():
            law = loop.controller
            is_named = re.match(rf"{re.escape(law.name)}\b", label)
            titles[label] = law.title + label.removeprefix(law.name) if is_named else label
        return distinct_titles(titles)

    @property
    def times(self) -> Array:
        """Sample times, s."""
        return np.linspace(0.0, self.config.time.duration, self.config.time.samples)

    def reference_over_horizon(self, also: Iterable[float] = ()) -> Horizon:
        """Compute Q_d, V_d, V̇_d and τ_d over the horizon, `also` at some times."""
        times = np.unique([*np.linspace(0.0, self.times[-1], SAMPLES), *also])
        written = len(json.dumps(self.resolved))
        most = int(MOST_EVALUATIONS * min(1.0, MOST_WRITTEN / written))
        start = self.initial_pose, self.initial_velocity
        return reference_over_horizon(self.loop, start, times, most)

    def remarks(self) -> Iterator[tuple[KeyPath, str]]:
        """Yield remarks on what the sections say together, and on angles, each with its key."""
        broken = not_rigid(self.group, self.loop.inertia, self.config.time.duration)
        if broken and self.config.rigid is not False:
            yield (
                ("inertia",),
                f"not the inertia of a rigid body: its {broken}; correct it, or add "
                "`rigid: false` if the system is not one rigid body",
            )
        model, acting = self.config.model, {each.name for each in self.loop.vehicle.forces}
        known = model.forces if model and not isinstance(model.forces, str) else None
        if "restoring" in {each.name for each in known or ()} - acting:
            yield (
                ("plant", "forces"),
                "lacks the weight that model.forces has, so that laws hold the body against "
                "nothing; repeat it here",
            )
        listed, loops = {each.name for each in self.metrics}, self.loops.values()
        plugin_metrics = metrics.defined_by(self.plugins.values())
        for name in plugin_metrics if self.source.data.get("metrics") is None else ():
            if name not in listed:
                yield ("plugins",), f"{metrics.get(name)().unknown(loops)}: it is left out"
        yield from self._turns()

    def _turns(self) -> Iterator[tuple[KeyPath, str]]:
        """Yield remarks on angles that are written as numbers and exceed a full turn."""
        data, parts = self.source.data, self.group.parts
        of_pose = {*ANGLES, *(name for kind in pose_distributions.all() for name in kind.angles)}
        of_pose |= {"std", "coordinates"} if all(part.turns for part in parts) else set()
        initial = data.get("initial") or {}
        for path, value, angles in (
            (("reference",), data.get("reference"), (*ANGLES, "heading")),
            (("target",), data.get("target"), ANGLES),
            ((ACTUATORS,), data.get(ACTUATORS), ("pyramid",)),
            (("initial", "pose"), initial.get("pose"), of_pose),
        ):
            yield from many_turns(value, angles, path)
        most = self.config.settling_threshold
        if isinstance(most, float) and most > FARTHEST and any(part.turns for part in parts):
            yield (
                ("settling_threshold",),
                f"no rotation is further than {FARTHEST:.3g} from another, so that {most:g} is "
                f"always kept; write '{most:g} deg' if degrees were meant",
            )

    @property
    def plugins(self) -> dict[str, str]:
        """Source text of each plugin, by its path as written in the configuration."""
        return self.source.stored_plugins or {}

    @property
    def numeric_config(self) -> dict[str, Any]:
        """Part of the resolved configuration that affects the numbers, with hashes of files.

        The names of files do not count: the folder of a result holds them under names of its own.
        """
        numeric = {key: value for key, value in self.resolved.items() if WORDS not in marks_of(key)}
        return renamed(numeric, hashes(self.files | self.plugins))

    @cached_property
    def digest(self) -> str:
        """Hash of everything that affects the numbers. Equal digests mean equal experiments."""
        text = json.dumps(self.numeric_config, sort_keys=True)
        return sha256(text.encode()).hexdigest()


def hashes(files: Mapping[str, str]) -> dict[str, str]:
    """Return the hashes of files, by their names in the configuration."""
    return {name: sha256(text.encode()).hexdigest() for name, text in files.items()}


def renamed(data: Any, names: Mapping[str, str]) -> Any:
    """Return configuration data with the names of files replaced."""
    if isinstance(data, dict):
        return {key: renamed(value, names) for key, value in data.items()}
    if isinstance(data, list):
        return [renamed(value, names) for value in data]
    return names.get(data, data) if isinstance(data, str) else data


# From the sections of a configuration to its experiment -------------------------------------------


@dataclass(frozen=True)
class Start:
    """The initial states of the runs.

    Attributes
    ----------
    poses, velocities
        Q_d(0)⁻¹ Q(0) and V(0) − V_d(0).
    resolved
        The complete section of the configuration.
    rows
        Number of runs for which there are initial states; None for any number.
    files
        Contents of the files with data, by their names.
    """

    poses: PoseDistribution
    velocities: VelocityDistribution
    resolved: dict[str, Any]
    rows: int | None = None
    files: dict[str, str] = field(default_factory=dict)


TAKEN_BY = {"rates": "{kind: rate_loop, bandwidth: 40}", "dipole": "{kind: magnetorquers, …}"}
"""The actuators of commands other than a torque."""

OF_EVERY_LAW = ("label", "gains")
"""The keys of an entry of `controllers` that no law has for itself."""


@blamed()
@np.errstate(all="ignore")  # what overflows is found by the checks, and said by them alone
def assemble(source: ConfigSource, trust_plugins: bool = False) -> Experiment:
    """Make the experiment of a configuration that names its engine, and evaluate nothing of it.

    Laws that are designed for their loops have no gains yet; `designed_laws` gives them.

    Raises
    ------
    ConfigError
        With every problem, each at its place in the file.
    """
    problems = Problems(source.place)
    plugins = load_plugins(source, trust_plugins, problems)
    problems.raise_if_any()  # without its plugins a configuration cannot be judged
    read = _Sections(source, trust_plugins, problems)
    group, sections, laws = read.group, read.sections, read.laws
    read.read_controllers()
    task, initial = sections["task"], sections["initial"]
    desired = inertia = start = solver = None
    gains: dict[str, Gains | None] = {}
    if sections["reference"] is not None or source.data.get("reference") is None:
        parts = task, sections["reference"], sections["target"], group
        make: Any = partial(desired_from, *parts, source, problems)
        desired = source.made("desired", problems, make, *parts)
    if (section := sections["solver"]) is not None:
        make = partial(solver_from, section, source.chosen, problems.at("solver"))
        solver = source.made("built solver", problems, make, section, source.chosen)
    horizon = sections["time"].duration if sections["time"] else 0.0
    if group and sections["inertia"] is not None:
        of = sections["inertia"], group, horizon
        make = partial(inertia_from, *of, problems.at("inertia"))
        inertia = source.made("built inertia", problems, make, *of)
    vehicle = vehicle_from(sections, group, horizon, problems, inertia) if group else None
    if group and solver and vehicle and vehicle.control is None:
        calls = solver.engine.calls_laws or source.chosen  # a chosen engine was tried
        for law in laws.values():
            check_calls(law.law, calls, problems.at("controllers", law.index))
    if group:
        gains = read.gains(group)
        if inertia and vehicle and desired and sections["time"]:
            desired = read.with_model(group, inertia, vehicle, desired)
        if isinstance(thresholds := sections["settling_threshold"], dict):
            check_thresholds(thresholds, group, problems.at("settling_threshold"))
    if initial:
        start = read.start(initial, desired)
    config = read.config(desired, start)
    problems.raise_if_any()
    assert config and group and desired and inertia and vehicle and start and solver
    reference, axis = desired.reference, tuple(read.point.axis) if read.point else ()
    loops = {
        label: ClosedLoop(group, inertia, law_gains, reference, laws[label].law, vehicle, axis=axis)
        for label, law_gains in gains.items()
        if law_gains is not None
    }
    plugin_metrics = _metrics_of(sections["metrics"], plugins, loops.values(), problems)
    problems.raise_if_any()
    config = config.model_copy(update={"metrics": plugin_metrics}) if plugin_metrics else config
    complete = read.resolved(config) | {
        **desired.resolved,
        "controllers": [law.resolved | {"label": label} for label, law in laws.items()],
        "initial": start.resolved,
        "solver": solver.resolved,
    }
    return Experiment(
        config,
        complete,
        group,
        loops,
        desired.pose,
        desired.velocity,
        start.poses,
        start.velocities,
        solver,
        replace(source, stored_plugins=plugins | read.code),
        desired.files | start.files | read.files,
    )


def designed_laws(experiment: Experiment, problems: Problems) -> Experiment:
    """Return the experiment with the gains of the laws that are designed for their loops."""
    made, horizon = dict(experiment.loops), float(experiment.times[-1])
    for index, (label, loop) in enumerate(experiment.loops.items()):
        if not (count := loop.controller.pieces):
            continue
        with problems.catching("controllers", index):
            times = np.linspace(0.0, horizon, count + 1)
            if (control := loop.vehicle.control) is not None:
                last = max(1, math.ceil(horizon / control.period - 1e-9)) - 1
                step = max(1, round(horizon / count / control.period))
                middles = control.period * (0.5 + np.unique([*range(0, last, step), last]))
                times = np.minimum(middles, horizon)
            times = np.array([0.0, *times, horizon])
            shown = experiment.reference_over_horizon(times)
            if shown.spent or not shown.finite.all():
                return experiment  # the checks of the reference say so
            where = np.searchsorted(shown.times, times)
            made[label] = designed(loop, times, shown.pose[where], shown.velocity[where])
    return replace(experiment, loops=made)


def _metrics_of(
    listed: Sequence[Metric | None] | None,
    plugins: Mapping[str, str],
    loops: Collection[ClosedLoop],
    problems: Problems,
) -> list[Metric]:
    """Return the metrics that are listed, or those of the plugins whose signals a loop has."""
    if listed is None:
        names = metrics.defined_by(plugins.values())
        listed = [Kind(metrics).read(name, problems.at("metrics")) for name in names]
        return [metric for metric in listed if metric and not metric.unknown(loops)]
    valid = [metric for metric in listed if metric is not None]
    names = [metric.name for metric in valid]
    for name in dict.fromkeys(name for name in names if names.count(name) > 1):
        problems.at("metrics").add(f"{name} is listed twice; a result has one number of a name")
    return valid


class _Sections:
    """The sections of a configuration, and what is made of them.

    Attributes
    ----------
    group
        The group; None where it is not known.
    sections
        The validated sections by name; None for those that are missing or broken.
    laws
        The control laws by label.
    files
        The contents of the files in which laws are given.
    code
        The texts of the code that laws execute, by their files.
    """

    def __init__(self, source: ConfigSource, trusted: bool, problems: Problems) -> None:
        self.source, self.trusted, self.problems = source, trusted, problems
        here, name = problems.at("group"), source.data.get("group")
        self.group = source.made("built group", here, partial(_group, source.data, here), name)
        known = known_keys(Config, ())
        for key in [key for key in source.data if key not in known]:
            # The section's key that is written without its section: gains.kp for kp.
            owners = (name for name in Config.model_fields if key in known_keys(Config, (name,)))
            elsewhere = next((f"{name}.{key}" for name in owners), None)
            problems.at(key).add(unknown_key(key, known, elsewhere))
        valid = fields_of(Config, source.data, problems, self.group, source.made)
        self.sections: dict[str, Any] = dict.fromkeys(known) | valid
        task, threshold = self.sections["task"], self.sections["settling_threshold"]
        self.point = task if isinstance(task, schema.PointSection) else None
        if self.point and isinstance(threshold, float):  # of the axis, as of a rotation
            turn = float(turn_of_distance(np.array(threshold)))
            self.sections["settling_threshold"] = {"rotation": turn}
        self.laws: dict[str, _Entry] = {}
        self.files: dict[str, str] = {}
        self.code: dict[str, str] = {}

    def read_controllers(self) -> None:
        """Read the control laws."""
        task, G = self.sections["task"], self.group
        for index, entry in enumerate(self.sections["controllers"] or []):
            here = self.problems.at("controllers", index)
            options = dict(entry) if isinstance(entry, dict) else {}
            label, law_gains = options.pop("label", None), options.pop("gains", None)
            named, gains = options if isinstance(entry, dict) else entry, None
            law: Controller | None = Kind(controllers).read(named, here, G, OF_EVERY_LAW)
            if law_gains is not None:
                of = None if law is None or G is None else law.gains_group(G)
                gains = validated(GainsSection, law_gains, here.at("gains"), group=of)
            if law is not None and G is not None:
                law, texts = with_data(law, self.source, here)
                self.files |= texts
                law.check(G, here)
                law, texts = law.loaded(self.source, self.trusted, G, here)
                self.code |= texts
            if law is None:
                continue
            wrong = self.point.refusal(law, G) if self.point and G is not None else ""
            if isinstance(task, str) and law.tasks and task not in law.tasks:
                fitting = ", ".join(kind.name for kind in controllers.all() if task in kind.tasks)
                wrong = f"{law.name} is a law for task: {' or '.join(law.tasks)}; for task: {task} "
                wrong += f"use {fitting}"
            if wrong:
                here.add(wrong)
                continue
            label = law.name if label is None else label
            if not isinstance(label, str) or not label.strip() or not label.isprintable():
                here.at("label").add(f"expected text on one line, got {shown(label)}")
            elif same := alike(label, self.laws):
                also = f" than '{label}': capitals do not count" * (same != label)
                held = f"an earlier controller has the label '{same}'"
                here.add(f"{held}; give this one another `label`{also}")
            else:
                law_gains = gains.model_dump(exclude_none=True) if gains else {}
                law_gains = kp_and_kd(law_gains, law.gains_group(G), here.at("gains")) if G else {}
                self.laws[label] = _Entry(law, index, law_gains, tuple(options))

    def gains(self, G: MatrixLieGroup) -> dict[str, Gains | None]:
        """Return the gains of every law, and give laws the options that follow them."""
        data, here = self.source.data, self.problems.at("gains")
        section = data.get("gains")
        known = {}
        if isinstance(section, dict):
            known = kp_and_kd(fields_of(GainsSection, section, here, G), G, here)
            for name in [] if here else {"kp", "kd"} - known.keys():
                here.at(name).add(f"{MISSING}: {known_keys(GainsSection, ())[name]}")
            self.sections["gains"] = GainsSection.model_construct(**known)
        by_label = dict[str, Gains | None]()
        meant = closest("gains", data.keys() - Config.model_fields.keys())
        if (
            section is None
            and not meant
            and any(map(_reads_gains, self.sections["controllers"] or []))
        ):
            here.add(f"{MISSING}: {known_keys(Config, ())['gains']}")
        for label, law in self.laws.items():
            axes = self.point and self.point.axes(law.law)
            shared = gains_from(known, G, here, axes if law.law.gains_group(G) is G else None)
            by_label[label] = self._gains_of(law, known, shared, G, axes)
            self.laws[label] = law.with_gains(G, by_label[label])
        return by_label

    def _gains_of(
        self, entry: "_Entry", known: Any, shared: Gains | None, G: MatrixLieGroup, axes: Any
    ) -> Gains | None:
        """Return the gains of a law; None after noting its problems."""
        law, law_gains, problems = entry.law, entry.gains, self._at(entry).at("gains")
        group, reads = law.gains_group(G), law.reads_gains or law.inside_reads_gains
        if not (law_gains or reads) and (shared is None or group is not G):
            return Gains(np.eye(group.size), np.eye(group.dimension))  # which it never reads
        if group is G:
            return gains_from(known | law_gains, G, problems, axes) if law_gains else shared
        for name in {"kp", "kd"} - law_gains.keys():
            problems.at(name).add(
                f"{MISSING}: {law.name} needs its own gains, of its law on {group.name}, "
                "such as gains: {kp: 4, kd: 2}"
            )
        return gains_from(law_gains, group, problems, axes)

    def _at(self, entry: "_Entry") -> Problems:
        return self.problems.at("controllers", entry.index)

    def with_model(
        self, G: MatrixLieGroup, inertia: InertiaLaw, vehicle: Vehicle, desired: DesiredTrajectory
    ) -> DesiredTrajectory:
        """Give laws, and the reference that is returned, what they know of the plant."""
        sections, laws, pushes = self.sections, self.laws, vehicle.pushes(G)
        forces = known_forces(sections, vehicle, G)
        acts, model, horizon = sections["plant"], sections["model"], sections["time"].duration
        acting = acts is not None and acts.forces and not (model and model.forces == "plant")
        exact, flat = vehicle.is_direct and not acting, desired.reference.flat_output(G, 0.0)
        period = vehicle.control.period if vehicle.control else None
        acting = () if self.problems else (vehicle.configured or vehicle).actuators
        known = tuple(part.nominal.of_run(G, None) for part in acting)
        foreseen = isinstance(desired.reference, ClosedReference)
        plant = PlantModel(
            inertia, forces, pushes, exact, horizon, flat, None, period, known, foreseen
        )
        takes = next((a.takes for a in vehicle.actuators if a.takes != "torque"), "torque")
        for label, entry in laws.items():
            laws[label] = replace(entry, law=entry.law.for_plant(G, plant, self._at(entry)))
            commands = entry.law.commands
            if commands and commands != takes:
                which = takes if commands == "torque" else commands
                put = f"only {TAKEN_BY[which]} takes {which}"
                self._at(entry).add(f"commands {commands}, and actuators take {takes}; {put}")
            push = laws[label].law.direction
            if self.point and push and abs(np.dot(self.point.axis, push)) < 1 - 1e-9:
                self.problems.at("task", "axis").add(
                    f"expected the direction of the push, {list(push)}"
                )
        if self.problems:
            return desired
        directions: list[Any] = [entry.law.direction for entry in laws.values()]
        along = next(filter(None, directions), None)
        if along is None and pushes is not None:
            along = only_direction(pushes)
        plant = plant._replace(along=along)
        reference = desired.reference.for_plant(G, plant, self.problems.at("reference"))
        if reference is desired.reference:
            return desired
        pose, velocity = reference.initial(G, desired.pose, desired.velocity)
        return replace(desired, reference=reference, pose=pose, velocity=velocity)

    def start(self, section: InitialSection, desired: DesiredTrajectory | None) -> Start | None:
        """Return where the runs start, by distributions or by the rows of a file."""
        problems = self.problems.at("initial")
        if section.file is not None:
            return self._start_from_file(section, section.file, desired, problems)
        for key in section.model_fields_set & {"relative", MAPPING}:
            problems.at(key).add(
                "applies only to poses from a `file`; give `file` too, or remove this key"
            )
        if problems or self.group is None:
            return None
        resolved = section.model_dump(include={"pose", "velocity"})
        return Start(section.pose, section.velocity, resolved)

    def _start_from_file(
        self, section: InitialSection, name: str, desired: DesiredTrajectory | None, here: Problems
    ) -> Start | None:
        """Read the rows of `initial.file`; return None after noting their problems.

        Relative poses are errors to the reference, Q(0) = Q_d(0) · pose and V(0) = V_d(0) + V.
        Missing velocities are 0.
        """
        for key in ("pose", "velocity"):
            if key in section.model_fields_set:
                here.at(key).add(f"{name} gives the {key}, one row per run; remove this key")
        if (G := self.group) is None:
            return None
        mapping = section.mapping or LogMapping()
        mapping.check(here.at(MAPPING))
        if here.at(MAPPING):
            return None
        with here.catching("file"):
            text = data_file(self.source, name)
            try:
                poses, velocities, notes = read_starts(text, name, G, mapping)
            except MappingError as error:
                here.at(MAPPING, *error.path).add(str(error))
                return None
            if velocities is None:
                velocities = np.zeros((len(poses), G.dimension))
            if desired is None:
                return None
            if not section.relative:
                poses, velocities = G.inverse(desired.pose) @ poses, velocities - desired.velocity
            resolved = section.model_dump(include={"file", "relative", MAPPING}, exclude_none=True)
            listed = ListedPoses(poses, notes), ListedVelocities(velocities)
            return Start(*listed, resolved, len(poses), {name: text})
        return None

    def config(self, desired: DesiredTrajectory | None, start: Start | None) -> Config | None:
        """Return the configuration, if its sections agree on the number of runs and the horizon."""
        G, problems = self.group, self.problems
        if problems or not (G and desired and start):
            return None
        config = Config.model_construct(set(self.source.data), **self.sections)
        over_time: dict[str, Any] = {"reference": desired.reference}
        over_time |= {f"controllers[{entry.index}]": entry.law for entry in self.laws.values()}
        for place, component in over_time.items():
            check_horizon(component, place, G, config.time.duration, problems)
        if start.rows is None:
            return config
        if "runs" not in config.ensemble.model_fields_set:
            ensemble = config.ensemble.model_copy(update={"runs": start.rows})
            return config.model_copy(update={"ensemble": ensemble})
        if config.ensemble.runs > start.rows:
            problems.at("ensemble", "runs").add(
                f"expected at most {start.rows}, the number of rows of {config.initial.file}, "
                f"got {config.ensemble.runs}"
            )
        return config

    def resolved(self, config: Config) -> dict[str, Any]:
        """Return the sections with every default; those for searches change no run."""
        searches = set(marked(schema.SEARCH))
        complete = config.model_dump(exclude=searches, exclude_none=True, warnings="none")
        if config.plant and config.plant.forces and config.model and config.model.forces:
            complete["model"] = self.source.data["model"]  # as it is written, as in all digests
        return complete


def _reads_gains(entry: Any) -> bool:
    """Whether an entry of `controllers` needs the section `gains`."""
    options = entry if isinstance(entry, dict) else {"kind": entry}
    gains, name = options.get("gains"), options.get("kind")
    kind = controllers.get(name) if name in controllers.names() else None
    if kind is None or (isinstance(gains, dict) and len(gains) > 1):
        return False
    reads: Any = kind.reads_gains
    # Code reads those of the law that it claims to be, if it claims any.
    return _reads_gains(options.get("as")) if isinstance(reads, property) else bool(reads)


def _group(data: dict[str, Any], problems: Problems) -> MatrixLieGroup | None:
    """The group; without one, the message says which sections could not be checked."""
    if not isinstance(name := data.get("group"), str):
        return None
    try:
        return group_named(name)
    except InputError as error:
        unchecked = ", ".join(key for key in marked(schema.ON_GROUP) if key in data)
        more = f", so the numbers of {unchecked} were not checked" if unchecked else ""
        problems.add(error.args[0].replace(";", f"{more};", 1), *error.remedies)
    return None


@dataclass(frozen=True)
class _Entry:
    """An entry of `controllers`: a law, its index, its gains, and the names of written options."""

    law: Controller
    index: int
    gains: dict[str, Any]
    written: tuple[str, ...]
    followed: tuple[str, ...] = ()

    def with_gains(self, G: MatrixLieGroup, gains: Gains | None) -> "_Entry":
        """The entry with the options that follow the gains, where they are not written."""
        defaults = {} if gains is None else self.law.defaults(G, gains)
        defaults = {name: value for name, value in defaults.items() if name not in self.written}
        return replace(self, law=with_fields(self.law, **defaults), followed=tuple(defaults))

    @property
    def resolved(self) -> dict[str, Any]:
        """The section; options that follow the gains stay away, and follow them again."""
        section = as_section(self.law) | ({"gains": self.gains} if self.gains else {})
        return {name: value for name, value in section.items() if name not in self.followed}
