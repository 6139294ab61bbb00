"""The search for the worst run of each law, and the runs around what was found."""

from __future__ import annotations

import math
from functools import partial, reduce
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import EqtError
from eqt_cli.execution.run_study import Execution
from eqt_cli.experiment.read_study import study
from eqt_cli.results.quantity_table import QUANTITIES
from eqt_cli.results.result import Result, open_result
from eqt_cli.tuning.evolution import Population, selected
from eqt_cli.tuning.folder import WORST, SearchFolder, found_files
from eqt_cli.tuning.generations import Computing, Scored, evolve
from eqt_cli.tuning.law_search import LawSearch
from eqt_cli.tuning.ranking import Scores
from eqt_cli.tuning.worst_search import Line, WorstSearch

AGREEING = 0.01
"""Searches agree that find worst values within this share of the worst of all."""


def costs_of_runs(result: Result, metric: str) -> Array:
    """How bad each run is by a metric, as `Result.metric`: ∞ where it failed, −∞ without a value.

    So the worst of several runs is the largest of these numbers.
    """
    found = result.quantity(metric).cost(result.counted(metric))
    return np.where(result.good, np.where(np.isnan(found), -np.inf, found), np.inf)


def badness(metric: str, result: Result) -> Scores:
    """The scores of the points of a sweep with one law: the worse its worst run, the better."""
    worst = costs_of_runs(result, metric)[:, 0].max(axis=-1)
    good = result.good[:, 0]
    late = good & np.isnan(result.metric("settling_time")[:, 0])
    failed, unsettled = (~good).sum(axis=1), late.sum(axis=1)
    return Scores(-worst[:, None], np.zeros(len(worst)), failed, unsettled)


def worst(
    search: WorstSearch, folder: SearchFolder, do: Computing
) -> tuple[Execution, dict[str, Any]]:
    """Search for the worst run of each law, and run all laws along each key through it."""
    found, first = {}, {}
    scored = partial(badness, search.objective)
    for law in search.laws:
        found[law.label] = evolve(search, law, folder, do, scored)
        first[law.label] = [_first(folder.generation(law, k, 0)[0], scored) for k in search.seeds]
    best = {label: reduce(selected, searches.values()) for label, searches in found.items()}
    shares = {label: tuple(one.shares[one.best].tolist()) for label, one in best.items()}
    alone = {}
    for law in search.laws:
        source = law.at(law.values(shares[law.label]))
        do.execute(source, folder.run_of(law))
        with open_result(folder.run_of(law)) as result:
            told_of = alone[law.label] = _alone(search, result)
        single = study(source, trust_plugins=True)
        folder.write_found(law, [single], said=_said(search, law, told_of))
    lines = search.lines(shares)
    along = do.execute(search.along(lines), folder.path)
    laws = [
        {
            "label": law.label,
            "config": found_files(WORST, law, 1)[0],
            **alone[law.label],
            **_searched(search, law, found[law.label], first[law.label], shares[law.label]),
            "lines": _places(lines, law.label),
        }
        for law in search.laws
    ]
    return along, {"objective": search.objective, "laws": laws}


def _first(out: Path, scored: Scored) -> Scores:
    """Of the points of a first generation, which are spread evenly over the box."""
    with open_result(out) as result:
        return scored(result)


def _said(search: WorstSearch, law: LawSearch, record: dict[str, Any]) -> str:
    """What stands above the configuration: which of its runs is meant."""
    what = "failed" if record["failed"] else f"{search.objective} {record['value']!r}"
    return f"# run {record['run']} of {law.label}: {what}\n"


def _alone(search: WorstSearch, result: Result) -> dict[str, Any]:
    """The worst run of what was found for a law, run by itself.

    The engine may give runs other last digits beside those of other points.
    """
    costs = costs_of_runs(result, search.objective)[0]
    run = int(np.argmax(costs))
    if costs[run] == -math.inf:
        raise EqtError(
            f"{result.path}: no run of '{result.labels[0]}' has a value of {search.objective}; "
            "choose another objective"
        )
    settled = np.isfinite(result.metric("settling_time")[0])
    return {
        "run": run,
        **_valued(search, float(costs[run])),
        "runs": result.runs,
        "unsettled": int(np.count_nonzero(~settled)),
    }


def _searched(
    search: WorstSearch,
    law: LawSearch,
    searches: dict[int, Population],
    first: list[Scores],
    shares: tuple[float, ...],
) -> dict[str, Any]:
    """Where the worst was found, by which searches, and how many runs of the box settle."""
    worst = {seed: -float(left.scores.objectives[left.best, 0]) for seed, left in searches.items()}
    axes = dict(zip(law.given, law.axes.values(), strict=True))
    points = sum(len(scored) for scored in first)
    return {
        "over": {key: [axis.low, axis.high] for key, axis in axes.items()},
        "log": [key for key, axis in axes.items() if axis.scale == "log"],
        "values": dict(zip(law.given, law.values(shares).values(), strict=True)),
        "searches": [{"seed": seed, **_valued(search, cost)} for seed, cost in worst.items()],
        "agreeing": sum(_agree(cost, max(worst.values())) for cost in worst.values()),
        "first": {
            "runs": points * search.base.config.ensemble.runs,
            "unsettled": int(sum((each.failed + each.unsettled).sum() for each in first)),
        },
    }


def _places(lines: list[Line], label: str) -> list[dict[str, Any]]:
    """Where the lines of a law are among the points of all."""
    ends = np.cumsum([0, *(len(line.points) for line in lines)]).tolist()
    return [
        {"key": line.key, "points": [ends[k], ends[k + 1]]}
        for k, line in enumerate(lines)
        if line.law == label
    ]


def _valued(search: WorstSearch, cost: float) -> dict[str, Any]:
    """A value of the objective; None of a run that failed."""
    failed = cost == math.inf
    value = None if failed else float(QUANTITIES[search.objective].cost(cost))
    return {"value": value, "failed": failed}


def _agree(cost: float, worst: float) -> bool:
    return cost == worst or (math.isfinite(worst) and worst - cost <= AGREEING * abs(worst))
