"""How the error of a prediction grows with its horizon, over many windows of a recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.core.arrays import Array, norm
from eqt_cli.core.errors import EqtError
from eqt_cli.core.reporting import step
from eqt_cli.engines import Engine
from eqt_cli.fitting.prediction import WINDOWS, Windows, errors

HORIZONS = 10
"""At which errors are told at the most: rows of the first window, spread up to the longest."""

LOW, HIGH = 0.1, 0.9
"""Quantiles."""


@dataclass(frozen=True)
class Growth:
    """Errors of predictions from recorded states, by part of the pose and of the velocity.

    Attributes
    ----------
    name
        The recording.
    windows
        How many there are.
    failed
        How many of them have no prediction, since its run failed.
    horizons : (h,)
        s.
    parts, units
        What the rows are: parts of the pose, then of the velocity where it was recorded.
    median, low, high, rms : (parts, h)
        Of the error over windows: the median, the 10 % and the 90 % quantile, the root mean square.
    noise : (parts, h)
        The root mean square that the noise of the recording alone gives a perfect model: that of
        the first state, as it grows, and that of the row at the horizon. A first velocity that
        was not recorded counts as exact.
    notes
        What a reader should know of the recording and the model.
    """

    name: str
    windows: int
    failed: int
    horizons: Array
    parts: tuple[str, ...]
    units: tuple[str, ...]
    median: Array
    low: Array
    high: Array
    rms: Array
    noise: Array
    notes: tuple[str, ...] = ()


def growth(loop: ClosedLoop, engine: Engine, windows: Windows, count: int) -> Growth:
    """How the error grows, over at most `count` windows spread over the recording.

    Raises
    ------
    EqtError
        If no window can be predicted.
    """
    recording, variances = windows.recording, windows.noise**2
    measured = np.isfinite(windows.noise)
    kinds = windows.kinds
    own, expected, chosen = [], [], windows.spread(count)
    first = recording.times[chosen[0].rows]
    told = np.unique(np.linspace(0, len(first) - 1, HORIZONS + 1).round().astype(int)[1:])
    horizons = first[told] - first[0]
    with step(WINDOWS, len(chosen)):
        for window in chosen:
            found = errors([loop, loop], np.empty(0), engine, recording, window)
            if found is None:
                continue
            times = recording.times[window.rows]
            rows = np.abs(times[:, None] - times[0] - horizons).argmin(axis=0)
            start = np.where(measured, variances, 0.0)  # what was not recorded is not known
            spread = found.by_state[rows] ** 2 @ start + variances
            own.append([norm(found.values[rows][:, axes]) for _, _, axes in kinds])
            expected.append([spread[:, axes].sum(axis=1) for _, _, axes in kinds])
    if not own:
        raise EqtError(
            f"{recording.name}: the runs of all {len(chosen)} windows failed; check the inertia "
            "and the units of the wrench"
        )
    sizes = np.array(own)
    low, median, high = np.quantile(sizes, [LOW, 0.5, HIGH], axis=0)
    return Growth(
        recording.name,
        len(chosen),
        len(chosen) - len(own),
        horizons,
        tuple(name for name, _, _ in kinds),
        tuple(unit for _, unit, _ in kinds),
        median,
        low,
        high,
        np.sqrt(np.mean(sizes**2, axis=0)),
        np.sqrt(np.mean(expected, axis=0)),
    )
