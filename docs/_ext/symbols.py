"""Sphinx extension: letters with an underscore, such as ω_d, become letters with a subscript."""

import re

from docutils import nodes
from sphinx.transforms.post_transforms import SphinxPostTransform

MARKS = "\u0300-\u036f"
SYMBOL = re.compile(
    rf"(?<![A-Za-z_.\\])((?:[Aa]d|[A-Za-zΑ-Ωα-ω𝕀Ḁ-ỹ])[{MARKS}]*)_(?!(?:dot|value)\b)([A-Za-z0-9Α-Ωα-ω]{{1,5}}(?:,[a-z])?)(?![A-Za-z0-9_])"
)
"""A letter (or Ad, ad) with its marks and a short subscript; names of files and keys are longer,
except b_dot and p_value."""


class Subscripts(SphinxPostTransform):
    """Set the subscripts of symbols in prose; code and formulas stay as they are."""

    default_priority = 800

    def run(self, **_):
        for text in list(self.document.findall(nodes.Text)):
            if isinstance(
                text.parent, (nodes.literal, nodes.math, nodes.raw, nodes.FixedTextElement)
            ):
                continue
            pieces, end = [], 0
            for match in SYMBOL.finditer(text):
                letter, index = match.groups()
                pieces += [
                    nodes.Text(text[end : match.start()] + letter),
                    nodes.subscript(index, index),
                ]
                end = match.end()
            if pieces:
                pieces.append(nodes.Text(text[end:]))
                text.parent.replace(text, pieces)


def setup(app):
    """Add the transform."""
    app.add_post_transform(Subscripts)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
