"""A study from configuration to result folder: what is missing is computed, then all is packed."""

import json
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.core.errors import EqtError, EqtWarning, FullDiskError, Remedy
from eqt_cli.core.replacement import NO_SPACE
from eqt_cli.core.reporting import RUNS_DONE, reporter, step
from eqt_cli.execution.cost import check_resources
from eqt_cli.execution.executors import MOST_TRIES, Executor
from eqt_cli.execution.executors.serial import Serial
from eqt_cli.execution.folder import RERUN, ResultFolder
from eqt_cli.execution.lock import LOCK, locked
from eqt_cli.execution.pack import BrokenPart, pack, replace_runs
from eqt_cli.execution.part_task import PartTask
from eqt_cli.execution.provenance import OTHERS, differences, now, provenance, together
from eqt_cli.execution.rerun_failed import rerun_of
from eqt_cli.execution.result_layout import described
from eqt_cli.execution.wall_time import timed
from eqt_cli.experiment.study import Study
from eqt_cli.store.reader import open_results


@dataclass(frozen=True)
class Shard:
    """The share of one job of an array: parts `index`, `index` + `count`, …; counted from 1."""

    index: int
    count: int


@dataclass(frozen=True)
class Execution:
    """What `execute` did.

    Attributes
    ----------
    folder
        Where the result is.
    was_complete
        The folder held this study's finished result already; nothing was run.
    removed
        What `force` removed.
    runs, failed
        Runs over all controllers and points, and those with a status other than 0.
    resumed
        Runs that earlier sessions had finished.
    packed
        Whether the result file is there; a shard alone does not write it.
    seconds
        Wall time of simulation, writing and cross-check, s.
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
    """Compute what of a study is not in its folder yet, and pack the result file.

    Parameters
    ----------
    executor
        Who computes the parts; default: this process.
    force
        Start over, removing what eqt wrote there.
    rerun_failed
        Compute those runs again that failed, each by itself.
    shard
        Compute only this share of the parts, beside other processes, and do not pack.

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
    there = complete.runs - complete.failed if complete else 0 if force else _kept(study, folder)
    check_resources(study, out, 1 - there / study.plans.total)
    with ExitStack() as locks:
        locks.enter_context(_telling_what_is_kept(study, folder))
        locks.enter_context(locked(out, shared=shard is not None))
        if shard:
            locks.enter_context(
                locked(out, name=f"{LOCK}-{shard.index}-{shard.count}", tells=False)
            )
            if shard.index > len(study.plans):
                reporter().remark(_without_work(shard, out, len(study.plans)))
        session = _Session(study, folder, executor or Serial())
        if complete:
            return session.rerun(complete.failed)
        if rerun_failed:
            session.forget_lost()
        done = session.run(force, shard)
        again = rerun_failed and done.failed and done.packed
        return session.rerun(done.failed) if again else done


def pack_folder(study: Study, out: Path) -> Execution:
    """Pack the parts that shards have computed.

    Raises
    ------
    EqtError
        If some are missing, or the folder is not this study's.
    """
    folder = ResultFolder(out)
    folder.check()
    if complete := _complete(study, folder):
        return complete
    with _telling_what_is_kept(study, folder), locked(out):
        missing = len(PartTask(study, folder.parts).missing())
        if missing:
            raise EqtError(
                f"{out}: {missing} of {len(study.plans)} parts are missing; run every shard to its "
                "end, or eqt run (eqt sweep) on the folder, which computes what is missing"
            )
        return _Session(study, folder, Serial()).run(False, None)


def _complete(study: Study, folder: ResultFolder) -> Execution | None:
    """What there is to say of a folder that holds the study's finished result; None of another.

    What a process left that was killed after it had packed the result is tidied away, unless
    another one is about it, or the folder is not to be written to.
    """
    if not folder.is_complete(study):
        return None
    manifest = folder.manifest or {}
    if not folder.is_tidy:
        with open_results(folder.results) as results:
            manifest |= {"failed": int(np.count_nonzero(results["status"]))}
        with suppress(EqtError), locked(folder.path):
            folder.tidy()
            folder.finish({"finished": now(), **manifest})
    return Execution(folder, True, [], study.plans.total, int(manifest.get("failed", 0)))


def _kept(study: Study, folder: ResultFolder) -> int:
    """The runs of a study that its folder holds as finished parts."""
    if (folder.manifest or {}).get("digest") != study.digest:
        return 0
    return sum(study.plans.runs_of(n) for n in folder.parts.listed() if n < len(study.plans))


@contextmanager
def _telling_what_is_kept(study: Study, folder: ResultFolder) -> Iterator[None]:
    """Say of a full disk what is kept, and how to go on without computing it again."""
    try:
        yield
    except EqtError as error:
        cause = error.__cause__
        full = isinstance(cause, OSError) and cause.errno in NO_SPACE
        if not full and not isinstance(error, FullDiskError):
            raise
        kept, total = _kept(study, folder), study.plans.total
        if not kept:
            raise
        raise FullDiskError(
            f"{error.args[0]}; {kept} of {total} runs are kept in {folder.path}",
            Remedy("free some space and run the same command again")
            if kept < total
            else Remedy(f"free some space and run `eqt pack {folder.path}`"),
            Remedy("move the folder to another disk and name it with {}", "out")
            if kept < total
            else Remedy("move the folder to another disk and run `eqt pack` there"),
        ) from error


