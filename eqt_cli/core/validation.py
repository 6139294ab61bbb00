"""Validates plain data, and describes its errors, including unknown keys."""

import dataclasses
import json
import math
from collections.abc import Callable, Iterable, Mapping
from copy import deepcopy
from functools import lru_cache
from typing import Any, TypeVar, get_args, get_type_hints

from pydantic import BaseModel, Discriminator, TypeAdapter, ValidationError

from eqt_cli.core.component import option_of_field
from eqt_cli.core.errors import suggestion
from eqt_cli.core.problems import KeyPath, Problems
from eqt_cli.core.registry import Registry, meanings

T = TypeVar("T")

_UNKNOWN_KEY = "unknown key"
_MISSING = "missing; this key is required"

_EXPECTED = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "text",
    "bool_type": "true or false",
    "list_type": "a list",
    "dict_type": "a mapping",
    "model_type": "a mapping",
    "dataclass_type": "a mapping",
    "finite_number": "a finite number",
    "greater_than": "a number greater than {gt:g}",
    "greater_than_equal": "a whole number of at least {ge}",
    "less_than": "a whole number less than {lt}",
    "less_than_equal": "a number of at most {le:,.15g}",
    "too_short": "at least {min_length} entry",
    "literal_error": "{expected}",
    "string_pattern_mismatch": "letters, digits, '.', '_' and '-', with a letter or digit first",
}
"""Expectations in words, by pydantic's type of error."""


# Values -------------------------------------------------------------------------------------------


def validated(kind: Any, data: Any, problems: Problems, common: tuple[str, ...] = ()) -> Any:
    """Return the data as the type `kind`, or None after noting its errors.

    Unknown keys are noted, and the rest is validated without them.

    Parameters
    ----------
    common
        Keys that `data` may have in addition to those of its type.
    """
    try:
        # As JSON, because strict validation accepts a mapping for a dataclass only in JSON.
        return _adapter(kind).validate_json(json.dumps(data, default=str))
    except ValidationError as error:
        unknown = _note_errors(error, data, kind, problems, common)
    return validated(kind, _without(data, unknown), problems, common) if unknown else None


def fields_of(model: type[BaseModel], data: Any, problems: Problems) -> dict[str, Any]:
    """Return the valid fields of a model by name, and defaults; each is validated by itself."""
    found = {}
    for name, field in model.model_fields.items():
        if name in data:
            value = validated(field.rebuild_annotation(), data[name], problems.at(name))
        elif field.is_required():
            problems.at(name).add(f"{_MISSING}: {_meanings(model)[name]}")
            value = None
        else:
            value = field.get_default(call_default_factory=True)
        if value is not None:
            found[name] = value
    return found


def known_keys(kind: Any, path: KeyPath, common: tuple[str, ...] = ()) -> dict[str, str]:
    """Return the keys at a place in data of a type, with their meanings."""
    for step in path:
        hints = [get_type_hints(owner) for owner in owners(kind)]
        kind = next((hint[str(step)] for hint in hints if str(step) in hint), kind)
    found = dict.fromkeys(() if path else common, "")
    for owner in owners(kind):
        found |= _meanings(owner)
    return found


def _meanings(owner: type) -> dict[str, str]:
    """Return the meanings of the keys of a model or component, from its docstring."""
    texts = {option_of_field(name): text for name, text in meanings(owner).items()}
    examples: dict[str, list[Any]] = (
        {name: field.examples or [] for name, field in owner.model_fields.items()}
        if issubclass(owner, BaseModel)
        else {name: [] for name in option_names(owner)}
    )
    return {
        name: texts.get(name, "").removesuffix(".")
        + "".join(f", for example {name}: {each}" for each in given)
        for name, given in examples.items()
    }


def owners(kind: Any) -> list[type]:
    """Return the models and dataclasses that a value of a type may be or contain."""
    if isinstance(kind, type) and (dataclasses.is_dataclass(kind) or issubclass(kind, BaseModel)):
        return [kind]
    return [found for part in get_args(kind) for found in owners(part)]


def one_of(kind: Callable[[Any], str | None], expected: str) -> Discriminator:
    """Return a discriminator of a union, with `expected` for values that match no member."""
    return Discriminator(kind, custom_error_type="none_of", custom_error_message=expected)


