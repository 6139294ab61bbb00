"""The table that a run ends with: one row per controller."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.store.reader import Results


@dataclass(frozen=True)
class Row:
    """Means over the good runs of one controller, and its largest energy residual.

    Attributes
    ----------
    controller
        Label.
    runs, failed
        All runs, and those with a status other than 0.
    early_torque
        Mean ‖τ‖ over the first 5 s.
    mean_pose_error
        Mean ‖I − Q_E‖_F over the horizon.
    final_pose_error, final_velocity_error
        Means at the end of the horizon.
    energy_residual
        Largest |L + W − L(0)| / max(L(0), 1 J) over runs and samples.
    """

    controller: str
    runs: int
    failed: int
    early_torque: float
    mean_pose_error: float
    final_pose_error: float
    final_velocity_error: float
    energy_residual: float


MEANS = ("early_torque", "mean_pose_error", "final_pose_error", "final_velocity_error")


def headline(results: Results) -> list[Row]:
    """One row per controller of a result, in its order; NaN where no run is good."""
    rows = []
    for index, label in enumerate(results.coordinate("controller")):
        good = results.read("status", controller=index) == 0
        means = {
            name: _or_nan(np.mean, results.read(name, controller=index)[good]) for name in MEANS
        }
        residual = _or_nan(np.max, results.read("energy_residual", controller=index)[good])
        failed = int(good.size - good.sum())
        rows.append(Row(str(label), good.size, failed, **means, energy_residual=residual))
    return rows


def _or_nan(statistic: Callable[[Array], Any], values: Array) -> float:
    return float(statistic(values)) if values.size else float("nan")
