"""Writes files completely or not at all, and never through a link; all of eqt writes this way."""

import errno
import io
import os
import re
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

NO_SPACE = {errno.ENOSPC, errno.EFBIG, getattr(errno, "EDQUOT", errno.ENOSPC)}
"""Error numbers of a full disk or an exceeded quota."""

_TEMPORARY = re.compile(r"(.+)\.[0-9a-f]{16}\.tmp")
"""The name of an unfinished file: the final name, and a random part."""


@contextmanager
def replacement(path: Path) -> Iterator[io.FileIO]:
    """Open a new file that replaces `path` when the block ends without an error.

    The file is written in the same folder under a random name that must not exist yet, so that no
    link can redirect it. Then it is flushed to the disk and renamed.
    """
    temporary = path.with_name(f"{path.name}.{secrets.token_hex(8)}.tmp")
    with io.FileIO(temporary, "x+") as file:
        try:
            yield file
            os.fsync(file.fileno())
            file.close()
            temporary.replace(path)
        except BaseException:
            with suppress(OSError):
                file.close()
            with suppress(OSError):
                temporary.unlink(missing_ok=True)
            raise
    _sync_folder(path.parent)


def replace_file(path: Path, content: bytes) -> None:
    """Write a file completely or not at all, even if the process or the machine stops."""
    with replacement(path) as file:
        _write(file, content)


def new_file(path: Path, content: bytes) -> None:
    """Write a file that must not exist yet; after an error, no file remains.

    Raises
    ------
    FileExistsError
        If there is an entry of this name, even a broken link.
    """
    with io.FileIO(path, "x") as file:
        try:
            _write(file, content)
            os.fsync(file.fileno())
        except BaseException:
            with suppress(OSError):
                path.unlink()
            raise


def name_to_be(name: str) -> str | None:
    """Return the final name of an unfinished file; None for any other file."""
    match = _TEMPORARY.fullmatch(name)
    return match[1] if match else None


def _write(file: io.FileIO, content: bytes) -> None:
    """Write all of the content, in several calls where the system takes less at a time."""
    rest = memoryview(content)
    while rest:
        rest = rest[file.write(rest) :]


def _sync_folder(folder: Path) -> None:
    """Flush a rename to the disk, where the system and the disk support it."""
    if os.name != "posix":
        return
    with suppress(PermissionError):  # a folder may be writable, but not readable
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        except OSError as error:
            if error.errno not in (errno.EINVAL, errno.ENOTSUP):
                raise
        finally:
            os.close(handle)
