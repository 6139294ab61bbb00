"""The cache of compiled laws of a user: files in a folder that nobody else can write to.

They are loaded as code. A file has the digest of its content in its name, so that a damaged one is
not used.
"""

from __future__ import annotations

import hashlib
import os
import stat
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from eqt_cli.core.replacement import replace_file

KEPT = 200
"""Most files, of some 50 kB each; the least recently used are removed."""


@dataclass(frozen=True)
class Cache:
    """The files of a folder, each under a key."""

    folder: Path

    def find(self, key: str, ending: str) -> Path | None:
        """Return an intact file of this key, if there is one; a damaged one is removed."""
        for path in self.folder.glob(f"{_short(key)}-*{ending}"):
            with suppress(OSError):
                if path.name == _name(key, path.read_bytes(), ending):
                    os.utime(path)
                    return path
                path.unlink()
        return None

    def keep(self, key: str, ending: str, content: bytes) -> Path:
        """Keep a file; the least recently used others are removed.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        path = self.folder / _name(key, content, ending)
        replace_file(path, content)
        self._forget_the_oldest()
        return path

    def _forget_the_oldest(self) -> None:
        """Remove the least recently used files, including unfinished ones of killed processes."""
        used = []
        for path in self.folder.iterdir():
            with suppress(OSError):  # another process has removed it
                used.append((path.stat().st_mtime, path))
        for _, path in sorted(used)[:-KEPT]:
            with suppress(OSError):
                path.unlink()


def own_cache() -> Cache | None:
    """Return the cache of this user; None if there is none that only the user can write to."""
    with suppress(OSError, RuntimeError):  # RuntimeError: there is no home
        folder = _base() / "eqt" / "native"
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if os.name == "nt" or _is_private(folder.lstat()):
            return Cache(folder)
    return None


def _base() -> Path:
    """Return the folder of the user's caches."""
    if os.name == "nt":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    chosen = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return chosen if chosen.is_absolute() else Path.home() / ".cache"


def _is_private(found: os.stat_result) -> bool:
    """Return whether it is a folder of this user that no one else can write to."""
    shared = found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not shared


def digest(text: str) -> str:
    """Return the key of a text."""
    return hashlib.sha256(text.encode()).hexdigest()


def _short(key: str) -> str:
    return key[:32]


def _name(key: str, content: bytes, ending: str) -> str:
    return f"{_short(key)}-{hashlib.sha256(content).hexdigest()}{ending}"
