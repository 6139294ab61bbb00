"""Checks the paper's statements on an experiment or on a result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from eqt_cli.analysis.oracles import oracle_named
from eqt_cli.analysis.verification import RUNS, Verification, verify_experiment, verify_stored
from eqt_cli.api.loading import Configuration, LoadedExperiment, at_point, load_experiment
from eqt_cli.core.errors import EqtError
from eqt_cli.results.result import open_result


def verify(
    target: LoadedExperiment | Configuration,
    *,
    runs: int | None = None,
    point: int | None = None,
    trust_plugins: bool = False,
    workers: int = 1,
    oracle: str | Sequence[str] = (),
    exact: bool = False,
) -> Verification:
    """Check the paper's statements on an experiment or on the runs of a result.

    Parameters
    ----------
    target
        From `load_experiment`, or what that takes. Of a result folder or file, the stored runs are
        judged; of all else, new ones.
    runs
        New runs per controller, at most those of the experiment; 20 if not given.
    point
        Of a sweep, counted from 0; the first of an experiment if not given.
    trust_plugins
        Execute plugin sources that are stored in a result file.
    workers
        Cores to use.
    oracle
        ``mujoco``, ``pinocchio`` or both: programs whose rigid bodies eqt's is compared with.
    exact
        Also prove identities, with exact numbers: those rows then have ``degree``, ``points`` and
        ``probability``.

    Returns
    -------
    Verification
        Its ``rows`` have a verdict each; ``failures`` are those that refute a statement.

    Raises
    ------
    EqtError
        If the target cannot be read, or is a sweep's result and no point is given.

    Examples
    --------
    >>> eqt_cli.verify("results/paper").failures
    []
    """
    names = [oracle] if isinstance(oracle, str) else oracle
    oracles = [oracle_named(name) for name in names]
    if not isinstance(target, (LoadedExperiment, Mapping)):
        path = Path(target)
        if path.suffix == ".h5" or path.is_dir():
            if runs is not None:
                raise EqtError(f"{path}: a result is verified as it is; leave runs out")
            with open_result(path, point) as opened:
                return verify_stored(
                    opened,
                    trust_plugins=trust_plugins,
                    workers=workers,
                    oracles=oracles,
                    exact=exact,
                )
    if not isinstance(target, LoadedExperiment):
        target = load_experiment(target, trust_plugins=trust_plugins)
    experiment = at_point(target, point)
    count = min(runs or RUNS, experiment.config.ensemble.runs)
    return verify_experiment(experiment, count, workers, oracles, exact)
