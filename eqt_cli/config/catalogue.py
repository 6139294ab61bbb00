"""Every kind of component by its name in `eqt list`; importing this module is fast."""

from importlib import import_module
from typing import Any

from eqt_cli.core.registry import Registry, registry_of

KINDS = {
    "groups": "eqt_cli.groups",
    "controllers": "eqt_cli.controllers",
    "references": "eqt_cli.references",
    "forces": "eqt_cli.vehicle.forces",
    "actuators": "eqt_cli.vehicle.actuators",
    "sensors": "eqt_cli.vehicle.sensors",
    "estimators": "eqt_cli.vehicle.estimators",
    "engines": "eqt_cli.engines",
    "poses": "eqt_cli.ensemble.poses",
    "velocities": "eqt_cli.ensemble.velocities",
    "designs": "eqt_cli.ensemble.designs",
    "executors": "eqt_cli.execution.executors",
    "figures": "eqt_cli.plots.figures",
    "certificates": "eqt_cli.analysis.certificates",
    "claims": "eqt_cli.analysis.comparison.claims",
}
"""The packages of the components, by the plural of their kind, in the order of `eqt list`."""


def registry(kind: str) -> Registry[Any]:
    """Return the registry of a kind."""
    import_module(KINDS[kind])
    return registry_of(KINDS[kind])
