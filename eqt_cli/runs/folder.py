"""The folder of a result: its files, the experiment it belongs to, and the rules for removal.

The variables of a sweep have a dimension `point`. If its points differ in shape, the points of
each shape are a result of their own in the folder `shapes`, and the result file beside it is their
index: it holds the numbers of each run of all points.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.base import files, purposes
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import (
    OTHER_FOLDER,
    ComponentError,
    EqtError,
    FullDiskError,
    KeyPath,
    Remedy,
    dotted,
)
from eqt_cli.base.extensions import functions_for
from eqt_cli.base.files import Entry, FilePattern, FolderPattern
from eqt_cli.base.option_types import shown
from eqt_cli.base.store_reader import open_results
from eqt_cli.base.store_writer import Assembly, Attribute, Variable, assemble
from eqt_cli.base.stored import FORMULA, LAW, MIXED, OUTPUT, POINT, SHAPE, signal_of
from eqt_cli.base.yaml_source import dump, load
from eqt_cli.components.derived import derived
from eqt_cli.components.groups import MatrixLieGroup, Part
from eqt_cli.components.laws import Controller, output_units
from eqt_cli.components.vehicle import Vehicle, exactly_measured
from eqt_cli.config.experiment import Experiment, renamed
from eqt_cli.config.marks import WORDS
from eqt_cli.config.remarks import gains_flown
from eqt_cli.config.schema import Config, marked
from eqt_cli.config.study import Study, section_of
from eqt_cli.loop.signals import FORMULAS, LoopSignal, Metric, formulas_of, holds, output_names
from eqt_cli.results.metrics import (
    ESTIMATE_SETTLING,
    MEASURED,
    QUANTITIES,
    SETTLING,
    over,
    over_time,
    own_quantity,
)
from eqt_cli.results.origin import stored_part
from eqt_cli.results.quantity import WHOLE, Measure, ValuePer, Window
from eqt_cli.results.timing import TIMING
from eqt_cli.runs.description import description
from eqt_cli.runs.law_names import law_names
from eqt_cli.runs.lock import LOCK
from eqt_cli.runs.part_files import MANIFEST, PART_ENTRIES, PARTS, PartFiles

# The folder: its entries, the experiment that it belongs to, and the rules for removal ------------


CONFIG, PLUGINS, FILES = "config.yaml", "stored_plugins", "stored_files"
RERUN = "reruns"
"""Folder for the parts of failed runs that are computed again, and of those of a growing result."""
GROWN = "grown"
"""Folder for a result that grew, until it takes the place of the old one."""
MOVING = "moving"
"""Entry of the manifest while it does so: its digest; the result file may be the old one."""

_PICTURES = (FilePattern(r".+\.(pdf|svg|png|json|gif|html)", marked=True),)
COPY_FOLDERS = tuple(FolderPattern(name, (FilePattern(r"\d+-.+"),)) for name in (PLUGINS, FILES))
"""Copies of the files that a configuration refers to."""

_SHAPES = FolderPattern(files.SHAPES, (FilePattern(r"\d+\.h5"),))

_ENTRIES: dict[str, Entry] = {
    files.FILE_NAME: FilePattern(re.escape(files.FILE_NAME)),
    PARTS: FolderPattern(PARTS, PART_ENTRIES),
    RERUN: FolderPattern(RERUN, PART_ENTRIES),
    files.SHAPES: _SHAPES,
    GROWN: FolderPattern(GROWN, (FilePattern(re.escape(files.FILE_NAME)), _SHAPES)),
    files.FIGURES: FolderPattern(
        files.FIGURES, (FolderPattern(r"point(_\d+)+", _PICTURES), *_PICTURES)
    ),
    **{one.name: one for one in COPY_FOLDERS},
    files.REPORT: FilePattern(re.escape(files.REPORT), marked=True),
    CONFIG: FilePattern(re.escape(CONFIG)),
    TIMING: FilePattern(re.escape(TIMING)),
    MANIFEST: FilePattern(re.escape(MANIFEST)),
}
"""Entries that eqt writes in a result folder, in the order of their removal."""

RESULT_ENTRIES: tuple[Entry, ...] = (*_ENTRIES.values(), FilePattern(re.escape(LOCK) + "(-.+)?"))
"""The same entries, and the locks."""

MOST_NAMES = 3
"""Largest number of other results that a message names."""
GROWS = re.compile(r"(ensemble\.runs|sweep|controllers)\b")
"""Keys by which a result may grow, at the beginning of a line about a difference."""


@dataclass(frozen=True)
class ResultFolder:
    """The folder to which one experiment writes."""

    path: Path

    @property
    def results(self) -> Path:
        """The result file."""
        return self.path / files.FILE_NAME

    def files_of(self, study: Study) -> list[Path]:
        """Return the result file of each piece of a study."""
        if not study.is_ragged:
            return [self.results]
        return [files.shape_file(self.path, index) for index in range(len(study.shapes))]

    @property
    def parts(self) -> PartFiles:
        """The finished parts."""
        return PartFiles(self.path.resolve() / PARTS)  # workers may have another working directory

    @property
    def manifest(self) -> dict[str, Any]:
        """Record of the folder's last experiment; empty if there is none."""
        with self._refusals():
            return files.read_record(self.path / MANIFEST, "digest") or {}

    def begun(self, study: Study) -> Study:
        """Return the study by the engine that began this folder, if eqt chose another one."""
        engine = None
        with suppress(KeyError, TypeError, EqtError):  # what is wrong is told at the claim
            engine = self.manifest["config"]["solver"]["engine"]
        return study.begun_by(engine, self.path)

    def finished_runs(self, study: Study) -> int:
        """Return the number of a study's finished runs."""
        if self.manifest.get("digest") != study.digest:
            return 0
        return self.parts.done(study.plans)

    @contextmanager
    def reporting_finished_runs(self, study: Study) -> Iterator[None]:
        """Add to an error of a full disk how many runs are saved, and how to continue."""
        try:
            yield
        except EqtError as error:
            cause = error.__cause__
            full = isinstance(cause, OSError) and cause.errno in files.NO_SPACE
            if not full and not isinstance(error, FullDiskError):
                raise
            finished, total = self.finished_runs(study), study.plans.total
            if not finished:
                raise
            again = Remedy("free some space and run the same command again")
            elsewhere = Remedy("move the folder to another disk and name it with {}", "out")
            if finished == total:
                again = Remedy(f"free some space and run `eqt pack {self.path}`")
                elsewhere = Remedy("move the folder to another disk and run `eqt pack` there")
            message = f"{error.args[0]}; {finished} of {total} runs are kept in {self.path}"
            raise FullDiskError(message, again, elsewhere) from error

    def check(self) -> None:
        """Check the folder before anything in it changes.

        Raises
        ------
        EqtError
            If an entry that eqt would write or remove is a link, or was not written by eqt.
        """
        with self._refusals():
            files.check_entries(self.path, RESULT_ENTRIES)

    def claim(self, study: Study, manifest: dict[str, Any], force: bool) -> list[str]:
        """Claim the folder for this study; return the names of removed entries.

        Raises
        ------
        EqtError
            If it holds results of another experiment and `force` is false, or files that eqt did
            not write. An experiment that was begun and has no results yet is replaced.
        """
        with self._refusals():
            removed = self._clear(study, force)
            self.path.mkdir(parents=True, exist_ok=True)
            # The manifest comes first: it marks the folder as eqt's if this process dies.
            files.write_record(self.path / MANIFEST, manifest)
            self.write_config(study)
            self.parts.folder.mkdir(exist_ok=True)
        return removed

    def write_config(self, study: Study, name: str = CONFIG, mark: bytes = b"") -> None:
        """Write the complete configuration below a mark, and copies of the files it refers to."""
        plugins = self._copied(PLUGINS, study.base.plugins)
        data = renamed(study.resolved, self._copied(FILES, study.files, ".csv") | plugins)
        files.replace_file(self.path / name, mark + dump(data).encode())

    def keep_words(self, study: Study) -> None:
        """Write the configuration again if words differ that no digest has, such as `require`."""
        with suppress(OSError, EqtError, ValueError):
            content = files.content_of(self.path / CONFIG, files.TEXT_BYTES, follow=False)
            stored = load(content, CONFIG).data
            now = study.resolved
            if any(stored.get(key) != now.get(key) for key in marked(WORDS)):
                self.write_config(study)

    def tidy(self) -> None:
        """Remove unfinished files of killed processes."""
        files.remove_left_over(self.path, RESULT_ENTRIES)
        self.parts.tidy()

    def remove(self, name: str) -> list[Path]:
        """Remove what eqt wrote under a name, and nothing else; return the removed paths."""
        return files.remove_written(self.path / name, _ENTRIES[name])

    def finish(self, manifest: dict[str, Any]) -> None:
        """Write the final manifest, and remove the parts, which the result file now holds."""
        with self._refusals():
            files.write_record(self.path / MANIFEST, manifest)
            with suppress(OSError):  # the result is complete even if parts remain
                self.remove(PARTS)

    def _refusals(self) -> AbstractContextManager[None]:
        return files.refusals(self.path, "used", OTHER_FOLDER)

    def _clear(self, study: Study, force: bool) -> list[str]:
        existing = [name for name in _ENTRIES if files.kind_of(self.path / name)]
        manifest = self.manifest
        if MANIFEST in existing and not manifest:
            raise EqtError(
                f"{self.path}: {MANIFEST} is damaged, or not of eqt",
                Remedy("restore a copy of it"),
                OTHER_FOLDER,
            )
        if existing and not manifest:
            raise EqtError(f"{self.path}: holds {existing[0]} that eqt did not write", OTHER_FOLDER)
        inner = () if existing else self.path.glob(f"*/{MANIFEST}")
        if others := sorted(path.parent.name for path in inner):
            others[MOST_NAMES:] = ["…"] if len(others) > MOST_NAMES else []
            raise EqtError(
                f"{self.path}: is the folder of other results: {', '.join(others)}",
                Remedy(f"choose another folder with {{}}, such as {self.path / study.name}", "out"),
            )
        is_another = bool(manifest) and manifest["digest"] != study.digest
        begun = bool(self.parts.listed())
        precious = begun or self.results.exists() or (self.path / files.FIGURES).exists()
        if is_another and precious and not force:
            # Parts are not to be computed twice, so nobody is told how to remove them.
            ways = [] if begun else [Remedy("replace it with {}", "force")]
            if not begun and all(GROWS.match(key) for key in self.differences(study)):
                ways.insert(0, Remedy("keep the runs that are equal with {}", "grow"))
            raise self.of_another(study, OTHER_FOLDER, *ways)
        if begun and not force and manifest.get("plan") != study.plans.data:
            raise EqtError(
                f"{self.path}: was begun by a version of eqt that divides the runs differently",
                Remedy("finish with that version"),
                OTHER_FOLDER,
            )
        if not (is_another or force):
            return []
        removed = [path for name in existing for path in self.remove(name)]
        return [str(path) for path in removed] if force else []

    def of_another(self, study: Study, *remedies: Remedy) -> EqtError:
        """Return the error that the folder holds another experiment, with the differences."""
        message = f"{self.path}: holds another experiment, which differs in"
        return EqtError(message, *remedies, lines=[f"  {key}" for key in self.differences(study)])

    def differences(self, study: Study) -> list[str]:
        """Return the keys in which the experiment in the folder differs, with both values."""
        return _differences(self.manifest.get("config", {}), study.numeric_config)

    def _copied(self, folder: str, texts: Mapping[str, str], suffix: str = "") -> dict[str, str]:
        """Copy the files that a configuration refers to, so that the folder can be moved.

        Returns the new paths by the old ones.
        """
        copies = {}
        for index, (path, text) in enumerate(texts.items()):
            keeps = not suffix or Path(path).suffix in files.YAML
            name = Path(path).name if keeps else Path(path).stem + suffix
            copies[path] = f"{folder}/{index}-{name}"
            (self.path / folder).mkdir(exist_ok=True)
            files.replace_file(self.path / copies[path], text.encode())
        return copies


