"""Checks the paper's statements on an experiment or on a result."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from eqt_cli.analysis.verification import RUNS, Verification, verify_experiment, verify_stored
from eqt_cli.api.loading import Configuration, experiment_at
from eqt_cli.core.errors import EqtError
from eqt_cli.experiment.study import Study
from eqt_cli.results.result import open_result


def verify(
    target: Study | Configuration,
    *,
    runs: int | None = None,
    point: int | None = None,
    trust_plugins: bool = False,
    workers: int = 1,
    exact: bool = False,
) -> Verification:
    """Check the paper's statements on an experiment or on the runs of a result.

    Parameters
    ----------
    target
        A result folder or file, whose stored runs are checked; or a `Study` or a configuration, of
        which new runs are computed.
    runs
        Number of new runs per law, at most that of the experiment. Default: 20.
    point
        Point of a sweep, counted from 0. Default for an experiment: the first.
    trust_plugins
        Whether to execute plugin sources that are stored in a result file.
    workers
        Number of cores to use.
    exact
        Whether to prove identities with exact numbers. Proved rows have ``degree``, ``points`` and
        ``probability``.

    Returns
    -------
    Verification
        Each of its ``rows`` has a verdict; ``failures`` are the rows that refute a statement.

    Raises
    ------
    EqtError
        If the target cannot be read, or is the result of a sweep and ``point`` is missing.

    Examples
    --------
    >>> eqt_cli.verify("results/paper").failures
    []
    """
    if not isinstance(target, (Study, Mapping)):
        path = Path(target)
        if path.suffix == ".h5" or path.is_dir():
            if runs is not None:
                raise EqtError(f"{path}: a result is verified as it is; leave runs out")
            with open_result(path, point) as opened:
                return verify_stored(
                    opened, trust_plugins=trust_plugins, workers=workers, exact=exact
                )
    experiment = experiment_at(target, point, trust_plugins=trust_plugins)
    count = min(runs or RUNS, experiment.config.ensemble.runs)
    return verify_experiment(experiment, count, workers, exact)
