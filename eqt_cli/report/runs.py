"""The table of single runs: columns, units and rows as plain data; it knows no page."""

from __future__ import annotations

from typing import Any

import numpy as np

from eqt_cli.engines import Status
from eqt_cli.store.reader import Results

MOST_ROWS = 8000
"""Rows that a page holds, controllers times runs; failed runs are among them before good ones."""

COLUMNS = {
    "early_torque": "mean ‖τ‖, first 5 s",
    "effort": "effort ∫‖τ‖² dt",
    "peak_torque": "max ‖τ‖",
    "mean_pose_error": "mean ‖I − Q_E‖",
    "final_pose_error": "final ‖I − Q_E‖",
    "final_velocity_error": "final ‖V − V_d‖",
    "settling_time": "settling time",
    "energy_residual": "energy residual",
    "error_estimate": "error estimate",
}

Document = dict[str, Any]


def run_table(results: Results) -> Document:
    """Columns with names and units, and a row per controller and run.

    Returns
    -------
    dict
        ``item``, what a row is about; ``columns`` with a value in any run; ``rows`` of controller,
        run, status and numbers, where null says none; ``total``, the number of rows there are;
        ``messages`` of failed runs by row.
    """
    labels = [str(label) for label in results.coordinate("controller")]
    names = [name for name in COLUMNS if results.has(name) and np.isfinite(results[name]).any()]
    status = results["status"]
    order = np.argwhere(np.ones_like(status))
    order = order[np.argsort(status[tuple(order.T)] == 0, kind="stable")][:MOST_ROWS]
    order = order[np.lexsort(order.T[::-1])]
    # No name is left where every run failed.
    values = np.moveaxis(np.array([results[name] for name in names]), 0, -1) if names else None
    messages = results["message"] if results.has("message") else None
    return {
        "item": "run",
        "columns": [{"name": COLUMNS[name], "unit": unit_of(results, name)} for name in names],
        "controllers": labels,
        "rows": [
            [
                int(c),
                int(r),
                _meaning(int(status[c, r])),
                *map(plain, () if values is None else values[c, r]),
            ]
            for c, r in order
        ],
        "messages": {
            f"{c}-{r}": str(messages[c, r])
            for c, r in order
            if messages is not None and status[c, r]
        },
        "total": int(status.size),
    }


def unit_of(results: Results, name: str) -> str:
    """The unit of a metric; nothing for a pure number."""
    unit = results.units(name)
    return "" if unit == "1" else unit


def _meaning(code: int) -> str:
    try:
        return Status(code).name.lower().replace("_", " ")
    except ValueError:
        return f"status {code}"


def plain(value: float) -> float | None:
    """A number with six digits, as far as there is one."""
    return float(f"{value:.6g}") if np.isfinite(value) else None
