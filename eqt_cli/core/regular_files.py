"""The one place that opens a file which a user, a configuration or a folder names.

Such a name can lead to a named pipe, which nobody writes to, to a device without an end, or to a
file that does not fit the memory. It knows nothing of what a file holds.
"""

import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO

RECORD_BYTES = 16 * 2**20
"""The most of a record that eqt keeps in a folder, such as ``manifest.json``."""

TEXT_BYTES = 4_000_000
"""The most of a text that a user writes: a configuration, a plugin, a style sheet, notes."""

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
    """What an entry of this mode is."""
    return next((kind for matches, kind in _KINDS if matches(mode)), "a device")


class NotRegularError(OSError):
    """What is there is no regular file."""


class TooLargeError(OSError):
    """A file with more bytes than its kind may have.

    Attributes
    ----------
    size
        Its size, bytes; at least this where it does not say its size.
    """

    def __init__(self, most: int, size: int) -> None:
        super().__init__(errno.EFBIG, f"expected at most {most:,} bytes, got {size:,}")
        self.size = size


def open_regular(path: Path, *, follow: bool = True) -> BinaryIO:
    """Open a regular file for reading, and nothing else.

    Parameters
    ----------
    follow
        Whether the file itself may be a symbolic link.

    Raises
    ------
    NotRegularError
        For a pipe, a device, a socket, and a link that is not followed.
    OSError
        If it cannot be opened; a folder is one of these.
    """
    _require_regular(path.stat() if follow else path.lstat())  # a device may act when it is opened
    handle = os.open(path, _OPEN_FLAGS | (0 if follow else getattr(os, "O_NOFOLLOW", 0)))
    try:
        _require_regular(os.fstat(handle))
        return os.fdopen(handle, "rb")
    except BaseException:
        os.close(handle)
        raise


def content_of(path: Path, most: int, *, follow: bool = True) -> bytes:
    """The content of a regular file of at most so many bytes.

    Raises
    ------
    TooLargeError
        Before anything is read, if the file says that it is larger.
    OSError
        As `open_regular`.
    """
    with open_regular(path, follow=follow) as stream:
        size = os.fstat(stream.fileno()).st_size
        if size > most:
            raise TooLargeError(most, size)
        content = stream.read(most + 1)  # some files of the system say that they are empty
    if len(content) > most:
        raise TooLargeError(most, len(content))
    return content


def text_in(path: Path, most: int = TEXT_BYTES) -> str:
    """As `content_of`, decoded; line breaks are those of Python.

    Raises
    ------
    UnicodeDecodeError
        If it is no text in UTF-8.
    """
    text = content_of(path, most).decode("utf-8")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _require_regular(found: os.stat_result) -> None:
    if stat.S_ISREG(found.st_mode):
        return
    if stat.S_ISDIR(found.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    kind = kind_in_words(found.st_mode)
    raise NotRegularError(errno.EINVAL, f"it is {kind}; expected a regular file")
