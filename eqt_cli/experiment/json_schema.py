"""One JSON schema of configurations, for editors: the models, and every registered component."""

from __future__ import annotations

from typing import Any

from pydantic import TypeAdapter

from eqt_cli.controllers import controllers
from eqt_cli.core.registry import Registry, summary
from eqt_cli.engines import engines
from eqt_cli.ensemble.designs import Surroundings, designs
from eqt_cli.ensemble.poses import pose_distributions
from eqt_cli.ensemble.velocities import velocity_distributions
from eqt_cli.experiment.components import option_names
from eqt_cli.experiment.schema import Config
from eqt_cli.experiment.solver import DEFAULT_ENGINE, Judgement
from eqt_cli.experiment.source import parse_key
from eqt_cli.experiment.sweeping import FIXED
from eqt_cli.groups import groups
from eqt_cli.references import references


def json_schema() -> dict[str, Any]:
    """The schema of a configuration file, JSON Schema draft 2020-12."""
    schema = _overlapping(Config.model_json_schema())
    shared: dict[str, Any] = schema["$defs"]
    top = schema["properties"]
    top["group"]["examples"] = [name for kind in groups.all() for name in kind.examples()]
    top["controllers"]["items"] = _any_of(controllers, shared, extra={"label": {"type": "string"}})
    initial = shared["InitialSection"]["properties"]
    shared["PoseDistribution"] = _any_of(pose_distributions, shared)
    one = {"$ref": "#/$defs/PoseDistribution"}
    initial["pose"] |= {"anyOf": [one, {"type": "array", "items": one}]}
    initial["velocity"] |= _any_of(velocity_distributions, shared)
    top["reference"] = _reference(top["reference"], shared)
    top["solver"] = _solver(top["solver"], shared)
    shared["SweepBlock"] = _sweep_block(schema)
    top["sweep"]["anyOf"][0]["items"] = {"$ref": "#/$defs/SweepBlock"}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "eqt experiment",
        **{key: value for key, value in schema.items() if key != "title"},
    }


def _overlapping(schema: Any) -> Any:
    """The same with `anyOf` for `oneOf`: a list of numbers fits several members of our unions."""
    if isinstance(schema, dict):
        return {
            "anyOf" if key == "oneOf" else key: _overlapping(value) for key, value in schema.items()
        }
    return [_overlapping(entry) for entry in schema] if isinstance(schema, list) else schema


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
        "required": ["kind", *options["required"]],
        "additionalProperties": False,
    }


def _options(component: type, shared: dict[str, Any]) -> dict[str, Any]:
    """The object schema of a component's options; what it refers to goes to `shared`."""
    schema = TypeAdapter(component).json_schema()
    shared |= schema.pop("$defs", {})
    properties = {name: schema["properties"][name] for name in option_names(component)}
    required = [name for name in schema.get("required", []) if name in properties]
    return {"properties": properties, "required": required}


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


def _sweep_block(schema: dict[str, Any]) -> dict[str, Any]:
    """One block of a sweep: a design by name, over keys of the configuration."""
    swept = {
        key: {"description": meaning}
        for key, meaning in config_keys(schema).items()
        if parse_key(key, "")[0] not in FIXED and key != "ensemble.runs"
    }
    sections = "|".join(name for name in schema["properties"] if name not in FIXED)

    def axes(axis: dict[str, Any]) -> dict[str, Any]:
        return {
            "type": "object",
            "minProperties": 1,
            "properties": swept,  # for completion; the pattern checks these keys as well
            "patternProperties": {_KEY_IN.format(sections): axis},
            "additionalProperties": False,
        }

    around = Surroundings(axes, {"$ref": "#/$defs/SweepBlock"})
    kinds = {
        design.name: {"description": summary(design), **design.schema(around)}
        for design in designs.all()
    }
    return {
        "type": "object",
        "description": "One block; blocks multiply, the first one changing slowest.",
        "properties": kinds,
        "minProperties": 1,
        "maxProperties": 1,
        "additionalProperties": False,
    }


_KEY_IN = r"^(?!ensemble\.runs$)({})(\[[0-9]+\])*(\.[^.\[\]]+(\[[0-9]+\])*)*$"
"""Keys such as ``gains.kp`` or ``controllers[0].label``, within these sections."""


def config_keys(schema: dict[str, Any]) -> dict[str, str]:
    """The keys of a configuration, as ``gains.kp`` and ``controllers[0].label``, with meanings."""
    found: dict[str, str] = {}

    def below(place: dict[str, Any], prefix: str) -> None:
        for choice in _choices(place, schema):
            for name, entry in choice.get("properties", {}).items():
                key = f"{prefix}.{name}" if prefix else name
                meaning = entry.get("description") or _resolved(entry, schema).get("description")
                found.setdefault(key, " ".join((meaning or "").split()))
                below(entry, key)
        if place.get("type") == "array":
            below(place["items"], f"{prefix}[0]")

    below(schema, "")
    return found


def _choices(place: dict[str, Any], schema: dict[str, Any]) -> list[dict[str, Any]]:
    """The alternatives at a place of a schema."""
    place = _resolved(place, schema)
    # Where a reference has a description beside it, pydantic 2.8 wraps it into an `allOf`.
    choices = place.get("anyOf") or place.get("allOf")
    if not choices or "properties" in place:
        return [place]
    return [found for choice in choices for found in _choices(choice, schema)]


def _resolved(place: dict[str, Any], schema: dict[str, Any]) -> dict[str, Any]:
    name = place.get("$ref", "").rpartition("/")[2]
    found: dict[str, Any] = schema["$defs"][name] if name else place
    return found
