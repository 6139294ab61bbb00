"""Docstrings that write formulas as plain text, for a parser that sees markup in them."""

from __future__ import annotations

import re
from typing import Any

from sphinx.application import Sphinx

LITERAL = re.compile(r"(``.*?``|`[^`]*`)")
MARKUP = re.compile(r"[*|]|_(?=[\s,.;:)\]…]|$)")
TYPED = re.compile(r"^(\w[\w, ]*) : ([^`]+)$")  # ``Q, Qd : (..., d, d)``
COLON = "\ue000"


def escape(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """``Ad*_V |x|`` is no emphasis, no substitution and no reference; a shape is no class."""
    for index, line in enumerate(lines):
        parts = LITERAL.split(TYPED.sub(r"\1 : ``\2``", line))
        parts[::2] = [MARKUP.sub(lambda found: "\\" + found.group(), text) for text in parts[::2]]
        lines[index] = "".join(parts)
    if what in ("attribute", "data", "property") and lines:
        lines[0] = lines[0].replace(":", COLON)  # napoleon would read "type: description"


def restore(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Undo what `escape` hid from napoleon."""
    lines[:] = [line.replace(COLON, ":") for line in lines]


def setup(app: Sphinx) -> dict[str, Any]:
    """Run before and after napoleon, which reads the sections."""
    app.connect("autodoc-process-docstring", escape, priority=400)
    app.connect("autodoc-process-docstring", restore, priority=600)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
