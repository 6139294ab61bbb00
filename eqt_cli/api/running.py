"""Runs an experiment into its result folder, at once or in shares, and chooses who computes."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eqt_cli.api.loading import Configuration, LoadedExperiment, load_experiment
from eqt_cli.api.opening import open_results
from eqt_cli.api.paths import ResultPath
from eqt_cli.config.source import config_in
from eqt_cli.core.problems import Problems
from eqt_cli.core.reporting import reporter
from eqt_cli.core.validation import component
from eqt_cli.execution.executors import Executor, executors
from eqt_cli.execution.folder import CONFIG, ResultFolder
from eqt_cli.execution.run_study import (
    Execution,
    Shard,
    execute,
    pack_folder,
)
from eqt_cli.experiment.horizon import remarks
from eqt_cli.experiment.read_study import study

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True)
class StoredResult(Execution, os.PathLike[str]):
    """A result in its folder; it stands for its path wherever one is expected."""

    @property
    def path(self) -> Path:
        """The folder."""
        return self.folder.path

    def __fspath__(self) -> str:
        return str(self.path)

    @property
    def file(self) -> Path:
        """The result file."""
        return self.folder.results

    @cached_property
    def data(self) -> xarray.Dataset:
        """The result as an xarray Dataset, which reads from the file when values are asked for."""
        return open_results(self, "xarray")

    def __repr__(self) -> str:
        failed = f", {self.failed} failed" if self.failed else ""
        return f"<result {self.path}: {self.runs} runs{failed}>"


def run(
    experiment: LoadedExperiment | Configuration,
    out: str | os.PathLike[str] | None = None,
    *,
    force: bool = False,
    workers: int = 1,
    executor: Executor | None = None,
    rerun_failed: bool = False,
    shard: Shard | None = None,
) -> StoredResult:
    """Run an experiment, and keep its result in a folder.

    A folder that already holds the finished result of the same experiment is left as it is.

    Parameters
    ----------
    experiment
        From `load_experiment`, or what that takes.
    out
        The result folder; ``results/<name>`` if not given.
    force
        Start over, removing what eqt wrote there.
    workers
        Cores to use. More than one may start processes, for which a script needs the usual
        ``if __name__ == "__main__":``.
    executor
        Who computes; if not given, `choose_executor` chooses.
    rerun_failed
        Compute those runs again that failed, each by itself.
    shard
        Compute only this share, beside other processes; `pack` joins the shares.

    Returns
    -------
    StoredResult
        The folder, and how many runs failed. It stands for its path in other calls.

    Raises
    ------
    EqtError
        If the folder holds another experiment, or cannot be written. Runs that fail do not raise:
        see `StoredResult.failed`.

    Examples
    --------
    >>> few = {"ensemble.runs": 2, "time.duration": 1, "name": "few"}
    >>> result = eqt_cli.run(eqt_cli.load_experiment("configs/paper.yaml", few))
    >>> result.failed
    0
    """
    loaded = experiment if isinstance(experiment, LoadedExperiment) else load_experiment(experiment)
    for known in remarks(loaded.experiment):
        reporter().remark(known)
    done = execute(
        loaded.study,
        Path("results") / loaded.name if out is None else Path(out),
        executor=executor or choose_executor(loaded, workers),
        force=force,
        rerun_failed=rerun_failed,
        shard=shard,
    )
    return StoredResult(**vars(done))


def choose_executor(
    experiment: LoadedExperiment,
    workers: int = 1,
    name: str | None = None,
    scheduler: str | None = None,
    options: Mapping[str, Any] | None = None,
) -> Executor:
    """Who computes an experiment.

    Parameters
    ----------
    workers
        Cores to use.
    name
        Of an executor. If not given: Dask for a scheduler, else `auto`.
    scheduler
        Address of a running Dask scheduler.
    options
        Of the executor, by name (`eqt list executors`).

    Returns
    -------
    Executor
        To be given to `run` or `tune`.

    Examples
    --------
    >>> experiment = eqt_cli.load_experiment("configs/paper.yaml")
    >>> executor = eqt_cli.choose_executor(experiment, workers=2, name="threads")
    """
    kind = name or ("dask" if scheduler else "auto")
    address = {"scheduler": scheduler} if scheduler else {}
    problems = Problems(lambda path: "executor")
    asked = {"kind": kind, "workers": workers} | address | dict(options or {})
    found = component(executors, asked, problems)
    problems.raise_if_any()
    assert found is not None
    return found.for_engine(experiment.experiment.engine)


def pack(folder: ResultPath, *, trust_plugins: bool = False) -> StoredResult:
    """Join the shares of an experiment that several calls of `run` have computed.

    Parameters
    ----------
    folder
        The result folder that all of them wrote to.
    trust_plugins
        Execute the plugins that the folder contains.

    Returns
    -------
    StoredResult
        The whole result.

    Raises
    ------
    EqtError
        If shares are missing.

    Examples
    --------
    >>> eqt_cli.pack("results/paper").failed
    0
    """
    ResultFolder(Path(folder)).check()
    found = study(config_in(Path(folder), CONFIG), trust_plugins=trust_plugins)
    return StoredResult(**vars(pack_folder(found, Path(folder))))
