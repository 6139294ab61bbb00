"""Formulas as MathML, converted when the site is built: no script, no network, selectable text.

latex2mathml does the conversion. What it leaves to attributes that browsers no longer read
(`mathvariant`, `columnalign`) is put into characters and styles here, and operators get the spaces
that TeX gives them.
"""

from __future__ import annotations

import re
from itertools import pairwise
from typing import Any
from xml.etree import ElementTree as ET

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.writers.html5 import HTML5Translator

logger = logging.getLogger(__name__)

_MATHML = "http://www.w3.org/1998/Math/MathML"
_LETTERS = {
    "double-struck": {"I": "𝕀", "R": "ℝ"},
    "fraktur": {"g": "𝔤"},
    "script": {"L": "ℒ", "R": "ℛ"},
}
_ACCENTS = {"~": "˜", "^": "ˆ", "\u2015": "¯"}
_SIGNS = {"+", "−"}


def mathml(latex: str, display: bool) -> str:
    """One formula.

    Raises
    ------
    ValueError
        If the formula holds a command or a letter that is not known here.
    """
    source = re.sub(r"\\(begin|end)\{aligned\}", r"\\\1{split}", latex)
    source = re.sub(r"\\mathrm\{(\w+)\}", r"\\text{\1}", source)
    text = convert(source, display="block" if display else "inline")
    unknown = re.search(r"\\[A-Za-z]*", text)
    if unknown:
        raise ValueError(f"unknown command {unknown.group()}")
    ET.register_namespace("", _MATHML)
    root = ET.fromstring(re.sub(r"&(?!#|amp;|lt;|gt;)", "&amp;", text))
    for element in root.iter():
        _modernise(element)
    return ET.tostring(root, encoding="unicode")


def _modernise(element: ET.Element) -> None:
    kind = element.tag.removeprefix(f"{{{_MATHML}}}")
    if kind == "mi":
        _letter(element)
    elif kind == "mo":
        _operator(element)
    elif kind == "mover":
        _accent(element)
    _signs(element)
    align = element.attrib.pop("columnalign", None)
    if align:
        element.set("style", f"text-align: {align}")


def _letter(identifier: ET.Element) -> None:
    variant = identifier.attrib.pop("mathvariant", None)
    text = identifier.text or ""
    if text.isalpha() and text.isascii() and len(text) > 1:  # cos
        identifier.tag = f"{{{_MATHML}}}mo"
        _operator(identifier)
    elif variant in (None, "normal"):
        capital_greek = len(text) == 1 and "Α" <= text <= "Ω"  # upright, as in TeX
        if variant or capital_greek:
            identifier.set("mathvariant", "normal")
    elif text in _LETTERS.get(variant, {}):
        identifier.text = _LETTERS[variant][text]
    else:
        raise ValueError(f"no {variant} letter for {text!r}")


def _operator(operator: ET.Element) -> None:
    """Named operators such as Ad, and bars that are not fences."""
    text = operator.text or ""
    if text == "*":
        operator.text = "∗"  # the low one, which an exponent raises
    elif text.isalpha() and len(text) > 1:
        operator.attrib |= {"lspace": "0.12em", "rspace": "0.12em"}
    elif text == "/":
        operator.attrib |= {"lspace": "0", "rspace": "0"}
    elif text in ("|", "‖") and "fence" not in operator.attrib:
        operator.attrib |= {"stretchy": "false", "lspace": "0", "rspace": "0"}


def _accent(over: ET.Element) -> None:
    mark = over[1]
    if len(mark) or not mark.tag.endswith("}mo"):
        return
    over.set("accent", "true")
    mark.text = _ACCENTS.get(mark.text or "", mark.text)
    mark.attrib |= {"stretchy": "false", "style": "padding-bottom: 0.1em"}


def _signs(row: ET.Element) -> None:
    """A sign behind another operator belongs to what follows it."""
    for before, sign in pairwise(row):
        after_operator = before.tag.endswith("}mo") and before.text not in (")", "]", "⟩", "∗")
        if sign.text in _SIGNS and after_operator:
            sign.attrib |= {"form": "prefix", "lspace": "0", "rspace": "0"}


def _render(translator: HTML5Translator, node: nodes.Element, display: bool) -> str:
    try:
        return mathml(node.astext(), display)
    except Exception as error:
        logger.warning("formula %r: %s", node.astext(), error, location=node)
        return translator.encode(node.astext())


def inline(translator: HTML5Translator, node: nodes.math) -> None:
    """A formula within a sentence."""
    translator.body.append(_render(translator, node, display=False))
    raise nodes.SkipNode


def block(translator: HTML5Translator, node: nodes.math_block) -> None:
    """A formula in a line of its own, which scrolls where it is too wide."""
    ids = f' id="{node["ids"][0]}"' if node.get("ids") else ""
    formula = _render(translator, node, display=True)
    translator.body.append(f'<div class="formula" tabindex="0"{ids}>{formula}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the renderer."""
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
