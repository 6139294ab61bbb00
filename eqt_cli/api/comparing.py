"""Compares laws and results, checks certificates, linearises loops."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from eqt_cli.analysis.intervals import NEGLIGIBLE, Resampling
from eqt_cli.analysis.search_record import TUNE, laws_of
from eqt_cli.api.loading import (
    Configuration,
    ResultPath,
    experiment_at,
    open_at,
    path_from,
    require_list,
)
from eqt_cli.base.errors import EqtError
from eqt_cli.results.quantity import Window
from eqt_cli.results.result import Result, open_result

if TYPE_CHECKING:
    from eqt_cli.analysis.certified import LawRates
    from eqt_cli.analysis.comparison import Comparison
    from eqt_cli.analysis.differences import Differences
    from eqt_cli.analysis.maps import Map
    from eqt_cli.analysis.margins import Margins
    from eqt_cli.analysis.verification import Verification
    from eqt_cli.config.study import Study

# Each function imports the analysis that it needs: together they take half a second.


def compare(
    result: str | os.PathLike[str],
    metrics: Sequence[str] = (),
    windows: Sequence[str | Window] = (),
    *,
    other: ResultPath | None = None,
    controllers: Sequence[str] = (),
    without_start: bool = False,
    point: int | None = None,
    units: Sequence[str] = (),
    confidence: float = Resampling.confidence,
    resamples: int = Resampling.resamples,
    seed: int = Resampling.seed,
    negligible: float = NEGLIGIBLE,
) -> Comparison:
    """Compare the laws of a result, or the laws of another result with them, run by run.

    Parameters
    ----------
    result
        The result folder, or the file in it.
    metrics
        Names of metrics, as ``eqt compare RESULT --list`` shows them; a default selection if empty.
    windows
        Time windows in seconds, as ``"0:5"``.
    other
        Another result, such as one with other gains, whose laws are compared with the same laws of
        the first.
    controllers
        Labels or titles of the controllers to compare; all if empty.
    without_start
        Whether to leave out the starting gains of a tuning.
    point
        Point of a sweep, counted from 0.
    units
        ``"mN m"`` for every quantity of this dimension, or ``"mean_torque=mN m"`` for one.
    confidence, resamples, seed
        Settings of the bootstrap.
    negligible
        Relative difference that counts as none.

    Returns
    -------
    Comparison
        Means of each controller, differences of each pair, and verdicts on claims.

    Raises
    ------
    EqtError
        If the result does not have a metric or a window.

    Examples
    --------
    >>> comparison = eqt_cli.compare("results/paper", ["mean_torque"], ["0:5"])
    >>> [(pair.first, pair.second) for pair in comparison.pairs][:2]
    [('eqt', 'gt'), ('eqt', 'nog')]
    """
    from eqt_cli.analysis.compare import compare as compare_results
    from eqt_cli.analysis.compare import compare_two

    require_list("metrics", metrics)
    if isinstance(windows, str | Window):
        raise EqtError(f"windows: expected a list of windows, as ['0:5'], got {windows!r}")
    parsed = []
    for window in windows:
        if not isinstance(window, str | Window):
            raise EqtError(f"windows: expected text such as '0:5', or a Window, got {window!r}")
        parsed.append(Window.parse(window) if isinstance(window, str) else window)
    with open_at(path_from("result", result), point) as opened:
        results = opened.in_units(units)
        how = Resampling(confidence, resamples, seed)
        if other is not None:
            with open_at(path_from("other", other), point) as second:
                return compare_two(
                    results,
                    second.in_units(units),
                    metrics=metrics,
                    windows=parsed,
                    between=_between(opened, second),
                    how=how,
                    negligible=negligible,
                )
        return compare_results(
            results,
            metrics=metrics,
            windows=parsed,
            labels=chosen_labels(results, controllers, without_start=without_start),
            how=how,
            negligible=negligible,
        )


def _between(first: Result, second: Result) -> list[str]:
    """Say whether the runs of two results are pairs, and what differs between the results."""
    from eqt_cli.analysis.differences import changed_keys

    runs = slice(min(first.runs, second.runs))
    paired = True
    for name in ("initial_pose", "initial_velocity"):
        one, other = (result.read(name, run=runs) for result in (first, second))
        paired &= one.shape == other.shape and np.allclose(one, other, ROUNDED, ROUNDED)
    changes = [
        f"{each['key']} {each.get('first', '-')} → {each.get('second', '-')}"
        for each in changed_keys(first, second)
    ]
    if len(changes) > MOST_CHANGES:
        changes[MOST_CHANGES:] = [f"{len(changes) - MOST_CHANGES} more keys (`eqt diff`)"]
    versions = [str(each.provenance.get("eqt")) for each in (first, second)]
    if versions[0] != versions[1]:
        changes.append(f"eqt {' → '.join(versions)}")
    return [
        f"what differs: {', '.join(changes) or 'nothing'}",
        "runs are paired by their equal starts" if paired else "runs are not paired: other starts",
    ]


ROUNDED = 1e-12
"""Relative, and in the units of poses and velocities: starts of one draw differ by less where two
engines or two processors round them, and those of two draws by far more."""

MOST_CHANGES = 4
"""Maximum number of changed keys that a comparison of two results names."""


def chosen_labels(
    result: Result, controllers: Sequence[str], *, without_start: bool = False
) -> list[str]:
    """The labels of the laws of a result, in its order; all if none is named.

    Raises
    ------
    EqtError
        If there is no such controller, or no start to leave out.
    """
    require_list("controllers", controllers)
    wanted = [result.labels[result.position_of(name)] for name in controllers]
    starts, record = [], TUNE.beside(result)
    if without_start:
        if record is None:
            raise result.error("is not the result of a tuning, so it has no starting gains")
        starts = [law["start"] for law in record["laws"]]
    chosen = wanted or laws_of(result, record)
    return [label for label in result.labels if label in chosen and label not in starts]


def compare_sweep(
    result: ResultPath,
    metrics: Sequence[str],
    *,
    controllers: Sequence[str] = (),
    units: Sequence[str] = (),
    confidence: float = Resampling.confidence,
    resamples: int = Resampling.resamples,
    seed: int = Resampling.seed,
    share: float = 0.9,
) -> list[Map]:
    """Compare the laws at each point of a sweep, and find the points that each wins.

    Parameters
    ----------
    result
        The result folder, or the file in it.
    metrics
        Names of stored metrics; each gives a map.
    controllers
        Labels or titles of the controllers to compare; all if empty.
    units, confidence, resamples, seed
        As for `compare`.
    share
        A law is not ranked at a point where it settles in fewer than 1 − `share` of the runs and
        another law in `share` of them, or where more than 1 − `share` of its runs fail.

    Returns
    -------
    list of Map
        The comparison of the laws at each point, for each metric.

    Raises
    ------
    EqtError
        If the result is not a sweep, or does not have a metric.

    Examples
    --------
    >>> (map,) = eqt_cli.compare_sweep("results/sweep_gains", ["effort"])
    >>> map.labels
    ['eqt', 'gt']
    """
    from eqt_cli.analysis.maps import compare_map

    with open_result(path_from("result", result)) as opened:
        results = opened.in_units(units)
        if not results.is_sweep:
            raise results.error("is a single experiment; compare its controllers with `compare`")
        how = Resampling(confidence, resamples, seed)
        chosen = [results.labels.index(label) for label in chosen_labels(results, controllers)]
        return [compare_map(results, name, how, chosen, settling=share) for name in metrics]


def diff(first: ResultPath, second: ResultPath) -> Differences:
    """Compare two results: configuration, provenance, and the numbers bit by bit.

    Parameters
    ----------
    first, second
        The result folders, or the files in them.

    Returns
    -------
    Differences
        The differences; ``equal`` is true if only the provenance differs.

    Raises
    ------
    EqtError
        If a result does not exist or is damaged.

    Examples
    --------
    >>> again = eqt_cli.run(eqt_cli.load_experiment("results/paper/results.h5"), "again")
    >>> eqt_cli.diff("results/paper", again).equal
    True
    """
    from eqt_cli.analysis.differences import differences

    with (
        open_result(path_from("first", first)) as one,
        open_result(path_from("second", second)) as other,
    ):
        return differences(one, other)


# Checks the paper's statements on an experiment or on a result ------------------------------------


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
    from eqt_cli.analysis.verification import RUNS, verify_experiment, verify_stored
    from eqt_cli.config.remarks import remark_on

    if isinstance(target, str | os.PathLike):
        path = Path(target)
        if path.suffix == ".h5" or path.is_dir():
            if runs is not None:
                raise EqtError(f"{path}: a result is verified as it is; leave runs out")
            with open_at(path, point) as opened:
                return verify_stored(
                    opened, trust_plugins=trust_plugins, workers=workers, exact=exact
                )
    experiment = experiment_at(target, point, trust_plugins=trust_plugins)
    remark_on(experiment)
    count = min(runs or RUNS, experiment.config.ensemble.runs)
    return verify_experiment(experiment, count, workers, exact)


# Computes the stability margins of the loops of an experiment -------------------------------------


def margins(
    target: Study | Configuration, *, point: int | None = None, trust_plugins: bool = False
) -> Margins:
    """Compute eigenvalues, delay margin and gain margins of the loop of every law.

    Loops are linearised about their reference, with the hold, the delay and the linear parts of the
    actuators. Limits, quantisation and noise are left out. No run is simulated.

    Parameters
    ----------
    target
        A `Study` from `load_experiment`, or a configuration as `load_experiment` takes it.
    point
        Point of a sweep, counted from 0. Default: the first.
    trust_plugins
        Whether to execute plugin sources that are stored in a result file.

    Returns
    -------
    Margins
        Each of its ``laws`` has ``growth``, ``delay``, ``gains`` and ``is_indicative``: whether the
        linearised loop depends on time, so that these numbers prove nothing.

    Raises
    ------
    ConfigError
        With all problems of the configuration and their places.
    EqtError
        If the file does not exist, or a loop cannot be differentiated.

    Examples
    --------
    >>> [law] = eqt_cli.margins(
    ...     {
    ...         "group": "SO2",
    ...         "inertia": 0.4,
    ...         "gains": {"kp": 1.0, "kd": 0.8},
    ...         "reference": {"kind": "constant"},
    ...         "controllers": ["eqt"],
    ...         "time": {"duration": 10},
    ...     }
    ... ).laws
    >>> law.growth.is_stable, round(law.delay, 4)
    (True, 0.3043)
    """
    from eqt_cli.analysis.margins import margins_of
    from eqt_cli.config.remarks import remark_on

    experiment = experiment_at(target, point, trust_plugins=trust_plugins)
    remark_on(experiment)
    return margins_of(experiment)


def certified(
    target: Study | Configuration,
    velocities: Sequence[float] = (),
    *,
    push: float = 0,
    start: float = 0,
    point: int | None = None,
) -> list[LawRates]:
    """Prove a rate at which small errors decay along every reference whose velocity is bounded.

    About a reference, the errors of the loop obey ẋ = A(V_d) x to first order. One matrix P with
    AᵀP + PA + 2λP ≺ 0 at the corners of a box proves the rate λ for every V_d(t) in the box. The
    proof is in fractions. It needs the extra `certify`.

    Parameters
    ----------
    target
        A `Study` from `load_experiment`, or a configuration as `load_experiment` takes it.
    velocities
        Each v stands for the box |V_d,i| ≤ v. Default: the box around the reference's own velocity,
        as sampled over the horizon.
    push
        Bound of a wrench, N m: also prove by how much it turns a law on SO(3), to first order.
    start
        Angle, deg: also prove a rate from every start on SO(3) with no more L than a turn by this
        angle at rest. It takes up to a minute for each law and box.
    point
        Point of a sweep, counted from 0. Default: the first.

    Returns
    -------
    list
        For each law its ``label``, and ``rates``, one for each box in rising order, with ``rate``
        (a fraction, 1/s, or None), ``P``, ``overshoot`` √cond P, ``velocity`` (the box),
        ``slowest_constant`` and ``slowest_rate``; and ``gain`` and ``region`` if asked, with their
        proofs. Of a law without, ``refused`` says why.

    Raises
    ------
    ConfigError
        With all problems of the configuration and their places.
    EqtError
        If the file does not exist, or Clarabel is not installed.

    Examples
    --------
    >>> [eqt, *others] = eqt_cli.certified("configs/paper.yaml", [0.5])
    >>> [one] = eqt.rates
    >>> round(float(one.rate), 3), round(one.overshoot, 2)
    (0.119, 1.65)
    """
    from eqt_cli.analysis.margins import certified_rates

    return certified_rates(experiment_at(target, point), velocities, push, start)
