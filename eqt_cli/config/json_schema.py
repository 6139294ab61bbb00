"""The JSON schema of configurations, for editors, with every registered component."""

from collections.abc import Callable
from functools import cache
from typing import Any, TypeAlias

from pydantic import TypeAdapter
from pydantic.json_schema import GenerateJsonSchema
from pydantic_core import core_schema

from eqt_cli.config.key_descriptions import choices, keys_of
from eqt_cli.config.option_scales import COMPONENTS
from eqt_cli.config.schema import DEFAULT_ENGINE, FIXED, Config, Judgement, OwnGainsSection
from eqt_cli.core.component import option_of_field
from eqt_cli.core.problems import parse_key
from eqt_cli.core.registry import Registry, meanings, summary
from eqt_cli.core.validation import option_names
from eqt_cli.engines import engines
from eqt_cli.ensemble.designs import designs
from eqt_cli.ensemble.poses import pose_distributions
from eqt_cli.ensemble.sweep import BLOCK
from eqt_cli.groups import groups
from eqt_cli.references import references

Axes: TypeAlias = Callable[[dict[str, Any]], dict[str, Any]]
"""Returns the schema of a mapping from keys to axes, from that of one axis."""

KIND = "The component; the other keys are its options."
LABEL = {"type": "string", "description": "The name of the law in tables and figures; its kind."}
GAINS = "Gains of this law, where they differ from the section `gains`."


def json_schema() -> dict[str, Any]:
    """Return the schema of a configuration file, JSON Schema draft 2020-12."""
    schema = Config.model_json_schema(schema_generator=_Generator)
    shared: dict[str, Any] = schema["$defs"]
    top = schema["properties"]
    top["group"]["examples"] = [name for kind in groups.all() for name in kind.examples()]
    own_gains = OwnGainsSection.model_json_schema(schema_generator=_Generator)
    shared |= own_gains.pop("$defs", {}) | {"OwnGainsSection": own_gains}
    gains = {"$ref": "#/$defs/OwnGainsSection", "description": GAINS}
    for place, registry in COMPONENTS.items():
        if place not in ("reference", "initial.pose", "solver"):
            key = _key_at(place, schema)
            lists = [kind for kind in key.get("anyOf", [key]) if kind.get("type") == "array"]
            component = lists[0]["items"] if lists else key
            laws_only = {"label": LABEL, "gains": gains} if place == "controllers" else {}
            component |= _any_of(registry, shared, laws_only)
    shared["PoseDistribution"] = _any_of(pose_distributions, shared)
    one = {"$ref": "#/$defs/PoseDistribution"}
    _key_at("initial.pose", schema)["anyOf"] = [one, {"type": "array", "items": one}]
    top["reference"] = _reference(top["reference"], shared)
    top["solver"] = _solver(top["solver"], shared)
    shared["SweepBlock"] = _sweep_block(schema)
    top["sweep"]["anyOf"][0]["items"] = {"$ref": "#/$defs/SweepBlock"}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "eqt experiment",
        **{key: value for key, value in schema.items() if key != "title"},
    }


