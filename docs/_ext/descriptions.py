"""The first words of a page are its description, which search engines and messengers show."""

from __future__ import annotations

from html import escape
from textwrap import shorten
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx

LONGEST = 160


def describe(
    app: Sphinx, page: str, template: str, context: dict[str, Any], tree: nodes.document | None
) -> None:
    """Add it to the head of a page that is made from a source."""
    first = next(tree.findall(nodes.section), None) if tree else None
    if first is None:
        return
    said = " ".join(
        child.astext() for child in first.children if isinstance(child, nodes.paragraph)
    )
    text = escape(shorten(said, LONGEST, placeholder=" …"))
    context["metatags"] += f'<meta name="description" content="{text}">\n'


def setup(app: Sphinx) -> dict[str, Any]:
    """Run for every page."""
    app.connect("html-page-context", describe)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
