"""A result file that is filled piece by piece, for what does not fit the memory.

It must not know what the numbers mean or where the pieces come from.
"""

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
    """A variable whose data come later.

    Parameters
    ----------
    dims
        One name per axis.
    dtype
        Its type; None for strings.
    attributes
        What describes the array.
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
        As of `assemble`; the compression is also that of groups to come.

    Attributes
    ----------
    replaces : bool
        What is written replaces what was written before, text by empty text too.
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
        for dim, size in sizes.items():
            if dim in coordinates:
                self._add(dim, coordinates[dim]).make_scale(dim)
            else:
                # Never written, so that it takes no room: only its length counts.
                blank = file.create_dataset(dim, shape=(size,), dtype=">f4")
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
        """Add a group with dimensions and variables of its own, as `assemble` does for the file."""
        creation = h5py.h5p.create(h5py.h5p.GROUP_CREATE)
        creation.set_obj_track_times(False)
        creation.set_link_creation_order(h5py.h5p.CRT_ORDER_TRACKED | h5py.h5p.CRT_ORDER_INDEXED)
        group = h5py.Group(h5py.h5g.create(self._file.id, name.encode(), gcpl=creation))
        return Assembly(group, sizes, coordinates, variables, self._compression)

    def shape(self, name: str) -> tuple[int, ...]:
        """The shape of a variable."""
        return self._file[name].shape

    def put(self, name: str, data: NDArray[Any], positions: tuple[int | slice, ...] = ()) -> None:
        """Write part of a variable: at `positions` along its first axes, all of the others."""
        # Empty strings are left unwritten, which reads the same: the millions of runs without a
        # message then cost a reference each, but no object in a heap.
        is_empty = data.dtype == object and bool((data == "").all())
        if data.size and (self.replaces or not is_empty):
            self._file[name][positions] = data

    def describe(self, attributes: Mapping[str, Attribute]) -> None:
        """Add attributes of the file, or of the group."""
        self._file.attrs.update(attributes)

    def _add(
        self, name: str, entry: Blank | Variable, compression: Literal["gzip"] | None = None
    ) -> Any:
        """Create one dataset, with the data of a variable."""
        shape = tuple(self._sizes[dim] for dim in entry.dims)
        options: dict[str, Any] = {}
        if entry.dtype is None:  # never compressed: that would reach only the references to strings
            dtype = h5py.string_dtype("utf-8")
        else:
            dtype = entry.dtype.newbyteorder("<")
            if compression and shape and 0 not in shape:
                options = _compressed(shape, dtype)
        dataset = self._file.create_dataset(name, shape=shape, dtype=dtype, **options)
        if entry.dtype is None and 0 not in shape:
            dataset[(0,) * len(shape)] = ""  # so that the dataset takes its room
        dataset.attrs.update(entry.attributes)
        if isinstance(entry, Variable):
            self.put(name, entry.data.astype(object) if entry.dtype is None else entry.data)
        return dataset

    def _attach(self, dataset: Any, dims: tuple[str, ...], extra: Mapping[str, Variable]) -> None:
        """Name the dimensions of a dataset, and the further coordinates along them."""
        for axis, dim in enumerate(dims):
            dataset.dims[axis].attach_scale(self._file[dim])
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
    tag: str = "",
) -> Iterator[Assembly]:
    """Create a result file to be filled in the block; every blank must be written.

    The layout is that of HDF5 1.8 with netCDF-4's dimension scales, which HDF5 tools, netCDF and
    xarray all read. The file appears, complete, when the block ends without an error.

    Parameters
    ----------
    path
        The file; its folder must exist.
    sizes
        The size of every dimension.
    coordinates
        As in a `Table`.
    variables
        By name: blanks, or variables that are written at once.
    compression
        ``"gzip"`` stores numbers in shuffled, compressed chunks; None, contiguously.
    tag
        Distinguishes the unfinished files of concurrent processes.

    Raises
    ------
    ResultError
        If the disk refuses; `path` is then as it was before.
    """
    with created(path, tag) as file:
        file.attrs[FORMAT_ATTRIBUTE] = FORMAT
        file.attrs[VERSION_ATTRIBUTE] = np.bytes_(__version__)
        yield Assembly(file, sizes, coordinates, variables, compression)


def _compressed(shape: tuple[int, ...], dtype: np.dtype[Any]) -> dict[str, Any]:
    """How h5py is told to compress: in blocks of about 1 MiB that hold the last axes whole."""
    room = max(1, _CHUNK_BYTES // dtype.itemsize)
    chunks: list[int] = []
    for size in reversed(shape):
        pieces = -(-size // room)
        chunks.insert(0, -(-size // pieces))
        room = max(1, room // chunks[0])
    return {"compression": "gzip", "shuffle": True, "chunks": tuple(chunks)}
