"""Components from a configuration: `eqt`, or `{kind: family, gyroscopic: 0.5}`, as objects."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from eqt_cli.core.errors import ComponentError
from eqt_cli.core.registry import Registry
from eqt_cli.ensemble.spread import Spread
from eqt_cli.experiment.problems import Problems
from eqt_cli.experiment.translate import Path, problems_of

T = TypeVar("T")


def component(registry: Registry[T], value: Any, path: Path, problems: Problems) -> T | None:
    """The component that `value` asks for, or None after noting what is wrong with it."""
    kind, options = (value, {}) if isinstance(value, str) else split_kind(value)
    if not isinstance(kind, str):
        names = ", ".join(registry.names())
        problems.add((*path, "kind"), f"missing; the {registry.kind} to use, one of {names}")
        return None
    try:
        found = registry.get(kind)
    except ComponentError as error:
        problems.add((*path, "kind") if isinstance(value, Mapping) else path, str(error))
        return None
    return options_into(found, options, path, problems)


def split_kind(value: Mapping[str, Any]) -> tuple[Any, dict[str, Any]]:
    """The `kind` of a mapping, and everything else in it."""
    return value.get("kind"), {key: entry for key, entry in value.items() if key != "kind"}


def options_into(
    component: type[T], options: dict[str, Any], path: Path, problems: Problems
) -> T | None:
    """An instance with these options, or None after noting what is wrong with them."""
    try:
        # As JSON, since strict validation takes a mapping for a dataclass only from there.
        return TypeAdapter(component).validate_json(json.dumps(options))
    except ValidationError as error:
        for place, message in problems_of(error, options, lambda _: option_names(component)):
            problems.add((*path, *place), message)
        return None


def option_path(path: Path, option: str) -> Path:
    """The path of an option such as ``position.std`` or ``torque[1]`` below `path`."""
    name, _, rest = option.partition("[")
    steps: list[str | int] = list(name.split("."))
    if rest:
        steps.append(int(rest.removesuffix("]")))
    return (*path, *steps)


def option_names(component: type) -> list[str]:
    """The options that a component takes in a configuration."""
    return [field.name for field in dataclasses.fields(component) if field.init]


def resolved(component: Any) -> dict[str, Any]:
    """A component as a mapping with `kind` and every option, defaults included."""
    options = {name: getattr(component, name) for name in option_names(type(component))}
    plain = {
        name: dataclasses.asdict(value) if isinstance(value, Spread) else value
        for name, value in options.items()
        if value is not None
    }
    return {"kind": component.name, **plain}
