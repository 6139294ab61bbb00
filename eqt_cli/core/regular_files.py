"""Opens the files that a user, a configuration or a folder names; all of eqt opens them here.

Such a name can lead to a named pipe without a writer, to an endless device, or to a file that is
larger than the memory.
"""

import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO

RECORD_BYTES = 16 * 2**20
"""Largest record that eqt keeps in a folder, such as ``manifest.json``, bytes."""

TEXT_BYTES = 4_000_000
"""Largest text that a user writes, bytes: a configuration, a plugin, a style sheet, notes."""

FILE, FOLDER = "a file", "a folder"

_KINDS = (
    (stat.S_ISREG, FILE),
    (stat.S_ISDIR, FOLDER),
    (stat.S_ISLNK, "a symbolic link"),
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISSOCK, "a socket"),
)

_OPEN_FLAGS = (
    os.O_RDONLY
    | getattr(os, "O_NONBLOCK", 0)  # a pipe would wait for a writer
    | getattr(os, "O_NOCTTY", 0)
    | getattr(os, "O_CLOEXEC", 0)
    | getattr(os, "O_BINARY", 0)
)


def kind_in_words(mode: int) -> str:
    """Return the kind of a folder entry of this mode."""
    return next((kind for matches, kind in _KINDS if matches(mode)), "a device")


class NotRegularError(OSError):
    """Raised where an entry is no regular file."""


class TooLargeError(OSError):
    """Raised for a file that is larger than its kind may be.

    Attributes
    ----------
    size
        Size of the file, bytes; a lower bound where the system does not report the size.
    """

    def __init__(self, limit: int, size: int) -> None:
        super().__init__(errno.EFBIG, f"expected at most {limit:,} bytes, got {size:,}")
        self.size = size


def open_regular(path: Path, *, follow: bool = True) -> BinaryIO:
    """Open a file for reading, if it is a regular file.

    Parameters
    ----------
    follow
        Whether the file itself may be a symbolic link.

    Raises
    ------
    NotRegularError
        For a pipe, a device, a socket, and a link that is not followed.
    OSError
        If it cannot be opened, as for a folder.
    """
    # Check first, because opening a device may start an action.
    _require_regular(path.stat() if follow else path.lstat())
    handle = os.open(path, _OPEN_FLAGS | (0 if follow else getattr(os, "O_NOFOLLOW", 0)))
    try:
        _require_regular(os.fstat(handle))
        return os.fdopen(handle, "rb")
    except BaseException:
        os.close(handle)
        raise


def content_of(path: Path, limit: int, *, follow: bool = True) -> bytes:
    """Return the content of a regular file of at most `limit` bytes.

    Raises
    ------
    TooLargeError
        If the file is larger; where the system reports its size, before anything is read.
    OSError
        As by `open_regular`.
    """
    with open_regular(path, follow=follow) as stream:
        size = os.fstat(stream.fileno()).st_size
        if size > limit:
            raise TooLargeError(limit, size)
        content = stream.read(limit + 1)  # some system files report a size of 0
    if len(content) > limit:
        raise TooLargeError(limit, len(content))
    return content


def text_in(path: Path, limit: int = TEXT_BYTES) -> str:
    """Return the text of a file, read by `content_of`, with line breaks as in Python.

    Raises
    ------
    UnicodeDecodeError
        If the file is not in UTF-8.
    """
    text = content_of(path, limit).decode("utf-8")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _require_regular(status: os.stat_result) -> None:
    if stat.S_ISREG(status.st_mode):
        return
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    kind = kind_in_words(status.st_mode)
    raise NotRegularError(errno.EINVAL, f"it is {kind}; expected a regular file")
