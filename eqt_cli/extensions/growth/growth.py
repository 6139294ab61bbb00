"""Growth of results: what other results hold and what is equal is taken over, the rest computed.

A run belongs to a point, a law and a number. What decides its numbers are the experiment at the
point, without the number of its runs and its other laws: its digest. The runs whose digests stand
in a result need not be computed. The new result is written beside the old one, and takes its place
when it is complete.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from eqt_cli.base import files, purposes
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import OTHER_FOLDER, EqtError, EqtWarning, Remedy
from eqt_cli.base.reporting import reporter
from eqt_cli.base.store_reader import ResultFile, open_results
from eqt_cli.base.store_writer import Assembly
from eqt_cli.base.stored import LAW_OUTPUT, POINT
from eqt_cli.base.version import GROWN_FROM, OTHERS, differences, together
from eqt_cli.config.document import document_of
from eqt_cli.config.experiment import digest_of
from eqt_cli.config.parts import StudyPart
from eqt_cli.config.study import Study, study
from eqt_cli.engines.engine import Compiled, Engine
from eqt_cli.extensions.growth.reruns import GROWING
from eqt_cli.extensions.growth.solvers_of_runs import remarks
from eqt_cli.loop.signals import output_names
from eqt_cli.results.quantity import ValuePer
from eqt_cli.runs.batches import BOUND_PER_RTOL, chosen_entries, kind_of
from eqt_cli.runs.compute_part import PartTask
from eqt_cli.runs.folder import (
    GROWN,
    MOVING,
    RERUN,
    ResultFolder,
    outputs_of_laws,
    stored_quantities,
)
from eqt_cli.runs.part_files import MANIFEST, PartFiles
from eqt_cli.runs.provenance import now
from eqt_cli.runs.run_study import Execution, Session, Works, pack, timed

MOST_NAMED = 3
"""Largest number of points that a message names."""

Run = tuple[int, str]
"""A point and the label of a law."""


@dataclass(frozen=True, eq=False)
class Source:
    """A result from which runs are taken over.

    Attributes
    ----------
    file
        The open result.
    study
        Its study.
    """

    file: ResultFile
    study: Study

    @cached_property
    def digests(self) -> dict[str, Run]:
        """The point and the law of each digest."""
        return {digest: run for run, digest in digests_of(self.study, self.code).items()}

    @cached_property
    def code(self) -> dict[str, str]:
        """Hashes of the files of code that computed its runs."""
        return dict(json.loads(str(self.file.attributes.get("code", "{}"))))

    @cached_property
    def runs(self) -> int:
        """The number of runs of each point and law."""
        return int(self.study.base.config.ensemble.runs)

    @cached_property
    def blocks(self) -> set[tuple[Any, ...]]:
        """The runs of each part, whose engine may have solved them together."""
        names = digests_of(self.study, self.code)
        return {
            content
            for index in range(len(self.study.shapes))
            for _, content in parts_of(self.study, index, names)
        }

    def at(self, point: int) -> ResultFile:
        """Return the result of a point."""
        return self.file.at(point) if POINT in self.file.dimensions else self.file

    @property
    def stored(self) -> int:
        """The number of runs of each point and law with trajectories."""
        return self.study.trajectories


def source_of(file: ResultFile) -> Source:
    """Return an open result as a source of runs.

    Raises
    ------
    EqtError
        If some of its runs are not those of its configuration.
    """
    for words in remarks(file):
        raise EqtError(
            f"{file.path}: {words}; the runs of a result that grows, or is joined with others, are "
            "those of one configuration",
            Remedy("compute it with these settings for all runs, with {}", "force"),
            OTHER_FOLDER,
        )
    return Source(file, study(document_of(file)))


def digests_of(of: Study, code: Mapping[str, str] | None = None) -> dict[Run, str]:
    """Return the digest of each law at each point: of all that decides the numbers of its runs.

    Parameters
    ----------
    code
        Hashes of the files of code, if not those that are there now.
    """
    code = of.code if code is None else code
    digests: dict[Run, str] = {}
    for point in range(len(of)):
        config = {**of.experiment(point).numeric_config, "code": code}
        laws = {str(law["label"]): law for law in config.pop("controllers")}
        config["ensemble"] = {k: x for k, x in config["ensemble"].items() if k != "runs"}
        config["solver"] = {k: x for k, x in config["solver"].items() if k != "cross_check"}
        config["store"] = {k: x for k, x in config["store"].items() if k in ("decimate", "memory")}
        digests |= {(point, k): digest_of([config, law]) for k, law in laws.items()}
    return digests


def require_same_code(wanted: Study, source: Source) -> None:
    """Raise an `EqtError` where files of code have changed since a result was computed."""
    lines = [
        f"  {name}: {source.code.get(name, 'none')} there, {wanted.code.get(name, 'none')} here"
        for name in sorted(source.code.keys() | wanted.code.keys())
        if source.code.get(name) != wanted.code.get(name)
    ]
    if lines:
        raise EqtError(
            f"{source.file.path}: was computed by other files of code, whose hashes differ",
            Remedy("undo their changes"),
            Remedy("compute it all again with {}", "force"),
            OTHER_FOLDER,
            lines=lines,
        )


def parts_of(
    of: Study, index: int, names: Mapping[Run, str]
) -> Iterator[tuple[StudyPart, tuple[Any, ...]]]:
    """Yield the parts of a piece, each with the digests and numbers of its runs."""
    piece, points = of.piece(index), of.shapes[index]
    labels = list(of.base.loops)
    for number in range(len(piece.plan)):
        part = piece.plan.part(number)
        label = labels[part.controller]
        kinds = {k: kind_of(piece.experiment(k), label) for k in np.unique(part.points).tolist()}
        order = {kind: k for k, kind in enumerate(dict.fromkeys(kinds.values()))}
        pairs = zip(part.points.tolist(), part.run_numbers.tolist(), strict=True)
        yield part, tuple((names[points[p], label], order[kinds[p]], run) for p, run in pairs)


# What is taken over, and what is left to compute --------------------------------------------------


@dataclass(frozen=True)
class Taken:
    """Runs of a law at a point that a source holds: the first `runs` of them.

    Attributes
    ----------
    source
        The result that holds them.
    point, label
        Where they are there.
    runs
        Their number.
    """

    source: Source
    point: int
    label: str
    runs: int

    def numbers(self, name: str, whole: dict[tuple[int, str], Array]) -> Array:
        """Return a number of these runs."""
        file, row = self.source.file, None
        if POINT in file.dimensions:
            file, row = file.source(self.point)
        key = id(file), name
        if key not in whole:
            whole[key] = file[name]
        values = whole[key] if row is None else whole[key][row]
        return values[list(self.source.study.base.loops).index(self.label)][: self.runs]

    def signal(self, name: str, piece: Study) -> Array:
        """Return a signal over time of those of these runs that a piece stores."""
        view = self.source.at(self.point)
        runs = min(self.runs, piece.trajectories)
        if name != LAW_OUTPUT:
            dim = view.dims(name)[1]
            return view.read(name, controller=self.label, **{dim: slice(0, runs)})
        ours = list(outputs_of_laws(piece.base))
        samples = len(piece.base.times[:: piece.base.config.store.decimate])
        signals = np.full((runs, samples, len(ours)), np.nan)
        if view.has(name):
            dim, last = view.dims(name)[1], view.dims(name)[-1]
            values = view.read(name, controller=self.label, **{dim: slice(0, runs)})
            for k, output in enumerate(map(str, view.coordinate(last))):
                if output in ours:
                    signals[..., ours.index(output)] = values[..., k]
        return signals


@dataclass
class Growth:
    """What of a study some results hold.

    Attributes
    ----------
    study
        The study that is to be complete.
    sources
        The results that hold parts of it.
    """

    study: Study
    sources: Sequence[Source]
    _names: dict[Run, str] = field(init=False)

    def __post_init__(self) -> None:
        self._names = digests_of(self.study)

    @cached_property
    def taken(self) -> dict[Run, Taken]:
        """What is taken over, by point and law of the study."""
        runs, taken = self.study.base.config.ensemble.runs, dict[Run, Taken]()
        for source in filter(self._fits, self.sources):
            whole = source.stored == source.runs or source.stored >= self.study.trajectories
            for run, digest in self._names.items():
                if digest not in source.digests or not self._has_outputs(source, run[1]):
                    continue
                if run not in taken or source.runs > taken[run].runs:
                    there = min(source.runs, runs)
                    if not whole:  # the others lack trajectories that this study stores
                        there = min(there, source.stored)
                    if there:
                        taken[run] = Taken(source, *source.digests[digest], there)
        return taken

    def _fits(self, source: Source) -> bool:
        """Whether a source stores all that the study does."""
        by_shape = {id(piece): piece for piece in self.study.pieces}.values()
        names = {entry.name for piece in by_shape for entry in stored_quantities(piece)}
        held = {entry.name for piece in source.study.pieces for entry in stored_quantities(piece)}
        return names - {LAW_OUTPUT} <= held

    def _has_outputs(self, source: Source, label: str) -> bool:
        """Whether a source stores all numbers of a law over time that the study stores."""
        if not self.study.trajectories:
            return True
        ours, theirs = (set(outputs_of_laws(of.base)) for of in (self.study, source.study))
        loop = self.study.base.loops[label]
        return ours & set(output_names(loop.controller, loop.group)) <= theirs

    def left_out(self, source: Source) -> list[str]:
        """Return what a source holds and the study does not, in words."""
        wanted, runs = set(self._names.values()), self.study.base.config.ensemble.runs
        lost = [run for digest, run in source.digests.items() if digest not in wanted]
        words = [f"{label} at point {point}" for point, label in lost[:MOST_NAMED]]
        words += [f"and {len(lost) - MOST_NAMED} more"] if len(lost) > MOST_NAMED else []
        if source.runs > runs:
            words.append(f"runs {runs} to {source.runs - 1}")
        return words

    def chosen(self) -> list[tuple[int, StudyPart]]:
        """Return the parts that are left to compute, each with the index of its piece.

        Runs that are cross-checked are computed again, because results do not hold their states.
        Where an engine solves runs together, their parts are taken over as a whole or not at all.
        """
        chosen: list[tuple[int, StudyPart]] = []
        labels = list(self.study.base.loops)
        for index in range(len(self.study.shapes)):
            piece, points = self.study.piece(index), self.study.shapes[index]
            checked = set(chosen_entries(piece).tolist())
            for part, content in parts_of(self.study, index, self._names):
                missing = []
                for entry in range(part.start, part.stop):
                    point, run = divmod(entry, part.runs)
                    taken = self.taken.get((points[point], labels[part.controller]))
                    missing.append(entry in checked or taken is None or run >= taken.runs)
                if is_shared(piece.base.engine):
                    differs = not any(content in source.blocks for source in self.sources)
                    missing = [differs or any(missing)] * len(missing)
                chosen += [(index, piece) for piece in _cut(part, missing)]
        return chosen

    def lacks(self, index: int, part: StudyPart) -> int:
        """Return how many runs of a part the sources lack; those in blocks count as lacking."""
        piece, points = self.study.piece(index), self.study.shapes[index]
        if is_shared(piece.base.engine):
            return len(part)
        label = list(self.study.base.loops)[part.controller]
        held = [self.taken.get((points[point], label)) for point in part.points.tolist()]
        pairs = zip(held, part.run_numbers.tolist(), strict=True)
        return sum(taken is None or run >= taken.runs for taken, run in pairs)

    def compare(self, task: PartTask, origin: Mapping[str, Any]) -> None:
        """Compare the kept runs that were computed again with what the sources hold.

        They have the same bits by the same versions, on the same arithmetic, each alone; else
        they differ by at most `BOUND_PER_RTOL` times the solver's tolerance, as cross-checks allow.

        Raises
        ------
        EqtError
            If one differs by more.
        """
        labels, engine = list(self.study.base.loops), self.study.base.engine
        whole = dict[tuple[int, str], Array]()
        for item, finished in sorted(task.finished().items()):
            index, part = task.part(item)
            label, points = labels[part.controller], self.study.shapes[index]
            pairs = zip(part.points.tolist(), part.run_numbers.tolist(), strict=True)
            held = [(self.taken.get((points[p], label)), points[p], run) for p, run in pairs]
            if not any(taken and run < taken.runs for taken, _, run in held):
                continue
            data = task.slab(item, finished.path).data
            for k, (taken, point, run) in enumerate(held):
                if taken is None or run >= taken.runs:
                    continue
                there = json.loads(str(taken.source.file.attributes["provenance"]))
                exact = not is_shared(engine) and not differences(together(there, origin), there)
                bound = 0.0 if exact and OTHERS not in there else BOUND_PER_RTOL * engine.rtol
                for entry in stored_quantities(self.study.piece(index)):
                    if entry.per is not ValuePer.RUN or entry.name not in data:
                        continue
                    stored, again = taken.numbers(entry.name, whole)[run], data[entry.name][k]
                    if _differs(stored, again, bound):
                        raise EqtError(
                            f"{taken.source.file.path}: run {run} of {label} at point {point} was "
                            f"computed again, and its {entry.name} is {again}, but {stored} there: "
                            "what computes it has changed",
                            Remedy("undo that change"),
                            Remedy("compute all runs again with {}", "force"),
                            OTHER_FOLDER,
                        )

    def put_into(self, index: int, file: Assembly) -> Works:
        """Write what is taken over into the file of a piece; return the largest work by law."""
        piece, points = self.study.piece(index), self.study.shapes[index]
        longest: Works = defaultdict(float)
        laws = list(self.study.base.loops)
        whole = dict[tuple[int, str], Array]()  # numbers of all runs of a source, read once
        for place, point in enumerate(points):
            for law, label in enumerate(laws):
                taken = self.taken.get((point, label))
                if taken is None:
                    continue
                at = (place, law) if piece.sweep else (law,)
                for entry in stored_quantities(piece):
                    if entry.per is ValuePer.RUN:
                        values = taken.numbers(entry.name, whole)
                        _put(file, entry.name, values, *at, slice(0, taken.runs))
                        if entry.name == "steps":
                            longest[label] = max(longest[label], float(values.max()))
                    elif entry.per is ValuePer.TRAJECTORY and piece.trajectories:
                        values = taken.signal(entry.name, piece)
                        _put(file, entry.name, values, *at, slice(0, len(values)))
                if law == 0:
                    _put_start(piece, place, taken, file)
        return longest


def _differs(stored: Any, again: Any, bound: float) -> bool:
    """Whether a number of a run differs from the stored one; with a bound, only if it is real."""
    if np.asarray(stored).dtype.kind != "f":
        return bool(bound == 0 and np.any(stored != again))
    apart = ~np.isclose(again, stored, rtol=bound, atol=bound, equal_nan=True)
    return bool(apart.any())


def _put(file: Assembly, name: str, values: Array, *at: int | slice) -> None:
    """Write an array at positions, of which integers stand for axes that it lacks."""
    lacking = sum(isinstance(k, int) for k in at)
    positions = tuple(slice(k, k + 1) if isinstance(k, int) else k for k in at)
    file.put(name, values[(None,) * lacking], positions)


def _put_start(piece: Study, place: int, taken: Taken, file: Assembly) -> None:
    """Write the initial states and the reference of a point, which its first law writes."""
    view, in_sweep = taken.source.at(taken.point), piece.sweep is not None
    for entry in stored_quantities(piece):
        if entry.per is ValuePer.INITIAL and (piece.initial_varies or not place):
            at = (place,) if in_sweep and piece.initial_varies else ()
            values = view.read(entry.name, run=slice(0, taken.runs))
            _put(file, entry.name, values, *at, slice(0, taken.runs))
        elif entry.per is ValuePer.DESIRED and piece.desired_varies:
            _put(file, entry.name, view[entry.name], *((place,) if in_sweep else ()))


def is_shared(engine: Engine) -> bool:
    """Whether the engine solves several runs together, so that each depends on the others."""
    return not isinstance(engine, Compiled) and getattr(engine, "runs_per_block", 1) > 1


def _cut(part: StudyPart, missing: Sequence[bool]) -> Iterator[StudyPart]:
    """Yield the stretches of a part whose runs are missing."""
    edges = np.flatnonzero(np.diff([0, *map(int, missing), 0]))
    for start, stop in edges.reshape(-1, 2).tolist():
        yield replace(part, start=part.start + start, stop=part.start + stop)


# Growth in a folder -------------------------------------------------------------------------------


@purposes.run_grow
def grow(session: Session, *, drops: bool = False) -> Execution:
    """Make the result in a folder that of another study, and compute only what it lacks.

    Parameters
    ----------
    drops
        Whether what the study leaves out is dropped; then a result of which nothing can be used is
        replaced as a whole.

    Raises
    ------
    EqtError
        If nothing of it can be used, or something of it would be lost.
    """
    folder, wanted = session.folder, session.study
    manifest = folder.manifest
    folder.tidy()
    if manifest.get(MOVING) == wanted.digest:
        return _moved(session, manifest, 0)
    with open_results(folder.results) as old:
        growth = Growth(wanted, [] if drops and [*remarks(old)] else [source_of(old)])
        if growth.taken or not drops:
            return _completed(session, growth, manifest, drops=drops)
    return session.run(True, None)


def _completed(
    session: Session, growth: Growth, manifest: dict[str, Any], *, drops: bool
) -> Execution:
    """Compute what the sources lack, write the new result, and let it take the place of the old."""
    folder, wanted = session.folder, session.study
    for source in growth.sources:
        require_same_code(growth.study, source)
        if not growth.taken:
            raise folder.of_another(wanted, Remedy("compute it all with {}", "force"), OTHER_FOLDER)
        if not drops and (lost := growth.left_out(source)):
            raise EqtError(
                f"{folder.path}: holds what the configuration leaves out: {', '.join(lost)}",
                Remedy("keep them in the configuration"),
                OTHER_FOLDER,
            )
    chosen = growth.chosen()
    place = folder.path.resolve() / RERUN
    if manifest.get(GROWING) != wanted.digest:
        folder.remove(RERUN)
        files.write_record(folder.path / MANIFEST, manifest | {GROWING: wanted.digest})
    place.mkdir(exist_ok=True)
    task = PartTask(wanted, PartFiles(place), tuple(chosen))
    session.note_earlier(manifest)
    before = {source.runs for source in growth.sources} - {wanted.base.config.ensemble.runs}
    session.origin[GROWN_FROM] = sorted({*session.origin.get(GROWN_FROM, ()), *before})
    held = session.plan.total - sum(growth.lacks(index, part) for index, part in chosen)
    if is_shared(wanted.base.engine) and not drops:
        reporter().remark(
            EqtWarning(
                f"{folder.path}: the engine solves runs in blocks; those of blocks that differ, or "
                "are cross-checked, are computed again",
                Remedy("set solver.block to 1 for runs that do not depend on each other"),
            )
        )
    with timed(session.seconds, "simulation"):
        session.compute(task)
    grown = ResultFolder(folder.path / GROWN)
    folder.remove(GROWN)
    grown.path.mkdir(exist_ok=True)
    growth.compare(task, session.origin)
    last = not is_shared(wanted.base.engine)
    with timed(session.seconds, "writing", without="cross-check"):
        pack(task, grown, session.origin, session.seconds, growth.put_into, taken_last=last)
    with open_results(grown.results) as result:
        failed = int(np.count_nonzero(result["status"]))
    record = session.manifest_of({}, afresh=True) | {"provenance": session.origin}
    record |= {MOVING: wanted.digest, "failed": failed}
    files.write_record(folder.path / MANIFEST, record)
    return _moved(session, record, held)


def _moved(session: Session, record: dict[str, Any], held: int) -> Execution:
    """Let a complete result take the place of the old one; a killed process is followed here."""
    folder, wanted = session.folder, session.study
    grown = ResultFolder(folder.path / GROWN)
    folder.write_config(wanted)
    for path, place in zip(grown.files_of(wanted), folder.files_of(wanted), strict=True):
        if wanted.is_ragged and path.exists():
            place.parent.mkdir(exist_ok=True)
            path.replace(place)
    if grown.results.exists():
        grown.results.replace(folder.results)
    if not wanted.is_ragged:
        folder.remove(files.SHAPES)
    ending = {"finished": now(), "seconds": session.seconds}
    record = {key: value for key, value in record.items() if key != MOVING}
    folder.remove(RERUN)  # before the manifest says that all is done, and nobody looks here again
    folder.remove(GROWN)
    folder.finish(record | ending)
    total, failed = session.plan.total, int(record["failed"])
    return Execution(folder, False, [], total, failed, 0, True, session.seconds, held)
