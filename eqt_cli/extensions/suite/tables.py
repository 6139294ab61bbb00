"""The tables of the suite, and the sentences that come first."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from eqt_cli.base.reporting import Block, TextTable, count_of, fixed, listed
from eqt_cli.extensions.search.exchanges import FINISHED, NOT_FINISHED
from eqt_cli.extensions.suite.archive import Archive
from eqt_cli.extensions.suite.tasks import REFERENCE, VERSION, Task, digest_of
from eqt_cli.extensions.suite.verdicts import (
    EQUAL,
    FAILS,
    MOST_SPENT,
    VERDICTS,
    Overall,
    TaskVerdict,
    at_ends,
    overall,
    sets_of,
    verdicts,
)
from eqt_cli.results.quantity import Plain


def _interval(value: float, low: float, high: float) -> str:
    """Return a ratio as ``0.873 [0.86, 0.89]``."""
    if not math.isfinite(value):
        return "-"
    half = (high - low) / 2
    digits = 2 if not math.isfinite(half) else 4 if half < 0.0005 else 3 if half < 0.05 else 2
    ends = f" [{fixed(low, digits)}, {fixed(high, digits)}]" if math.isfinite(half) else ""
    return fixed(value, digits) + ends


def _cell(judgement: TaskVerdict) -> str:
    """Return the ratio with its interval, or what failed."""
    ratio = judgement.ratio
    return (
        judgement.failure or "-" if ratio is None else _interval(ratio.value, ratio.low, ratio.high)
    )


def task_table(
    of_tasks: Sequence[TaskVerdict],
    archive: Archive,
    tasks: Mapping[str, Task],
    write: Plain,
    laws: Sequence[str] = (),
) -> TextTable:
    """Return the table of laws against the reference law by task."""
    blocks = []
    for name, task in tasks.items():
        of_task = [x for x in of_tasks if x.task == name and (not laws or x.law in laws)]
        rows = [_row(judgement, archive, write) for judgement in of_task]
        if rows:
            blocks.append(Block(write.text(f"{name}: {task.section.says}"), rows))
    header = ["law", "ratio to GT", "median run", "better in", "failed", "effort", "verdict"]
    notes = [
        "ratio to GT: mean error over the mean error of GT, both tuned on the same training "
        "samples to spend at most the same effort, with a 95 % interval over samples and held-out "
        "runs",
        "median run: the ratio in the middle run; better in: share of the runs; effort: what the "
        "law spends on held-out runs, as a share of the most that all may spend in training",
    ]
    if any(judgement.verdict == NOT_FINISHED for judgement in of_tasks):
        notes.append(
            f"{NOT_FINISHED}: the last exchange between the samples of the law, or of GT, gained "
            f"more than {100 * FINISHED:g} %, so that better gains are likely"
        )
    ends = [
        f"{archive.laws[x.law].title} on {x.task} ({', '.join(numbers)})"
        for x in of_tasks
        if (numbers := at_ends(archive.laws[x.law], tasks[x.task]))
    ]
    if ends:
        notes.append(f"at an end of its range, on some sample: {listed(ends)}")
    if any(judgement.verdict == FAILS for judgement in of_tasks):
        notes.append(
            f"fails: no ratio, since runs failed, no gains spend so little, or the law spends more "
            f"than {MOST_SPENT} of the effort"
        )
    if any(judgement.judged.is_stated for judgement in of_tasks):
        notes.append("stated: gains of the user, which the suite did not tune")
    return TextTable(
        "tasks", "Laws against GT, by task", header, blocks, list(map(write.text, notes))
    )


def _row(judgement: TaskVerdict, archive: Archive, write: Plain) -> list[str]:
    law, ratio = archive.laws[judgement.law], judgement.ratio
    if judgement.law == REFERENCE:
        counted = f"{judgement.judged.failed}/{judgement.judged.runs}"
        return [
            write.text(law.title),
            "1",
            "-",
            "-",
            counted,
            fixed(judgement.spent, 2),
            "reference",
        ]
    title = law.title + (" (stated)" if judgement.judged.is_stated else "")
    return [
        write.text(title),
        write.text(_cell(judgement)),
        write.text(fixed(ratio.median, 3) if ratio else "-"),
        write.text(f"{100 * ratio.ahead:.0f} %" if ratio else "-"),
        f"{judgement.judged.failed}/{judgement.judged.runs}",
        fixed(judgement.spent, 2),
        judgement.verdict,
    ]


def overall_table(rows: Sequence[Overall], archive: Archive, write: Plain) -> TextTable:
    """Return the table of laws over whole sets of tasks."""
    blocks = []
    rows = [row for row in rows if row.law != REFERENCE]
    for name in dict.fromkeys(row.tasks for row in rows):
        of_law = [row for row in rows if row.tasks == name]
        title = f"{name} tasks ({of_law[0].count})"
        blocks.append(
            Block(write.text(title), [_overall_row(row, archive, write) for row in of_law])
        )
    header = ["law", "geometric mean", "one left out", "from", "to"]
    header += [word.removeprefix("search ") for word in VERDICTS]
    notes = [
        "geometric mean: of the ratios to GT, with a 95 % interval over samples and held-out "
        "runs; the tasks are fixed, and another set of tasks would give another number",
        "one left out: this mean without one of the tasks, the least and the largest; from, to: "
        "the ratios of single tasks; then the number of tasks with each verdict",
    ]
    caption = "Laws against GT, over whole sets of tasks"
    return TextTable("overall", caption, header, blocks, list(map(write.text, notes)))


def _overall_row(row: Overall, archive: Archive, write: Plain) -> list[str]:
    return [
        write.text(archive.laws[row.law].title),
        write.text(_interval(*row.ratio)),
        " to ".join(fixed(x, 2) for x in row.without) if math.isfinite(row.without[0]) else "-",
        fixed(row.least, 2),
        fixed(row.largest, 2),
        *(str(row.verdicts[word]) for word in VERDICTS),
    ]


def answer(
    law: str, of_tasks: Sequence[TaskVerdict], rows: Sequence[Overall], title: str
) -> list[str]:
    """Say first what a law does against the reference law."""
    of_law = [judgement for judgement in of_tasks if judgement.law == law]
    said = []
    for word in VERDICTS:
        names = [f"{x.task} ({_cell(x)})" for x in of_law if x.verdict == word]
        if names:
            said.append(f"{word} on {listed(names)}")
    if not said:
        return [f"{title} was judged on no task that this archive has; judge it anew."]
    lines = [f"{title} against GT: {'; '.join(said)}."]
    for row in (row for row in rows if row.law == law):
        over = f"Over {row.tasks} {count_of(row.count, 'task')}"
        if math.isfinite(row.ratio.value):
            ends = f"from {fixed(row.least, 2)} to {fixed(row.largest, 2)}"
            mean = f"the geometric mean of the ratios is {_interval(*row.ratio)}, {ends}"
            lines.append(f"{over}, {mean}.")
        else:
            why = f"it fails on {row.verdicts[FAILS]}"
            if not row.verdicts[FAILS]:
                why = "a search is not finished, of the law or of GT"
            lines.append(f"{over}, there is no mean: {why}.")
    if not any(row.law == law for row in rows):
        lines.append("There is no mean over tasks: this needs a whole set of tasks.")
    of_reference = {x.task: x.spent for x in of_tasks if x.law == REFERENCE}
    for judgement in of_law:
        of_gt = of_reference[judgement.task]
        if abs(judgement.spent - of_gt) > EQUAL * of_gt:
            spent = f"{fixed(judgement.spent, 2)} of what all may spend, and GT {fixed(of_gt, 2)}"
            lines.append(f"On {judgement.task}, it spends {spent}.")
    return lines


def heading(tasks: Mapping[str, Task]) -> str:
    """Name the suite, with the start of the digest of the tasks."""
    return f"{VERSION}, digest {digest_of(dict(tasks))[:12]}"


def judged_records(archive: Archive, tasks: Mapping[str, Task]) -> dict[str, Any]:
    """Return all verdicts for programs."""
    of_tasks = verdicts(archive, tasks)
    return {
        "suite": VERSION,
        "digest": digest_of(dict(tasks)),
        "sets": sets_of(tasks),
        "laws": {
            label: {"title": law.title, "kind": law.kind, "digest": law.digest, "eqt": law.eqt}
            for label, law in archive.laws.items()
        },
        "tasks": [judgement.record() for judgement in of_tasks],
        "overall": [row.record() for row in overall(of_tasks, archive, tasks)],
    }
