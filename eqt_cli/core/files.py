"""Replaces small files in one step, and explains in words what the system refuses."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from eqt_cli.core.errors import EqtError, Remedy


def replace_file(path: Path, content: bytes) -> None:
    """Write a file whole or not at all, whenever the process or the machine may stop."""
    temporary = path.with_name(f"{path.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        temporary.replace(path)
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


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
        raise kind(f"{subject}: cannot be {done}: {said.lower()}", advice) from error


def text_of(
    path: Path, missing: str, kind: type[EqtError] = EqtError, subject: object = None
) -> str:
    """The text of a file that a user names.

    Raises
    ------
    EqtError
        Of this kind, where it cannot be read; `missing` is what to say where there is none.
    """
    with refusals(subject or path, "read", kind=kind):
        try:
            return path.read_text(encoding="utf-8")
        except FileNotFoundError:
            raise kind(f"{path}: does not exist; {missing}") from None
