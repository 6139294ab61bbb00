"""Lists the keys of a configuration with their values and meanings, from its JSON schema."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import yaml

from eqt_cli.core.errors import EqtError, suggestion

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
    return [_joined(key, alternatives, schema) for key, alternatives in entries.items()]


def within(keys: Sequence[Key], requested: str) -> list[Key]:
    """Return a key and the keys in it; every entry of a list has the keys of the first.

    Raises
    ------
    EqtError
        If there is no such key.
    """
    plain = re.sub(r"\[\d+\]", "[0]", requested)
    found = [
        each
        for each in keys
        if each.key == plain or each.key.startswith((f"{plain}.", f"{plain}["))
    ]
    if not found:
        names = [each.key for each in keys]
        last = [name for name in names if name.rpartition(".")[2] == plain]
        hint = f"; did you mean '{last[0]}'?" if last else suggestion(plain, names)
        top = [name for name in names if not re.search(r"[.\[]", name)]
        known = hint or f"; known are: {', '.join(top)}"
        raise EqtError(f"no key '{requested}' in a configuration{known}")
    return found


def _joined(key: str, entries: list[tuple[Schema, list[str]]], schema: Schema) -> Key:
    """Return a key that several alternatives may have, such as `kind`."""
    name = key.rpartition(".")[2]
    together = {"anyOf": [entry for entry, _ in entries]}
    meanings = dict.fromkeys(described(entry, schema) for entry, _ in entries)
    defaults = dict.fromkeys(default_of(name, entry, required) for entry, required in entries)
    meaning = " ".join(" ".join(filter(None, meanings)).split())
    return Key(key, value_of(together, schema), " or ".join(defaults), meaning)


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
    return [found for choice in several for found in choices(choice, schema)]


def described(entry: Schema, schema: Schema) -> str:
    """Return the first paragraph of the description of an entry."""
    text = entry.get("description") or dereferenced(entry, schema).get("description", "")
    return str(text).partition("\n\n")[0]


def default_of(key: str, entry: Schema, required: list[str]) -> str:
    """Return ``required``, ``optional``, or the default as code."""
    if key in required:
        return "required"
    default = entry.get("default")
    return "optional" if default in (None, {}, []) else f"`{_plain(default)}`"


def _plain(value: Any) -> str:
    return str(yaml.safe_dump(value, default_flow_style=True)).strip().removesuffix("\n...")


def value_of(entry: Schema, schema: Schema) -> str:
    """Return the possible values in words."""
    words = dict.fromkeys(word for each in choices(entry, schema) for word in _words(each, schema))
    words.pop("null", None)
    if "number" in words:
        words.pop("constant", None)
    if set(words) == {"number", "text"}:
        words = {"expression": None}
    names = list(words) or ["anything"]
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + " or " + names[-1]


def _words(option: Schema, schema: Schema) -> Iterator[str]:
    if "enum" in option:
        yield from (f"`{word}`" for word in option["enum"])
    else:
        yield _word(option, schema)


def _word(option: Schema, schema: Schema) -> str:
    if "const" in option:
        return f"`{option['const']}`"
    kind = option.get("type")
    if kind == "array":
        inner = value_of(option.get("items", {}), schema)
        return {
            "number": "list",
            "list": "matrix",
            "list of expressions": "matrix of expressions",
        }.get(inner, f"list of {_plural(inner)}")
    if kind == "string" and "constant expression" in option.get("description", ""):
        return "constant"
    words = {"object": "mapping", "integer": "whole number", "boolean": "`true`, `false`"}
    named = {"string": "text", "number": "number", "null": "null", None: "anything"}
    return (words | named)[kind]


def _plural(words: str) -> str:
    return re.sub(r"(number|list|mapping|expression)\b", r"\1s", words)
