"""What a run needs, checked: the laws in their loops, the initial states, and the solver."""

import json
import re
from dataclasses import dataclass
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
from eqt_cli.mechanics.rigid_body import not_rigid

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
