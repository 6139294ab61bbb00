"""Studies: an experiment at many points of a sweep, and how one is read from a configuration."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from hashlib import sha256
from pathlib import Path
from typing import Any

from eqt_cli.base.code_files import united
from eqt_cli.base.errors import (
    ConfigError,
    EqtError,
    InputError,
    InputProblem,
    Problems,
    parse_key,
    suggestion,
)
from eqt_cli.base.option_types import shown
from eqt_cli.base.registry import load_plugin
from eqt_cli.base.reporting import reporter, step
from eqt_cli.base.yaml_source import parse_value
from eqt_cli.components.vehicle import INNER, Vehicle
from eqt_cli.config.designs import EXPECTED, Sweep
from eqt_cli.config.document import Document, changed_at
from eqt_cli.config.experiment import Experiment, LastPoint, digest_of, hashes, numeric, renamed
from eqt_cli.config.marks import DESIRED, SHAPES, STARTS, VEHICLE
from eqt_cli.config.parts import MANY_PARTS, Plan, Plans
from eqt_cli.config.preflight import build
from eqt_cli.config.schema import Config, marks_of, not_swept
from eqt_cli.config.sections import decides_parts
from eqt_cli.engines.choice import AUTO
from eqt_cli.engines.engine import Compiled

# An experiment at the points of a sweep: its points, its parts, and what is stored ----------------


def at_point(
    document: Document, sweep: Sweep | None, point: int, keys: Collection[str] | None = None
) -> Document:
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
        return document
    changed = document
    for key, value in sweep.settings(point).items():
        if keys is None or key in keys:
            place = document.place(("sweep", *sweep.place(point, key)))
            changed = changed_at(changed, parse_key(key), value, place)
    return changed


def _is_kind(key: str) -> bool:
    """Whether a key decides which law a controller is, and so how much it remembers."""
    path = parse_key(key)
    return len(path) <= 2 or path[-1] == "kind"


def section_of(key: str) -> str:
    """Return the section of a dotted key."""
    return str(parse_key(key)[0])


def without_sweep(document: Document) -> Document:
    """Return the configuration without its section `sweep`."""
    data = {key: value for key, value in document.data.items() if key != "sweep"}
    return replace(document, data=data)


def sweep_of(document: Document) -> Sweep:
    """Return the sweep that a configuration defines.

    Raises
    ------
    ConfigError
        With all problems of the sweep.
    """
    problems = Problems(document.place)
    sweep = Sweep.read(document.data["sweep"], problems.at("sweep"))
    if sweep is not None and sweep.rules:
        sweep.rules.bind(sweep, document, problems.at("sweep"))
    problems.raise_if_any()
    assert sweep is not None
    return sweep


def config_at(document: Document, point: int) -> Document:
    """Return the configuration at a point of the sweep that it defines.

    Raises
    ------
    EqtError
        If it defines no sweep, or has no such point.
    """
    name = document.source.name
    if not document.data.get("sweep"):
        raise EqtError(f"{name}: defines no sweep, so it has no points; leave the point out")
    sweep = sweep_of(document)
    if not 0 <= point < len(sweep):
        raise EqtError(f"{name}: has no point {point}; choose one of 0 to {len(sweep) - 1}")
    return at_point(without_sweep(document), sweep, point)


MOST_TRAJECTORIES = 10_000
"""Number of runs above which sweeps store trajectories only if the configuration requests them."""

PART_BYTES = 64 * 2**20
"""Size of the states of a part, bytes; its signals take a few times as much."""

WITHOUT_TRAJECTORIES = 4
"""Factor of the number of runs of a part without stored trajectories."""

CACHED_POINTS = 10_000
"""Number of points kept once they are built, for 5 ms each; one of a small body takes 18 KiB."""

PART_RUNS, COMPILED_RUNS = 50, 2500
"""Approximate number of runs in a part, and of a compiled engine: enough to outweigh a file, few
enough to lose."""

FEW_RUNS, LEAST_PARTS = 50, 16
"""Parts of more than so many runs, without a sweep four times as many, become smaller until a law
has so many of them, for workers; those of the paper would cost a seventh more."""

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
    planned
        The plans of all pieces, where another process or the whole study has made them.
    whole
        The study of which this is a piece.
    remarks
        What was remarked on `base` before it is run, for the readers of its result.
    """

    sweep: Sweep | None
    base: Experiment
    common: Document | None = None
    planned: Plans | None = None
    whole: Study | None = None
    remarks: tuple[str, ...] = field(default=(), compare=False)

    @property
    def document(self) -> Document:
        """The configuration that points change."""
        return self.base.document if self.common is None else self.common

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
        return self._built(point) if self.sweep else self.base

    @cached_property
    def _built(self) -> Callable[[int], Experiment]:
        last = LastPoint()
        return lru_cache(maxsize=CACHED_POINTS)(
            lambda point: build(at_point(self.document, self.sweep, point), last)
        )

    @cached_property
    def first_loops(self) -> dict[Hashable, Any]:
        """The first loop of each kind that was met; the others of the kind are variations of it."""
        return {}

    @property
    def _swept(self) -> list[Any]:
        """Marks of the keys that differ between points."""
        return [mark for key in self.sweep.sets for mark in marks_of(key)] if self.sweep else []

    @cached_property
    def varied(self) -> list[str]:
        """The keys that differ between points; those of points of one shape have that in common."""
        sweep = self.sweep
        if sweep is None or self.whole is None:
            return list(sweep.sets) if sweep else []
        values = [sweep.settings(point) for point in range(len(sweep))]
        first = values[0]
        return [
            key for key in sweep.sets if any(x.get(key, ...) != first.get(key, ...) for x in values)
        ]

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
        """Vehicles at the first point of each shape; all pieces have the same metrics."""
        if self.whole is not None:
            return self.whole.vehicles
        firsts = (self.experiment(points[0]) for points in self.shapes)
        return [loop.vehicle for first in firsts for loop in first.loops.values()]

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
        if self.planned is not None and not self.is_ragged:
            return self.planned.plans[0]
        base, runs = self.base, self.base.config.ensemble.runs
        state_length = max(loop.state_length for loop in base.loops.values())
        limit = PART_BYTES // (8 * base.config.time.samples * state_length)
        if not self.trajectories:
            limit *= WITHOUT_TRAJECTORIES
        few = FEW_RUNS if self.sweep else 4 * FEW_RUNS
        shares = max(few, -(-len(self) * runs // LEAST_PARTS))
        usual = COMPILED_RUNS if isinstance(base.engine, Compiled) else PART_RUNS
        wanted = max(min(usual, shares), self._all_runs // MANY_PARTS)
        block = getattr(base.engine, "runs_per_block", 1)
        blocks = min(wanted, limit, POINTS_OF_A_PART * runs) // block
        return Plan(len(self), runs, len(base.loops), max(1, blocks) * block)

    # Points that differ in shape.

    @cached_property
    def shapes(self) -> list[Sequence[int]]:
        """Points grouped by shape."""
        shaping = [key for key in (self.sweep.sets if self.sweep else ()) if self._shapes(key)]
        sets = self.sweep.sets if self.sweep else ()
        # Laws have memories, and delays that are times wait for other numbers of other periods.
        remembers = any(
            section_of(key) == "control" or (section_of(key) == "controllers" and _is_kind(key))
            for key in sets
        )
        if self.sweep is None or not (shaping or remembers):
            return [range(len(self))]
        by_shape: dict[str, list[int]] = {}
        for point in range(len(self)):
            values = self.sweep.settings(point)
            shape: dict[str, Any] = {key: values[key] for key in shaping if key in values}
            with suppress(ConfigError):  # which the check of all points notes
                loops = self.experiment(point).loops.values() if remembers else ()
                shape[""] = [loop.state_length for loop in loops]
            by_shape.setdefault(json.dumps(shape), []).append(point)
        return list(by_shape.values())

    def _shapes(self, key: str) -> bool:
        """Whether shapes of arrays can depend on a key."""
        if self.sweep is None or not (VEHICLE in marks_of(key) or INNER in parse_key(key)):
            return SHAPES in marks_of(key)
        vehicle, values = self.base.loop.vehicle, self.sweep.values_of(key)
        return key not in self.sweep.always or decides_parts(key, values, vehicle)

    @property
    def is_ragged(self) -> bool:
        """Whether the points differ in shape."""
        return len(self.shapes) > 1

    @property
    def pieces(self) -> list[Study]:
        """The points of each shape as a study."""
        return [self.piece(index) for index in range(len(self.shapes))]

    def piece(self, index: int) -> Study:
        """Return the points of one shape as a study; the study itself if all are equal."""
        if self.sweep is None or not self.is_ragged:
            return self
        if index not in self._pieces:
            store = {"store": self.resolved["store"]}  # all pieces store the same
            document = replace(self.document, data=self.document.data | store)
            whole = self.sweep
            sweep = Sweep(whole.blocks, whole.section, self.shapes[index], whole.rules)
            base = build(at_point(document, sweep, 0))
            plans = None
            if self.planned is not None:
                plans = Plans(self.planned.plans[index : index + 1])
            self._pieces[index] = Study(sweep, base, document, plans, self)
        return self._pieces[index]

    @cached_property
    def _pieces(self) -> dict[int, Study]:
        return {}

    @cached_property
    def plans(self) -> Plans:
        """Plans of all pieces."""
        return self.planned or Plans(tuple(piece.plan for piece in self.pieces))

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
                resolved = build(self.document).resolved
            runs = self.base.config.ensemble.runs
            trajectories = "all" if self.trajectories == runs else self.trajectories or "none"
            store = resolved["store"] | {"trajectories": trajectories}
            resolved = resolved | {"store": store, "sweep": self.sweep.data}
        return resolved

    @property
    def numeric_config(self) -> dict[str, Any]:
        """Part of the resolved configuration that affects the numbers, with hashes of files."""
        return numeric(self.resolved, self.files | self.base.plugins, self.code)

    @cached_property
    def code(self) -> dict[str, str]:
        """Hashes of the files of code of somebody else at the first points of all shapes."""
        firsts = [points[0] for points in self.shapes[1:]]
        return united([self.base.code, *(self.experiment(point).code for point in firsts)])

    @cached_property
    def digest(self) -> str:
        """Hash of everything that affects the numbers. Equal digests mean equal results."""
        whole = digest_of(self.numeric_config)
        if self.sweep is None:
            return whole
        # The order of the keys is that of the points.
        ordered = json.dumps(renamed(self.sweep.data, hashes(self.files)))
        return sha256(f"{whole} {ordered}".encode()).hexdigest()

    @property
    def files(self) -> dict[str, str]:
        """Contents of the files with data of all points, by their names in the configuration."""
        return self.document.home.files

    def begun_by(self, engine: object, folder: Path) -> Study:
        """Return the study by the engine that began its folder, if eqt chose another one."""
        name = self.base.solver.begun_by(engine, folder)
        if name is None:
            return self
        document = changed_at(self.document, ("solver", "engine"), name, str(folder))
        return _built_again(document, self.sweep, None)

    # Pickling for other processes.

    def __reduce__(self) -> tuple[Callable[..., Study], tuple[Any, ...]]:
        return _built_again, (self.document, self.sweep, self.plans)


def _built_again(document: Document, sweep: Sweep | None, plans: Plans | None) -> Study:
    """Return a study in another process, whose parts are planned, or by another engine."""
    for path in document.data.get("plugins", []):
        load_plugin(Path(path), (document.home.plugins or {})[path])
    return Study(sweep, build(at_point(document, sweep, 0)), document, plans)


# Reads the sweep of a configuration, and checks every point of it ---------------------------------


MOST_PROBLEMS = 20
"""Largest number of reported problems of a sweep; a mistake often affects thousands of points."""

MOST_GROUPS = 1000
"""Largest number of points that differ in shape. Opening the group of each takes milliseconds."""

RUNS = (
    "ensemble.runs cannot be swept: run k starts from the same state however many runs there are, "
    "so the first 50 of 200 runs are the ensemble of 50; set the largest number, and use the first "
    "runs of it"
)


def add_grids(document: Document, grids: Mapping[str, str]) -> Document:
    """Return the configuration whose sweep has more blocks: ``gains.kd=0.25,0.5,1`` by places.

    A text such as ``gains.kd=0.25:1:4``, or with ``:log`` at its end, is a range with its number of
    points.

    Raises
    ------
    ConfigError
        For a text that does not parse.
    """
    section = document.data.get("sweep")
    if section is not None and not isinstance(section, list):
        message = f"{EXPECTED}, got {shown(section)}"
        raise ConfigError([document.problem(("sweep",), message)])
    for place, grid in grids.items():
        key, equals, text = grid.partition("=")
        if not equals or not key.strip() or not text.strip():
            message = f"expected KEY=VALUE,VALUE,…, got '{grid}'"
            raise ConfigError([InputProblem("", message, place)])
        values = parse_value(f"[{text}]", place)
        if re.fullmatch(r"[^:,\[\]{}]+(:[^:,\[\]{}]+){2}(:log)?", text.strip()):
            ends = [parse_value(part, place) for part in text.split(":")]
            values = dict(zip(("low", "high", "points", "scale"), ends, strict=False))
        document = with_grid(document, key.strip(), values, place)
    return document


def with_grid(document: Document, key: str, values: Any, place: str) -> Document:
    """Return the configuration whose sweep has one more key, whose errors are at a place."""
    return with_block(document, {"grid": {key: values}}, place)


def with_block(document: Document, block: dict[str, Any], place: str) -> Document:
    """Return the configuration whose sweep has one more entry, whose errors are at a place."""
    blocks = document.data.get("sweep") or []
    changes = document.changes | {("sweep", len(blocks)): place}
    data = document.data | {"sweep": [*blocks, block]}
    return replace(document, data=data, changes=changes)


def study(document: Document, *, most_checked: int | None = None) -> Study:
    """Check a configuration and the points of its sweep.

    Parameters
    ----------
    most_checked
        Largest number of points to check, spread over all; None checks all.

    Raises
    ------
    ConfigError
        With all problems; problems of a swept value are at its place.
    """
    section = document.data.get("sweep")
    bare = without_sweep(document)
    if section is None or section == []:
        return Study(None, build(bare))
    sweep = sweep_of(document)
    problems = Problems(document.place)
    for key in sweep.sets:
        with problems.catching("sweep", *sweep.first_place(key)):
            require_sweepable(key)
    problems.raise_if_any()
    common = at_point(bare, sweep, 0, sweep.always)
    base = build(at_point(common, sweep, 0))
    if base.solver.is_auto:
        engine = _common_engine(common, sweep, base)
        common = changed_at(common, ("solver", "engine"), engine, AUTO)
        if engine != base.engine.name:
            named = build(at_point(common, sweep, 0))
            solver = replace(base.solver, engine=named.engine)
            base = replace(base, solver=solver, document=named.document)
    home = base.document.home  # other processes execute the same sources
    checked = Study(sweep, base, replace(common, home=home))
    try:
        checked.resolved  # noqa: B018  # builds and caches it
    except ConfigError as error:
        where = "without what only some of the cases change"
        raise ConfigError(
            replace(problem, message=f"{where}: {problem.message}") for problem in error.problems
        ) from None
    if checked.is_ragged and len(checked) > MOST_GROUPS:
        raise EqtError(
            f"{document.place(('sweep',))}: {len(checked):,} points that differ in group, times or "
            f"parts are too many files; sweep at most {MOST_GROUPS:,}, or split the sweep"
        )
    with step("points checked", len(checked)):
        _check_points(checked, spread(len(checked), most_checked))
    return checked


def _common_engine(common: Document, sweep: Sweep, base: Experiment) -> str:
    """Return the engine that can solve every point; settings of keys may need another one."""
    if not isinstance(base.engine, Compiled):
        return base.engine.name
    texts = [json.dumps(sweep.settings(point)) for point in range(len(sweep))]
    kinds = [json.dumps(json.loads(text, parse_float=bool, parse_int=bool)) for text in texts]
    for point in sorted(map(kinds.index, set(kinds)))[1:]:
        with suppress(ConfigError):  # which the check of all points notes
            engine = build(at_point(common, sweep, point)).engine.name
            if engine != base.engine.name:
                return engine
    return base.engine.name


def spread(count: int, most: int | None) -> Sequence[int]:
    """Return at most `most` of the points, spread from the first to the last."""
    if most is None or count <= most:
        return range(count)
    return [k * (count - 1) // max(1, most - 1) for k in range(most)]


def require_sweepable(key: str) -> None:
    """Raise an `InputError` if a key cannot be swept."""
    name = section_of(key)
    if why := not_swept(key):
        raise InputError(f"{name} cannot be swept: it {why}; run one experiment for each value")
    if key == "time":
        raise InputError(
            "time cannot be swept as a whole; sweep time.duration and time.samples with zip"
        )
    if key == "ensemble.runs":
        raise InputError(RUNS)
    if name not in Config.model_fields:
        fields = [field for field in Config.model_fields if not not_swept(field)]
        unread = ", and no formula of `set` reads it" if key.isidentifier() else ""
        where = suggestion(name, fields) or f"; keys are in: {', '.join(fields)}"
        raise InputError(f"unknown key '{key}'{unread}{where}")


def _check_points(checked: Study, points: Sequence[int]) -> None:
    """Build points; a value that is wrong at many points is reported once."""
    problems: dict[InputProblem, None] = {}
    first_of = {point: alike[0] for alike in checked.shapes[1:] for point in alike}
    for point in points:
        reporter().advance(len(checked) / len(points))
        try:
            experiment = checked.experiment(point)
        except ConfigError as error:
            problems |= dict.fromkeys(error.problems)
            if len(problems) >= MOST_PROBLEMS:
                break
            continue
        if experiment.solver.is_auto and checked.base.solver.is_auto:
            path, message = "solver.engine", "must be named where a point or a case sets the solver"
            place = experiment.document.place(("solver", "engine"))
            problems[InputProblem(path, message, place)] = None
        elif wrong := _unlike(checked, experiment, first_of.get(point, 0)):
            place = checked.document.place(("sweep",))
            problems[InputProblem("sweep", f"point {point}: {wrong}", place)] = None
            break
    if problems:
        raise ConfigError(problems)


def _unlike(checked: Study, experiment: Experiment, first: int) -> str | None:
    """Return why the results of a point do not fit to those of the others, or None.

    Parameters
    ----------
    first
        The first point of its shape, with which it is solved.
    """
    base = checked.base
    if list(experiment.loops) != list(base.loops):
        return (
            f"the controllers are {', '.join(experiment.loops)}, but {', '.join(base.loops)} at "
            "point 0; give each a `label` that is the same at all points"
        )
    if experiment.solver.is_auto:
        return "solver.engine is given there or at point 0 only; give it at both"
    runs, base_runs = experiment.config.ensemble.runs, base.config.ensemble.runs
    if runs != base_runs:
        return f"ensemble.runs is {runs}, but {base_runs} at point 0; {RUNS}"
    for label, loop in checked.experiment(first).loops.items():
        length, expected = experiment.loops[label].state_length, loop.state_length
        if length != expected:
            lengths = (one.layout.lengths for one in (experiment.loops[label], loop))
            differing = {
                x for x, _ in set.symmetric_difference(*(set(of.items()) for of in lengths))
            }
            return (
                f"the loop of controller '{label}' has {length} states, but {expected} at point "
                f"{first} ({', '.join(sorted(differing)).replace('_', ' ')}); run such points as "
                "separate experiments, and compare them by `eqt compare RESULT OTHER`"
            )
    return None
