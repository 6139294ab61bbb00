"""Quantities, units and numbers as text, plain or for LaTeX; it knows no table."""

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
    """How the cells of a table are written, for terminals and HTML."""

    plus_minus = "±"

    def text(self, words: str) -> str:
        """Words, such as a label that a user chose."""
        return words

    def name(self, quantity: Quantity) -> str:
        """What a quantity is called, with its formula."""
        return quantity.described

    def unit(self, unit: str) -> str:
        """A unit; nothing for a pure number."""
        if unit in ("", "1"):
            return ""
        return re.sub(r"\^(-?\d+)", lambda match: match[1].translate(_SUPERSCRIPTS), unit)

    def window(self, window: Window) -> str:
        """A window in seconds."""
        return f"{window.start:g}–{window.stop:g} s"

    def number(self, text: str) -> str:
        """A number that is formatted already."""
        return text

    def interval(self, mean: float, low: float, high: float) -> str:
        """A mean with its interval, to two digits of its half width."""
        digits = decimals((high - low) / 2, mean)
        ends = f"{fixed(low, digits)}, {fixed(high, digits)}"
        centre = self.number(fixed(mean, digits))
        return f"{centre} [{self.number(ends)}]" if math.isfinite(low) else centre

    def spread(self, mean: float, low: float, high: float) -> str:
        """A mean with half the width of its interval."""
        half = (high - low) / 2
        digits = decimals(half, mean)
        if not math.isfinite(half):
            return self.number(fixed(mean, digits))
        return f"{self.number(fixed(mean, digits))} {self.plus_minus} {fixed(half, digits)}"


class Latex(Plain):
    """The same for LaTeX, with packages booktabs and amsmath."""

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
    """Decimal places that show two digits of the half width of an interval.

    Without one, they show three digits of the mean.
    """
    if math.isfinite(half_width) and half_width > 0:
        return min(12, max(0, 1 - math.floor(math.log10(half_width))))
    if math.isfinite(mean) and mean != 0:
        return min(12, max(0, 2 - math.floor(math.log10(abs(mean)))))
    return 3


def fixed(value: float, digits: int) -> str:
    """A number with so many decimal places, scientific where those would be many; - if none."""
    if not math.isfinite(value):
        return "-"
    if digits > 6:
        return f"{value:.2g}"
    text = f"{value:.{digits}f}"
    return text.removeprefix("-") if float(text) == 0 else text
