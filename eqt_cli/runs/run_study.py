"""Computes the missing parts of a study in its result folder, and packs the result file.

On request, only the failed runs of a finished result are computed again.
"""

import json
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import OTHER_FOLDER, EqtError, EqtWarning, Remedy, ResultError
from eqt_cli.base.files import LAW, kind_of
from eqt_cli.base.reporting import RUNS_DONE, count_of, reporter, step
from eqt_cli.base.store_reader import ResultFile, open_results
from eqt_cli.base.store_writer import Assembly, Attribute
from eqt_cli.base.stored import Status
from eqt_cli.base.version import OTHERS, differences, together
from eqt_cli.config.parts import StudyPart
from eqt_cli.config.study import Study
from eqt_cli.results.quantity import Measure, ValuePer
from eqt_cli.runs.arithmetic import by
from eqt_cli.runs.batches import chosen_entries, cross_check
from eqt_cli.runs.compute_part import UNSAVED_SECONDS, PartTask, checked_states, read_part
from eqt_cli.runs.executors import MOST_TRIES, Executor, Serial
from eqt_cli.runs.folder import (
    CONFIG,
    RERUN,
    Destination,
    Layout,
    ResultFolder,
    described,
    in_root,
    new_result_file,
)
from eqt_cli.runs.lock import LOCK, locked
from eqt_cli.runs.part_files import PartFiles
from eqt_cli.runs.preflight import check_resources, rehearse
from eqt_cli.runs.provenance import now, provenance


def rerun_of(study: Study, results: Path, folder: Path) -> PartTask:
    """Return the task that computes the failed runs of a result again, with parts in `folder`.

    Every failed run becomes its own part, so that it is integrated alone. Parts that were lost with
    their workers are computed as in the first run. A number that only this version stores is NaN
    for the other runs.

    Raises
    ------
    EqtError
        If the result holds variables that this version does not know, or lacks integer variables,
        which have no value for a missing number.
    """
    root = in_root([Layout(piece) for piece in study.pieces])
    integers = {entry.name for entry in root if entry.dtype is not None and entry.dtype.kind != "f"}
    with open_results(results) as old:
        if set(old.names) - {LAW, *(entry.name for entry in root)} or integers - set(old.names):
            raise EqtError(
                f"{results}: was written by a version of eqt that stores other variables",
                Remedy("compute its failed runs with that version"),
                OTHER_FOLDER,
            )
        status = old["status"]
    status = status.reshape(-1, *status.shape[-2:]).swapaxes(0, 1)
    by_piece = [status[:, points].reshape(len(status), -1) for points in study.shapes]
    chosen: list[tuple[int, StudyPart]] = []
    for item in range(len(study.plans)):
        index, part = PartTask(study, PartFiles(folder)).part(item)
        statuses = by_piece[index][part.controller, part.start : part.stop]
        if (statuses == Status.WORKER_LOST).all():
            chosen.append((index, part))
            continue
        failed = (part.start + np.flatnonzero(statuses)).tolist()
        chosen += [(index, replace(part, start=entry, stop=entry + 1)) for entry in failed]
    return PartTask(study, PartFiles(folder), tuple(chosen))


@dataclass(frozen=True)
class Shard:
    """The share of one job of an array: parts `index`, `index` + `count`, …, counted from 1."""

    index: int
    count: int


@dataclass(frozen=True)
class Execution:
    """The outcome of `execute`.

    Attributes
    ----------
    folder
        The result folder.
    was_complete
        Whether the folder already held the complete result, so that nothing was run.
    removed
        Entries that `force` removed.
    runs, failed
        Numbers of runs over all controllers and points, and of those with a status other than 0.
    resumed
        Number of runs that earlier sessions had finished.
    packed
        Whether the result file is written; a shard alone does not write it.
    seconds
        Wall time of compiling, simulation, writing and cross-check, s.
    """

    folder: ResultFolder
    was_complete: bool
    removed: list[str]
    runs: int
    failed: int
    resumed: int = 0
    packed: bool = True
    seconds: dict[str, float] = field(default_factory=dict)


