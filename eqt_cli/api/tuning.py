"""Starts the search for gains, from its configuration."""

from __future__ import annotations

import os
from pathlib import Path

from eqt_cli.api.loading import Configuration, LoadedExperiment, source_from
from eqt_cli.api.running import choose_executor
from eqt_cli.execution.executors import Executor, Progress
from eqt_cli.execution.run_study import Remark, warn
from eqt_cli.experiment.study import Study
from eqt_cli.tuning.generations import Told
from eqt_cli.tuning.search import Search, search_from
from eqt_cli.tuning.tune import Tuning, folder_of
from eqt_cli.tuning.tune import tune as run_search


def tune(
    search: Search | Configuration,
    out: str | os.PathLike[str] | None = None,
    *,
    force: bool = False,
    workers: int = 1,
    progress: Progress = lambda runs: None,
    executor: Executor | None = None,
    resumed: Progress = lambda runs: None,
    remark: Remark = warn,
    told: Told = lambda law, generation, population: None,
) -> Tuning:
    """Search for the best gains of each law, and compare the winners on held-out runs.

    The folder becomes the result of the held-out runs, to be compared, drawn and reported like any
    other; in ``tuned/`` are the complete configurations of the winners.

    Parameters
    ----------
    search
        A configuration with a section ``tune``, or what `search_from` has made of one.
    out
        The folder; ``results/<name>-tuned`` if not given. Generations that it holds are not
        computed again.
    force, workers, progress, executor, resumed, remark
        As of `run`.
    told
        Called after every generation, with the law, the number of generations over all searches
        for the law, and the points that are left of them.

    Returns
    -------
    Tuning
        What was found for each law, and the result of the held-out runs.

    Raises
    ------
    ConfigError
        With every problem of the configuration, each at its place.
    EqtError
        If it tunes nothing, or the folder holds something else.

    Examples
    --------
    >>> tuning = eqt_cli.tune("configs/tune_so2.yaml")
    >>> [law.law.label for law in tuning.laws]
    ['stabilising']
    """
    if not isinstance(search, Search):
        search = search_from(source_from(search, {}))
    chosen = executor or choose_executor(LoadedExperiment(Study(None, search.base)), workers)
    return run_search(
        search,
        folder_of(search) if out is None else Path(out),
        executor=chosen,
        force=force,
        progress=progress,
        resumed=resumed,
        remark=remark,
        told=told,
    )
