"""The JSON schema of configurations, for editors, and what it says of each key.

It has every registered component.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeAlias, get_args, get_type_hints

import yaml
from pydantic import TypeAdapter
from pydantic.json_schema import GenerateJsonSchema
from pydantic_core import core_schema

from eqt_cli.base.errors import EqtError, KeyPath, parse_key, suggestion
from eqt_cli.base.option_types import Kind, Scale, has_options, option_names, owners
from eqt_cli.base.registry import meanings, option_of_field, summary
from eqt_cli.base.reporting import listed
from eqt_cli.components.groups import groups
from eqt_cli.components.vehicle import INNER
from eqt_cli.config.designs import BLOCK, designs
from eqt_cli.config.schema import Config, GainsSection, not_swept
from eqt_cli.engines.choice import AUTO
from eqt_cli.engines.engine import SolverChecks, engines


def scale_of(config: Any, key: str) -> Scale | None:
    """Return the scale of a key in a configuration with every default; None where it has none."""
    metadata = getattr(type_of(config, parse_key(key))[0], "__metadata__", ())
    return next((entry for entry in metadata if isinstance(entry, Scale)), None)


def type_of(config: Any, path: KeyPath) -> tuple[Any, Kind | None]:
    """Return the type of an option, with its marks, and the kind of component that has it.

    An option of a plugin that is not loaded has none.
    """
    *steps, option = path
    kind: Any = Config
    part: Kind | None = None
    for step in steps:
        try:
            config = config[step]
        except (KeyError, IndexError, TypeError):
            config = None
        if isinstance(step, str):
            kind = GainsSection if step == "gains" else _hints(kind).get(step)
        if isinstance(config, dict) and (part := _kind_in(kind)):
            name = config.get("kind", config.get("engine"))
            kind = next((kind for kind in part.registry.all() if kind.name == name), None)
    return _hints(kind).get(option), part


def _kind_in(hint: Any) -> Kind | None:
    """Return the kind of component that is in a type; None if none is."""
    if isinstance(hint, Kind):
        return hint
    return next(filter(None, map(_kind_in, get_args(hint))), None)


def _hints(kind: Any) -> dict[Any, Any]:
    """Return the types of the options of all classes in a type, by name."""
    return {
        option_of_field(name): hint
        for owner in owners(kind)
        for name, hint in get_type_hints(owner, include_extras=True).items()
    }


Axes: TypeAlias = Callable[[dict[str, Any]], dict[str, Any]]
"""Returns the schema of a mapping from keys to axes, from that of one axis."""


def json_schema() -> dict[str, Any]:
    """Return the schema of a configuration file, JSON Schema draft 2020-12."""
    schema = Config.model_json_schema(schema_generator=_Generator)
    shared: dict[str, Any] = schema["$defs"]
    top = schema["properties"]
    top["group"]["examples"] = [name for kind in groups.all() for name in kind.examples()]
    pose = shared["InitialSection"]["properties"]["pose"]
    shared["PoseDistribution"] = {"anyOf": pose["anyOf"]}
    one = {"$ref": "#/$defs/PoseDistribution"}
    pose["anyOf"] = [one, {"type": "array", "items": one}]
    top["gains"]["anyOf"][0]["minProperties"] = 2
    shared["Actuators"], blocks = top["actuators"]["anyOf"][0], {"$ref": "#/$defs/Actuators"}
    top["actuators"]["anyOf"][0] = blocks
    for law in top["controllers"]["items"]["anyOf"][1:]:
        law["properties"][INNER] |= blocks
    del top["reference"]["default"], top["reference"]["title"]
    top["solver"] = _solver(top["solver"], shared)
    shared["SweepBlock"] = _sweep_block(schema)
    top["sweep"]["anyOf"][0]["items"] = {"$ref": "#/$defs/SweepBlock"}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "eqt experiment",
        **{key: value for key, value in schema.items() if key != "title"},
    }


def of_files(schema: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of files, of which those that extend others need no key by themselves."""
    either = [{"required": schema["required"]}, {"required": ["extends"]}]
    return {key: x for key, x in schema.items() if key != "required"} | {"anyOf": either}


class _Generator(GenerateJsonSchema):
    """Pydantic's generator, with meanings from docstrings, and with `anyOf` for unions."""

    def dataclass_schema(self, schema: core_schema.DataclassSchema) -> dict[str, Any]:
        """Return the options, each with its meaning."""
        return _with_meanings(super().dataclass_schema(schema), schema["cls"])

    def model_schema(self, schema: core_schema.ModelSchema) -> dict[str, Any]:
        """Return the keys of a section, each with its meaning."""
        return _with_meanings(super().model_schema(schema), schema["cls"])

    def tagged_union_schema(self, schema: core_schema.TaggedUnionSchema) -> dict[str, Any]:
        """Return `anyOf` for `oneOf`, because a list of numbers may fit several members."""
        return {"anyOf": super().tagged_union_schema(schema)["oneOf"]}


