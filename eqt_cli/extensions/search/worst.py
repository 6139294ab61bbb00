"""The search for the worst run of each law, and the runs around what was found."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any

import numpy as np

from eqt_cli.base.errors import EqtError, InputError, Problems, parse_key
from eqt_cli.base.option_types import shown
from eqt_cli.base.reporting import brief, reporter
from eqt_cli.config.document import Document, entries_of, expanded, value_at
from eqt_cli.config.experiment import Experiment
from eqt_cli.config.schema import without_search
from eqt_cli.config.study import require_sweepable, study
from eqt_cli.extensions.search import law_search
from eqt_cli.extensions.search.fronts import Population, Scores, selected
from eqt_cli.extensions.search.keys import WorstSection
from eqt_cli.extensions.search.law_search import TunedRange
from eqt_cli.extensions.search.record import WORST, agree, costs_of_runs
from eqt_cli.extensions.search.run_numbers import Numbers
from eqt_cli.extensions.search.search import Outcome, Searches, compute, evolve, stored_scores
from eqt_cli.results.metrics import quantity_of
from eqt_cli.results.result import Result, open_result
from eqt_cli.runs.executors import Executor
from eqt_cli.runs.run_study import Execution

MOST_ON_A_LINE = 21
"""Default number of values along a key, besides the found point, at which every law is run."""

LEAST_ON_A_LINE = 5
"""Number below which the default does not fall to save runs."""

MOST_LINE_POINTS = 900
"""Largest number of points of all lines. Points that differ in shape need one HDF5 group each."""


@dataclass(frozen=True)
class Line:
    """Points along one key through the point that was found for a law.

    Attributes
    ----------
    law
        Label of the law.
    key
        Key of the user's configuration that varies along the line.
    points
        Values of all keys at each point.
    """

    law: str
    key: str
    points: list[dict[str, float]]


class WorstSearch(Searches[WorstSection]):
    """A checked search for the worst run: the section `worst`."""

    kind = WORST
    example = "{over: {gains.kp: [0.8, 1.2]}, objective: final_pose_error}"
    continuing = frozenset({"budget", "seeds", "profile"})
    keeps_ends = True
    judging = "for the picture along all keys (worst.profile)"

    @property
    def evolution(self) -> tuple[int, int, range]:
        """Number of generations, points of each, and seeds of the searches for each law."""
        first, section = self.section.seed, self.section
        return section.budget, section.population, range(first, first + section.seeds)

    @property
    def objective(self) -> str:
        """The metric whose worst value is searched."""
        return self.section.objective

    @property
    def judging_runs(self) -> int:
        """Number of runs at the points that were found, and of all laws along each key."""
        at_point = len(self.laws) * self.runs_at_a_point
        return at_point + self._per_line * self._on_all_lines

    @property
    def _lines(self) -> int:
        return sum(len(law.axes) for law in self.laws)

    @property
    def _on_all_lines(self) -> int:
        """Number of runs of all laws at one value on every line."""
        return self._lines * len(self.laws) * self.profile_runs

    @property
    def profile_runs(self) -> int:
        """Number of runs at each point of a line."""
        return min(self.section.profile.runs or self.runs_at_a_point, self.runs_at_a_point)

    @property
    def _per_line(self) -> int:
        points = self.section.profile.points
        if points is None:
            affordable = self.searched_runs // self._on_all_lines - 1
            points = min(MOST_ON_A_LINE, max(LEAST_ON_A_LINE, affordable))
        return max(2, min(points, MOST_LINE_POINTS // self._lines)) + 1

    def lines(self, centres: Mapping[str, Mapping[str, float]]) -> list[Line]:
        """Return the lines through the centres that were found: values by key, by law."""
        written, lines = dict[str, float](), list[Line]()
        for law in reversed(self.laws):
            written |= zip(law.written, centres[law.label].values(), strict=True)
        for law in self.laws:
            centre = written | dict(zip(law.written, centres[law.label].values(), strict=True))
            for key, axis in zip(law.written, law.axes.values(), strict=True):
                last = self._per_line - 2
                values = sorted({*(axis.at(k / last) for k in range(last + 1)), centre[key]})
                points = [centre | {key: value} for value in values]
                lines.append(Line(law.label, key, points))
        return lines

    def along(self, lines: list[Line]) -> Document:
        """Return a sweep of all laws over all lines, by default without trajectories."""
        points = [point for line in lines for point in line.points]
        columns = expanded({key: [point[key] for point in points] for key in points[0]})
        data, follows = self.base.document.data, self.section.set
        ensemble = dict(data.get("ensemble") or {}) | {"runs": self.profile_runs}
        changes: dict[str, Any] = {
            "ensemble": ensemble,
            "sweep": [{"zip": columns}, *([{"set": follows}] if follows else [])],
            "store": {"trajectories": "none"} | dict(data.get("store") or {}),
        }
        return replace(self.base.document, data=without_search(data) | changes)

    def so_far(self, law: law_search.LawSearch, population: Population) -> str:
        """Describe the worst run of a law so far."""
        cost = quantity_of(self.objective).cost(-population.scores.objectives[population.best, 0])
        return f"worst so far: {self.objective} {brief(cost)}"

    @property
    def scored_metrics(self) -> list[str]:
        return [self.objective]

    def scores(self, result: Result | Numbers) -> Scores:
        return badness(self.objective, result)

    def conclude(self, folder: law_search.SearchFolder, executor: Executor) -> Outcome:
        """Search for the worst run of each law, and run all laws along each key through it.

        The worst of all these runs is computed once more, without other points.
        """
        centres, costs = dict[str, dict[str, float]](), dict[str, dict[int, float]]()
        for law in self.laws:
            searches = evolve(self, law, folder, executor)
            best = reduce(selected, searches.values())
            centres[law.label] = law.values(best.shares[best.best].tolist())
            costs[law.label] = {
                seed: -float(last.scores.objectives[last.best, 0])
                for seed, last in searches.items()
            }
        lines, laws = self.lines(centres), []
        reporter().note("runs", self.judging)
        along = compute(self.along(lines), folder.path, executor, folder.remarks)
        at = self._worst_points(centres, costs, lines, along)
        ends = np.cumsum([0, *(len(line.points) for line in lines)]).tolist()
        for law in self.laws:
            document = law.at(at[law.label])
            compute(document, folder.run_of(law), executor, folder.remarks)
            with open_result(folder.run_of(law)) as result:
                worst_run = _worst_run(self, result)
            value = "failed" if worst_run["failed"] else f"{self.objective} {worst_run['value']!r}"
            comment = f"# run {worst_run['run']} of {law.label}: {value}\n"
            folder.write_configs(law, [study(document)], comment=comment)
            laws.append(
                {
                    "label": law.label,
                    "config": law_search.config_files(WORST, law, 1)[0],
                    **worst_run,
                    **_search_record(self, law, folder, costs[law.label], at[law.label]),
                    "in_profile": at[law.label] != centres[law.label],
                    "lines": [
                        {"key": line.key, "points": [ends[k], ends[k + 1]]}
                        for k, line in enumerate(lines)
                        if line.law == law.label
                    ],
                }
            )
        return along, {"objective": self.objective, "laws": laws}

    def _worst_points(
        self,
        centres: Mapping[str, dict[str, float]],
        costs: Mapping[str, Mapping[int, float]],
        lines: Sequence[Line],
        along: Execution,
    ) -> dict[str, dict[str, float]]:
        """Return where each law has its worst run: as found, or at a point of the lines."""
        points, at = [point for line in lines for point in line.points], dict(centres)
        with open_result(along.folder.path) as result:
            of_points = costs_of_runs(result, self.objective).max(axis=-1)
        for number, law in enumerate(self.laws):
            worst = int(np.argmax(of_points[:, number]))
            if of_points[worst, number] > max(costs[law.label].values()):
                there = (points[worst][key] for key in law.written)
                at[law.label] = dict(zip(law.axes, there, strict=True))
        return at

    @classmethod
    def _axis(cls, key: str, axis: TunedRange | None, base: Experiment) -> TunedRange | None:
        """Return the range of a key that holds a number and can be swept; integers if it does."""
        first = entries_of(key)[0]
        require_sweepable(first)
        held = value_at(base.resolved, parse_key(first))
        if isinstance(held, bool | str | list):
            raise InputError(
                f"expected a key that holds a number, and this one holds {shown(held)}"
            )
        if axis is None or not isinstance(held, int):
            return axis
        if not (float(axis.low).is_integer() and float(axis.high).is_integer()):
            raise InputError(
                f"expected whole numbers at both ends, since {key} takes whole numbers, "
                f"got [{axis.low:g}, {axis.high:g}]"
            )
        return replace(axis, integer=True)

    @classmethod
    def _check(cls, section: WorstSection, base: Experiment, problems: Problems) -> None:
        ensemble = base.config.ensemble
        runs = {"runs": ensemble.runs, "seed": ensemble.seed}
        law_search.refuse_runs_of_training(base, problems, "ensemble.seed", runs)
        with problems.catching("objective"):
            law_search.require_metric(section.objective, base)
            if quantity_of(section.objective).better == "neither":
                raise InputError(
                    f"'{section.objective}' is neither better low nor better high, so no run is "
                    "the worst; choose another metric, such as final_pose_error"
                )


def badness(metric: str, result: Result | Numbers) -> Scores:
    """Score the points of a sweep with one law: a point is better if its worst run is worse."""
    worst = costs_of_runs(result, metric)[:, 0].max(axis=-1)
    good = result.good[:, 0]
    late = good & np.isnan(result.metric("settling_time")[:, 0])
    failed, unsettled = (~good).sum(axis=1), late.sum(axis=1)
    return Scores(-worst[:, None], np.zeros(len(worst)), failed, unsettled)


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
    law: law_search.LawSearch,
    folder: law_search.SearchFolder,
    costs: Mapping[int, float],
    at: Mapping[str, float],
) -> dict[str, Any]:
    """Describe what each search found at worst, by seed, and how many runs did not settle."""
    axes, points, unsettled = dict(zip(law.written, law.axes.values(), strict=True)), 0, 0
    for seeds in folder.groups(law, search.evolution[2]):
        # Of the first generations, which are spread over the ranges
        scored = stored_scores(folder.generation(law, seeds, 0))
        assert scored is not None  # the search has just written it
        points += len(scored)
        unsettled += int((scored.failed + scored.unsettled).sum())
    return {
        "over": {key: [axis.low, axis.high] for key, axis in axes.items()},
        "log": [key for key, axis in axes.items() if axis.scale == "log"],
        "values": dict(zip(law.written, at.values(), strict=True)),
        "searches": [{"seed": seed, **_value_record(search, cost)} for seed, cost in costs.items()],
        "agreeing": sum(agree(cost, max(costs.values())) for cost in costs.values()),
        "first": {"runs": points * search.base.config.ensemble.runs, "unsettled": unsettled},
    }


def _value_record(search: WorstSearch, cost: float) -> dict[str, Any]:
    """Return the value of the objective; None for a failed run."""
    failed = cost == math.inf
    value = None if failed else float(quantity_of(search.objective).cost(cost))
    return {"value": value, "failed": failed}
