"""Symbols, units and names as text that Matplotlib draws; it knows no result and no layout."""

from __future__ import annotations

import re
import textwrap
import unicodedata

from matplotlib.mathtext import MathTextParser
from matplotlib.text import Text

SYMBOLS = {
    "pose_error": r"\|I - Q_E\|_{\mathrm{F}}",
    "velocity_error": r"\|V - V_d\|",
    "torque_norm": r"\|\tau\|",
    "lyapunov": r"\mathcal{L}",
}
"""The paper's symbol for each scalar signal, in Matplotlib's mathematical notation."""

_LONGEST_LINE = 40
_PLAIN_UNIT = re.compile(r"[A-Za-z0-9/^() -]+")


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
        escaped = unit.replace("$", r"\$")
        return f"${symbol}$ ({escaped})"
    upright = re.sub(r"\^(-?\d+)", r"^{\1}", unit).replace(" ", r"\,")
    return rf"${symbol}$ $(\mathrm{{{upright}}})$"


def component(symbol: str, axis: str) -> str:
    r"""The symbol with the name of an axis as its index: ``\tau_{\omega x}`` for ``ωx``."""
    letters = " ".join(_mathematical(letter) for letter in axis if letter.isalnum())
    return f"{symbol}_{{{letters}}}"


def _mathematical(letter: str) -> str:
    """A letter in mathematical notation, where Greek ones have names."""
    words = unicodedata.name(letter, "").split()
    if words[:3] == ["GREEK", "SMALL", "LETTER"]:
        return "\\" + words[-1].lower()
    return letter


def set_name(text: Text, name: str) -> None:
    """Show a name that a user chose; ``$…$`` is mathematics only if it can be typeset."""
    shown = "".join(c if c.isprintable() else " " for c in name)
    try:
        MathTextParser("path").parse(shown)
    except ValueError:
        text.set_parse_math(False)
    if "$" not in shown:
        shown = textwrap.fill(shown, _LONGEST_LINE)
    text.set_text(shown)