def execute(
    study: Study,
    out: Path,
    *,
    executor: Executor | None = None,
    force: bool = False,
    rerun_failed: bool = False,
    shard: Shard | None = None,
) -> Execution:
    """Compute the missing parts of a study in its folder, and pack the result file.

    Parameters
    ----------
    executor
        The executor that computes the parts. Default: this process.
    force
        Whether to start over and remove what eqt wrote there.
    rerun_failed
        Whether to compute failed runs again, each alone.
    shard
        Share of the parts to compute while other processes compute the rest; then nothing is
        packed.

    Raises
    ------
    EqtError
        If the folder holds something else, is in use, or cannot be written.
    """
    folder = ResultFolder(out)
    folder.check()
    complete = None if force else _complete(study, folder)
    if complete and not (rerun_failed and complete.failed):
        return complete
    finished = 0 if force else folder.finished_runs(study)
    if complete:
        finished = complete.runs - complete.failed
    check_resources(study, out, 1 - finished / study.plans.total)
    rehearse(study)
    with ExitStack() as locks:
        locks.enter_context(folder.reporting_finished_runs(study))
        locks.enter_context(locked(out, shared=shard is not None))
        if shard:
            locks.enter_context(
                locked(out, name=f"{LOCK}-{shard.index}-{shard.count}", warns=False)
            )
            parts = count_of(len(study.plans), "part")
            if shard.index > len(study.plans):
                reporter().remark(
                    EqtWarning(
                        f"{out}: shard {shard.index} of {shard.count} computes nothing, since the "
                        f"experiment has {parts}",
                        Remedy(f"use at most {parts.replace('part', 'shard')}"),
                    )
                )
        chosen = locks.enter_context((executor or Serial()).opened(folder.path))
        session = _Session(study, folder, chosen)
        if complete:
            return session.rerun(complete.failed)
        if rerun_failed:  # parts whose runs all failed are computed as a whole
            for number, entry in session.files.listed().items():
                if entry.failed == study.plans.runs_of(number):
                    entry.path.unlink()
        done = session.run(force, shard)
        return session.rerun(done.failed) if rerun_failed and done.failed and done.packed else done


def pack_folder(study: Study, out: Path) -> Execution:
    """Pack the parts that shards computed.

    Raises
    ------
    EqtError
        If parts are missing, or the folder belongs to another study.
    """
    folder = ResultFolder(out)
    folder.check()
    if complete := _complete(study, folder):
        return complete
    with folder.reporting_finished_runs(study), locked(out):
        if folder.manifest.get("digest") != study.digest:
            raise folder.of_another(study, Remedy(f"undo the changes of {out / CONFIG}"))
        missing = len(PartTask(study, folder.parts).missing())
        if missing:
            raise EqtError(
                f"{out}: {missing} of {len(study.plans)} parts are missing; complete every shard, "
                "or use eqt run (for a sweep eqt sweep), which computes the missing parts"
            )
        return _Session(study, folder, Serial()).run(False, None)


def _complete(study: Study, folder: ResultFolder) -> Execution | None:
    """Return the execution of a folder that holds the study's complete result; else None.

    If a process was killed after it had packed the result, its left-over files are removed, unless
    another process holds the lock or the folder is not writable.
    """
    manifest = folder.manifest
    if manifest.get("digest") != study.digest or not folder.results.exists():
        return None
    if folder.parts.listed() or kind_of(folder.path / LOCK) or "finished" not in manifest:
        with open_results(folder.results) as results:
            manifest |= {"failed": int(np.count_nonzero(results["status"]))}
        with suppress(EqtError), locked(folder.path):
            folder.tidy()
            folder.finish({"finished": now(), **manifest})
    return Execution(folder, True, [], study.plans.total, int(manifest.get("failed", 0)))


@contextmanager
def timed(seconds: dict[str, float], name: str, without: str = "") -> Iterator[None]:
    """Record the wall time of the block under a name, s, less that of a part of it."""
    started = time.perf_counter()
    yield
    took = time.perf_counter() - started
    seconds[name] = round(max(took - seconds.get(without, 0.0), 0.0), 3)


