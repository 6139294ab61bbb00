"""Carries out a search in its folder; each generation is an ordinary sweep in its own folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.config.source import ConfigSource
from eqt_cli.core.arrays import Array
from eqt_cli.core.reporting import RUNS_DONE, reporter, step
from eqt_cli.execution.cost import PROBE_SECONDS, estimate
from eqt_cli.execution.executors import Executor
from eqt_cli.execution.folder import ResultFolder
from eqt_cli.execution.lock import LOCK, locked
from eqt_cli.execution.run_study import Execution, execute
from eqt_cli.experiment.read_study import study
from eqt_cli.results.result import open_result
from eqt_cli.store.reserved_names import FILE_NAME
from eqt_cli.tuning.evolution import Population, first_points, generator, selected, trials
from eqt_cli.tuning.folder import SearchFolder
from eqt_cli.tuning.law_search import LawSearch, coordinate_of, expanded
from eqt_cli.tuning.ranking import Scores
from eqt_cli.tuning.searches import Searches

SWEEP, GROUP = 0.2, 0.07
"""Measured overhead of a sweep, and of each of its points where points differ in shape, s."""


def compute(source: ConfigSource, out: Path, executor: Executor) -> Execution:
    """Compute an experiment, or the missing parts of it."""
    sweep = study(source, trust_plugins=True)
    there = ResultFolder(out).manifest
    # A search with fewer generations left another result here.
    force = there is not None and there["digest"] != sweep.digest
    done = execute(sweep, out, executor=executor, force=force)
    if done.was_complete:
        reporter().skip(done.runs)
    return done


def _generation(
    search: Searches[Any], law: LawSearch, out: Path, shares: Array, executor: Executor
) -> Scores:
    """Return the scores of the points of a generation, which a folder may already hold."""
    columns = _columns(law, shares)
    held = _holds(out, columns)
    if not held:
        compute(_swept(law, columns), out, executor)
    with open_result(out) as result:
        if held:
            reporter().skip(len(shares) * result.runs)
        return search.scores(result)


def evolve(
    search: Searches[Any], law: LawSearch, folder: SearchFolder, executor: Executor
) -> dict[int, Population]:
    """Run all generations of all searches for one law; return the last population by seed."""
    section, cases = search.section, search.in_cases(law).values()
    searches: dict[int, Population] = {}
    for count, seed in enumerate(search.seeds):
        shares = first_points(section.population, list(law.axes), law.start, seed)
        for number in range(section.budget):
            if number:
                random = generator(seed, law.label, number)
                shares = trials(searches[seed], random, search.keeps_ends)
            outs = folder.generation(law, seed, number, len(cases))
            scores = [
                _generation(search, case, out, shares, executor)
                for case, out in zip(cases, outs, strict=True)
            ]
            tried = Population(shares, search.over_cases(scores))
            searches[seed] = selected(searches[seed], tried) if number else tried
            search.keep(law, searches, folder)
            done = f"seed {count + 1}/{len(search.seeds)}, generation {number + 1}/{section.budget}"
            so_far = search.so_far(law, reduce(selected, searches.values()))
            reporter().note(law.label, f"{done}, {so_far}")
    return searches


@dataclass(frozen=True)
class Expected:
    """The expected size and duration of a search.

    Attributes
    ----------
    points
        Points of all generations of all searches.
    runs
        Largest number of runs, including those that judge the outcome.
    seconds
        Wall time, s; None if a moment of the horizon takes longer than an estimate may.
    workers
        Number of workers.
    """

    points: int
    runs: int
    seconds: float | None
    workers: int


def expected(search: Searches[Any], executor: Executor) -> Expected:
    """Estimate the cost of a search from part of the first generation of each law."""
    section, workers = search.section, 1
    seconds: float | None = 0.0
    share = PROBE_SECONDS / sum(len(search.in_cases(law)) for law in search.laws)
    for law in search.laws:
        shares = first_points(section.population, list(law.axes), law.start, section.seed)
        for case in search.in_cases(law).values():
            generation = study(_swept(case, _columns(law, shares)), trust_plugins=True)
            if seconds is None:
                break
            estimated = estimate(generation, executor, share)
            workers = max(workers, estimated.workers)
            if estimated.seconds is None:
                seconds = None
                break
            groups = len(generation) if generation.is_ragged else 0
            seconds += (estimated.seconds + SWEEP + groups * GROUP) * search.all_generations
    points = len(search.laws) * search.all_generations * section.population
    if seconds is not None:
        seconds *= search.all_runs / search.searched_runs
    return Expected(points, search.all_runs, seconds, workers)


def _columns(law: LawSearch, shares: Array) -> dict[str, list[float]]:
    """Return the values of each key at the points of a generation."""
    points = [law.values(row) for row in shares.tolist()]
    return expanded({key: [point[key] for point in points] for key in law.axes})


def _swept(law: LawSearch, columns: dict[str, list[float]]) -> ConfigSource:
    """Return a sweep over listed points that stores only metrics and skips cross-checks."""
    data = law.source.data
    solver = dict(data.get("solver") or {})
    if "max_error" not in solver:
        solver.setdefault("error_estimate", False)
    own = {
        "sweep": [{"zip": columns}],
        "store": {"trajectories": "none"},
        "solver": solver | {"cross_check": 0},
    }
    return replace(law.source, data=data | own)


def _holds(out: Path, columns: Mapping[str, Sequence[float]]) -> bool:
    """Whether a folder holds a complete sweep over these points."""
    if not (out / FILE_NAME).exists():
        return False
    with open_result(out) as result:
        return all(
            np.array_equal(result.coordinate(coordinate_of(key)), values)
            for key, values in columns.items()
        )


@dataclass(frozen=True)
class Found:
    """The outcome of a finished search.

    Attributes
    ----------
    search
        The search.
    judged
        Result of the runs that judge the outcome.
    record
        The record of the search, as its folder holds it.
    """

    search: Searches[Any]
    judged: Execution
    record: dict[str, Any]


def carry_out(
    search: Searches[Any], out: Path, executor: Executor, *, force: bool = False
) -> Found:
    """Carry out a search in a folder, reusing the generations that it already holds.

    Parameters
    ----------
    force
        Whether to start over.

    Raises
    ------
    EqtError
        If the folder holds something else, is in use, or cannot be written.
    """
    folder = SearchFolder(out, search.kind)
    folder.check(search.laws)
    with locked(out, name=f"{LOCK}-{search.kind.command}"):
        folder.claim(search.base.name, search.digest, force)
        with step(RUNS_DONE, search.all_runs):
            judged, outcome = search.conclude(folder, executor)
        record = search.settings | outcome
        folder.write_record(record)
    return Found(search, judged, record)
