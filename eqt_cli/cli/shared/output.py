"""Text that stays on one line: words, norms, integrals, intervals, shares; knows no layout."""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import sys
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TextIO

from eqt_cli.analysis.text_tables import WORD, Block, TextTable
from eqt_cli.cli.shared.streams import drop_stdout
from eqt_cli.core.errors import EqtError, EqtWarning, InputProblem, printable

if TYPE_CHECKING:
    from rich.text import Text


def folded(line: str, width: int, indent: str = "") -> str:
    """Wrap a line to a width, with the further lines indented."""
    kept = WORD.sub(lambda word: word[0].replace(" ", "\u00a0"), line)
    return textwrap.fill(
        kept, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    ).replace("\u00a0", " ")


_LINES = "\n\t"
"""Control characters allowed in texts of several lines, such as the source of a plugin."""


_silent = False
"""Whether the command prints errors only."""


def be_quiet(quiet: bool) -> bool:
    """Apply ``--quiet``: omit tables and remarks, but print errors and documents."""
    global _silent
    _silent = quiet
    return quiet


def is_quiet() -> bool:
    """Return whether only errors and documents, such as JSON or CSV, are printed."""
    return _silent


def print_text(*pieces: str | Text) -> None:
    """Print a result on stdout; on a terminal, wrap lines between words and colour tables."""
    if _silent:
        return
    for piece in pieces or ("",):
        if isinstance(piece, str):
            print(_folded(printable(piece, _LINES), sys.stdout))
        else:
            from rich.console import Console

            console = Console(file=sys.stdout, soft_wrap=True, highlight=False)
            with console.capture() as captured:  # else a reader who has left ends the process
                console.print(piece)
            print(captured.get(), end="")


def print_verbatim(text: str) -> None:
    """Print a document, such as a configuration or CSV, on stdout without wrapping lines."""
    print(printable(text.removesuffix("\n"), _LINES))


def say(message: str) -> None:
    """Print a remark on stderr, unless the command is quiet."""
    if not _silent:
        complain(message)


def complain(message: str) -> None:
    """Print an error on stderr, also if the command is quiet."""
    print(_folded(printable(message, _LINES), sys.stderr), file=sys.stderr, flush=True)


def warn(remark: EqtWarning) -> None:
    """Print a warning about a result on stderr."""
    say(f"eqt: {remark.with_advice(option)}")


def option(argument: str) -> str:
    """Return an argument as an option of a command, such as ``--out``."""
    return f"--{argument.replace('_', '-')}"


@contextmanager
def as_remark() -> Iterator[None]:
    """Treat output on stdout as a remark, since the work is done and stored.

    A full disk is then no error.
    """
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:  # the reader has left, which needs no remark
        raise
    except OSError as error:
        drop_stdout()
        reason = str(error.strerror).lower()
        say(f"standard output: cannot be written: {reason}; the result is complete")


def print_json(document: Any) -> None:
    """Print a JSON document on stdout; numbers that JSON cannot hold become null."""
    print(json_text(document, indent=2))


def json_text(document: Any, indent: int | None = None) -> str:
    """Return a document as JSON that is safe on a terminal and parses to the same text.

    Characters that stdout cannot encode are escaped.
    """
    encoding = (sys.stdout.encoding or "utf-8").lower().replace("_", "-")
    text = json.dumps(_plain(document), indent=indent, ensure_ascii=encoding[:3] != "utf")
    return printable(text, _LINES, lambda character: json.dumps(character)[1:-1])


def print_found(document: Any, *pieces: str | Text, json: bool, nothing: str = "") -> None:
    """Print findings as one JSON document or as text; say `nothing` if there are none."""
    if json:
        print_json(document)
    elif any(pieces):
        print_text(*pieces)
    elif nothing:
        say(nothing)


def print_source(document: Any, text: str, *, json: bool, nothing: str = "") -> None:
    """Print findings as one JSON document or verbatim; say `nothing`, if given, without a text."""
    if json:
        print_json(document)
    elif text or not nothing:
        print_verbatim(text)
    else:
        say(nothing)


def print_error(error: EqtError) -> None:
    """Print an error as one JSON document, with the place of every problem that has one."""
    problems = problem_records(getattr(error, "problems", ()))
    print_json(
        {"error": error.with_advice(option), "exit_code": error.exit_code, "problems": problems}
    )


def problem_records(problems: Iterable[InputProblem]) -> list[dict[str, str]]:
    """Return the path, message and place of each problem, for programs."""
    return [{"path": p.path, "message": p.with_advice(option), "place": p.place} for p in problems]


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def print_records(header: list[str], rows: Sequence[Sequence[Any]], *, json: bool) -> None:
    """Print a table, or its rows as JSON objects, where a cell of several words is a list."""
    records = [dict(zip(header, row, strict=True)) for row in rows]
    cells = [[cell if isinstance(cell, str) else ", ".join(cell) for cell in row] for row in rows]
    print_found(records, table(header, cells), json=json)


def table(header: list[str], rows: list[list[str]]) -> Text:
    """Return columns under their headings: text aligned left, numbers right."""
    return laid_out(TextTable("", "", header, [Block("", rows)]))


def laid_out(table: TextTable) -> Text:
    """Lay out a table in the width of the terminal or COLUMNS; in full for a pipe."""
    from eqt_cli.cli.shared.terminal_tables import table_text

    return table_text(table, room_of_tables())


def room(stream: TextIO | None = None) -> int | None:
    """Return the width of the terminal; None if the stream is not a terminal."""
    if not (stream or sys.stdout).isatty():
        return None
    return shutil.get_terminal_size().columns


def room_of_tables() -> int | None:
    """Return the width for tables, which obey COLUMNS also without a terminal."""
    columns = os.environ.get("COLUMNS", "")
    return room() or (int(columns) if columns.isdecimal() else 0) or None


def _folded(text: str, stream: TextIO) -> str:
    """Wrap lines between words if the stream is a terminal, which would break them anywhere."""
    width = room(stream)
    if width is None:
        return text
    return "\n".join(_fold(line, width) for line in text.split("\n"))


def _fold(line: str, width: int) -> str:
    if len(line) <= width:
        return line
    indent = min(len(_HANGING.match(line)[0]), width // 2)  # type: ignore[index]  # every line matches
    return folded(line, width, " " * indent)


_HANGING = re.compile(r" *(\S+ {2,})?")
"""Hanging indent of wrapped lines: the indentation, and the word that labels the line."""


def count_of(number: int, noun: str) -> str:
    """Return a count with its noun: ``1 run``, ``200 runs``."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def duration(seconds: float) -> str:
    """Return a time span in a suitable unit."""
    for unit, length in (("d", 86_400), ("h", 3_600), ("min", 60)):
        if seconds >= 2 * length:
            return f"{seconds / length:.1f} {unit}"
    return f"{seconds:.1f} s"
