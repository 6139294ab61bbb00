"""Cells that are numbers, with intervals and units, say so: no browser may break a line in them.

An empty corner of a table heads nothing, so it is no heading: screen readers would read one.
"""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.transforms.post_transforms import SphinxPostTransform

LONGEST = 48
"""Characters; what is longer is prose that begins with a number."""

SIGN = r"[-+−±<>≤≥≈~]?\s?"
DIGITS = r"\d[\d.,:/·×⁰¹²³⁴⁵⁶⁷⁸⁹⁻^e+−–\-±%()\[\]∞ \u00a0]*"
UNITS = r"(?:[^\W\d_][\w²³⁻¹/·]{0,4} ?){0,3}"
NUMBER = re.compile(SIGN + DIGITS + UNITS)


EMPTY_HEAD = re.compile(r'<th class="head[^"]*"><p></p></th>')


class Numbers(SphinxPostTransform):
    """Marks the cells."""

    default_priority = 400
    formats = ("html",)

    def run(self, **kwargs: Any) -> None:
        """Of every table."""
        for cell in self.document.findall(nodes.entry):
            text = cell.astext()
            if text == "–" or (len(text) <= LONGEST and NUMBER.fullmatch(text)):
                cell["classes"].append("number")


def _no_empty_heads(
    app: Sphinx, page: str, template: str, context: dict[str, Any], tree: Any
) -> None:
    if body := context.get("body"):
        context["body"] = EMPTY_HEAD.sub('<td class="head"></td>', body)


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the transform."""
    app.add_post_transform(Numbers)
    app.connect("html-page-context", _no_empty_heads)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