_ABSENT = object()


def _differences(old: Any, new: Any, path: KeyPath = ()) -> list[str]:
    """Return lines with the keys in which two configurations differ, and both values."""
    pairs: dict[str | int, tuple[Any, Any]] = {}
    if isinstance(old, dict) and isinstance(new, dict):
        pairs = {key: (old.get(key, _ABSENT), new.get(key, _ABSENT)) for key in {**new, **old}}
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        pairs = dict(enumerate(zip(old, new, strict=True)))
    elif old != new:
        return [f"{dotted(path)}: {_value_text(old)} there, {_value_text(new)} here"]
    return [line for key, pair in pairs.items() for line in _differences(*pair, (*path, key))]


def _value_text(value: Any) -> str:
    return "not given" if value is _ABSENT else shown(value)


# The result file: its dimensions, variables and groups --------------------------------------------


MOST_OUTPUTS = 32
"""Most numbers of laws that are stored over time where `store.memory` does not say."""

TEXT_BYTES = 4
"""Size of the number of a text, bytes."""


# The rows of the table for a configuration -------------------------------------------------------


def by_thresholds_of_parts(quantity: Measure, thresholds: Mapping[str, float]) -> Measure:
    """Return a row that uses the settling threshold, for separate thresholds of the parts."""
    assert quantity.of is not None
    words = quantity.long_name.replace("||I - Q_E||_F", "the largest error of a part")
    words = words.replace("||I - Qhat^-1 Q||_F", "the largest error of a part of the estimate")
    return replace(
        quantity,
        long_name=words.replace("the settling threshold", "its settling threshold"),
        signals=(ESTIMATE_SETTLING if quantity.signals == ("estimate_error",) else SETTLING,),
        of=partial(quantity.of, threshold=1.0),
        settings={},
        notes={f"threshold_{name}": value for name, value in thresholds.items()},
    )


