"""pydantic's errors in eqt's words: where, what was expected, what was found."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from typing import Any

from pydantic import ValidationError

from eqt_cli.core.errors import suggestion

Path = tuple[str | int, ...]

UNKNOWN_KEY = "unknown key"
"""How every message about a key that does not belong there begins."""

MISSING = "missing; this key has no default"
"""What is said of a key whose meaning is not known here."""

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
    "too_short": "at least {min_length} entry",
    "literal_error": "{expected}",
    "string_pattern_mismatch": "a letter or digit, then letters, digits, '.', '_' and '-'",
}


def problems_of(
    error: ValidationError,
    data: Any,
    known: Callable[[Path], Mapping[str, str]],
    elsewhere: Callable[[Path], str | None] = lambda path: None,
) -> list[tuple[Path, str]]:
    """(path, message) for each error, at the path that the user wrote.

    Parameters
    ----------
    error
        What pydantic found in `data`.
    known
        The keys that a mapping at a path may have, for suggestions, with their meanings.
    elsewhere
        Where a key belongs that is unknown at a path, if that is clear.
    """
    messages: dict[Path, str] = {}
    expected: dict[Path, list[str]] = {}
    for detail in error.errors(include_url=False):
        kind, context = detail["type"], detail.get("ctx", {})
        path = _written(detail["loc"], data, missing=kind == "missing")
        if kind in ("extra_forbidden", "unexpected_keyword_argument"):
            messages[path] = _unknown(str(path[-1]), known(path[:-1]), elsewhere(path))
        elif kind == "missing":
            meaning = known(path[:-1]).get(str(path[-1]))
            messages[path] = f"missing; expected: {meaning}" if meaning else MISSING
        elif kind == "value_error":
            messages[path] = str(context["error"])
        else:
            words = _EXPECTED.get(kind, detail["msg"]).format(**context)
            expected.setdefault(path, []).append(words)
    for path, alternatives in expected.items():
        # The alternatives of a union fail one by one at the same place, or deeper in its value.
        if path not in messages and not any(
            _below(other, path) for other in [*expected, *messages]
        ):
            words, value = _listed(list(dict.fromkeys(alternatives))), _at(path, data)
            alone = len(path) == 1 and isinstance(value, str)
            if alone and words == _EXPECTED["list_type"]:
                words += f", as [{value}]"
            messages[path] = f"expected {words}, got {shown(value)}"
    return list(messages.items())


def shown(value: Any) -> str:
    """A value as it would stand on one line of YAML, shortened."""
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
    """``a, b or c``; an alternative may itself be such a list."""
    *first, last = alternatives
    return f"{', '.join(first).replace(' or ', ', ')} or {last}" if first else last


def _unknown(key: str, known: Mapping[str, str], deeper: str | None) -> str:
    if deeper:
        return f"{UNKNOWN_KEY}; did you mean '{deeper}'?"
    others = [name for name in known if name != key]  # of a union, `key` may be known elsewhere
    return UNKNOWN_KEY + (suggestion(key, others) or f"; known here: {', '.join(others)}")


def _written(location: Path, data: Any, *, missing: bool) -> Path:
    """The steps of a pydantic location that are in the data; the others name union members."""
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


def _at(path: Path, data: Any) -> Any:
    for step in path:
        data = data[step]
    return data


def _below(path: Path, ancestor: Path) -> bool:
    return len(path) > len(ancestor) and path[: len(ancestor)] == ancestor
