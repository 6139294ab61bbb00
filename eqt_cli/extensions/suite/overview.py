"""The suite at a glance: its tasks, the laws in the archive, and what a law costs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from eqt_cli.base.reporting import Block, TextTable
from eqt_cli.cli.output import laid_out
from eqt_cli.extensions.suite.archive import Archive
from eqt_cli.extensions.suite.tables import heading
from eqt_cli.extensions.suite.tasks import VERSION, Task, digest_of


def _seconds(archive: Archive, task: str) -> float:
    """Return what the middle law took on a task, s of the processor; 0 if it is not known."""
    took = sorted(law.tasks[task].seconds for law in archive.laws.values() if task in law.tasks)
    return took[len(took) // 2] if took else 0.0


def overview_record(tasks: Mapping[str, Task], archive: Archive) -> dict[str, Any]:
    """Return the suite for programs."""
    return {
        "suite": VERSION,
        "digest": digest_of(dict(tasks)),
        "tasks": {
            name: task.section.model_dump(exclude={"gains"})
            | {"gains": task.ranges, "digest": task.digest, "cpu_seconds": _seconds(archive, name)}
            for name, task in tasks.items()
        },
        "laws": {label: sorted(law.tasks) for label, law in archive.laws.items()},
    }


def overview_table(tasks: Mapping[str, Task], archive: Archive) -> list[Any]:
    """Return what `eqt suite` prints."""
    rows = []
    for name, task in tasks.items():
        cost, bound = task.cost
        seconds = _seconds(archive, name)
        count = sum(name in law.tasks for law in archive.laws.values())
        rows.append(
            [
                name,
                task.section.says,
                task.section.laws,
                f"{cost} {bound:g}",
                str(count),
                f"{seconds:.0f}" if seconds else "-",
            ]
        )
    header = ["task", "what it is", "laws", "may spend", "archived", "CPU s"]
    table = TextTable("suite", f"{heading(tasks)}", header, [Block("", rows)], spare=("may spend",))
    laws = ", ".join(archive.laws) or "none yet; `eqt suite archive` computes them"
    total = sum(_seconds(archive, name) for name in tasks)
    lines = ["", f"archive  {laws}"]
    if total:
        with_times = sum(_seconds(archive, name) > 0 for name in tasks)
        minutes = f"{total / 60:.1f} CPU minutes for a law with two gains"
        lines.append(f"expected {minutes}, on {with_times} of {len(tasks)} tasks")
    lines += [f"a task   eqt suite show {next(iter(tasks))}", "next     eqt suite mylaw.py"]
    return [laid_out(table), *lines]
