"""What the commands of the suite do: judge laws, write the archive, join files of judged laws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, count
from pathlib import Path
from shlex import quote
from typing import Any, TypeVar

from eqt_cli.base.errors import EqtError, EqtWarning, suggestion
from eqt_cli.base.files import file_name
from eqt_cli.base.reporting import reporter
from eqt_cli.cli import output
from eqt_cli.components.laws import controllers
from eqt_cli.extensions.suite import archive as archives
from eqt_cli.extensions.suite import checking, proposals, repeats
from eqt_cli.extensions.suite.archive import Archive, JudgedLaw
from eqt_cli.extensions.suite.checking import Optimism, Recomputed
from eqt_cli.extensions.suite.entrants import Law, read_law, shipped_laws, stated_gains
from eqt_cli.extensions.suite.judging import Judged, fits, judged, tuned
from eqt_cli.extensions.suite.tasks import REFERENCE, VERSION, Task, chosen_tasks, read_task

T = TypeVar("T")

FILE = "law.zip"
"""Name of the file with the numbers of a law, in the folder of its result."""

FOLDER = Path("results") / "suite"
"""Folder of the results of the suite."""

AGAIN = Path("results") / "suite-again"
"""Folder of the searches on other training samples."""


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
            remark = f"{law.label} does not fit {name}: {_first_line(reason)}"
            reporter().remark(EqtWarning(remark))
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
    tasks, chosen = chosen_tasks(names), chosen_laws(labels, shipped_laws()).values()
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


def chosen_laws(labels: Sequence[str], laws: Mapping[str, T]) -> dict[str, T]:
    """Return some laws of the archive by label, in its order, or all.

    Raises
    ------
    EqtError
        If there is no such law.
    """
    for label in labels:
        if label not in laws:
            near = suggestion(label, laws) or f"; there are: {', '.join(laws)}"
            raise EqtError(f"no law '{label}' in the archive{near}")
    return {label: law for label, law in laws.items() if not labels or label in labels}


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
    checking.check_shapes(archive, tasks, name)
    stale = checking.stale_tasks(archive, tasks)
    if stale:
        remark = f"{name}: judged on other tasks than those of this eqt: {', '.join(stale)}"
        reporter().remark(EqtWarning(remark))
    usable = {n: d for n, d in archive.tasks.items() if n not in stale}
    laws = {
        label: replace(law, tasks={n: law for n, law in law.tasks.items() if n in usable})
        for label, law in archive.laws.items()
    }
    return Archive(usable, laws, archive.suite)


def with_archive(
    part: Archive, tasks: Mapping[str, Task], out: Path, workers: int
) -> tuple[Archive, str]:
    """Return a judged law beside the archive, and its label there.

    Where the archive lacks the reference law, that is judged.
    """
    archive = current(archives.shipped_archive(), tasks, "the archive")
    reference = archive.laws.get(REFERENCE)
    lacking = {
        name: task
        for name, task in tasks.items()
        if name in part.tasks and (reference is None or name not in reference.tasks)
    }
    (law,) = part.laws.values()
    if lacking and law.digest != shipped_laws()[REFERENCE].digest:
        more = judge_law(shipped_laws()[REFERENCE], lacking, out / REFERENCE, workers)
        archive = joined([archive, more])
    return joined([archive, part]), free_label(law, archive.laws)


def file_in(result: Path) -> Path:
    """Return the file of a folder of judged laws, or the file that was given.

    Raises
    ------
    EqtError
        If the folder has none.
    """
    if not result.exists():
        raise EqtError(
            f"{result}: not found; give a pack, a folder that eqt suite LAW wrote, or a task, as "
            "late"
        )
    path = result / FILE if result.is_dir() else result
    if not path.exists():
        raise EqtError(f"{result}: has no {FILE}; give the folder that eqt suite LAW wrote")
    return path


def beside_archive(
    results: Sequence[Path], tasks: Mapping[str, Task], labels: Sequence[str]
) -> tuple[Archive, list[str]]:
    """Return judged laws beside those of the archive, all or some, and the labels of the former."""
    archive = current(archives.shipped_archive(), tasks, "the archive")
    if labels:
        archive = replace(archive, laws=chosen_laws([REFERENCE, *labels], archive.laws))
    new = list[str]()
    for result in results:
        part = archives.read(file_in(result))
        if part.suite != VERSION:
            raise EqtError(
                f"{result}: judged on {part.suite}, and this eqt has {VERSION}; show it with the "
                "version of eqt that judged it, or judge the law anew"
            )
        part = current(part, tasks, str(result))
        for law in part.laws.values():
            new.append(free_label(law, archive.laws))
            archive = joined([archive, Archive(part.tasks, {law.label: law})])
    return archive, new


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
    if part.spends_more:
        failed += f", at {part.spent:.2f} times the effort that the file states"
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
    checking.check_shapes(content, tasks, str(path))
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
    archive = current(archives.shipped_archive(), chosen_tasks([]), "the archive")
    reference = reference_of(content, archive, laws[REFERENCE].digest)
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


def reference_of(content: Archive, archive: Archive, digest: str) -> JudgedLaw | None:
    """Return the reference law that a file is checked against: what the archive has of it counts.

    A law of a user can have its label, too, and a file could state any cost of it.
    """
    of_file, of_archive = content.laws.get(REFERENCE), archive.laws.get(REFERENCE)
    if of_file is None or of_file.digest != digest:
        return of_archive
    tasks = of_archive.tasks if of_archive else {}
    return replace(of_file, tasks={**of_file.tasks, **tasks})


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
            f"(`unzip {quote(str(checked.file))}`), then add --law FILE"
        )
    elif law.digest != judged_law.digest:
        place = law.file or "this eqt"
        checked.wrong.append(f"{judged_law.label}: the law in {place} is not the one of the file")
        return None
    elif judged_law.sources and law.text not in judged_law.sources.values():
        there = ", ".join(judged_law.sources)
        checked.wrong.append(f"{judged_law.label}: {there} in the file is not the law of its hash")
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
    """Tune laws of the archive on a task, GT among them, and judge the task.

    Raises
    ------
    EqtError
        If fewer than two of the laws fit the task.
    """
    task = read_task(path)
    laws = chosen_laws([REFERENCE, *labels] if labels else [], shipped_laws())
    reasons = {label: fits(replace(law, only=()), task) for label, law in laws.items()}
    fitting = [law for label, law in laws.items() if not reasons[label]]
    if len(fitting) < 2:
        why = [
            f"{x} does not fit: {_first_line(reason)}" for x, reason in reasons.items() if reason
        ]
        there = "; ".join(why) or f"--laws names {', '.join(laws)} alone"
        raise EqtError(f"{path}: a task is judged by two laws or more; {there}")
    folder = out or FOLDER / "proposed" / task.name
    parts = [judge_law(law, {task.name: task}, folder / law.label, workers) for law in fitting]
    archive = current(archives.shipped_archive(), chosen_tasks([]), "the archive")
    return proposals.proposal(task.name, joined(parts), archive)


def _first_line(text: str) -> str:
    return text.strip().splitlines()[0]


def repeat(
    labels: Sequence[str], names: Sequence[str], seed: int | None, folder: Path, workers: int
) -> repeats.Repeated:
    """Tune laws of the archive on other training samples, and compare with the archive.

    Raises
    ------
    EqtError
        If a law or task is unknown, or the archive has other laws or tasks than this eqt.
    """
    content, tasks = archives.shipped_archive(), chosen_tasks(names)
    laws = chosen_laws([*labels, REFERENCE] if labels else [], shipped_laws())
    stale = [f"task {name}" for name in tasks if name not in content.tasks]
    stale += [f"task {name}" for name in checking.stale_tasks(content, tasks) if name in tasks]
    archived = {label: law.digest for label, law in content.laws.items()}
    stale += [label for label, law in laws.items() if archived.get(label) != law.digest]
    if stale:
        what = ", ".join(stale)
        raise EqtError(f"{archives.ARCHIVE}: has another {what}; run eqt suite archive first")
    return repeats.repeat(content, laws, tasks, seed, folder, workers)
