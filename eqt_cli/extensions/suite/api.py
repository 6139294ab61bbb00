"""`eqt_cli.suite`: a law on standard tasks, beside the laws of the archive."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from eqt_cli.base.reporting import InNotebook, count_of
from eqt_cli.extensions.suite import tables, verdicts
from eqt_cli.extensions.suite.actions import FOLDER, current, judge_law, judge_stated, with_archive
from eqt_cli.extensions.suite.archive import Archive, shipped_archive
from eqt_cli.extensions.suite.entrants import law_of
from eqt_cli.extensions.suite.tasks import Task, chosen_tasks
from eqt_cli.extensions.suite.verdicts import Overall, TaskVerdict


@dataclass(frozen=True, repr=False)
class SuiteTable(InNotebook):
    """Judged laws against GT; a notebook shows a row for each law and task.

    Attributes
    ----------
    archive
        The laws, with their gains and held-out errors.
    tasks
        The tasks by name.
    law, folder
        Label and folder of the law that was judged now; empty and None for the archive alone.
    """

    archive: Archive
    tasks: Mapping[str, Task]
    law: str = ""
    folder: Path | None = None

    def answer(self) -> list[str]:
        """Return what the law does against GT, or how large the archive is."""
        heading = tables.heading(self.tasks)
        if not self.law:
            laws, tasks = len(self.archive.laws), len(self.tasks)
            return [f"{heading}: {count_of(laws, 'law')} on {count_of(tasks, 'task')}"]
        of_tasks, rows = self._verdicts()
        title = self.archive.laws[self.law].title
        return [*tables.answer(self.law, of_tasks, rows, title), heading]

    def records(self) -> list[dict[str, Any]]:
        """Return a record per law and task: ratio to GT, interval, failed runs, effort, verdict."""
        return [row.record() for row in self._verdicts()[0]]

    def overall(self) -> list[dict[str, Any]]:
        """Return a record per law and whole set of tasks, with the geometric mean of the ratios."""
        return [row.record() for row in self._verdicts()[1]]

    def _verdicts(self) -> tuple[list[TaskVerdict], list[Overall]]:
        of_tasks = verdicts.verdicts(self.archive, self.tasks)
        return of_tasks, verdicts.overall(of_tasks, self.archive, self.tasks)


def suite(
    law: str | os.PathLike[str] | None = None,
    tasks: Sequence[str] = (),
    *,
    gains: str | os.PathLike[str] | None = None,
    out: str | os.PathLike[str] | None = None,
    force: bool = False,
    workers: int = 1,
) -> SuiteTable:
    """Tune a law on standard tasks, judge it on held-out runs, and return it beside the archive.

    Parameters
    ----------
    law
        File of a law, or label of one in the archive. Without it, nothing is computed.
    tasks
        Names of some tasks. Default: all.
    gains
        A YAML file with gains by task, which are judged as they are.
    out
        Folder of the law. Default: ``results/suite/<law>``. Searches that it holds are used again.
    force, workers
        As for `run`.

    Returns
    -------
    SuiteTable
        With `records`, `overall` and `to_dataframe`.

    Raises
    ------
    EqtError
        If there is no such law or task, or the law fits none of the tasks.

    Examples
    --------
    >>> table = eqt_cli.suite()
    >>> eqt = next(x for x in table.overall() if x["law"] == "eqt" and x["tasks"] == "all")
    >>> eqt["count"], 0.98 < eqt["geometric_mean"] < 1.01
    (6, True)
    """
    all_tasks = chosen_tasks([])
    if law is None:
        wanted = chosen_tasks(tasks)
        return SuiteTable(current(shipped_archive(), all_tasks, "the archive"), wanted)
    judged = law_of(os.fspath(law))
    folder = FOLDER / judged.label if out is None else Path(out)
    if gains is None:
        part = judge_law(judged, chosen_tasks(tasks), folder, workers, force=force)
    else:
        part = judge_stated(judged, Path(gains), chosen_tasks(tasks), folder, workers)
    beside, label = with_archive(part, all_tasks, folder.parent, workers)
    return SuiteTable(beside, all_tasks, label, folder)
