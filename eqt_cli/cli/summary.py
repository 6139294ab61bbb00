"""The tables that several commands print about a result."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from eqt_cli.cli.output import number, table
from eqt_cli.engines import Status
from eqt_cli.results.headline import headline
from eqt_cli.results.metrics import EARLY_WINDOW
from eqt_cli.store.reader import Results

MOST_FAILURES = 10
"""Different messages shown of failed runs."""

MOST_READ = 500
"""Failed runs whose messages are looked at."""


def print_headline(results: Results) -> None:
    """One line per controller: effort, tracking error, final errors, energy residual."""
    early, whole = "", ""
    if results.has("time"):  # which differs between the points of some sweeps
        horizon = float(results.coordinate("time")[-1])
        early, whole = f" 0-{min(EARLY_WINDOW, horizon):g} s", f" 0-{horizon:g} s"
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
    header = [
        "controller",
        "runs",
        f"mean ‖τ‖{early or ' early'}",
        f"mean ‖I−Q_E‖{whole}",
        "final ‖I−Q_E‖",
        "final ‖V−V_d‖",
        "energy residual",
    ]
    print(table(header, rows))


def cross_check(results: Results) -> dict[str, Any] | None:
    """What the result says of its cross-check, and whether it holds; None where it has none."""
    found = {
        key.removeprefix("cross_check_"): value
        for key, value in results.attributes.items()
        if key.startswith("cross_check_")
    }
    if not found:
        return None
    beyond = float(found["difference"]) > float(found["bound"])
    return found | {"holds": not beyond}


def print_accuracy(results: Results) -> None:
    """How accurate the numbers are, by their own estimate and by another engine."""
    estimates = results["error_estimate"]
    if np.isfinite(estimates).any():
        largest, median = np.nanmax(estimates), np.nanmedian(estimates)
        print(f"error estimates: largest {largest:.1e}, median {median:.1e}")
    check = cross_check(results)
    if check is None:
        return
    if np.isnan(check["difference"]):
        print("cross-check: nothing to compare, since its runs failed")
        return
    print(
        f"cross-check: {check['runs']} runs per controller by {check['method']}, "
        f"largest difference {check['difference']:.1e} (bound {check['bound']:.0e})"
    )
    if not check["holds"]:
        print(
            "eqt: the two ways of integrating disagree beyond the bound; tighten solver.rtol, "
            "or look for kinks and discontinuities in the laws",
            file=sys.stderr,
        )


def print_failures(results: Results) -> None:
    """How many runs failed in which way, and in what words, the first of each, on stderr."""
    status = results["status"]
    codes, counts = np.unique(status[status != 0], return_counts=True)
    listed = ", ".join(
        f"{counts[i]} {Status(codes[i]).name.lower().replace('_', ' ')}"
        for i in np.argsort(-counts, kind="stable")
    )
    print(f"\n{np.count_nonzero(status)} runs failed: {listed}", file=sys.stderr)
    first = np.argwhere(status)[:MOST_READ]
    # All messages of a million runs would take seconds: only the rows and columns of the first.
    axes = [np.unique(first[:, axis], return_inverse=True) for axis in range(status.ndim)]
    chosen = {dim: along for dim, (along, _) in zip(results.dims("status"), axes, strict=True)}
    messages = results.read("message", **chosen)[tuple(position for _, position in axes)]
    places: dict[str, list[tuple[int, ...]]] = {}
    for where, message in zip(map(tuple, first), messages, strict=True):
        places.setdefault(str(message), []).append(where)
    for message, found in list(places.items())[:MOST_FAILURES]:
        others = f" and {len(found) - 1} more" if len(found) > 1 else ""
        print(f"  {place_of(results, found[0])}{others}: {message}", file=sys.stderr)
    total = np.count_nonzero(status)
    if total > min(len(places), MOST_FAILURES):
        those = f"of the first {MOST_READ}; " if total > MOST_READ else ""
        cut = "… " if len(places) > MOST_FAILURES else ""
        how = f"`eqt show {results.path.parent} --failed` lists all"
        print(f"  {cut}{those}{how}", file=sys.stderr)


def place_of(results: Results, where: tuple[int, ...]) -> str:
    """A run by its position along (point,) controller and run: ``point 3 eqt run 17``."""
    *point, controller, run = where
    label = results.coordinate("controller")[controller]
    return f"{f'point {point[0]} ' if point else ''}{label} run {run}"
