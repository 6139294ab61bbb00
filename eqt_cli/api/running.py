"""Runs experiments into their result folders, completely or in shards, and starts searches."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eqt_cli.api.loading import (
    Configuration,
    ResultPath,
    StoredResult,
    document_from,
    load_experiment,
)
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import Kind
from eqt_cli.config.document import read_config
from eqt_cli.config.remarks import remark_on
from eqt_cli.config.study import Study, study
from eqt_cli.runs.executors import Executor, executors
from eqt_cli.runs.folder import CONFIG, ResultFolder
from eqt_cli.runs.run_study import Shard, execute, pack_folder

if TYPE_CHECKING:
    from eqt_cli.analysis.search import Searched, Searches
    from eqt_cli.analysis.tune import Search
    from eqt_cli.analysis.worst import WorstSearch


def run(
    experiment: Study | Configuration,
    out: str | os.PathLike[str] | None = None,
    *,
    force: bool = False,
    workers: int = 1,
    executor: Executor | None = None,
    rerun_failed: bool = False,
    shard: Shard | None = None,
) -> StoredResult:
    """Run an experiment and store its result in a folder.

    If the folder already holds the complete result of the same experiment, nothing is run.

    Parameters
    ----------
    experiment
        A `Study` from `load_experiment`, or a configuration as `load_experiment` takes it.
    out
        Result folder. Default: ``results/<name>``.
    force
        Whether to start over and remove what eqt wrote there.
    workers
        Number of cores to use. With more than one, eqt may start processes; a script then needs the
        usual ``if __name__ == "__main__":``.
    executor
        Executor of the runs. Default: that of `choose_executor`.
    rerun_failed
        Whether to compute failed runs again, each alone.
    shard
        Share of the runs to compute while other processes compute the rest. `pack` joins them.

    Returns
    -------
    StoredResult
        The result folder and the number of failed runs. It can be used as a path in other calls.

    Raises
    ------
    EqtError
        If the folder holds another experiment, or is not writable. Failed runs raise no error:
        see `StoredResult.failed`.

    Examples
    --------
    >>> few = {"ensemble.runs": 2, "time.duration": 1, "name": "few"}
    >>> result = eqt_cli.run(eqt_cli.load_experiment("configs/paper.yaml", few))
    >>> result.failed
    0
    """
    loaded = experiment if isinstance(experiment, Study) else load_experiment(experiment)
    folder = Path("results") / loaded.name if out is None else Path(out)
    loaded = loaded if force else ResultFolder(folder).begun(loaded)
    remark_on(loaded.base)
    done = execute(
        loaded,
        folder,
        executor=executor or choose_executor(loaded, workers),
        force=force,
        rerun_failed=rerun_failed,
        shard=shard,
    )
    return StoredResult(done.folder.path, outcome=done)


def choose_executor(
    experiment: Study,
    workers: int = 1,
    name: str = "auto",
    options: Mapping[str, Any] | None = None,
) -> Executor:
    """Choose the executor of an experiment.

    Parameters
    ----------
    experiment
        The experiment, whose engine determines default options.
    workers
        Number of cores to use.
    name
        Name of an executor.
    options
        Options of the executor by name (`eqt list executors`).

    Returns
    -------
    Executor
        An executor for `run`, `tune` and `worst`.

    Examples
    --------
    >>> experiment = eqt_cli.load_experiment("configs/paper.yaml")
    >>> executor = eqt_cli.choose_executor(experiment, workers=2, name="threads")
    """
    problems = Problems(lambda path: "executor")
    section = {"kind": name, "workers": workers} | dict(options or {})
    chosen = Kind(executors).checked(section, problems)
    problems.raise_if_any()
    assert chosen is not None
    return chosen.for_engine(experiment.base.engine)


def pack(folder: ResultPath, *, trust_plugins: bool = False) -> StoredResult:
    """Join the shards of an experiment that several calls of `run` computed.

    Parameters
    ----------
    folder
        The result folder of all shards.
    trust_plugins
        Whether to execute the plugins that the folder contains.

    Returns
    -------
    StoredResult
        The complete result.

    Raises
    ------
    EqtError
        If runs are missing.

    Examples
    --------
    >>> eqt_cli.pack("results/paper").failed
    0
    """
    ResultFolder(Path(folder)).check()
    document = read_config(Path(folder, CONFIG), trusted=trust_plugins)
    document = replace(document, home=replace(document.home, is_result=True))
    done = pack_folder(study(document), Path(folder))
    return StoredResult(done.folder.path, outcome=done)


# Searches -----------------------------------------------------------------------------------------


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
    from eqt_cli.analysis.tune import Search

    read = search if isinstance(search, Search) else Search.read(document_from(search, {}))
    return _searched(read, out, executor, workers, force)


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
    from eqt_cli.analysis.worst import WorstSearch

    read = (
        search if isinstance(search, WorstSearch) else WorstSearch.read(document_from(search, {}))
    )
    return _searched(read, out, executor, workers, force)


def _searched(
    search: Searches[Any],
    out: str | os.PathLike[str] | None,
    executor: Executor | None,
    workers: int,
    force: bool,
) -> Searched:
    from eqt_cli.analysis.search import carry_out

    folder = search.folder if out is None else Path(out)
    search = search if force else search.begun_in(folder)
    executor = executor or choose_executor(Study(None, search.base), workers)
    remark_on(search.base)
    return carry_out(search, folder, executor, force=force)
