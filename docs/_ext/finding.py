"""The words of topics are index entries of their pages, so that the search finds them."""

from __future__ import annotations

from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.transforms import SphinxTransform

from eqt_cli.extensions.topics.topics import topics


class Words(SphinxTransform):
    """Adds the words of its topics to each page, before Sphinx gathers the entries."""

    default_priority = 500

    def apply(self, **options: Any) -> None:
        """Add an entry for each word, at its heading or at the first one."""
        for topic in topics():
            page, _, anchor = topic.page.partition("#")
            page = page.removesuffix(".md")
            first = next(self.document.findall(nodes.section), None)
            if page != self.env.docname or first is None:
                continue
            target = anchor or first["ids"][0]
            entries = [("single", word, target, "", None) for word in topic.words]
            first.insert(1, addnodes.index(entries=entries))


def setup(app: Sphinx) -> dict[str, Any]:
    """Run for every page."""
    app.add_transform(Words)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
