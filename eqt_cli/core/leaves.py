"""The numbers of a component by path, and the same component with other numbers.

A component is a frozen dataclass. Its numbers, the leaves, are the floats and arrays in its fields
and in those of the components that it holds, alone or in a tuple: ``gains.K``,
``vehicle.actuators[0].low``. All else is its structure. A leaf may be replaced by an array with a
leading axis of runs, or by symbols.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Hashable, Iterator, Mapping
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from eqt_cli.core.arrays import Array

T = TypeVar("T")

STRUCTURE = {"is_structure": True}
"""The metadata of a field in which nothing is a leaf."""


def leaves(component: Any) -> dict[str, Array]:
    """The numbers of a component by path, in the order of its fields; floats as arrays ``(1,)``."""
    return dict(_leaves(component))


def with_leaves(component: T, values: Mapping[str, Array]) -> T:
    """The same component with other numbers at some of its paths.

    Raises
    ------
    KeyError
        If it has no leaf at a path.
    """
    if unknown := values.keys() - leaves(component).keys():
        raise KeyError(", ".join(sorted(unknown)))
    return _mapped(component, values.get)


def with_fields(component: T, **values: Any) -> T:
    """The same component with other values of some of its fields, also of those that are no option.

    What it has computed from the old ones is forgotten.
    """
    kind = type(component)
    copy = object.__new__(kind)
    kept = {name: value for name, value in vars(component).items() if not _computed(kind, name)}
    vars(copy).update(kept | values)
    return copy


def structure(component: Any) -> Hashable:
    """What of a component is no number; components of equal structure differ in their leaves only.

    A field that does not count in comparisons does not count here.
    """
    return type(component), tuple(
        (field.name, _structure(field, getattr(component, field.name)))
        for field in dataclasses.fields(component)
        if field.compare
    )


def _leaves(component: Any, prefix: str = "") -> Iterator[tuple[str, Array]]:
    for field in _open_fields(component):
        value, path = getattr(component, field.name), prefix + field.name
        if isinstance(value, float | np.ndarray):
            found = np.atleast_1d(value) if isinstance(value, float) else value
            if found.size:
                yield path, found
        elif _is_component(value):
            yield from _leaves(value, f"{path}.")
        elif isinstance(value, tuple):
            for index, entry in enumerate(value):
                if _is_component(entry):
                    yield from _leaves(entry, f"{path}[{index}].")


def _mapped(component: T, new: Callable[[str], Any], prefix: str = "") -> T:
    changed: dict[str, Any] = {}
    for field in _open_fields(component):
        value, path = getattr(component, field.name), prefix + field.name
        if isinstance(value, float | np.ndarray):
            found = new(path)
            changed |= {} if found is None else {field.name: found}
        elif _is_component(value):
            changed[field.name] = _mapped(value, new, f"{path}.")
        elif isinstance(value, tuple):
            changed[field.name] = tuple(
                _mapped(entry, new, f"{path}[{index}].") if _is_component(entry) else entry
                for index, entry in enumerate(value)
            )
    return with_fields(component, **changed)


def _structure(field: dataclasses.Field[Any], value: Any) -> Hashable:
    if field.metadata.get("is_structure"):
        return repr(value)
    if isinstance(value, float | np.ndarray):
        return np.shape(value)
    if _is_component(value):
        return structure(value)
    if isinstance(value, tuple):
        return tuple(structure(each) if _is_component(each) else repr(each) for each in value)
    return repr(value)


def _open_fields(component: Any) -> Iterator[dataclasses.Field[Any]]:
    """Those that may hold leaves."""
    fields = dataclasses.fields(component)
    return (field for field in fields if not field.metadata.get("is_structure"))


def _is_component(value: Any) -> bool:
    return dataclasses.is_dataclass(value) and not isinstance(value, type)


def _computed(kind: type, name: str) -> bool:
    return isinstance(getattr(kind, name, None), cached_property)