@dataclass
class _Session:
    study: Study
    folder: ResultFolder
    executor: Executor
    seconds: dict[str, float] = field(default_factory=dict)
    origin: dict[str, Any] = field(default_factory=dict, init=False)
    """Where numbers come from that are computed now, here or by workers."""

    def __post_init__(self) -> None:
        self.plan, self.files = self.study.plans, self.folder.parts
        self.task = PartTask(self.study, self.files, keeps=True)

    def run(self, force: bool, shard: Shard | None) -> Execution:
        earlier = self.folder.manifest
        manifest = self._manifest(
            earlier, afresh=force or not (shard or self.folder.finished_runs(self.study))
        )
        removed = self.folder.claim(self.study, manifest, force)
        if shard is None:
            self.folder.tidy()
        first, step = (shard.index - 1, shard.count) if shard else (0, 1)
        wanted = range(first, len(self.plan), step)
        runs = sum(map(self.task.runs_of, wanted))
        resumed = runs - sum(map(self.task.runs_of, self.task.missing(wanted)))
        resumed += sum(ended for n, (_, ended) in self.files.stopped().items() if n in wanted)
        with ExitStack() as unless_packed:
            unless_packed.callback(self.task.save)
            with timed(self.seconds, "simulation", without=COMPILING):
                self._compute(self.task, wanted)
            finished = self.task.finished()
            if lost := [number for number in wanted if number not in finished]:
                raise EqtError(
                    f"{self.files.folder}: {len(lost)} of {len(wanted)} parts were removed while "
                    "others were computed; run the same command again"
                )
            if shard is None:
                with timed(self.seconds, "writing", without="cross-check"):
                    self._pack()
                unless_packed.pop_all()
        failed = sum(finished[number].failed for number in wanted)
        if shard is None:
            ending = {"finished": now(), "seconds": self.seconds, "failed": failed}
            self.folder.finish(manifest | ending | {"provenance": self.origin})
        return Execution(
            self.folder, False, removed, runs, failed, resumed, shard is None, self.seconds
        )

    def rerun(self, failed: int) -> Execution:
        """Compute the failed runs of a complete result again, and replace their rows."""
        self.folder.tidy()
        place = self.folder.path.resolve() / RERUN
        place.mkdir(exist_ok=True)
        again = rerun_of(self.study, self.folder.results, place)
        manifest = self.folder.manifest
        here = _origin(self.study)
        earlier = manifest.get("provenance", here)
        self._remark_versions([earlier], here)
        self.origin = together(earlier, here)
        with timed(self.seconds, "simulation", without=COMPILING):
            self._compute(again)
        with timed(self.seconds, "writing"):
            described = json.dumps(self.origin, ensure_ascii=False)
            still = replace_runs(again, self.folder.results, {"provenance": described})
        self.folder.finish(manifest | {"failed": still, "provenance": self.origin})
        self.folder.remove(RERUN)
        done, total = self.plan.total - failed, self.plan.total
        return Execution(self.folder, False, [], total, still, done, True, self.seconds)

    def _compute(self, task: PartTask, wanted: Iterable[int] | None = None) -> None:
        """Compute the missing parts of a task, among all or the wanted ones."""
        wanted = range(len(task)) if wanted is None else wanted
        missing = task.missing(wanted)
        runs, left = (sum(map(task.runs_of, items)) for items in (wanted, missing))
        begun = time.monotonic()
        with step(RUNS_DONE, runs) as counted:
            task.prepare()
            reporter().skip(runs - left)
            for outcome in self.executor.outcomes(task, missing):
                if time.monotonic() > begun + UNSAVED_SECONDS:
                    task.save()
                if outcome.origin:
                    self._note_origin(outcome.origin)
                if outcome.failed is None:
                    message = f"worker lost {MOST_TRIES} times (killed, or out of memory)"
                    reporter().advance(task.lose(outcome.item, message))
        if counted.uncounted:
            self.seconds[COMPILING] = round(counted.uncounted, 3)

    def _pack(self) -> None:
        """Pack all parts; damaged parts are computed again."""
        attributes, mended = described(self.study, self.origin), set[Path]()
        while True:
            try:
                pack(self.task, self.folder.results, attributes, self.seconds)
                return
            except BrokenPart as broken:
                if broken.path in mended:  # computing it again did not help
                    raise
                mended.add(broken.path)
                broken.path.unlink(missing_ok=True)
                self._compute(self.task)

    def _remark_versions(self, earlier: Sequence[dict[str, Any]], here: dict[str, Any]) -> None:
        """Remark if some runs were computed with other versions."""
        differing = (differences(session, here) for session in earlier)
        if listed := "; or ".join(filter(None, differing)):
            reporter().remark(
                EqtWarning(
                    f"{self.folder.path}: some of its runs were computed with {listed}; they agree "
                    "with the new ones within tolerances, not bit for bit",
                    Remedy("for runs of one version, choose another folder with {}", "out"),
                )
            )

    def _note_origin(self, origin: Mapping[str, Any]) -> None:
        """Add where a worker's numbers come from, and remark if it computes otherwise."""
        both = together(self.origin, origin)
        if both != self.origin:
            self.origin, words = both, differences(origin, self.origin)
            agree = "its runs agree with the others within tolerances, not bit for bit"
            reporter().remark(EqtWarning(f"a worker has {words}: {agree}"))

    def _manifest(self, earlier: dict[str, Any], afresh: bool) -> dict[str, Any]:
        study = self.study
        same = earlier.get("digest") == study.digest
        origin = _origin(study)
        if same and not afresh and "provenance" in earlier:
            origin = together(origin, earlier["provenance"])
            self._remark_versions(origin.get(OTHERS, []), origin)
        self.origin = origin
        return {
            "name": study.name,
            "digest": study.digest,
            "points": len(study) if study.sweep else None,
            "runs": study.base.config.ensemble.runs,
            "controllers": list(study.base.loops),
            "plan": self.plan.data,
            "config": study.numeric_config,
            "provenance": origin,
            "begun": earlier["begun"] if same and "begun" in earlier else now(),
        }


