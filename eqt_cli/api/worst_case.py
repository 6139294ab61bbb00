"""Starts the search for the worst run, from its configuration."""

from __future__ import annotations

import os
from pathlib import Path

from eqt_cli.api.loading import Configuration, LoadedExperiment, source_from
from eqt_cli.api.running import choose_executor
from eqt_cli.execution.executors import Executor, Progress
from eqt_cli.execution.run_study import Remark, warn
from eqt_cli.experiment.study import Study
from eqt_cli.tuning.generations import Told
from eqt_cli.tuning.worst import Worst, find_worst, folder_of
from eqt_cli.tuning.worst_search import WorstSearch, worst_search_from


def worst(
    search: WorstSearch | Configuration,
    out: str | os.PathLike[str] | None = None,
    *,
    force: bool = False,
    workers: int = 1,
    progress: Progress = lambda runs: None,
    executor: Executor | None = None,
    resumed: Progress = lambda runs: None,
    remark: Remark = warn,
    told: Told = lambda law, generation, population: None,
) -> Worst:
    """Search for the worst run of each law within ranges of keys.

    The folder becomes the result of all laws along each key through the points that were found; in
    ``worst/`` are the complete configurations that give the runs again.

    Parameters
    ----------
    search
        A configuration with a section ``worst``, or what `worst_search_from` has made of one.
    out
        The folder; ``results/<name>-worst`` if not given. Generations that it holds are not
        computed again.
    force, workers, progress, executor, resumed, remark
        As of `run`.
    told
        Called after every generation, with the law, the number of generations over all searches
        for the law, and the points that are left of them.

    Returns
    -------
    Worst
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
    if not isinstance(search, WorstSearch):
        search = worst_search_from(source_from(search, {}))
    chosen = executor or choose_executor(LoadedExperiment(Study(None, search.base)), workers)
    return find_worst(
        search,
        folder_of(search) if out is None else Path(out),
        executor=chosen,
        force=force,
        progress=progress,
        resumed=resumed,
        remark=remark,
        told=told,
    )
