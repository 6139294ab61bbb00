"""Symbols, units and names as text that Matplotlib or LaTeX sets; it knows no layout.

Symbols are written in the mathematics that both have in common. What a user chose goes through
`free_text`, which escapes it for the one that sets it (LaTeX where ``text.usetex`` is on).
"""

from __future__ import annotations

import re
import textwrap
from itertools import groupby

import matplotlib
from matplotlib.mathtext import MathTextParser

from eqt_cli.plots.drawing import latex
from eqt_cli.plots.drawing.tex_letters import mathematical, shift
from eqt_cli.results.quantity_table import QUANTITIES
from eqt_cli.results.result import Result

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
_DOLLAR = re.compile(r"(?<!\\)\$")


SYMBOLS = {quantity.name: quantity.symbol for quantity in QUANTITIES.values() if quantity.symbol}
"""By the names of what results hold, as plugins of the first version look them up."""


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
    text = quantity(result.quantity(signal).symbol, result.units(signal))
    own = signal == "lyapunov" and result.lyapunov_functions
    return f"{text}, each law's own" if own else text


def metric_label(result: Result, metric: str, characters: int) -> str:
    """The name of a metric with its unit, in lines of at most so many characters."""
    found = result.quantity(metric)
    unit = result.units(metric) if result.has(metric) else found.units
    if "{}" in found.label:
        return found.label.replace("{}", quantity(found.symbol, unit))
    return in_words(free_text(found.label or found.long_name, characters), unit)


def component(symbol: str, axis: str) -> str:
    r"""The symbol with the name of an axis as its index: ``\tau_{\omega x_{1}}`` for ``ωx₁``."""
    pieces = []
    for place, letters in groupby(filter(str.isalnum, axis), shift):
        text = " ".join(map(mathematical, letters))
        pieces.append(f"{place}{{{text}}}" if place else text)
    return f"{symbol}_{{{''.join(pieces)}}}"


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
        f"${latex.mathematics(piece)}$" if number % 2 else _literal(piece.replace(r"\$", "$"))
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
    return latex.escaped(text) if _by_latex() else text.replace("$", r"\$")
