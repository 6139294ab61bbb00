"""What was run, where and how accurately, as words; it must not know how a page shows them."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from eqt_cli.plots.drawing.swept import Swept
from eqt_cli.results.headline import MEANS, headline
from eqt_cli.store.reader import Results

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


def facts(results: Results) -> Facts:
    """Everything that a result says of itself."""
    attributes = results.attributes
    labels = [str(label) for label in results.coordinate("controller")]
    sweeps = "point" in results.dimensions
    horizon = float(results.coordinate("time")[-1]) if results.has("time") else None
    controllers = f"{len(labels)} controllers" if len(labels) > 1 else "one controller"
    shared = "the same initial states for all of them"
    return Facts(
        title=str(attributes.get("title", results.path.parent.name)),
        group=str(attributes.get("group", "")),
        lead=(
            f"{_points(results) if sweeps else ''}{results.dimensions['run']} runs"
            f"{f' of {horizon:g} s' if horizon else ''} for each of {controllers} "
            f"({', '.join(labels)}) on {attributes.get('group', 'a group')}; {shared}."
        ),
        horizon=horizon,
        units={name: _unit(results, name) for name in MEANS},
        headline=[] if sweeps else [asdict(row) for row in headline(results)],
        accuracy=list(_accuracy(results)),
        provenance=_provenance(results),
        config=str(attributes.get("config", "")).rstrip(),
        failed=int(np.count_nonzero(results["status"])),
    )


def _points(results: Results) -> str:
    """How many points a sweep has, and over what."""
    keys = " and ".join(axis.key for axis in Swept(results, "report").axes) or "nothing"
    return f"{results.dimensions['point']} points over {keys}, each with "


def _unit(results: Results, name: str) -> str:
    unit = results.units(name)
    return {"1": "", "mixed": "mixed units"}.get(unit, unit)


def _accuracy(results: Results) -> list[str]:
    sentences = []
    good = results["status"] == 0
    if results.has("energy_residual"):
        residual = results["energy_residual"][good]
        if np.isfinite(residual).any():
            sentences.append(
                "Energy balance: |L(t) + ∫damping − L(0)| stays below "
                f"{np.nanmax(residual):.0e} of L(0) in every run."
            )
    if results.has("error_estimate"):
        estimates = results["error_estimate"][good]
        if np.isfinite(estimates).any():
            sentences.append(
                "Global error, estimated run by run from a tighter solve: largest "
                f"{np.nanmax(estimates):.1e}, median {np.nanmedian(estimates):.1e}."
            )
    if "cross_check_difference" in results.attributes:
        check = results.attributes
        holds = float(check["cross_check_difference"]) <= float(check["cross_check_bound"])
        sentences.append(
            f"Cross-check by {check['cross_check_method']} on {check['cross_check_runs']} runs per "
            f"controller: largest difference {float(check['cross_check_difference']):.1e}, "
            f"{'within' if holds else 'BEYOND'} the bound of "
            f"{float(check['cross_check_bound']):.0e}."
        )
    return sentences


def _provenance(results: Results) -> list[Fact]:
    attributes = results.attributes
    try:
        origin = json.loads(str(attributes.get("provenance", "{}")))
    except ValueError:
        origin = {}
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
