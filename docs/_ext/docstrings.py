"""Docstrings that write formulas as plain text, for a parser that sees markup in them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from sphinx.application import Sphinx
from sphinx.util.inspect import TypeAliasForwardRef

LITERAL = re.compile(r"(``.*?``|`[^`]*`)")
MARKUP = re.compile(r"[*|]|_(?=[\s,.;:)\]…]|$)")
TYPED = re.compile(r"^(\w[\w, ]*) : ([^`]+)$")  # ``Q, Qd : (..., d, d)``
SEVERAL = re.compile(r"^\w+(?:, \w+)+(?= : |$)")  # ``mean, low, high``
ARRAY = re.compile(r"numpy\.ndarray\[tuple\[Any, \.\.\.\], numpy\.dtype\[Any\]\]")
PATH = re.compile(r"\b(?:[a-z_]\w*\.)+(?=\w)")  # of a module, in front of a name
COLON = "\ue000"


def escape(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """``Ad*_V |x|`` is no emphasis, no substitution and no reference; a shape is no class."""
    lines[:] = one_by_one(lines)
    for index, line in enumerate(lines):
        parts = LITERAL.split(TYPED.sub(r"\1 : ``\2``", line))
        parts[::2] = [MARKUP.sub(lambda found: "\\" + found.group(), text) for text in parts[::2]]
        lines[index] = "".join(parts)
    if what in ("attribute", "data", "property") and lines:
        lines[0] = lines[0].replace(":", COLON)  # napoleon would read "type: description"


def one_by_one(lines: list[str]) -> Iterator[str]:
    """Attributes that share a description, each with it.

    Sphinx would take all names but the last for a type.
    """
    heading, section, names = "", "", None
    described: list[str] = []
    for line in [*lines, ""]:
        if names and line.startswith(" "):
            described.append(line)
            continue
        if names:
            yield from _each(names, described)
        if line.startswith("---"):
            section = heading
        heading, described = line, []
        names = SEVERAL.match(line) if section == "Attributes" else None
        if not names:
            yield line


def _each(names: re.Match[str], described: list[str]) -> Iterator[str]:
    for name in names[0].split(", "):
        yield name + names.string[names.end() :]
        yield from described


def restore(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Undo what `escape` hid from napoleon, and write types as they are imported."""
    lines[:] = [_short(line.replace(COLON, ":")) for line in lines]


def _short(line: str) -> str:
    """``:vartype runs: collections.abc.Mapping[str, int]`` without the names of modules."""
    field = re.match(r":vartype \w+: (?!``)(.*)", line)
    if not field:
        return line
    return f"{line[: field.start(1)]}``{PATH.sub('', ARRAY.sub('Array', field[1]))}``"


# In a union, an alias is written by this.
TypeAliasForwardRef.__repr__ = lambda alias: alias.name  # type: ignore[method-assign]


def setup(app: Sphinx) -> dict[str, Any]:
    """Run before and after napoleon, which reads the sections."""
    app.connect("autodoc-process-docstring", escape, priority=400)
    app.connect("autodoc-process-docstring", restore, priority=600)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
