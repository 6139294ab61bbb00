"""Every kind of component by the name that `eqt list` gives it, and what options one takes."""

from __future__ import annotations

from dataclasses import is_dataclass
from typing import Any

from pydantic import TypeAdapter

from eqt_cli.analysis.certificates import certificates
from eqt_cli.analysis.comparison.claims import claim_sets
from eqt_cli.controllers import controllers
from eqt_cli.core.registry import Registry
from eqt_cli.engines import engines
from eqt_cli.ensemble.designs import Design, Surroundings, designs
from eqt_cli.ensemble.executors import executors
from eqt_cli.ensemble.poses import pose_distributions
from eqt_cli.ensemble.velocities import velocity_distributions
from eqt_cli.experiment.components import option_names
from eqt_cli.groups import groups
from eqt_cli.plots import figures
from eqt_cli.references import references

REGISTRIES: dict[str, Registry[Any]] = {
    "groups": groups,
    "controllers": controllers,
    "references": references,
    "engines": engines,
    "poses": pose_distributions,
    "velocities": velocity_distributions,
    "designs": designs,
    "executors": executors,
    "figures": figures,
    "certificates": certificates,
    "claims": claim_sets,
}
"""The registries by the plural of their kind, in the order of `eqt list`."""

_ALONE = Surroundings(lambda axis: {"type": "object"}, {})


def options(component: type) -> dict[str, Any]:
    """The options of a component as a JSON schema of an object; without any, no `properties`."""
    if issubclass(component, Design):
        return component.schema(_ALONE)
    if not is_dataclass(component):
        return {}
    schema = TypeAdapter(component).json_schema()
    properties = {name: schema["properties"][name] for name in option_names(component)}
    return schema | {"properties": properties}
