"""Formats quantities, units and numbers, as plain text or for LaTeX."""

import math
import re

from eqt_cli.results.quantity import Quantity
from eqt_cli.results.time_windows import Window

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_LATEX_SPECIAL = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    **{character: "\\" + character for character in "&%$#_{}"},
}


class Plain:
    """Formats the cells of tables for terminals and HTML."""

    plus_minus = "±"

    def text(self, words: str) -> str:
        """Return plain words, such as a user's label."""
        return words

    def name(self, quantity: Quantity) -> str:
        """Return the name of a quantity with its formula."""
        return quantity.described

    def unit(self, unit: str) -> str:
        """Return a unit; empty for a pure number."""
        if unit in ("", "1"):
            return ""
        return re.sub(r"\^(-?\d+)", lambda match: match[1].translate(_SUPERSCRIPTS), unit)

    def window(self, window: Window) -> str:
        """Return a window in seconds."""
        return f"{window.start:g}–{window.stop:g} s"

    def number(self, text: str) -> str:
        """Return a number that is already formatted."""
        return text

    def interval(self, mean: float, low: float, high: float) -> str:
        """Return a mean with its interval, to two digits of the half width."""
        digits = decimals((high - low) / 2, mean)
        ends = f"{fixed(low, digits)}, {fixed(high, digits)}"
        centre = self.number(fixed(mean, digits))
        return f"{centre} [{self.number(ends)}]" if math.isfinite(low) else centre

    def spread(self, mean: float, low: float, high: float) -> str:
        """Return a mean with half the width of its interval."""
        half = (high - low) / 2
        digits = decimals(half, mean)
        if not math.isfinite(half):
            return self.number(fixed(mean, digits))
        return f"{self.number(fixed(mean, digits))} {self.plus_minus} {fixed(half, digits)}"


class Latex(Plain):
    """Formats the cells of tables for LaTeX with the packages booktabs and amsmath."""

    plus_minus = r"$\pm$"

    def text(self, words: str) -> str:
        escaped = "".join(_LATEX_SPECIAL.get(character, character) for character in words)
        for plain, symbol in (("‖", r"$\|$"), ("−", "$-$"), ("τ", r"$\tau$")):
            escaped = escaped.replace(plain, symbol)
        return escaped

    def name(self, quantity: Quantity) -> str:
        label = self.text(quantity.long_name.replace("||", "‖"))
        if quantity.label:
            label = quantity.label.replace("{}", f"${quantity.symbol}$")
        formula = quantity.formula.replace("{}", quantity.symbol)
        return f"{label} ${formula}$" if formula else label

    def unit(self, unit: str) -> str:
        if unit in ("", "1", "mixed"):
            return super().unit(unit)
        return rf"$\mathrm{{{unit.replace(' ', chr(92) + ',')}}}$"

    def window(self, window: Window) -> str:
        return rf"{window.start:g}--{window.stop:g}\,s"

    def number(self, text: str) -> str:
        return re.sub(r"-(?=\d)", "$-$", text)


def decimals(half_width: float, mean: float = 0.0) -> int:
    """Return the decimal places that show two digits of the half width of an interval.

    Without an interval, they show three digits of the mean.
    """
    if math.isfinite(half_width) and half_width > 0:
        return min(12, max(0, 1 - math.floor(math.log10(half_width))))
    if math.isfinite(mean) and mean != 0:
        return min(12, max(0, 2 - math.floor(math.log10(abs(mean)))))
    return 3


def significant(value: float, digits: int = 4) -> str:
    """A number with so many digits, zeros at its end among them; ``-`` if there is none."""
    if not math.isfinite(value):
        return "-"
    if value == 0:
        return "0"
    size = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if not -3 <= size < 6:
        return f"{value:.{digits - 1}e}"
    return f"{value:.{max(0, digits - 1 - size)}f}"


def fixed(value: float, digits: int) -> str:
    """Format a number with decimal places, or scientifically if there are many; - if not finite."""
    if not math.isfinite(value):
        return "-"
    if digits > 6:
        return f"{value:.2g}"
    text = f"{value:.{digits}f}"
    return text.removeprefix("-") if float(text) == 0 else text
