"""One writer per result folder: a lock that ends with its process, however that ends."""

import errno
import json
import os
import platform
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from eqt_cli.core.errors import OTHER_FOLDER, EqtError, EqtWarning, Remedy
from eqt_cli.core.files import refusals
from eqt_cli.core.own_files import check_kind, foreign
from eqt_cli.core.regular_files import FILE
from eqt_cli.core.reporting import reporter
from eqt_cli.execution.provenance import now

LOCK = ".lock"

_BEGINNING = b'{"pid": '
"""Of what a lock says; a process that was killed may have left less."""

_MOST_READ = 4096
"""Bytes of a lock; it says less."""

_CAREFULLY = sum(getattr(os, name, 0) for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC"))
"""Follow no link and wait for no pipe."""

if sys.platform == "win32":

    def _flock(handle: int, *, shared: bool) -> None:
        """Nothing keeps two writers apart there."""

else:
    import fcntl

    def _flock(handle: int, *, shared: bool) -> None:
        """Lock an open file, or raise at once."""
        fcntl.flock(handle, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)


@contextmanager
def locked(
    folder: Path,
    *,
    shared: bool = False,
    name: str = LOCK,
    tells: bool = True,
) -> Iterator[None]:
    """Keep the folder for this process until the block ends.

    The system itself holds the lock, so that none is left behind by a process that was killed.
    Where a disk refuses to lock, nothing is kept.

    Parameters
    ----------
    shared
        Let others in that also ask for a share, as the shards of a job array do.
    name
        The file that is locked.
    tells
        Whether a disk that refuses is remarked upon.

    Raises
    ------
    EqtError
        If another process has it, the folder cannot be written to, or the file is not eqt's.
    """
    path = folder / name
    with refusals(folder, "used", OTHER_FOLDER):
        folder.mkdir(parents=True, exist_ok=True)
        handle, is_locked = _opened(path, shared)
    try:
        if tells and not is_locked:
            reporter().remark(
                EqtWarning(
                    f"{folder}: its disk refuses file locks, so nothing keeps a second eqt from "
                    "writing to it at the same time",
                    Remedy("run one at a time there"),
                    Remedy("choose another disk with {}", "out"),
                )
            )
        if not shared:
            with refusals(folder, "used", OTHER_FOLDER):
                _sign(handle)
        yield
    finally:
        with suppress(OSError):  # the next process takes over a file that is left
            if not shared and os.path.samestat(os.fstat(handle), path.lstat()):
                path.unlink()
        with suppress(OSError):
            os.close(handle)


def _sign(handle: int) -> None:
    """Write into the locked file who has it."""
    os.ftruncate(handle, 0)
    os.lseek(handle, 0, os.SEEK_SET)
    own = {"pid": os.getpid(), "host": platform.node(), "since": now()}
    os.write(handle, json.dumps(own).encode())


def _opened(path: Path, shared: bool) -> tuple[int, bool]:
    """The open file, and whether it could be locked.

    It is tried again where its last owner has removed the file before it was locked.
    """
    while True:
        check_kind(path, FILE)
        handle = os.open(path, os.O_RDWR | os.O_CREAT | _CAREFULLY, 0o666)
        try:
            is_locked = _lock(handle, path, shared)
            if os.path.samestat(os.fstat(handle), path.lstat()):
                _check_own(handle, path)
                return handle, is_locked
        except FileNotFoundError:
            pass
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)


def _check_own(handle: int, path: Path) -> None:
    """Refuse a file that eqt did not make: one with another name elsewhere, or of another text."""
    found = os.fstat(handle)
    if found.st_nlink > 1:
        raise foreign(path, f"a file with {found.st_nlink} hard links", FILE)
    if not _BEGINNING.startswith(_text(handle)[: len(_BEGINNING)]):
        raise foreign(path, "a file with another content", "a lock")


def holder(folder: Path) -> dict[str, Any] | None:
    """Who writes to the folder now: process, host, since when; None if nobody does."""
    for path in [folder / LOCK, *folder.glob(f"{LOCK}-*")]:
        try:
            handle = os.open(path, os.O_RDONLY | _CAREFULLY)
        except OSError:
            continue
        try:
            if stat.S_ISREG(os.fstat(handle).st_mode):
                _flock(handle, shared=True)
        except OSError as error:
            if error.errno in (errno.EAGAIN, errno.EACCES):
                return _read(handle) or {}
        finally:
            os.close(handle)
    return None


def _lock(handle: int, path: Path, shared: bool) -> bool:
    """Whether the disk could lock; an error if another process has done so."""
    try:
        _flock(handle, shared=shared)
    except OSError as error:
        if error.errno not in (errno.EAGAIN, errno.EACCES):
            return False
        other = _read(handle)
        who = f" (process {other['pid']} on {other['host']})" if other else ""
        raise EqtError(
            f"{path.parent}: another eqt{who} is writing to it",
            Remedy("wait for its end"),
            OTHER_FOLDER,
        ) from error
    return True


def _read(handle: int) -> dict[str, Any] | None:
    """Who has a lock; None where it does not say."""
    with suppress(OSError, ValueError):
        found = json.loads(_text(handle))
        return found if isinstance(found, dict) and {"pid", "host"} <= set(found) else None
    return None


def _text(handle: int) -> bytes:
    os.lseek(handle, 0, os.SEEK_SET)
    return os.read(handle, _MOST_READ)
