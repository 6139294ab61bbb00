"""From configuration data to an experiment that can run, with everything wrong reported at once.

Every section is built even where another is broken; what depends on a broken section is skipped.
"""

from __future__ import annotations

import json
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass
from hashlib import sha256
from typing import Any, get_args

import numpy as np
from pydantic import TypeAdapter, ValidationError

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.config.components import component, option_path, resolved
from eqt_cli.config.plugins import load_plugins
from eqt_cli.config.problems import Path as KeyPath
from eqt_cli.config.problems import Problems
from eqt_cli.config.schema import Config, GainsSection, Section
from eqt_cli.config.source import ConfigSource
from eqt_cli.config.translate import UNKNOWN_KEY, problems_of, shown
from eqt_cli.controllers import Controller, controllers
from eqt_cli.core.arrays import Array
from eqt_cli.core.blame import blamed
from eqt_cli.core.errors import ComponentError
from eqt_cli.core.registry import Registry
from eqt_cli.engines import Engine
from eqt_cli.ensemble.factor_poses import FactorPoses
from eqt_cli.ensemble.poses import PoseDistribution, pose_distributions
from eqt_cli.ensemble.velocities import VelocityDistribution, velocity_distributions
from eqt_cli.experiment.gains import gains_from
from eqt_cli.experiment.inertia import inertia_from
from eqt_cli.experiment.motion import motion_from
from eqt_cli.experiment.probe import probe
from eqt_cli.experiment.solver import Solver, solver_from
from eqt_cli.groups import MatrixLieGroup, group_named
from eqt_cli.groups.product import ProductGroup


@dataclass(frozen=True)
class Experiment:
    """Everything that a run needs, checked.

    Attributes
    ----------
    config
        The validated sections.
    resolved
        The configuration with every default written out; running it gives equal numbers.
    loops
        One closed loop per controller label.
    initial_pose, initial_velocity
        Q_d(0) and V_d(0).
    plugins
        Source text of each plugin, by its path as written in the configuration.
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
    plugins: dict[str, str]

    @property
    def name(self) -> str:
        """Name of the experiment."""
        return str(self.config.name)

    @property
    def engine(self) -> Engine:
        """The engine that integrates the runs."""
        return self.solver.engine

    @property
    def times(self) -> Array:
        """The sample times, s."""
        return np.linspace(0.0, self.config.time.duration, self.config.time.samples)

    @property
    def numeric_config(self) -> dict[str, Any]:
        """What of the resolved configuration affects the numbers, plugins by their source."""
        kept = {key: value for key, value in self.resolved.items() if key != "name"}
        digests = [sha256(text.encode()).hexdigest() for text in self.plugins.values()]
        return kept | {"plugins": digests}

    @property
    def digest(self) -> str:
        """Hash of everything that affects the numbers; equal digests, equal experiments."""
        text = json.dumps(self.numeric_config, sort_keys=True)
        return sha256(text.encode()).hexdigest()


@blamed()
def build(source: ConfigSource, *, trust_plugins: bool = False) -> Experiment:
    """Check a configuration and make an experiment of it.

    Parameters
    ----------
    trust_plugins
        Execute plugin sources that are stored in a result file.

    Raises
    ------
    ConfigError
        With every problem, each at its place in the file.
    ComponentError
        If a component of the user's own fails while it is made.
    """
    problems = Problems(source.place)
    plugins = load_plugins(source, trust_plugins, problems)
    problems.raise_if_any()  # without its plugins a configuration cannot be judged
    sections = _sections(source.data, problems)
    group = _group(sections["group"], problems)
    motion = None
    if sections["reference"] is not None or source.data.get("reference") is None:
        motion = motion_from(
            sections["task"], sections["reference"], sections["target"], group, problems
        )
    laws = _controllers(sections["controllers"] or [], sections["task"], problems)
    solver = None if sections["solver"] is None else solver_from(sections["solver"], problems)
    inertia = gains = poses = velocities = None
    if group and sections["inertia"] is not None:
        horizon = sections["time"].duration if sections["time"] else 0.0
        inertia = inertia_from(sections["inertia"], group, horizon, problems)
    if group:
        gains = gains_from(_good_keys(GainsSection, source.data.get("gains")), group, problems)
    if sections["initial"]:
        poses = _pose_distribution(sections["initial"].pose, group, problems)
        velocities = _distribution(
            velocity_distributions,
            sections["initial"].velocity,
            group,
            ("initial", "velocity"),
            problems,
        )
    problems.raise_if_any()
    assert group and motion and inertia and gains and poses and velocities and solver
    config = Config.model_validate(source.data)
    complete = config.model_dump(exclude_none=True, warnings="none") | {
        **motion.resolved,
        "controllers": [resolved(law) | {"label": label} for label, law in laws.items()],
        "initial": {"pose": _resolved_poses(poses), "velocity": resolved(velocities)},
        "solver": solver.resolved,
    }
    loops = {
        label: ClosedLoop(group, inertia, gains, motion.reference, law)
        for label, law in laws.items()
    }
    seed = config.ensemble.seed
    probe(loops, poses, velocities, motion.pose, motion.velocity, seed, problems)
    problems.raise_if_any()
    return Experiment(
        config,
        complete,
        group,
        loops,
        motion.pose,
        motion.velocity,
        poses,
        velocities,
        solver,
        plugins,
    )


def _sections(data: dict[str, Any], problems: Problems) -> dict[str, Any]:
    """The validated sections by name; None for those that are missing or broken."""
    broken = set()
    try:
        config = Config.model_validate(data)
        return {name: getattr(config, name) for name in Config.model_fields}
    except ValidationError as error:
        data = deepcopy(data)
        for path, message in problems_of(error, data, _known_keys, _elsewhere):
            problems.add(path, message)
            if message.startswith(UNKNOWN_KEY):
                _remove(data, path)  # the rest of its section can still be judged
            else:
                broken.add(path[0])
    sections: dict[str, Any] = dict.fromkeys(Config.model_fields)
    for name, field in Config.model_fields.items():
        if name in broken:
            continue
        if name in data:
            sections[name] = TypeAdapter(field.rebuild_annotation()).validate_python(data[name])
        else:
            sections[name] = field.get_default(call_default_factory=True)
    return sections


def _good_keys(model: type[Section], data: Any) -> dict[str, Any]:
    """The validated keys of a section in which others may be broken; `_sections` notes those."""
    found = {}
    for name, field in model.model_fields.items():
        if isinstance(data, dict) and name in data:
            with suppress(ValidationError):
                adapter = TypeAdapter(field.rebuild_annotation())
                found[name] = adapter.validate_python(data[name])
    return found


def _remove(data: Any, path: KeyPath) -> None:
    for step in path[:-1]:
        data = data[step]
    del data[path[-1]]


def _known_keys(path: KeyPath) -> dict[str, str]:
    """The keys of the section at a path, with their meanings."""
    models: list[type[Section]] = [Config]
    for step in path:
        annotations = [model.model_fields[str(step)].rebuild_annotation() for model in models]
        models = [model for annotation in annotations for model in _sections_in(annotation)]
    return {
        name: " ".join((field.description or "").split()).removesuffix(".")
        + "".join(f", as {name}: {example}" for example in field.examples or ())
        for model in models
        for name, field in model.model_fields.items()
    }


def _elsewhere(path: KeyPath) -> str | None:
    """The section's key that is written without its section: ``gains.kp`` for ``kp``."""
    if len(path) != 1:
        return None
    found = (name for name in Config.model_fields if path[0] in _known_keys((name,)))
    return next((f"{name}.{path[0]}" for name in found), None)


