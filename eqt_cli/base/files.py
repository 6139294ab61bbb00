"""Names, opens, reads and replaces files; all of eqt opens and writes files here.

A name that a user, a configuration or a folder gives can lead to a named pipe without a writer, to
an endless device, or to a file that is larger than the memory. A file is written completely or not
at all, and never through a link.
"""

from __future__ import annotations

import errno
import io
import json
import mmap as mmap_module
import os
import re
import stat
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import islice
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any

from eqt_cli.base.errors import OTHER_FOLDER, EqtError, Remedy, closest

_DEVICE = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE | re.ASCII)
"""Names that Windows reserves for devices, with any suffix."""


def is_device(name: str) -> bool:
    """Whether a file of this name would be a device on Windows."""
    return _DEVICE.fullmatch(name) is not None


def file_name(text: str, otherwise: str) -> str:
    """Return a text as a file name, with a hyphen for each run of invalid characters.

    Parameters
    ----------
    otherwise
        The name where no valid character is left, and the prefix to the name of a device.
    """
    name = re.sub(r"[^A-Za-z0-9._-]+", "-", text).strip("-._") or otherwise
    return f"{otherwise}-{name}" if is_device(name) else name


RECORD_BYTES = 16 * 2**20
"""Largest record that eqt keeps in a folder, such as ``manifest.json``, bytes."""

TEXT_BYTES = 4_000_000
"""Largest text that a user writes, bytes: a configuration, a plugin, a style sheet, notes."""

FILE, FOLDER = "a file", "a folder"

_KINDS = (
    (stat.S_ISREG, FILE),
    (stat.S_ISDIR, FOLDER),
    (stat.S_ISLNK, "a symbolic link"),
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISSOCK, "a socket"),
)

_OPEN_FLAGS = (
    os.O_RDONLY
    | getattr(os, "O_NONBLOCK", 0)  # a pipe would wait for a writer
    | getattr(os, "O_NOCTTY", 0)
    | getattr(os, "O_CLOEXEC", 0)
    | getattr(os, "O_BINARY", 0)
)


def kind_in_words(mode: int) -> str:
    """Return the kind of a folder entry of this mode."""
    return next((kind for matches, kind in _KINDS if matches(mode)), "a device")


class NotRegularError(OSError):
    """Raised where an entry is no regular file."""


class TooLargeError(OSError):
    """Raised for a file that is larger than its kind may be.

    Attributes
    ----------
    size
        Size of the file, bytes; a lower bound where the system does not report the size.
    """

    def __init__(self, limit: int, size: int) -> None:
        super().__init__(errno.EFBIG, f"expected at most {limit:,} bytes, got {size:,}")
        self.size = size


def open_regular(path: Path, *, follow: bool = True) -> io.BufferedReader:
    """Open a file for reading, if it is a regular file.

    Parameters
    ----------
    follow
        Whether the file itself may be a symbolic link.

    Raises
    ------
    NotRegularError
        For a pipe, a device, a socket, and a link that is not followed.
    OSError
        If it cannot be opened, as for a folder.
    """
    # Check first, because opening a device may start an action.
    _require_regular(path.stat() if follow else path.lstat())
    handle = os.open(path, _OPEN_FLAGS | (0 if follow else getattr(os, "O_NOFOLLOW", 0)))
    try:
        _require_regular(os.fstat(handle))
        return os.fdopen(handle, "rb")
    except BaseException:
        os.close(handle)
        raise


def content_of(path: Path, limit: int, *, follow: bool = True) -> bytes:
    """Return the content of a regular file of at most `limit` bytes.

    Raises
    ------
    TooLargeError
        If the file is larger; where the system reports its size, before anything is read.
    OSError
        As by `open_regular`.
    """
    with open_regular(path, follow=follow) as stream:
        size = os.fstat(stream.fileno()).st_size
        if size > limit:
            raise TooLargeError(limit, size)
        content = stream.read((size or limit) + 1)  # some system files report a size of 0
    if len(content) > limit:
        raise TooLargeError(limit, len(content))
    return content


def text_in(path: Path, limit: int = TEXT_BYTES) -> str:
    """Return the text of a file, read by `content_of`, with line breaks as in Python.

    Raises
    ------
    UnicodeDecodeError
        If the file is not in UTF-8.
    """
    return content_of(path, limit).decode("utf-8").replace("\r\n", "\n").replace("\r", "\n")


def _require_regular(status: os.stat_result) -> None:
    if stat.S_ISREG(status.st_mode):
        return
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    kind = kind_in_words(status.st_mode)
    raise NotRegularError(errno.EINVAL, f"it is {kind}; expected a regular file")


