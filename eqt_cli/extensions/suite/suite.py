"""What the commands of the suite do: judge laws, write the archive, join files of judged laws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, count
from pathlib import Path
from typing import Any

from eqt_cli.base.errors import EqtError, EqtWarning, suggestion
from eqt_cli.base.files import file_name
from eqt_cli.base.reporting import reporter
from eqt_cli.cli import output
from eqt_cli.components.laws import controllers
from eqt_cli.extensions.suite import archive as archives
from eqt_cli.extensions.suite import checking, proposals
from eqt_cli.extensions.suite.archive import Archive, JudgedLaw
from eqt_cli.extensions.suite.checking import Optimism, Recomputed
from eqt_cli.extensions.suite.judging import Judged, fits, judged, tuned
from eqt_cli.extensions.suite.laws import Law, read_law, shipped_laws, stated_gains
from eqt_cli.extensions.suite.tasks import REFERENCE, VERSION, Task, chosen_tasks, read_task

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

    What `out` holds of earlier searches is used again. Laws that fit no task are left out.

    Raises
    ------
    EqtError
        If a label or a task is unknown, or no law fits.
    """
    tasks, laws = chosen_tasks(names), shipped_laws()
    for label in labels:
        if label not in laws:
            raise EqtError(f"no law '{label}' in the archive; there are: {', '.join(laws)}")
    chosen = [laws[label] for label in labels or laws]
    fitting = {law.label: {n: t for n, t in tasks.items() if not fits(law, t)} for law in chosen}
    if not any(fitting.values()):
        raise EqtError(f"{', '.join(fitting)}: fits none of the tasks: {', '.join(tasks)}")
    parts = [
        judge_law(law, fitting[law.label], out / law.label, workers)
        for law in chosen
        if fitting[law.label]
    ]
    whole = joined(parts)
    archives.write(path, whole)
    return whole


