"""Finds, checks and removes the files and folders that eqt writes; a link is never one of them.

All other entries of a folder stay as they are. If an entry has one of eqt's names but is of another
kind, eqt refuses the folder before it changes anything.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from eqt_cli.core.errors import OTHER_FOLDER, EqtError, Remedy
from eqt_cli.core.files import (
    FILE,
    FOLDER,
    kind_in_words,
    name_to_be,
    read_record,
    refusals,
    replace_file,
    require_writable,
)

# Entries -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class OwnFile:
    """A pattern of files that eqt writes.

    Attributes
    ----------
    name
        Their names, as a regular expression.
    marked
        Whether others use such names, too, so that eqt's files are recognised by `is_eqts`.
    """

    name: str
    marked: bool = False


@dataclass(frozen=True)
class OwnFolder:
    """A pattern of folders in which eqt writes.

    Attributes
    ----------
    name
        Their names, as a regular expression.
    entries
        The files and folders of eqt within them.
    record
        The file that marks such a folder as eqt's; without one, every folder of this name is.
    """

    name: str
    entries: Sequence[Own] = ()
    record: str = ""


Own = OwnFile | OwnFolder


def kind_of(path: Path) -> str | None:
    """Return the kind of an entry in words, where a link is a link; None if there is no entry."""
    try:
        return kind_in_words(path.lstat().st_mode)
    except (FileNotFoundError, NotADirectoryError):
        return None


def check_kind(path: Path, expected: str) -> None:
    """Refuse an existing entry that is not of the expected kind, `FILE` or `FOLDER`.

    Raises
    ------
    EqtError
        With the kind of the entry, and what to do.
    """
    found = kind_of(path)
    if found not in (None, expected):
        raise foreign(path, found or "", expected)


def check_within(home: Path, path: Path) -> None:
    """Check a file in a folder, and all folders between; `home` itself may be a link."""
    below = path.relative_to(home).parts
    for count in range(1, len(below)):
        check_kind(home.joinpath(*below[:count]), FOLDER)
    check_kind(path, FILE)


def check_entries(folder: Path, own: Sequence[Own]) -> None:
    """Refuse a folder in which an entry has a name of eqt's but is of another kind.

    Names of marked files are skipped, because others may use them for anything.
    """
    for path, entry in _entries(folder, own):
        if isinstance(entry, OwnFolder):
            check_kind(path, FOLDER)
            check_entries(path, entry.entries)
        elif not entry.marked:
            check_kind(path, FILE)


def foreign(path: Path, found: str, expected: str) -> EqtError:
    """Return the error for an entry that is not eqt's at a place where eqt writes."""
    return EqtError(
        f"{path}: is {found}; expected {expected} that eqt wrote, or no such entry",
        Remedy("rename or remove it"),
    )


def remove_own(path: Path, own: Own) -> list[Path]:
    """Remove what eqt wrote, and nothing else; return the removed paths.

    If a folder also holds other entries, only eqt's entries in it are removed.
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
    """Remove unfinished files of eqt that killed processes left behind; return their paths."""
    files = [entry for entry in own if isinstance(entry, OwnFile)]
    left = list[Path]()
    for path in _listed(folder):
        name = name_to_be(path.name)
        if name and _pattern_of(name, files) and kind_of(path) == FILE:
            path.unlink()
            left.append(path)
        entry = _pattern_of(path.name, own)
        if isinstance(entry, OwnFolder) and kind_of(path) == FOLDER:
            left += remove_left_over(path, entry.entries)
    return left


def _has_record(path: Path) -> bool:
    return kind_of(path) == FILE and read_record(path, "digest") is not None


def _entries(folder: Path, own: Sequence[Own]) -> Iterator[tuple[Path, Own]]:
    """Yield the entries of a folder that have a name of eqt's, with the matching pattern."""
    for path in _listed(folder):
        if entry := _pattern_of(path.name, own):
            yield path, entry


def _pattern_of(name: str, own: Sequence[Own]) -> Own | None:
    return next((entry for entry in own if re.fullmatch(entry.name, name)), None)


def _listed(folder: Path) -> list[Path]:
    """Return the sorted entries of a folder; an empty list if there is no folder."""
    try:
        names = sorted(os.listdir(folder))  # noqa: PTH208  # faster for thousands of entries
        return [folder / name for name in names]
    except (FileNotFoundError, NotADirectoryError):
        return []


# Writing -----------------------------------------------------------------------------------------


def check_targets(paths: Iterable[Path], home: Path) -> None:
    """Refuse, before the work, to write where it would fail or replace what is not eqt's.

    Parameters
    ----------
    home
        Folder below which no link is followed.

    Raises
    ------
    EqtError
        If a path is a folder, a link or a file that eqt did not write, or its parent is no folder
        that can be written to.
    """
    for path in paths:
        with refusals(path, "written", OTHER_FOLDER):
            if path.is_dir():
                example = path / "report.html"
                raise EqtError(f"{path}: is a folder; expected a file, such as {example}")
            check_within(home, path)
            if path.exists() and not is_eqts(path):
                raise EqtError(
                    f"{path}: exists, and is no file that eqt wrote",
                    Remedy("choose another place with {}", "out"),
                )
            require_writable(path.parent)


def write_all(contents: Mapping[Path, bytes], home: Path) -> None:
    """Write each file atomically; missing folders are made.

    Parameters
    ----------
    home
        Folder below which no link is followed.

    Raises
    ------
    EqtError
        If a folder or file cannot be written, or would replace what eqt did not write.
    """
    check_targets(contents, home)
    for path, content in contents.items():
        with refusals(path, "written", OTHER_FOLDER):
            path.parent.mkdir(parents=True, exist_ok=True)
            replace_file(path, content)


# Marks -------------------------------------------------------------------------------------------

FOUND_BY = "# found by eqt {}\n"
"""The mark of a configuration that a command found."""

_HEAD = 4096
"""Number of bytes at the start of a file that are searched for a mark; a PDF file is searched
completely."""

_MARKS = (
    re.compile(rb'<!DOCTYPE html>.*?<meta name="generator" content="eqt ', re.DOTALL),
    re.compile(rb"<\?xml.*?<dc:title>eqt ", re.DOTALL),
    re.compile(rb"\x89PNG.*?Software\0eqt ", re.DOTALL),
    re.compile(rb"GIF8.*?!\xfe.eqt ", re.DOTALL),
    re.compile(rb'\[\n(\{"panel": |\n\])'),  # the numbers of a figure
    re.compile(rb"% caption by eqt: "),
    re.compile(rb"# found by eqt (tune|worst|fit)\n"),
    re.compile(rb"(/\* E|<!-- e)xported by eqt "),
)
_PDF, _PDF_MARK = b"%PDF", b"/Creator (eqt "


def is_eqts(path: Path) -> bool:
    """Whether eqt wrote a picture, its numbers or caption, a page, a configuration or a law.

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
    """Whether a mark is in the bytes that were read, or in the rest of the file."""
    while read:
        if mark in read:
            return True
        more = stream.read(2**20)
        read = read[-len(mark) :] + more if more else b""
    return False
