"""Reads small files and records, and turns errors of the system into messages."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from difflib import get_close_matches
from itertools import islice
from pathlib import Path
from typing import Any

from eqt_cli.core.errors import EqtError, Remedy
from eqt_cli.core.regular_files import (
    RECORD_BYTES,
    TEXT_BYTES,
    NotRegularError,
    TooLargeError,
    content_of,
    text_in,
)
from eqt_cli.core.replacement import replace_file


def write_record(path: Path, record: dict[str, Any]) -> None:
    """Write the record of a folder, completely or not at all."""
    text = json.dumps(record, indent=2, ensure_ascii=False) + "\n"
    replace_file(path, text.encode())


def read_record(path: Path, *keys: str) -> dict[str, Any] | None:
    """Return a record of `write_record`; None where there is none, or where a key is missing."""
    try:
        with _named(path):
            record = json.loads(content_of(path, RECORD_BYTES, follow=False))
    except (FileNotFoundError, ValueError, RecursionError):
        return None
    return record if isinstance(record, dict) and set(keys) <= set(record) else None


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Add the name of the file to errors, because callers name only its folder."""
    try:
        yield
    except (NotRegularError, TooLargeError) as error:
        raise OSError(error.errno, f"{path.name}: {error.strerror}") from error


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
        reason = "it is no text in UTF-8" if isinstance(error, UnicodeError) else str(error)
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
    found: dict[str, Path] = {}
    for folder in dict.fromkeys((path.parent, Path("results"))):
        with suppress(OSError):
            for entry in islice(folder.iterdir(), MAX_LISTED):
                found.setdefault(entry.stem.lower(), entry)
    for name in get_close_matches(path.stem.lower(), list(found), n=3, cutoff=0.6):
        if fits(found[name]):
            return f"; did you mean '{found[name]}'?"
    return ""


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
