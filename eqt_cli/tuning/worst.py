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
"""Searches agree if their worst values are within this share of the worst value of all."""


def costs_of_runs(result: Result, metric: str) -> Array:
    """Return the cost of each run by a metric, in the shape of `Result.metric`.

    The worst run has the largest cost: ∞ for a failed run, −∞ for a run without a value.
    """
    found = result.quantity(metric).cost(result.counted(metric))
    return np.where(result.good, np.where(np.isnan(found), -np.inf, found), np.inf)


def badness(metric: str, result: Result) -> Scores:
    """Score the points of a sweep with one law: a point is better if its worst run is worse."""
    worst = costs_of_runs(result, metric)[:, 0].max(axis=-1)
    good = result.good[:, 0]
    late = good & np.isnan(result.metric("settling_time")[:, 0])
    failed, unsettled = (~good).sum(axis=1), late.sum(axis=1)
    return Scores(-worst[:, None], np.zeros(len(worst)), failed, unsettled)


def worst(
    search: WorstSearch, folder: SearchFolder, do: Computing
) -> tuple[Execution, dict[str, Any]]:
    """Search for the worst run of each law, and run all laws along each key through that point."""
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
            worst_run = alone[law.label] = _worst_run(search, result)
        single = study(source, trust_plugins=True)
        folder.write_found(law, [single], comment=_comment(search, law, worst_run))
    lines = search.lines(shares)
    along = do.execute(search.along(lines), folder.path)
    laws = [
        {
            "label": law.label,
            "config": found_files(WORST, law, 1)[0],
            **alone[law.label],
            **_search_record(search, law, found[law.label], first[law.label], shares[law.label]),
            "lines": _line_ranges(lines, law.label),
        }
        for law in search.laws
    ]
    return along, {"objective": search.objective, "laws": laws}


def _first(out: Path, scored: Scored) -> Scores:
    """Return the scores of a first generation, whose points are spread evenly over the ranges."""
    with open_result(out) as result:
        return scored(result)


def _comment(search: WorstSearch, law: LawSearch, record: dict[str, Any]) -> str:
    """Return the comment above the configuration, which names the worst of its runs."""
    outcome = "failed" if record["failed"] else f"{search.objective} {record['value']!r}"
    return f"# run {record['run']} of {law.label}: {outcome}\n"


def _worst_run(search: WorstSearch, result: Result) -> dict[str, Any]:
    """Describe the worst run at the point that was found, computed without other points.

    The last digits of a run can depend on the runs that the engine integrates with it.
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
        **_value_record(search, float(costs[run])),
        "runs": result.runs,
        "unsettled": int(np.count_nonzero(~settled)),
    }


def _search_record(
    search: WorstSearch,
    law: LawSearch,
    searches: dict[int, Population],
    first: list[Scores],
    shares: tuple[float, ...],
) -> dict[str, Any]:
    """Describe where each search found its worst run, and how many runs did not settle."""
    worst = {seed: -float(left.scores.objectives[left.best, 0]) for seed, left in searches.items()}
    axes = dict(zip(law.given, law.axes.values(), strict=True))
    points = sum(len(scored) for scored in first)
    return {
        "over": {key: [axis.low, axis.high] for key, axis in axes.items()},
        "log": [key for key, axis in axes.items() if axis.scale == "log"],
        "values": dict(zip(law.given, law.values(shares).values(), strict=True)),
        "searches": [{"seed": seed, **_value_record(search, cost)} for seed, cost in worst.items()],
        "agreeing": sum(_agree(cost, max(worst.values())) for cost in worst.values()),
        "first": {
            "runs": points * search.base.config.ensemble.runs,
            "unsettled": int(sum((each.failed + each.unsettled).sum() for each in first)),
        },
    }


def _line_ranges(lines: list[Line], label: str) -> list[dict[str, Any]]:
    """Return the ranges of points that the lines of a law occupy in the sweep."""
    ends = np.cumsum([0, *(len(line.points) for line in lines)]).tolist()
    return [
        {"key": line.key, "points": [ends[k], ends[k + 1]]}
        for k, line in enumerate(lines)
        if line.law == label
    ]


def _value_record(search: WorstSearch, cost: float) -> dict[str, Any]:
    """Return the value of the objective; None for a failed run."""
    failed = cost == math.inf
    value = None if failed else float(QUANTITIES[search.objective].cost(cost))
    return {"value": value, "failed": failed}


def _agree(cost: float, worst: float) -> bool:
    return cost == worst or (math.isfinite(worst) and worst - cost <= AGREEING * abs(worst))
