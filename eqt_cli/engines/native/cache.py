"""The compiled laws that a user keeps: files in a folder that nobody else can write to.

What is in it is loaded as code. A file has the digest of its content in its name, so that a damaged
one is not used.
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
"""Files, of some 50 kB each; those that were not used for longest go."""


@dataclass(frozen=True)
class Cache:
    """The files of a folder, each under a key."""

    folder: Path

    def find(self, key: str, ending: str) -> Path | None:
        """A whole file of this key; a damaged one is removed."""
        for path in self.folder.glob(f"{_short(key)}-*{ending}"):
            with suppress(OSError):
                if path.name == _name(key, path.read_bytes(), ending):
                    os.utime(path)
                    return path
                path.unlink()
        return None

    def keep(self, key: str, ending: str, content: bytes) -> Path:
        """Keep a file; others that were not used for long are removed.

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
        """Also what killed processes have left unfinished: nobody uses that."""
        used = []
        for path in self.folder.iterdir():
            with suppress(OSError):  # another process has removed it
                used.append((path.stat().st_mtime, path))
        for _, path in sorted(used)[:-KEPT]:
            with suppress(OSError):
                path.unlink()


def own_cache() -> Cache | None:
    """The cache of this user; None where there is none that is the user's alone."""
    with suppress(OSError, RuntimeError):  # RuntimeError: there is no home
        folder = _base() / "eqt" / "native"
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if os.name == "nt" or _is_private(folder.lstat()):
            return Cache(folder)
    return None


def _base() -> Path:
    """Where users keep what can be made anew."""
    if os.name == "nt":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    chosen = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return chosen if chosen.is_absolute() else Path.home() / ".cache"


def _is_private(found: os.stat_result) -> bool:
    """Whether it is a folder of this user's that no one else can write to."""
    shared = found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not shared


def digest(text: str) -> str:
    """A key."""
    return hashlib.sha256(text.encode()).hexdigest()


def _short(key: str) -> str:
    return key[:32]


def _name(key: str, content: bytes, ending: str) -> str:
    return f"{_short(key)}-{hashlib.sha256(content).hexdigest()}{ending}"
