"""How commands print: results on stdout, all else on stderr."""

from __future__ import annotations

import json
import math
import sys
from typing import Any


def say(message: str) -> None:
    """A remark, on stderr."""
    print(message, file=sys.stderr)


def warn(message: str) -> None:
    """What a user should know of a result even with --quiet, on stderr."""
    say(f"eqt: {message}")


def print_json(document: Any) -> None:
    """One JSON document on stdout; numbers that JSON cannot hold become null."""
    print(json.dumps(_plain(document), indent=2, ensure_ascii=False))


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
    return "\n".join(columns(header, rows))


def columns(header: list[str], rows: list[list[str]]) -> list[str]:
    """The lines of `table`: headings, rule, rows."""
    widths = [max(map(len, column)) for column in zip(header, *rows, strict=True)]
    numeric = [all(_is_number(row[i]) for row in rows) for i in range(len(header))]

    def line(cells: list[str]) -> str:
        padded = (
            cell.rjust(width) if right else cell.ljust(width)
            for cell, width, right in zip(cells, widths, numeric, strict=True)
        )
        return "  ".join(padded).rstrip()

    rule = "  ".join("─" * width for width in widths)
    return [line(header), rule, *map(line, rows)]


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


def size(count: float) -> str:
    """A number of bytes in the unit that suits it."""
    for unit in ("B", "kB", "MB", "GB"):
        if count < 1000:
            return f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.3g} TB"
