"""Selects the failed runs of a finished result to compute them again."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from eqt_cli.core.errors import START_OVER, EqtError, Remedy
from eqt_cli.engines import Status
from eqt_cli.execution.part_files import PartFiles
from eqt_cli.execution.part_task import PartTask
from eqt_cli.execution.result_layout import in_root
from eqt_cli.experiment.law_names import LAW
from eqt_cli.experiment.parts import StudyPart
from eqt_cli.experiment.study import Study
from eqt_cli.store.reader import open_results


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
    kept = in_root(study)
    integers = {entry.name for entry in kept if entry.dtype is not None and entry.dtype.kind != "f"}
    with open_results(results) as old:
        if set(old.names) - {LAW, *(entry.name for entry in kept)} or integers - set(old.names):
            raise EqtError(
                f"{results}: was written by a version of eqt that stores other variables",
                Remedy("compute its failed runs with that version"),
                START_OVER,
            )
        status = old["status"]
    status = status.reshape(-1, *status.shape[-2:]).swapaxes(0, 1)
    by_piece = [status[:, points].reshape(len(status), -1) for points in study.shapes]
    chosen: list[tuple[int, StudyPart]] = []
    for item in range(len(study.plans)):
        index, part = PartTask(study, PartFiles(folder)).part(item)
        found = by_piece[index][part.controller, part.start : part.stop]
        if (found == Status.WORKER_LOST).all():
            chosen.append((index, part))
            continue
        failed = (part.start + np.flatnonzero(found)).tolist()
        chosen += [(index, replace(part, start=entry, stop=entry + 1)) for entry in failed]
    return PartTask(study, PartFiles(folder), tuple(chosen))
