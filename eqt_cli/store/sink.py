"""A file that never fails while HDF5 writes it; it must not know what is written."""

from __future__ import annotations

import io
import os
from pathlib import Path
from types import TracebackType
from typing import Self

READ_BACK = 2**24
"""Bytes; HDF5 reads back its own notes and heaps, which are shorter, and no longer data."""


class Sink:
    """A new file that keeps its first error to itself until asked.

    When a write fails while HDF5 closes a file, HDF5 leaves objects behind whose destruction
    crashes the process later. So this file takes every write; after the first error it writes
    nothing more, and leaving its `with` block raises that error, once HDF5 is done. Until then
    HDF5 may read back what it wrote, and trusts it: what no longer reaches the disk is kept here.
    """

    def __init__(self, path: Path) -> None:
        self._file = io.FileIO(path, "x+")
        self._error: BaseException | None = None
        self._kept: list[tuple[int, bytes]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._file.close()
        if self._error is not None:
            raise self._error

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Go to a position, as HDF5 asks before it reads, writes, or measures the file."""
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        """The position."""
        return self._file.tell()

    def readinto(self, buffer: memoryview) -> int:
        """Read back what HDF5 wrote earlier, whether it reached the disk or not."""
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
            except BaseException as error:  # also an interruption: HDF5 must come to its end first
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
        """Do nothing: the file has no buffer of its own."""

    def synchronise(self) -> None:
        """Bring the file to the disk, unless an earlier step failed."""
        if self._error is None:
            os.fsync(self._file.fileno())