def _sections_in(annotation: Any) -> list[type[Section]]:
    """The sections that a value of this type may be."""
    if isinstance(annotation, type) and issubclass(annotation, Section):
        return [annotation]
    return [model for part in get_args(annotation) for model in _sections_in(part)]


def _group(name: str | None, problems: Problems) -> MatrixLieGroup | None:
    if name is None:
        return None
    try:
        return group_named(name)
    except ComponentError as error:
        problems.add(("group",), str(error))
        return None


def _controllers(entries: list[Any], task: str | None, problems: Problems) -> dict[str, Controller]:
    """The control laws by label."""
    laws: dict[str, Controller] = {}
    for index, entry in enumerate(entries):
        path: KeyPath = ("controllers", index)
        label = None
        if isinstance(entry, dict):
            entry = dict(entry)
            label = entry.pop("label", None)
        law = component(controllers, entry, path, problems, ("label",))
        if law is None:
            continue
        if task is not None and task not in law.tasks:
            problems.add(path, _wrong_task(law, task))
            continue
        label = law.name if label is None else label
        if not isinstance(label, str) or not label.strip() or not label.isprintable():
            problems.add((*path, "label"), f"expected text on one line, got {shown(label)}")
        elif label in laws:
            message = f"label '{label}' is taken by an earlier controller; give this one a `label`"
            problems.add(path, message)
        else:
            laws[label] = law
    return laws


def _distribution(
    registry: Registry[Any],
    value: Any,
    G: MatrixLieGroup | None,
    path: KeyPath,
    problems: Problems,
) -> Any:
    distribution = component(registry, value, path, problems)
    if distribution is None or G is None:
        return None
    for option, message in distribution.problems(G):
        problems.add(option_path(path, option), message)
    return distribution


def _wrong_task(law: Controller, task: str) -> str:
    fitting = ", ".join(kind.name for kind in controllers.all() if task in kind.tasks)
    return f"{law.name} is for task: {' or '.join(law.tasks)}; task: {task} takes {fitting}"


def _pose_distribution(
    value: Any, G: MatrixLieGroup | None, problems: Problems
) -> PoseDistribution | None:
    """One distribution, or one per factor of a product."""
    path: KeyPath = ("initial", "pose")
    if not isinstance(value, list):
        return _distribution(pose_distributions, value, G, path, problems)
    factors = G.factors if isinstance(G, ProductGroup) else ()
    if len(value) != len(factors):
        if G is not None:
            expected = f"one entry per factor of {G.name}" if factors else "one distribution"
            problems.add(path, f"expected {expected}, got a list of {len(value)}")
        return None
    found = [
        _distribution(pose_distributions, entry, factor, (*path, index), problems)
        for index, (entry, factor) in enumerate(zip(value, factors, strict=True))
    ]
    return None if None in found else FactorPoses(tuple(found))


def _resolved_poses(poses: PoseDistribution) -> Any:
    if isinstance(poses, FactorPoses):
        return [resolved(factor) for factor in poses.factors]
    return resolved(poses)
