"""Measures how the error of a prediction grows with its horizon, over windows of a recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eqt_cli.analysis.comparison.notation import significant
from eqt_cli.analysis.text_tables import Block, TextTable
from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.core.arrays import Array, norm
from eqt_cli.core.errors import EqtError
from eqt_cli.core.reporting import step
from eqt_cli.engines import Engine
from eqt_cli.fitting.prediction import WINDOWS, Windows, correlated, delayed, errors, linear

HORIZONS = 10
"""Largest number of horizons: rows of the first window, spread up to its last."""

LOW, HIGH = 0.1, 0.9
"""Quantiles of the errors over the windows."""


@dataclass(frozen=True)
class Growth:
    """Errors of predictions from recorded states, by part of the pose and of the velocity.

    Attributes
    ----------
    name
        The recording.
    windows
        The number of windows.
    failed
        The number of windows without a prediction, because the run failed.
    horizons : (h,)
        Times since the start of a window, s.
    parts, units
        The rows of the errors: parts of the pose, then of the velocity where it was recorded.
    median, low, high, rms : (parts, h)
        Median, 10 % and 90 % quantile, and root mean square of the error over the windows.
    noise : (parts, h)
        The root mean square error of a perfect model, which the noise of the recording causes: in
        the first state, from which it grows, and in the row at the horizon. A first velocity
        that was not recorded counts as exact.
    notes
        Remarks on the recording and the model.
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


def growth(
    loop: ClosedLoop, engine: Engine, windows: Windows, count: int, delay: float = 0.0
) -> Growth:
    """Measure the growth of the error over at most `count` windows, spread over the recording.

    The wrench is recorded a `delay` late, s.

    Raises
    ------
    EqtError
        If no window can be predicted.
    """
    recording, variances = windows.recording, windows.noise**2
    measured = np.isfinite(windows.noise)
    parts = windows.parts
    norms, by_noise, left, chosen = [], [], [], windows.spread(count)
    first = recording.times[chosen[0].rows]
    sampled = np.unique(np.linspace(0, len(first) - 1, HORIZONS + 1).round().astype(int)[1:])
    horizons = first[sampled] - first[0]
    with step(WINDOWS, len(chosen)):
        for window in chosen:
            pair = [loop, loop]
            prediction = errors(pair, np.empty(0), engine, recording, window, delay, windows.later)
            if prediction is None:
                continue
            left.append(linear(prediction, windows.noise))
            times = recording.times[window.rows]
            rows = np.abs(times[:, None] - times[0] - horizons).argmin(axis=0)
            start = np.where(measured, variances, 0.0)
            spread = prediction.by_state[rows] ** 2 @ start + variances
            norms.append([norm(prediction.values[rows][:, axes]) for _, _, axes in parts])
            by_noise.append([spread[:, axes].sum(axis=1) for _, _, axes in parts])
    if not norms:
        raise EqtError(
            f"{recording.name}: the runs of all {len(chosen)} windows failed; check the inertia "
            "and the units of the wrench"
        )
    sizes = np.array(norms)
    low, median, high = np.quantile(sizes, [LOW, 0.5, HIGH], axis=0)
    return Growth(
        recording.name,
        len(chosen),
        len(chosen) - len(norms),
        horizons,
        tuple(name for name, _, _ in parts),
        tuple(unit for _, unit, _ in parts),
        median,
        low,
        high,
        np.sqrt(np.mean(sizes**2, axis=0)),
        np.sqrt(np.mean(by_noise, axis=0)),
        (*correlated(left, windows), *delayed(left, fitted=False)),
    )


def growth_table(result: Growth) -> TextTable:
    """Return the error of each part at each horizon: median, quantiles, rms, and that by noise."""
    header = ["horizon, s", "median", "10 %", "90 %", "rms", "noise"]
    blocks = []
    for k, (part, unit) in enumerate(zip(result.parts, result.units, strict=True)):
        columns = (result.median, result.low, result.high, result.rms, result.noise)
        rows = [
            [f"{horizon:.4g}", *(significant(column[k, h], 3) for column in columns)]
            for h, horizon in enumerate(result.horizons)
        ]
        blocks.append(Block(f"{part}, {unit}", rows))
    failed = f"; the runs of {result.failed} more failed" if result.failed else ""
    title = f"Error of the prediction of {result.name} over {result.windows} windows{failed}"
    notes = [
        "Each window starts in a recorded state. noise: the rms that the noise of the recording "
        "alone gives a perfect model.",
        *result.notes,
    ]
    return TextTable("growth", title, header, blocks, notes)
