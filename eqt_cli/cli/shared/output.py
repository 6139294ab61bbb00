"""How commands print: results on stdout, all else on stderr, and nothing that cannot be seen.

What is printed may come from a file, so it leaves through `print_text`, `say` and `print_json`,
which escape it; no other module prints (ruff's T20). Tables escape their cells themselves.
"""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TextIO

from eqt_cli.analysis.text_tables import Block, TextTable
from eqt_cli.cli.shared.streams import drop_stdout
from eqt_cli.cli.shared.unbroken import folded
from eqt_cli.core.errors import EqtError, EqtWarning, InputProblem
from eqt_cli.core.printable import printable

if TYPE_CHECKING:
    from rich.text import Text

_LINES = "\n\t"
"""What texts of several lines are made of, such as the source of a plugin."""


_silent = False
"""Whether this command was told to print errors only."""


def be_quiet(quiet: bool) -> bool:
    """What ``--quiet`` does: tables and remarks are left out, errors and documents are not."""
    global _silent
    _silent = quiet
    return quiet


def is_quiet() -> bool:
    """Whether only errors are printed, and documents such as JSON or CSV."""
    return _silent


def print_text(*pieces: str | Text) -> None:
    """A result, on stdout; on a terminal, lines are broken between words and tables coloured."""
    if _silent:
        return
    for piece in pieces or ("",):
        if isinstance(piece, str):
            print(_folded(printable(piece, _LINES), sys.stdout))
        else:
            from rich.console import Console

            console = Console(file=sys.stdout, soft_wrap=True, highlight=False)
            with console.capture() as captured:  # which would exit where a reader has left
                console.print(piece)
            print(captured.get(), end="")


def print_verbatim(text: str) -> None:
    """A document, such as a configuration or CSV, on stdout; no line of it is broken."""
    print(printable(text.removesuffix("\n"), _LINES))


def say(message: str) -> None:
    """A remark, on stderr."""
    if not _silent:
        complain(message)


def complain(message: str) -> None:
    """An error, on stderr, also where only errors are printed."""
    print(_folded(printable(message, _LINES), sys.stderr), file=sys.stderr, flush=True)


def warn(remark: EqtWarning) -> None:
    """What a user should know of a result, on stderr."""
    say(f"eqt: {remark.with_advice(option)}")


def option(argument: str) -> str:
    """An argument as commands take it: ``--out``."""
    return f"--{argument.replace('_', '-')}"


@contextmanager
def as_remark() -> Iterator[None]:
    """Where what is printed on stdout is no more than a remark: the work is done and kept.

    A disk that is full is no error then.
    """
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:  # whoever read it has gone, which is no news
        raise
    except OSError as error:
        drop_stdout()
        reason = str(error.strerror).lower()
        say(f"standard output: cannot be written: {reason}; the result is complete")


def print_json(document: Any) -> None:
    """One JSON document on stdout; numbers that JSON cannot hold become null."""
    print(json_text(document, indent=2))


def json_text(document: Any, indent: int | None = None) -> str:
    """A document as JSON that a terminal may be shown; readers get the same text from it.

    Where stdout cannot show all characters, the others are escapes.
    """
    encoding = (sys.stdout.encoding or "utf-8").lower().replace("_", "-")
    text = json.dumps(_plain(document), indent=indent, ensure_ascii=encoding[:3] != "utf")
    return printable(text, _LINES, lambda character: json.dumps(character)[1:-1])


def print_found(document: Any, *pieces: str | Text, json: bool, nothing: str = "") -> None:
    """What a command has found, as one JSON document or as text; `nothing` where it is empty."""
    if json:
        print_json(document)
    elif any(pieces):
        print_text(*pieces)
    elif nothing:
        say(nothing)


def print_error(error: EqtError) -> None:
    """What went wrong as one JSON document, with the place of every problem that has one."""
    problems = problem_records(getattr(error, "problems", ()))
    print_json(
        {"error": error.with_advice(option), "exit_code": error.exit_code, "problems": problems}
    )


def problem_records(problems: Iterable[InputProblem]) -> list[dict[str, str]]:
    """Problems for programs: path, message and place of each."""
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
    """A table, or its rows as JSON objects; a cell of several words is a list there."""
    records = [dict(zip(header, row, strict=True)) for row in rows]
    cells = [[cell if isinstance(cell, str) else ", ".join(cell) for cell in row] for row in rows]
    print_found(records, table(header, cells), json=json)


def table(header: list[str], rows: list[list[str]]) -> Text:
    """Columns under their headings: text to the left, numbers to the right."""
    return laid_out(TextTable("", "", header, [Block("", rows)]))


def laid_out(table: TextTable) -> Text:
    """A table as it is printed, as wide as the terminal or COLUMNS; a pipe gets all of it."""
    from eqt_cli.cli.shared.terminal_tables import table_text

    return table_text(table, room_of_tables())


def room(stream: TextIO | None = None) -> int | None:
    """The width of the terminal; None where the stream is none, as a program may read it."""
    if not (stream or sys.stdout).isatty():
        return None
    return shutil.get_terminal_size().columns


def room_of_tables() -> int | None:
    """The same for tables, which obey COLUMNS wherever they go."""
    columns = os.environ.get("COLUMNS", "")
    return room() or (int(columns) if columns.isdecimal() else 0) or None


def _folded(text: str, stream: TextIO) -> str:
    """Lines broken between words where a terminal would break them anywhere."""
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
"""What further lines of a line leave free: its indentation, and a word that names it."""


def count_of(number: int, noun: str) -> str:
    """``1 run``, ``200 runs``."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def duration(seconds: float) -> str:
    """A span of time in the unit that suits it."""
    for unit, length in (("d", 86_400), ("h", 3_600), ("min", 60)):
        if seconds >= 2 * length:
            return f"{seconds / length:.1f} {unit}"
    return f"{seconds:.1f} s"