def joined(parts: Sequence[Archive]) -> Archive:
    """Join judged laws; what a later part has of the same law counts.

    A law that has the label of another one gets a number behind it.

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
        for law in part.laws.values():
            label = free_label(law, laws)
            if label in laws:
                law = replace(law, tasks=laws[label].tasks | law.tasks)
            elif label != law.label:
                law = replace(law, label=label, title=f"{law.title} ({label})")
            laws[label] = law
    return Archive(tasks, laws)


def free_label(law: JudgedLaw, laws: Mapping[str, JudgedLaw]) -> str:
    """Return the label of a law among others, a new one if another law has it."""
    numbered = (f"{law.label} {number}" for number in count(2))
    labels = chain([law.label], numbered)
    return next(x for x in labels if x not in laws or _is_same(law, laws[x]))


def _is_same(law: JudgedLaw, other: JudgedLaw) -> bool:
    stated = {judged.is_stated for one in (law, other) for judged in one.tasks.values()}
    return law.digest == other.digest and len(stated) < 2


def current(archive: Archive, tasks: Mapping[str, Task], name: str) -> Archive:
    """Return the part of a file that was judged on the tasks of this version of eqt."""
    stale = checking.stale_tasks(archive, tasks)
    if stale:
        remark = f"{name}: judged on other tasks than those of this eqt: {', '.join(stale)}"
        reporter().remark(EqtWarning(remark))
    known = {n: d for n, d in archive.tasks.items() if n not in stale}
    laws = {
        label: replace(law, tasks={n: law for n, law in law.tasks.items() if n in known})
        for label, law in archive.laws.items()
    }
    return Archive(known, laws, archive.suite)


def with_archive(
    part: Archive, tasks: Mapping[str, Task], out: Path, workers: int
) -> tuple[Archive, str]:
    """Return a judged law beside the archive, and its label there.

    Where the archive lacks the reference law, that is judged.
    """
    known = current(archives.shipped_archive(), tasks, "the archive")
    reference = known.laws.get(REFERENCE)
    lacking = {
        name: task
        for name, task in tasks.items()
        if name in part.tasks and (reference is None or name not in reference.tasks)
    }
    (law,) = part.laws.values()
    if lacking and law.digest != shipped_laws()[REFERENCE].digest:
        more = judge_law(shipped_laws()[REFERENCE], lacking, out / REFERENCE, workers)
        known = joined([known, more])
    return joined([known, part]), free_label(law, known.laws)


def file_in(result: Path) -> Path:
    """Return the file of a folder of judged laws, or the file that was given.

    Raises
    ------
    EqtError
        If the folder has none.
    """
    path = result / FILE if result.is_dir() else result
    if not path.exists():
        raise EqtError(f"{result}: has no judged law; eqt suite LAW writes one")
    return path


def beside_archive(
    results: Sequence[Path], tasks: Mapping[str, Task], labels: Sequence[str]
) -> tuple[Archive, list[str]]:
    """Return judged laws beside those of the archive, all or some, and the labels of the former."""
    known = current(archives.shipped_archive(), tasks, "the archive")
    for label in labels:
        if label not in known.laws:
            raise EqtError(f"no law '{label}' in the archive{suggestion(label, known.laws)}")
    if labels:
        wanted = {x: law for x, law in known.laws.items() if x in (*labels, REFERENCE)}
        known = replace(known, laws=wanted)
    new = list[str]()
    for result in results:
        part = current(archives.read(file_in(result)), tasks, str(result))
        for law in part.laws.values():
            new.append(free_label(law, known.laws))
            known = joined([known, Archive(part.tasks, {law.label: law})])
    return known, new


def pack(result: Path, out: Path | None) -> Path:
    """Write the pack of a judged law, and return its path."""
    content = archives.read(file_in(result))
    label = next(iter(content.laws))
    path = out or Path(f"{file_name(label, 'law')}{archives.ENDING}")
    archives.write(path, content)
    return path


@dataclass(frozen=True)
class Checked:
    """The outcome of a check.

    Attributes
    ----------
    file
        What was checked.
    runs, optimism
        The runs that were computed again, and the laws on fresh runs.
    wrong
        What is wrong beside them, in words.
    unchecked
        What could not be checked, and how it can.
    """

    file: Path
    runs: list[Recomputed]
    optimism: list[Optimism]
    wrong: list[str]
    unchecked: list[str]

    @property
    def holds(self) -> bool:
        """Whether nothing speaks against the file."""
        differs = any(row.differing for row in self.runs)
        return not (differs or self.wrong or any(row.is_optimistic for row in self.optimism))

    def answer(self) -> list[str]:
        """Return what was found, the verdict first."""
        verdict = "holds" if self.holds else "FAILS"
        if self.holds and not self.runs:
            verdict = "nothing was computed again"
        lines = [f"{self.file}: {verdict}", *self.wrong, *self.unchecked]
        runs, differing = sum(x.runs for x in self.runs), sum(x.differing for x in self.runs)
        if self.runs:
            lines.append(f"runs     {runs} computed again: {differing or 'none'} differ")
        for row in (row for row in self.runs if row.differing):
            lines.append(
                f"  {row.law} on {row.task}, sample {row.sample}: {row.differing} of {row.runs} "
                f"differ, by up to {row.largest:.1e}"
            )
        if any(row.differing for row in self.runs) and all(x.largest < SMALL for x in self.runs):
            lines.append("  another processor or compiler can make so small a difference")
        lines += [_fresh_line(part) for part in self.optimism]
        return lines

    def record(self) -> dict[str, Any]:
        """Return the outcome for programs."""
        return {
            "file": str(self.file),
            "holds": self.holds,
            "wrong": self.wrong,
            "unchecked": self.unchecked,
            "runs": [checking.record_of(row) for row in self.runs],
            "optimism": [checking.record_of(row) for row in self.optimism],
        }


def _fresh_line(part: Optimism) -> str:
    low, high = (100 * (end - 1) for end in part.factor[1:])
    word = "OPTIMISTIC" if part.is_optimistic else "as on the public runs"
    failed = f", {part.failed} fresh runs failed" if part.failed else ""
    return (
        f"fresh    {part.law} on {part.task or 'all tasks'}: ratio {part.public:.3f} on the public "
        f"runs, {part.fresh:.3f} on fresh ones: {100 * (part.factor.value - 1):+.1f} % "
        f"[{low:+.1f}, {high:+.1f}]{failed}; {word}"
    )


SMALL = 1e-5
"""Relative difference of an error that another processor or compiler can make."""


def check(
    file: Path | None,
    law_file: str | None,
    labels: Sequence[str],
    names: Sequence[str],
    workers: int,
    *,
    share: float,
    has_fresh: bool,
) -> Checked:
    """Check a file of judged laws: the archive, a pack, or the folder of a law."""
    path, tasks = file_in(file or archives.ARCHIVE), chosen_tasks(names)
    content, laws = archives.read(path), shipped_laws()
    stale = [x for x in checking.stale_tasks(content, chosen_tasks([])) if not names or x in names]
    checked = Checked(path, [], [], [], [])
    if content.suite != VERSION:
        checked.wrong.append(f"judged on {content.suite}, and this eqt has {VERSION}")
    checked.wrong.extend(f"task {x} is not the one of this eqt; judge the law anew" for x in stale)
    tasks = {n: t for n, t in tasks.items() if n in content.tasks and n not in stale}
    for label in labels:
        if label not in content.laws:
            raise EqtError(f"{path}: has no law '{label}'{suggestion(label, content.laws)}")
    named = None if law_file is None else read_law(law_file)
    known = current(archives.shipped_archive(), chosen_tasks([]), "the archive")
    reference = known.laws.get(REFERENCE)
    reference = content.laws.get(REFERENCE, reference)
    for judged_law in content.laws.values():
        if labels and judged_law.label not in labels:
            continue
        law = _law_of(judged_law, named, laws, checked)
        if law is None:
            continue
        of_law = {name: task for name, task in tasks.items() if name in judged_law.tasks}
        if others := checking.other_keys(law, judged_law, of_law):
            label, keys = judged_law.label, ", ".join(others)
            checked.wrong.append(f"{label}: changes keys beside the numbers of the law: {keys}")
            continue
        _recompute(checked, law, judged_law, of_law, share, workers)
        if has_fresh and law.digest != laws[REFERENCE].digest:
            _renew(checked, (law, laws[REFERENCE]), (judged_law, reference), of_law, workers)
    return checked


def _law_of(
    judged_law: JudgedLaw, named: Law | None, laws: Mapping[str, Law], checked: Checked
) -> Law | None:
    """Return the law of a file as it can be run; note why it cannot."""
    law = named if judged_law.sources else laws.get(judged_law.label)
    law = law or next((x for x in laws.values() if x.digest == judged_law.digest), None)
    if law is None:
        sources = ", ".join(judged_law.sources) or "its file"
        checked.unchecked.append(
            f"{judged_law.label}: not run, since a file is data; read {sources} in it "
            f"(`unzip {checked.file}`), then add --law FILE"
        )
    elif law.digest != judged_law.digest:
        place = law.file or "this eqt"
        checked.wrong.append(f"{judged_law.label}: the law in {place} is not the one of the file")
        return None
    return law


def _recompute(
    checked: Checked,
    law: Law,
    judged_law: JudgedLaw,
    tasks: Mapping[str, Task],
    share: float,
    workers: int,
) -> None:
    drawn = checking.drawn_samples(judged_law, list(tasks), share)
    for name, task in tasks.items():
        if samples := [sample for other, sample in drawn if other == name]:
            rows = checking.recomputed(law, judged_law, task, samples, workers)
            checked.runs.extend(rows)


def _renew(
    checked: Checked,
    laws: tuple[Law, Law],
    judged_laws: tuple[JudgedLaw, JudgedLaw | None],
    tasks: Mapping[str, Task],
    workers: int,
) -> None:
    judged_law, reference = judged_laws
    if reference is None:
        checked.unchecked.append("no fresh runs: there is no GT to compare with")
        return
    shared = {name: task for name, task in tasks.items() if name in reference.tasks}
    rows = checking.optimism(laws, (judged_law, reference), shared, workers)
    checked.optimism.extend(rows)


def propose(
    path: Path, labels: Sequence[str], out: Path | None, workers: int
) -> proposals.Proposal:
    """Tune the laws of the archive on a task, and judge the task."""
    task, laws = read_task(path), shipped_laws()
    for label in labels:
        if label not in laws:
            raise EqtError(f"no law '{label}' in the archive{suggestion(label, laws)}")
    folder = out or FOLDER / "proposed" / task.name
    parts = [
        judge_law(law, {task.name: task}, folder / law.label, workers)
        for law in (laws[label] for label in labels or laws)
        if not fits(replace(law, only=()), task)
    ]
    known = current(archives.shipped_archive(), chosen_tasks([]), "the archive")
    return proposals.proposal(task.name, joined(parts), known)
