"""A checked experiment: the loops of its laws, the initial states, and the solver."""

import json
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import sha256
from typing import Any

import numpy as np

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.config.schema import Config
from eqt_cli.config.source import ConfigSource
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import EqtWarning
from eqt_cli.engines import Engine
from eqt_cli.ensemble.poses import PoseDistribution
from eqt_cli.ensemble.velocities import VelocityDistribution
from eqt_cli.experiment.solver import Solver
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.inertia import not_rigid

WORDS = ("name", "rigid")
"""Keys that affect texts about an experiment, but not its numbers."""


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
        return told_apart(titles)

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
        kept = {key: value for key, value in self.resolved.items() if key not in WORDS}
        return renamed(kept, hashes(self.files | self.plugins))

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


def told_apart(titles: Mapping[str, str]) -> dict[str, str]:
    """Titles by label; the labels in place of titles that several have."""
    shared = [title for title, count in Counter(titles.values()).items() if count > 1]
    return {label: label if title in shared else title for label, title in titles.items()}