# Packing ------------------------------------------------------------------------------------------


def _origin(study: Study) -> dict[str, Any]:
    """Return where numbers come from that are computed now."""
    return provenance(study.document.home.folder, study.base.engine.provenance() | by(study))


PACKING, CHECKING = "parts packed", "runs cross-checked"
"""Titles of the steps."""

COMPILING = "compiling"
"""Name of the time that processes of this one spent on C compilers."""

COPIED_BYTES = 64 * 2**20


class BrokenPart(ResultError):
    """A part that cannot be read and must be computed again.

    Attributes
    ----------
    path
        File of the part.
    """

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(reason)
        self.path = path


def pack(
    task: PartTask, results: Path, attributes: Mapping[str, Attribute], seconds: dict[str, float]
) -> None:
    """Write the result file from all parts, which must exist.

    Parameters
    ----------
    seconds
        Wall times of what was done; receives that of the cross-check.

    Raises
    ------
    BrokenPart
        If a part cannot be read; then no file is written.
    ResultError
        If the file cannot be written.
    """
    study = task.study
    with new_result_file(study, results) as file:
        for index, place in enumerate(file.places):
            shared, decimate = task.shared(index), study.base.config.store.decimate
            for name, values in (shared or {}).items():
                place.put(name, values[::decimate])
        with step(PACKING, len(task)):
            states, longest = _put_parts(task, file.places)
        redone = sum(len(chosen_entries(piece)) * len(piece.base.loops) for piece in study.pieces)
        with timed(seconds, "cross-check"), step(CHECKING, redone):
            check = cross_check(study, states, longest)
        fields = {} if check is None else asdict(check)
        checked = {f"cross_check_{name}": value for name, value in fields.items()}
        file.root.describe({**attributes, **checked})


