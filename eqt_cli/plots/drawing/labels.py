"""Symbols, units and names as text that Matplotlib or LaTeX sets; it knows no layout.

Symbols are written in the mathematics that both have in common. What a user chose is escaped for
LaTeX here, and nowhere else, where LaTeX sets the text (``text.usetex``).
"""

from __future__ import annotations

import re
import textwrap
import unicodedata
from itertools import groupby

import matplotlib
from matplotlib.mathtext import MathTextParser

from eqt_cli.results.result import Result

_RENAMED = {"LAMDA": "LAMBDA", "OMICRON": "o"}
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
_LIKE_LATIN = dict(zip("ΑΒΕΖΗΙΚΜΝΟΡΤΥΧ", "ABEZHIKMNOPTYX", strict=True))
"""Greek capitals for which TeX has no command."""
_SHIFTS = {"<sub>": "_", "<super>": "^"}
"""How Unicode describes the letters of an index or an exponent."""
_PLAIN_UNIT = re.compile(r"(?:[A-Za-z0-9/() ]|\^-?[0-9])+")
_DOLLAR = re.compile(r"(?<!\\)\$")

_IN_LATEX = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    '"': r"\textquotedbl{}",
    "`": r"\textasciigrave{}",
    "'": r"'{}",  # two would be a quotation mark, as two hyphens a dash
    ",": r",{}",
    "-": r"-{}",
    **{character: "\\" + character for character in "{}$&%#_"},
}
"""Characters that are not themselves in a text for LaTeX."""
_MATHEMATICAL = {
    "‖": r"\|",
    "−": "-",
    "·": r"\cdot",
    "×": r"\times",
    "±": r"\pm",
    "∞": r"\infty",
    "√": r"\surd",
    "∂": r"\partial",
    "∇": r"\nabla",
    "∫": r"\int",
    "∑": r"\sum",
    "∈": r"\in",
    "≈": r"\approx",
    "≠": r"\neq",
    "≤": r"\leq",
    "≥": r"\geq",
    "→": r"\rightarrow",
    "←": r"\leftarrow",
    "↔": r"\leftrightarrow",
    "⋉": r"\ltimes",
    "𝕀": r"\mathbb{I}",
    "ℝ": r"\mathbb{R}",
}
"""Characters that LaTeX has in mathematics only, besides Greek letters and indices."""


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


def signal_label(result: Result, signal: str) -> str:
    """The label of an axis along which a signal is drawn: its symbol with its unit there."""
    return quantity(result.quantity(signal).symbol, result.units(signal))


def metric_label(result: Result, metric: str, characters: int) -> str:
    """The name of a metric with its unit, in lines of at most so many characters."""
    found, unit = result.quantity(metric), result.units(metric)
    if "{}" in found.label:
        return found.label.replace("{}", quantity(found.symbol, unit))
    return in_words(free_text(found.label or found.long_name, characters), unit)


def component(symbol: str, axis: str) -> str:
    r"""The symbol with the name of an axis as its index: ``\tau_{\omega x_{1}}`` for ``ωx₁``."""
    pieces = []
    for shift, letters in groupby(filter(str.isalnum, axis), _shift):
        text = " ".join(_mathematical(letter) for letter in letters)
        pieces.append(f"{shift}{{{text}}}" if shift else text)
    return f"{symbol}_{{{''.join(pieces)}}}"


def _shift(letter: str) -> str:
    """``_`` for a letter that is an index of its own, ``^`` for an exponent; nothing for others."""
    return _SHIFTS.get(unicodedata.decomposition(letter).partition(" ")[0], "")


def _mathematical(letter: str) -> str:
    """A letter in mathematical notation, where Greek ones have names; indices on the line."""
    if _shift(letter):
        letter = unicodedata.normalize("NFKC", letter)
    words = unicodedata.name(letter, "").split()
    if len(words) == 4 and words[0] == "GREEK" and words[2] == "LETTER":
        name = _RENAMED.get(words[3], words[3])
        if words[1] == "SMALL":
            return name if name == "o" else "\\" + name.lower()
        return _LIKE_LATIN.get(letter) or "\\" + name.capitalize()
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

    ``$…$`` is mathematics if Matplotlib can typeset it, and is else shown as it is. That holds for
    LaTeX too, which could do much more than typeset.
    """
    shown = "".join(c if c.isprintable() else " " for c in name)
    if not _DOLLAR.search(shown):  # and never parsed, which warns of letters that its font lacks
        return _in_lines(shown.replace(r"\$", "$"), characters)
    try:
        MathTextParser("path").parse(shown)
    except ValueError:
        return _in_lines(shown, characters)
    if not _by_latex():
        return shown
    # Texts and mathematics in turn.
    pieces = enumerate(_DOLLAR.split(shown))
    return "".join(
        f"${_mathematics(piece)}$" if number % 2 else _literal(piece.replace(r"\$", "$"))
        for number, piece in pieces
    )


def part_name(suffix: str) -> str:
    """The words in the suffix of a norm over a part: ``rotation`` for ``_rotation``."""
    return suffix.removeprefix("_").replace("_", " ")


def _by_latex() -> bool:
    return bool(matplotlib.rcParams["text.usetex"])


def _in_lines(text: str, characters: int) -> str:
    """Text without mathematics."""
    if "$" in text and not _by_latex():
        return _literal(text)
    return "\n".join(_literal(line) for line in textwrap.wrap(text, characters))


def _literal(text: str) -> str:
    """Text in which no character is a command."""
    if not _by_latex():
        return text.replace("$", r"\$")
    return "".join(map(_letter_for_latex, unicodedata.normalize("NFC", text)))


def _letter_for_latex(letter: str) -> str:
    if letter in _IN_LATEX:
        return _IN_LATEX[letter]
    command = _command(letter)
    return letter if command is None else rf"\ensuremath{{{command}}}"


def _mathematics(text: str) -> str:
    """Mathematics that Matplotlib knows, for LaTeX, where comments and the like must be escaped."""
    escaped = re.sub(r"(?<!\\)[%#&]", r"\\\g<0>", text)
    return "".join(
        letter if (command := _command(letter)) is None else f"{{{command}}}" for letter in escaped
    )


def _command(letter: str) -> str | None:
    """A letter that LaTeX has in mathematics only; None for all others."""
    if letter in _MATHEMATICAL:
        return _MATHEMATICAL[letter]
    if letter.isascii():
        return None
    found = _mathematical(letter)
    if shift := _shift(letter):
        return f"{{}}{shift}{{{found}}}"
    return found if found != letter else None