def with_keys_of(config: Config, quantity: Measure) -> Measure:
    """Return the row of the table for the keys of a configuration."""
    thresholds = config.settling_threshold
    if isinstance(thresholds, dict) and "settling_threshold" in quantity.settings.values():
        return by_thresholds_of_parts(quantity, thresholds)
    values = {name: getattr(config, key) for name, key in quantity.choices.items()}
    quantity = quantity.with_choices(values)
    return over(quantity, window_of(config))


def window_of(config: Config) -> Window:
    """Return the window of time over which metrics are taken."""
    if (window := config.measure) is None:
        return WHOLE
    return Window(window.start, math.inf if window.stop is None else window.stop)


RESERVED = {*QUANTITIES, *(dim for quantity in QUANTITIES.values() for dim in quantity.dims)}
RESERVED |= {"controller", "run", "stored_run", POINT, "sample", "quantity"}
"""Names that no metric of the user's own may have: variables, dimensions, variables of datasets."""


def quantities(experiment: Experiment, vehicles: Sequence[Vehicle] = ()) -> list[Measure]:
    """Return the variables of an experiment's result with their units, in the file's order.

    Parameters
    ----------
    vehicles
        Vehicles of all points of a sweep; a variable stored for one is stored for all. Default:
        those of the experiment.

    Raises
    ------
    ComponentError
        If a metric of the user's own has the name of another variable.
    """
    vehicle, flown = experiment.vehicle, [loop.vehicle for loop in experiment.loops.values()]
    formulas = formulas_of(vehicle)
    # Points whose actuators show other signals have different shapes.
    shown = [over_time(signal) for signal in vehicle.shows.values() if signal.words]
    variables = list[Measure]()
    for row in (*QUANTITIES.values(), *shown, *map(own_row, experiment.metrics)):
        signal = formulas.get(row.signals[0]) if row.signals else None
        if _is_stored(row, signal, experiment, vehicles or flown):
            _check_name(row, variables, experiment.group)
            variables += _variables(row, signal, experiment, formulas)
    return variables


