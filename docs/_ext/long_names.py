"""Names that are wider than a phone may break behind a dot, a slash, an underscore or a sign."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.transforms.post_transforms import SphinxPostTransform

LONG = re.compile(r"\S{32,}")
BREAKS = re.compile(r"(?<=[./_=,:])(?=\w)")


class LongNames(SphinxPostTransform):
    """Puts a place to break into them, which is not copied with the name."""

    default_priority = 400
    formats = ("html",)

    def run(self, **kwargs: Any) -> None:
        """In all code of running text."""
        for literal in list(self.document.findall(nodes.literal)):
            text = literal.astext()
            if len(literal) == 1 and LONG.search(text):
                literal.clear()
                literal += _pieces(text)


def _pieces(text: str) -> list[nodes.Node]:
    found: list[nodes.Node] = []
    for word in re.split(r"(\s+)", text):
        for number, piece in enumerate(BREAKS.split(word) if LONG.fullmatch(word) else [word]):
            if number:
                found.append(nodes.raw("", "<wbr>", format="html"))
            found.append(nodes.Text(piece))
    return found


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the transform."""
    app.add_post_transform(LongNames)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
