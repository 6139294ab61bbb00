"""Packs the files of parts into the result file, part by part to limit the memory."""

import time
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import ResultError
from eqt_cli.core.reporting import reporter, step
from eqt_cli.execution.compute_part import PartTask, checked_states, read_part
from eqt_cli.execution.cross_check import LEAST_SECONDS, chosen_entries, cross_check, together
from eqt_cli.execution.provenance import timed
from eqt_cli.execution.result_layout import (
    Destination,
    Layout,
    NewResultFile,
    in_root,
    new_result_file,
)
from eqt_cli.experiment.parts import StudyPart
from eqt_cli.experiment.study import Study
from eqt_cli.results.quantity import Quantity, ValuePer
from eqt_cli.store.reader import ResultFile, open_results
from eqt_cli.store.writer import Assembly, Attribute

PACKING, CHECKING = "parts packed", "runs cross-checked"
"""Titles of the steps."""

_ByController = dict[int, dict[str, list[Array]]]

COPIED_BYTES = 64 * 2**20


class BrokenPart(ResultError):
    """A part that cannot be read and must be computed again.

    Attributes
    ----------
    path
        File of the part.
    """

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(reason)
        self.path = path


def pack(
    task: PartTask, results: Path, attributes: Mapping[str, Attribute], seconds: dict[str, float]
) -> None:
    """Write the result file from all parts, which must exist.

    Parameters
    ----------
    seconds
        Wall times of what was done; receives that of the cross-check, which may take as long as the
        simulation, and at least `LEAST_SECONDS`.

    Raises
    ------
    BrokenPart
        If a part cannot be read; then no file is written.
    ResultError
        If the file cannot be written.
    """
    study = task.study
    with new_result_file(study, results) as file:
        for index, place in enumerate(file.places):
            shared, decimate = task.shared(index), study.base.config.store.decimate
            for name, values in (shared or {}).items():
                place.put(name, values[::decimate])
        with step(PACKING, len(task)):
            states, work = _put_parts(task, file)
        pieces = [study.piece(index) for index in range(len(study.shapes))]
        redone = sum(len(chosen_entries(piece)) * len(piece.base.loops) for piece in pieces)
        deadline = time.monotonic() + max(LEAST_SECONDS, seconds.get("simulation", 0.0))
        with timed(seconds, "cross-check"), step(CHECKING, redone):
            check = together(
                [cross_check(piece, states[k], work[k], deadline) for k, piece in enumerate(pieces)]
            )
        fields = {} if check is None else asdict(check)
        checked = {f"cross_check_{name}": value for name, value in fields.items()}
        file.root.describe({**attributes, **checked})


def replace_runs(task: PartTask, results: Path, attributes: Mapping[str, Attribute]) -> int:
    """Rewrite a result file with the parts of a task in their places; return its failed runs.

    Parameters
    ----------
    attributes
        Attributes that change.
    """
    with open_results(results) as old, new_result_file(task.study, results) as file:
        layout = Layout(task.study.piece(0))
        _copy(file.root, old, in_root(task.study))
        for point, group in enumerate(file.groups):
            _copy(group, old.at(point), layout.quantities)
        for written in (file.root, *file.groups):
            written.replaces = True
        with step(PACKING, len(task)):
            _put_parts(task, file)
        file.root.describe({**old.attributes, **attributes})
    with open_results(results) as new:
        return int(np.count_nonzero(new["status"]))


def _copy(file: Assembly, old: ResultFile, kept: Iterable[Quantity]) -> None:
    """Copy all variables in blocks of rows; numbers that `old` does not hold become NaN."""
    for name in old.names:
        for rows in _rows(file.shape(name)):
            file.put(name, old.read(name, **{old.dims(name)[0]: rows}), (rows,))
    for entry in kept:
        if entry.dtype is not None and entry.name not in old.names:
            _, *others = shape = file.shape(entry.name)
            for rows in _rows(shape):
                file.put(entry.name, np.full((rows.stop - rows.start, *others), np.nan), (rows,))


def _rows(shape: tuple[int, ...]) -> Iterator[slice]:
    """Yield all rows of an array in blocks of at most `COPIED_BYTES`."""
    step = max(1, COPIED_BYTES // (8 * int(np.prod(shape[1:]))))
    for start in range(0, shape[0], step):
        yield slice(start, min(start + step, shape[0]))


def _put_parts(task: PartTask, file: NewResultFile) -> tuple[_ByController, _ByController]:
    """Write the content of all finished parts into the result file.

    Returns
    -------
    states, work
        Inputs of the cross-check by piece and controller: the states of the chosen runs, and the
        work of all runs.
    """
    states: _ByController = defaultdict(lambda: defaultdict(list))
    work: _ByController = defaultdict(lambda: defaultdict(list))
    for item, listed in sorted(task.files.listed().items()):
        index, part = task.part(item)
        study, place = task.study.piece(index), file.places[index]
        layout = Layout(study)
        label, loop = list(study.base.loops.items())[part.controller]
        try:
            with task.opened(item, listed.path) as results:
                digest = task.study.digest
                if results.attributes.get("digest", digest) != digest:
                    raise ResultError(f"{listed.path}: is a part of another experiment")
                found = read_part(results, layout.quantities)
                for entry in layout.quantities:
                    if entry.name in found:
                        _put(place, layout, entry, found[entry.name], part)
                chosen = chosen_entries(study)
                if ((chosen >= part.start) & (chosen < part.stop)).any():
                    states[index][label].append(checked_states(results, loop.layout))
                if "steps" in found:
                    work[index][label].append(found["steps"])
        except ResultError as error:
            raise BrokenPart(listed.path, str(error)) from error
        reporter().advance(1)
    return states, work


def _put(place: Destination, layout: Layout, entry: Quantity, data: Array, part: StudyPart) -> None:
    """Write the values of a quantity in a part into the result file."""
    study: Study = layout.study
    if entry.per is ValuePer.DESIRED:  # a point cut by parts belongs to its first one
        points = np.unique(part.points)
        own = points * part.runs >= part.start
        if own.any():
            first, last = int(points[own][0]), int(points[own][-1])
            place.put(entry.name, data[own], (slice(first, last + 1),))
    elif entry.per is ValuePer.INITIAL and not study.initial_varies:
        place.put(entry.name, data, (slice(part.start, part.start + len(data)),))
    else:
        controller = () if entry.per is ValuePer.INITIAL else (part.controller,)
        for slab in part.slabs(study.kept if entry.per is ValuePer.TRAJECTORY else part.runs):
            block = data[slab.rows].reshape(*slab.shape, *data.shape[1:])
            where = (*controller, slab.runs)
            if study.sweep:
                place.put(entry.name, block, (slab.points, *where))
            else:
                place.put(entry.name, block[0], where)
