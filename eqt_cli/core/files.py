"""Reads small files and records, and explains in words what the system refuses."""

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
    """Write what a folder says of itself, whole or not at all."""
    text = json.dumps(record, indent=2, ensure_ascii=False) + "\n"
    replace_file(path, text.encode())


def read_record(path: Path, *keys: str) -> dict[str, Any] | None:
    """What `write_record` has written; None where there is none, or none with these keys."""
    try:
        with _named(path):
            found = json.loads(content_of(path, RECORD_BYTES, follow=False))
    except (FileNotFoundError, ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) and set(keys) <= set(found) else None


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Say which file it is, to somebody who was told of the folder only."""
    try:
        yield
    except (NotRegularError, TooLargeError) as error:
        raise OSError(error.errno, f"{path.name}: {error.strerror}") from error


@contextmanager
def refusals(
    subject: object, done: str, remedy: Remedy | str = "", kind: type[EqtError] = EqtError
) -> Iterator[None]:
    """Say what the system refuses: ``x.yaml: cannot be read: permission denied; check …``.

    Parameters
    ----------
    done
        What is done in the block: ``"read"``.
    remedy
        What the user can do about it.
    kind
        The error to raise instead of the system's.
    """
    try:
        yield
    except (OSError, ValueError) as error:  # the latter of bytes, and of names with a null byte
        said = "it is no text in UTF-8" if isinstance(error, UnicodeError) else str(error)
        if isinstance(error, OSError):
            said = error.strerror or str(error)
        advice = Remedy(remedy) if isinstance(remedy, str) else remedy
        said = said[:1].lower() + said[1:]
        raise kind(f"{subject}: cannot be {done}: {said}", advice) from error


YAML = (".yaml", ".yml")
"""How files of configurations end, where results could be meant as well."""

MOST_LISTED = 1000
"""Entries of a folder among which a name is looked for that is like a missing one."""


def near(path: Path, fits: Callable[[Path], bool]) -> str:
    """`; did you mean 'results/sat'?` for the entry whose name is closest to a missing one.

    It is looked for in the folder where the path should be, and in ``results``.

    Parameters
    ----------
    fits
        Whether an entry may be meant.
    """
    found: dict[str, Path] = {}
    for folder in dict.fromkeys((path.parent, Path("results"))):
        with suppress(OSError):
            for entry in islice(folder.iterdir(), MOST_LISTED):
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
    most: int = TEXT_BYTES,
    smaller: str = "",
    read: Callable[[Path, int], str] = text_in,
) -> str:
    """The text of a file that a user names, of at most so many bytes.

    Raises
    ------
    EqtError
        Of this kind, where it cannot be read; `missing` is what to say where there is none, and
        `smaller` what to do about one that is too large.
    """
    with refusals(subject or path, "read", kind=kind):
        try:
            return read(path, most)
        except FileNotFoundError:
            raise kind(f"{path}: not found; {missing}") from None
        except TooLargeError as error:
            if not smaller:
                raise
            said = f"{subject or path}: cannot be read: {error.strerror}"
            raise kind(f"{said}; {smaller}") from error
