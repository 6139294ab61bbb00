"""Failed runs of a result, computed again: `--rerun-failed`, also by a solver with other settings.

With other settings, the experiment of the result stays what it is. Runs that end well now take
the place of the failed ones, and the result says which they are and what they were computed with.
Runs that fail again stay as they were.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.base import files, purposes
from eqt_cli.base.errors import OTHER_FOLDER, EqtError, Remedy
from eqt_cli.base.reporting import step
from eqt_cli.base.store_reader import ResultFile, open_results
from eqt_cli.base.store_writer import Assembly
from eqt_cli.base.stored import LAW, SHAPE, Status
from eqt_cli.config.parts import StudyPart
from eqt_cli.config.study import Study
from eqt_cli.extensions.growth.solvers_of_runs import SETTINGS, Setting, settings_of
from eqt_cli.results.quantity import Measure
from eqt_cli.runs.compute_part import PartTask
from eqt_cli.runs.folder import (
    RERUN,
    ResultFolder,
    further_variables,
    in_index,
    new_result_file,
    stored_quantities,
    write_index,
)
from eqt_cli.runs.part_files import MANIFEST, PartFiles
from eqt_cli.runs.run_study import (
    COMPILING,
    PACKING,
    Execution,
    Session,
    finished_parts,
    put_parts,
    timed,
)

GROWING = "growing"
"""Entry of the manifest: of what the parts are that are computed in the folder of reruns."""

COPIED_BYTES = 64 * 2**20


@purposes.run_rerun_failed
def rerun(session: Session) -> Execution:
    """Compute the failed runs of a complete result again, and replace their rows.

    Raises
    ------
    EqtError
        If the result is of an experiment that differs in more than its solver.
    """
    folder, study = session.folder, session.study
    solver = _changed(folder, study)
    folder.tidy()
    place, manifest = folder.path.resolve() / RERUN, folder.manifest
    mark = f"failed runs of {study.digest}"
    if manifest.get(GROWING, mark) != mark:
        folder.remove(RERUN)  # what was begun for something else
    files.write_record(folder.path / MANIFEST, manifest | {GROWING: mark})
    place.mkdir(exist_ok=True)
    again = rerun_of(study, folder.results, place)
    session.note_earlier(manifest)
    with timed(session.seconds, "simulation", without=COMPILING):
        session.compute(again)
    failed = sum(map(again.runs_of, range(len(again))))
    with timed(session.seconds, "writing"):
        still = replace_runs(again, folder, session.origin, solver)
    ending = {"failed": still, "provenance": session.origin}
    manifest.pop(GROWING, None)
    folder.finish(manifest | ending)
    folder.remove(RERUN)
    done, total = session.plan.total - failed, session.plan.total
    return Execution(folder, False, [], total, still, done, True, session.seconds)


def _changed(folder: ResultFolder, study: Study) -> dict[str, Any]:
    """Return the settings of the solver in which a study differs from the result in its folder."""
    manifest = folder.manifest
    if manifest.get("digest") == study.digest:
        return {}
    if not all(line.startswith("solver.") for line in folder.differences(study)):
        raise folder.of_another(
            study, Remedy("failed runs may differ in `solver` only"), OTHER_FOLDER
        )
    old, new = manifest["config"]["solver"], study.numeric_config["solver"]
    return {key: new.get(key) for key in {**old, **new} if old.get(key) != new.get(key)}


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
    root = in_index(study)
    integers = {entry.name for entry in root if entry.dtype is not None and entry.dtype.kind != "f"}
    names = {LAW, SHAPE, *(entry.name for entry in root), *further_variables(study)}
    with open_results(results) as old:
        if set(old.names) - names or integers - set(old.names):
            raise EqtError(
                f"{results}: was written by a version of eqt that stores other variables",
                Remedy("compute its failed runs with that version"),
                OTHER_FOLDER,
            )
        status = old["status"]
    status = status.reshape(-1, *status.shape[-2:]).swapaxes(0, 1)
    by_piece = [status[:, points].reshape(len(status), -1) for points in study.shapes]
    chosen: list[tuple[int, StudyPart]] = []
    for item in range(len(study.plans)):
        index, part = PartTask(study, PartFiles(folder)).part(item)
        statuses = by_piece[index][part.controller, part.start : part.stop]
        if (statuses == Status.WORKER_LOST).all():
            chosen.append((index, part))
            continue
        failed = (part.start + np.flatnonzero(statuses)).tolist()
        chosen += [(index, replace(part, start=entry, stop=entry + 1)) for entry in failed]
    return PartTask(study, PartFiles(folder), tuple(chosen))


def replace_runs(
    task: PartTask, folder: ResultFolder, origin: dict[str, Any], solver: Mapping[str, Any]
) -> int:
    """Rewrite a result with the parts of a task in their places; return its failed runs.

    Parameters
    ----------
    origin
        Where its numbers come from now.
    solver
        Settings that differ from those of the result; then parts that failed again are left out.
    """
    study, parts = task.study, finished_parts(task)
    now = {"provenance": json.dumps(origin, ensure_ascii=False)}
    if solver:
        there = task.finished()
        parts = {
            index: [entry for entry in listed if there[entry[0]].failed < len(entry[1])]
            for index, listed in parts.items()
        }
        now |= _noted(study, folder, parts, solver)
    with step(PACKING, len(task)):
        for index, path in enumerate(folder.files_of(study)):
            piece = study.piece(index)
            with open_results(path) as old, new_result_file(piece, path) as file:
                _copy(file, old, stored_quantities(piece))
                for name, values in ((task.shared(index) if solver else None) or {}).items():
                    if name in old.names and not np.isfinite(old[name]).all():  # it failed, too
                        file.put(name, values[:: study.base.config.store.decimate])
                put_parts(task, piece, parts.get(index, ()), file, {})
                file.describe({**old.attributes, **now})
    if study.is_ragged:
        with open_results(folder.results) as old:
            attributes = {**old.attributes, **now}
        write_index(study, folder.results, attributes)
    with open_results(folder.results) as new:
        return int(np.count_nonzero(new["status"]))


def _noted(
    study: Study,
    folder: ResultFolder,
    parts: Mapping[int, Iterable[tuple[int, StudyPart, Path]]],
    solver: Mapping[str, Any],
) -> dict[str, str]:
    """Return the attribute that says which runs were computed with which settings."""
    labels = list(study.base.loops)
    with open_results(folder.results) as old:
        settings = settings_of(old)
    runs = [
        (labels[part.controller], int(study.shapes[index][point]), run)
        for index, listed in parts.items()
        for _, part, _ in listed
        for point, run in zip(part.points.tolist(), part.run_numbers.tolist(), strict=True)
    ]
    if not runs:
        return {}
    noted = [*settings, Setting(dict(solver), sorted(runs, key=lambda run: (run[1], run[2])))]
    return {SETTINGS: json.dumps([note._asdict() for note in noted])}


def _copy(file: Assembly, old: ResultFile, stored: Iterable[Measure]) -> None:
    """Copy all variables in blocks of rows; numbers that `old` does not hold become NaN."""
    for entry in stored:
        shape = file.shape(entry.name)
        for rows in _rows(shape):
            if entry.name in old.names:
                values = old.read(entry.name, **{old.dims(entry.name)[0]: rows})
            elif entry.dtype is None:
                continue
            else:
                values = np.full((rows.stop - rows.start, *shape[1:]), np.nan)
            file.put(entry.name, values, (rows,))


def _rows(shape: tuple[int, ...]) -> Iterator[slice]:
    """Yield all rows of an array in blocks of at most `COPIED_BYTES`."""
    step = max(1, COPIED_BYTES // (8 * int(np.prod(shape[1:]))))
    for start in range(0, shape[0], step):
        yield slice(start, min(start + step, shape[0]))
