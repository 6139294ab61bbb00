"""Creates HDF5 files that appear completely or not at all."""

import errno
import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

import h5py

from eqt_cli.core.errors import FullDiskError, Remedy, ResultError
from eqt_cli.core.replacement import NO_SPACE, replacement

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
        self._kept: list[tuple[int, bytes]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._error is not None:
            raise self._error

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Go to a position, as HDF5 requests before it reads, writes, or measures the file."""
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
            for position, data in self._kept:
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
                rest = memoryview(data)
                while rest:
                    rest = rest[self._file.write(rest) :]
            except BaseException as error:  # even an interruption must wait for HDF5
                self._error = error
        if self._error is not None and len(data) <= READ_BACK:
            self._kept.append((start, bytes(data)))

    def truncate(self, size: int) -> None:
        """Set the length of the file, unless an earlier step failed."""
        if self._error is None:
            try:
                self._file.truncate(size)
            except OSError as error:
                self._error = error

    def flush(self) -> None:
        """Do nothing, because the file has no buffer."""


@contextmanager
def created(path: str | Path) -> Iterator[Any]:
    """Open a new HDF5 file that replaces `path` when the block ends without an error.

    Raises
    ------
    ResultError
        If the file cannot be written; `path` is then unchanged.
    """
    target = Path(path)
    try:
        with replacement(target) as written, Sink(written) as sink, _create(sink) as file:
            yield file
    except OSError as error:
        raise _refused(target, error) from error


def _create(sink: Sink) -> Any:
    """Create an HDF5 file in `sink`, in the layout of HDF5 1.8 and without time stamps."""
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
    if error.errno in NO_SPACE:
        remedy = Remedy("free some space or choose another folder with {}", "out")
        return FullDiskError(reason, remedy)
    if error.errno in _FORBIDDEN:
        remedy = Remedy("choose a folder that you may write to with {}", "out")
    elif error.errno in _NO_FOLDER:
        remedy = Remedy(f"create the folder {target.parent} first")
    else:
        remedy = Remedy(f"check the folder {target.parent}")
    return ResultError(reason, remedy)