def replace_runs(task: PartTask, results: Path, attributes: Mapping[str, Attribute]) -> int:
    """Rewrite a result file with the parts of a task in their places; return its failed runs.

    Parameters
    ----------
    attributes
        Attributes that change.
    """
    layouts = [Layout(piece) for piece in task.study.pieces]
    with open_results(results) as old, new_result_file(task.study, results) as file:
        _copy(file.root, old, in_root(layouts))
        for point, group in enumerate(file.groups):
            _copy(group, old.at(point), layouts[0].quantities)
        with step(PACKING, len(task)):
            _put_parts(task, file.places)
        file.root.describe({**old.attributes, **attributes})
    with open_results(results) as new:
        return int(np.count_nonzero(new["status"]))


def _copy(file: Assembly, old: ResultFile, stored: Iterable[Measure]) -> None:
    """Copy all variables in blocks of rows; numbers that `old` does not hold become NaN."""
    for name in old.names:
        for rows in _rows(file.shape(name)):
            file.put(name, old.read(name, **{old.dims(name)[0]: rows}), (rows,))
    for entry in stored:
        if entry.dtype is not None and entry.name not in old.names:
            _, *others = shape = file.shape(entry.name)
            for rows in _rows(shape):
                file.put(entry.name, np.full((rows.stop - rows.start, *others), np.nan), (rows,))


def _rows(shape: tuple[int, ...]) -> Iterator[slice]:
    """Yield all rows of an array in blocks of at most `COPIED_BYTES`."""
    step = max(1, COPIED_BYTES // (8 * int(np.prod(shape[1:]))))
    for start in range(0, shape[0], step):
        yield slice(start, min(start + step, shape[0]))


def _put_parts(
    task: PartTask, places: Sequence[Destination]
) -> tuple[dict[int, dict[str, list[Array]]], dict[int, dict[str, float]]]:
    """Write the content of all finished parts into the result file, by piece.

    Returns
    -------
    states, longest
        Inputs of the cross-check by piece and controller: the states of the chosen runs, and the
        largest work of a run.
    """
    states: dict[int, dict[str, list[Array]]] = defaultdict(lambda: defaultdict(list))
    longest: dict[int, dict[str, float]] = defaultdict(lambda: defaultdict(float))
    for item, listed in sorted(task.finished().items()):
        index, part = task.part(item)
        study, place = task.study.piece(index), places[index]
        layout = Layout(study)
        label, loop = list(study.base.loops.items())[part.controller]
        try:
            with task.opened(item, listed.path) as results:
                digest = task.study.digest
                if results.attributes.get("digest", digest) != digest:
                    raise ResultError(f"{listed.path}: is a part of another experiment")
                variables = read_part(results, listed.path, layout.quantities)
                for entry in layout.quantities:
                    if entry.name in variables:
                        _put(place, layout, entry, variables[entry.name], part)
                chosen = chosen_entries(study)
                if ((chosen >= part.start) & (chosen < part.stop)).any():
                    states[index][label].append(checked_states(results, loop.layout))
                if "steps" in variables:
                    work = float(np.max(variables["steps"]))
                    longest[index][label] = max(longest[index][label], work)
        except ResultError as error:
            raise BrokenPart(listed.path, str(error)) from error
        reporter().advance(1)
    return states, longest


def _put(place: Destination, layout: Layout, entry: Measure, data: Array, part: StudyPart) -> None:
    """Write the values of a quantity in a part into the result file."""
    study: Study = layout.study
    if entry.per is ValuePer.DESIRED:  # a point cut by parts belongs to its first one
        points = np.unique(part.points)
        begins_here = points * part.runs >= part.start
        if begins_here.any():
            first, last = int(points[begins_here][0]), int(points[begins_here][-1])
            place.put(entry.name, data[begins_here], (slice(first, last + 1),))
    elif entry.per is ValuePer.INITIAL and not study.initial_varies:
        place.put(entry.name, data, (slice(part.start, part.start + len(data)),))
    else:
        controller = () if entry.per is ValuePer.INITIAL else (part.controller,)
        runs = study.trajectories if entry.per is ValuePer.TRAJECTORY else part.runs
        for slab in part.slabs(runs):
            block = data[slab.rows].reshape(*slab.shape, *data.shape[1:])
            where = (*controller, slab.runs)
            if study.sweep:
                place.put(entry.name, block, (slab.points, *where))
            else:
                place.put(entry.name, block[0], where)
