"""Reads the commit of the repository that contains a folder from the files of `.git`.

Git itself is not run, because it executes what a repository configures (`core.fsmonitor`, filters,
hooks), and the folder may come from someone else. Only small regular files within the repository
are read, and a line that is not a hash is ignored.
"""

import re
from pathlib import Path

from eqt_cli.core.regular_files import content_of

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
