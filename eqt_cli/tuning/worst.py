"""The search for the worst run of each law, and the runs around what was found."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial, reduce
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.execution.executors import Executor, Progress
from eqt_cli.execution.lock import LOCK, locked
from eqt_cli.execution.run_study import Execution, Remark
from eqt_cli.experiment.read_study import study
from eqt_cli.results.quantity_table import QUANTITIES
from eqt_cli.results.result import Result, open_result
from eqt_cli.tuning.evolution import Population, selected
from eqt_cli.tuning.folder import WORST, SearchFolder, found_files
from eqt_cli.tuning.generations import Computing, Scored, Told, evolve
from eqt_cli.tuning.law_search import LawSearch
from eqt_cli.tuning.ranking import Scores
from eqt_cli.tuning.record_shape import fits_worst
from eqt_cli.tuning.worst_search import Line, WorstSearch

AGREEING = 0.01
"""Searches agree that find worst values within this share of the worst of all."""


@dataclass(frozen=True)
class Worst:
    """A search for the worst run that has come to its end.

    Attributes
    ----------
    search
        What for.
    along
        The result of all laws at the points along each key.
    record
        What was found, as plain data, as the folder has it.
    """

    search: WorstSearch
    along: Execution
    record: dict[str, Any]


def folder_of(search: WorstSearch) -> Path:
    """Where a search keeps its results unless it is told."""
    return Path("results") / f"{search.name}-worst"


def costs_of_runs(result: Result, metric: str) -> Array:
    """How bad each run is by a metric, as `Result.metric`: ∞ where it failed; NaN has no value."""
    found = result.quantity(metric).cost(result.counted(metric))
    return np.where(result.good, found, np.inf)


def worst_of(costs: Array) -> Array:
    """The largest over the last axis; −∞ where no run has a value."""
    return np.max(np.where(np.isnan(costs), -np.inf, costs), axis=-1)


def badness(metric: str, result: Result) -> Scores:
    """The scores of the points of a sweep with one law: the worse its worst run, the better."""
    worst = worst_of(costs_of_runs(result, metric)[:, 0])
    good = result.good[:, 0]
    late = good & np.isnan(result.metric("settling_time")[:, 0])
    failed, unsettled = (~good).sum(axis=1), late.sum(axis=1)
    return Scores(-worst[:, None], np.zeros(len(worst)), failed, unsettled)


def find_worst(
    search: WorstSearch,
    out: Path,
    *,
    executor: Executor,
    force: bool = False,
    progress: Progress = lambda runs: None,
    resumed: Progress = lambda runs: None,
    remark: Remark,
    told: Told = lambda law, generation, population: None,
) -> Worst:
    """Search for the worst run of each law, and run all laws along each key through it.

    Parameters
    ----------
    out
        The folder; generations that are there are not computed again.
    executor, progress, resumed, remark
        As of `execute`.
    force
        Start over.
    told
        What is told of the search.

    Raises
    ------
    EqtError
        If the folder holds something else, is in use, or cannot be written.
    """
    folder = SearchFolder(out, WORST)
    folder.check(search)
    with locked(out, name=f"{LOCK}-worst", remark=remark):
        folder.claim(search, force)
        do = Computing(executor, progress, resumed, remark)
        found, first = {}, {}
        scored = partial(badness, search.objective)
        for law in search.laws:

            def after(
                generation: int, searches: dict[int, Population], law: LawSearch = law
            ) -> None:
                told(law, generation, reduce(selected, searches.values()))

            found[law.label] = evolve(search, law, folder, do, scored, after)
            first[law.label] = [_first(folder.generation(law, k, 0), scored) for k in search.seeds]
        best = {label: reduce(selected, searches.values()) for label, searches in found.items()}
        lines = search.lines(
            {label: tuple(one.shares[one.best].tolist()) for label, one in best.items()}
        )
        along = do.execute(search.along(lines), out)
        with open_result(out) as result:
            laws = [
                _law_record(search, law, found[law.label], first[law.label], lines, result)
                for law in search.laws
            ]
        for law, told_of in zip(search.laws, laws, strict=True):
            at = study(law.at(_own(law, told_of)), trust_plugins=True)
            folder.write_found(law, [at], said=_said(search, told_of))
        record = _record(search, laws)
        folder.write_record(record)
    return Worst(search, along, record)


def _first(out: Path, scored: Scored) -> Scores:
    """Of the points of a first generation, which are spread evenly over the box."""
    with open_result(out) as result:
        return scored(result)


def _own(law: LawSearch, record: dict[str, Any]) -> dict[str, float]:
    """The values that were found, by the keys of the law's own configuration."""
    return {own: record["values"][key] for own, key in zip(law.axes, law.given, strict=True)}


