"""DOP853 in Python, for one long solution: SciPy takes longer to import than this to follow it."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from importlib.resources import files
from types import SimpleNamespace
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array

SAFETY, SHRINK, GROW = 0.9, 0.2, 10.0
"""Of the step that the estimate allows; bounds on the ratio of two steps."""

_TERM = re.compile(r"ADD\(([-.\de]+), (\d+)\)")


@cache
def _coefficients() -> dict[str, Array]:
    """Return the weights of the slopes, a row for each sum, and ``c``, the times of the stages.

    They are those of the C header, which names the source.
    """
    text = files("eqt_cli.engines").joinpath("native/dop853.h").read_text(encoding="utf-8")
    by_name: dict[str, Array] = {"c": np.zeros(16)}
    for block in text.split("#define EQT_")[2:-1]:
        rows = block.split("STAGE(")[1:] or [block]
        weights = np.zeros((len(rows), 16))
        for row, words in zip(weights, rows, strict=True):
            for value, place in _TERM.findall(words):
                row[int(place)] = float(value)
            if len(rows) > 1:
                number, time = words.split(", ")[:2]
                by_name["c"][int(number)] = float(time)
        by_name[block.split()[0].partition("(")[0]] = weights
    return by_name


def solve(
    field: Callable[[float, Array], Array],
    horizon: tuple[float, float],
    start: Array,
    *,
    t_eval: Array | None,
    events: Callable[[float, Array], float],
    first_step: float | None,
    rtol: float,
    atol: float,
    **others: Any,
) -> Any:
    """Solve as `scipy.integrate.solve_ivp` does; parameters and result have its names."""
    known, (t, stop), y, f = _coefficients(), horizon, start, field(horizon[0], start)
    kept = [start[:, None]]
    times = t_eval[1:] if t_eval is not None else np.array([stop])
    scale = atol + rtol * np.abs(y)
    h = first_step or min(stop - t, 0.01 * _rms(y / scale) / max(_rms(f / scale), 1e-5) + 1e-6)
    while t < stop:
        h = min(h, stop - t)
        if t + h == t:
            return SimpleNamespace(status=-1, message="the step size is too small")
        slopes = np.zeros((16, len(y)))
        slopes[0] = f
        for stage, row in enumerate(known["STAGES"], start=1):
            slopes[stage] = field(t + known["c"][stage] * h, y + h * (row @ slopes))
        after = y + h * (known["STEP"][0] @ slopes)
        scale = atol + rtol * np.maximum(np.abs(y), np.abs(after))
        fifth, third = (_rms((known[f"ERROR_{n}"][0] @ slopes) / scale) for n in (5, 3))
        error = h * fifth**2 / np.sqrt(fifth**2 + 0.01 * third**2) if fifth else 0.0
        if not error < 1:
            h *= max(SHRINK, SAFETY * error ** (-1 / 8)) if np.isfinite(error) else SHRINK
            continue
        end = stop if stop - t <= h else t + h
        slopes[12] = f_after = field(end, after)
        events(end, after)
        inside = times[(times > t) & (times <= end)]
        if inside[:-1].size or (inside != end).any():
            for stage, row in enumerate(known["DENSE_STAGES"], start=13):
                slopes[stage] = field(t + known["c"][stage] * h, y + h * (row @ slopes))
            change = after - y
            parts = [change, h * f - change, 2 * change - h * (f + f_after)]
            parts += [h * (known[f"DENSE_{n}"][0] @ slopes) for n in (3, 4, 5, 6)]
            x = ((inside - t) / h)[None]
            within = np.zeros((len(y), 1))
            for index, part in enumerate(reversed(parts)):
                within = (within + part[:, None]) * (x if index % 2 == 0 else 1 - x)
            kept.append(y[:, None] + within)
        elif inside.size:
            kept.append(after[:, None])
        t, y, f = end, after, f_after
        h *= min(GROW, SAFETY * error ** (-1 / 8)) if error else GROW
    return SimpleNamespace(status=0, y=np.concatenate(kept, axis=1))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values * values)))
