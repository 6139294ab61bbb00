"""The commit of the repository that a folder lies in, from the files of `.git` alone.

The folder may be a colleague's, and git runs what a repository configures (`core.fsmonitor`,
filters, hooks): so git is not run. Every file is regular, small, and within the repository; a line
that is no hash is nothing.
"""

import re
from pathlib import Path

from eqt_cli.core.regular_files import content_of

_HASH = re.compile(r"[0-9a-f]{40}(?:[0-9a-f]{24})?")
_REFERENCE = re.compile(r"ref: (refs/[^\s\\:?*\[~^]+)")

_POINTER_BYTES = 4096
"""The most of ``HEAD``, a reference, or a file that says where the repository is."""

_PACKED_BYTES = 64_000_000
"""The most of ``packed-refs``; a repository with a million references has about so much."""


def commit_of(folder: Path) -> str | None:
    """The commit that is checked out around a folder; None where none can be told."""
    try:
        start = folder.resolve()
        each = (_repository(around / ".git") for around in (start, *start.parents))
        found = next(filter(None, each), None)
        return _head(*found) if found else None
    except (OSError, ValueError, RuntimeError):  # the last of links in a circle
        return None


def _repository(entry: Path) -> tuple[Path, Path] | None:
    """Where ``HEAD`` and the references are; None where the entry is no repository.

    They differ in a worktree, whose `.git` is a file that leads to the repository.
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
    """The one line of a small file."""
    return content_of(path, _POINTER_BYTES, follow=False).decode().rstrip("\n")


def _hash(text: str) -> str | None:
    return text if _HASH.fullmatch(text) else None
