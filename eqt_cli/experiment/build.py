"""From configuration data to an experiment that can run, with everything wrong reported at once.

Every section is built even where another is broken; what depends on a broken section is skipped.
"""

from __future__ import annotations

import json
from copy import deepcopy
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.controllers import Controller, controllers
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import ComponentError
from eqt_cli.core.numbers import Real
from eqt_cli.core.registry import Registry, load_plugin
from eqt_cli.engines import Engine
from eqt_cli.ensemble.poses import PoseDistribution, pose_distributions
from eqt_cli.ensemble.velocities import VelocityDistribution, velocity_distributions
from eqt_cli.experiment import tensors
from eqt_cli.experiment.components import component, resolved
from eqt_cli.experiment.pose import pose_from
from eqt_cli.experiment.problems import Path as KeyPath
from eqt_cli.experiment.problems import Problems
from eqt_cli.experiment.schema import Config, GainsSection
from eqt_cli.experiment.solver import Solver, solver_from
from eqt_cli.experiment.source import ConfigSource
from eqt_cli.experiment.translate import UNKNOWN_KEY, problems_of
from eqt_cli.groups import MatrixLieGroup, groups
from eqt_cli.mechanics.tracking import Gains, Inertia
from eqt_cli.references import Reference, references


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
    """
    problems = Problems(source.place)
    plugins = _load_plugins(source, trust_plugins, problems)
    problems.raise_if_any()  # without its plugins a configuration cannot be judged
    sections = _sections(source.data, problems)
    group = _group(sections["group"], problems)
    inertia = _inertia(group, sections["inertia"], problems)
    gains = _gains(group, sections["gains"], problems)
    reference, Qd, Vd = _reference(group, sections["reference"], problems)
    laws = _controllers(sections["controllers"] or [], problems)
    initial = sections["initial"]
    poses = initial and _distribution(
        pose_distributions, initial.pose, group, ("initial", "pose"), problems
    )
    velocities = initial and _distribution(
        velocity_distributions, initial.velocity, group, ("initial", "velocity"), problems
    )
    solver = None if sections["solver"] is None else solver_from(sections["solver"], problems)
    problems.raise_if_any()
    assert group and inertia and gains and reference and poses and velocities and solver
    assert Qd is not None and Vd is not None
    config = Config.model_validate(source.data)
    complete = config.model_dump(exclude_none=True) | {
        "reference": {**_reference_section(source.data["reference"]), **resolved(reference)},
        "controllers": [resolved(law) | {"label": label} for label, law in laws.items()],
        "initial": {"pose": resolved(poses), "velocity": resolved(velocities)},
        "solver": solver.resolved,
    }
    loops = {
        label: ClosedLoop(group, inertia, gains, reference, law) for label, law in laws.items()
    }
    return Experiment(config, complete, group, loops, Qd, Vd, poses, velocities, solver, plugins)


def _load_plugins(source: ConfigSource, trusted: bool, problems: Problems) -> dict[str, str]:
    """Load every plugin; returns their sources by path."""
    paths = source.data.get("plugins", [])
    if not isinstance(paths, list) or not all(isinstance(path, str) for path in paths):
        problems.add(("plugins",), "expected a list of paths to Python files")
        return {}
    sources: dict[str, str] = {}
    for index, path in enumerate(paths):
        try:
            if source.stored_plugins is None:
                file = source.folder / path
                load_plugin(file)
                sources[path] = file.read_text(encoding="utf-8")
            elif trusted:
                sources[path] = source.stored_plugins[path]
                load_plugin(Path(path), sources[path])
            else:
                problems.add(
                    ("plugins", index),
                    f"the result holds the source of {path}, which is executed only on request; "
                    "read it with `eqt show --plugins`, then add --trust-plugins",
                )
        except ComponentError as error:
            problems.add(("plugins", index), str(error))
    return sources


def _sections(data: dict[str, Any], problems: Problems) -> dict[str, Any]:
    """The validated sections by name; None for those that are missing or broken."""
    broken = set()
    try:
        Config.model_validate(data)
    except ValidationError as error:
        data = deepcopy(data)
        for path, message in problems_of(error, data, _known_keys):
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
            sections[name] = field.get_default(call_default_factory=True, validated_data={})
    return sections


def _remove(data: Any, path: KeyPath) -> None:
    for step in path[:-1]:
        data = data[step]
    del data[path[-1]]


def _known_keys(path: KeyPath) -> list[str]:
    """The keys of the section at a path."""
    model: Any = Config
    for step in path:
        model = model.model_fields[step].annotation
    return list(model.model_fields)


def _group(name: str | None, problems: Problems) -> MatrixLieGroup | None:
    if name is None:
        return None
    try:
        return groups.get(name)()
    except ComponentError as error:
        problems.add(("group",), str(error))
        return None


def _inertia(G: MatrixLieGroup | None, value: Any, problems: Problems) -> Inertia | None:
    if G is None or value is None:
        return None
    matrix = tensors.square(value, G.dimension, G)
    if isinstance(matrix, str):
        problems.add(("inertia",), matrix)
        return None
    wrong = tensors.asymmetry(matrix) or tensors.indefiniteness(matrix)
    if wrong:
        problems.add(("inertia",), wrong)
        return None
    return Inertia(matrix, np.linalg.inv(matrix))


def _gains(
    G: MatrixLieGroup | None, section: GainsSection | None, problems: Problems
) -> Gains | None:
    if G is None or section is None:
        return None
    K = tensors.square(section.kp, G.size, G)
    wrong = K if isinstance(K, str) else tensors.asymmetry(K) or tensors.degenerate_minimum(K, G)
    if wrong:
        problems.add(("gains", "kp"), wrong)
    K_d = tensors.square(section.kd, G.dimension, G)
    wrong = K_d if isinstance(K_d, str) else tensors.indefiniteness(K_d)
    if wrong:
        problems.add(("gains", "kd"), wrong)
    return None if isinstance(K, str) or isinstance(K_d, str) else Gains(K, K_d)


def _reference_section(section: dict[str, Any]) -> dict[str, Any]:
    """The keys that every reference takes, with their defaults."""
    return {"pose": section.get("pose", "identity"), "velocity": section.get("velocity", 0.0)}


def _reference(
    G: MatrixLieGroup | None, section: dict[str, Any] | None, problems: Problems
) -> tuple[Reference | None, Array | None, Array | None]:
    """The reference, Q_d(0) and V_d(0)."""
    if section is None:
        return None, None, None
    options = {key: value for key, value in section.items() if key not in ("pose", "velocity")}
    reference = component(references, {"kind": "torque"} | options, ("reference",), problems)
    if G is None:
        return reference, None, None
    for option, message in reference.problems(G) if reference else ():
        problems.add(_option_path(("reference",), option), message)
    common = _reference_section(section)
    Qd = pose_from(common["pose"], G, ("reference", "pose"), problems)
    Vd = _velocity(common["velocity"], G, problems)
    return reference, Qd, Vd


def _velocity(value: Any, G: MatrixLieGroup, problems: Problems) -> Array | None:
    path: KeyPath = ("reference", "velocity")
    try:
        numbers = TypeAdapter(Real | list[Real]).validate_python(value)
    except ValidationError as error:
        for place, message in problems_of(error, value, lambda _: ()):
            problems.add((*path, *place), message)
        return None
    velocity = tensors.vector(numbers, G.dimension, G)
    if isinstance(velocity, str):
        problems.add(path, velocity)
        return None
    return velocity


def _controllers(entries: list[Any], problems: Problems) -> dict[str, Controller]:
    """The control laws by label."""
    laws: dict[str, Controller] = {}
    for index, entry in enumerate(entries):
        path: KeyPath = ("controllers", index)
        label = None
        if isinstance(entry, dict):
            entry = dict(entry)
            label = entry.pop("label", None)
        law = component(controllers, entry, path, problems)
        if law is None:
            continue
        label = law.name if label is None else label
        if not isinstance(label, str) or not label:
            problems.add((*path, "label"), f"expected text, got {label!r}")
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
        problems.add(_option_path(path, option), message)
    return distribution


def _option_path(path: KeyPath, option: str) -> KeyPath:
    """The path of an option such as ``position.std`` or ``torque[1]`` below `path`."""
    name, _, rest = option.partition("[")
    steps: list[str | int] = list(name.split("."))
    if rest:
        steps.append(int(rest.removesuffix("]")))
    return (*path, *steps)
