"""Writes result files in HDF5, whole or not at all."""

from __future__ import annotations

import errno
import io
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from eqt_cli.base import files, stored
from eqt_cli.base.errors import FullDiskError, Remedy, ResultError
from eqt_cli.base.version import __version__

Attribute = stored.Attribute
"""The value of an attribute; integers must fit into 64 bits."""


@dataclass(frozen=True, eq=False)
class Variable:
    """An array whose axes have names.

    Parameters
    ----------
    dims
        One name per axis; empty for a scalar.
    data
        Integers of 1 to 8 bytes, floats of 4 or 8 bytes, or strings (of any NumPy string dtype, or
        an object array of `str`). Of a blank, which is written later, only the type of its data:
        None for strings.
    attributes
        Descriptions of the array: ``units``, ``long_name``, and so on.
    """

    dims: tuple[str, ...]
    data: NDArray[Any] | np.dtype[Any] | None
    attributes: Mapping[str, Attribute] = field(default_factory=dict)

    @property
    def dtype(self) -> np.dtype[Any] | None:
        """The type of the data; None for strings."""
        if not isinstance(self.data, np.ndarray):
            return self.data
        return None if self.data.dtype.kind in "UTO" else self.data.dtype

    @property
    def size(self) -> int:
        """The number of its entries; 0 of a blank."""
        return self.data.size if isinstance(self.data, np.ndarray) else 0


READ_BACK = 2**24
"""Largest write to keep after an error, bytes; HDF5 reads back only its metadata and heaps, which
are smaller."""

_FORBIDDEN = {errno.EACCES, errno.EPERM, errno.EROFS}
_NO_FOLDER = {errno.ENOENT, errno.ENOTDIR}


