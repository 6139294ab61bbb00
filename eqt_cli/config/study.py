"""Studies: an experiment at many points of a sweep."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Collection, Hashable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from hashlib import sha256
from pathlib import Path
from typing import Any

from eqt_cli.base.errors import EqtError, Problems, parse_key
from eqt_cli.base.registry import load_plugin
from eqt_cli.base.store_reader import ResultFile
from eqt_cli.base.yaml_source import dump
from eqt_cli.components.vehicle import Vehicle
from eqt_cli.config.build import build
from eqt_cli.config.experiment import Experiment, hashes, renamed
from eqt_cli.config.parts import MANY_PARTS, Plan, Plans
from eqt_cli.config.schema import DESIRED, SHAPES, STARTS, VEHICLE, marks_of
from eqt_cli.config.source import ConfigSource, changed_at, description, source_of
from eqt_cli.config.sweep import Sweep
from eqt_cli.config.vehicle_section import decides_parts


def at_point(
    source: ConfigSource, sweep: Sweep | None, point: int, keys: Collection[str] | None = None
) -> ConfigSource:
    """Return the configuration at a point of a sweep.

    Parameters
    ----------
    keys
        The swept keys to set; None for all.

    Raises
    ------
    ConfigError
        If a swept key does not exist.
    """
    if sweep is None:
        return source
    changed = source
    for key, value in sweep.settings(point).items():
        if keys is None or key in keys:
            place = source.place(("sweep", *sweep.place(point, key)))
            changed = changed_at(changed, parse_key(key), value, place)
    return changed


def section_of(key: str) -> str:
    """Return the section of a dotted key."""
    return str(parse_key(key)[0])


def without_sweep(source: ConfigSource) -> ConfigSource:
    """Return the configuration without its section `sweep`."""
    data = {key: value for key, value in source.data.items() if key != "sweep"}
    return dataclasses.replace(source, data=data)


def sweep_of(source: ConfigSource) -> Sweep:
    """Return the sweep that a configuration defines.

    Raises
    ------
    ConfigError
        With all problems of the sweep.
    """
    problems = Problems(source.place)
    sweep = Sweep.read(source.data["sweep"], problems.at("sweep"))
    problems.raise_if_any()
    assert sweep is not None
    return sweep


def config_at(source: ConfigSource, point: int) -> ConfigSource:
    """Return the configuration at a point of the sweep that it defines.

    Raises
    ------
    EqtError
        If it defines no sweep, or has no such point.
    """
    name = source.source.name
    if not source.data.get("sweep"):
        raise EqtError(f"{name}: defines no sweep, so it has no points; leave the point out")
    sweep = sweep_of(source)
    if not 0 <= point < len(sweep):
        raise EqtError(f"{name}: has no point {point}; choose one of 0 to {len(sweep) - 1}")
    return at_point(without_sweep(source), sweep, point)


def attributes_at(results: ResultFile, point: int) -> dict[str, str]:
    """Return the attributes of one point of a result file that has only those of its sweep."""
    config = config_at(source_of(results), point).data
    experiment = json.loads(str(results.attributes["experiment"]))
    with suppress(KeyError, TypeError, AttributeError, ValueError):  # values in other units
        experiment |= description(config, experiment["departures"])
    return {"config": dump(config), "experiment": json.dumps(experiment, ensure_ascii=False)}


MOST_TRAJECTORIES = 10_000
"""Number of runs above which sweeps store trajectories only if the configuration requests them."""

PART_BYTES = 64 * 2**20
"""Size of the states of a part, bytes; its signals take a few times as much."""

WITHOUT_TRAJECTORIES = 4
"""Factor of the number of runs of a part without stored trajectories."""

CACHED_POINTS = 10_000
"""Number of points kept once they are built, for 5 ms each; one of a small body takes 18 KiB."""

POINTS_OF_A_PART = 1024
"""Largest number of points of a part, which are in memory at once."""


@dataclass(frozen=True, eq=False)
class Study:
    """An experiment, or a sweep of them, checked and ready to run.

    Attributes
    ----------
    sweep
        The points; None for a single experiment.
    base
        The experiment at the first point: its group, laws, gains and distributions.
    common
        The configuration that points change; None if that of `base` serves.
    """

    sweep: Sweep | None
    base: Experiment
    common: ConfigSource | None = None

    @property
    def source(self) -> ConfigSource:
        """The configuration that points change."""
        return self.base.source if self.common is None else self.common

    def __repr__(self) -> str:
        runs = self.base.config.ensemble.runs
        points = f"{len(self)} points, each with " if self.sweep else ""
        return (
            f"<experiment {self.name} on {self.base.group.name}: {points}{runs} runs of "
            f"{', '.join(self.controllers)}>"
        )

    # The points.

    def __len__(self) -> int:
        return 1 if self.sweep is None else len(self.sweep)

    def experiment(self, point: int) -> Experiment:
        """Return the experiment at a point."""
        return self._cached(point) if self.sweep else self.base

    @cached_property
    def _cached(self) -> Any:
        return lru_cache(maxsize=CACHED_POINTS)(
            lambda point: build(at_point(self.source, self.sweep, point), trust_plugins=True)
        )

    @cached_property
    def first_loops(self) -> dict[Hashable, Any]:
        """The first loop of each kind that was met; the others of the kind are variations of it."""
        return {}

    @property
    def _swept(self) -> list[Any]:
        """Marks of the keys that differ between points."""
        return [mark for key in self.sweep.sets for mark in marks_of(key)] if self.sweep else []

    @property
    def initial_varies(self) -> bool:
        """Whether the initial states differ between points."""
        return STARTS in self._swept

    @property
    def desired_varies(self) -> bool:
        """Whether the references differ between points."""
        return DESIRED in self._swept

    @cached_property
    def vehicles(self) -> list[Vehicle]:
        """Vehicles at the first point of each shape."""
        experiments = (self.experiment(points[0]) for points in self.shapes)
        return [next(iter(experiment.loops.values())).vehicle for experiment in experiments]

    # Storage.

    @property
    def trajectories(self) -> int:
        """Number of runs of each controller and point with stored trajectories."""
        store, runs = self.base.config.store, self.base.config.ensemble.runs
        requested = "trajectories" in store.model_fields_set
        if self.sweep and not requested and self._all_runs > MOST_TRAJECTORIES:
            return 0
        if isinstance(store.trajectories, int):
            return min(store.trajectories, runs)
        return runs if store.trajectories == "all" else 0

    @property
    def _all_runs(self) -> int:
        return len(self) * self.base.config.ensemble.runs * len(self.base.loops)

    @cached_property
    def plan(self) -> Plan:
        """Plan of the parts, if all points have the same shape."""
        base, runs = self.base, self.base.config.ensemble.runs
        state_length = max(loop.state_length for loop in base.loops.values())
        limit = PART_BYTES // (8 * base.config.time.samples * state_length)
        if not self.trajectories:
            limit *= WITHOUT_TRAJECTORIES
        wanted = max(base.engine.part_runs, self._all_runs // MANY_PARTS)
        size = base.engine.runs_at_once(min(wanted, limit, POINTS_OF_A_PART * runs))
        return Plan(len(self), runs, len(base.loops), size)

    # Points that differ in shape.

    @cached_property
    def shapes(self) -> list[Sequence[int]]:
        """Points grouped by shape."""
        keys = self.sweep.sets if self.sweep else ()
        shaping = [key for key in keys if self._shapes(key)]
        if self.sweep is None or not shaping:
            return [range(len(self))]
        by_shape: dict[str, list[int]] = {}
        for point in range(len(self)):
            values = self.sweep.settings(point)
            shape = {key: values[key] for key in shaping if key in values}
            by_shape.setdefault(json.dumps(shape), []).append(point)
        return list(by_shape.values())

    def _shapes(self, key: str) -> bool:
        """Whether shapes of arrays can depend on a key."""
        if self.sweep is None or VEHICLE not in marks_of(key):
            return SHAPES in marks_of(key)
        vehicle, values = next(iter(self.base.loops.values())).vehicle, self.sweep.values_of(key)
        return key not in self.sweep.always or decides_parts(key, values, vehicle)

    @property
    def is_ragged(self) -> bool:
        """Whether the points differ in shape."""
        return len(self.shapes) > 1

    def piece(self, index: int) -> Study:
        """Return the points of one shape as a study; the study itself if all are equal."""
        return self._piece(index) if self.is_ragged else self

    @cached_property
    def _piece(self) -> Callable[[int], Study]:
        return lru_cache(maxsize=None)(self._cut)

    def _cut(self, index: int) -> Study:
        assert self.sweep is not None
        store = {"store": self.resolved["store"]}  # all pieces store the same
        source = replace(self.source, data=self.source.data | store)
        sweep = self.sweep.only(self.shapes[index])
        piece = Study(sweep, build(at_point(source, sweep, 0), trust_plugins=True), source)
        piece.__dict__["vehicles"] = self.vehicles  # all pieces have the same metrics
        if "plans" in self.__dict__:
            piece.__dict__["plan"] = self.plans.plans[index]
        return piece

    @cached_property
    def plans(self) -> Plans:
        """Plans of all pieces."""
        return Plans(tuple(self.piece(index).plan for index in range(len(self.shapes))))

    # Identity.

    @property
    def name(self) -> str:
        """Name of the experiment and of its folder under ``results/``."""
        return self.base.name

    @property
    def controllers(self) -> list[str]:
        """Labels of the controllers."""
        return list(self.base.loops)

    @cached_property
    def resolved(self) -> dict[str, Any]:
        """The configuration with all defaults."""
        resolved = self.base.resolved
        if self.sweep:
            if set(self.sweep.always) != set(self.sweep.sets):
                resolved = build(self.source, trust_plugins=True).resolved
            runs = self.base.config.ensemble.runs
            trajectories = "all" if self.trajectories == runs else self.trajectories or "none"
            store = resolved["store"] | {"trajectories": trajectories}
            resolved = resolved | {"store": store, "sweep": self.sweep.data}
        return resolved

    @cached_property
    def _whole(self) -> Experiment:
        """The first point with the configuration of the whole study."""
        return replace(self.base, resolved=self.resolved, files=self.files)

    @property
    def numeric_config(self) -> dict[str, Any]:
        """Part of the resolved configuration that affects the numbers, with hashes of plugins."""
        return self._whole.numeric_config

    @cached_property
    def digest(self) -> str:
        """Hash of everything that affects the numbers. Equal digests mean equal results."""
        whole = self._whole.digest
        if self.sweep is None:
            return whole
        # The order of the keys is that of the points.
        ordered = json.dumps(renamed(self.sweep.data, hashes(self.files)))
        return sha256(f"{whole} {ordered}".encode()).hexdigest()

    @property
    def files(self) -> dict[str, str]:
        """Contents of the files with data of all points, by their names in the configuration."""
        return self.source.files

    # Pickling for other processes.

    def __getstate__(self) -> dict[str, Any]:
        return {"source": self.source, "sweep": self.sweep, "plans": self.plans}

    def __setstate__(self, state: dict[str, Any]) -> None:
        source, plans = state.pop("source"), state["plans"]
        for path in source.data.get("plugins", []):
            load_plugin(Path(path), source.stored_plugins[path])
        first = at_point(source, state["sweep"], 0)
        self.__dict__.update(state, base=build(first, trust_plugins=True), common=source)
        if not self.is_ragged:
            self.__dict__["plan"] = plans.plans[0]
