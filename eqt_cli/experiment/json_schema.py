"""One JSON schema of configurations, for editors: the models, and every registered component."""

from __future__ import annotations

from typing import Any

from pydantic import TypeAdapter

from eqt_cli.controllers import controllers
from eqt_cli.core.registry import Registry, summary
from eqt_cli.engines import engines
from eqt_cli.ensemble.poses import pose_distributions
from eqt_cli.ensemble.velocities import velocity_distributions
from eqt_cli.experiment.schema import Config
from eqt_cli.experiment.solver import DEFAULT_ENGINE, Judgement
from eqt_cli.groups import groups
from eqt_cli.references import references


def json_schema() -> dict[str, Any]:
    """The schema of a configuration file, JSON Schema draft 2020-12."""
    schema = Config.model_json_schema()
    shared: dict[str, Any] = schema["$defs"]
    top = schema["properties"]
    top["group"]["examples"] = [name for kind in groups.all() for name in kind.examples()]
    top["controllers"]["items"] = _any_of(controllers, shared, extra={"label": {"type": "string"}})
    initial = shared["InitialSection"]["properties"]
    for key, registry in (("pose", pose_distributions), ("velocity", velocity_distributions)):
        initial[key] |= _any_of(registry, shared)
    top["reference"] = _reference(top["reference"], shared)
    top["solver"] = _solver(top["solver"], shared)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "eqt experiment",
        **{key: value for key, value in schema.items() if key != "title"},
    }


def _any_of(
    registry: Registry[Any], shared: dict[str, Any], extra: dict[str, Any] | None = None
) -> dict[str, Any]:
    """A component of a registry: its name, or a mapping with `kind` and its options."""
    names = {"enum": registry.names(), "type": "string"}
    mappings = [_mapping(component, shared, extra or {}) for component in registry.all()]
    return {"anyOf": [names, *mappings]}


def _mapping(component: type, shared: dict[str, Any], extra: dict[str, Any]) -> dict[str, Any]:
    options = _options(component, shared)
    kind = {"const": component.name}  # type: ignore[attr-defined]  # registered, so it has one
    return {
        "type": "object",
        "description": summary(component),
        "properties": {"kind": kind, **extra, **options["properties"]},
        "required": ["kind", *options.get("required", [])],
        "additionalProperties": False,
    }


def _options(component: type, shared: dict[str, Any]) -> dict[str, Any]:
    """The object schema of a component's options; what it refers to goes to `shared`."""
    schema = TypeAdapter(component).json_schema()
    shared |= schema.pop("$defs", {})
    return {"properties": {}, **schema}


def _reference(section: dict[str, Any], shared: dict[str, Any]) -> dict[str, Any]:
    anything: dict[str, Any] = {}
    common = {"pose": anything, "velocity": anything}
    kinds = [_mapping(component, shared, common) for component in references.all()]
    for kind in kinds:
        if kind["properties"]["kind"]["const"] == "torque":  # what a section without `kind` is
            kind["required"].remove("kind")
    return {"description": section["description"], "anyOf": kinds}


def _solver(section: dict[str, Any], shared: dict[str, Any]) -> dict[str, Any]:
    properties: dict[str, Any] = {
        "engine": {"enum": engines.names(), "type": "string", "default": DEFAULT_ENGINE}
    }
    owners: list[type] = [Judgement, *engines.all()]
    for owner in owners:
        properties |= _options(owner, shared)["properties"]
    return {
        "type": "object",
        "description": section["description"],
        "properties": properties,
        "additionalProperties": False,
    }
