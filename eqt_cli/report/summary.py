"""The runs, their provenance and accuracy in words; this module must not know any page."""

from collections.abc import Iterator
from contextlib import suppress
from datetime import datetime
from typing import Any

import numpy as np

from eqt_cli.analysis.comparison.findings import listed
from eqt_cli.results.result import Result


def lead(result: Result) -> str:
    """Describe the experiment in a sentence."""
    labels, horizon = result.labels, result.horizon
    points = ""
    if result.is_sweep:
        swept = [each.key for each in result.swept_keys]
        keys = listed(swept) if swept else "nothing"
        points = f"{result.points} points over {keys}, each with "
    lasting = f" of {horizon:g} s" if horizon else ""
    controllers = f"{len(labels)} controllers" if len(labels) > 1 else "one controller"
    loop = f" {result.loop_in_words}" if result.loop_in_words and not result.is_sweep else ""
    comma = "; " if any(", " in title for title in result.titles) else ", "
    return (
        f"{points}{result.runs} runs{lasting} for each of {controllers} "
        f"({comma.join(result.titles)}) on {result.group_name or 'a group'}; the same initial "
        f"states for all of them.{loop}"
    )


def day(result: Result) -> str:
    """Return the day of the run, such as ``2026-11-22``; empty if unknown."""
    with suppress(ValueError):
        return datetime.fromisoformat(result.provenance.get("started", "")).date().isoformat()
    return ""


def accuracy(result: Result) -> Iterator[str]:
    """Yield sentences on the accuracy of the numbers."""
    yield from _energy(result)
    values = result.metric("error_estimate") if "error_estimate" in result.metrics else np.array([])
    estimates = values[np.isfinite(values)]
    if estimates.size:
        yield (
            "Global error, estimated run by run from a tighter solve: largest "
            f"{estimates.max():.2g}, median {np.median(estimates):.2g}."
        )
    check = result.cross_check
    if check is not None:
        yield (
            f"Cross-check by {check.method} on {check.runs} runs per controller: largest "
            f"difference {check.difference:.2g}, {'within' if check.holds else 'BEYOND'} the bound "
            f"of {check.bound:.1g}."
        )


def _energy(result: Result) -> Iterator[str]:
    """Yield the residual of the energy balance, for the laws that claim one."""
    if "energy_residual" not in result.metrics:
        return
    residuals = {
        title: result.metric("energy_residual", c)[result.good[..., c, :]]
        for c, title in enumerate(result.titles)
    }
    kept = {title: found[np.isfinite(found)] for title, found in residuals.items()}
    balanced = [title for title, found in kept.items() if found.size]
    if not balanced:
        return
    largest = max(kept[title].max() for title in balanced)
    others = [title for title, found in residuals.items() if found.size and not kept[title].size]
    whose = f" of {listed(balanced)}; none is claimed of {listed(others)}" if others else ""
    yield (
        f"Energy balance: |L(t) + ∫dissipation − L(0)| stays below {largest:.1g} of L(0) "
        f"in every run{whose}."
    )


def provenance(result: Result) -> list[tuple[str, str]]:
    """Return the provenance as names and values."""
    attributes, origin = result.attributes, result.provenance
    found = [(str(name), _words(value, origin)) for name, value in origin.items() if value]
    for name, key in (("digest", "digest"), ("theory", "references")):
        found.append((name, str(attributes.get(key, ""))))
    return [(name, words) for name, words in found if words]


def _words(value: Any, origin: dict[str, Any]) -> str:
    """Return a value of the provenance in words; for other sessions, only their differences."""
    if not isinstance(value, list):
        return str(value)
    sessions = [session.items() for session in value if isinstance(session, dict)]
    return "; ".join(
        ", ".join(f"{name} {found}" for name, found in session if origin.get(name) != found)
        for session in sessions
    )
