"""Sphinx extension: SVG drawings stand in the page, so that they have its colours and live text.

On a code host the same file is an image, with the colours of its own first `style` element.
"""

import re
from pathlib import Path

from docutils import nodes
from sphinx.transforms.post_transforms import SphinxPostTransform

FOLDER = "figures/drawings/"
READABLE = 0.72
"""Least scale at which the text of a drawing can be read; on a phone, a wider one scrolls."""


class Inline(SphinxPostTransform):
    """Replace images of drawings by their source."""

    default_priority = 5  # before images are collected
    formats = ("html",)

    def run(self, **_):
        for image in list(self.document.findall(nodes.image)):
            name = image["uri"].partition(FOLDER)[2]
            if name:
                source = Path(self.app.srcdir, FOLDER, name).read_text(encoding="utf-8")
                self.env.note_dependency(FOLDER + name)
                source = re.sub(r"<style>.*?</style>", "", source, count=1, flags=re.S)
                alt = image.get("alt", "").replace('"', "&quot;")
                width = int(re.search(r' width="(\d+)"', source)[1])
                least = f'style="--least: {round(READABLE * width)}px" '
                source = source.replace(
                    "<svg ", f'<svg class="drawing" {least}role="img" aria-label="{alt}" ', 1
                )
                source = f'<div class="drawing" tabindex="0">{source}</div>'
                image.replace_self(nodes.raw("", source, format="html"))


def setup(app):
    """Add the transform."""
    app.add_post_transform(Inline)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
