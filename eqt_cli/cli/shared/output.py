"""How commands print: results on stdout, all else on stderr, and nothing that cannot be seen.

What is printed may come from a file, so it leaves through `print_text`, `say` and `print_json`,
which escape it; no other module prints (ruff's T20).
"""

from __future__ import annotations

import json
import math
import shutil
import sys
import textwrap
from collections.abc import Iterable, Sequence
from typing import Any

from eqt_cli.core.errors import EqtError, EqtWarning, InputProblem
from eqt_cli.core.printable import printable

_LINES = "\n\t"
"""What texts of several lines are made of, such as the source of a plugin."""


def print_text(text: str = "") -> None:
    """A result, on stdout."""
    print(printable(text, _LINES))


def say(message: str) -> None:
    """A remark, on stderr."""
    print(printable(message, _LINES), file=sys.stderr, flush=True)


def warn(remark: EqtWarning) -> None:
    """What a user should know of a result even with --quiet, on stderr."""
    say(f"eqt: {remark.told(option)}")


def option(argument: str) -> str:
    """An argument as commands take it: ``--out``."""
    return f"--{argument.replace('_', '-')}"


def print_json(document: Any) -> None:
    """One JSON document on stdout; numbers that JSON cannot hold become null."""
    print(json_text(document, indent=2))


def json_text(document: Any, indent: int | None = None) -> str:
    """A document as JSON that a terminal may be shown; readers get the same text from it."""
    text = json.dumps(_plain(document), indent=indent, ensure_ascii=False)
    return printable(text, _LINES, lambda character: json.dumps(character)[1:-1])


def print_found(document: Any, text: str, *, json: bool, nothing: str = "") -> None:
    """What a command has found, as one JSON document or as text; `nothing` where it is empty."""
    if json:
        print_json(document)
    elif text:
        print_text(text.removesuffix("\n"))
    elif nothing:
        say(nothing)


def print_error(error: EqtError) -> None:
    """What went wrong as one JSON document, with the place of every problem that has one."""
    problems = problem_records(getattr(error, "problems", ()))
    print_json({"error": error.told(option), "exit_code": error.exit_code, "problems": problems})


def problem_records(problems: Iterable[InputProblem]) -> list[dict[str, str]]:
    """Problems for programs: path, message and place of each."""
    return [{"path": p.path, "message": p.told(option), "place": p.place} for p in problems]


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def table(header: list[str], rows: list[list[str]]) -> str:
    """Columns under their headings: text to the left, numbers to the right."""
    head, body = columns(header, rows, room())
    return "\n".join([*head, *body])


def print_records(header: list[str], rows: Sequence[Sequence[Any]], *, json: bool) -> None:
    """A table, or its rows as JSON objects; a cell of several words is a list there."""
    document = [dict(zip(header, row, strict=True)) for row in rows]
    cells = [[cell if isinstance(cell, str) else ", ".join(cell) for cell in row] for row in rows]
    print_found(document, table(header, cells), json=json)


def room() -> int | None:
    """The width of the terminal; None where stdout is none, as a program may read it."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else None


def columns(
    header: list[str], rows: list[list[str]], room: int | None = None
) -> tuple[list[str], list[str]]:
    """The headings with a rule below, and the rows, each without a line break at its end.

    What is wider than `room` gets headings of several lines, and then a last column of text that
    is wrapped; numbers are never cut.
    """
    rows = [[printable(cell) for cell in row] for row in rows]
    bodies = [max((len(row[i]) for row in rows), default=0) for i in range(len(header))]
    numeric = [all(_is_number(row[i]) for row in rows) for i in range(len(header))]
    heads = [[heading] for heading in header]
    widths = [max(len(heading), body) for heading, body in zip(header, bodies, strict=True)]
    if room is not None and _total(widths) > room:
        heads = [_folded(heading, body) for heading, body in zip(header, bodies, strict=True)]
        widths = [max(body, *map(len, head)) for head, body in zip(heads, bodies, strict=True)]
    left = 0 if room is None else room - _total([*widths[:-1], 0])
    if _LEAST_TEXT <= left < widths[-1] and not numeric[-1]:
        widths[-1] = left
        rows = [[*row[:-1], textwrap.fill(row[-1], left)] for row in rows]

    def line(cells: list[str]) -> str:
        padded = (
            cell.rjust(width) if right else cell.ljust(width)
            for cell, width, right in zip(cells, widths, numeric, strict=True)
        )
        return _GAP.join(padded).rstrip()

    def lines(row: list[str]) -> str:
        first, *more = row[-1].split("\n")
        empty = [""] * (len(row) - 1)
        return "\n".join([line([*row[:-1], first]), *(line([*empty, rest]) for rest in more)])

    rule = _GAP.join("─" * width for width in widths)
    height = max(map(len, heads))
    raised = [[""] * (height - len(head)) + head for head in heads]
    return [*map(line, map(list, zip(*raised, strict=True))), rule], [lines(row) for row in rows]


_GAP = "  "
_LEAST_TEXT = 24
"""A column of text that would be narrower is left as it is."""


def _total(widths: list[int]) -> int:
    return sum(widths) + len(_GAP) * (len(widths) - 1)


def _folded(heading: str, width: int) -> list[str]:
    """A heading in lines no wider than its column, or than its longest word."""
    longest = max(map(len, heading.split()), default=0)
    return textwrap.wrap(heading, max(width, longest, 1)) or [""]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return text in ("", "-")
    return True


def number(value: float, digits: int = 3) -> str:
    """A number for a table; ``-`` where there is none."""
    if not math.isfinite(value):
        return "-"
    return f"{value:.{digits}g}" if abs(value) < 1e-2 and value else f"{value:.{digits}f}"


def duration(seconds: float) -> str:
    """A span of time in the unit that suits it."""
    for unit, length in (("d", 86_400), ("h", 3_600), ("min", 60)):
        if seconds >= 2 * length:
            return f"{seconds / length:.1f} {unit}"
    return f"{seconds:.1f} s"
