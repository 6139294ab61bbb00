"""Records the origin of a result: versions, machine, commit. Nothing here affects numbers."""

from __future__ import annotations

import os
import platform
import re
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path
from typing import Any

from eqt_cli.core.files import content_of
from eqt_cli.core.version import __version__


@contextmanager
def timed(seconds: dict[str, float], name: str) -> Iterator[None]:
    """Record the wall time of the block under a name, s."""
    started = time.perf_counter()
    yield
    seconds[name] = round(time.perf_counter() - started, 3)


_HASH = re.compile(r"[0-9a-f]{40}(?:[0-9a-f]{24})?")
_REFERENCE = re.compile(r"ref: (refs/[^\s\\:?*\[~^]+)")

_POINTER_BYTES = 4096
"""Largest size of ``HEAD``, a reference, or a file with the path of the repository."""

_PACKED_BYTES = 64_000_000
"""Largest size of ``packed-refs``: about a million references."""


def commit_of(folder: Path) -> str | None:
    """Return the commit checked out in the repository of a folder; None if it is unknown."""
    try:
        start = folder.resolve()
        each = (_repository(around / ".git") for around in (start, *start.parents))
        found = next(filter(None, each), None)
        return _head(*found) if found else None
    except (OSError, ValueError, RuntimeError):  # `RuntimeError`: links in a circle
        return None


def _repository(entry: Path) -> tuple[Path, Path] | None:
    """Return the folders of ``HEAD`` and of the references; None if this is no repository.

    They differ in a worktree, whose `.git` is a file with the path of the repository.
    """
    if entry.is_symlink():
        return None
    if entry.is_file():
        word, _, path = _line(entry).partition(": ")
        if word != "gitdir":
            return None
        entry = (entry.parent / path).resolve()
    if not (entry / "HEAD").is_file():
        return None
    common = entry / "commondir"
    return entry, (entry / _line(common)).resolve() if common.is_file() else entry


def _head(own: Path, common: Path) -> str | None:
    head = _line(own / "HEAD")
    reference = _REFERENCE.fullmatch(head)
    if reference is None:
        return _hash(head)
    name = reference[1]
    for place in (own, common):
        path = place / name
        if path.is_file() and path.resolve().is_relative_to(place.resolve()):
            return _hash(_line(path))
    return _packed(common / "packed-refs", name)


def _packed(path: Path, name: str) -> str | None:
    text = content_of(path, _PACKED_BYTES, follow=False).decode()
    found = re.search(rf"^([0-9a-f]+) {re.escape(name)}$", text, re.MULTILINE)
    return _hash(found[1]) if found else None


def _line(path: Path) -> str:
    """Return the line of a small file."""
    return content_of(path, _POINTER_BYTES, follow=False).decode().rstrip("\n")


def _hash(text: str) -> str | None:
    return text if _HASH.fullmatch(text) else None


PACKAGES = ("numpy", "scipy", "h5py")

NUMERIC = ("eqt", "numpy", "scipy", "machine")
"""Entries on which the last bits of a number can depend."""

VERSIONS = ("eqt", "python", "numpy", "scipy")
"""Entries that a summary shows."""

OTHERS = "other_sessions"
"""Entry for other sessions that computed some of the runs and differ in `NUMERIC`."""


def provenance(folder: Path, tools: Mapping[str, str]) -> dict[str, Any]:
    """Describe this machine, the tools of the engine, and the session of a configuration."""
    return {
        "eqt": __version__,
        "python": platform.python_version(),
        **{name: import_module(name).__version__ for name in PACKAGES},
        "platform": platform.platform(),
        "machine": platform.machine(),
        **tools,
        "cpu_count": os.cpu_count(),
        "command": " ".join(["eqt", *sys.argv[1:]]),
        "started": now(),
        "git": commit_of(folder),
    }


def now() -> str:
    """Return the current time, ISO 8601."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def together(origin: dict[str, Any], other: dict[str, Any]) -> dict[str, Any]:
    """Return `origin` with the sessions of both that differ from it in `NUMERIC`."""
    known = {_numeric(origin): origin}
    for entry in [*origin.get(OTHERS, ()), *other.get(OTHERS, ()), other]:
        known.setdefault(_numeric(entry), {k: v for k, v in entry.items() if k != OTHERS})
    _, *differing = known.values()
    plain = {key: value for key, value in origin.items() if key != OTHERS}
    return plain | ({OTHERS: differing} if differing else {})


def differences(other: dict[str, Any], origin: dict[str, Any]) -> str:
    """Describe the differences of a session from this one, as ``numpy 2.0.0 (not 2.4.6)``."""
    return ", ".join(
        f"{name} {other.get(name, 'none')} (not {origin.get(name, 'none')})"
        for name in NUMERIC
        if other.get(name) != origin.get(name)
    )


def _numeric(origin: dict[str, Any]) -> tuple[Any, ...]:
    return tuple(origin.get(name) for name in NUMERIC)
