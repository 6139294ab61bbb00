"""Tunes a law on a task and judges it: on the held-out runs that are the same for all laws."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.api.running import choose_executor
from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import ConfigError, EqtError
from eqt_cli.base.extensions import functions_for
from eqt_cli.base.reporting import RUNS_DONE, step, working_for
from eqt_cli.config.document import Document, expanded
from eqt_cli.config.study import Study, study
from eqt_cli.extensions.search.candidates import computed
from eqt_cli.extensions.search.exchanges import unfinished
from eqt_cli.extensions.search.law_search import SearchFolder
from eqt_cli.extensions.search.record import AS_IT_IS, TUNE
from eqt_cli.extensions.search.training import trained
from eqt_cli.extensions.search.tune import Sampled, Search
from eqt_cli.extensions.suite.entrants import Law, starting
from eqt_cli.extensions.suite.tasks import Task
from eqt_cli.runs.executors import Executor
from eqt_cli.runs.lock import LOCK, locked

Values = dict[str, Any]
"""Gains and own numbers by the keys of a task's configuration."""


@dataclass(frozen=True, eq=False)
class Judged:
    """A law on a task.

    Attributes
    ----------
    values
        What was found on each training sample; None where no point will do. Of a law without
        anything to tune, or with stated gains, a single one.
    errors : (samples, runs)
        The objective of each held-out run; NaN where it failed, or at a sample without gains.
    spent : (samples,)
        What it spends on the held-out runs, in the mean.
    trained : (samples,)
        What it spends on the training runs, in the mean; NaN without a search.
    start
        Mean of the objective at the starting gains; NaN if it is not known.
    is_stated
        Whether its user states the gains.
    seconds
        What it took of the processor, s.
    why
        Why there are no gains on some sample.
    gained : (samples,)
        By what share the last exchange between samples lowered the objective of the search; NaN
        without an exchange, and empty without a search.
    """

    values: tuple[Values | None, ...]
    errors: Array
    spent: Array
    trained: Array
    start: float = math.nan
    is_stated: bool = False
    seconds: float = 0.0
    why: str = ""
    gained: Array = field(default_factory=lambda: np.empty(0))

    @property
    def is_finished(self) -> bool:
        """Whether the search for its gains is finished, or there was none."""
        return not unfinished([None if math.isnan(x) else x for x in self.gained.tolist()])

    @property
    def failed(self) -> int:
        """Number of the held-out runs that failed, at gains that were found."""
        return int(np.isnan(self.errors[self.with_gains]).sum())

    @property
    def runs(self) -> int:
        """Number of the held-out runs at gains that were found."""
        return int(self.with_gains.sum()) * self.errors.shape[1]

    @property
    def with_gains(self) -> Array:
        """Whether there are gains, by sample."""
        return np.array([values is not None for values in self.values])

    @property
    def is_whole(self) -> bool:
        """Whether it has gains on every sample, and no held-out run failed."""
        return bool(np.isfinite(self.errors).all())


def search_of(law: Law, task: Task) -> Search | None:
    """Return the search for a law in a task; None if there is nothing to tune.

    Raises
    ------
    ConfigError
        If the law does not fit the task.
    """
    document, section = law.in_task(task), task.section
    over = law.over(task)
    settings = {
        "over": over,
        "objective": section.objective,
        "equal": section.equal,
        "samples": section.search.samples,
        "budget": section.search.budget(len(over)),
        "confirm": {"runs": section.judge.runs, "seed": section.judge.seed},
    }
    ensemble = {"runs": section.search.runs, "seed": section.search.seed}
    solver = _in_memory(document)
    data = document.data | {"ensemble": ensemble, "tune": settings, "solver": solver}
    if not over or _reads_nothing(replace(document, data=data), over):
        return None
    return Search.read(replace(document, data=data))


def _reads_nothing(document: Document, over: Mapping[str, Any]) -> bool:
    """Whether a law reads none of the keys, as a network reads no gains."""
    if not all(key.startswith("gains.") for key in over):
        return False
    without = {key: value for key, value in document.data.items() if key != "tune"}
    experiment = study(replace(document, data=without)).base
    return not experiment.loop.controller.reads_gains


def _in_memory(document: Document) -> dict[str, Any]:
    solver = dict(document.data.get("solver") or {})
    return solver | {"error_estimate": False, "cross_check": 0}