def _key_at(place: str, schema: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of a key, such as ``plant.forces``, to be changed in place."""
    section = schema
    *names, key = place.split(".")
    for name in names:
        found = choices(section["properties"][name], schema)
        section = next(each for each in found if "properties" in each)
    entry: dict[str, Any] = section["properties"][key]
    return entry


class _Generator(GenerateJsonSchema):
    """Pydantic's generator, with meanings from docstrings, and with `anyOf` for unions."""

    def dataclass_schema(self, schema: core_schema.DataclassSchema) -> dict[str, Any]:
        """Return the options, each with its meaning."""
        return _with_meanings(super().dataclass_schema(schema), schema["cls"])

    def model_schema(self, schema: core_schema.ModelSchema) -> dict[str, Any]:
        """Return the keys of a section, each with its meaning."""
        section = _with_meanings(super().model_schema(schema), schema["cls"])
        return section | {"description": summary(schema["cls"])}

    def tagged_union_schema(self, schema: core_schema.TaggedUnionSchema) -> dict[str, Any]:
        """Return `anyOf` for `oneOf`, because a list of numbers may fit several members."""
        return {"anyOf": super().tagged_union_schema(schema)["oneOf"]}


def _with_meanings(schema: dict[str, Any], kind: type) -> dict[str, Any]:
    """Add the meanings in a class's docstring to the keys of its schema."""
    texts = {option_of_field(name): text for name, text in meanings(kind).items()}
    for name, option in schema["properties"].items():
        if name in texts:
            schema["properties"][name] = {"description": texts[name]} | option
    return schema


def _any_of(
    registry: Registry[Any], shared: dict[str, Any], extra: dict[str, Any] | None = None
) -> dict[str, Any]:
    """Return the schema of a component: a name, or a mapping with `kind` and options."""
    names = {"enum": registry.names(), "type": "string"}
    mappings = [_mapping(component, shared, extra or {}) for component in registry.all()]
    return {"anyOf": [names, *mappings]}


def _mapping(component: type, shared: dict[str, Any], extra: dict[str, Any]) -> dict[str, Any]:
    options = _options(component, shared)
    name = component.name  # type: ignore[attr-defined]  # registered, so it has one
    kind = {"const": name, "description": KIND}
    return {
        "type": "object",
        "description": summary(component),
        "properties": {"kind": kind, **extra, **options["properties"]},
        "required": ["kind", *options["required"]],
        "additionalProperties": False,
    }


@cache
def _generated(component: type) -> dict[str, Any]:
    """Return the schema of a component; cached, because pydantic takes milliseconds."""
    return TypeAdapter(component).json_schema(schema_generator=_Generator)


def _options(component: type, shared: dict[str, Any]) -> dict[str, Any]:
    """Return the object schema of a component's options; add definitions to `shared`."""
    schema = _generated(component)
    shared |= schema.get("$defs", {})
    properties = {name: schema["properties"][name] for name in option_names(component)}
    required = [name for name in schema.get("required", []) if name in properties]
    return {"properties": properties, "required": required}


def _reference(section: dict[str, Any], shared: dict[str, Any]) -> dict[str, Any]:
    common = {
        "pose": {
            "description": "Q_d(0): identity, a matrix, or rotation and translations by name."
        },
        "velocity": {"description": "V_d(0): a list in the body frame, or parts by name."},
    }
    kinds = [
        _mapping(component, shared, {key: common[key] for key in component.starts_from})
        for component in references.all()
    ]
    for kind in kinds:
        if kind["properties"]["kind"]["const"] == "torque":  # the default of `kind`
            kind["required"].remove("kind")
    return {"description": section["description"], "anyOf": kinds}


def _solver(section: dict[str, Any], shared: dict[str, Any]) -> dict[str, Any]:
    properties: dict[str, Any] = {
        "engine": {
            "description": "The engine that integrates the equations (`eqt list engines`).",
            "enum": engines.names(),
            "type": "string",
            "default": DEFAULT_ENGINE,
        },
        **_options(Judgement, shared)["properties"],
    }
    by_key: dict[str, dict[str, dict[str, Any]]] = {}
    for engine in engines.all():
        for name, option in _options(engine, shared)["properties"].items():
            by_key.setdefault(name, {})[engine.name] = option
    properties |= {name: _of_engines(options) for name, options in by_key.items()}
    return {
        "type": "object",
        "description": section["description"],
        "properties": properties,
        "additionalProperties": False,
    }


def _of_engines(options: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Return a key of some engines, with its meaning and its default for each of them."""
    key = dict(next(iter(options.values())))
    differing = len({str(option.get("default")) for option in options.values()}) > 1
    if differing:
        del key["default"]
    texts = [
        f"{engine}: {option.get('description', '')}"
        + (f" Default: {option['default']}." if differing and "default" in option else "")
        for engine, option in options.items()
    ]
    return key | {"description": " ".join(texts)}


def _sweep_block(schema: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of a block of a sweep: a design by name, over keys of the configuration."""
    swept = {
        each.key: {"description": each.meaning}
        for each in keys_of(schema)
        if parse_key(each.key)[0] not in FIXED and each.key != "ensemble.runs"
    }
    sections = "|".join(name for name in schema["properties"] if name not in FIXED)

    def axes(axis: dict[str, Any]) -> dict[str, Any]:
        return {
            "type": "object",
            "properties": swept,  # for completion; the pattern checks these keys as well
            "patternProperties": {_KEY_IN.format(sections): axis},
            "additionalProperties": False,
        }

    kinds = {
        design.name: {
            "description": summary(design),
            **_design(design, axes, schema["$defs"]),
        }
        for design in designs.all()
    }
    return {
        "type": "object",
        "description": "One block; blocks multiply, and the first one changes slowest.",
        "properties": kinds,
        "minProperties": 1,
        "maxProperties": 1,
        "additionalProperties": False,
    }


def _design(design: Any, axes: Axes, shared: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of the section of a design."""
    options = _options(design, shared)
    if design.whole_section:
        option = options["properties"][design.whole_section]
        return _around(option | {"description": summary(design)}, axes)
    whole = {"type": "object", **options, "additionalProperties": False}
    return _around(whole, axes)


def _around(schema: Any, axes: Axes) -> Any:
    """Return the schema of a design with keys of the configuration in its mappings, and blocks."""
    if isinstance(schema, list):
        return [_around(entry, axes) for entry in schema]
    if not isinstance(schema, dict):
        return schema
    if schema == BLOCK:
        return {"$ref": "#/$defs/SweepBlock"}
    inner = schema.get("additionalProperties")
    # The keys are one level deeper in mappings by name.
    if isinstance(inner, dict) and "additionalProperties" in inner:
        return schema | {"additionalProperties": _around(inner, axes)}
    if isinstance(inner, dict) or inner is True:
        return schema | axes(inner if isinstance(inner, dict) else {})
    return {key: _around(entry, axes) for key, entry in schema.items()}


_KEY_IN = r"^(?!ensemble\.runs$)({})(\[[0-9]+\])*(\.[^.\[\]]+(\[[0-9]+\])*)*$"
"""Keys such as ``gains.kp`` or ``controllers[0].label``, within these sections."""