def _without_work(shard: Shard, out: Path, parts: int) -> EqtWarning:
    return EqtWarning(
        f"{out}: shard {shard.index} of {shard.count} computes nothing, since the experiment has "
        f"{parts} part{'' if parts == 1 else 's'}",
        Remedy(f"use at most {parts} shard{'' if parts == 1 else 's'}"),
    )


@dataclass
class _Session:
    study: Study
    folder: ResultFolder
    executor: Executor
    seconds: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.plan, self.files = self.study.plans, self.folder.parts
        self.task = PartTask(self.study, self.files, keeps=True)

    def run(self, force: bool, shard: Shard | None) -> Execution:
        earlier = self.folder.manifest or {}
        manifest = self._manifest(earlier, afresh=force or not (shard or self.files.listed()))
        removed = self.folder.claim(self.study, manifest, force)
        if shard is None:
            self.folder.tidy()
        first, step = (shard.index - 1, shard.count) if shard else (0, 1)
        wanted = range(first, len(self.plan), step)
        runs = sum(map(self.task.runs_of, wanted))
        resumed = runs - sum(map(self.task.runs_of, self.task.missing(wanted)))
        with timed(self.seconds, "simulation"):
            self._compute(self.task, wanted)
        if shard is None:
            with timed(self.seconds, "writing"):
                self._pack(manifest["provenance"])
            checking = self.seconds.setdefault("cross-check", 0.0)
            self.seconds["writing"] = round(self.seconds["writing"] - checking, 3)
        listed = self.files.listed()
        failed = sum(listed[number].failed for number in wanted)
        if shard is None:
            ending = {"finished": now(), "seconds": self.seconds, "failed": failed}
            self.folder.finish(manifest | ending)
        return Execution(
            self.folder, False, removed, runs, failed, resumed, shard is None, self.seconds
        )

    def forget_lost(self) -> None:
        """Remove the parts of which every run failed, so that they are computed as a whole."""
        for number, entry in self.files.listed().items():
            if entry.failed == self.plan.runs_of(number):
                entry.path.unlink()

    def rerun(self, failed: int) -> Execution:
        """Compute the failed runs of a finished result again, and replace their rows."""
        self.folder.tidy()
        place = self.folder.path.resolve() / RERUN
        place.mkdir(exist_ok=True)
        again = rerun_of(self.study, self.folder.results, place)
        manifest = self.folder.manifest or {}
        here = provenance(self.study.source.folder, self.study.base.engine)
        earlier = manifest.get("provenance", here)
        self._tell_versions([earlier], here)
        origin = together(earlier, here)
        with timed(self.seconds, "simulation"):
            self._compute(again)
        with timed(self.seconds, "writing"):
            described = json.dumps(origin, ensure_ascii=False)
            still = replace_runs(again, self.folder.results, {"provenance": described})
        self.folder.finish(manifest | {"failed": still, "provenance": origin})
        self.folder.remove(RERUN)
        done, total = self.plan.total - failed, self.plan.total
        return Execution(self.folder, False, [], total, still, done, True, self.seconds)

    def _compute(self, task: PartTask, wanted: Iterable[int] | None = None) -> None:
        """Compute what of a task is missing, or of some of its parts."""
        task.prepare()
        wanted = range(len(task)) if wanted is None else wanted
        missing = task.missing(wanted)
        runs, left = (sum(map(task.runs_of, items)) for items in (wanted, missing))
        with step(RUNS_DONE, runs):
            reporter().skip(runs - left)
            for outcome in self.executor.outcomes(task, missing):
                if outcome.failed is None:
                    message = f"worker lost {MOST_TRIES} times (killed, or out of memory)"
                    reporter().advance(task.lose(outcome.item, message))

    def _pack(self, origin: dict[str, Any]) -> None:
        """Pack all parts; those that turn out to be damaged are computed again."""
        attributes, mended = described(self.study, origin), set[Path]()
        while True:
            try:
                pack(self.task, self.folder.results, attributes, self.seconds)
                return
            except BrokenPart as broken:
                if broken.path in mended:  # what computing it again does not cure
                    raise
                mended.add(broken.path)
                broken.path.unlink(missing_ok=True)
                self._compute(self.task)

    def _tell_versions(self, earlier: Sequence[dict[str, Any]], here: dict[str, Any]) -> None:
        """Say that not all runs are of the same versions, if they are not."""
        differing = (differences(session, here) for session in earlier)
        if listed := "; or ".join(filter(None, differing)):
            reporter().remark(
                EqtWarning(
                    f"{self.folder.path}: some of its runs were computed with {listed}; they agree "
                    "with the new ones within tolerances, not bit for bit",
                    Remedy("{} starts over", "force"),
                )
            )

    def _manifest(self, earlier: dict[str, Any], afresh: bool) -> dict[str, Any]:
        study = self.study
        same = earlier.get("digest") == study.digest
        origin = provenance(study.source.folder, study.base.engine)
        if same and not afresh and "provenance" in earlier:
            origin = together(origin, earlier["provenance"])
            self._tell_versions(origin.get(OTHERS, []), origin)
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
