"""A user's C file with the files beside it that its preprocessor reads, as one text.

They are kept as one text, in which every file stands as it was written. What is compiled is what
the preprocessor makes of that text, and of the headers of the system.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePath, PurePosixPath

from eqt_cli.core.errors import InputError, Remedy, TraceError, printable
from eqt_cli.core.files import TEXT_BYTES, text_of
from eqt_cli.engines.native import compiler
from eqt_cli.engines.native.contained import temporary_folder

_HEAD = re.compile(r"/\* eqt: (\d+) characters of (.+) \*/\n")
_MARKER = re.compile(r'^# \d+ "((?:[^"\\\n]|\\.)*)"([ \d]*)$', re.MULTILINE)
_BEGINS, _OF_SYSTEM = "1", "3"
"""Flags of a marker: here a file begins; it is a header of the compiler or the system."""


def gathered(file: Path) -> str:
    """Return the text of a C file, and of all others beside it that its preprocessor reads.

    Raises
    ------
    InputError
        If one of them is not in the folder of the file, or cannot be read.
    """
    folder = Path(os.path.abspath(file)).parent  # noqa: PTH100  # as the compiler does with ".."
    told = _preprocessed(folder, file.name, file.name)
    texts: dict[str, str] = {}
    for name in dict.fromkeys([file.name, *_included(told, folder, file.name)]):
        texts[name] = text_of(folder / name, "it is included", InputError, limit=TEXT_BYTES)
        if (total := sum(map(len, texts.values()))) > TEXT_BYTES:
            raise InputError(
                f"{file.name} and what it includes: expected at most {TEXT_BYTES:,} characters, "
                f"got {total:,}"
            )
    return "".join(
        f"/* eqt: {len(text)} characters of {name} */\n{text}\n" for name, text in texts.items()
    )


def is_gathered(text: str) -> bool:
    """Return whether a text is one that `gathered` returned."""
    return _HEAD.match(text) is not None


def files_in(text: str, file: str) -> Mapping[str, str]:
    """Return the files of a text by their names, the first one first.

    Parameters
    ----------
    file
        Name of the text, for messages; and of its only file, if it is not one of `gathered`.

    Raises
    ------
    InputError
        If it is not as `gathered` writes it, or a name leads out of its folder.
    """
    if not is_gathered(text):
        return {PurePath(file).name: text}
    found, at = {}, 0
    while at < len(text):
        head = _HEAD.match(text, at)
        name = PurePosixPath(head[2]) if head else PurePosixPath("..")
        if not head or name.is_absolute() or ".." in name.parts or "\\" in head[2]:
            raise InputError(f"{file}: is not as eqt keeps C files: at character {at:,}")
        found[head[2]] = text[head.end() : head.end() + int(head[1])]
        at = head.end() + int(head[1]) + 1
    return found


def preprocessed(text: str, file: str) -> str:
    """Return what the preprocessor makes of a text of `gathered`, with markers of the lines.

    Raises
    ------
    InputError
        If it fails, or reads a file that is not in the text.
    """
    texts = files_in(text, file)
    first = next(iter(texts))
    with temporary_folder() as folder:
        for name, content in texts.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(content, encoding="utf-8")
        told = _preprocessed(folder, first, file)
        if missing := {*_included(told, folder, file)} - {*texts}:
            raise InputError(f"{file} includes {min(missing)}, which eqt has not kept")
    return told.replace(f'"{folder}{os.sep}', '"')


def _preprocessed(folder: Path, name: str, file: str) -> str:
    if compiler.missing():
        raise InputError(
            f"{file} is C, and this machine has no C compiler; install gcc or clang, or "
            "'pip install ziglang' (extra native), a clang in a wheel"
        )
    try:
        return compiler.preprocessed(file=folder / name)
    except TraceError as error:
        told = "; ".join(line.strip() for line in error.lines) or str(error.args[0])
        raise InputError(
            f"{file} cannot be compiled: {printable(told.replace(f'{folder}{os.sep}', ''))}",
            Remedy("compile it with your own compiler to see all of it"),
        ) from error


def _included(told: str, folder: Path, file: str) -> Iterator[str]:
    """Yield the names of the files in a folder that were read; the system's headers are left out.

    Raises
    ------
    InputError
        If another file was read, or a name cannot be kept.
    """
    for marker in _MARKER.finditer(told):
        path, flags = re.sub(r"\\(.)", r"\1", marker[1]), marker[2].split()
        if _BEGINS not in flags or path.startswith("<"):
            continue
        name = PurePath(os.path.normpath(folder / path))
        if name.is_relative_to(folder):
            inner = name.relative_to(folder).as_posix()
            if not inner.isprintable() or "*/" in inner:
                raise InputError(f"{file} includes {printable(inner)}: rename this file")
            yield inner
        elif _OF_SYSTEM not in flags:
            raise InputError(
                f"{file} includes {printable(path)}, which is not in its folder; a result keeps "
                "what is in this folder and below; copy the file there"
            )
