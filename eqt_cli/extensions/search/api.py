"""Searches for the best gains and for the worst run of each law."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from eqt_cli.api.loading import Configuration, document_from
from eqt_cli.api.running import choose_executor
from eqt_cli.config.study import Study
from eqt_cli.extensions.search.search import Searched, Searches, carry_out
from eqt_cli.extensions.search.tune import Search
from eqt_cli.extensions.search.worst import WorstSearch
from eqt_cli.runs.executors import Executor


def tune(
    search: Search | Configuration,
    out: str | os.PathLike[str] | None = None,
    *,
    force: bool = False,
    workers: int = 1,
    executor: Executor | None = None,
) -> Searched:
    """Search for the best gains of each law, and compare the winners on held-out runs.

    The folder becomes the result of the held-out runs, which you can compare, draw and report like
    any other result. Its subfolder ``tuned/`` holds the complete configurations of the winners.

    Parameters
    ----------
    search
        A configuration with a section ``tune``, or a `Search` from `Search.read`.
    out
        Output folder. Default: ``results/<name>-tuned``. Generations that it already holds are
        reused.
    force, workers, executor
        As for `run`.

    Returns
    -------
    Searched
        The winners of each law, and the result of the held-out runs.

    Raises
    ------
    ConfigError
        With all problems of the configuration and their places.
    EqtError
        If the configuration has no section ``tune``, or the folder holds something else.

    Examples
    --------
    >>> outcome = eqt_cli.tune("configs/tune_so2.yaml")
    >>> [law["label"] for law in outcome.record["laws"]]
    ['stabilising']
    """
    return _searched(Search, search, out, executor, workers, force)


def worst(
    search: WorstSearch | Configuration,
    out: str | os.PathLike[str] | None = None,
    *,
    force: bool = False,
    workers: int = 1,
    executor: Executor | None = None,
) -> Searched:
    """Search for the worst run of each law within ranges of keys.

    The folder becomes the result of all laws along each key through the points that were found. Its
    subfolder ``worst/`` holds the complete configurations that reproduce the worst runs.

    Parameters
    ----------
    search
        A configuration with a section ``worst``, or a `WorstSearch` from `WorstSearch.read`.
    out
        Output folder. Default: ``results/<name>-worst``. Generations that it already holds are
        reused.
    force, workers, executor
        As for `run`.

    Returns
    -------
    Searched
        The worst run of each law, and the result along each key.

    Raises
    ------
    ConfigError
        With all problems of the configuration and their places.
    EqtError
        If the configuration has no section ``worst``, or the folder holds something else.

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
    >>> outcome = eqt_cli.worst(config)
    >>> [law["label"] for law in outcome.record["laws"]]
    ['gt']
    """
    return _searched(WorstSearch, search, out, executor, workers, force)


def _searched(
    kind: type[Searches[Any]],
    search: Any,
    out: str | os.PathLike[str] | None,
    executor: Executor | None,
    workers: int,
    force: bool,
) -> Searched:
    if not isinstance(search, kind):
        search = kind.read(document_from(search, {}))
    folder = search.folder if out is None else Path(out)
    search = search if force else search.begun_in(folder)
    executor = executor or choose_executor(Study(None, search.base), workers)
    return carry_out(search, folder, executor, force=force)
