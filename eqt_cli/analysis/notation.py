"""How quantities and numbers are written in tables, as plain text and in LaTeX."""

import math
import re

from eqt_cli.results.quantity import Quantity, Window

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_LATEX: dict[str, str | int | None] = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "&": r"\&",
    "%": r"\%",
    "$": r"\$",
    "#": r"\#",
    "_": r"\_",
    "{": r"\{",
    "}": r"\}",
    "‖": r"$\|$",
    "−": "$-$",
    "τ": r"$\tau$",
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
        centre, *ends = map(self.number, in_one_form((high - low) / 2, mean, low, high))
        return f"{centre} [{', '.join(ends)}]" if math.isfinite(low) else centre

    def spread(self, mean: float, low: float, high: float) -> str:
        """Return a mean with half the width of its interval."""
        half = (high - low) / 2
        centre, around = map(self.number, in_one_form(half, mean, half))
        return f"{centre} {self.plus_minus} {around}" if math.isfinite(half) else centre


class Latex(Plain):
    """Formats the cells of tables for LaTeX with the packages booktabs and amsmath."""

    plus_minus = r"$\pm$"

    def text(self, words: str) -> str:
        return words.translate(str.maketrans(_LATEX))

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
        powers = re.sub(r"e([+-])0*(\d+)", r"$\\cdot10^{\1\2}$", text).replace("{+", "{")
        return re.sub(r"(?<!\{)-(?=\d)", "$-$", powers)


DECIMAL = 1e-3, 1e9
"""Sizes of the numbers that are written as decimals; others are powers of ten."""


def in_one_form(half_width: float, *values: float) -> list[str]:
    """Format numbers to two digits of the half width of an interval, or three of the largest.

    All of them are decimals, or all powers of ten.
    """
    largest = max((abs(x) for x in values if math.isfinite(x)), default=0.0)
    known = math.isfinite(half_width) and half_width > 0
    if not (known or largest):
        return [fixed(x, 3) for x in values]
    digits = (1 if known else 2) - math.floor(math.log10(half_width if known else largest))
    if DECIMAL[0] <= largest < DECIMAL[1]:
        return [fixed(x, min(12, max(0, digits))) for x in values]
    return [_power(x, digits) for x in values]


def _power(value: float, digits: int) -> str:
    """Format a number as a power of ten, to so many decimal places of the number itself."""
    if not math.isfinite(value):
        return "-"
    if abs(value) < 0.5 * 10.0**-digits:
        return "0"
    return f"{value:.{max(0, math.floor(math.log10(abs(value))) + digits)}e}"


def percent(share: float, *, signed: bool = False) -> str:
    """Return a share in per cent with one decimal place, or with one digit if that is all 0."""
    digits = 1 if share == 0 else max(1, -math.floor(math.log10(100 * abs(share))))
    return f"{100 * share:{'+' if signed else ''}.{min(digits, 6)}f} %"


def fixed(value: float, digits: int) -> str:
    """Format a number with decimal places; - if not finite."""
    if not math.isfinite(value):
        return "-"
    text = f"{value:.{digits}f}"
    return text.removeprefix("-") if float(text) == 0 else text
