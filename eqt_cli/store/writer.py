"""Writing a table to an HDF5 file in one step that either happens or does not."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Literal

import h5py
import numpy as np
from numpy.typing import NDArray

from eqt_cli.core.errors import Remedy, ResultError
from eqt_cli.store.layout import COORDINATES, FORMAT, FORMAT_ATTRIBUTE, PLACEHOLDER
from eqt_cli.store.sink import Sink
from eqt_cli.store.variables import Attribute, Table, Variable

_CHUNK_BYTES = 2**20
_NO_SPACE = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
_FORBIDDEN = {errno.EACCES, errno.EPERM, errno.EROFS}
_NO_FOLDER = {errno.ENOENT, errno.ENOTDIR}


def write(
    path: str | Path,
    table: Table,
    compression: Literal["gzip"] | None = None,
    tag: str = "",
) -> None:
    """Write `table` to the HDF5 file `path`, replacing what is there.

    The file appears complete or not at all: it is written beside its place as ``<name>.tmp``, or
    ``<name>.<tag>.tmp`` where several processes may write the same file at a time, brought to the
    disk and renamed. Equal tables give equal bytes. The layout is that of HDF5 1.8 with netCDF-4's
    dimension scales, which HDF5 tools, netCDF and xarray all read.

    Parameters
    ----------
    path
        The file; its folder must exist.
    table
        What to store.
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
        _fill(file, table, compression)


@contextmanager
def created(path: str | Path, tag: str = "") -> Iterator[Any]:
    """A new HDF5 file that takes the place of `path` when the block ends without an error.

    See `write` for what is promised, and for the errors raised.
    """
    target = Path(path)
    temporary = target.with_name(f"{target.name}{tag and '.' + tag}.tmp")
    try:
        temporary.unlink(missing_ok=True)  # what a killed process may have left
        with Sink(temporary) as sink:
            with _create(sink) as file:
                yield file
            sink.synchronise()
        temporary.replace(target)
        _sync_folder(target.parent)
    except OSError as error:
        raise _refused(target, error) from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def _create(sink: Sink) -> Any:
    """A new HDF5 file in `sink`, as readable as HDF5 1.8 and free of times of its own."""
    access = h5py.h5p.create(h5py.h5p.FILE_ACCESS)
    access.set_fileobj_driver(h5py.h5fd.fileobj_driver, sink)
    # From 1.8 on, attributes may exceed 64 KB and metadata carry checksums.
    access.set_libver_bounds(h5py.h5f.LIBVER_V18, h5py.h5f.LIBVER_V18)
    access.set_fclose_degree(h5py.h5f.CLOSE_STRONG)
    creation = h5py.h5p.create(h5py.h5p.FILE_CREATE)
    creation.set_obj_track_times(False)
    creation.set_link_creation_order(h5py.h5p.CRT_ORDER_TRACKED | h5py.h5p.CRT_ORDER_INDEXED)
    return h5py.File(h5py.h5f.create(b"results", h5py.h5f.ACC_TRUNC, creation, access))


def _fill(file: Any, table: Table, compression: Literal["gzip"] | None) -> None:
    file.attrs[FORMAT_ATTRIBUTE] = FORMAT
    set_attributes(file, table.attributes)
    extra = add_scales(file, table.dimensions, table.coordinates)
    for name, variable in table.variables.items():
        attach(file, _add(file, name, variable, compression), variable.dims, extra)


def add_scales(
    file: Any, sizes: Mapping[str, int], coordinates: Mapping[str, Variable]
) -> dict[str, Variable]:
    """Write every dimension and coordinate; returns those that are not a dimension's own."""
    for dim, size in sizes.items():
        if dim in coordinates:
            _add(file, dim, coordinates[dim], None).make_scale(dim)
        else:
            # Never written, so that it takes no room: only its length counts.
            file.create_dataset(dim, shape=(size,), dtype=">f4").make_scale(
                f"{PLACEHOLDER}{size:10d}"
            )
    extra = {name: variable for name, variable in coordinates.items() if name not in sizes}
    for name, variable in extra.items():
        attach(file, _add(file, name, variable, None), variable.dims, {})
    return extra


def attach(file: Any, dataset: Any, dims: tuple[str, ...], extra: Mapping[str, Variable]) -> None:
    """Name the dimensions of a dataset, and the further coordinates along them."""
    for axis, dim in enumerate(dims):
        dataset.dims[axis].attach_scale(file[dim])
    described = [name for name, variable in extra.items() if set(variable.dims) <= set(dims)]
    if described:
        dataset.attrs[COORDINATES] = " ".join(described)


def _add(file: Any, name: str, variable: Variable, compression: Literal["gzip"] | None) -> Any:
    if variable.is_text:
        dataset = _add_text(file, name, variable.data.astype(object))
    else:
        data = variable.data
        data = data.astype(data.dtype.newbyteorder("<"), copy=False)
        options: dict[str, Any] = {}
        if compression and data.ndim and data.size:
            options = compressed(data.shape, data.dtype)
        dataset = file.create_dataset(name, data=data, **options)
    set_attributes(dataset, variable.attributes)
    return dataset


def _add_text(file: Any, name: str, text: NDArray[Any]) -> Any:
    """Strings, never compressed: that would reach only the references to them.

    Empty ones are left unwritten, which reads the same: the millions of runs without a message
    then cost a reference each, but no object in a heap.
    """
    dataset = file.create_dataset(name, shape=text.shape, dtype=h5py.string_dtype("utf-8"))
    if text.ndim == 0:
        dataset[()] = text.item()
    elif text.size:
        filled = text != ""
        filled.flat[0] = True  # so that the dataset takes its room
        dataset[filled] = text[filled]
    return dataset


def set_attributes(owner: Any, attributes: Mapping[str, Attribute]) -> None:
    """Write attributes of a file or of a dataset."""
    for key, value in attributes.items():
        owner.attrs[key] = value


def compressed(shape: tuple[int, ...], dtype: np.dtype[Any]) -> dict[str, Any]:
    """How h5py is told to compress: in blocks of about 1 MiB that hold the last axes whole."""
    room = max(1, _CHUNK_BYTES // dtype.itemsize)
    chunks: list[int] = []
    for size in reversed(shape):
        pieces = -(-size // room)
        chunks.insert(0, -(-size // pieces))
        room = max(1, room // chunks[0])
    return {"compression": "gzip", "shuffle": True, "chunks": tuple(chunks)}


def _sync_folder(folder: Path) -> None:
    """Make a rename last; not every system and disk can, and there the system's own habit holds."""
    if os.name != "posix":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(handle)


def _refused(target: Path, error: OSError) -> ResultError:
    if error.errno in _NO_SPACE:
        remedy = Remedy("free some space or choose another folder with {}", "out")
    elif error.errno in _FORBIDDEN:
        remedy = Remedy("choose a folder that you may write to with {}", "out")
    elif error.errno in _NO_FOLDER:
        remedy = Remedy(f"create the folder {target.parent} first")
    else:
        remedy = Remedy(f"check the folder {target.parent}")
    return ResultError(f"{target}: cannot be written: {error.strerror or error}", remedy)
