"""Compares the controllers of a result, at each point of a sweep, and with a recording."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

from eqt_cli.analysis.comparison.compare import Comparison
from eqt_cli.analysis.comparison.compare import compare as compare_results
from eqt_cli.analysis.comparison.intervals import Resampling
from eqt_cli.analysis.comparison.maps import Map, compare_map
from eqt_cli.analysis.measured import Explanation, explained, measured_runs
from eqt_cli.api.checking_logs import read_measured
from eqt_cli.api.loading import ResultPath, path_from
from eqt_cli.core.errors import EqtError
from eqt_cli.results.result import Result, open_result
from eqt_cli.results.time_windows import Window
from eqt_cli.tuning.folder import TUNE


def compare(
    result: str | os.PathLike[str],
    metrics: Sequence[str] = (),
    windows: Sequence[str | Window] = (),
    *,
    controllers: Sequence[str] = (),
    without_start: bool = False,
    point: int | None = None,
    units: Sequence[str] = (),
    confidence: float = Resampling.confidence,
    resamples: int = Resampling.resamples,
    seed: int = Resampling.seed,
) -> Comparison:
    """Compare the controllers of a result, run by run on the same initial states.

    Parameters
    ----------
    result
        The result folder, or the file in it.
    metrics
        Names of metrics, as ``eqt compare RESULT --list`` shows them; a default selection if empty.
    windows
        Time windows in seconds, as ``"0:5"``.
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
    >>> found = eqt_cli.compare("results/paper", ["mean_torque"], ["0:5"])
    >>> [(pair.first, pair.second) for pair in found.pairs][:2]
    [('eqt', 'gt'), ('eqt', 'nog')]
    """
    if isinstance(metrics, str):
        raise EqtError(f"metrics: expected a list of names, as [{metrics!r}], got {metrics!r}")
    if isinstance(windows, str | Window):
        raise EqtError(f"windows: expected a list of windows, as ['0:5'], got {windows!r}")
    parsed = [_window(window) for window in windows]
    with open_result(path_from("result", result), point) as opened:
        results = opened.in_units(units)
        how = Resampling(confidence, resamples, seed)
        labels = chosen_labels(results, controllers, without_start=without_start)
        return compare_results(results, metrics=metrics, windows=parsed, labels=labels, how=how)


def chosen_labels(
    result: Result, controllers: Sequence[str], *, without_start: bool = False
) -> list[str]:
    """The labels of controllers of a result, in its order; all if none is named.

    Raises
    ------
    EqtError
        If there is no such controller, or no start to leave out.
    """
    wanted = [result.labels[result.position_of(name)] for name in controllers]
    starts = []
    if without_start:
        record = TUNE.beside(result)
        if record is None:
            raise result.error("is not the result of a tuning, so it has no starting gains")
        starts = [law["start"] for law in record["laws"]]
    return [
        label for label in result.labels if label not in starts and (not wanted or label in wanted)
    ]


def compare_measured(
    result: ResultPath,
    measured: str | os.PathLike[str],
    mapping: str | os.PathLike[str] | Mapping[str, Any] | None = None,
    *,
    format: str = "csv",
    run: int = 0,
    controllers: Sequence[str] = (),
    point: int | None = None,
    units: Sequence[str] = (),
) -> list[Explanation]:
    """Compute how much of a measured tracking error the runs of a result explain.

    Parameters
    ----------
    result
        The result folder, or the file in it.
    measured, mapping, format
        A recording, as for `check_log`. Without ``time.offset`` in the mapping, its clock is
        aligned with that of the runs.
    run
        Number of the run, counted from 0.
    controllers
        Labels of the controllers to compare with; all if empty.
    point
        Point of a sweep, counted from 0.
    units
        Units of quantities, as for `compare`.

    Returns
    -------
    list of Explanation
        The explained shares of the error, for each controller.

    Raises
    ------
    EqtError
        If the run or a controller does not exist, or the recording does not fit the run.

    Examples
    --------
    >>> import numpy as np
    >>> with eqt_cli.open_results("results/paper", "arrays") as result:
    ...     poses = result.trajectory("pose", 0)[0].reshape(-1, 9)
    ...     rows = np.c_[result.times + 0.25, poses]
    >>> header = "t,Q11,Q12,Q13,Q21,Q22,Q23,Q31,Q32,Q33"
    >>> np.savetxt("flight.csv", rows, delimiter=",", header=header, comments="")
    >>> late = {"time": {"offset": -0.25}}
    >>> found = eqt_cli.compare_measured("results/paper", "flight.csv", late)
    >>> found[0].rows == len(rows), round(found[0].shares[0].explained, 6)
    (True, 1.0)
    """
    with open_result(path_from("result", result), point) as opened:
        if opened.group is None:
            raise opened.error(f"is on group '{opened.group_name}' of a plugin, which is not known")
        recording = read_measured(measured, opened.group, mapping, format)
        chosen = [opened.position_of(name) for name in controllers]
        shown_in = opened.in_units(units).shown_in
        return [explained(one, shown_in) for one in measured_runs(opened, recording, chosen, run)]


def compare_sweep(
    result: ResultPath,
    metrics: Sequence[str],
    *,
    controllers: Sequence[str] = (),
    units: Sequence[str] = (),
    confidence: float = Resampling.confidence,
    resamples: int = Resampling.resamples,
    seed: int = Resampling.seed,
) -> list[Map]:
    """Compare the controllers at each point of a sweep, and find the points that each wins.

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
    with open_result(path_from("result", result)) as opened:
        results = opened.in_units(units)
        if not results.is_sweep:
            raise results.error("is a single experiment; compare its controllers with `compare`")
        how = Resampling(confidence, resamples, seed)
        chosen = [results.labels.index(label) for label in chosen_labels(results, controllers)]
        return [compare_map(results, name, how, chosen) for name in metrics]


def _window(given: Any) -> Window:
    if isinstance(given, Window):
        return given
    if isinstance(given, str):
        return Window.parse(given)
    raise EqtError(f"windows: expected text such as '0:5', or a Window, got {given!r}")
