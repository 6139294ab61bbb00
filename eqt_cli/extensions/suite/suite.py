"""What the commands of the suite do: judge laws, write the archive, join files of judged laws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from eqt_cli.base.errors import EqtError, EqtWarning
from eqt_cli.base.reporting import reporter
from eqt_cli.cli import output
from eqt_cli.components.laws import controllers
from eqt_cli.extensions.suite import archive as archives
from eqt_cli.extensions.suite.archive import Archive, JudgedLaw
from eqt_cli.extensions.suite.judging import Judged, fits, judged, tuned
from eqt_cli.extensions.suite.laws import Law, shipped_laws, stated_gains
from eqt_cli.extensions.suite.tasks import REFERENCE, Task, chosen_tasks

FILE = "law.zip"
"""Name of the file with the numbers of a law, in the folder of its result."""

FOLDER = Path("results") / "suite"
"""Folder of the results of the suite."""


def judge_law(
    law: Law, tasks: Mapping[str, Task], out: Path, workers: int, *, force: bool = False
) -> Archive:
    """Tune and judge a law on tasks; write and return its numbers.

    Tasks that do not fit the law are left out, with a remark.

    Raises
    ------
    EqtError
        If it fits none of the tasks.
    """
    reasons = {name: fits(law, task) for name, task in tasks.items()}
    fitting = {name: task for name, task in tasks.items() if not reasons[name]}
    if not fitting:
        raise EqtError(next(iter(reasons.values())))
    for name, reason in reasons.items():
        if reason and not law.only:
            first = reason.strip().splitlines()[0]
            reporter().remark(EqtWarning(f"{law.label} does not fit {name}: {first}"))
    outcomes = dict[str, Judged]()
    for name, task in fitting.items():
        output.say(f"{law.label} on {name}")
        outcomes[name] = tuned(law, task, out / name, workers, force=force)
    return stored(law, fitting, outcomes, out)


def judge_stated(
    law: Law, gains: Path, tasks: Mapping[str, Task], out: Path, workers: int
) -> Archive:
    """Judge a law at the gains in a file, on the tasks that it names; write its numbers."""
    values = stated_gains(law, gains, tasks)
    outcomes = {name: judged(law, tasks[name], [values[name]], workers) for name in values}
    return stored(law, {name: tasks[name] for name in values}, outcomes, out)


def stored(law: Law, tasks: Mapping[str, Task], outcomes: dict[str, Judged], out: Path) -> Archive:
    """Write the numbers of a law into its folder, and return them."""
    title = law.label
    if law.kind in ("shipped", "Python"):
        title = str(getattr(controllers.get(law.entry["kind"]), "title", law.label))
    sources = {law.file.name: law.text} if law.file else {}
    whole = JudgedLaw(law.label, title, law.kind, law.digest, outcomes, sources)
    numbers = Archive({name: task.digest for name, task in tasks.items()}, {law.label: whole})
    archives.write(out / FILE, numbers)
    return numbers


def write_archive(
    labels: Sequence[str], names: Sequence[str], path: Path, out: Path, workers: int
) -> Archive:
    """Judge the laws of the archive on the tasks of the suite, and write them into a file.

    What `out` holds of earlier searches is used again.
    """
    tasks, laws = chosen_tasks(names), shipped_laws()
    for label in labels:
        if label not in laws:
            raise EqtError(f"no law '{label}' in the archive; there are: {', '.join(laws)}")
    chosen = [laws[label] for label in labels or laws]
    parts = [
        judge_law(
            law, {n: t for n, t in tasks.items() if not fits(law, t)}, out / law.label, workers
        )
        for law in chosen
    ]
    whole = joined(parts)
    archives.write(path, whole)
    return whole


def joined(parts: Sequence[Archive]) -> Archive:
    """Join judged laws; of two laws with one label, the later one is the better known.

    Raises
    ------
    EqtError
        If a task is not the same in all of them.
    """
    tasks: dict[str, str] = {}
    laws: dict[str, JudgedLaw] = {}
    for part in parts:
        for name, digest in part.tasks.items():
            if tasks.setdefault(name, digest) != digest:
                raise EqtError(f"task {name} is another one in some of the files; judge them anew")
        laws |= part.laws
    return Archive(tasks, laws)


def current(archive: Archive, tasks: Mapping[str, Task], name: str) -> Archive:
    """Return the part of a file that was judged on the tasks of this version of eqt."""
    stale = [
        task
        for task, digest in archive.tasks.items()
        if task in tasks and tasks[task].digest != digest
    ]
    if stale:
        remark = f"{name}: judged on other tasks than those of this eqt: {', '.join(stale)}"
        reporter().remark(EqtWarning(remark))
    known = {n: d for n, d in archive.tasks.items() if n in tasks and n not in stale}
    laws = {
        label: replace(law, tasks={n: each for n, each in law.tasks.items() if n in known})
        for label, law in archive.laws.items()
    }
    return Archive(known, laws, archive.suite)


def with_archive(part: Archive, tasks: Mapping[str, Task], out: Path, workers: int) -> Archive:
    """Return judged laws beside the archive; where that lacks the reference law, it is judged."""
    known = current(archives.shipped_archive(), tasks, "the archive")
    reference = known.laws.get(REFERENCE)
    needed = {
        name: task
        for name, task in tasks.items()
        if name in part.tasks and (reference is None or name not in reference.tasks)
    }
    parts = [known, part]
    if needed and REFERENCE not in part.laws:
        law = shipped_laws()[REFERENCE]
        more = judge_law(law, needed, out / REFERENCE, workers)
        if reference is not None:
            both = reference.tasks | more.laws[REFERENCE].tasks
            more = Archive(more.tasks, {REFERENCE: replace(reference, tasks=both)})
        parts = [known, more, part]
    return joined(parts)
