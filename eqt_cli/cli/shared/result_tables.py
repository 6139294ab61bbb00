"""The tables that several commands print about a result."""

from __future__ import annotations

import numpy as np

from eqt_cli.cli.shared.output import number, print_text, say, table
from eqt_cli.results.result import HEADLINE, Result

MOST_FAILURES = 10
"""Different messages shown of failed runs."""

MOST_READ = 500
"""Failed runs whose messages are looked at."""


def print_headline(result: Result) -> None:
    """One line per controller: torque, tracking error, final errors, energy residual."""
    rows = []
    for row in result.headline():
        *means, residual = (row[name] for name in HEADLINE)
        runs = str(row["runs"] - row["failed"])
        rows.append([row["controller"], runs, *map(number, means), number(residual, 1)])
    header = ["controller", "runs", *(result.quantity(name).plain for name in HEADLINE)]
    print_text(table(header, rows))


def print_accuracy(result: Result) -> None:
    """How accurate the numbers are, by their own estimate and by another engine."""
    estimates = result["error_estimate"]
    if np.isfinite(estimates).any():
        largest, median = np.nanmax(estimates), np.nanmedian(estimates)
        print_text(f"error estimates: largest {largest:.1e}, median {median:.1e}")
    check = result.cross_check
    if check is None:
        return
    if np.isnan(check.difference):
        print_text("cross-check: nothing to compare, since its runs failed")
        return
    print_text(
        f"cross-check: {check.runs} runs per controller by {check.method}, "
        f"largest difference {check.difference:.1e} (bound {check.bound:.0e})"
    )
    if not check.holds:
        say(
            "eqt: the two ways of integrating disagree beyond the bound; tighten solver.rtol, "
            "or look for kinks and discontinuities in the laws"
        )


def print_failures(result: Result) -> None:
    """How many runs failed in which way, and in what words, the first of each, on stderr."""
    failures = result.failures
    total, first = len(failures), failures[:MOST_READ]
    listed = ", ".join(f"{count} {ending}" for ending, count in result.endings.items())
    say(f"\n{total} runs failed: {listed}")
    places: dict[str, list[str]] = {}
    for where, message in zip(first, result.messages(first), strict=True):
        places.setdefault(message, []).append(result.place(where))
    for message, found in list(places.items())[:MOST_FAILURES]:
        others = f" and {len(found) - 1} more" if len(found) > 1 else ""
        say(f"  {found[0]}{others}: {message}")
    if total > min(len(places), MOST_FAILURES):
        those = f"of the first {MOST_READ}; " if total > MOST_READ else ""
        cut = "… " if len(places) > MOST_FAILURES else ""
        how = f"`eqt show {result.path.parent} --failed` lists all"
        say(f"  {cut}{those}{how}")
