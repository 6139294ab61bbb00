"""Finds the differences between two results: configuration, provenance and numbers, bit by bit.

Does not know what the numbers mean.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from math import prod
from typing import Any

import numpy as np

from eqt_cli.analysis.differences import changes, configurations, leaves
from eqt_cli.api.loading import ResultPath, path_from
from eqt_cli.base.arrays import Array
from eqt_cli.results.origin import KnownResult
from eqt_cli.results.result import open_result

BLOCK_ENTRIES = 2**22
"""Number of entries of a dataset that are read at once, or one along its longest axis."""

_APART = ("config", "experiment", "provenance", "digest", "files", "plugins")
"""Attributes that are compared entry by entry, or that follow from others."""

_REPEATED = ("cross_check_difference",)
"""Attributes by NumPy and SciPy, which depend on the machine, as those of an engine in C do not."""


@dataclass(frozen=True)
class Dataset:
    """A dataset that differs between two results.

    Attributes
    ----------
    name
        Name of the variable or coordinate; preceded by the point if points differ in shape.
    shapes
        Shape in each result; None where it is missing.
    different
        Number of entries with different bits, of equal shapes.
    largest
        Largest difference of two entries; inf if only one of them is finite. None for text and for
        different shapes.
    """

    name: str
    shapes: tuple[tuple[int, ...] | None, tuple[int, ...] | None]
    different: int = 0
    largest: float | None = None


@dataclass(frozen=True)
class Differences:
    """The differences between two results.

    Attributes
    ----------
    configuration, attributes, provenance
        Changes in keys of the configuration, in other attributes of the files, and in versions,
        machine, time, command and what the cross-check found: a `key`, with its value in the
        `first` and in the `second` result, where it is there.
    datasets
        Datasets that differ.
    compared
        Number of compared datasets.
    """

    configuration: list[dict[str, Any]]
    attributes: list[dict[str, Any]]
    provenance: list[dict[str, Any]]
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
    configuration, texts, renamings = configurations(both)
    arrays = [_datasets(result) for result in both]
    names = list(dict.fromkeys(chain(*arrays)))
    compared = [_compared(name, arrays[0].get(name), arrays[1].get(name)) for name in names]
    attributes = [
        {key: value for key, value in result.attributes.items() if key not in _APART + _REPEATED}
        | {f"file {names[name]}": text for name, text in stored.items()}
        for result, names, stored in zip(both, renamings, texts, strict=True)
    ]
    provenance = [
        dict(leaves(result.provenance))
        | {key: result.attributes[key] for key in _REPEATED if key in result.attributes}
        for result in both
    ]
    return Differences(
        configuration,
        changes(*attributes),
        changes(*provenance),
        [dataset for dataset in compared if dataset is not None],
        len(names),
    )


def diff(first: ResultPath, second: ResultPath) -> Differences:
    """Compare two results: configuration, provenance, and the numbers bit by bit.

    Parameters
    ----------
    first, second
        The result folders, or the files in them.

    Returns
    -------
    Differences
        The differences; ``equal`` is true if only the provenance differs.

    Raises
    ------
    EqtError
        If a result does not exist or is damaged.

    Examples
    --------
    >>> again = eqt_cli.run(eqt_cli.load_experiment("results/paper/results.h5"), "again")
    >>> eqt_cli.diff("results/paper", again).equal
    True
    """
    with (
        open_result(path_from("first", first)) as one,
        open_result(path_from("second", second)) as other,
    ):
        return differences(one, other)


# Datasets -----------------------------------------------------------------------------------------

Place = tuple[KnownResult, str]
"""A dataset of a result or of one of its points."""


def _datasets(result: KnownResult) -> dict[str, Place]:
    datasets = {name: (result, name) for name in (*result.coordinates, *result.names)}
    for number in result.shapes:
        of_shape = result.of_shape(number)
        for name in (*of_shape.coordinates, *of_shape.names):
            datasets[f"shape {number}: {name}"] = (of_shape, name)
    return datasets


def _compared(name: str, first: Place | None, second: Place | None) -> Dataset | None:
    """Compare a dataset; None if it is equal in both."""
    shapes = _shape(first), _shape(second)
    if first is None or second is None or shapes[0] is None or shapes[0] != shapes[1]:
        return Dataset(name, shapes)
    different, largest = 0, None
    for one, other in zip(_blocks(first, shapes[0]), _blocks(second, shapes[0]), strict=True):
        text = one.dtype == object or other.dtype == object
        differ = one != other if text else _bits(one) != _bits(other)
        different += int(np.count_nonzero(differ))
        if np.any(differ) and not text:
            a, b = one[differ].astype(float), other[differ].astype(float)
            with np.errstate(invalid="ignore", over="ignore"):
                gaps = np.where(np.isnan(a) & np.isnan(b), 0.0, np.abs(a - b))
            largest = max(largest or 0.0, float(np.where(np.isnan(gaps), np.inf, gaps).max()))
    return Dataset(name, shapes, different, largest) if different else None


def _shape(place: Place | None) -> tuple[int, ...] | None:
    if place is None:
        return None
    result, name = place
    return tuple(result.dimensions[dim] for dim in result.dims(name))


def _blocks(place: Place, shape: tuple[int, ...]) -> Iterator[Array]:
    """Yield a dataset in blocks of its longest axis that fit into memory."""
    result, name = place
    dims = result.dims(name)
    if not dims:
        yield np.asarray(result.read(name))
        return
    axis = int(np.argmax(shape))
    step = max(1, BLOCK_ENTRIES * shape[axis] // max(1, prod(shape)))
    for start in range(0, shape[axis], step):
        yield np.asarray(result.read(name, **{dims[axis]: slice(start, start + step)}))


def _bits(array: Array) -> Array:
    """Return the bits of numbers, which distinguish NaNs and the signs of zeros."""
    return np.asarray(array, dtype=float, order="C").view(np.uint64)
