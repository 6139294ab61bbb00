"""Writes a result file piece by piece, so that it may be larger than the memory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import h5py
import numpy as np
from numpy.typing import NDArray

from eqt_cli.core.version import __version__
from eqt_cli.store.output_file import created
from eqt_cli.store.reserved_names import (
    COORDINATES,
    FORMAT,
    FORMAT_ATTRIBUTE,
    PLACEHOLDER,
    VERSION_ATTRIBUTE,
)
from eqt_cli.store.table import Attribute, Variable

_CHUNK_BYTES = 2**20


@dataclass(frozen=True)
class Blank:
    """A variable whose data are written later.

    Parameters
    ----------
    dims
        One name per axis.
    dtype
        The type of the data; None for strings.
    attributes
        Descriptions of the array.
    """

    dims: tuple[str, ...]
    dtype: np.dtype[Any] | None
    attributes: Mapping[str, Attribute] = field(default_factory=dict)


class Assembly:
    """An unfinished result file, with every dimension, coordinate and variable.

    Parameters
    ----------
    file
        The open HDF5 file, or a group of it.
    sizes, coordinates, variables, compression
        As in `assemble`; the compression also applies to groups.

    Attributes
    ----------
    replaces : bool
        Whether writes may replace earlier data, even text by empty text.
    """

    def __init__(
        self,
        file: Any,
        sizes: Mapping[str, int],
        coordinates: Mapping[str, Variable],
        variables: Mapping[str, Blank | Variable],
        compression: Literal["gzip"] | None,
    ) -> None:
        self._file, self._sizes, self._compression = file, sizes, compression
        self.replaces = False
        self._datasets: dict[str, Any] = {}  # kept open: opening one takes as long as writing it
        for dim, size in sizes.items():
            if dim in coordinates:
                self._add(dim, coordinates[dim]).make_scale(dim)
            else:
                # It is never written, so that it takes no space: only its length counts.
                blank = file.create_dataset(dim, shape=(size,), dtype=">f4")
                self._datasets[dim] = blank
                blank.make_scale(f"{PLACEHOLDER}{size:10d}")
        extra = {name: variable for name, variable in coordinates.items() if name not in sizes}
        for name, variable in extra.items():
            self._attach(self._add(name, variable), variable.dims, {})
        for name, entry in variables.items():
            self._attach(self._add(name, entry, compression), entry.dims, extra)

    def group(
        self,
        name: str,
        sizes: Mapping[str, int],
        coordinates: Mapping[str, Variable],
        variables: Mapping[str, Blank | Variable],
    ) -> Assembly:
        """Add a group with its own dimensions and variables, as `assemble` does for the file."""
        creation = h5py.h5p.create(h5py.h5p.GROUP_CREATE)
        creation.set_obj_track_times(False)
        creation.set_link_creation_order(h5py.h5p.CRT_ORDER_TRACKED | h5py.h5p.CRT_ORDER_INDEXED)
        group = h5py.Group(h5py.h5g.create(self._file.id, name.encode(), gcpl=creation))
        return Assembly(group, sizes, coordinates, variables, self._compression)

    def shape(self, name: str) -> tuple[int, ...]:
        """Return the shape of a variable."""
        return self._datasets[name].shape

    def put(self, name: str, data: NDArray[Any], positions: tuple[int | slice, ...] = ()) -> None:
        """Write part of a variable: `positions` along its first axes, and all of the other axes."""
        # Unwritten strings read as empty ones. So millions of runs without a message need only a
        # reference each, and no object in a heap.
        is_empty = data.dtype == object and bool((data == "").all())
        if data.size and (self.replaces or not is_empty):
            self._datasets[name][positions] = data

    def describe(self, attributes: Mapping[str, Attribute]) -> None:
        """Add attributes of the file, or of the group."""
        self._file.attrs.update(attributes)

    def _add(
        self, name: str, entry: Blank | Variable, compression: Literal["gzip"] | None = None
    ) -> Any:
        """Create a dataset; for a variable, write its data."""
        shape = tuple(self._sizes[dim] for dim in entry.dims)
        options: dict[str, Any] = {}
        if entry.dtype is None:  # not compressed, which would affect only references to strings
            dtype = h5py.string_dtype("utf-8")
        else:
            dtype = entry.dtype.newbyteorder("<")
            if compression and shape and 0 not in shape:
                options = _compressed(shape, dtype)
        dataset = self._file.create_dataset(name, shape=shape, dtype=dtype, **options)
        self._datasets[name] = dataset
        if entry.dtype is None and 0 not in shape:
            dataset[(0,) * len(shape)] = ""  # allocates the dataset
        dataset.attrs.update(entry.attributes)
        if isinstance(entry, Variable):
            self.put(name, entry.data.astype(object) if entry.dtype is None else entry.data)
        return dataset

    def _attach(self, dataset: Any, dims: tuple[str, ...], extra: Mapping[str, Variable]) -> None:
        """Attach the dimensions of a dataset, and name its further coordinates."""
        for axis, dim in enumerate(dims):
            dataset.dims[axis].attach_scale(self._datasets[dim])
        described = [name for name, variable in extra.items() if set(variable.dims) <= set(dims)]
        if described:
            dataset.attrs[COORDINATES] = " ".join(described)


@contextmanager
def assemble(
    path: str | Path,
    sizes: Mapping[str, int],
    coordinates: Mapping[str, Variable],
    variables: Mapping[str, Blank | Variable],
    compression: Literal["gzip"] | None = None,
) -> Iterator[Assembly]:
    """Create a result file, to be filled in the block; every blank must be written.

    The layout is that of HDF5 1.8 with netCDF-4's dimension scales, which HDF5 tools, netCDF and
    xarray can read. The complete file appears when the block ends without an error.

    Parameters
    ----------
    path
        The file; its folder must exist.
    sizes
        The size of every dimension.
    coordinates
        As in a `Table`.
    variables
        Blanks by name, or variables that are written immediately.
    compression
        ``"gzip"`` stores numbers in shuffled, compressed chunks, None contiguously.

    Raises
    ------
    ResultError
        If the file cannot be written; `path` is then unchanged.
    """
    with created(path) as file:
        file.attrs[FORMAT_ATTRIBUTE] = FORMAT
        file.attrs[VERSION_ATTRIBUTE] = np.bytes_(__version__)
        yield Assembly(file, sizes, coordinates, variables, compression)


def _compressed(shape: tuple[int, ...], dtype: np.dtype[Any]) -> dict[str, Any]:
    """Return h5py's options for compressed chunks of about 1 MiB, complete along the last axes."""
    capacity = max(1, _CHUNK_BYTES // dtype.itemsize)
    chunks: list[int] = []
    for size in reversed(shape):
        pieces = -(-size // capacity)
        chunks.insert(0, -(-size // pieces))
        capacity = max(1, capacity // chunks[0])
    return {"compression": "gzip", "shuffle": True, "chunks": tuple(chunks)}
