"""From configuration data to an experiment that can run, with everything wrong reported at once.

Every section is built even where another is broken; what depends on a broken section is skipped.
"""

import json
import re
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import sha256
from typing import Any

import numpy as np

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.config.data_files import with_data
from eqt_cli.config.plugins import load_plugins
from eqt_cli.config.schema import (
    SEARCHES,
    Config,
    GainsSection,
    InitialSection,
    OwnGainsSection,
)
from eqt_cli.config.source import ConfigSource
from eqt_cli.controllers import Controller, controllers
from eqt_cli.core.arrays import Array
from eqt_cli.core.error_origin import blamed
from eqt_cli.core.errors import EqtWarning
from eqt_cli.core.problems import Problems
from eqt_cli.core.validation import (
    as_section,
    component,
    fields_of,
    known_keys,
    shown,
    unknown_key,
    validated,
)
from eqt_cli.engines import Engine
from eqt_cli.ensemble.factor_poses import FactorPoses
from eqt_cli.ensemble.poses import PoseDistribution, pose_distributions
from eqt_cli.ensemble.velocities import VelocityDistribution, velocity_distributions
from eqt_cli.experiment.desired_trajectory import DesiredTrajectory, check_horizon, desired_from
from eqt_cli.experiment.gains import gains_from
from eqt_cli.experiment.inertia import inertia_from
from eqt_cli.experiment.laws_in_code import LawsInCode, check_calls
from eqt_cli.experiment.settling import check_thresholds
from eqt_cli.experiment.solver import Solver, solver_from
from eqt_cli.experiment.start import Start, start_from_file
from eqt_cli.experiment.trial_evaluation import probe
from eqt_cli.experiment.trial_of_parts import probe_parts
from eqt_cli.experiment.vehicle import resolved as resolved_vehicle
from eqt_cli.experiment.vehicle import vehicle_from
from eqt_cli.groups import MatrixLieGroup, group_named
from eqt_cli.groups.product import ProductGroup
from eqt_cli.logs.mapping import MAPPING
from eqt_cli.mechanics.rigid_body import not_rigid
from eqt_cli.mechanics.tracking import Gains

OF_EVERY_LAW = ("label", "gains")
"""The keys of an entry of `controllers` that no law has for itself."""

WORDS = ("name", "rigid")
"""Keys that change what is said of an experiment, and none of its numbers."""


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
    source
        What it was built from, with the text of each plugin: it can be built again anywhere.
    files
        Contents of files with data, by their names in the configuration.
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

    @property
    def engine(self) -> Engine:
        """The engine that integrates the runs."""
        return self.solver.engine

    @property
    def titles(self) -> dict[str, str]:
        """How tables and figures write the controllers, by label: EqT for ``eqt``.

        A label that begins with the name of its law, as "eqt, start", is written "EqT, start"; any
        other as it is.
        """
        laws = {label: loop.controller for label, loop in self.loops.items()}
        return {
            label: law.title + label.removeprefix(law.name)
            if re.match(rf"{re.escape(law.name)}\b", label)
            else label
            for label, law in laws.items()
        }

    @property
    def times(self) -> Array:
        """The sample times, s."""
        return np.linspace(0.0, self.config.time.duration, self.config.time.samples)

    @cached_property
    def remarks(self) -> list[EqtWarning]:
        """What a user should know of it, and no error is."""
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
        """What of the resolved configuration affects the numbers, plugins by their source."""
        kept = {key: value for key, value in self.resolved.items() if key not in WORDS}
        sources = {path: sha256(text.encode()).hexdigest() for path, text in self.plugins.items()}
        laws = [
            {
                key: sources.get(value, value) if key == "file" else value
                for key, value in law.items()
            }
            for law in kept["controllers"]
        ]
        named = {"controllers": laws, "plugins": list(sources.values())}
        return kept | named | digests(self.files)

    @cached_property
    def digest(self) -> str:
        """Hash of everything that affects the numbers; equal digests, equal experiments."""
        text = json.dumps(self.numeric_config, sort_keys=True)
        return sha256(text.encode()).hexdigest()


def digests(files: dict[str, str]) -> dict[str, Any]:
    """The contents of files with data as they stand in the identity of an experiment."""
    found = {name: sha256(text.encode()).hexdigest() for name, text in sorted(files.items())}
    return {"files": found} if found else {}