NO_SPACE = {errno.ENOSPC, errno.EFBIG, getattr(errno, "EDQUOT", errno.ENOSPC)}
"""Error numbers of a full disk or an exceeded quota."""

_TEMPORARY = re.compile(r"(.+)\.[0-9a-f]{16}\.tmp")
"""The name of an unfinished file: the final name, and a random part."""


@contextmanager
def replacement(path: Path) -> Iterator[io.FileIO]:
    """Open a new file that replaces `path` when the block ends without an error.

    The file is written in the same folder under a random name that must not exist yet, so that no
    link can redirect it. Then it is flushed to the disk and renamed.
    """
    temporary = path.with_name(f"{path.name}.{os.urandom(8).hex()}.tmp")
    with io.FileIO(temporary, "x+") as file:
        try:
            yield file
            os.fsync(file.fileno())
            file.close()
            temporary.replace(path)
        except BaseException:
            with suppress(OSError):
                file.close()
            with suppress(OSError):
                temporary.unlink(missing_ok=True)
            raise
    _sync_folder(path.parent)


def replace_file(path: Path, content: bytes) -> None:
    """Write a file completely or not at all, even if the process or the machine stops."""
    with replacement(path) as file:
        write_whole(file, content)


def new_file(path: Path, content: bytes) -> None:
    """Write a file that must not exist yet; after an error, no file remains.

    Raises
    ------
    FileExistsError
        If there is an entry of this name, even a broken link.
    """
    with io.FileIO(path, "x") as file:
        try:
            write_whole(file, content)
            os.fsync(file.fileno())
        except BaseException:
            with suppress(OSError):
                path.unlink()
            raise


def name_to_be(name: str) -> str | None:
    """Return the final name of an unfinished file; None for any other file."""
    match = _TEMPORARY.fullmatch(name)
    return match[1] if match else None


def write_whole(file: io.FileIO, content: bytes | memoryview) -> None:
    """Write all of the content, in several calls where the system takes less at a time."""
    rest = memoryview(content)
    while rest:
        rest = rest[file.write(rest) :]


def _sync_folder(folder: Path) -> None:
    """Flush a rename to the disk, where the system and the disk support it."""
    if os.name != "posix":
        return
    with suppress(PermissionError):  # a folder may be writable, but not readable
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        except OSError as error:
            if error.errno not in (errno.EINVAL, errno.ENOTSUP):
                raise
        finally:
            os.close(handle)


SEAL = b"\neqt CRC-32 "
"""Stands behind the bytes of a file, before their checksum: 4 bytes, the lowest first."""

DROP = getattr(mmap_module, "MADV_DONTNEED", None)

CHECKSUM = "checksum"
"""Key of a record with the CRC-32 of its other keys, in hexadecimal digits."""


def seal(file: io.FileIO) -> None:
    """Append the checksum of all bytes of a file."""
    file.seek(0)
    checksum = 0
    while read := file.read(2**20):  # not mapped: that would count as memory of this process
        checksum = zlib.crc32(read, checksum)
    write_whole(file, SEAL + checksum.to_bytes(4, "little"))


def is_intact(view: mmap) -> bool | None:
    """Return whether the bytes of a file are those that were written; None without a checksum."""
    end = len(view) - len(SEAL) - 4
    if end < 0 or view[end:-4] != SEAL:
        return None
    checksum = 0
    with memoryview(view) as whole:  # whose parts are no copies
        for start in range(0, end, 2**24):
            checksum = zlib.crc32(whole[start : min(start + 2**24, end)], checksum)
            if DROP is not None:  # what was read need not stay in the memory of this process
                view.madvise(DROP, start, min(2**24, len(view) - start))
    return checksum == int.from_bytes(view[-4:], "little")


def checksum_of(path: Path) -> str:
    """Return the checksum at the end of a result file, in hexadecimal digits."""
    with open_regular(path) as stream:
        stream.seek(-4, os.SEEK_END)
        return stream.read()[::-1].hex()


def is_intact_file(path: Path) -> bool | None:
    """Return whether a result file or record is as it was written; None without a checksum."""
    if path.suffix != ".json":
        with open_regular(path) as stream, mmap(stream.fileno(), 0, access=ACCESS_READ) as view:
            return is_intact(view)
    try:
        record = json.loads(content_of(path, RECORD_BYTES))
        return None if CHECKSUM not in record else read_record(path) is not None
    except (OSError, ValueError):
        return False


