"""Computes the missing parts of a study in its result folder, and packs the result file."""

import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import OTHER_FOLDER, EqtError, EqtWarning, Remedy, ResultError
from eqt_cli.base.extensions import function_for, functions_for
from eqt_cli.base.files import kind_of, write_record
from eqt_cli.base.reporting import RUNS_DONE, count_of, reporter, step
from eqt_cli.base.store_reader import open_results
from eqt_cli.base.store_writer import Assembly
from eqt_cli.base.version import OTHERS, differences, together
from eqt_cli.config.parts import StudyPart
from eqt_cli.config.study import Study
from eqt_cli.engines.engine import Compiled, hurried
from eqt_cli.results.timing import write_timing
from eqt_cli.runs.arithmetic import by
from eqt_cli.runs.batches import chosen_entries, cross_check
from eqt_cli.runs.compute_part import UNSAVED_SECONDS, PartTask, is_brief, is_of
from eqt_cli.runs.executors import MOST_TRIES, Auto, Executor, Serial, Threads
from eqt_cli.runs.folder import (
    CONFIG,
    MOVING,
    ResultFolder,
    described,
    new_result_file,
    write_index,
)
from eqt_cli.runs.lock import LOCK, locked
from eqt_cli.runs.part_files import MANIFEST
from eqt_cli.runs.preflight import check_resources, rehearse
from eqt_cli.runs.provenance import now, provenance


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
    taken
        Number of runs that were taken over from the earlier result.
    """

    folder: ResultFolder
    was_complete: bool
    removed: list[str]
    runs: int
    failed: int
    resumed: int = 0
    packed: bool = True
    seconds: dict[str, float] = field(default_factory=dict)
    taken: int = 0


def execute(
    study: Study,
    out: Path,
    *,
    executor: Executor | None = None,
    force: bool = False,
    rerun_failed: bool = False,
    grow: bool = False,
    shard: Shard | None = None,
) -> Execution:
    """Compute the missing parts of a study in its folder, and pack the result file.

    Parameters
    ----------
    executor
        The executor that computes the parts. Default: this process.
    force
        Whether to start over and remove what eqt wrote there; with `grow`, what the study leaves
        out.
    rerun_failed
        Whether to compute failed runs again, each alone.
    grow
        Whether the folder may hold a result with fewer points, laws or runs, which are kept.
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
    if not force:
        _restore_manifest(study, folder)
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
            locks.enter_context(_lock_of(shard, out, len(study.plans)))
        chosen = locks.enter_context((executor or Serial()).opened(folder.path))
        session = Session(study, folder, chosen)
        grow |= not force and MOVING in folder.manifest
        if grow and not complete and folder.results.exists():
            return function_for(purposes.run_grow)(session, drops=force)
        if complete or (rerun_failed and folder.results.exists()):
            return function_for(purposes.run_rerun_failed)(session)
        if rerun_failed:  # parts whose runs all failed are computed as a whole
            for number, entry in session.files.listed().items():
                if entry.failed == study.plans.runs_of(number):
                    entry.path.unlink()
        done = session.run(force, shard)
        again = rerun_failed and done.failed and done.packed
        return function_for(purposes.run_rerun_failed)(session) if again else done


def _lock_of(shard: Shard, out: Path, parts: int) -> AbstractContextManager[None]:
    """Return the lock of a shard, and remark if it has nothing to compute."""
    if shard.index > parts:
        words = count_of(parts, "part")
        reporter().remark(
            EqtWarning(
                f"{out}: shard {shard.index} of {shard.count} computes nothing, since the "
                f"experiment has {words}",
                Remedy(f"use at most {words.replace('part', 'shard')}"),
            )
        )
    return locked(out, name=f"{LOCK}-{shard.index}-{shard.count}", warns=False)


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
        return Session(study, folder, Serial()).run(False, None)