def _is_stored(
    row: Measure, signal: LoopSignal | None, experiment: Experiment, vehicles: Sequence[Vehicle]
) -> bool:
    """Whether the result has this row of the table, which may be of a signal."""
    stored_of = row.stored_of
    if signal and row.per is ValuePer.TRAJECTORY:
        stored_of = signal.stored_of
    if not (row.stored and any(map(stored_of, vehicles)) and _exists(row, experiment.group)):
        return False
    if signal and not any(map(signal.exists_for, experiment.loops.values())):
        return False
    return OUTPUT not in row.dims or bool(outputs_of_laws(experiment))


def _check_name(row: Measure, others: Iterable[Measure], group: MatrixLieGroup) -> None:
    """Refuse a metric of the user's own, or a signal of an actuator, with a name that is taken."""
    taken = RESERVED | {x.name for x in others} | {x.name for x in derived(group, "ZYX")}
    if row.name in taken and (row.is_own or "symbol" in row.notes):
        kind = "metric" if row.is_own else "signal of an actuator"
        raise ComponentError(
            f"{kind} '{row.name}': results have a number of this name; rename yours"
        )


def _variables(
    row: Measure,
    signal: LoopSignal | None,
    experiment: Experiment,
    formulas: Mapping[str, LoopSignal],
) -> Iterator[Measure]:
    """Yield the variable of a row, in its unit, and those of the parts that stand beside it."""
    config, group, is_over_time = (
        experiment.config,
        experiment.group,
        row.per is ValuePer.TRAJECTORY,
    )
    if signal and is_over_time:
        row = replace(row, long_name=signal.long_name)
    row, unit = with_keys_of(config, row), ""
    notes = {name: getattr(config, key) for name, key in row.settings.items()}
    if row.signals:
        laws = [loop.controller for loop in experiment.loops.values()]
        unit = _unit_of(row.signals[0], laws, group, formulas)
    yield replace(row, units=row.unit(unit), notes={**row.notes, **notes})
    if signal and (is_over_time or row.stored_by_part):
        for part in _separate_parts(row, signal, group):
            yield replace(row.part(part.name), units=row.unit(signal.unit_in(part)))