def write_record(path: Path, record: dict[str, Any]) -> None:
    """Write the record of a folder and its checksum, completely or not at all."""
    sealed = record | {CHECKSUM: f"{zlib.crc32(json.dumps(record).encode()):08x}"}
    text = json.dumps(sealed, indent=2, ensure_ascii=False) + "\n"
    replace_file(path, text.encode())


def read_record(path: Path, *keys: str) -> dict[str, Any] | None:
    """Return a record of `write_record`; None where there is none, or where a key is missing."""
    try:
        record = json.loads(content_of(path, RECORD_BYTES, follow=False))
    except (NotRegularError, TooLargeError) as error:  # callers name only the folder
        raise OSError(error.errno, f"{path.name}: {error.strerror}") from error
    except (FileNotFoundError, ValueError, RecursionError):
        return None
    if not isinstance(record, dict):
        return None
    checksum = record.pop(CHECKSUM, None)
    if checksum not in (None, f"{zlib.crc32(json.dumps(record).encode()):08x}"):
        raise OSError(errno.EIO, f"{path.name} is damaged: its checksum differs; restore a copy")
    return record if set(keys) <= set(record) else None


@contextmanager
def refusals(
    subject: object, action: str, remedy: Remedy | str = "", kind: type[EqtError] = EqtError
) -> Iterator[None]:
    """Turn errors of the system into ``x.yaml: cannot be read: permission denied; check …``.

    Parameters
    ----------
    action
        The participle of what the block does: ``"read"``.
    remedy
        Advice for the user.
    kind
        The error to raise in place of the system's.
    """
    try:
        yield
    except (OSError, ValueError) as error:  # ValueError: not UTF-8, or a name with a null byte
        reason = "it is not text in UTF-8" if isinstance(error, UnicodeError) else str(error)
        if isinstance(error, OSError):
            reason = error.strerror or str(error)
        advice = Remedy(remedy) if isinstance(remedy, str) else remedy
        reason = reason[:1].lower() + reason[1:]
        raise kind(f"{subject}: cannot be {action}: {reason}", advice) from error


YAML = (".yaml", ".yml")
"""Suffixes of configurations, to distinguish them from results."""

MAX_LISTED = 1000
"""Largest number of folder entries to compare with a missing name."""


def near(path: Path, fits: Callable[[Path], bool]) -> str:
    """Return `; did you mean 'results/sat'?` for the entry whose name is closest to a missing one.

    The folder of the missing path and ``results`` are searched.

    Parameters
    ----------
    fits
        Whether an entry may be suggested.
    """
    entries: dict[str, Path] = {}
    for folder in dict.fromkeys((path.parent, Path("results"))):
        with suppress(OSError):
            for entry in filter(fits, islice(folder.iterdir(), MAX_LISTED)):
                entries.setdefault(entry.stem, entry)
    name = closest(path.stem, entries)
    return f"; did you mean '{entries[name]}'?" if name else ""


def text_of(
    path: Path,
    missing: str,
    kind: type[EqtError] = EqtError,
    subject: object = None,
    limit: int = TEXT_BYTES,
    smaller: str = "",
    read: Callable[[Path, int], str] = text_in,
) -> str:
    """Return the text of a file that a user names, of at most `limit` bytes.

    Raises
    ------
    EqtError
        Of this kind, if the file cannot be read; `missing` is the advice for a missing file, and
        `smaller` that for one that is too large.
    """
    with refusals(subject or path, "read", kind=kind):
        try:
            return read(path, limit)
        except FileNotFoundError:
            raise kind(f"{path}: not found; {missing}") from None
        except TooLargeError as error:
            if not smaller:
                raise
            message = f"{subject or path}: cannot be read: {error.strerror}"
            raise kind(f"{message}; {smaller}") from error


# Entries -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class FilePattern:
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
class FolderPattern:
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
    entries: Sequence[Entry] = ()
    record: str = ""


Entry = FilePattern | FolderPattern


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
    kind = kind_of(path)
    if kind not in (None, expected):
        raise foreign(path, kind or "", expected)


def check_entries(folder: Path, patterns: Sequence[Entry]) -> None:
    """Refuse a folder in which an entry has a name of eqt's but is of another kind.

    Names of marked files are skipped, because others may use them for anything.
    """
    for path, entry in _entries(folder, patterns):
        if isinstance(entry, FolderPattern):
            check_kind(path, FOLDER)
            check_entries(path, entry.entries)
        elif not entry.marked:
            check_kind(path, FILE)


