"""Removal of the compiled laws on disk after a process that used them has crashed.

heyoka executes the code in its file. If a failing disk has damaged it, a signal (SIGSEGV, SIGILL,
SIGBUS) ends the process without a message; Python's `faulthandler` records that. The file itself
is not inspected: it is a database that heyoka has open, and a second copy of SQLite in one process
breaks the locks of the first.
"""

import atexit
import faulthandler
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from eqt_cli.core.errors import EqtError, EqtWarning, Remedy
from eqt_cli.core.regular_files import content_of
from eqt_cli.core.reporting import reporter

FILE = "cache.db"

_REPORT = "crash-{}-{}.txt"
_MOST_BYTES = 1_000_000

_folder: Path | None = None
"""The watched folder."""


def watch(folder: Path) -> None:
    """Remove the compiled laws if a process that used them has crashed, and watch this process.

    Crashes are not recorded if Python already reports them elsewhere, or nothing can be written.
    """
    global _folder
    _folder = folder
    _give_up_after_a_crash(folder)
    if faulthandler.is_enabled():
        return
    path = folder / _REPORT.format(os.getpid(), secrets.token_hex(8))
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        report = path.open("x")
        faulthandler.enable(report, all_threads=False)
        atexit.register(_end, path)


@contextmanager
def damage_told() -> Iterator[None]:
    """Remove the file if LLVM rejects its content, and raise an error with the remedy."""
    try:
        yield
    except ValueError as error:
        if "object file" not in str(error) or _folder is None:
            raise
        _remove(_folder)
        raise EqtError(
            f"{_folder / FILE}: held damaged compiled laws, and is removed",
            Remedy("run the command again; it compiles them"),
        ) from error


def _end(path: Path) -> None:
    faulthandler.disable()
    with suppress(OSError):
        path.unlink()


def _give_up_after_a_crash(folder: Path) -> None:
    crashed = False
    for path in folder.glob(_REPORT.format("*", "*")):
        with suppress(OSError):
            said = content_of(path, _MOST_BYTES, follow=False)
            if said or not _lives(path):
                path.unlink()
            crashed = crashed or bool(said)
    if not crashed:
        return
    _remove(folder)
    reporter().remark(
        EqtWarning(
            f"{folder / FILE}: a process that used these compiled laws has crashed; they are "
            "removed and compiled again"
        )
    )


def _remove(folder: Path) -> None:
    for end in ("", "-wal", "-shm", "-journal"):
        with suppress(OSError):
            (folder / f"{FILE}{end}").unlink()


def _lives(path: Path) -> bool:
    """Return whether the process of an empty report may still be running."""
    if os.name != "posix":  # elsewhere, os.kill may end it
        return True
    number = path.name.split("-")[1]
    try:
        os.kill(int(number), 0)
    except (ValueError, ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    return True