def _restore_manifest(study: Study, folder: ResultFolder) -> None:
    """Write the manifest of an unfinished folder anew if it is damaged, for parts of this study."""
    if not folder.parts.folder.is_dir():
        return
    try:
        is_damaged = not folder.manifest
    except EqtError:
        is_damaged = True
    paths = [part.path for part in folder.parts.listed().values()]
    paths += [path for path, _ in folder.parts.stopped().values()]
    if not is_damaged or folder.results.exists():
        return
    ours, parts = sum(is_of(study, path) for path in paths), count_of(len(paths), "part")
    words = f"{folder.path}: {MANIFEST} is damaged or missing"
    references = [] if paths else folder.parts.folder.glob("reference*.npy")
    begun = ours or any(is_of(study, path) for path in references)
    if not begun and not (paths and kind_of(folder.path / MANIFEST)):
        return  # they may be anybody's
    if not begun:
        raise EqtError(f"{words}, and none of the {parts} is of this experiment", OTHER_FOLDER)
    used = f"{ours} of its {parts} say that they are of this experiment, and are used again"
    reporter().remark(EqtWarning(f"{words}; {used if paths else 'no run is finished there'}"))
    plan, config = study.plans.data, study.numeric_config
    record = {"name": study.name, "digest": study.digest, "plan": plan, "config": config}
    write_record(folder.path / MANIFEST, record | {"begun": now()})


def _complete(study: Study, folder: ResultFolder) -> Execution | None:
    """Return the execution of a folder that holds the study's complete result; else None.

    If a process was killed after it had packed the result, its left-over files are removed, unless
    another process holds the lock or the folder is not writable.
    """
    manifest = folder.manifest
    is_another = manifest.get("digest") != study.digest or MOVING in manifest
    if is_another or not folder.results.exists():
        return None
    if folder.parts.listed() or kind_of(folder.path / LOCK) or "finished" not in manifest:
        with open_results(folder.results) as results:
            manifest["failed"] = int(np.count_nonzero(results["status"]))
        with suppress(EqtError), locked(folder.path):
            folder.tidy()
            folder.finish({"finished": now(), **manifest})
    folder.keep_words(study)
    return Execution(folder, True, [], study.plans.total, int(manifest.get("failed", 0)))


@contextmanager
def timed(seconds: dict[str, float], name: str, without: str = "") -> Iterator[None]:
    """Record the wall time of the block under a name, s, less that of a part of it."""
    started = time.perf_counter()
    yield
    took = time.perf_counter() - started
    seconds[name] = round(max(took - seconds.get(without, 0.0), 0.0), 3)


@dataclass
class Session:
    """Computes what is missing of a study in a folder, which it holds until it ends."""

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
        manifest = self.manifest_of(
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
                self.compute(self.task, wanted)
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

    def note_earlier(self, manifest: Mapping[str, Any]) -> None:
        """Add this session to those of a result, and remark if their versions differ."""
        here = _origin(self.study)
        earlier = manifest.get("provenance", here)
        self._remark_versions([earlier], here)
        self.origin = together(earlier, here)

    def compute(self, task: PartTask, wanted: Iterable[int] | None = None) -> None:
        """Compute the missing parts of a task, among all or the wanted ones."""
        wanted = range(len(task)) if wanted is None else wanted
        missing = task.missing(wanted)
        runs, left = (sum(map(task.runs_of, items)) for items in (wanted, missing))
        begun = time.monotonic()
        with step(RUNS_DONE, runs) as counted:
            here = isinstance(self.executor, (Threads, Auto)) and left
            task.prepare(self.executor.workers if here else 0)
            reporter().skip(runs - left)
            for outcome in self.executor.outcomes(task, missing):
                if time.monotonic() > begun + UNSAVED_SECONDS:
                    task.save()
                if outcome.origin:
                    self._note_origin(outcome.origin)
                if outcome.value is None:
                    message = f"worker lost {MOST_TRIES} times (killed, or out of memory)"
                    reporter().advance(task.lose(outcome.item, message))
        if counted.uncounted:
            self.seconds[COMPILING] = round(counted.uncounted, 3)

    def _pack(self) -> None:
        """Pack all parts; damaged parts are computed again."""
        mended = set[Path]()
        while True:
            try:
                pack(self.task, self.folder, self.origin, self.seconds)
                return
            except BrokenPart as broken:
                if broken.path in mended:  # computing it again did not help
                    raise
                mended.add(broken.path)
                broken.path.unlink(missing_ok=True)
                self.compute(self.task)

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

    def manifest_of(self, earlier: dict[str, Any], afresh: bool) -> dict[str, Any]:
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
    engine = study.base.engine
    tools = engine.provenance() if isinstance(engine, Compiled) else {}
    return provenance(study.document.home.folder, tools | by(study))


PACKING, CHECKING = "parts packed", "runs cross-checked"
"""Titles of the steps."""

COMPILING = "compiling"
"""Name of the time that processes of this one spent on C compilers."""

COPIED_BYTES = 64 * 2**20

States = dict[str, list[Array]]
"""The states of the runs to cross-check, in blocks, by controller."""

Works = dict[str, float]
"""The largest work of a run, by controller."""


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
    task: PartTask,
    folder: ResultFolder,
    origin: dict[str, Any],
    seconds: dict[str, float],
    taken: Callable[[int, Assembly], Works] | None = None,
    *,
    taken_last: bool = False,
) -> None:
    """Write the result file from all parts, which must exist.

    Every number is copied once. Parts have files of their own, because processes and computers that
    write to one file would have to wait for each other, and may damage it when they are killed.
    Those of a short session in one process stay in memory, and are written here only.

    Parameters
    ----------
    origin
        Where its numbers come from.
    seconds
        Wall times of what was done; receives that of the cross-check.
    taken
        Writes what is taken over from other results into the file of a piece.
    taken_last
        Whether what is taken over stays where it was computed again.

    Raises
    ------
    BrokenPart
        If a part cannot be read; then no file is written.
    ResultError
        If the file cannot be written.
    """
    study, decimate = task.study, task.study.base.config.store.decimate
    pieces = list(zip(study.pieces, folder.files_of(study), strict=True))
    checked: list[tuple[States, Works]] = []
    checks, parts, times = dict[str, Any](), finished_parts(task), dict[str, list[Array]]()
    with ExitStack() as packing:
        packing.enter_context(step(PACKING, len(task)))
        for index, (piece, path) in enumerate(pieces):
            path.parent.mkdir(exist_ok=True)
            with new_result_file(piece, path) as file:
                for name, values in (task.shared(index) or {}).items():
                    file.put(name, values[::decimate])
                earlier = taken(index, file) if taken and not taken_last else {}
                states, works = put_parts(task, piece, parts[index], file, times)
                if taken and taken_last:
                    earlier = taken(index, file)
                for label, work in earlier.items():
                    works[label] = max(works.get(label, 0.0), work)
                checked.append((states, works))
                if not study.is_ragged:
                    packing.close()  # the cross-check is another step
                    checks = _cross_checked(study, checked, seconds)
                file.describe({**described(piece, origin), **checks})
    if study.is_ragged:
        checks = _cross_checked(study, checked, seconds)
        write_index(study, folder.results, {**described(study, origin), **checks})
    if times:
        write_timing(folder.path, {label: np.concatenate(rows) for label, rows in times.items()})


