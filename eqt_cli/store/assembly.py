"""A result file that is filled piece by piece, for what does not fit the memory.

It appears complete or not at all, as with `eqt_cli.store.writer`; it must not know what the
numbers mean or where the pieces come from.
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

from eqt_cli.store.layout import FORMAT, FORMAT_ATTRIBUTE
from eqt_cli.store.variables import Attribute, Variable
from eqt_cli.store.writer import add_scales, attach, compressed, created, set_attributes


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
    """An unfinished result file.

    Parameters
    ----------
    file
        The open HDF5 file, or a group of it, which holds its variables already.
    compression
        Of groups to come.
    """

    def __init__(self, file: Any, compression: Literal["gzip"] | None = None) -> None:
        self._file, self._compression = file, compression
        self._texts: set[str] = set()

    def group(
        self,
        name: str,
        sizes: Mapping[str, int],
        coordinates: Mapping[str, Variable],
        blanks: Mapping[str, Blank],
    ) -> Assembly:
        """Add a group with dimensions and variables of its own, as `assemble` does for the file."""
        creation = h5py.h5p.create(h5py.h5p.GROUP_CREATE)
        creation.set_obj_track_times(False)
        creation.set_link_creation_order(h5py.h5p.CRT_ORDER_TRACKED | h5py.h5p.CRT_ORDER_INDEXED)
        group = h5py.Group(h5py.h5g.create(self._file.id, name.encode(), gcpl=creation))
        _add_blanks(group, sizes, coordinates, blanks, self._compression)
        return Assembly(group, self._compression)

    def put(self, name: str, data: NDArray[Any], positions: tuple[int | slice, ...] = ()) -> None:
        """Write part of a variable: at `positions` along its first axes, all of the others."""
        is_text = data.dtype == object
        # Empty strings are left unwritten, as in `write`, unless they replace others.
        if data.size and not (is_text and name not in self._texts and (data == "").all()):
            self._file[name][positions] = data
            if is_text:
                self._texts.add(name)

    def describe(self, attributes: Mapping[str, Attribute]) -> None:
        """Add attributes of the file, or of the group."""
        set_attributes(self._file, attributes)


@contextmanager
def assemble(
    path: str | Path,
    sizes: Mapping[str, int],
    coordinates: Mapping[str, Variable],
    blanks: Mapping[str, Blank],
    compression: Literal["gzip"] | None = None,
) -> Iterator[Assembly]:
    """Create a result file to be filled in the block; every variable must be written.

    Parameters
    ----------
    path
        The file; its folder must exist.
    sizes
        The size of every dimension.
    coordinates
        As in a `Table`.
    blanks
        The variables, by name.
    compression
        As for `eqt_cli.store.writer.write`.

    Raises
    ------
    ResultError
        If the disk refuses; `path` is then as it was before.
    """
    with created(path) as file:
        file.attrs[FORMAT_ATTRIBUTE] = FORMAT
        _add_blanks(file, sizes, coordinates, blanks, compression)
        yield Assembly(file, compression)


def _add_blanks(
    owner: Any,
    sizes: Mapping[str, int],
    coordinates: Mapping[str, Variable],
    blanks: Mapping[str, Blank],
    compression: Literal["gzip"] | None,
) -> None:
    extra = add_scales(owner, sizes, coordinates)
    for name, blank in blanks.items():
        shape = tuple(sizes[dim] for dim in blank.dims)
        dtype = h5py.string_dtype("utf-8") if blank.dtype is None else blank.dtype
        options: dict[str, Any] = {}
        if compression and blank.dtype is not None and shape and 0 not in shape:
            options = compressed(shape, blank.dtype)
        dataset = owner.create_dataset(name, shape=shape, dtype=dtype, **options)
        if blank.dtype is None and 0 not in shape:
            dataset[(0,) * len(shape)] = ""  # so that the dataset takes its room
        set_attributes(dataset, blank.attributes)
        attach(owner, dataset, blank.dims, extra)
