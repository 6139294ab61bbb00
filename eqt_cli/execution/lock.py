"""One writer per result folder: a lock that ends with its process, however that ends."""

import errno
import json
import os
import platform
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from eqt_cli.core.errors import OTHER_FOLDER, EqtError, EqtWarning, Remedy
from eqt_cli.core.files import read_record, refusals
from eqt_cli.execution.provenance import now

LOCK = ".lock"

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
    remark: Callable[[EqtWarning], None] = lambda remark: None,
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
    remark
        Told if the disk refuses.

    Raises
    ------
    EqtError
        If another process has it, or the folder cannot be written to.
    """
    path = folder / name
    with refusals(folder, "used", OTHER_FOLDER):
        folder.mkdir(parents=True, exist_ok=True)
        handle, is_locked = _opened(path, shared)
    try:
        if not is_locked:
            remark(
                EqtWarning(
                    f"{folder}: its disk refuses file locks, so nothing keeps a second eqt from "
                    "writing to it at the same time",
                    Remedy("run one at a time there"),
                    Remedy("choose another disk with {}", "out"),
                )
            )
        if not shared:
            os.ftruncate(handle, 0)
            own = {"pid": os.getpid(), "host": platform.node(), "since": now()}
            os.write(handle, json.dumps(own).encode())
        yield
    finally:
        if not shared:
            path.unlink(missing_ok=True)
        os.close(handle)


def _opened(path: Path, shared: bool) -> tuple[int, bool]:
    """The open file, and whether it could be locked.

    It is tried again where its last owner has removed the file before it was locked.
    """
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            is_locked = _lock(handle, path, shared)
            if os.path.samestat(os.fstat(handle), path.stat()):
                return handle, is_locked
        except FileNotFoundError:
            pass
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)


def holder(folder: Path) -> dict[str, Any] | None:
    """Who writes to the folder now: process, host, since when; None if nobody does."""
    for path in [folder / LOCK, *folder.glob(f"{LOCK}-*")]:
        try:
            handle = os.open(path, os.O_RDONLY)
        except OSError:
            continue
        try:
            _flock(handle, shared=True)
        except OSError as error:
            if error.errno in (errno.EAGAIN, errno.EACCES):
                return _read(path) or {}
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
        other = _read(path)
        who = f" (process {other['pid']} on {other['host']})" if other else ""
        raise EqtError(
            f"{path.parent}: another eqt{who} is writing to it",
            Remedy("wait for its end"),
            OTHER_FOLDER,
        ) from error
    return True


def _read(path: Path) -> dict[str, Any] | None:
    with suppress(OSError):
        return read_record(path, "pid", "host")
    return None