class Sink:
    """A file that raises its first error only at the end of its `with` block.

    If a write fails while HDF5 closes a file, HDF5 leaves objects behind whose destruction crashes
    the process later. So this file accepts every write. After the first error it writes nothing
    more to the disk, and raises that error at the end of the block, when HDF5 is done. Until then
    HDF5 may read back what it wrote, so later writes are kept in memory.
    """

    def __init__(self, file: io.FileIO) -> None:
        self._file = file
        self._error: BaseException | None = None
        self._buffered: list[tuple[int, bytes]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._error is not None:
            raise self._error

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Go to a position, as HDF5 requests before it reads, writes, or measures the file."""
        try:
            return self._file.seek(offset, whence)
        except BaseException as error:  # an interruption, as in `write`; HDF5 would print it
            self._error = self._error or error
            return self._file.seek(offset, whence)

    def tell(self) -> int:
        """Return the position."""
        return self._file.tell()

    def readinto(self, buffer: memoryview) -> int:
        """Read back what HDF5 wrote, from the disk or from memory."""
        start, view = self._file.tell(), memoryview(buffer).cast("B")
        count = self._file.readinto(view)
        if self._error is not None:
            view[count:] = bytes(len(view) - count)
            for position, data in self._buffered:
                first, last = max(start, position), min(start + len(view), position + len(data))
                if first < last:
                    view[first - start : last - start] = data[first - position : last - position]
            count = len(view)
        return count

    def write(self, data: memoryview) -> None:
        """Write all of `data`, unless an earlier step failed."""
        start = self._file.tell()
        if self._error is None:
            try:
                files.write_whole(self._file, data)
            except BaseException as error:  # even an interruption must wait for HDF5
                self._error = error
        if self._error is not None and len(data) <= READ_BACK:
            self._buffered.append((start, bytes(data)))

    def truncate(self, size: int) -> None:
        """Set the length of the file, unless an earlier step failed."""
        if self._error is None:
            try:
                self._file.truncate(size)
            except OSError as error:
                self._error = error

    def flush(self) -> None:
        """Do nothing, because the file has no buffer."""


def _create(sink: Sink) -> Any:
    """Create an HDF5 file in `sink`, in the layout of HDF5 1.8, without time stamps.

    Names are listed in the order of writing.
    """
    access = h5py.h5p.create(h5py.h5p.FILE_ACCESS)
    access.set_fileobj_driver(h5py.h5fd.fileobj_driver, sink)
    # From 1.8 on, attributes may exceed 64 KB and metadata carry checksums.
    access.set_libver_bounds(h5py.h5f.LIBVER_V18, h5py.h5f.LIBVER_V18)
    access.set_fclose_degree(h5py.h5f.CLOSE_STRONG)
    creation = h5py.h5p.create(h5py.h5p.FILE_CREATE)
    creation.set_obj_track_times(False)
    creation.set_link_creation_order(h5py.h5p.CRT_ORDER_TRACKED | h5py.h5p.CRT_ORDER_INDEXED)
    return h5py.File(h5py.h5f.create(b"results", h5py.h5f.ACC_TRUNC, creation, access))


def _refused(target: Path, error: OSError) -> ResultError:
    reason = f"{target}: cannot be written: {error.strerror or error}"
    if error.errno in files.NO_SPACE:
        remedy = Remedy("free some space or choose another folder with {}", "out")
        return FullDiskError(reason, remedy)
    if error.errno in _FORBIDDEN:
        remedy = Remedy("choose a folder that you may write to with {}", "out")
    elif error.errno in _NO_FOLDER:
        remedy = Remedy(f"create the folder {target.parent} first")
    else:
        remedy = Remedy(f"check the folder {target.parent}")
    return ResultError(reason, remedy)


def _fixed(texts: Iterable[str], encoding: int) -> tuple[NDArray[np.bytes_], Any]:
    """Encode texts, each with a NUL: netCDF takes a single byte for a character."""
    encoded = np.array([text.encode() for text in texts], np.bytes_)
    if any("\0" in text for text in texts):
        raise ValueError("texts in results hold no NUL")
    kind = h5py.h5t.C_S1.copy()
    kind.set_size(encoded.itemsize + 1)
    kind.set_cset(encoding)
    return encoded.astype(kind.dtype), h5py.Datatype(kind)


def _describe(owner: Any, attributes: Mapping[str, Attribute]) -> None:
    for name, value in attributes.items():
        if isinstance(value, str):
            (text,), kind = _fixed([value], h5py.h5t.CSET_UTF8)
            owner.attrs.create(name, text, dtype=kind)
        else:
            owner.attrs[name] = value


_CHUNK_BYTES = 2**20


class Assembly:
    """An unfinished result file, with every dimension, coordinate and variable.

    Parameters
    ----------
    file
        The open HDF5 file.
    sizes, coordinates, variables, compression
        As in `assemble`.
    """

    def __init__(
        self,
        file: Any,
        sizes: Mapping[str, int],
        coordinates: Mapping[str, Variable],
        variables: Mapping[str, Variable],
        compression: Literal["gzip"] | None,
    ) -> None:
        self._file, self._sizes = file, sizes
        self._texts: dict[str, dict[str, int]] = {}  # the numbers of texts, by variable
        self._datasets: dict[str, Any] = {}  # kept open: opening one takes as long as writing it
        for dim, size in sizes.items():
            if dim in coordinates:
                self._add(dim, coordinates[dim]).make_scale(dim)
            else:
                # It is never written, so that it takes no space: only its length counts.
                blank = file.create_dataset(dim, shape=(size,), dtype=">f4")
                self._datasets[dim] = blank
                blank.make_scale(f"{stored.PLACEHOLDER}{size:10d}")
        extra = {name: variable for name, variable in coordinates.items() if name not in sizes}
        for name, variable in extra.items():
            self._attach(self._add(name, variable), variable.dims, {})
        for name, entry in variables.items():
            if entry.dtype is None:
                self._texts[name] = {"": 0}
            self._attach(self._add(name, entry, compression), entry.dims, extra)

    def shape(self, name: str) -> tuple[int, ...]:
        """Return the shape of a variable."""
        return self._datasets[name].shape

    def put(self, name: str, data: NDArray[Any], positions: tuple[int | slice, ...] = ()) -> None:
        """Write part of a variable: `positions` along its first axes, and all of the other axes."""
        if name in self._texts:
            numbers = self._texts[name]
            listed = [numbers.setdefault(text, len(numbers)) for text in data.ravel().tolist()]
            data = np.array(listed, np.int32).reshape(data.shape)
        if data.size:
            self._datasets[name][positions] = data

    def put_texts(self) -> None:
        """Write the texts that complete variables number, in alphabetical order."""
        for name, numbers in self._texts.items():
            dataset = self._datasets[name]
            is_used = np.zeros(len(numbers), dtype=bool)
            is_used[dataset[()]] = True
            by_number = np.where(is_used, np.array(list(numbers), dtype=object), "")
            texts, places = np.unique(by_number, return_inverse=True)
            if len(numbers) > 1:
                dataset[...] = places[dataset[...]]
            table, about = name + stored.TEXTS, {"long_name": f"texts that '{name}' numbers"}
            self._sizes = {table: len(texts)}
            self._add(table, Variable((table,), texts, about)).make_scale(table)

    def describe(self, attributes: Mapping[str, Attribute]) -> None:
        """Add attributes of the file."""
        _describe(self._file, attributes)

    def _add(self, name: str, entry: Variable, compression: Literal["gzip"] | None = None) -> Any:
        """Create a dataset; for a variable, write its data."""
        shape = tuple(self._sizes[dim] for dim in entry.dims)
        options: dict[str, Any] = {}
        data = entry.data if isinstance(entry.data, np.ndarray) else None
        if data is not None and entry.dtype is None and name not in self._texts:
            # Declared as ASCII, because Octave's `load` stops at UTF-8.
            data, dtype = _fixed(data.tolist(), h5py.h5t.CSET_ASCII)
        else:
            dtype = (entry.dtype or np.dtype(np.int32)).newbyteorder("<")
            if compression and shape and 0 not in shape:
                options = _compressed(shape, dtype)
        dataset = self._file.create_dataset(name, shape=shape, dtype=dtype, **options)
        self._datasets[name] = dataset
        _describe(dataset, entry.attributes)
        if isinstance(dtype, h5py.Datatype):
            # For h5netcdf, as an array of one, which netCDF skips: xarray would decode text again.
            dataset.attrs.create("_Encoding", [b"utf-8"], (1,), "(1,)S5")
        if data is not None:
            self.put(name, data)
        return dataset

    def _attach(self, dataset: Any, dims: tuple[str, ...], extra: Mapping[str, Variable]) -> None:
        """Attach the dimensions of a dataset, and name its further coordinates."""
        for axis, dim in enumerate(dims):
            dataset.dims[axis].attach_scale(self._datasets[dim])
        described = [name for name, variable in extra.items() if set(variable.dims) <= set(dims)]
        if described:
            _describe(dataset, {stored.COORDINATES: " ".join(described)})


@contextmanager
def assemble(
    path: str | Path,
    sizes: Mapping[str, int],
    coordinates: Mapping[str, Variable],
    variables: Mapping[str, Variable],
    compression: Literal["gzip"] | None = None,
) -> Iterator[Assembly]:
    """Create a result file, to be filled in the block; every blank must be written.

    The layout is that of HDF5 1.8 with netCDF-4's dimension scales, which HDF5 tools, netCDF and
    xarray can read; a checksum of all bytes follows. The complete file appears when the block ends
    without an error.

    Parameters
    ----------
    path
        The file; its folder must exist.
    sizes
        The size of every dimension.
    coordinates
        The meaning of positions along the dimensions, by name. A 1-D array with the name of a
        dimension belongs to that dimension; others are further coordinates, such as ``gains.kd``
        along ``point``. A dimension may have no coordinate.
    variables
        The data by name; blanks are written in the block.
    compression
        ``"gzip"`` stores numbers in shuffled, compressed chunks, None contiguously.

    Raises
    ------
    ResultError
        If the file cannot be written; `path` is then unchanged.
    """
    target = Path(path)
    try:
        with files.replacement(target) as written:
            with Sink(written) as sink, _create(sink) as file:
                file.attrs[stored.FORMAT_ATTRIBUTE] = stored.FORMAT
                file.attrs[stored.VERSION_ATTRIBUTE] = np.bytes_(__version__)
                assembly = Assembly(file, sizes, coordinates, variables, compression)
                yield assembly
                assembly.put_texts()
            files.seal(written)
    except OSError as error:
        raise _refused(target, error) from error


def _compressed(shape: tuple[int, ...], dtype: np.dtype[Any]) -> dict[str, Any]:
    """Return h5py's options for compressed chunks of about 1 MiB, complete along the last axes."""
    capacity = max(1, _CHUNK_BYTES // dtype.itemsize)
    chunks: list[int] = []
    for size in reversed(shape):
        pieces = -(-size // capacity)
        chunks.insert(0, -(-size // pieces))
        capacity = max(1, capacity // chunks[0])
    return {"compression": "gzip", "shuffle": True, "chunks": tuple(chunks)}


def write_arrays(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays one after the other, as `numpy.save` does, whole or not at all.

    Their names come first, and a checksum of all bytes last. Raises as `assemble`.
    """
    try:
        with files.replacement(path) as written:
            for values in (np.array(list(arrays)), *map(np.ascontiguousarray, arrays.values())):
                head, about = io.BytesIO(), np.lib.format.header_data_from_array_1_0(values)
                np.lib.format.write_array_header_1_0(head, about)
                files.write_whole(written, head.getvalue())
                files.write_whole(written, values.tobytes())
            files.seal(written)
    except OSError as error:
        raise _refused(path, error) from error