def _cross_checked(
    study: Study, checked: Sequence[tuple[States, Works]], seconds: dict[str, float]
) -> dict[str, Any]:
    """Return the attributes of the cross-check of all pieces, and those that extensions add."""
    of_extensions: dict[str, Any] = {}
    redone = sum(len(chosen_entries(piece)) * len(piece.base.loops) for piece in study.pieces)
    with timed(seconds, "cross-check"), step(CHECKING, redone):
        check = cross_check(study, *map(list, zip(*checked, strict=True)))
        with hurried(is_brief(study)):  # what the runs have compiled
            for tell in functions_for(purposes.errors_of_a_result):
                of_extensions |= tell(study)
    fields = {} if check is None else asdict(check)
    of_check = {f"cross_check_{name}": value for name, value in fields.items() if value != ""}
    return of_check | of_extensions


def finished_parts(task: PartTask) -> dict[int, list[tuple[int, StudyPart, Path]]]:
    """Return the number, the extent and the file of the finished parts of each piece."""
    listed: dict[int, list[tuple[int, StudyPart, Path]]] = defaultdict(list)
    for item, finished in sorted(task.finished().items()):
        index, part = task.part(item)
        listed[index].append((item, part, finished.path))
    return listed


def put_parts(
    task: PartTask,
    study: Study,
    parts: Iterable[tuple[int, StudyPart, Path]],
    file: Assembly,
    times: dict[str, list[Array]],
) -> tuple[States, Works]:
    """Write the content of the finished parts of a piece into its result file.

    Parameters
    ----------
    times
        Receives the CPU times of calls, by the label of the law, s.

    Returns
    -------
    states, longest
        Inputs of the cross-check.
    """
    states: States = defaultdict(list)
    longest: Works = defaultdict(float)
    for item, part, path in parts:
        label = list(study.base.loops)[part.controller]
        try:
            slab = task.slab(item, path)
            slab.put_into(file)
        except ResultError as error:
            raise BrokenPart(path, str(error)) from error
        if len(slab.seconds):
            times.setdefault(label, []).append(slab.seconds)
        if len(slab.check_states):
            states[label].append(slab.check_states)
        if "steps" in slab.data:
            longest[label] = max(longest[label], float(np.max(slab.data["steps"])))
        reporter().advance(1)
    return states, longest
