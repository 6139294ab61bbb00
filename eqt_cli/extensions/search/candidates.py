"""Runs of candidates, computed in memory: of points that nobody reads again, nothing is written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from eqt_cli.base.errors import EqtError
from eqt_cli.base.registry import blamed
from eqt_cli.config.study import Study
from eqt_cli.engines.engine import hurried
from eqt_cli.extensions.search.run_numbers import Numbers
from eqt_cli.results.metrics import quantity_of
from eqt_cli.runs.compute_part import compute_part, shared_reference
from eqt_cli.runs.executors import MOST_TRIES, Executor, TaskContext
from eqt_cli.runs.preflight import check_memory, rehearse


@dataclass(frozen=True)
class _Parts:
    """The parts of several studies, numbered one after the other, as a task of an executor.

    Attributes
    ----------
    studies
        Studies without trajectories.
    names
        Metrics to keep; those that imply others are kept, too.
    items
        Study, piece, and part in it.
    """

    studies: tuple[Study, ...]
    names: frozenset[str]
    items: tuple[tuple[int, int, int], ...]
    _references: dict[tuple[int, int], Any] = field(default_factory=dict, init=False)

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"_references": {}}

    def runs_of(self, item: int) -> int:
        study, piece, number = self.items[item]
        return len(self.studies[study].piece(piece).plan.part(number))

    def origin(self) -> dict[str, Any]:
        return {}

    @blamed()
    def __call__(self, item: int, context: TaskContext) -> Any:
        """Compute a part, and return its status and metrics."""
        study, index, number = self.items[item]
        piece = self.studies[study].piece(index)
        with hurried():
            if (study, index) not in self._references:
                shared = None if piece.desired_varies else shared_reference(piece)
                self._references[study, index] = shared
            shared = self._references[study, index]
            slab = compute_part(piece, piece.plan.part(number), shared, context)
        return {name: slab.data[name] for name in {"status", *self.names} & slab.data.keys()}


def computed(
    studies: Sequence[Study], names: Sequence[str], executor: Executor, *, tried: bool = False
) -> list[Numbers]:
    """Compute several studies, each of one law, side by side, and return their numbers.

    Parameters
    ----------
    tried
        Whether others like them were computed before, so that nothing has to be tried.

    Raises
    ------
    EqtError
        If workers are lost.
    """
    implying = {quantity_of(name).implied_by for name in names} - {""}
    stored = frozenset({*names, *implying, "settling_time"})
    if not tried:
        for study in studies:
            check_memory(study)
            rehearse(study)
    items = tuple(
        (k, index, number)
        for k, study in enumerate(studies)
        for index in range(len(study.shapes))
        for number in range(len(study.piece(index).plan))
    )
    task, numbers = _Parts(tuple(studies), stored, items), [_blank(study) for study in studies]
    for outcome in executor.outcomes(task, range(len(items))):
        if outcome.value is None:
            raise EqtError(
                f"a worker was lost {MOST_TRIES} times (killed, or out of memory); run the same "
                "command again, with fewer workers"
            )
        k, index, number = items[outcome.item]
        part = studies[k].piece(index).plan.part(number)
        points = np.array(studies[k].shapes[index])[part.points]
        for name, values in outcome.value.items():
            into = numbers[k].status
            if name != "status":
                none = np.full(into.shape, np.nan)
                into = numbers[k].stored.setdefault(name, none)
            into[points, 0, part.run_numbers] = values
    return numbers


def _blank(study: Study) -> Numbers:
    points = range(len(study))
    horizons = np.array([study.experiment(point).times[-1] for point in points])
    custom = {metric.name: quantity_of(metric.name) for metric in study.base.metrics}
    status = np.ones((len(study), 1, study.base.config.ensemble.runs), dtype=int)
    return Numbers(status, {}, horizons, custom)
