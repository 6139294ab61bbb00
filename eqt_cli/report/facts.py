"""What was run, where and how accurately, as words; it must not know how a page shows them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.results.result import HEADLINE, Result

Fact = tuple[str, str]


@dataclass(frozen=True)
class Facts:
    """The words around the figures.

    Attributes
    ----------
    title, group
        Of the experiment.
    lead
        What was run, in a sentence.
    horizon
        s; None where the points of a sweep have horizons of their own.
    units
        Of the four means, by name; nothing for pure numbers.
    headline
        A row per controller: label, good runs, failed runs, four means, energy residual. None for
        a sweep, where a mean over all points means little.
    accuracy
        Sentences on how far the numbers can be trusted.
    provenance
        Names and values.
    config
        The resolved configuration, as YAML.
    failed
        Runs that failed, over all controllers.
    """

    title: str
    group: str
    lead: str
    horizon: float | None
    units: dict[str, str]
    headline: list[dict[str, Any]]
    accuracy: list[str]
    provenance: list[Fact]
    config: str
    failed: int


def facts(result: Result) -> Facts:
    """Everything that a result says of itself."""
    labels, horizon = result.labels, result.horizon
    controllers = f"{len(labels)} controllers" if len(labels) > 1 else "one controller"
    shared = "the same initial states for all of them"
    return Facts(
        title=result.title,
        group=result.group_name,
        lead=(
            f"{_points(result) if result.is_sweep else ''}{result.runs} runs"
            f"{f' of {horizon:g} s' if horizon else ''} for each of {controllers} "
            f"({', '.join(labels)}) on {result.group_name or 'a group'}; {shared}."
        ),
        horizon=horizon,
        units={name: _unit(result, name) for name in HEADLINE},
        headline=[] if result.is_sweep else result.headline(),
        accuracy=list(_accuracy(result)),
        provenance=_provenance(result),
        config=str(result.attributes.get("config", "")).rstrip(),
        failed=len(result.failures),
    )


def _points(result: Result) -> str:
    """How many points a sweep has, and over what."""
    keys = " and ".join(swept.key for swept in result.swept_keys) or "nothing"
    return f"{result.points} points over {keys}, each with "


def _unit(result: Result, name: str) -> str:
    unit = result.units(name)
    return {"1": "", "mixed": "mixed units"}.get(unit, unit)


def _accuracy(result: Result) -> Iterator[str]:
    residual = _finite(result, "energy_residual")
    if residual.size:
        yield (
            f"Energy balance: |L(t) + ∫damping − L(0)| stays below {residual.max():.0e} of L(0) in "
            "every run."
        )
    estimates = _finite(result, "error_estimate")
    if estimates.size:
        yield (
            "Global error, estimated run by run from a tighter solve: largest "
            f"{estimates.max():.1e}, median {np.median(estimates):.1e}."
        )
    check = result.cross_check
    if check is not None:
        yield (
            f"Cross-check by {check.method} on {check.runs} runs per controller: largest "
            f"difference {check.difference:.1e}, {'within' if check.holds else 'BEYOND'} the bound "
            f"of {check.bound:.0e}."
        )


def _finite(result: Result, name: str) -> Array:
    """The values of good runs that have one."""
    values = result.metric(name) if name in result.metrics else np.array([])
    finite: Array = values[np.isfinite(values)]
    return finite


def _provenance(result: Result) -> list[Fact]:
    attributes, origin = result.attributes, result.provenance
    found = [(str(name), _words(value, origin)) for name, value in origin.items() if value]
    digest = str(attributes.get("digest", ""))
    # "source" in results of the first versions.
    theory = str(attributes.get("references", attributes.get("source", "")))
    return [
        *found,
        *([("digest", digest)] if digest else []),
        *([("theory", theory)] if theory else []),
    ]


def _words(value: Any, origin: dict[str, Any]) -> str:
    """A value of the provenance; of other sessions, what differs from this one."""
    if not isinstance(value, list):
        return str(value)
    sessions = [session.items() for session in value if isinstance(session, dict)]
    return "; ".join(
        ", ".join(f"{name} {found}" for name, found in session if origin.get(name) != found)
        for session in sessions
    )
