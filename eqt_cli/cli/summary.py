"""The tables that several commands print about a result."""

from __future__ import annotations

import sys
from collections import Counter

import numpy as np

from eqt_cli.analysis.headline import headline
from eqt_cli.analysis.metrics import EARLY_WINDOW
from eqt_cli.cli.output import number, table
from eqt_cli.engines import Status
from eqt_cli.store.reader import Results

MOST_FAILURES = 10


def print_headline(results: Results) -> None:
    """One line per controller: effort, tracking error, final errors, energy residual."""
    horizon = float(results.coordinate("time")[-1])
    rows = [
        [
            row.controller,
            str(row.runs - row.failed),
            number(row.early_torque),
            number(row.mean_pose_error),
            number(row.final_pose_error),
            number(row.final_velocity_error),
            number(row.energy_residual, 1),
        ]
        for row in headline(results)
    ]
    early = min(EARLY_WINDOW, horizon)
    header = [
        "controller",
        "runs",
        f"mean ‖τ‖ 0-{early:g} s",
        f"mean ‖I−Q_E‖ 0-{horizon:g} s",
        "final ‖I−Q_E‖",
        "final ‖V−V_d‖",
        "energy residual",
    ]
    print(table(header, rows))


def print_failures(results: Results) -> None:
    """How many runs failed in which way, and the first few of them, on stderr."""
    status, messages = results["status"], results["message"]
    labels = results.coordinate("controller")
    counts = Counter(Status(code).name.lower().replace("_", " ") for code in status[status != 0])
    listed = ", ".join(f"{count} {name}" for name, count in counts.most_common())
    print(f"\n{np.count_nonzero(status)} runs failed: {listed}", file=sys.stderr)
    for controller, run in np.argwhere(status)[:MOST_FAILURES]:
        print(f"  {labels[controller]} run {run}: {messages[controller, run]}", file=sys.stderr)
    if np.count_nonzero(status) > MOST_FAILURES:
        print("  … `eqt show RESULT --failed` lists all", file=sys.stderr)
