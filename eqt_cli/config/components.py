"""Components from a configuration: `eqt`, or `{kind: family, gyroscopic: 0.5}`, as objects."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, TypeVar, get_args, get_type_hints

from pydantic import TypeAdapter, ValidationError

from eqt_cli.config.problems import Problems
from eqt_cli.config.translate import UNKNOWN_KEY, Path, problems_of, shown
from eqt_cli.core.errors import ComponentError
from eqt_cli.core.registry import Registry
from eqt_cli.ensemble.spread import Spread

T = TypeVar("T")


def component(
    registry: Registry[T],
    value: Any,
    path: Path,
    problems: Problems,
    common: tuple[str, ...] = (),
) -> T | None:
    """The component that `value` asks for, or None after noting what is wrong with it.

    `common` are the keys that the section takes beside the component's own.
    """
    if not isinstance(value, str | Mapping):
        problems.add(path, f"expected text or a mapping, got {shown(value)}")
        return None
    kind, options = (value, {}) if isinstance(value, str) else split_kind(value)
    if not isinstance(kind, str):
        expected = f"expected a {registry.kind}, one of {', '.join(registry.names())}"
        wrong = f"missing; {expected}" if kind is None else f"{expected}, got {shown(kind)}"
        problems.add((*path, "kind"), wrong)
        return None
    try:
        found = registry.get(kind)
    except ComponentError as error:
        problems.add((*path, "kind") if isinstance(value, Mapping) else path, str(error))
        return None
    return options_into(found, options, path, problems, ("kind", *common))


def split_kind(value: Mapping[str, Any]) -> tuple[Any, dict[str, Any]]:
    """The `kind` of a mapping, and everything else in it."""
    return value.get("kind"), {key: entry for key, entry in value.items() if key != "kind"}


def options_into(
    component: type[T],
    options: dict[str, Any],
    path: Path,
    problems: Problems,
    common: tuple[str, ...] = (),
) -> T | None:
    """An instance with these options, or None after noting what is wrong with them.

    Keys that do not belong there are noted, and the rest is judged without them.
    """
    try:
        # As JSON, since strict validation takes a mapping for a dataclass only from there.
        adapter: TypeAdapter[T] = _adapter(component)  # type: ignore[arg-type]  # is hashable
        return adapter.validate_json(json.dumps(options))
    except ValidationError as error:
        found = problems_of(error, options, lambda at: _known_options(component, at, common))
    for place, message in found:
        problems.add((*path, *place), message)
    unknown = [place[0] for place, message in found if message.startswith(UNKNOWN_KEY)]
    known = {key: value for key, value in options.items() if key not in unknown}
    return options_into(component, known, path, problems, common) if unknown else None


def _known_options(component: type, place: Path, common: tuple[str, ...]) -> dict[str, str]:
    """The keys at a place within a component's options; their meanings are in its docstring."""
    for step in place:
        kinds = get_args(get_type_hints(component)[str(step)])
        component = next(kind for kind in kinds if hasattr(kind, "__dataclass_fields__"))
    return dict.fromkeys([*(() if place else common), *option_names(component)], "")


def option_path(path: Path, option: str) -> Path:
    """The path of an option such as ``position.std`` or ``torque[1]`` below `path`."""
    name, _, rest = option.partition("[")
    steps: list[str | int] = list(name.split("."))
    if rest:
        steps.append(int(rest.removesuffix("]")))
    return (*path, *steps)


@lru_cache(maxsize=256)
def _adapter(component: Any) -> TypeAdapter[Any]:
    return TypeAdapter(component)


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
