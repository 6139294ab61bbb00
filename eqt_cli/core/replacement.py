"""The one way in which eqt writes a file: whole or not at all, and through no link."""

import errno
import io
import os
import re
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

NO_SPACE = {errno.ENOSPC, errno.EFBIG, getattr(errno, "EDQUOT", errno.ENOSPC)}
"""What a full disk, or a quota, answers."""

_TEMPORARY = re.compile(r"(.+)\.[0-9a-f]{16}\.tmp")
"""An unfinished file: its name to be, and what nobody can guess."""


@contextmanager
def replacement(path: Path) -> Iterator[io.FileIO]:
    """A new file that takes the place of `path` when the block ends without an error.

    It is written beside its place, under a name that nobody can guess and that must not exist; so
    no link can lead it elsewhere. Then it is brought to the disk and renamed.
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
    """Write a file whole or not at all, whenever the process or the machine may stop."""
    with replacement(path) as file:
        _write(file, content)


def new_file(path: Path, content: bytes) -> None:
    """Write a file that must not exist yet; an error leaves none.

    Raises
    ------
    FileExistsError
        If there is any entry of this name, also a link that leads nowhere.
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
    """The name for which an unfinished file was meant; None of any other file."""
    match = _TEMPORARY.fullmatch(name)
    return match[1] if match else None


def _write(file: io.FileIO, content: bytes) -> None:
    """All of it: the system may take less at a time."""
    rest = memoryview(content)
    while rest:
        rest = rest[file.write(rest) :]


def _sync_folder(folder: Path) -> None:
    """Make a rename last; not every system and disk can, and there the system's own habit holds."""
    if os.name != "posix":
        return
    with suppress(PermissionError):  # of a folder that may be written to, but not be read
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        except OSError as error:
            if error.errno not in (errno.EINVAL, errno.ENOTSUP):
                raise
        finally:
            os.close(handle)
