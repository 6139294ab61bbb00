"""From the files of all parts to the one result file, part by part, so that the memory suffices."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import ResultError
from eqt_cli.ensemble.parts import Part
from eqt_cli.experiment.compute import CHECK_STATES, read_part
from eqt_cli.experiment.cross_check import CrossCheck, chosen_entries, cross_check
from eqt_cli.experiment.describe import Per, Quantity, coordinates, quantities
from eqt_cli.experiment.part_files import PartFiles
from eqt_cli.experiment.study import Study
from eqt_cli.store.assembly import Assembly, Blank, assemble
from eqt_cli.store.reader import Results, open_results
from eqt_cli.store.variables import Attribute, Variable


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
    return _Packing(study, files).write(results, attributes)


class Frame:
    """The result file of a study before anything is in it."""

    def __init__(self, study: Study) -> None:
        self.study, self.plan = study, study.plan
        self.quantities = [entry for entry in quantities(study.base) if self._is_kept(entry)]
        self.varies = {Per.INITIAL: study.initial_varies, Per.DESIRED: study.desired_varies}

    @contextmanager
    def assembled(self, path: Path) -> Iterator[Assembly]:
        """The file, which appears when the block ends."""
        base = self.study.base
        found = coordinates(base, self.study.kept) | swept_coordinates(self.study)
        blanks = {
            entry.name: Blank(self._dims(entry), entry.dtype, entry.attributes)
            for entry in self.quantities
        }
        sizes = {name: len(found[name].data) for name in found if found[name].dims == (name,)}
        if self.study.sweep:
            sizes = {"point": len(self.study)} | sizes
        gzip = base.config.store.compression == "gzip"
        with assemble(path, sizes, found, blanks, "gzip" if gzip else None) as file:
            yield file

    def _is_kept(self, quantity: Quantity) -> bool:
        if quantity.per is Per.TRAJECTORY:
            return self.study.kept > 0
        return quantity.per is not Per.DESIRED or self.study.keeps_desired

    def _of(self, per: Per) -> Iterator[Quantity]:
        return (entry for entry in self.quantities if entry.per is per)

    def _dims(self, quantity: Quantity) -> tuple[str, ...]:
        point = ("point",) if self.study.sweep and self.varies.get(quantity.per, True) else ()
        stored = "run" if self.study.kept == self.plan.runs else "stored_run"
        leading = {
            Per.TRAJECTORY: ("controller", stored),
            Per.RUN: ("controller", "run"),
            Per.INITIAL: ("run",),
            Per.DESIRED: (),
        }
        return (*point, *leading[quantity.per], *quantity.dims)


class _Packing(Frame):
    def __init__(self, study: Study, files: PartFiles) -> None:
        super().__init__(study)
        self.files = files
        self.chosen = chosen_entries(study)
        length = next(iter(study.base.loops.values())).state_length
        shape = (len(self.chosen), study.base.config.time.samples, length)
        self.states = {label: np.full(shape, np.nan) for label in study.base.loops}

    def write(self, path: Path, attributes: Mapping[str, Attribute]) -> CrossCheck | None:
        with self.assembled(path) as file:
            if not self.study.desired_varies:
                self._add_reference(file)
            for number, listed in sorted(self.files.listed().items()):
                with _opened(listed.path, self.study) as results:
                    try:
                        self._add(file, self.plan.part(number), results)
                    except ResultError as error:
                        raise BrokenPart(listed.path, str(error)) from error
            check = cross_check(self.study, self.states)
            fields = {} if check is None else asdict(check)
            checked = {f"cross_check_{name}": value for name, value in fields.items()}
            file.describe({**attributes, **checked})
        return check

    def _add_reference(self, file: Assembly) -> None:
        with _opened(self.files.reference, self.study) as shared:
            try:
                for entry in self._of(Per.DESIRED):
                    file.put(entry.name, shared.read(entry.name, reference=0))
            except ResultError as error:
                raise BrokenPart(self.files.reference, str(error)) from error

    def _add(self, file: Assembly, part: Part, results: Results) -> None:
        """Put everything that a part holds in its place."""
        label = list(self.study.base.loops)[part.controller]
        found = read_part(results, self.quantities)
        for entry in self.quantities:
            if entry.name not in found:
                continue
            data = found[entry.name]
            if entry.per is Per.RUN:
                self._put(file, entry, data, part, self.plan.runs)
            elif entry.per is Per.TRAJECTORY:
                self._put(file, entry, data, part, self.study.kept)
            elif entry.per is Per.INITIAL:
                self._put_initial(file, entry, data, part)
            elif part.controller == 0:
                # A point that is cut belongs to the part where it starts.
                points = np.unique(part.points)
                own = points * self.plan.runs >= part.start
                if own.any():
                    first, last = int(points[own][0]), int(points[own][-1])
                    file.put(entry.name, data[own], (slice(first, last + 1),))
        here = (self.chosen >= part.start) & (self.chosen < part.stop)
        if here.any():
            self.states[label][here] = results[CHECK_STATES]

    def _put(self, file: Assembly, entry: Quantity, data: Array, part: Part, kept: int) -> None:
        for slab in part.slabs(kept):
            block = data[slab.rows].reshape(*slab.shape, *data.shape[1:])
            if self.study.sweep:
                file.put(entry.name, block, (slab.points, part.controller, slab.runs))
            else:
                file.put(entry.name, block[0], (part.controller, slab.runs))

    def _put_initial(self, file: Assembly, entry: Quantity, data: Array, part: Part) -> None:
        if self.study.initial_varies:
            for slab in part.slabs():
                block = data[slab.rows].reshape(*slab.shape, *data.shape[1:])
                file.put(entry.name, block, (slab.points, slab.runs))
        else:
            file.put(entry.name, data, (slice(part.start, part.start + len(data)),))


def swept_coordinates(study: Study) -> dict[str, Variable]:
    """One coordinate along `point` for every swept key: numbers, text, or an index with labels."""
    if study.sweep is None:
        return {}
    found = {}
    columns = list(zip(*map(study.sweep.values, range(len(study))), strict=True))
    for key, values in zip(study.sweep.keys, columns, strict=True):
        name = key.replace("[", ".").replace("]", "")
        attributes = {"long_name": f"{key}, swept", "key": key}
        if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
            found[name] = Variable(("point",), np.array(values), attributes)
        elif all(isinstance(value, str) for value in values):
            found[name] = Variable(("point",), np.array(values, dtype=object), attributes)
        else:
            labels = [json.dumps(value, ensure_ascii=False) for value in values]
            index = {label: k for k, label in enumerate(dict.fromkeys(labels))}
            numbers = np.array([index[label] for label in labels])
            found[name] = Variable(("point",), numbers, attributes)
            found[f"{name}.label"] = Variable(
                ("point",), np.array(labels, dtype=object), {"long_name": f"{key}, as JSON"}
            )
    return found


def _opened(path: Path, study: Study) -> Results:
    try:
        results = open_results(path)
    except ResultError as error:
        raise BrokenPart(path, str(error)) from error
    if results.attributes.get("digest", study.digest) != study.digest:
        results.close()
        raise BrokenPart(path, f"{path}: is a part of another experiment")
    return results


def titles(study: Study) -> dict[str, str]:
    """How every controller is written in figures: by its law's title unless it has a label."""
    laws = {label: loop.controller for label, loop in study.base.loops.items()}
    return {label: law.title if label == law.name else label for label, law in laws.items()}


def described(
    study: Study, provenance: dict[str, Any], config: str, plugins: str
) -> dict[str, Any]:
    """The attributes with which a result can be understood and run again."""
    return {
        "title": study.name,
        "config": config,
        "plugins": plugins,
        "digest": study.digest,
        "group": study.base.group.name,
        "titles": json.dumps(titles(study), ensure_ascii=False),
        "provenance": json.dumps(provenance, ensure_ascii=False),
        "source": "Hampsey, van Goor, Banavar, Mahony (2025), arXiv 2511.18800",
    }