def _note_errors(
    error: ValidationError, data: Any, kind: Any, problems: Problems, common: tuple[str, ...]
) -> list[KeyPath]:
    """Note pydantic's errors at the places in `data` that the user wrote.

    Returns
    -------
    list of KeyPath
        The unknown keys.
    """
    unknown: dict[KeyPath, str] = {}
    messages: dict[KeyPath, str] = {}
    expected: dict[KeyPath, list[str]] = {}
    for detail in error.errors(include_url=False):
        code, context = detail["type"], detail.get("ctx", {})
        path = _written(detail["loc"], data, missing=code == "missing")
        known = known_keys(kind, path[:-1], common)
        if code in ("extra_forbidden", "unexpected_keyword_argument"):
            unknown[path] = unknown_key(str(path[-1]), known)
        elif code == "missing":
            meaning = known.get(str(path[-1]))
            messages[path] = f"{_MISSING}: {meaning}" if meaning else _MISSING
        elif code == "value_error":
            messages[path] = str(context["error"])
        else:
            words = _EXPECTED[code].format(**context) if code in _EXPECTED else detail["msg"]
            expected.setdefault(path, []).append(words)
    noted = [*expected, *messages, *unknown]
    for path, alternatives in expected.items():
        # Each member of a union fails at the same place, or deeper in its value.
        if not any(_below(other, path) for other in noted):
            words, value = _listed(list(dict.fromkeys(alternatives))), _at(path, data)
            alone = len(path) <= 1 and isinstance(value, str)
            if alone and words == _EXPECTED["list_type"]:
                words += f", such as [{value}]"
            messages.setdefault(path, f"expected {words}, got {shown(value)}")
    for path, message in (messages | unknown).items():
        problems.at(*path).add(message)
    return list(unknown)


def unknown_key(key: str, known: Iterable[str], deeper: str | None = None) -> str:
    """Return the message for an unknown key, which may belong at `deeper`."""
    if deeper:
        return f"{_UNKNOWN_KEY}; did you mean '{deeper}'?"
    others = [name for name in known if name != key]  # a union's other members may know `key`
    return _UNKNOWN_KEY + (suggestion(key, others) or f"; expected one of {', '.join(others)}")


def shown(value: Any) -> str:
    """Return a value as on one line of YAML, shortened."""
    text = _flow(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _flow(value: Any) -> str:
    if isinstance(value, str):
        return repr(value)
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else ".inf" if value > 0 else "-.inf"
    if isinstance(value, list):
        return f"[{', '.join(map(_flow, value))}]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(entry)}" for key, entry in value.items()) + "}"
    return json.dumps(value, default=str)


def _listed(alternatives: list[str]) -> str:
    """Return ``a, b or c``; an alternative may itself be such a list."""
    *first, last = alternatives
    return f"{', '.join(first).replace(' or ', ', ')} or {last}" if first else last


def _written(location: KeyPath, data: Any, *, missing: bool) -> KeyPath:
    """Return the steps of a pydantic location that are in the data, without union members."""
    path: list[str | int] = []
    for index, step in enumerate(location):
        inside = (isinstance(data, dict) and step in data) or (
            isinstance(data, list) and isinstance(step, int) and step < len(data)
        )
        if inside:
            path.append(step)
            data = data[step]
        elif missing and index == len(location) - 1:
            path.append(step)
    return tuple(path)


def _at(path: KeyPath, data: Any) -> Any:
    for step in path:
        data = data[step]
    return data


def _without(data: Any, paths: list[KeyPath]) -> Any:
    data = deepcopy(data)
    for *above, key in paths:
        del _at(tuple(above), data)[key]
    return data


def _below(path: KeyPath, ancestor: KeyPath) -> bool:
    return len(path) > len(ancestor) and path[: len(ancestor)] == ancestor


_adapter = lru_cache(maxsize=256)(TypeAdapter)


# Components ---------------------------------------------------------------------------------------


def component(
    registry: Registry[T],
    value: Any,
    problems: Problems,
    common: tuple[str, ...] = (),
    group: Any = None,
) -> T | None:
    """Return the component that `value` describes, or None after noting its errors.

    The value is a name, or a mapping such as `{kind: family, gyroscopic: 0.5}`. A mapping may have
    the keys `common` in addition to `kind` and the options. The component is checked for `group`.
    """
    if not isinstance(value, str | Mapping):
        problems.add(f"expected text or a mapping, got {shown(value)}")
        return None
    options = {} if isinstance(value, str) else dict(value)
    kind = value if isinstance(value, str) else options.pop("kind", None)
    at_kind = problems if isinstance(value, str) else problems.at("kind")
    if not isinstance(kind, str):
        expected = f"expected a {registry.kind}, one of {', '.join(registry.names())}"
        at_kind.add(f"missing; {expected}" if kind is None else f"{expected}, got {shown(kind)}")
        return None
    with at_kind.catching():
        found: Any = validated(registry.get(kind), options, problems, ("kind", *common))
        if found is not None and group is not None:
            found.check(group, problems)
        return found
    return None


def option_names(component: type) -> list[str]:
    """Return the options that a component has in a configuration."""
    return [option_of_field(field.name) for field in dataclasses.fields(component) if field.init]


def as_section(component: Any) -> dict[str, Any]:
    """Return a component as a mapping with `kind` and every option, including defaults."""
    options = {
        option_of_field(field.name): value
        for field in dataclasses.fields(component)
        for value in [getattr(component, field.name)]
        if field.init
    }
    return {
        "kind": component.name,
        **{name: _plain(value) for name, value in options.items() if value is not None},
    }


def _plain(value: Any) -> Any:
    """Return dataclasses, also in lists, as mappings."""
    if isinstance(value, list):
        return [_plain(entry) for entry in value]
    return dataclasses.asdict(value) if hasattr(value, "__dataclass_fields__") else value