def tuned(law: Law, task: Task, out: Path, workers: int, *, force: bool = False) -> Judged:
    """Tune a law on a task and judge it; what the folder holds of the search is used again."""
    before = _cpu_seconds()
    search = search_of(law, task)
    if search is None:
        return judged(law, task, [{}], workers)
    folder = SearchFolder(out, TUNE)
    folder.check(search.laws)
    budget = search.searched_runs
    with locked(out, name=f"{LOCK}-{TUNE.command}"), ExitStack() as stack:
        folder.claim(search.settings, force)
        earlier = (TUNE.record_in(out) or {}).get("seconds", 0.0)
        executor = choose_executor(Study(None, search.base), workers)
        opened = stack.enter_context(executor.opened(out))
        stack.enter_context(working_for(f"{law.label} on {task.name}"))
        stack.enter_context(step(RUNS_DONE, budget))
        best = {key.sample: one for key, one in trained(search, folder, opened).items()}
        of_law = Sampled(search, search.laws[0], best)
        if of_law.winner is not None:
            config = study(search.laws[0].at(of_law.values(of_law.winner)))
            folder.write_configs(search.laws[0], [config])
        searched = earlier + _cpu_seconds() - before
        folder.write_record(search.settings | {"seconds": searched})
        after = _cpu_seconds()
    values = [None if x.point is None else of_law.values(k) for k, x in of_law.best.items()]
    outcome = _judged(law, task, values, workers)
    record = of_law.record()
    return replace(
        outcome,
        trained=np.array(
            [
                math.nan if x.point is None else float(x.tried.measured[x.point, 0])
                for x in best.values()
            ]
        ),
        why=record["why"] or "",
        gained=np.array([math.nan if one.gained is None else one.gained for one in best.values()]),
        seconds=searched + _cpu_seconds() - after,
    )


def judged(law: Law, task: Task, points: Sequence[Values | None], workers: int) -> Judged:
    """Judge a law at stated values."""
    before = _cpu_seconds()
    outcome = _judged(law, task, points, workers, with_start=False)
    return replace(outcome, is_stated=bool(points[0]), seconds=_cpu_seconds() - before)


def _judged(
    law: Law, task: Task, points: Sequence[Values | None], workers: int, *, with_start: bool = True
) -> Judged:
    tried = [values for values in points if values is not None]
    document, start = law.in_task(task), math.nan
    if with_start and tried:
        tried = [*tried, starting(document, tried[0])]
    errors, spent = held_out(document, task, tried, workers)
    if with_start and tried:
        start = float(np.nanmean(errors[-1])) if np.isfinite(errors[-1]).any() else math.nan
    at = iter(range(len(errors)))
    rows = [None if values is None else next(at) for values in points]
    none = np.full(task.section.judge.runs, np.nan)
    return Judged(
        tuple(points),
        np.array([none if row is None else errors[row] for row in rows]),
        np.array([np.nan if row is None else spent[row] for row in rows]),
        np.full(len(points), np.nan),
        start,
    )


def held_out(
    document: Document, task: Task, points: Sequence[Values], workers: int
) -> tuple[Array, Array]:
    """Return the objective of each held-out run, ``(points, runs)``, and the mean cost.

    Errors are rounded as the archive keeps them.
    """
    section = task.section
    if not points:
        return np.empty((0, section.judge.runs)), np.empty(0)
    columns = expanded({key: [values[key] for values in points] for key in points[0]})
    sweep = {"zip": columns} if columns else {"cases": {AS_IT_IS: {}}}
    data = document.data | {
        "ensemble": {"runs": section.judge.runs, "seed": section.judge.seed},
        "sweep": [sweep],
        "solver": _in_memory(document),
        "store": {"trajectories": "none"},
    }
    swept, (cost, _) = study(replace(document, data=data)), task.cost
    _refuse_runs_of_training(swept, task)
    executor: Executor = choose_executor(swept, workers)
    with working_for(f"held-out runs of {task.name}"), step(RUNS_DONE, swept.plans.total):
        (numbers,) = computed([swept], [section.objective, cost], executor)
    errors = numbers.counted(section.objective)[:, 0]
    costs = numbers.counted(cost)[:, 0]
    spent = [row[np.isfinite(row)].mean() if np.isfinite(row).any() else np.nan for row in costs]
    return errors.astype(np.float32).astype(float), np.array(spent)


def _refuse_runs_of_training(judged: Study, task: Task) -> None:
    """Refuse a law that was trained on the runs that judge it."""
    for sentences in functions_for(purposes.laws_that_runs_flatter):
        for said in sentences(judged.document, f"those of {task.name}"):
            name = task.section.name
            raise EqtError(f"{said}; train it by another seed, as eqt_cli.gym.make('{name}') does")


def fits(law: Law, task: Task) -> str:
    """Say why a law does not fit a task; empty if it does."""
    if law.only and task.name not in law.only:
        return "the archive does not name this task for it"
    try:
        search_of(law, task)
    except ConfigError as error:
        return str(error)
    return ""


def _cpu_seconds() -> float:
    used = os.times()
    return used.user + used.system + used.children_user + used.children_system
