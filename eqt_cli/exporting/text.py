"""Fills in the templates beside this file, and writes numbers and comments in C."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterable, Sequence
from pathlib import Path
from string import Template

import numpy as np

from eqt_cli.analysis.evidence.program_error import Arithmetic
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import printable

_TEMPLATES = Path(__file__).parent / "templates"
WIDTH = 100


def filled(template: str, **values: object) -> str:
    """Return a template with values for its names."""
    text = (_TEMPLATES / template).read_text(encoding="utf-8")
    return Template(text).substitute({name: str(value) for name, value in values.items()})


def number(value: float, by: Arithmetic) -> str:
    """Return the shortest text that a compiler reads as exactly this number."""
    if by.name == "double":
        return repr(float(value))
    text = str(np.float32(value))
    return f"{text if '.' in text or 'e' in text else text + '.0'}f"


def braced(values: Iterable[float], by: Arithmetic) -> str:
    """Return an array in C."""
    return f"{{{', '.join(number(value, by) for value in values)}}}"


def wrapped(text: str, indent: str, first: str = "") -> str:
    """Return text broken into lines at spaces."""
    return "\n".join(
        textwrap.wrap(
            text,
            WIDTH,
            initial_indent=first or indent,
            subsequent_indent=indent,
            break_long_words=False,
            break_on_hyphens=False,
        )
    )


def comment(text: str) -> str:
    """Return a text for a comment, without marks that begin or end one."""
    return printable(text).replace("*/", "* /").replace("/*", "/ *").replace("\\", "\\ ")


def markdown(text: str) -> str:
    """Return a text for Markdown, without marks that format it, link or begin HTML."""
    return re.sub(r"[\\`*_\[\]<>&|~$#!]", r"\\\g<0>", printable(text))


def declared(fields: Sequence[tuple[str, str, str]]) -> str:
    """Return the fields of a structure, given by type, declaration and meaning."""
    lines = []
    width = max(len(f"{kind} {name};") for kind, name, _ in fields)
    for kind, name, meaning in fields:
        text = f"    {f'{kind} {name};':{width}} /* {comment(meaning)} */"
        lines.append(
            wrapped(text.strip(), " " * (8 + width), "    ") if len(text) > WIDTH else text
        )
    return "\n".join(lines)


def above(value: float) -> str:
    """Return a bound in two digits, rounded up."""
    if not value > 0 or not math.isfinite(value):
        return f"{value:g}"
    scale = 10.0 ** (math.floor(math.log10(value)) - 1)
    return f"{math.ceil(value / scale) * scale:.2g}"


def row(values: Array) -> str:
    """Return doubles as an array in C on one line."""
    return f"{{{', '.join(repr(float(value)) for value in values)}}}"