@blamed()
@np.errstate(all="ignore")  # what overflows is found by the checks, and said by them alone
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
    task, initial = sections["task"], sections["initial"]
    group = _group(sections["group"], problems.at("group"))
    code = LawsInCode(source, trust_plugins)
    laws, files = _controllers(
        sections["controllers"] or [], task, group, code, problems.at("controllers")
    )
    desired = inertia = start = solver = None
    gains: dict[str, Gains | None] = {}
    if sections["reference"] is not None or source.data.get("reference") is None:
        desired = desired_from(
            task, sections["reference"], sections["target"], group, source, problems
        )
    if sections["solver"] is not None:
        solver = solver_from(sections["solver"], problems.at("solver"))
    horizon = sections["time"].duration if sections["time"] else 0.0
    vehicle = vehicle_from(sections, group, horizon, problems) if group else None
    if group and solver and vehicle:
        for law in laws.values():
            check_calls(law.law, vehicle, solver.engine, problems.at("controllers", law.index))
    if group and sections["inertia"] is not None:
        inertia = inertia_from(sections["inertia"], group, horizon, problems.at("inertia"))
    if group:
        section, at_gains = source.data.get("gains"), problems.at("gains")
        known = fields_of(GainsSection, section, at_gains) if isinstance(section, dict) else {}
        shared = gains_from(known, group, at_gains)
        for label, law in laws.items():
            at_law = problems.at("controllers", law.index, "gains")
            gains[label] = gains_from(known | law.gains, group, at_law) if law.gains else shared
        if isinstance(thresholds := sections["settling_threshold"], dict):
            written = source.data["settling_threshold"]
            check_thresholds(thresholds, written, group, problems.at("settling_threshold"))
    if initial:
        start = _start(initial, group, desired, source, problems.at("initial"))
    config = _agreeing(
        source,
        {name: sections[name] for name in (*SEARCHES, "initial")},
        group,
        desired,
        {entry.index: entry.law for entry in laws.values()},
        start,
        problems,
    )
    problems.raise_if_any()
    assert config and group and desired and inertia and vehicle and start and solver
    complete = config.model_dump(exclude=set(SEARCHES), exclude_none=True, warnings="none") | {
        **desired.resolved,
        "controllers": [law.resolved | {"label": label} for label, law in laws.items()],
        "initial": start.resolved,
        "solver": solver.resolved,
        **resolved_vehicle(vehicle, config),
    }
    loops = {
        label: ClosedLoop(group, inertia, own, desired.reference, laws[label].law, vehicle)
        for label, own in gains.items()
        if own is not None
    }
    experiment = Experiment(
        config,
        complete,
        group,
        loops,
        desired.pose,
        desired.velocity,
        start.poses,
        start.velocities,
        solver,
        replace(source, stored_plugins=plugins | code.texts),
        desired.files | start.files | files,
    )
    probe_parts(experiment, problems)
    problems.raise_if_any()
    probe(experiment, problems)
    problems.raise_if_any()
    return experiment


def _start(
    section: InitialSection,
    G: MatrixLieGroup | None,
    desired: DesiredTrajectory | None,
    source: ConfigSource,
    problems: Problems,
) -> Start | None:
    """Where the runs start, by distributions or by the rows of a file."""
    if section.file is not None:
        return start_from_file(section, G, desired, source, problems)
    for key in section.model_fields_set & {"relative", MAPPING}:
        problems.at(key).add(
            "applies only to poses from a `file`; give `file` too, or remove this key"
        )
    poses = _poses(section.pose, G, problems.at("pose"))
    at_velocity = problems.at("velocity")
    velocities = component(velocity_distributions, section.velocity, at_velocity, group=G)
    if poses is None or velocities is None:
        return None
    resolved = {"pose": _poses_section(poses), "velocity": as_section(velocities)}
    return Start(poses, velocities, resolved)


