"""One experiment, or a sweep of them: the points, each an `Experiment`, and how they are stored."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from functools import cached_property, lru_cache
from hashlib import sha256
from pathlib import Path
from typing import Any

from eqt_cli.core.registry import load_plugin
from eqt_cli.ensemble.parts import MANY_PARTS, Plan
from eqt_cli.ensemble.sweep import Sweep
from eqt_cli.experiment.build import Experiment, build
from eqt_cli.experiment.source import ConfigSource, parse_key, with_value

MOST_TRAJECTORIES = 10_000
"""Sweeps of more runs than this keep trajectories only if the configuration asks for them."""

PART_BYTES = 64 * 2**20
"""Size of the states of a part; its signals take a few times as much."""

CACHED_POINTS = 1024


@dataclass(frozen=True, eq=False)
class Study:
    """Everything to be computed, checked.

    Attributes
    ----------
    source
        The configuration; its data without `sweep`.
    sweep
        The points; None for a single experiment.
    base
        The experiment at the first point.
    """

    source: ConfigSource
    sweep: Sweep | None
    base: Experiment

    # The points.

    def __len__(self) -> int:
        return 1 if self.sweep is None else len(self.sweep)

    def experiment(self, point: int) -> Experiment:
        """The experiment at a point."""
        return self._cached(point) if self.sweep else self.base

    @cached_property
    def _cached(self) -> Any:
        trusted = dataclasses.replace(self.source, stored_plugins=self.base.plugins)
        return lru_cache(maxsize=CACHED_POINTS)(
            lambda point: build(at_point(trusted, self.sweep, point), trust_plugins=True)
        )

    @property
    def _swept(self) -> set[str]:
        """The sections that differ between points."""
        return {section_of(key) for key in self.sweep.keys} if self.sweep else set()

    @property
    def initial_varies(self) -> bool:
        """Whether the points have initial states of their own."""
        return bool(self._swept & {"initial", "ensemble", "reference", "target"})

    @property
    def desired_varies(self) -> bool:
        """Whether the points have references of their own."""
        return bool(self._swept & {"inertia", "reference", "target", "solver"})

    # What is kept.

    @property
    def kept(self) -> int:
        """How many runs of each controller (and point) keep their trajectories."""
        store, runs = self.base.config.store, self.base.config.ensemble.runs
        asked = "trajectories" in store.model_fields_set
        if self.sweep and not asked and self._all_runs > MOST_TRAJECTORIES:
            return 0
        if isinstance(store.trajectories, int):
            return min(store.trajectories, runs)
        return runs if store.trajectories == "all" else 0

    @property
    def keeps_desired(self) -> bool:
        """Whether the desired trajectories are kept: one always, one per point with the others."""
        return not self.desired_varies or self.kept > 0

    @property
    def _all_runs(self) -> int:
        return len(self) * self.base.config.ensemble.runs * len(self.base.loops)

    @cached_property
    def plan(self) -> Plan:
        """The cut into parts."""
        base, runs = self.base, self.base.config.ensemble.runs
        state_length = next(iter(base.loops.values())).state_length
        most = PART_BYTES // (8 * base.config.time.samples * state_length)
        wanted = max(base.engine.part_runs, self._all_runs // MANY_PARTS)
        size = base.engine.runs_at_once(min(wanted, most))
        return Plan(len(self), runs, len(base.loops), size)

    # Identity.

    @property
    def name(self) -> str:
        """Name of the experiment."""
        return self.base.name

    @cached_property
    def resolved(self) -> dict[str, Any]:
        """The configuration with every default written out."""
        base = self.base
        resolved = base.resolved
        if self.sweep:
            runs = base.config.ensemble.runs
            kept = "all" if self.kept == runs else self.kept or "none"
            store = resolved["store"] | {"trajectories": kept}
            resolved = resolved | {"store": store, "sweep": self.sweep.data}
        return resolved

    @property
    def numeric_config(self) -> dict[str, Any]:
        """What of the resolved configuration affects the numbers, plugins by their source."""
        kept = {key: value for key, value in self.resolved.items() if key != "name"}
        return kept | {"plugins": self.base.numeric_config["plugins"]}

    @cached_property
    def digest(self) -> str:
        """Hash of everything that affects the numbers; equal digests, equal results."""
        text = json.dumps(self.numeric_config, sort_keys=True)
        return sha256(text.encode()).hexdigest()

    # Journeys to other processes.

    def __getstate__(self) -> dict[str, Any]:
        return {
            "source": self.source,
            "sweep": self.sweep,
            "plugins": self.base.plugins,
            "plan": self.plan,
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        source = dataclasses.replace(state["source"], stored_plugins=state["plugins"])
        for path, text in state["plugins"].items():
            load_plugin(Path(path), text)
        first = at_point(source, state["sweep"], 0)
        base = build(first, trust_plugins=True)
        kept = {"sweep": state["sweep"], "plan": state["plan"]}
        self.__dict__.update(source=source, base=base, **kept)


def at_point(source: ConfigSource, sweep: Sweep | None, point: int) -> ConfigSource:
    """The configuration at a point of a sweep.

    Raises
    ------
    ConfigError
        If a swept key leads nowhere.
    """
    if sweep is None:
        return source
    data, overrides = source.data, dict(source.overrides)
    for key, value in sweep.point(point).items():
        place = source.place(("sweep", *sweep.place(point, key)))
        path = _path(key)
        data = with_value(data, path, value, place)
        overrides[path] = place
    return dataclasses.replace(source, data=data, overrides=overrides)


def section_of(key: str) -> str:
    """The section that a dotted key is in."""
    return str(_path(key)[0])


@lru_cache(maxsize=256)
def _path(key: str) -> tuple[str | int, ...]:
    return parse_key(key, "")