def own_row(metric: Metric) -> Measure:
    """Return the row of a metric of the user's own, with its formula."""
    return own_quantity(type(metric), of=metric.of)


def _unit_of(
    name: str, laws: Iterable[Controller], G: MatrixLieGroup, formulas: Mapping[str, LoopSignal]
) -> str:
    """Return the unit of a signal, or of one in a part, or of a number of a law."""
    if signal := formulas.get(name):
        return signal.units(G)
    if quantity := signal_of(name):
        signal = formulas[quantity.name]
        part = next(
            pose_part for pose_part in signal.parts(G) if name == f"{signal.name}_{pose_part.name}"
        )
        return signal.unit_in(part)
    return next((of[name] for of in map(output_units, laws) if name in of), "1")


def outputs_of_laws(experiment: Experiment) -> dict[str, str]:
    """Return the units of all numbers of the laws that the result stores, by name."""
    wanted, units = experiment.config.store.memory, dict[str, str]()
    for loop in experiment.loops.values():
        units |= output_names(loop.controller, experiment.group)
    return units if wanted is True or (wanted and len(units) <= MOST_OUTPUTS) else {}


def _exists(quantity: Measure, group: MatrixLieGroup) -> bool:
    """Return whether a group has the signals of a quantity."""
    return all(FORMULAS[name].exists_on(group) for name in quantity.signals if name in FORMULAS)


def _separate_parts(
    quantity: Measure, signal: LoopSignal, group: MatrixLieGroup
) -> tuple[Part, ...]:
    """Return the parts stored besides a norm; for numbers per run, only if their units differ."""
    alone = quantity.per is ValuePer.TRAJECTORY or signal.norm == "each"
    return signal.parts(group) if alone or signal.units(group) == MIXED else ()


def measured_of(experiment: Experiment) -> list[Measure]:
    """Return the quantities computed from signals, including those of parts."""
    config, group = experiment.config, experiment.group
    rows = [with_keys_of(config, quantity) for quantity in MEASURED if _exists(quantity, group)]
    rows += (with_keys_of(config, own_row(metric)) for metric in experiment.metrics)
    return rows + [
        row.part(part.name)
        for row in rows
        if row.stored_by_part and row.signals[0] in FORMULAS
        for part in _separate_parts(row, FORMULAS[row.signals[0]], group)
    ]


