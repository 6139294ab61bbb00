"""The task of a worker: computes parts of a study and saves them."""

from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.core.error_origin import blamed
from eqt_cli.core.errors import ResultError
from eqt_cli.execution.compute_part import (
    Desired,
    KeptPart,
    StoredPart,
    compute_part,
    lost_part,
    reference_table,
)
from eqt_cli.execution.executors import TaskContext
from eqt_cli.execution.part_files import PartFiles
from eqt_cli.experiment.parts import StudyPart
from eqt_cli.experiment.study import Study
from eqt_cli.results.quantity_table import DESIRED
from eqt_cli.store.reader import open_results
from eqt_cli.store.table import Table

KEPT_BYTES = 64 * 2**20
"""Largest size of finished parts kept in memory, so that packing need not read their files."""


@dataclass(frozen=True, eq=False)
class PartTask:
    """Computes parts of a study into a folder; it can be sent to other processes.

    Attributes
    ----------
    chosen
        The parts to compute, each with the index of its piece of the study; None for all parts of
        the study's plan.
    keeps
        Whether saved parts also stay in memory, up to `KEPT_BYTES`, until they are packed. Copies
        of the task in other processes keep none.
    """

    study: Study
    files: PartFiles
    chosen: tuple[tuple[int, StudyPart], ...] | None = None
    keeps: bool = False
    _kept: dict[int, Table] = field(default_factory=dict, init=False)
    """Saved parts that are also in memory, by number."""

    def __len__(self) -> int:
        return len(self.study.plans) if self.chosen is None else len(self.chosen)

    def part(self, item: int) -> tuple[int, StudyPart]:
        """Return the index of the piece of the study, and the part."""
        if self.chosen is not None:
            return self.chosen[item]
        index, number = self.study.plans.where(item)
        return index, self.study.piece(index).plan.part(number)

    def runs_of(self, item: int) -> int:
        """Return the number of runs of a part."""
        return len(self.part(item)[1])

    def missing(self, wanted: Iterable[int] | None = None) -> list[int]:
        """Return the numbers of the missing parts, among all or the wanted ones."""
        there = self.files.listed()
        return [n for n in (range(len(self)) if wanted is None else wanted) if n not in there]

    @blamed()
    def __call__(self, item: int, context: TaskContext) -> int:
        """Compute and save one part; returns how many of its runs failed."""
        index, part = self.part(item)
        piece = self.study.piece(index)
        return self._save(item, compute_part(piece, part, self.shared(index), context))

    def lose(self, item: int, message: str) -> int:
        """Save a part that could not be computed; returns the number of its runs."""
        index, part = self.part(item)
        return self._save(item, lost_part(self.study.piece(index), part, message))

    def _save(self, item: int, table: Table) -> int:
        failed = int(np.count_nonzero(table.variables["status"].data))
        attributes = {**table.attributes, "digest": self.study.digest}
        whole = Table(table.variables, {}, attributes)
        self.files.save(item, whole, failed)
        self._kept.pop(item, None)
        if self.keeps and _bytes(whole, *self._kept.values()) <= KEPT_BYTES:
            self._kept[item] = whole
        return failed

    def opened(self, item: int, path: Path) -> AbstractContextManager[StoredPart]:
        """Open a finished part: from memory the first time if it is there, else from its file."""
        if item in self._kept:
            return nullcontext(KeptPart(path, self._kept.pop(item)))
        return open_results(path)

    @blamed()
    def prepare(self) -> None:
        """Save the shared references of the pieces that have no complete file yet."""
        for index in range(len(self.study.shapes)):
            piece = self.study.piece(index)
            if not (piece.desired_varies or self._has_reference(index)):
                self.files.write(self.files.reference(index), reference_table(piece))

    def _has_reference(self, index: int) -> bool:
        try:
            with open_results(self.files.reference(index)) as results:
                return all(map(results.has, DESIRED))
        except ResultError:
            return False

    @cached_property
    def shared(self) -> Callable[[int], Desired | None]:
        """Returns the reference that all points of a piece share; None if each has its own."""
        return lru_cache(maxsize=None)(self._shared)

    def _shared(self, index: int) -> Desired | None:
        if self.study.piece(index).desired_varies:
            return None
        with open_results(self.files.reference(index)) as results:
            return {name: results[name] for name in DESIRED}

    def __getstate__(self) -> dict[str, Any]:
        return {"study": self.study, "files": self.files, "chosen": self.chosen, "_kept": {}}


def _bytes(*tables: Table) -> int:
    return sum(entry.data.nbytes for table in tables for entry in table.variables.values())
