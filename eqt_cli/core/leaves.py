"""The numbers of a component by path, and the same component with other numbers.

A component is a frozen dataclass. Its numbers, the leaves, are the floats and arrays in its fields
and in those of the components that it holds, alone or in a tuple: ``gains.K``,
``vehicle.actuators[0].low``. All else is its structure. A leaf may be replaced by an array with a
leading axis of runs, or by symbols.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Hashable, Mapping
from typing import Any, TypeVar

import numpy as np

from eqt_cli.core.arrays import Array

T = TypeVar("T")

STRUCTURE = {"is_structure": True}
"""The metadata of a field in which nothing is a leaf."""


def leaves(component: Any) -> dict[str, Array]:
    """The numbers of a component by path, in the order of its fields; floats as arrays ``(1,)``."""
    found: dict[str, Array] = {}

    def note(path: str, number: Array | float) -> None:
        found[path] = np.atleast_1d(number) if isinstance(number, float) else number

    _mapped(component, note)
    return found


def with_leaves(component: T, values: Mapping[str, Array]) -> T:
    """The same component with other numbers at some of its paths.

    Raises
    ------
    KeyError
        If it has no leaf at a path.
    """
    if unknown := values.keys() - leaves(component).keys():
        raise KeyError(", ".join(sorted(unknown)))
    return _mapped(component, lambda path, number: values.get(path, number))


def with_fields(component: T, **values: Any) -> T:
    """The same component with other values of some of its fields, also of those that are no option.

    What it has computed from the old ones is forgotten.
    """
    # Not dataclasses.replace: a field may be none for its initialiser.
    copy = object.__new__(type(component))
    own = vars(component)
    kept = {field.name: own[field.name] for field in _fields(component) if field.name in own}
    vars(copy).update(kept | values)
    return copy


def structure(component: Any) -> Hashable:
    """What of a component is no number; components of equal structure differ in their leaves only.

    A field that does not count in comparisons does not count here.
    """
    return type(component), tuple(
        (field.name, _structure(field, getattr(component, field.name)))
        for field in _fields(component)
        if field.compare
    )


def _mapped(component: T, new: Callable[[str, Any], Any], prefix: str = "") -> T:
    """The same component with `new` in the place of each leaf, from its path and its number."""

    def mapped(value: Any, path: str) -> Any:
        if isinstance(value, float | np.ndarray):
            return new(path, value) if np.size(value) else value
        if _is_component(value):
            return _mapped(value, new, f"{path}.")
        if isinstance(value, tuple):
            return tuple(mapped(entry, f"{path}[{k}]") for k, entry in enumerate(value))
        return value

    return with_fields(
        component,
        **{
            field.name: mapped(getattr(component, field.name), prefix + field.name)
            for field in _fields(component)
            if not field.metadata.get("is_structure")
        },
    )


def _structure(field: dataclasses.Field[Any], value: Any) -> Hashable:
    if field.metadata.get("is_structure"):
        return repr(value)
    if isinstance(value, float | np.ndarray):
        return np.shape(value)
    if _is_component(value):
        return structure(value)
    if isinstance(value, tuple):
        return tuple(_structure(field, entry) for entry in value)
    return repr(value)


def _fields(component: Any) -> tuple[dataclasses.Field[Any], ...]:
    return dataclasses.fields(component)


def _is_component(value: Any) -> bool:
    return dataclasses.is_dataclass(value) and not isinstance(value, type)
