"""What eqt owns in a folder: regular files and folders of certain names, and never a link.

Everything else is somebody's, and stays as it is. Where an entry of such a name is no file, or no
folder, eqt refuses to work there before it changes anything.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from eqt_cli.core.errors import EqtError, Remedy
from eqt_cli.core.files import read_record
from eqt_cli.core.regular_files import FILE, FOLDER, kind_in_words
from eqt_cli.core.replacement import name_to_be

# Entries -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class OwnFile:
    """Files that eqt writes.

    Attributes
    ----------
    name
        What they are called, as a regular expression.
    marked
        Others use such names, too; eqt's hold its mark, as `is_eqts` finds it.
    """

    name: str
    marked: bool = False


@dataclass(frozen=True)
class OwnFolder:
    """Folders in which eqt writes.

    Attributes
    ----------
    name
        What they are called, as a regular expression.
    entries
        What is eqt's in them.
    record
        The file that says that such a folder is eqt's; without a name, each is.
    """

    name: str
    entries: Sequence[Own] = ()
    record: str = ""


Own = OwnFile | OwnFolder


def kind_of(path: Path) -> str | None:
    """What an entry of a folder is by itself, in words; None where there is none."""
    try:
        return kind_in_words(path.lstat().st_mode)
    except (FileNotFoundError, NotADirectoryError):
        return None


def check_kind(path: Path, expected: str) -> None:
    """Refuse an entry that is there and no `FILE`, or no `FOLDER`, of its own.

    Raises
    ------
    EqtError
        With what it is, and what to do.
    """
    found = kind_of(path)
    if found not in (None, expected):
        raise foreign(path, found or "", expected)


def check_within(home: Path, path: Path) -> None:
    """The same for a file in a folder, and for the folders between; `home` itself may be a link."""
    below = path.relative_to(home).parts
    for count in range(1, len(below)):
        check_kind(home.joinpath(*below[:count]), FOLDER)
    check_kind(path, FILE)


def check_entries(folder: Path, own: Sequence[Own]) -> None:
    """Refuse a folder in which an entry has a name of eqt's and is no file, or no folder.

    Files that are told by their marks are left out: what is no file has no mark.
    """
    for path, entry in _entries(folder, own):
        if isinstance(entry, OwnFolder):
            check_kind(path, FOLDER)
            check_entries(path, entry.entries)
        elif not entry.marked:
            check_kind(path, FILE)


def foreign(path: Path, found: str, expected: str) -> EqtError:
    """The refusal of an entry where eqt writes."""
    return EqtError(
        f"{path}: is {found}; expected {expected} that eqt wrote, or no such entry",
        Remedy("rename or remove it"),
    )


def remove_own(path: Path, own: Own) -> list[Path]:
    """Remove what eqt wrote, and nothing else; returns what is gone.

    That is the path itself, or, where a folder holds something else too, what was removed of it.
    """
    if isinstance(own, OwnFile):
        if kind_of(path) != FILE or (own.marked and not is_eqts(path)):
            return []
        path.unlink()
        return [path]
    if kind_of(path) != FOLDER or (own.record and not _has_record(path / own.record)):
        return []
    gone = remove_left_over(path, own.entries)
    for inner, entry in _entries(path, own.entries):
        gone += remove_own(inner, entry)
    if any(path.iterdir()):
        return gone
    path.rmdir()
    return [path]


def remove_left_over(folder: Path, own: Sequence[Own]) -> list[Path]:
    """Remove unfinished files that killed processes left of what is eqt's; returns them."""
    files = [entry for entry in own if isinstance(entry, OwnFile)]
    left = list[Path]()
    for path in _listed(folder):
        name = name_to_be(path.name)
        if name and _owner(name, files) and kind_of(path) == FILE:
            path.unlink()
            left.append(path)
        entry = _owner(path.name, own)
        if isinstance(entry, OwnFolder) and kind_of(path) == FOLDER:
            left += remove_left_over(path, entry.entries)
    return left


def _has_record(path: Path) -> bool:
    return kind_of(path) == FILE and read_record(path, "digest") is not None


def _entries(folder: Path, own: Sequence[Own]) -> Iterator[tuple[Path, Own]]:
    """The entries of a folder that have a name of eqt's, with what they are to be."""
    for path in _listed(folder):
        if entry := _owner(path.name, own):
            yield path, entry


def _owner(name: str, own: Sequence[Own]) -> Own | None:
    return next((entry for entry in own if re.fullmatch(entry.name, name)), None)


def _listed(folder: Path) -> list[Path]:
    """The entries of a folder in their order; none of what is no folder."""
    try:
        names = sorted(os.listdir(folder))  # noqa: PTH208  # thousands, quickly
        return [folder / name for name in names]
    except (FileNotFoundError, NotADirectoryError):
        return []


# Marks -------------------------------------------------------------------------------------------

FOUND_BY = "# found by eqt {}\n"
"""The mark of a configuration, with the command that searched."""

_HEAD = 4096
"""Bytes at the start of a file in which its mark stands; in a PDF file it may stand anywhere."""

_MARKS = (
    re.compile(rb'<!DOCTYPE html>.*?<meta name="generator" content="eqt ', re.DOTALL),
    re.compile(rb"<\?xml.*?<dc:title>eqt ", re.DOTALL),
    re.compile(rb"\x89PNG.*?Software\0eqt ", re.DOTALL),
    re.compile(rb"GIF8.*?!\xfe.eqt ", re.DOTALL),
    re.compile(rb'\[\n(\{"panel": |\n\])'),  # the numbers of a figure
    re.compile(rb"# found by eqt (tune|worst|fit)\n"),
    re.compile(rb"(/\* E|<!-- e)xported by eqt "),
)
_PDF, _PDF_MARK = b"%PDF", b"/Creator (eqt "


def is_eqts(path: Path) -> bool:
    """Whether a file is a picture, a page, the numbers of a figure or a law that eqt has written.

    Raises
    ------
    OSError
        If it cannot be read.
    """
    if kind_of(path) != FILE:
        return False
    with path.open("rb") as stream:
        head = stream.read(_HEAD)
        if head.startswith(_PDF):
            return _holds(stream, head, _PDF_MARK)
    return any(mark.match(head) for mark in _MARKS)


def _holds(stream: BinaryIO, read: bytes, mark: bytes) -> bool:
    """Whether a mark is in what was read of a file, or in the rest of it."""
    while read:
        if mark in read:
            return True
        more = stream.read(2**20)
        read = read[-len(mark) :] + more if more else b""
    return False
