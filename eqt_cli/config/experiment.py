"""An experiment: what the sections of a configuration describe, and how it is solved."""

import json
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from hashlib import sha256
from itertools import repeat
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtWarning, InputError, Problems
from eqt_cli.base.option_types import option_names, shown, unknown_key, validated
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.inertia import not_rigid
from eqt_cli.components.initial_states import PoseDistribution, VelocityDistribution
from eqt_cli.components.laws import distinct_titles
from eqt_cli.config.schema import DEFAULT_ENGINE, WORDS, Config, marks_of
from eqt_cli.config.source import ConfigSource
from eqt_cli.engines.engine import Engine, SolverChecks, engines
from eqt_cli.loop.closed_loop import ClosedLoop

# The sections `solver` and `settling`: the engine of the runs, and when a run has settled ---------


def check_thresholds(
    thresholds: Mapping[str, float], G: MatrixLieGroup, problems: Problems
) -> None:
    """Note unknown parts, and angles beyond a half-turn, among thresholds by part."""
    parts = {part.name: part for part in G.parts}
    for name, threshold in thresholds.items():
        here = problems.at(name)
        if name not in parts:
            here.add(unknown_key(name, parts))
        elif parts[name].turns and threshold > math.pi:
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


def solver_from(section: dict[str, Any], problems: Problems) -> Solver | None:
    """Return the solver of a section, or None after noting its problems."""
    name = section.get("engine", DEFAULT_ENGINE)
    with problems.catching("engine"):
        _require_available(name)
    kinds = engines.core()
    if all(kind.name != name for kind in kinds) or set(section) - set(_keys(kinds)):
        kinds = engines.all()
    owners: list[type[Any]] = [SolverChecks, *kinds]
    known = _keys(kinds)
    for key in section:
        if key not in known:
            problems.at(key).add(unknown_key(key, known))
    data = ({key: section[key] for key in option_names(kind) if key in section} for kind in owners)
    judgement, *built = map(validated, owners, data, repeat(problems))
    engine = next((entry for entry in built if entry and entry.name == name), None)
    if engine is not None:
        engine.check(problems)
        if "device" in section and "device" not in option_names(type(engine)):
            able = [each.name for each in engines.all() if "device" in option_names(each)]
            problems.at("device").add(f"engine {name} has none; use engine {' or '.join(able)}")
    if engine is None or problems:
        return None
    keys = {**section, **asdict(engine), **asdict(judgement), "engine": name}
    values = {key: value for key, value in keys.items() if value is not None}
    return Solver(engine, judgement, {"engine": name} | values)


def _keys(kinds: Iterable[type[Engine]]) -> list[str]:
    """Return the keys of the section, where these are the engines."""
    owners: list[type[Any]] = [SolverChecks, *kinds]
    return ["engine", *dict.fromkeys(key for owner in owners for key in option_names(owner))]


def _require_available(name: Any) -> None:
    """Raise an `InputError` if there is no engine of this name, or it is not available."""
    if not isinstance(name, str):
        raise InputError(f"expected the name of an engine, got {shown(name)}")
    unavailable = engines.get(name).unavailable()
    if unavailable:
        raise InputError(unavailable)


# A checked experiment: the loops of its laws, the initial states, and the solver ------------------


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

    @cached_property
    def remarks(self) -> list[EqtWarning]:
        """Remarks for the user that are not errors."""
        inertia = next(iter(self.loops.values())).inertia
        broken = not_rigid(self.group, inertia, self.config.time.duration)
        if not broken or self.config.rigid is False:
            return []
        return [
            EqtWarning(
                f"{self.source.place(('inertia',))}: inertia: not the inertia of a rigid body: its "
                f"{broken}; correct it, or add `rigid: false` if the system is not one rigid body"
            )
        ]

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
