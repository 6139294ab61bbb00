"""From the files of all parts to the one result file, part by part, so that the memory suffices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import ResultError
from eqt_cli.execution.compute import CHECK_STATES, read_part
from eqt_cli.execution.cross_check import chosen_entries, cross_check, together
from eqt_cli.execution.part_files import FinishedPart, PartFiles
from eqt_cli.execution.result_layout import Destination, Layout, new_result_file
from eqt_cli.experiment.plan import Part
from eqt_cli.experiment.study import Study
from eqt_cli.results.quantity import Per, Quantity
from eqt_cli.results.result import CrossCheck
from eqt_cli.store.reader import ResultFile, open_results
from eqt_cli.store.variables import Attribute


class BrokenPart(ResultError):
    """A part that cannot be read, so that it has to be computed again.

    Attributes
    ----------
    path
        Its file.
    """

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(reason)
        self.path = path


def pack(
    study: Study, files: PartFiles, results: Path, attributes: Mapping[str, Attribute]
) -> CrossCheck | None:
    """Write the result file from the parts, all of which must exist.

    Raises
    ------
    BrokenPart
        If one cannot be read; no file is written then.
    ResultError
        If the disk refuses.
    """
    by_piece: list[list[tuple[int, FinishedPart]]] = [[] for _ in study.shapes]
    for number, listed in sorted(files.listed().items()):
        index, inner = study.plans.where(number)
        by_piece[index].append((inner, listed))
    with new_result_file(study, results) as file:
        checks = [
            _Packing(study, index, place, files).fill(by_piece[index])
            for index, place in enumerate(file.places)
        ]
        check = together(checks)
        fields = {} if check is None else asdict(check)
        checked = {f"cross_check_{name}": value for name, value in fields.items()}
        file.root.describe({**attributes, **checked})
    return check


class _Packing:
    """Brings the parts of one piece of a study to their places."""

    def __init__(self, whole: Study, index: int, place: Destination, files: PartFiles) -> None:
        self.study, self.place, self.digest = whole.piece(index), place, whole.digest
        self.plan, self.layout = self.study.plan, Layout(self.study)
        self.reference = None if self.study.desired_varies else files.reference(index)
        self.chosen = chosen_entries(self.study)
        base = self.study.base
        shape = len(self.chosen), base.config.time.samples
        self.states = {
            label: np.full((*shape, loop.state_length), np.nan)
            for label, loop in base.loops.items()
        }

    def fill(self, parts: Sequence[tuple[int, FinishedPart]]) -> CrossCheck | None:
        if self.reference is not None:
            self._add_reference(self.reference)
        for number, listed in parts:
            with _opened(listed.path, self.digest) as results:
                try:
                    self._add(self.plan.part(number), results)
                except ResultError as error:
                    raise BrokenPart(listed.path, str(error)) from error
        return cross_check(self.study, self.states)

    def _add_reference(self, path: Path) -> None:
        with _opened(path, self.digest) as shared:
            try:
                for entry in self.layout.of(Per.DESIRED):
                    self.place.put(entry.name, shared.read(entry.name, reference=0))
            except ResultError as error:
                raise BrokenPart(path, str(error)) from error

    def _add(self, part: Part, results: ResultFile) -> None:
        """Put everything that a part holds in its place."""
        label = list(self.study.base.loops)[part.controller]
        found = read_part(results, self.layout.quantities)
        for entry in self.layout.quantities:
            if entry.name not in found:
                continue
            data = found[entry.name]
            if entry.per is Per.RUN:
                self._put(entry, data, part, self.plan.runs)
            elif entry.per is Per.TRAJECTORY:
                self._put(entry, data, part, self.study.kept)
            elif entry.per is Per.INITIAL:
                self._put_initial(entry, data, part)
            elif part.controller == 0:
                put_desired(self.place, entry.name, data, part)
        here = (self.chosen >= part.start) & (self.chosen < part.stop)
        if here.any():
            self.states[label][here] = results[CHECK_STATES]

    def _put(self, entry: Quantity, data: Array, part: Part, kept: int) -> None:
        for slab in part.slabs(kept):
            block = data[slab.rows].reshape(*slab.shape, *data.shape[1:])
            if self.study.sweep:
                self.place.put(entry.name, block, (slab.points, part.controller, slab.runs))
            else:
                self.place.put(entry.name, block[0], (part.controller, slab.runs))

    def _put_initial(self, entry: Quantity, data: Array, part: Part) -> None:
        if self.study.initial_varies:
            for slab in part.slabs():
                block = data[slab.rows].reshape(*slab.shape, *data.shape[1:])
                self.place.put(entry.name, block, (slab.points, slab.runs))
        else:
            self.place.put(entry.name, data, (slice(part.start, part.start + len(data)),))


def put_desired(place: Destination, name: str, data: Array, part: Part) -> None:
    """Put what a part holds of references; a point that is cut belongs to where it starts."""
    points = np.unique(part.points)
    own = points * part.runs >= part.start
    if own.any():
        first, last = int(points[own][0]), int(points[own][-1])
        place.put(name, data[own], (slice(first, last + 1),))


def _opened(path: Path, digest: str) -> ResultFile:
    try:
        results = open_results(path)
    except ResultError as error:
        raise BrokenPart(path, str(error)) from error
    if results.attributes.get("digest", digest) != digest:
        results.close()
        raise BrokenPart(path, f"{path}: is a part of another experiment")
    return results
