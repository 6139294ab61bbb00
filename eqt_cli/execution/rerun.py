"""Runs of a finished result that failed, computed once more and put in their places."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.blame import blamed
from eqt_cli.core.errors import START_OVER, EqtError, Remedy
from eqt_cli.engines import Status
from eqt_cli.execution.compute import compute_alone, compute_part, read_part
from eqt_cli.execution.executors import TaskContext
from eqt_cli.execution.pack import put_desired
from eqt_cli.execution.part_files import PartFiles
from eqt_cli.execution.part_task import PartTask
from eqt_cli.execution.result_layout import Destination, Layout, new_result_file
from eqt_cli.experiment.law_names import LAW
from eqt_cli.experiment.study import Study
from eqt_cli.results.quantity import Per
from eqt_cli.store.assembly import Assembly
from eqt_cli.store.reader import ResultFile, open_results
from eqt_cli.store.variables import Table, Variable

ROW = "row_in_part"
COPIED_BYTES = 64 * 2**20


@dataclass(frozen=True, eq=False)
class Rerun:
    """Computes the failed runs of parts, each run by itself; it can be sent to other processes.

    Attributes
    ----------
    parts
        The study, and where the new rows are kept until they are in the result.
    failed
        By part, the rows to compute.
    whole
        Parts that had been lost with their workers: they are computed as if for the first time.
    """

    parts: PartTask
    failed: dict[int, list[int]]
    whole: frozenset[int]

    @blamed()
    def __call__(self, item: int, context: TaskContext) -> int:
        rows = np.array(self.failed[item])
        index, number = self.parts.study.plans.where(item)
        study, shared = self.parts.study.piece(index), self.parts.shared(index)
        part = study.plan.part(number)
        if item in self.whole:
            table = compute_part(study, part, shared, context)
        else:
            table = compute_alone(study, part, rows, shared, context)
        where = {ROW: Variable(("entry",), rows)}
        return self.parts.save(item, Table({**table.variables, **where}, {}, table.attributes))

    def runs_of(self, item: int) -> int:
        """The number of runs to compute of a part."""
        return len(self.failed[item])

    @property
    def missing(self) -> list[int]:
        """The parts that an earlier session has not done."""
        there = self.parts.files.listed()
        return [number for number in self.failed if number not in there]


def rerun_of(study: Study, results: Path, folder: Path) -> Rerun:
    """What there is to compute again of a result; new rows are kept in `folder`.

    Raises
    ------
    EqtError
        If the result does not hold the variables that this version of eqt keeps.
    """
    failed: dict[int, list[int]] = {}
    whole = []
    layout = Layout(study.piece(0))
    kept = {entry.name for entry in (layout.of(Per.RUN) if study.is_ragged else layout.quantities)}
    with open_results(results) as old:
        if {LAW, *old.names} != {LAW, *kept}:
            raise EqtError(
                f"{results}: was written by a version of eqt that keeps other variables",
                Remedy("compute its failed runs with that version"),
                START_OVER,
            )
        status = old["status"]
    status = status.reshape(-1, *status.shape[-2:]).swapaxes(0, 1)
    by_piece = [status[:, points].reshape(len(status), -1) for points in study.shapes]
    for item in range(len(study.plans)):
        index, number = study.plans.where(item)
        part = study.piece(index).plan.part(number)
        found = by_piece[index][part.controller, part.start : part.stop]
        if found.any():
            failed[item] = np.flatnonzero(found).tolist()
        if (found == Status.WORKER_LOST).all():
            whole.append(item)
    return Rerun(PartTask(study, PartFiles(folder)), failed, frozenset(whole))


def patch(rerun: Rerun, path: Path, provenance: dict[str, Any]) -> int:
    """Replace a result file by one with the new rows; returns how many runs still fail."""
    study = rerun.parts.study
    with open_results(path) as old, new_result_file(study, path) as file:
        still = int(np.count_nonzero(old["status"]))
        _copy_all(file.root, old)
        for point, group in enumerate(file.groups):
            _copy_all(group, old.at(point))
        for item, listed in rerun.parts.files.listed().items():
            still += listed.failed - len(rerun.failed[item])
            index, number = study.plans.where(item)
            with open_results(listed.path) as new:
                _replace(study.piece(index), file.places[index], number, new)
        origin = json.dumps(provenance, ensure_ascii=False)
        file.root.describe({**old.attributes, "provenance": origin})
    return still


def _copy_all(file: Assembly, old: ResultFile) -> None:
    for name in old.names:
        _copy(file, old, name)


def _copy(file: Assembly, old: ResultFile, name: str) -> None:
    """A whole variable, some rows at a time."""
    dims = old.dims(name)
    length = old.dimensions[dims[0]]
    row = 8 * int(np.prod([old.dimensions[dim] for dim in dims[1:]]))
    step = max(1, COPIED_BYTES // row)
    for start in range(0, length, step):
        rows = slice(start, min(start + step, length))
        file.put(name, old.read(name, **{dims[0]: rows}), (rows,))


def _replace(study: Study, file: Destination, number: int, new: ResultFile) -> None:
    plan, layout = study.plan, Layout(study)
    part = plan.part(number)
    points, runs = np.divmod(part.start + new[ROW], plan.runs)
    found = read_part(new, layout.quantities)
    for entry in layout.quantities:
        if entry.per is Per.DESIRED and entry.name in found:  # of a part that had been lost
            put_desired(file, entry.name, found[entry.name], part)
        if entry.per not in (Per.RUN, Per.TRAJECTORY):
            continue
        kept: Array = runs < (study.kept if entry.per is Per.TRAJECTORY else plan.runs)
        if not kept.any():
            continue
        for values, point, run in zip(found[entry.name], points[kept], runs[kept], strict=True):
            place = (part.controller, int(run))
            file.put(entry.name, np.asarray(values), (int(point), *place) if study.sweep else place)