def coordinates(experiment: Experiment, most: int) -> dict[str, Variable]:
    """Return the coordinates of all dimensions; the first `most` runs have trajectories."""

    def along(dim: str, values: Array, long_name: str, **units: str) -> Variable:
        return Variable((dim,), values, {**units, "long_name": long_name})

    G, runs, labels = experiment.group, experiment.config.ensemble.runs, list(experiment.loops)
    variables = [
        along("controller", np.array(labels, dtype=object), "control law"),
        along("run", np.arange(runs), "run, with its own initial state", units="1"),
        along("time", experiment.times[:: experiment.config.store.decimate], "time", units="s"),
        along("row", np.arange(G.size), "row of a pose matrix", units="1"),
        along("col", np.arange(G.size), "column of a pose matrix", units="1"),
        along("axis", np.array(G.axis_names, dtype=object), "algebra coordinate"),
    ]
    members, outputs = experiment.loop.vehicle.members.items(), outputs_of_laws(experiment)
    variables += [along(dim, np.array(of, dtype=object), dim) for dim, of in members if of and most]
    if outputs and most:
        named = np.array(list(outputs), dtype=object)
        units = "; ".join(outputs.values())
        variables.append(along(OUTPUT, named, "number of a law, each with its unit", units=units))
    if 0 < most < runs:
        stored = np.arange(most)
        variables.append(along("stored_run", stored, "run whose trajectory is stored", units="1"))
    return {variable.dims[0]: variable for variable in variables}


# The file ----------------------------------------------------------------------------------------


@lru_cache(maxsize=8)
def stored_quantities(study: Study) -> list[Measure]:
    """Return the quantities that are stored of points of one shape."""
    left_out: list[ValuePer] = []
    if study.trajectories == 0:
        left_out = [ValuePer.TRAJECTORY, *([ValuePer.DESIRED] if study.desired_varies else [])]
    listed = quantities(study.base, study.vehicles)
    return [quantity for quantity in listed if quantity.per not in left_out]


def blanks(study: Study, *kinds: ValuePer) -> dict[str, Variable]:
    """Return the variables of points of one shape without their values; of some kinds, or all."""
    stored = "run" if study.trajectories == study.plan.runs else "stored_run"
    leading = {
        ValuePer.TRAJECTORY: ("controller", stored),
        ValuePer.RUN: ("controller", "run"),
        ValuePer.INITIAL: ("run",),
        ValuePer.DESIRED: (),
    }
    varies = {ValuePer.INITIAL: study.initial_varies, ValuePer.DESIRED: study.desired_varies}
    variables = {}
    for entry in stored_quantities(study):
        if not kinds or entry.per in kinds:
            by_point = study.sweep is not None and varies.get(entry.per, True)
            dims = (*((POINT,) if by_point else ()), *leading[entry.per], *entry.dims)
            variables[entry.name] = Variable(dims, entry.dtype, entry.attributes)
    return variables


def sizes_of(study: Study) -> dict[str, int]:
    """Return the length of every dimension of points of one shape."""
    along = coordinates(study.base, study.trajectories)
    return {POINT: len(study)} | _sizes(along)


def bytes_of(study: Study, *kinds: ValuePer) -> int:
    """Return the size of the variables of points of one shape, of some kinds or all, bytes."""
    sizes = sizes_of(study)
    return sum(
        math.prod(sizes[dim] for dim in blank.dims)
        * (blank.dtype.itemsize if blank.dtype else TEXT_BYTES)
        for blank in blanks(study, *kinds).values()
    )


def in_index(study: Study) -> list[Measure]:
    """Return the quantities in the result file of a study.

    If its points differ in shape, these are only the numbers per run that points of each have.
    """
    first, *others = map(stored_quantities, study.pieces)
    if not others:
        return first
    names = [{entry.name for entry in listed if entry.per is ValuePer.RUN} for listed in others]
    return [
        entry
        for entry in first
        if entry.per is ValuePer.RUN and all(entry.name in listed for listed in names)
    ]


