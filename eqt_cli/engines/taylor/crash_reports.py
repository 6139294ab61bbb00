"""Compiled laws on disk are given up after a process that used them has crashed.

heyoka executes what it finds in its file. Of a file that a failing disk has damaged, that ends the
process by a signal (SIGSEGV, SIGILL, SIGBUS) without a word. Python's `faulthandler` writes down
such an end. The file itself is not looked into: it is a database that heyoka has open, and a second
copy of SQLite in one process breaks the locks of the first.
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
"""The one that is watched."""


def watch(folder: Path) -> None:
    """Remove the compiled laws if a process that used them has crashed, and watch this one.

    Where Python already reports crashes elsewhere, or nothing can be written, none is noted.
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
    """Say what to do where LLVM refuses what it finds in the file; it is removed."""
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
    """Whether the process of a report that says nothing may still be there."""
    if os.name != "posix":  # elsewhere, asking may end it
        return True
    number = path.name.split("-")[1]
    try:
        os.kill(int(number), 0)
    except (ValueError, ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    return True
