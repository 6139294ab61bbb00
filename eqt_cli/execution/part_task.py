"""What a worker does: open the study once, compute the parts that it is told, and save them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.blame import blamed
from eqt_cli.core.errors import ResultError
from eqt_cli.execution.compute import (
    REFERENCE_STATES,
    OutdatedPart,
    check_part,
    compute_part,
    lost_part,
    reference_table,
)
from eqt_cli.execution.executors import TaskContext
from eqt_cli.execution.part_files import PartFiles
from eqt_cli.execution.result_layout import Layout
from eqt_cli.experiment.study import Study
from eqt_cli.store.reader import open_results
from eqt_cli.store.variables import Table


@dataclass(frozen=True, eq=False)
class PartTask:
    """Computes parts of a study into a folder; it can be sent to other processes."""

    study: Study
    files: PartFiles

    @blamed()
    def __call__(self, item: int, context: TaskContext) -> int:
        """Compute and save one part; returns how many of its runs failed."""
        index, number = self.study.plans.where(item)
        piece = self.study.piece(index)
        return self.save(
            item, compute_part(piece, piece.plan.part(number), self.shared(index), context)
        )

    def lose(self, item: int, message: str) -> int:
        """Save a part that could not be computed; returns the number of its runs."""
        index, number = self.study.plans.where(item)
        piece = self.study.piece(index)
        return self.save(item, lost_part(piece, piece.plan.part(number), message))

    @blamed()
    def prepare(self) -> None:
        """Save what all parts of a piece need, unless it is there."""
        for index in range(len(self.study.shapes)):
            piece, path = self.study.piece(index), self.files.reference(index)
            if not piece.desired_varies and not path.exists():
                self.files.save_reference(index, reference_table(piece))

    def is_outdated(self, item: int, path: Path) -> bool:
        """Whether a part was written by a version of eqt that did not keep all of this one's."""
        index, _ = self.study.plans.where(item)
        try:
            with open_results(path) as results:
                check_part(results, Layout(self.study.piece(index)).quantities)
        except OutdatedPart:
            return True
        except ResultError:
            return False  # but damaged: whoever reads all of it finds that too
        return False

    def runs_of(self, item: int) -> int:
        """The number of runs of a part."""
        return self.study.plans.runs_of(item)

    @cached_property
    def shared(self) -> Callable[[int], Array | None]:
        """The states of the reference that all points of a piece share; None where each has one."""
        return lru_cache(maxsize=None)(self._shared)

    def _shared(self, index: int) -> Array | None:
        if self.study.piece(index).desired_varies:
            return None
        with open_results(self.files.reference(index)) as results:
            return results.read(REFERENCE_STATES)[0]

    def save(self, item: int, table: Table) -> int:
        """Save a finished part as one of this study; returns how many of its runs failed."""
        failed = int(np.count_nonzero(table.variables["status"].data))
        attributes = {**table.attributes, "digest": self.study.digest}
        self.files.save(item, Table(table.variables, {}, attributes), failed)
        return failed

    def __getstate__(self) -> dict[str, Any]:
        return {"study": self.study, "files": self.files}