def _with_meanings(schema: dict[str, Any], kind: type) -> dict[str, Any]:
    """Add the summary and the meanings in a class's docstring to its schema and to its keys."""
    texts = {option_of_field(name): text for name, text in meanings(kind).items()}
    for name, option in schema["properties"].items():
        if name in texts:
            schema["properties"][name] = {"description": texts[name]} | option
    return schema | {"description": summary(kind)}


@cache
def _generated(component: type) -> dict[str, Any]:
    """Return the schema of a component; cached, because pydantic takes milliseconds."""
    return TypeAdapter(component).json_schema(schema_generator=_Generator)


def options_of(component: type, shared: dict[str, Any]) -> dict[str, Any]:
    """Return the object schema of a component's options; add definitions to `shared`."""
    schema = _generated(component)
    shared |= schema.get("$defs", {})
    properties = {name: schema["properties"][name] for name in option_names(component)}
    required = [name for name in schema.get("required", []) if name in properties]
    return {"properties": properties, "required": required}


def _solver(section: dict[str, Any], shared: dict[str, Any]) -> dict[str, Any]:
    properties: dict[str, Any] = {
        "engine": {
            "description": "`eqt list engines`; auto is native where possible, else solve_ivp.",
            "enum": [AUTO, *engines.names()],
            "type": "string",
            "default": AUTO,
        },
        **options_of(SolverChecks, shared)["properties"],
    }
    by_key: dict[str, dict[str, dict[str, Any]]] = {}
    for engine in engines.all():
        for name, option in options_of(engine, shared)["properties"].items():
            by_key.setdefault(name, {})[engine.name] = option
    for name, options in by_key.items():
        key = dict(next(iter(options.values())))
        differs = len({str(option.get("default")) for option in options.values()}) > 1
        if differs:
            del key["default"]
        texts = []
        for engine_name, option in options.items():
            texts.append(f"{engine_name}: {option.get('description', '')}")
            if differs and "default" in option:
                texts.append(f"Default: {option['default']}.")
        properties[name] = key | {"description": " ".join(texts)}
    return {
        "type": "object",
        "description": section["description"],
        "properties": properties,
        "additionalProperties": False,
    }


