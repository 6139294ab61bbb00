"""Finds damage in the file where heyoka keeps compiled laws, before a process executes them.

heyoka executes what it finds there. Of a damaged disk or a copy that was cut short, that ends the
process by a signal (SIGSEGV, SIGILL) without a word.
"""

import sqlite3
import warnings
import zlib
from contextlib import closing, suppress
from pathlib import Path

from eqt_cli.core.errors import EqtWarning

FILE = "cache.db"

_WAIT = 5.0
"""s for another process that writes to the file."""

_KEPT = "bitcode, opt_bc, opt_ir, obj"


def check(folder: Path) -> None:
    """Remove what is damaged, so that it is compiled again, and note the rest for the next time.

    A sum is kept of each law, in the same file; damage before its first check is not found.
    """
    file = folder / FILE
    if not file.is_file():
        return
    try:
        damaged = _discarded(file)
    except sqlite3.OperationalError:  # not to be written to, or busy, or of another heyoka
        return
    except sqlite3.DatabaseError:
        with suppress(OSError):
            for each in (
                file,
                *(file.with_name(FILE + end) for end in ("-wal", "-shm", "-journal")),
            ):
                each.unlink(missing_ok=True)
        damaged = 1
    if damaged:
        warnings.warn(
            EqtWarning(f"{file}: held compiled laws that were damaged; they are compiled again"),
            stacklevel=2,
        )


def _discarded(file: Path) -> int:
    """How many laws were damaged, and are not in the file any more."""
    with closing(sqlite3.connect(file, timeout=_WAIT)) as data, data:
        if data.execute("PRAGMA quick_check(1)").fetchone() != ("ok",):
            raise sqlite3.DatabaseError
        data.execute("CREATE TABLE IF NOT EXISTS eqt_sums (hash INTEGER PRIMARY KEY, sum INTEGER)")
        known = dict(data.execute("SELECT hash, sum FROM eqt_sums"))
        found = {
            key: _sum(parts) for key, *parts in data.execute(f"SELECT hash, {_KEPT} FROM cache")
        }
        damaged = [key for key, own in found.items() if known.get(key, own) != own]
        for key in damaged:
            data.execute(
                "UPDATE config SET value = value - (SELECT size FROM cache WHERE hash = ?) "
                "WHERE key = 'total_size'",
                [key],
            )
            data.execute("DELETE FROM cache WHERE hash = ?", [key])
        for key in [*(known.keys() - found.keys()), *damaged]:
            data.execute("DELETE FROM eqt_sums WHERE hash = ?", [key])
        new = [pair for pair in found.items() if pair[0] not in known]
        data.executemany("INSERT INTO eqt_sums VALUES (?, ?)", new)
        return len(damaged)


def _sum(parts: list[bytes]) -> int:
    found = 0
    for part in parts:
        found = zlib.crc32(part, found)
    return found