def foreign(path: Path, kind: str, expected: str) -> EqtError:
    """Return the error for an entry that is not eqt's at a place where eqt writes."""
    return EqtError(
        f"{path}: is {kind}; expected {expected} that eqt wrote, or no such entry",
        Remedy("rename or remove it"),
    )


def remove_written(path: Path, pattern: Entry) -> list[Path]:
    """Remove what eqt wrote, and nothing else; return the removed paths.

    If a folder also holds other entries, only eqt's entries in it are removed.
    """
    if isinstance(pattern, FilePattern):
        if kind_of(path) != FILE or (pattern.marked and not is_eqts(path)):
            return []
        path.unlink()
        return [path]
    if kind_of(path) != FOLDER:
        return []
    record = path / pattern.record  # the folder itself, if it needs none
    if pattern.record and (kind_of(record) != FILE or read_record(record, "digest") is None):
        return []
    removed = remove_left_over(path, pattern.entries)
    for inner, entry in _entries(path, pattern.entries):
        removed += remove_written(inner, entry)
    if any(path.iterdir()):
        return removed
    path.rmdir()
    return [path]


def remove_left_over(folder: Path, patterns: Sequence[Entry]) -> list[Path]:
    """Remove unfinished files of eqt that killed processes left behind; return their paths."""
    files = [entry for entry in patterns if isinstance(entry, FilePattern)]
    removed = list[Path]()
    for path in _listed(folder):
        name = name_to_be(path.name)
        if name and _pattern_of(name, files) and kind_of(path) == FILE:
            path.unlink()
            removed.append(path)
        entry = _pattern_of(path.name, patterns)
        if isinstance(entry, FolderPattern) and kind_of(path) == FOLDER:
            removed += remove_left_over(path, entry.entries)
    return removed


def _entries(folder: Path, patterns: Sequence[Entry]) -> Iterator[tuple[Path, Entry]]:
    """Yield the entries of a folder that have a name of eqt's, with the matching pattern."""
    for path in _listed(folder):
        if entry := _pattern_of(path.name, patterns):
            yield path, entry


def _pattern_of(name: str, patterns: Sequence[Entry]) -> Entry | None:
    return next((entry for entry in patterns if re.fullmatch(entry.name, name)), None)


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
            for parent in reversed(path.relative_to(home).parents):
                if parent != Path():  # `home` itself may be a link
                    check_kind(home / parent, FOLDER)
            check_kind(path, FILE)
            if path.exists() and not is_eqts(path):
                raise EqtError(
                    f"{path}: exists, but eqt did not write it",
                    Remedy("choose another place with {}", "out"),
                )
            existing = next(folder for folder in path.absolute().parents if folder.exists())
            if not existing.is_dir():
                raise NotADirectoryError("not a directory")
            if not os.access(existing, os.W_OK | os.X_OK):
                raise PermissionError("permission denied")


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
            remove_left_over(path.parent, [FilePattern(re.escape(path.name))])
            replace_file(path, content)


# Marks -------------------------------------------------------------------------------------------

CONFIG_MARK = "# found by eqt {}\n"
"""The mark of a configuration that a search or a fit wrote."""

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
    re.compile(rb"II\*\0.*?eqt \d", re.DOTALL),
    re.compile(rb"# found by eqt (tune|worst|fit|log)\n"),
    re.compile(rb"(/\* E|<!-- e)xported by eqt "),
)
_PDF_MARK = b"/Creator (eqt "


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
        block = stream.read(_HEAD)
        if block.startswith(b"II*"):  # TIFF, whose tags stand behind the picture
            stream.seek(-min(_HEAD, stream.seek(0, os.SEEK_END)), os.SEEK_END)
            block += stream.read()
        if not block.startswith(b"%PDF"):
            return any(mark.match(block) for mark in _MARKS)
        # In blocks: a mapped file that another process shortens would kill this one.
        while _PDF_MARK not in block:
            more = stream.read(2**20)
            if not more:
                return False
            block = block[-len(_PDF_MARK) :] + more
    return True


# Names in a result folder -------------------------------------------------------------------------

FILE_NAME, FIGURES, REPORT = "results.h5", "figures", "report.html"
"""Names in a result folder: of the result file, of the folder of pictures, and of the report."""

SHAPES = "shapes"
"""The folder beside a result whose points differ in shape, with a result for each shape; and the
attribute of that result with their checksums."""


def shape_file(folder: Path, shape: int) -> Path:
    """Return the result file of the points of one shape."""
    return folder / SHAPES / f"{shape}.h5"
