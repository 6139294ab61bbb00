"""Finds the differences between two results: configuration, provenance and numbers, bit by bit.

Does not know what the numbers mean.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from itertools import chain
from math import prod
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import KeyPath, dotted
from eqt_cli.config.experiment import renamed
from eqt_cli.config.source import source_of
from eqt_cli.results.origin import KnownResult

BLOCK_ENTRIES = 2**22
"""Number of entries of a dataset that are read at once."""

_APART = ("config", "experiment", "provenance", "digest", "files", "plugins")
"""Attributes that are compared entry by entry, or that follow from others."""


class Absent(Enum):
    """The value of a key that only the other result has."""

    ABSENT = "not there"


@dataclass(frozen=True)
class Change:
    """A key whose values differ; `Absent.ABSENT` marks a missing value."""

    key: str
    first: Any
    second: Any


@dataclass(frozen=True)
class Dataset:
    """A dataset that differs between two results.

    Attributes
    ----------
    name
        Name of the variable or coordinate; preceded by the point if points differ in shape.
    shapes, types
        Shapes and types in both results; None if missing. Numbers are compared if shapes are equal.
    different
        Number of entries with different bits.
    nan_bits
        Number of these that are NaN in both results.
    largest
        Largest difference of two entries; inf if only one of them is finite. None for text and for
        different shapes.
    relative
        Largest difference divided by the larger entry.
    place
        Position of the largest difference, or of the first one for text.
    """

    name: str
    shapes: tuple[tuple[int, ...] | None, tuple[int, ...] | None]
    types: tuple[str | None, str | None]
    different: int = 0
    nan_bits: int = 0
    largest: float | None = None
    relative: float | None = None
    place: tuple[int, ...] | None = None


@dataclass(frozen=True)
class Differences:
    """The differences between two results.

    Attributes
    ----------
    configuration, attributes, provenance
        Changes in keys of the configuration, in other attributes of the files, and in versions,
        machine, time and command.
    datasets
        Datasets that differ.
    compared
        Number of compared datasets.
    """

    configuration: list[Change]
    attributes: list[Change]
    provenance: list[Change]
    datasets: list[Dataset]
    compared: int

    @property
    def equal(self) -> bool:
        """Whether the results are equal; their provenance may differ."""
        return not (self.configuration or self.attributes or self.datasets)


def differences(first: KnownResult, second: KnownResult) -> Differences:
    """Compare two open results, entry by entry.

    A stored file has the same name in both if its text is the same, since packing renames files.
    """
    both = first, second
    sources = [source_of(each) for each in both]
    texts = [{**(source.stored_plugins or {}), **source.files} for source in sources]
    known = {text: name for name, text in texts[0].items()}
    renamings = [{name: known.get(text, name) for name, text in each.items()} for each in texts]
    arrays = [_datasets(each) for each in both]
    names = list(dict.fromkeys(chain(*arrays)))
    compared = [_compared(name, arrays[0].get(name), arrays[1].get(name)) for name in names]
    renaming = zip(sources, renamings, strict=True)
    configurations = [dict(_leaves(renamed(source.data, names))) for source, names in renaming]
    attributes = [
        {key: value for key, value in result.attributes.items() if key not in _APART}
        | {f"file {names[name]}": text for name, text in stored.items()}
        for result, names, stored in zip(both, renamings, texts, strict=True)
    ]
    return Differences(
        _changes(*configurations),
        _changes(*attributes),
        _changes(*(dict(_leaves(each.provenance)) for each in both)),
        [each for each in compared if each is not None],
        len(names),
    )


# Keys ---------------------------------------------------------------------------------------------


def _leaves(data: Any, path: KeyPath = ()) -> Iterator[tuple[str, Any]]:
    """Yield the values of nested mappings and lists with their dotted keys."""
    inner: Any = None
    if isinstance(data, dict):
        inner = data.items()
    elif isinstance(data, list):
        inner = enumerate(data)
    if not inner or not data:
        yield dotted(path), data
        return
    for key, value in inner:
        yield from _leaves(value, (*path, key))


def _changes(first: Mapping[str, Any], second: Mapping[str, Any]) -> list[Change]:
    keys = dict.fromkeys(chain(first, second))
    pairs = [(key, first.get(key, Absent.ABSENT), second.get(key, Absent.ABSENT)) for key in keys]
    return [Change(*pair) for pair in pairs if repr(pair[1]) != repr(pair[2])]


# Datasets -----------------------------------------------------------------------------------------

Place = tuple[KnownResult, str]
"""A dataset of a result or of one of its points."""


def _datasets(result: KnownResult) -> dict[str, Place]:
    datasets = {name: (result, name) for name in (*result.coordinates, *result.names)}
    for point in range(result.dimensions["point"]) if result.has_groups else ():
        view = result.at(point)
        for name in (*view.coordinates, *view.names):
            datasets[f"point {point}: {name}"] = (view, name)
    return datasets


def _compared(name: str, first: Place | None, second: Place | None) -> Dataset | None:
    """Compare a dataset; None if it is equal in both."""
    shapes, types = zip(*map(_shape_and_type, (first, second)), strict=True)
    if first is None or second is None or shapes[0] is None or shapes[0] != shapes[1]:
        return Dataset(name, shapes, types)
    tally = _Tally()
    for block in _blocks(shapes[0]):
        tally.add(_read(first, block), _read(second, block), [each.start for each in block])
    if not tally.different and types[0] == types[1]:
        return None
    return Dataset(name, shapes, types, **vars(tally))


def _shape_and_type(place: Place | None) -> tuple[Any, Any]:
    """Return the shape and the type of a dataset in words; None for both where it is missing."""
    if place is None:
        return None, None
    result, name = place
    dims = result.dims(name)
    kind = result.read(name, **dict.fromkeys(dims, slice(0))).dtype
    return tuple(map(result.dimensions.get, dims)), "text" if kind.kind == "O" else str(kind)


def _read(place: Place, block: tuple[slice, ...]) -> Array:
    result, name = place
    return np.asarray(result.read(name, **dict(zip(result.dims(name), block, strict=False))))


def _blocks(shape: tuple[int, ...]) -> Iterator[tuple[slice, ...]]:
    """Yield blocks of an array that fit into memory, as slices of its first axes."""
    if prod(shape) <= BLOCK_ENTRIES:
        yield ()
        return
    inner = prod(shape[1:])
    step = max(1, BLOCK_ENTRIES // inner)
    for start in range(0, shape[0], step):
        part = slice(start, start + step)
        for rest in _blocks(shape[1:]) if inner > BLOCK_ENTRIES else [()]:
            yield part, *rest


class _Tally:
    """Accumulates differences over the blocks of two arrays."""

    def __init__(self) -> None:
        self.different = self.nan_bits = 0
        self.largest: float | None = None
        self.relative: float | None = None
        self.place: tuple[int, ...] | None = None

    def add(self, first: Array, second: Array, start: list[int]) -> None:
        """Add a block that starts at `start` along the first axes."""
        text = first.dtype == object or second.dtype == object
        floats = first.dtype.kind == second.dtype.kind == "f"
        differ = _bits(first) != _bits(second) if floats else first != second
        where = np.flatnonzero(differ)
        if not where.size:
            return
        self.different += where.size
        worst = 0
        if not text:
            a, b = (np.ravel(each)[where].astype(float) for each in (first, second))
            both_nan = np.isnan(a) & np.isnan(b)
            self.nan_bits += int(both_nan.sum())
            with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
                gap = np.where(both_nan, 0.0, np.abs(a - b))
                gap[np.isnan(gap)] = np.inf
                ratio = np.where(gap > 0, gap / np.maximum(np.abs(a), np.abs(b)), 0.0)
            ratio[np.isinf(gap)] = np.inf
            worst = int(gap.argmax())
            self.relative = max(self.relative or 0.0, float(ratio.max()))
            if self.largest is not None and gap[worst] <= self.largest:
                return
            self.largest = float(gap[worst])
        elif self.place is not None:
            return
        place = np.unravel_index(where[worst], first.shape)
        offset = [*start, *[0] * (first.ndim - len(start))]
        self.place = tuple(int(k) + begin for k, begin in zip(place, offset, strict=True))


def _bits(array: Array) -> Array:
    """Return the bits of numbers, which distinguish NaNs and the signs of zeros."""
    return np.asarray(array, dtype=float, order="C").view(np.uint64)
