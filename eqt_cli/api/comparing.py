"""Compares the controllers of a result, and at each point of a sweep."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

from eqt_cli.analysis.comparison import Comparison, Window
from eqt_cli.analysis.comparison import compare as compare_results
from eqt_cli.analysis.comparison.bootstrap import Resampling
from eqt_cli.analysis.comparison.maps import Map, compare_map
from eqt_cli.analysis.measured.explained import Explanation, explained
from eqt_cli.analysis.measured.run import measured_runs
from eqt_cli.api.checking_logs import read_measured
from eqt_cli.api.paths import ResultPath, path_from
from eqt_cli.core.errors import EqtError
from eqt_cli.results.result import open_result


def compare(
    result: str | os.PathLike[str],
    metrics: Sequence[str] = (),
    windows: Sequence[str | Window] = (),
    *,
    point: int | None = None,
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
        Names of what to compare, as ``eqt compare RESULT --list`` shows them; a choice if empty.
    windows
        Over which seconds, as ``"0:5"``.
    point
        Of a sweep, counted from 0.
    confidence, resamples, seed
        Of the bootstrap.

    Returns
    -------
    Comparison
        Means of each controller, differences of each pair, and verdicts on claims.

    Raises
    ------
    EqtError
        If the result has no such metric or window.

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
    with open_result(path_from("result", result), point) as results:
        how = Resampling(confidence, resamples, seed)
        return compare_results(results, metrics=metrics, windows=parsed, how=how)


def compare_measured(
    result: ResultPath,
    measured: str | os.PathLike[str],
    mapping: str | os.PathLike[str] | Mapping[str, Any] | None = None,
    *,
    format: str = "csv",
    run: int = 0,
    controllers: Sequence[str] = (),
    point: int | None = None,
) -> list[Explanation]:
    """Say how much of a measured tracking error the runs of a result explain.

    Parameters
    ----------
    result
        The result folder, or the file in it.
    measured, mapping, format
        A recording, as of `check_log`. Without ``time.offset`` in the mapping, its clock is aligned
        with that of the runs.
    run
        Its number, counted from 0.
    controllers
        Labels of those to compare with; all if empty.
    point
        Of a sweep, counted from 0.

    Returns
    -------
    list of Explanation
        One for each controller.

    Raises
    ------
    EqtError
        If there is no such run or controller, or the recording does not fit it.

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
        return [explained(one) for one in measured_runs(opened, recording, chosen, run)]


def compare_sweep(
    result: ResultPath,
    metrics: Sequence[str],
    *,
    confidence: float = Resampling.confidence,
    resamples: int = Resampling.resamples,
    seed: int = Resampling.seed,
) -> list[Map]:
    """Compare the controllers at each point of a sweep: which of them wins where.

    Parameters
    ----------
    result
        The result folder, or the file in it.
    metrics
        Names of stored numbers per run; one map each.
    confidence, resamples, seed
        As of `compare`.

    Returns
    -------
    list of Map
        Which law is better at each point, one for each metric.

    Raises
    ------
    EqtError
        If the result is no sweep, or has no such metric.

    Examples
    --------
    >>> (map,) = eqt_cli.compare_sweep("results/sweep_gains", ["effort"])
    >>> map.labels
    ['eqt', 'gt']
    """
    with open_result(path_from("result", result)) as results:
        if not results.is_sweep:
            raise results.error("is a single experiment; `eqt compare` without more compares it")
        how = Resampling(confidence, resamples, seed)
        return [compare_map(results, name, how) for name in metrics]


def _window(given: Any) -> Window:
    if isinstance(given, Window):
        return given
    if isinstance(given, str):
        return Window.parse(given)
    raise EqtError(f"windows: expected text such as '0:5', or a Window, got {given!r}")
