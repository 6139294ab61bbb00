"""Lists the numbers of a component by path, and replaces them.

A component is a frozen dataclass. Its numbers, the leaves, are the floats and arrays in its fields
and in those of the components that it holds, alone or in a tuple: ``gains.K``,
``vehicle.actuators[0].low``. The rest is its structure. A leaf may be replaced by an array with a
leading axis of runs, or by symbols.
"""

import dataclasses
from collections.abc import Callable, Hashable, Iterable, Iterator
from functools import cache
from typing import Any, TypeVar

import numpy as np

from eqt_cli.base.arrays import Array, Arrays

T = TypeVar("T")

STRUCTURE = {"is_structure": True}
"""The metadata of a field without leaves."""


def leaves(component: Any, fields: Iterable[str] | None = None) -> dict[str, Array]:
    """Return the numbers of a component by path, in the order of fields; floats as ``(1,)``.

    `fields` are all of them, or the ones to look into.
    """
    names = _with_numbers(component.__class__) if fields is None else fields
    return {
        path: np.atleast_1d(number) if isinstance(number, float) else number
        for name in names
        for path, number in _numbers(getattr(component, name), name)
    }


def with_leaves(component: T, values: Arrays) -> T:
    """Return the component with other numbers at some of its paths.

    Raises
    ------
    KeyError
        If there is no leaf at a path.
    """
    if unknown := values.keys() - leaves(component).keys():
        raise KeyError(", ".join(sorted(unknown)))
    return _mapped(component, lambda path, number: values.get(path, number))


def with_fields(component: T, **values: Any) -> T:
    """Return the component with other values of some fields, even of those that are no options.

    Values that it cached from the old fields are dropped; of cached properties that remain as they
    are, `values` may have some.
    """
    # dataclasses.replace cannot set a field that the initialiser does not take.
    copy = object.__new__(type(component))
    old = vars(component)
    remaining = {field.name: old[field.name] for field in _fields(component) if field.name in old}
    vars(copy).update(remaining | values)
    return copy


def structure(component: Any) -> Hashable:
    """Return all of a component but its numbers, so that equal structures differ only in leaves.

    Fields that do not count in comparisons are left out.
    """
    return type(component), tuple(
        (field.name, _structure(field, getattr(component, field.name)))
        for field in _fields(component)
        if field.compare
    )


def _numbers(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Yield the leaves in the value of a field, with their paths."""
    if isinstance(value, float | np.ndarray):
        if np.size(value):
            yield path, value
    elif _is_component(value):
        for name in _with_numbers(value.__class__):
            yield from _numbers(getattr(value, name), f"{path}.{name}")
    elif isinstance(value, tuple):
        for k, entry in enumerate(value):
            yield from _numbers(entry, f"{path}[{k}]")


def _mapped(component: Any, new: Callable[[str, Any], Any], prefix: str = "") -> Any:
    """Return the component with each leaf replaced by `new` of its path and its number."""

    def mapped(value: Any, path: str) -> Any:
        if isinstance(value, float | np.ndarray):
            return new(path, value) if np.size(value) else value
        if _is_component(value):
            return _mapped(value, new, f"{path}.")
        if isinstance(value, tuple):
            return tuple(mapped(entry, f"{path}[{k}]") for k, entry in enumerate(value))
        return value

    names = _with_numbers(component.__class__)
    values = {name: mapped(getattr(component, name), prefix + name) for name in names}
    return with_fields(component, **values)


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


@cache
def _with_numbers(kind: Any) -> tuple[str, ...]:
    """Return the names of the fields of a class of components that may hold leaves."""
    fields = dataclasses.fields(kind)
    return tuple(field.name for field in fields if not field.metadata.get("is_structure"))


def _fields(component: Any) -> tuple[dataclasses.Field[Any], ...]:
    return dataclasses.fields(component)


def _is_component(value: Any) -> bool:
    return dataclasses.is_dataclass(value) and not isinstance(value, type)