def new_result_file(study: Study, path: Path) -> AbstractContextManager[Assembly]:
    """Open the result file of points of one shape for writing; it appears when the block ends."""
    coords = coordinates(study.base, study.trajectories) | swept_coordinates(study)
    variables = blanks(study) | further_variables(study)
    if study.whole is None:
        return _assembled(study, path, coords, variables | _laws(study))
    assert study.sweep is not None
    points, about = np.array(study.sweep.points), {"long_name": "number of the point in the sweep"}
    coords[POINT] = Variable((POINT,), points, about)
    return _assembled(study, path, coords, variables)


def write_index(study: Study, path: Path, attributes: Mapping[str, Attribute]) -> None:
    """Write the result file of points that differ in shape, from the results of all shapes."""
    of_shapes = [blanks(piece, ValuePer.RUN) for piece in study.pieces]
    shape = np.empty(len(study), dtype=np.int32)
    for index, points in enumerate(study.shapes):
        shape[points] = index
    meaning = {"long_name": f"shape of the point, whose arrays are in {files.SHAPES}/SHAPE.h5"}
    variables = {SHAPE: Variable((POINT,), shape, meaning)} | _laws(study)
    along = coordinates(study.base, 0)
    shared = {name: along[name] for name in ("controller", "run")}
    sources = [files.shape_file(path.parent, index) for index in range(len(of_shapes))]
    with ExitStack() as stack:
        results = [stack.enter_context(open_results(source)) for source in sources]
        for name in (entry.name for entry in in_index(study)):
            first, *others = (listed[name].attributes for listed in of_shapes)
            same = {key: x for key, x in first.items() if all(o.get(key) == x for o in others)}
            if "units" in first and "units" not in same:
                same = {"units": MIXED, **same}
            values = [result[name] for result in results]
            data = np.empty((len(study), *values[0].shape[1:]), values[0].dtype)
            for points, those in zip(study.shapes, values, strict=True):
                data[points] = those
            variables[name] = Variable(of_shapes[0][name].dims, data, same)
        sums = {files.SHAPES: " ".join(map(files.checksum_of, sources))}
        with _assembled(study, path, shared | swept_coordinates(study), variables) as file:
            file.describe({**attributes, **sums})


def _laws(study: Study) -> dict[str, Variable]:
    """Return the variable with the registered law that each controller is, if options are swept."""
    laws = law_names(study, study.sweep) if study.sweep else None
    meaning = {"long_name": "registered law without options that the law equals"}
    if laws is None:
        return {}
    return {LAW: Variable((POINT, "controller"), laws, meaning)}


def further_variables(study: Study) -> dict[str, Variable]:
    """Return the variables that extensions add."""
    of_extensions = functions_for(purposes.variables_of_a_result)
    return {name: x for variables in of_extensions for name, x in variables(study).items()}


def _assembled(
    study: Study, path: Path, coords: Mapping[str, Variable], variables: Mapping[str, Variable]
) -> AbstractContextManager[Assembly]:
    sizes = ({POINT: len(study)} if study.sweep else {}) | _sizes(coords)
    gzip = study.base.config.store.compression == "gzip"
    return assemble(path, sizes, coords, variables, "gzip" if gzip else None)


def _sizes(variables: Mapping[str, Variable]) -> dict[str, int]:
    return {name: along.size for name, along in variables.items() if along.dims == (name,)}


def _experiment(
    experiment: Experiment, config: Mapping[str, Any], swept: Set[str], remarks: Sequence[str]
) -> str:
    """Return what readers show of an experiment, in JSON; a swept tolerance is none."""
    laws = {label: loop.controller for label, loop in experiment.loops.items()}
    vehicles = [loop.vehicle for loop in experiment.loops.values()]
    departures = dict.fromkeys(part.departs for one in vehicles for part in one.parts.values())
    about = description(config, ", ".join(departures)) | {
        "titles": experiment.titles,
        "remarks": list(remarks),
        "exact": exactly_measured(experiment.group, experiment.loop.vehicle),
        "decimate": experiment.config.store.decimate,
        "axis": experiment.loop.task.axis or None,
        "parts": [] if "group" in swept else [stored_part(x) for x in experiment.group.parts],
        "functions": {label: law.energy for label, law in laws.items()},
        "unclaimed": [k for k, loop in experiment.loops.items() if not loop.claims_decrease],
        "not_matched": [label for label, law in laws.items() if law.matched is False],
    }
    if (model := experiment.config.model) and model.forces:
        about["without_forces"] = [k for k, law in experiment.laws.items() if not law.known_forces]
    about["setpoints"] = {k: x.setpoint for k, x in experiment.laws.items() if x.setpoint != "full"}
    about |= {"rtol": None} if "solver" in swept else {}
    if not swept & {"controllers", "gains", "group", "inertia", "reference", "time"}:
        flown = gains_flown(experiment)
        about["small_errors"] = {label: errors.model_dump() for label, errors in flown.items()}
    held = [holds(vehicle) for vehicle in vehicles]
    of_all = {name: value for name, value in held[0].items() if all(name in one for one in held)}
    about |= {} if swept & {"control", "actuators"} else {"holds": of_all}
    return json.dumps(about, ensure_ascii=False)


