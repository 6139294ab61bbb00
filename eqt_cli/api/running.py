"""Runs experiments into their result folders, completely or in shards."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from eqt_cli.api.loading import Configuration, ResultPath, StoredResult, load_experiment
from eqt_cli.base import purposes
from eqt_cli.base.errors import EqtError, Problems
from eqt_cli.base.extensions import function_for, functions_for
from eqt_cli.base.option_types import Kind
from eqt_cli.base.yaml_source import flow, parse_value
from eqt_cli.config.document import read_config
from eqt_cli.config.remarks import remark_on
from eqt_cli.config.study import Study, study, with_grid
from eqt_cli.runs.executors import Executor, executors
from eqt_cli.runs.folder import CONFIG, ResultFolder
from eqt_cli.runs.run_study import Shard, execute, pack_folder


def run(
    experiment: Study | Configuration,
    out: str | os.PathLike[str] | None = None,
    *,
    force: bool = False,
    workers: int = 1,
    executor: Executor | None = None,
    rerun_failed: bool = False,
    grow: bool = False,
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
        Whether to compute failed runs again, each alone; also by a solver with other settings.
    grow
        Whether to keep the points, laws and runs of a result in the folder, and add what it lacks.
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
    if grow and (force or shard):
        raise EqtError(
            f"{folder}: a result grows in one session, and keeps its runs; leave "
            "out --force and --shard"
        )
    loaded = loaded if force else ResultFolder(folder).begun(loaded)
    done = execute(
        _remarked(loaded),
        folder,
        executor=executor or choose_executor(loaded, workers),
        force=force,
        rerun_failed=rerun_failed,
        grow=grow,
        shard=shard,
    )
    return StoredResult(done.folder.path, outcome=done)


def _remarked(study: Study) -> Study:
    """Tell what is remarked on a study, and return it with that, as its result holds it."""
    noted = remark_on(study.base)
    for more in functions_for(purposes.remarks_on_other_values):
        points = ((f"at point {k}", study.experiment(k)) for k in range(1, len(study)))
        noted += more(study.base, points)
    return replace(study, remarks=noted)


def sweep(
    experiment: Study | Configuration,
    grid: Mapping[str, Any] | None = None,
    out: str | os.PathLike[str] | None = None,
    **options: Any,
) -> StoredResult:
    """Run an experiment at every point of a sweep and store the result in a folder.

    Parameters
    ----------
    experiment
        As for `run`.
    grid
        Values by key, as ``{"gains.kd": [0.5, 1]}``, or a range, ``{"low": 0.5, "high": 2,
        "points": 4}``; every combination is one point. Default: the sweep of the configuration.
    out
        Result folder. Default: ``results/<name>``.
    **options
        Further arguments of `run`.

    Returns
    -------
    StoredResult
        The result; ``open_result(result, point=0)`` opens one point.

    Raises
    ------
    EqtError
        As `run`, and if there is nothing to vary, or a sweep in both places.

    Examples
    --------
    >>> few = {"ensemble.runs": 2, "time.duration": 1, "name": "gains"}
    >>> experiment = eqt_cli.load_experiment("configs/paper.yaml", few)
    >>> result = eqt_cli.sweep(experiment, {"gains.kp": [1, 2], "gains.kd": [0.5, 1]})
    >>> result.metric("effort").shape
    (4, 4, 2)
    """
    loaded = experiment if isinstance(experiment, Study) else load_experiment(experiment)
    if not isinstance(grid, Mapping | None):
        raise EqtError(f"grid: expected values by key, as {{'gains.kp': [1, 2]}}, got {grid!r}")
    if not grid:
        if loaded.sweep is None:
            raise EqtError("grid: missing; give values by key, as {'gains.kp': [1, 2]}, or use run")
        return run(loaded, out, **options)
    if loaded.sweep is not None:
        raise EqtError("grid: the configuration has a section sweep; add these keys there")
    document = loaded.document
    for key, values in grid.items():
        place = f"grid[{key!r}]"
        document = with_grid(document, key, parse_value(flow(values), place), place)
    return run(study(document), out, **options)


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


def pack(
    folder: ResultPath,
    *others: ResultPath,
    out: str | os.PathLike[str] | None = None,
    trust_plugins: bool = False,
) -> StoredResult:
    """Join the shards of an experiment that several calls of `run` computed, or several results.

    Parameters
    ----------
    folder
        The result folder of all shards, or a result.
    *others
        Results that differ from it in points, laws or seeds.
    out
        Folder of the result of all of them; only with `others`.
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
    if others or out is not None:
        if not others or out is None:
            raise EqtError("pack: several results need a folder `out`, and one needs none")
        paths = [Path(path) for path in (folder, *others)]
        done = function_for(purposes.pack_out)(paths, Path(out), trusted=trust_plugins)
        return StoredResult(done.folder.path, outcome=done)
    ResultFolder(Path(folder)).check()
    document = read_config(Path(folder, CONFIG), trusted=trust_plugins)
    document = replace(document, home=replace(document.home, is_result=True))
    done = pack_folder(_remarked(study(document)), Path(folder))
    return StoredResult(done.folder.path, outcome=done)
