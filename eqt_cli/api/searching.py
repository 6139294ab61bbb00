"""Starts the searches, for gains and for the worst run, from their configurations."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, TypeVar

from eqt_cli.api.loading import Configuration, LoadedExperiment, source_from
from eqt_cli.api.running import choose_executor
from eqt_cli.execution.executors import Executor
from eqt_cli.experiment.study import Study
from eqt_cli.tuning.generations import Computing
from eqt_cli.tuning.search import Search
from eqt_cli.tuning.searches import Searches
from eqt_cli.tuning.searching import Conclude, Found, carry_out
from eqt_cli.tuning.tune import tune as tuned
from eqt_cli.tuning.worst import worst as worst_runs
from eqt_cli.tuning.worst_search import WorstSearch

S = TypeVar("S", bound=Searches[Any])


def tune(
    search: Search | Configuration,
    out: str | os.PathLike[str] | None = None,
    *,
    force: bool = False,
    workers: int = 1,
    executor: Executor | None = None,
) -> Found:
    """Search for the best gains of each law, and compare the winners on held-out runs.

    The folder becomes the result of the held-out runs, to be compared, drawn and reported like any
    other; in ``tuned/`` are the complete configurations of the winners.

    Parameters
    ----------
    search
        A configuration with a section ``tune``, or what `Search.read` has made of one.
    out
        The folder; ``results/<name>-tuned`` if not given. Generations that it holds are not
        computed again.
    force, workers, executor
        As of `run`.

    Returns
    -------
    Found
        What was found for each law, and the result of the held-out runs.

    Raises
    ------
    ConfigError
        With every problem of the configuration, each at its place.
    EqtError
        If it tunes nothing, or the folder holds something else.

    Examples
    --------
    >>> found = eqt_cli.tune("configs/tune_so2.yaml")
    >>> [law["label"] for law in found.record["laws"]]
    ['stabilising']
    """
    read = search if isinstance(search, Search) else Search.read(source_from(search, {}))
    on = executor or _executor(read, workers)
    return _found(read, out, tuned, Computing(on), force)


def worst(
    search: WorstSearch | Configuration,
    out: str | os.PathLike[str] | None = None,
    *,
    force: bool = False,
    workers: int = 1,
    executor: Executor | None = None,
) -> Found:
    """Search for the worst run of each law within ranges of keys.

    The folder becomes the result of all laws along each key through the points that were found; in
    ``worst/`` are the complete configurations that give the runs again.

    Parameters
    ----------
    search
        A configuration with a section ``worst``, or what `WorstSearch.read` has made of one.
    out
        The folder; ``results/<name>-worst`` if not given.
    force, workers, executor
        As of `tune`.

    Returns
    -------
    Found
        What was found for each law, and the result along each key.

    Raises
    ------
    ConfigError
        With every problem of the configuration, each at its place.
    EqtError
        If it searches for no worst run, or the folder holds something else.

    Examples
    --------
    >>> config = {
    ...     "name": "wheel",
    ...     "group": "SO2",
    ...     "inertia": 1.0,
    ...     "gains": {"kp": 0.5, "kd": 1.0},
    ...     "reference": {"torque": ["cos(t)"]},
    ...     "controllers": ["gt"],
    ...     "initial": {"pose": {"kind": "fixed", "coordinates": [1.0]}},
    ...     "ensemble": {"runs": 1},
    ...     "time": {"duration": 1.0, "samples": 11},
    ...     "worst": {
    ...         "over": {"initial.pose.coordinates[0]": [-2, 2]},
    ...         "objective": "final_pose_error",
    ...         "budget": 1,
    ...         "population": 5,
    ...     },
    ... }
    >>> found = eqt_cli.worst(config)
    >>> [law["label"] for law in found.record["laws"]]
    ['gt']
    """
    read = search if isinstance(search, WorstSearch) else WorstSearch.read(source_from(search, {}))
    on = executor or _executor(read, workers)
    return _found(read, out, worst_runs, Computing(on), force)


def _executor(search: Searches[Any], workers: int) -> Executor:
    return choose_executor(LoadedExperiment(Study(None, search.base)), workers)


def _found(
    search: S,
    out: str | os.PathLike[str] | None,
    conclude: Conclude[S],
    do: Computing,
    force: bool,
) -> Found:
    folder = search.folder if out is None else Path(out)
    return carry_out(search, folder, conclude, do, force=force)
