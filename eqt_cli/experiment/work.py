"""What a worker does: open the study once, compute the parts that it is told, and save them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.ensemble.executors import Ways
from eqt_cli.experiment.compute import REFERENCE_STATES, compute_part, lost_part, reference_table
from eqt_cli.experiment.part_files import PartFiles
from eqt_cli.experiment.study import Study
from eqt_cli.store.reader import open_results
from eqt_cli.store.variables import Table


@dataclass(frozen=True, eq=False)
class Work:
    """Computes parts of a study into a folder; it can be sent to other processes."""

    study: Study
    files: PartFiles

    def __call__(self, item: int, ways: Ways) -> int:
        """Compute and save one part; returns how many of its runs failed."""
        part = self.study.plan.part(item)
        return self._save(item, compute_part(self.study, part, self.shared, ways))

    def lose(self, number: int, message: str) -> int:
        """Save a part that could not be computed; returns the number of its runs."""
        return self._save(number, lost_part(self.study, self.study.plan.part(number), message))

    def prepare(self) -> None:
        """Save what all parts need, unless it is there."""
        if not self.study.desired_varies and not self.files.reference.exists():
            self.files.save_reference(reference_table(self.study))

    def runs_of(self, item: int) -> int:
        """The number of runs of a part."""
        return self.study.plan.runs_of(item)

    @cached_property
    def shared(self) -> Array | None:
        """The states of the reference that all points share; None where each has its own."""
        if self.study.desired_varies:
            return None
        with open_results(self.files.reference) as results:
            return results.read(REFERENCE_STATES)[0]

    def _save(self, number: int, table: Table) -> int:
        failed = int(np.count_nonzero(table.variables["status"].data))
        described = Table(table.variables, table.coordinates, {"digest": self.study.digest})
        self.files.save(number, described, failed)
        return failed

    def __getstate__(self) -> dict[str, Any]:
        return {"study": self.study, "files": self.files}
