"""Symbols, units and names as text that Matplotlib draws; it knows no result and no layout."""

from __future__ import annotations

import re
import textwrap
import unicodedata

from matplotlib.mathtext import MathTextParser

SYMBOLS = {
    "pose_error": r"\|I - Q_E\|_{\mathrm{F}}",
    "velocity_error": r"\|V - V_d\|",
    "torque_norm": r"\|\tau\|",
    "lyapunov": r"\mathcal{L}",
}
"""The paper's symbol for each scalar signal, in Matplotlib's mathematical notation."""

_RENAMED = {"LAMDA": r"\lambda", "OMICRON": "o"}
"""Greek letters that Unicode and TeX name differently."""
_SYMBOL = re.compile(r"\w+_\{[^}]*\}|\w+[_^]\w+|\w+\*|\b[GLPQ]\b|[⋉→Υ]")
"""A symbol of the paper among words: with an index or a star, or a single letter."""
_COMMANDS = {
    "_ff": r"_{\mathrm{ff}}",
    "^nog": r"^{\mathrm{nog}}",
    "^asym": r"^{\mathrm{asym}}",
    "L": r"\mathcal{L}",
    "Ad*": r"\mathrm{Ad}^*",
    "ad*": r"\mathrm{ad}^*",
    "Ad_": r"\mathrm{Ad}_",
    "⁻¹": "^{-1}",
    "g*": r"\mathfrak{g}^*",
    "⋉": r"\ltimes",
    "→": r"\to",
    "Υ": r"\Upsilon",
    "τ": r"\tau",
}
_PLAIN_UNIT = re.compile(r"(?:[A-Za-z0-9/() ]|\^-?[0-9])+")


def quantity(symbol: str, unit: str) -> str:
    """An axis label: the symbol with its unit in parentheses, or alone when it has none.

    Parameters
    ----------
    symbol
        In Matplotlib's mathematical notation, without dollar signs.
    unit
        As in a result file: ``rad/s``, ``N m``, ``m/s^2``; ``1`` or nothing for a pure number, and
        ``mixed`` for a norm over parts with different units.
    """
    if unit in ("", "1"):
        return f"${symbol}$"
    if unit == "mixed":
        return f"${symbol}$ (mixed units)"
    if not _PLAIN_UNIT.fullmatch(unit):
        return f"${symbol}$ ({_literal(unit)})"
    upright = re.sub(r"\^(-?\d+)", r"^{\1}", unit).replace(" ", r"\,")
    return rf"${symbol}$ $(\mathrm{{{upright}}})$"


def in_words(words: str, unit: str) -> str:
    """An axis label without a symbol: words with the unit in parentheses, as in `quantity`."""
    return words + quantity("", unit).removeprefix("$$")


def component(symbol: str, axis: str) -> str:
    r"""The symbol with the name of an axis as its index: ``\tau_{\omega x}`` for ``ωx``."""
    letters = " ".join(_mathematical(letter) for letter in axis if letter.isalnum())
    return f"{symbol}_{{{letters}}}"


def _mathematical(letter: str) -> str:
    """A letter in mathematical notation, where Greek ones have names."""
    words = unicodedata.name(letter, "").split()
    if len(words) == 4 and words[:3] == ["GREEK", "SMALL", "LETTER"]:
        return _RENAMED.get(words[3], "\\" + words[3].lower())
    return letter


def notation(text: str) -> str:
    r"""Words with the paper's symbols, as certificates are named, with the symbols typeset.

    ``rate of Ad_{Q_d⁻¹}`` becomes ``rate of $\mathrm{Ad}_{Q_d^{-1}}$``.
    """
    return _SYMBOL.sub(lambda symbol: f"${_typeset(symbol[0])}$", text)


def _typeset(symbol: str) -> str:
    for plain, command in _COMMANDS.items():
        symbol = symbol.replace(plain, command)
    return symbol


def free_text(name: str, characters: int) -> str:
    """What to draw for a text that a user chose, in lines of at most so many characters.

    ``$…$`` is mathematics if it can be typeset, and is else shown as it is.
    """
    shown = "".join(c if c.isprintable() else " " for c in name)
    try:
        MathTextParser("path").parse(shown)
    except ValueError:
        shown = _literal(shown)
    return shown if "$" in shown else textwrap.fill(shown, characters)


def part_name(suffix: str) -> str:
    """The words in the suffix of a norm over a part: ``rotation`` for ``_rotation``."""
    return suffix.removeprefix("_").replace("_", " ")


def _literal(text: str) -> str:
    """Text in which no dollar sign begins mathematics."""
    return text.replace("$", r"\$")