def _said(search: WorstSearch, record: dict[str, Any]) -> str:
    """What stands above the configuration: which of its runs is meant."""
    what = "failed" if record["failed"] else f"{search.objective} {record['value']!r}"
    return f"# run {record['run']} of {record['label']}: {what}\n"


def _law_record(
    search: WorstSearch,
    law: LawSearch,
    searches: dict[int, Population],
    first: list[Scores],
    lines: list[Line],
    result: Result,
) -> dict[str, Any]:
    """What was found for a law; its worst run is read from the runs along the lines."""
    starts = np.cumsum([0, *(len(line.points) for line in lines)])
    own = [index for index, line in enumerate(lines) if line.law == law.label]
    point = int(starts[own[0]]) + lines[own[0]].found
    position = result.labels.index(law.label)
    costs = costs_of_runs(result, search.objective)[point, position]
    run = int(np.argmax(np.where(np.isnan(costs), -np.inf, costs)))
    values = lines[own[0]].points[lines[own[0]].found]
    worst = {seed: -float(left.scores.objectives[left.best, 0]) for seed, left in searches.items()}
    settles = result.metric("settling_time")[point, position]
    runs = result.runs
    return {
        "label": law.label,
        "config": found_files(WORST, law, 1)[0],
        "over": {
            key: [axis.low, axis.high]
            for key, axis in zip(law.given, law.axes.values(), strict=True)
        },
        "values": {key: values[key] for key in law.given},
        "run": run,
        **_valued(search, float(costs[run])),
        "unsettled": int(runs - np.isfinite(settles).sum()),
        "runs": runs,
        "first": {
            "runs": runs * sum(len(scored) for scored in first),
            "unsettled": int(sum((s.failed + s.unsettled).sum() for s in first)),
        },
        "searches": [{"seed": seed, **_valued(search, cost)} for seed, cost in worst.items()],
        "agreeing": sum(_agree(cost, max(worst.values())) for cost in worst.values()),
        "lines": [
            {"key": lines[index].key, "points": [int(starts[index]), int(starts[index + 1])]}
            for index in own
        ],
    }


def _valued(search: WorstSearch, cost: float) -> dict[str, Any]:
    """A value of the objective; None of a run that failed."""
    failed = cost == math.inf
    value = None if failed else float(QUANTITIES[search.objective].cost(cost))
    return {"value": value, "failed": failed}


def worst_beside(result: Result) -> dict[str, Any] | None:
    """What a search found whose lines a result holds; None of any other result."""
    record = SearchFolder(result.path.parent, WORST).record
    return record if record is not None and fits_worst(record, result) else None


def _agree(cost: float, worst: float) -> bool:
    return cost == worst or worst - cost <= AGREEING * abs(worst)


def _record(search: WorstSearch, laws: list[dict[str, Any]]) -> dict[str, Any]:
    """What the folder says of the search when it is done."""
    section = search.section
    return {
        "name": search.name,
        "digest": search.digest,
        "objective": search.objective,
        "generations": section.budget,
        "population": section.population,
        "runs": search.base.config.ensemble.runs,
        "seeds": list(search.seeds),
        "laws": laws,
    }