def _sweep_block(schema: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of a block of a sweep: a design by name, over keys of the configuration."""
    sections = "|".join(name for name in Config.model_fields if not not_swept(name))
    swept = {
        key.key: {"description": key.meaning}
        for key in keys_of(schema)
        if not not_swept(key.key) and key.key != "ensemble.runs"
    }

    def axes(axis: dict[str, Any]) -> dict[str, Any]:
        return {
            "type": "object",
            "properties": swept,  # for completion; the pattern checks these keys as well
            "patternProperties": {_KEY_IN.format(sections): axis, _NAME: axis},
            "additionalProperties": False,
        }

    formula: dict[str, Any] = {"type": ["string", "number", "array"]}
    numbers = {"type": ["string", "integer", "array"], "description": "Numbers of the points."}
    condition = {"type": ["string", "array"], "description": "A condition of the points."}
    rules = {"where": condition, "points": numbers}
    rules["set"] = {"description": "Keys that follow, by formulas."} | axes(formula)
    kinds = dict(rules)
    for design in designs.all():
        text = {"description": summary(design)}
        options = options_of(design, schema["$defs"])
        section = {"type": "object", **options, "additionalProperties": False}
        if design.whole_section:
            section = options["properties"][design.whole_section] | text
        kinds[design.name] = text | _around(section, axes)
    return {
        "type": "object",
        "description": "One block; blocks multiply, and the first one changes slowest.",
        "properties": kinds,
        "minProperties": 1,
        "anyOf": [{"maxProperties": 1}, {"propertyNames": {"enum": list(rules)}}],
        "additionalProperties": False,
    }


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


_NAME = rf"^(?!({'|'.join(Config.model_fields)})$)[A-Za-z_][A-Za-z_0-9]*$"
"""Names that are no keys, for formulas."""

_KEY_IN = r"^(?!ensemble\.runs$)({})(\[[0-9]+\])*(\.[^.\[\]]+(\[[0-9]+\])*)*$"
"""Keys such as ``gains.kp`` or ``controllers[0].label``, within these sections."""


Schema = dict[str, Any]


@dataclass(frozen=True)
class Key:
    """A key of a configuration.

    Attributes
    ----------
    key
        The key as in overrides: ``gains.kp``, ``controllers[0].label``.
    value
        Its possible values in words; code is between backticks.
    default
        ``required``, ``optional``, or the value between backticks.
    meaning
        A sentence; may be empty.
    """

    key: str
    value: str
    default: str
    meaning: str


def keys_of(schema: Schema) -> list[Key]:
    """Return every key, sections before their keys."""
    entries: dict[str, list[tuple[Schema, list[str]]]] = {}

    def visit(place: Schema, prefix: str) -> None:
        for choice in choices(place, schema):
            for name, entry in choice.get("properties", {}).items():
                key = f"{prefix}.{name}" if prefix else name
                entries.setdefault(key, []).append((entry, choice.get("required", [])))
                visit(entry, key)
        if place.get("type") == "array":
            visit(place["items"], f"{prefix}[0]")

    visit(schema, "")
    keys = []
    for key, alternatives in entries.items():  # which several kinds may have, such as `kind`
        name = key.rpartition(".")[2]
        value = value_of({"anyOf": [entry for entry, _ in alternatives]}, schema)
        defaults = [default_of(name, entry, required) for entry, required in alternatives]
        texts = dict.fromkeys(described(entry, schema) for entry, _ in alternatives)
        meaning = " ".join(" ".join(filter(None, texts)).split())
        keys.append(Key(key, value, " or ".join(dict.fromkeys(defaults)), meaning))
    return keys


def keys_of_component(component: type) -> list[Key]:
    """Return the options of a component, and the keys in them."""
    shared: Schema = {}
    schema = options_of(component, shared) if has_options(component) else {}
    return keys_of(schema | {"$defs": shared})


def within(keys: Sequence[Key], requested: str) -> list[Key]:
    """Return a key and the keys in it; every entry of a list has the keys of the first.

    Raises
    ------
    EqtError
        If there is no such key.
    """
    plain = re.sub(r"\[\d+\]", "[0]", requested)
    inner = f"{plain}.", f"{plain}["
    inside = [key for key in keys if key.key == plain or key.key.startswith(inner)]
    if not inside:
        names = [key.key for key in keys]
        last = [name for name in names if name.rpartition(".")[2] == plain]
        hint = f"; did you mean '{last[0]}'?" if last else suggestion(plain, names)
        top = [name for name in names if not re.search(r"[.\[]", name)]
        listed = hint or f"; known are: {', '.join(top)}"
        raise EqtError(f"no key '{requested}' in a configuration{listed}")
    return inside


def dereferenced(entry: Schema, schema: Schema) -> Schema:
    """Return the target of a reference, and any other entry unchanged."""
    name = entry.get("$ref", "").rpartition("/")[2]
    return schema["$defs"][name] if name else entry


def choices(entry: Schema, schema: Schema) -> list[Schema]:
    """Return the alternatives at a place of a schema."""
    entry = dereferenced(entry, schema)
    # pydantic 2.8 wraps a reference with a description into an `allOf`.
    several = entry.get("anyOf") or entry.get("allOf")
    if not several or "properties" in entry:
        return [entry]
    return [inner for choice in several for inner in choices(choice, schema)]


def described(entry: Schema, schema: Schema) -> str:
    """Return the first paragraph of the description of an entry."""
    text = entry.get("description") or dereferenced(entry, schema).get("description", "")
    return str(text).partition("\n\n")[0]


def default_of(key: str, entry: Schema, required: list[str]) -> str:
    """Return ``required``, ``optional``, or the default as code."""
    if key in required:
        return "required"
    default = entry.get("default")
    if default in (None, {}, []):
        return "optional"
    text = str(yaml.safe_dump(default, default_flow_style=True)).strip().removesuffix("\n...")
    return f"`{text}`"


def value_of(entry: Schema, schema: Schema) -> str:
    """Return the possible values in words."""
    words: dict[str, None] = {}
    for choice in choices(entry, schema):
        if "enum" in choice:
            words |= dict.fromkeys(f"`{name}`" for name in choice["enum"])
        else:
            words[_word(choice, schema)] = None
    words.pop("null", None)
    if "number" in words:
        words.pop("constant", None)
    if set(words) == {"number", "text"}:
        return "expression"
    return listed(list(words) or ["name", "mapping"], "or")  # of a kind that plugins alone have


def _word(option: Schema, schema: Schema) -> str:
    if "const" in option:
        return f"`{option['const']}`"
    kind = option.get("type")
    if kind == "array":
        inner = value_of(option.get("items", {}), schema)
        plural = re.sub(r"(?<!`)(name|number|list|mapping|expression)\b", r"\1s", inner)
        return _LISTS.get(inner, f"list of {plural}")
    if kind == "string" and "constant expression" in option.get("description", ""):
        return "constant"
    words = {"object": "mapping", "integer": "whole number", "boolean": "`true`, `false`"}
    named = {"string": "text", "number": "number", "null": "null", None: "anything"}
    return (words | named)[kind]


_LISTS = {"number": "list", "list": "matrix", "list of expressions": "matrix of expressions"}