def _agreeing(
    source: ConfigSource,
    read: dict[str, Any],
    G: MatrixLieGroup | None,
    desired: DesiredTrajectory | None,
    laws: dict[int, Controller],
    start: Start | None,
    problems: Problems,
) -> Config | None:
    """The configuration, where its sections agree on how many runs there are, and how long."""
    if problems or not (G and desired and start):
        return None
    # Dataclasses, as ranges are, pass strict validation as such, and not as mappings.
    config = Config.model_validate(
        source.data | {name: section for name, section in read.items() if section}
    )
    check_horizon(desired.reference, "reference", G, config.time.duration, problems)
    for index, law in laws.items():
        check_horizon(law, f"controllers[{index}]", G, config.time.duration, problems)
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


def _sections(data: dict[str, Any], problems: Problems) -> dict[str, Any]:
    """The validated sections by name; None for those that are missing or broken."""
    known = known_keys(Config, ())
    for key in data:
        if key not in known:
            problems.at(key).add(unknown_key(key, known, _elsewhere(key)))
    return dict.fromkeys(known) | fields_of(Config, data, problems)


def _elsewhere(key: str) -> str | None:
    """The section's key that is written without its section: ``gains.kp`` for ``kp``."""
    found = (name for name in Config.model_fields if key in known_keys(Config, (name,)))
    return next((f"{name}.{key}" for name in found), None)


def _group(name: str | None, problems: Problems) -> MatrixLieGroup | None:
    if name is not None:
        with problems.catching():
            return group_named(name)
    return None


@dataclass(frozen=True)
class _Entry:
    """An entry of `controllers`: the law, where it stands, and gains that are its own."""

    law: Controller
    index: int
    gains: dict[str, Any]

    @property
    def resolved(self) -> dict[str, Any]:
        return as_section(self.law) | ({"gains": self.gains} if self.gains else {})


def _controllers(
    entries: list[Any],
    task: str | None,
    G: MatrixLieGroup | None,
    code: LawsInCode,
    problems: Problems,
) -> tuple[dict[str, _Entry], dict[str, str]]:
    """The control laws by label, and the contents of the files that they are given in."""
    laws: dict[str, _Entry] = {}
    files: dict[str, str] = {}
    for index, entry in enumerate(entries):
        here = problems.at(index)
        entry = dict(entry) if isinstance(entry, dict) else entry
        label = entry.pop("label", None) if isinstance(entry, dict) else None
        own = entry.pop("gains", None) if isinstance(entry, dict) else None
        gains = validated(OwnGainsSection, own, here.at("gains")) if own is not None else None
        law = component(controllers, entry, here, OF_EVERY_LAW)
        if law is not None and G is not None:
            law, texts = with_data(law, code.source, here)
            files |= texts
            law.check(G, here)
            law = code.running(law, G, here)
        if law is None:
            continue
        if task is not None and law.tasks and task not in law.tasks:
            here.add(_wrong_task(law, task))
            continue
        label = law.name if label is None else label
        if not isinstance(label, str) or not label.strip() or not label.isprintable():
            here.at("label").add(f"expected text on one line, got {shown(label)}")
        elif label in laws:
            here.add(
                f"an earlier controller has the label '{label}'; give this one another `label`"
            )
        else:
            laws[label] = _Entry(law, index, gains.model_dump(exclude_none=True) if gains else {})
    return laws, files


def _wrong_task(law: Controller, task: str) -> str:
    fitting = ", ".join(kind.name for kind in controllers.all() if task in kind.tasks)
    return f"{law.name} is a law for task: {' or '.join(law.tasks)}; for task: {task} use {fitting}"


def _poses(value: Any, G: MatrixLieGroup | None, problems: Problems) -> PoseDistribution | None:
    """One distribution, or one per factor of a product."""
    if not isinstance(value, list):
        return component(pose_distributions, value, problems, group=G)
    factors = G.factors if isinstance(G, ProductGroup) else ()
    if len(value) != len(factors):
        if G is not None:
            each = f"{len(factors)} entries, one per factor of {G.name}"
            expected = each if factors else "one distribution"
            problems.add(f"expected {expected}, got a list of {len(value)}")
        return None
    entries = [
        component(pose_distributions, entry, problems.at(index), group=factor)
        for index, (entry, factor) in enumerate(zip(value, factors, strict=True))
    ]
    known = tuple(entry for entry in entries if entry is not None)
    return FactorPoses(known) if len(known) == len(entries) else None


def _poses_section(poses: PoseDistribution) -> Any:
    if isinstance(poses, FactorPoses):
        return [as_section(factor) for factor in poses.factors]
    return as_section(poses)