def _scale_attributes(study: Study, key: str) -> dict[str, Attribute]:
    """Return the scale of a swept key, and its name on the axis of a figure with its unit."""
    from eqt_cli.config.json_schema import scale_of  # only sweeps need it

    attributes: dict[str, Attribute] = {}
    assert study.sweep is not None
    if key in log_keys(study.sweep.data):
        attributes["scale"] = "log"
    if scale := scale_of(study.resolved, key):
        letter = re.sub(r"(?<= )[gcnq]$", r"$\g<0>$", scale.label)  # of a weight
        attributes["label"] = f"${scale.label}$" if scale.is_symbol else letter
        attributes |= {"unit_of_key": scale.unit} if scale.unit else {}
    return attributes


def log_keys(section: Any) -> Iterator[str]:
    """Yield the keys of ranges with ``scale: log`` in the section of a sweep."""
    if isinstance(section, list):
        for entry in section:
            yield from log_keys(entry)
    elif isinstance(section, dict):
        for key, entry in section.items():
            if isinstance(entry, dict) and entry.get("scale") == "log":
                yield str(key)
            yield from log_keys(entry)


def swept_coordinates(study: Study) -> dict[str, Variable]:
    """Return a coordinate along `point` for each swept key: numbers, texts, or JSON texts."""
    if study.sweep is None:
        return {}
    swept, sweep, points = {}, study.sweep, range(len(study))
    columns = dict(zip(sweep.keys, zip(*map(sweep.values, points), strict=True), strict=True))
    if sweep.rules:
        follow = [sweep.rules.derived(sweep.settings_of_blocks(point)) for point in points]
        columns |= {key: tuple(values[key] for values in follow) for key in sweep.rules.formulas}
    for key, values in columns.items():
        name = key.replace("[", ".").replace("]", "")
        attributes = {"long_name": f"{key}, swept", "key": key} | _scale_attributes(study, key)
        if key not in sweep.keys:
            attributes |= {"long_name": f"{key}, from others", FORMULA: sweep.rules.text(key)}
        if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
            swept[name] = Variable((POINT,), np.array(values), attributes)
        else:
            plain = all(isinstance(value, str) for value in values)
            texts = values if plain else [json.dumps(v, ensure_ascii=False) for v in values]
            swept[name] = Variable((POINT,), np.array(texts, dtype=object), attributes)
    return swept


def described(study: Study, provenance: dict[str, Any]) -> dict[str, Any]:
    """Return the attributes that describe a result and allow running it again."""
    groups = {piece.base.group.name: None for piece in study.pieces}
    swept = set(map(section_of, study.varied))
    return {
        "title": study.name,
        "config": study.document.source.comment + dump((study.whole or study).resolved),
        "plugins": dump(study.base.plugins),
        **({"files": json.dumps(study.files, ensure_ascii=False)} if study.files else {}),
        **({"code": json.dumps(study.code)} if study.code else {}),
        "digest": (study.whole or study).digest,
        "group": ", ".join(groups),
        "experiment": _experiment(
            study.base, study.resolved, swept, (study.whole or study).remarks
        ),
        "provenance": json.dumps(provenance, ensure_ascii=False),
        "references": "Hampsey, van Goor, Banavar, Mahony (2025), arXiv 2511.18800",
    }
