"""Locks a result folder for one writer; the lock ends with its process.

The library filelock locks for one process alone, whose name it does not tell; its lock for several
readers is a database, which stays in the folder.
"""

import json
import os
import platform
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

from eqt_cli.base import files
from eqt_cli.base.errors import OTHER_FOLDER, EqtError, HarmWarning, Remedy
from eqt_cli.base.reporting import reporter
from eqt_cli.runs.provenance import now

if sys.platform != "win32":
    import fcntl

LOCK = ".lock"

_BEGINNING = b'{"pid": '
"""First bytes of a lock file; a killed process may have written fewer."""

_HELD = (BlockingIOError, PermissionError)
"""Errors of the system, by disk, if another process holds a lock."""


@contextmanager
def locked(
    folder: Path, *, shared: bool = False, name: str = LOCK, warns: bool = True
) -> Iterator[None]:
    """Lock the folder for this process until the block ends.

    The operating system holds the lock, so that a killed process leaves none behind. If the disk
    does not support locks, the folder is not locked.

    Parameters
    ----------
    shared
        Whether others may also take a shared lock, as the shards of a job array do.
    name
        Name of the locked file.
    warns
        Whether to remark that the disk does not support locks.

    Raises
    ------
    EqtError
        If another process holds the lock, the folder is not writable, or the file is not eqt's.
    """
    with ExitStack() as until_end:
        with files.refusals(folder, "used", OTHER_FOLDER):
            folder.mkdir(parents=True, exist_ok=True)
            is_locked = _lock(folder / name, shared, until_end)
        if warns and not is_locked:
            reporter().remark(
                HarmWarning(
                    f"{folder}: its disk does not support file locks, so a second eqt could write "
                    "to it at the same time",
                    Remedy("run one at a time there"),
                    Remedy("choose another disk with {}", "out"),
                )
            )
        yield


def _lock(path: Path, shared: bool, until_end: ExitStack) -> bool:
    """Open and lock a file, and name this process in it; return whether the disk supports locks."""
    flags = sum(getattr(os, name, 0) for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC"))
    while True:
        files.check_kind(path, files.FILE)
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | flags, 0o666)
        until_end.callback(_close, handle)
        try:
            is_locked = _flock(handle, shared=shared)
        except _HELD as error:
            other = files.read_record(path, "pid", "host")
            who = f" (process {other['pid']} on {other['host']})" if other else ""
            raise EqtError(
                f"{path.parent}: another eqt{who} is writing to it",
                Remedy("wait for its end"),
                OTHER_FOLDER,
            ) from error
        with suppress(FileNotFoundError):  # the previous owner removed it before it was locked
            if _is_at(path, handle):
                break
    links = os.fstat(handle).st_nlink
    if links > 1:
        raise files.foreign(path, f"a file with {links} hard links", files.FILE)
    if not _BEGINNING.startswith(os.read(handle, len(_BEGINNING))):
        raise files.foreign(path, "a file with another content", "a lock")
    if not shared:
        until_end.callback(_remove, path, handle)
        owner = {"pid": os.getpid(), "host": platform.node(), "since": now()}
        os.ftruncate(handle, 0)
        os.write(handle, json.dumps(owner).encode())
    return is_locked


def _flock(handle: int, *, shared: bool) -> bool:
    """Lock an open file at once, or raise one of `_HELD`; return whether the disk supports it."""
    if sys.platform == "win32":
        return False
    try:
        fcntl.flock(handle, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except _HELD:
        raise
    except OSError:
        return False
    return True


def _is_at(path: Path, handle: int) -> bool:
    return os.path.samestat(os.fstat(handle), path.lstat())


def _remove(path: Path, handle: int) -> None:
    with suppress(OSError):  # the next process reuses a file that remains
        if _is_at(path, handle):
            path.unlink()


def _close(handle: int) -> None:
    with suppress(OSError):
        os.close(handle)


def holder(folder: Path) -> dict[str, Any] | None:
    """Return the process, host and start time of the folder's writer; None if there is none."""
    for path in [folder / LOCK, *folder.glob(f"{LOCK}-*")]:
        with suppress(OSError), files.open_regular(path, follow=False) as file:
            try:
                _flock(file.fileno(), shared=True)
            except _HELD:
                return files.read_record(path, "pid", "host") or {}
    return None
