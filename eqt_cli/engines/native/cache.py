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
from functools import lru_cache
from pathlib import Path

from eqt_cli.core.errors import EqtWarning, Remedy
from eqt_cli.core.files import open_regular, replace_file
from eqt_cli.core.reporting import reporter

MOST_BYTES = 2**28
"""Largest file of a law, bytes."""

KEPT = 200
"""Most files, of some 50 kB each; the least recently used are removed."""


@dataclass(frozen=True)
class Cache:
    """The files of a folder, each under a key."""

    folder: Path

    def find(self, key: str, ending: str) -> bytes | None:
        """Return an intact file of this key, if there is one; anything else is removed.

        What is returned is what was checked: nobody reads the file a second time.
        """
        for path in self.folder.glob(f"{_short(key)}-*{ending}"):
            with suppress(OSError):
                content = _own_content(path)
                if content is not None and path.name == _name(key, content, ending):
                    return content
                path.unlink()
        return None

    def keep(self, key: str, ending: str, content: bytes) -> None:
        """Keep a file; the least recently used others are removed.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        path = self.folder / _name(key, content, ending)
        replace_file(path, content)
        path.chmod(0o600)  # whatever the umask lets others write to
        self._forget_the_oldest()

    def _forget_the_oldest(self) -> None:
        """Remove the least recently used files, including unfinished ones of killed processes."""
        used = []
        for path in self.folder.iterdir():
            with suppress(OSError):  # another process has removed it
                used.append((path.lstat().st_mtime, path))
        for _, path in sorted(used)[:-KEPT]:
            with suppress(OSError):
                path.unlink()


def _own_content(path: Path) -> bytes | None:
    """Return the content of a file that only this user can write to, and mark it as used."""
    with suppress(OSError), open_regular(path, follow=False) as stream:
        found = os.fstat(stream.fileno())
        if (os.name == "nt" or _is_private(found)) and found.st_size <= MOST_BYTES:
            os.utime(path)
            return stream.read(MOST_BYTES)
    return None


def own_cache() -> Cache | None:
    """Return the cache of this user; None if there is none that only the user can write to."""
    with suppress(OSError, RuntimeError):  # RuntimeError: there is no home
        folder = caches_of_user() / "eqt" / "native"
        folder.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
        if os.name == "nt":
            return Cache(folder)
        found, place = folder.lstat(), folder.resolve()
        if stat.S_ISDIR(found.st_mode) and _is_private(found):
            unsafe = next((each for each in place.parents if not _is_safe(each.stat())), None)
            if unsafe is None:
                return Cache(place)
            _tell(unsafe)
    return None


@lru_cache(maxsize=8)
def _tell(folder: Path) -> None:
    reporter().remark(
        EqtWarning(
            f"compiled laws are not kept: other users can replace what is in {folder}",
            Remedy("remove their permission to write to it, or set XDG_CACHE_HOME to another one"),
        )
    )


def caches_of_user() -> Path:
    """Return the folder of the user's caches."""
    if os.name == "nt":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    chosen = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return chosen if chosen.is_absolute() else Path.home() / ".cache"


def _is_private(found: os.stat_result) -> bool:
    """Return whether it is this user's, and no one else can write to it."""
    return found.st_uid == os.getuid() and not found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _is_safe(found: os.stat_result) -> bool:
    """Return whether nobody but this user and the system can replace what is in a folder.

    As ssh asks of the folders above a key. With its sticky bit, as /tmp, a folder lets others
    replace only what is theirs.
    """
    shared = found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return found.st_uid in (0, os.getuid()) and (not shared or bool(found.st_mode & stat.S_ISVTX))


def digest(text: str) -> str:
    """Return the key of a text."""
    return hashlib.sha256(text.encode()).hexdigest()


def _short(key: str) -> str:
    return key[:32]


def _name(key: str, content: bytes, ending: str) -> str:
    return f"{_short(key)}-{hashlib.sha256(content).hexdigest()}{ending}"
