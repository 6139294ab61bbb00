"""An experiment: what the sections of a configuration describe, and how it is solved.

First, each key is validated; then parts that need several sections or files are built. Each round
reports all its problems together.
"""

import json
import math
import re
from collections import ChainMap
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from hashlib import sha256
from operator import is_
from typing import Any

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array, distinct, ordered_product
from eqt_cli.base.errors import InputError, KeyPath, Problems
from eqt_cli.base.extensions import function_for
from eqt_cli.base.option_types import Kind, validated, with_values
from eqt_cli.base.registry import blamed, code_of
from eqt_cli.base.stored import distinct_titles
from eqt_cli.components.accelerometer import reads_specific_force
from eqt_cli.components.groups import MatrixLieGroup, group_named
from eqt_cli.components.inertia import InertiaLaw, not_rigid
from eqt_cli.components.initial_states import (
    ListedPoses,
    ListedVelocities,
    PoseDistribution,
    Stream,
    VelocityDistribution,
    generator,
    pose_distributions,
)
from eqt_cli.components.laws import Designed, RunsCode, counteracts
from eqt_cli.components.matrix_groups import FARTHEST
from eqt_cli.components.pose_notation import ANGLES, many_turns
from eqt_cli.components.pose_tables import MAPPING, LogMapping, MappingError, read_starts
from eqt_cli.components.tasks import task_of
from eqt_cli.components.vehicle import ACTUATORS, Vehicle, navigates, without_inner
from eqt_cli.config import schema, sections, tensors
from eqt_cli.config.controllers import Law, gains_of, laws_of, with_model
from eqt_cli.config.document import Document, Place, data_file, load_plugins
from eqt_cli.config.marks import ON_GROUP, SEARCH, VEHICLE, WORDS
from eqt_cli.config.schema import Config
from eqt_cli.config.sections import DesiredTrajectory
from eqt_cli.engines.choice import Solver
from eqt_cli.engines.engine import Compiled, Engine
from eqt_cli.engines.horizon import MOST_EVALUATIONS, Horizon, missed, reference_over_horizon
from eqt_cli.loop import bounds
from eqt_cli.loop.closed_loop import ClosedLoop, parts_of
from eqt_cli.loop.linearised import designed
from eqt_cli.loop.signals import Metric, metrics

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
    laws
        The control laws by label, with their gains as they are written.
    loops
        The closed loops by label.
    desired
        The reference and where it starts.
    start
        Distributions of the initial poses and velocities.
    document
        The configuration with the text of all code, from which it can be built again anywhere.
    opened
        Hashes of the files that code of somebody else opened while this was built, by name.
    """

    config: Config
    group: MatrixLieGroup
    laws: dict[str, Law]
    loops: dict[str, ClosedLoop]
    desired: DesiredTrajectory
    start: "Start"
    solver: Solver
    document: Document
    opened: dict[str, str] = field(default_factory=dict)

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
        """The loop of the first law; all have the same group and reference."""
        return next(iter(self.loops.values()))

    @cached_property
    def vehicle(self) -> Vehicle:
        """The vehicle that all laws share, without the blocks of any."""
        return without_inner(self.loop.vehicle)

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

    def reference_over_horizon(self, also: Iterable[float] = (), *, share: float = 1.0) -> Horizon:
        """Compute Q_d, V_d, V̇_d and τ_d over a share of the horizon, `also` at some times."""
        samples = round(share * (SAMPLES - 1)) + 1
        times = distinct([*np.linspace(0.0, share * self.times[-1], samples), *also])
        most = int(MOST_EVALUATIONS * min(1.0, MOST_WRITTEN / len(json.dumps(self.resolved))))
        start = self.desired.pose, self.desired.velocity
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
        forces, acting = self.config.known_forces, {x.name for x in self.loop.vehicle.forces}
        if isinstance(forces, list) and "restoring" in {x.name for x in forces} - acting:
            yield (
                ("plant", "forces"),
                "lacks the weight that model.forces has, so that laws hold the body against "
                "nothing; repeat it here",
            )
        listed, loops = {metric.name for metric in self.metrics}, self.loops.values()
        plugin_metrics = metrics.defined_by(self.plugins.values())
        if self.document.data.get("metrics") is None:
            for name in plugin_metrics:
                if name not in listed:
                    yield ("plugins",), f"{metrics.get(name)().unknown(loops)}: it is left out"
        yield from self._turns()

    def _turns(self) -> Iterator[tuple[KeyPath, str]]:
        """Yield remarks on angles that are written as numbers and exceed a full turn."""
        data, parts = self.document.data, self.group.parts
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
        return self.document.home.plugins or {}

    @property
    def files(self) -> dict[str, str]:
        """Contents of the files with data, by their names in the configuration."""
        of_laws = (law.files for law in self.laws.values())
        return dict(ChainMap(self.desired.files, self.start.files, *of_laws))

    @cached_property
    def resolved(self) -> dict[str, Any]:
        """The configuration with all defaults; running it gives equal numbers."""
        config = self.config
        complete = config.model_dump(  # without what searches read, which changes no run
            exclude=set(schema.marked(SEARCH)), exclude_none=True, warnings="none"
        )
        if config.plant and config.plant.forces and config.known_forces:
            complete["model"] = self.document.data["model"]  # as it is written, as in all digests
        if config.gains:
            complete["gains"] = tensors.kp_and_kd(config.gains, self.group, Problems())
        return complete | {
            **self.desired.resolved,
            "controllers": [law.resolved | {"label": name} for name, law in self.laws.items()],
            "initial": self.start.resolved,
            "solver": self.solver.resolved,
        }

    @cached_property
    def code(self) -> dict[str, str]:
        """Hashes of the files of code of somebody else, but for the plugins themselves, by name."""
        parts = self.loops, self.start, self.metrics, self.engine
        return code_of(self.plugins.values(), *parts) | self.opened

    @property
    def numeric_config(self) -> dict[str, Any]:
        """Part of the resolved configuration that affects the numbers, with hashes of files."""
        return numeric(self.resolved, self.files | self.plugins, self.code)

    @cached_property
    def digest(self) -> str:
        """Hash of everything that affects the numbers. Equal digests mean equal experiments."""
        return digest_of(self.numeric_config)


def numeric(
    resolved: Mapping[str, Any], files: Mapping[str, str], code: Mapping[str, str]
) -> dict[str, Any]:
    """Return the part of a resolved configuration that affects the numbers, with hashes of files.

    The names of files do not count, because the folder of a result holds them under other names.
    """
    numbers = {key: value for key, value in resolved.items() if WORDS not in schema.marks_of(key)}
    return {**renamed(numbers, hashes(files)), **({"code": dict(code)} if code else {})}


def digest_of(data: Any) -> str:
    """Return the hash of plain data."""
    return sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


def hashes(files: Mapping[str, str]) -> dict[str, str]:
    """Return the hashes of files, by their names in the configuration."""
    return {name: sha256(text.encode()).hexdigest() for name, text in files.items()}


def renamed(data: Any, names: Mapping[str, str]) -> Any:
    """Return configuration data with the names of files replaced."""
    return with_values(data, lambda x: names.get(x, x) if isinstance(x, str) else x)


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

    def numbers(self, G: MatrixLieGroup, seed: int, run: int) -> tuple[Array, Array]:
        """Return the random numbers of a run, ``(m,)`` for its pose and then for its velocity."""
        random = generator(seed, Stream.INITIAL_STATE, run)
        return self.poses.draw_of_run(G, random, run), self.velocities.draw_of_run(G, random, run)


class LastPoint:
    """The parts built at the last point of a sweep, by their inputs.

    The next point takes over what it would make of the same objects.
    """

    def __init__(self) -> None:
        self.data: dict[str, Any] = {}
        self.config: Config | None = None
        self._values: dict[str, tuple[Any, ...]] = {}

    def take(self, name: str, problems: Problems, make: Callable[[], Any], *parts: Any) -> Any:
        """Return the part built from these inputs; the last one if they have not changed."""
        *last, value = self._values.get(name, (None,))
        if len(last) != len(parts) or not all(map(is_, last, parts)):
            value = make()
            if not problems:
                self._values[name] = *parts, value
        return value


@blamed()
@np.errstate(all="ignore")  # what overflows is found by the checks, and said by them alone
def assemble(document: Document, last: LastPoint | None = None) -> Experiment:
    """Make the experiment of a configuration, and evaluate nothing of it.

    First every key is validated; then what needs several of them is built. Laws that are designed
    for their loops have no gains yet; `designed_laws` gives them.

    Parameters
    ----------
    last
        The last point of a sweep, whose parts are taken over where their sections are the same.

    Raises
    ------
    ConfigError
        With every problem of the keys or, if they are right, of the parts, each at its place.
    """
    problems, home, last = Problems(document.place), document.home, last or LastPoint()
    plugins = load_plugins(document, problems)
    problems.raise_if_any()  # without its plugins a configuration cannot be judged
    G, config = _validated(document, problems, last)
    task, time = task_of(config.task), config.time
    at_threshold = problems.at("settling_threshold")
    threshold = task.threshold(config.settling_threshold, G, at_threshold)
    _check_window(config.measure, time, problems.at("measure"))
    config = config.model_copy(update={"settling_threshold": threshold})

    def take(name: str, make: Callable[[], Any], *parts: Any) -> Any:
        return last.take(name, problems, make, G, *parts)

    laws: dict[str, Law] = take(
        "laws", lambda: laws_of(config, G, home, problems), config.task, config.controllers
    )
    desired: DesiredTrajectory | None = take(
        "desired",
        lambda: sections.desired_from(config, G, home, problems),
        *(config.task, config.reference, config.target),
    )
    at_inertia = problems.at("inertia")
    inertia: InertiaLaw | None = take(
        "inertia",
        lambda: tensors.inertia_from(config.inertia, G, time.duration, at_inertia),
        *(config.inertia, time),
    )
    vehicle: Vehicle = take(
        "vehicle",
        lambda: sections.vehicle_from(config, G, problems, inertia),
        *(getattr(config, name) for name in schema.marked(VEHICLE)),
        *(inertia, time),
        *(part for _, part in sections.inner_clocks(config, problems)),
    )
    if vehicle.control is None:
        calls = config.solver.is_auto or not isinstance(config.solver.engine, Compiled)
        for law in laws.values():
            sections.check_calls(law.law, calls, problems.at("controllers", law.index))
    gains = gains_of(config, laws, G, problems)
    problems.raise_if_any()
    assert desired
    assert inertia
    laws = {label: law.with_gains(G, gains[label]) for label, law in laws.items()}
    forces = sections.known_forces(config, vehicle, G)
    laws, vehicles, desired = with_model(
        config, laws, gains, G, inertia, vehicle, forces, desired, problems
    )
    start = start_from(config, G, desired, home, problems.at("initial"))
    if config.draws is not None and start is not None:
        start = function_for(purposes.starts_of_draws)(
            start, config, document, problems, last.take, G
        )
    sections.check_horizon(desired.reference, "reference", G, time.duration, problems)
    for law in laws.values():
        place = f"controllers[{law.index}]"
        sections.check_horizon(law.law, place, G, time.duration, problems)
    config = with_runs_of(config, start, problems)
    problems.raise_if_any()
    assert start
    felt = [label for label, law in laws.items() if reads_specific_force(law.law)]
    if vehicle.more_sensors[1] and not navigates(vehicle):
        # Other laws do not pay for an accelerometer.
        bare = vehicle.more_sensors[0], (), ()
        parts = {id(plant): plant.configured or plant for plant in vehicles.values()}
        unfelt = {k: replace(plant, more_sensors=bare).of_run(G) for k, plant in parts.items()}
        vehicles = {k: v if k in felt else unfelt[id(v)] for k, v in vehicles.items()}
        if not felt:
            problems.at("sensors", "accelerometer").add(
                "is read by no law; write `linear: accelerometer` in one of kind indi or "
                "`estimator: {kind: navigation}`, or remove it"
            )
    loops = {
        label: ClosedLoop(
            *(G, inertia, gains[label], desired.reference, law.law),
            vehicles[label],
            task=task,
            known_forces=forces if law.known_forces and counteracts(law.law) else (),
            setpoint=law.setpoint,
        )
        for label, law in laws.items()
    }
    if metrics_of_runs := _metrics_of(config, plugins, loops.values(), problems):
        config = config.model_copy(update={"metrics": metrics_of_runs})
    if config.failed_when is not None:
        most = bounds.read(config.failed_when, loops, problems.at("failed_when"))
        config = config.model_copy(update={"failed_when": most})
    problems.raise_if_any()
    _check_instants(
        next(iter(loops.values())), config.time.duration, config.solver.engine.rtol, problems
    )
    problems.raise_if_any()
    texts = plugins | dict(ChainMap(*(law.code for law in laws.values())))
    document = replace(document, home=replace(home, plugins=texts, trusted=True))
    return Experiment(config, G, laws, loops, desired, start, config.solver, document)


def _check_window(
    window: schema.MeasureSection | None, time: schema.TimeSection, problems: Problems
) -> None:
    """Note a window without two samples, or one that begins or ends after the runs."""
    if window is None:
        return
    start, end = window.start, time.duration
    stop = end if window.stop is None else window.stop
    if not 0 <= start < end:
        problems.at("start").add(
            f"expected 0 or more, and less than time.duration, {end:g} s, got {start:g}"
        )
    elif stop > end:
        problems.at("stop").add(f"expected at most time.duration, {end:g} s, got {stop:g}")
    elif stop <= start:
        problems.at("stop").add(f"expected more than the start, {start:g} s, got {stop:g}")
    else:
        times, rounding = np.linspace(0.0, end, time.samples), 1e-9 * end
        inside = np.count_nonzero((times >= start - rounding) & (times <= stop + rounding))
        if inside < 2:
            problems.add(
                f"from {start:g} to {stop:g} s there is {inside or 'no'} sample, and they are "
                f"{times[1]:g} s apart; widen the window, or set time.samples higher"
            )


def _check_instants(loop: ClosedLoop, until: float, rtol: float, problems: Problems) -> None:
    """Note expressions that change their piece too often, and of which steps lose something."""
    parts = {part.path: part.part for part in parts_of(loop) if not part.is_foreign}
    parts |= {("model", "forces", k): force for k, force in enumerate(loop.known_forces)}
    for path, part in (parts | {("inertia",): loop.inertia}).items():
        if hasattr(part, "instants"):
            with problems.at(*path).catching():
                part.instants(loop.group, until)
                expressions, named = getattr(part, "expressions", ()), getattr(part, "named", None)
                for expression in filter(None, named.bound(expressions) if named else expressions):
                    if lost := missed(expression, until, rtol):
                        problems.at(*path).add(lost)


def _validated(
    document: Document, problems: Problems, last: LastPoint
) -> tuple[MatrixLieGroup, Config]:
    """Return the group and the validated keys; at a further point, validate what differs.

    Raises
    ------
    ConfigError
        With the problems of all keys.
    """
    data = schema.without_absent(document.data, problems)
    if data.get("draws") is not None:
        data = function_for(purposes.draws)(document, problems, last.take)
        problems.raise_if_any()
    name, at_group = data.get("group"), problems.at("group")
    G = last.take("group", at_group, lambda: _group(data, at_group), name)
    config, keys = last.config, data.keys() | last.data.keys()
    differing = [key for key in keys if data.get(key) is not last.data.get(key)]
    if config is None or "group" in differing or not data.keys() >= {*differing}:
        config = validated(Config, data, problems, group=G)
    elif differing:
        kinds = {key: Config.model_fields[key].rebuild_annotation() for key in differing}
        changed = {
            key: validated(kind, data[key], problems.at(key), group=G)
            for key, kind in kinds.items()
        }
        config = config.model_copy(update=changed)
    problems.raise_if_any()
    if config.group != G.name:  # SO(3), so3
        config = config.model_copy(update={"group": G.name})
    last.data, last.config = data, config
    return G, config


def _group(data: dict[str, Any], problems: Problems) -> MatrixLieGroup | None:
    """Return the group; without one, note which sections could not be checked."""
    if not isinstance(name := data.get("group"), str):
        return None
    try:
        return group_named(name)
    except InputError as error:
        unchecked = ", ".join(key for key in schema.marked(ON_GROUP) if key in data)
        more = f", so the numbers of {unchecked} were not checked" if unchecked else ""
        problems.add(error.args[0].replace(";", f"{more};", 1), *error.remedies)
    return None


def start_from(
    config: Config, G: MatrixLieGroup, desired: DesiredTrajectory, home: Place, problems: Problems
) -> Start | None:
    """Return where the runs start: by distributions, or by the rows of a file.

    Relative poses in a file are errors to the reference, Q(0) = Q_d(0) · pose and
    V(0) = V_d(0) + V. Missing velocities are 0.
    """
    section = config.initial
    name = section.file
    if name is None:
        for key in section.model_fields_set & {"relative", MAPPING}:
            problems.at(key).add(
                "applies only to poses from a `file`; give `file` too, or remove this key"
            )
        resolved = config.model_dump(include={"initial": {"pose", "velocity"}})["initial"]
        return Start(section.pose, section.velocity, resolved)
    for key in section.model_fields_set & {"pose", "velocity"}:
        problems.at(key).add(f"{name} gives the {key}, one row per run; remove this key")
    mapping = section.mapping or LogMapping()
    mapping.check(problems.at(MAPPING))
    if problems.at(MAPPING):
        return None
    with problems.catching("file"):
        text = data_file(home, name)
        try:
            poses, velocities, notes = read_starts(text, name, G, mapping)
        except MappingError as error:
            problems.at(MAPPING, *error.path).add(str(error))
            return None
        if velocities is None:
            velocities = np.zeros((len(poses), G.dimension))
        if not section.relative:
            poses = ordered_product(G.inverse(desired.pose)[None], poses)
            velocities = velocities - desired.velocity
        resolved = section.model_dump(include={"file", "relative", MAPPING}, exclude_none=True)
        listed = ListedPoses(poses, notes), ListedVelocities(velocities)
        return Start(*listed, resolved, len(poses), {name: text})
    return None


def with_runs_of(config: Config, start: Start | None, problems: Problems) -> Config:
    """Return the configuration with as many runs as there are starts, or at most so many."""
    if start is None or start.rows is None:
        return config
    if "runs" not in config.ensemble.model_fields_set:
        ensemble = config.ensemble.model_copy(update={"runs": start.rows})
        return config.model_copy(update={"ensemble": ensemble})
    if config.ensemble.runs > start.rows:
        problems.at("ensemble", "runs").add(
            f"expected at most {start.rows}, the number of rows of {', '.join(start.files)}, "
            f"got {config.ensemble.runs}"
        )
    return config


def draws_nothing(experiment: Experiment) -> bool:
    """Whether all runs of a law are one and the same."""
    vehicle, seed = experiment.loop.vehicle, experiment.config.ensemble.seed
    if experiment.config.ensemble.runs == 1 or vehicle.varies or vehicle.measures:
        return False
    one, two = (experiment.start.numbers(experiment.group, seed, run) for run in (0, 1))
    return all(map(np.array_equal, one, two))


def starts_on_reference(experiment: Experiment) -> bool:
    """Whether run 0 starts on its reference."""
    G, start = experiment.group, experiment.start
    numbers, velocity = start.numbers(G, experiment.config.ensemble.seed, 0)
    return bool(not velocity.any() and (start.poses.place(G, numbers[None]) == G.identity).all())


def check_starts(experiment: Experiment, problems: Problems) -> None:
    """Note an experiment that repeats one run which starts on its reference."""
    if draws_nothing(experiment) and starts_on_reference(experiment):
        G = experiment.group
        turns = all(part.turns for part in G.parts) and G.dimension == 3
        pose = "haar" if turns else "{ kind: exp_normal, std: 0.5 }"
        problems.at("initial").add(
            f"all {experiment.config.ensemble.runs} runs start on the reference, and nothing is "
            "drawn, so they are one run; "
            f"add `initial: {{ pose: {pose}, velocity: {{ kind: normal, std: 1 }} }}`, or set "
            "ensemble.runs to 1"
        )


def designed_laws(experiment: Experiment, problems: Problems) -> Experiment:
    """Return the experiment with the gains of the laws that are designed for their loops."""
    loops, horizon = dict(experiment.loops), float(experiment.times[-1])
    for index, (label, loop) in enumerate(experiment.loops.items()):
        if not isinstance(law := loop.controller, Designed):
            continue
        with problems.catching("controllers", index):
            times = np.linspace(0.0, horizon, law.pieces + 1)
            if (control := loop.vehicle.control) is not None:
                last = max(1, math.ceil(horizon / control.period - 1e-9)) - 1
                step = max(1, round(horizon / law.pieces / control.period))
                middles = control.period * (0.5 + np.unique([*range(0, last, step), last]))
                times = np.minimum(middles, horizon)
            times = np.array([0.0, *times, horizon])
            shown = experiment.reference_over_horizon(times)
            if shown.spent or not shown.finite.all():
                return experiment  # the checks of the reference say so
            where = np.searchsorted(shown.times, times)
            loops[label] = designed(loop, times, shown.pose[where], shown.velocity[where])
    return replace(experiment, loops=loops)


def _metrics_of(
    config: Config, plugins: Mapping[str, str], loops: Collection[ClosedLoop], problems: Problems
) -> list[Metric]:
    """Return the metrics that are listed, or those of the plugins whose signals a loop has."""
    if config.metrics is None:
        names = metrics.defined_by(plugins.values())
        code = (law for loop in loops if isinstance(law := loop.controller, RunsCode))
        names += dict.fromkeys(name for law in code for name in law.metrics)
        listed = [Kind(metrics).read(name, problems.at("metrics")) for name in names]
        return [metric for metric in listed if metric and not metric.unknown(loops)]
    valid = list(filter(None, config.metrics))
    names = [metric.name for metric in valid]
    for name in dict.fromkeys(name for name in names if names.count(name) > 1):
        problems.at("metrics").add(f"{name} is listed twice; a result has one number of a name")
    return valid
