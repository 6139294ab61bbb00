"""Quantities that a result stores, windows of time, swept keys, and how they are written."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, field, replace
from enum import Enum, auto
from functools import cached_property, partial
from typing import Any, Literal

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError, ExpressionError
from eqt_cli.base.reporting import NOTHING, fixed
from eqt_cli.base.stored import Attribute, Better, Signal, Symbol, signal_of
from eqt_cli.numbers.running import SampledRuns

# Windows of time over which quantities are taken --------------------------------------------------


@dataclass(frozen=True)
class Window:
    """A window of time relative to the start of the runs.

    Attributes
    ----------
    start, stop
        Ends of the window, s; an infinite `stop` means the end of the horizon.
    """

    start: float = 0.0
    stop: float = math.inf

    @classmethod
    def parse(cls, text: str) -> Window:
        """Parse ``0:5``, ``5:`` or ``:5``; ``:`` is the whole horizon.

        Raises
        ------
        EqtError
            If the text has another form, or the window is empty.
        """
        start, colon, stop = text.partition(":")
        try:
            window = cls(float(start or 0), float(stop or math.inf))
        except ValueError:
            colon = ""
        if not colon or math.isnan(window.start) or math.isnan(window.stop):
            raise EqtError(
                f"window '{text}': expected START:STOP in seconds, as 0:5, 5: or : for all of it"
            )
        if not 0 <= window.start < window.stop or math.isinf(window.start):
            raise EqtError(f"window '{text}': expected 0 <= START < STOP")
        return window

    def within(self, times: Array) -> Window:
        """Return the window, cut at the last sample.

        Raises
        ------
        EqtError
            If it begins only after the last sample.
        """
        horizon = float(times[-1] - times[0])
        if self.start >= horizon:
            raise EqtError(
                f"window '{self}' begins after the end of the runs; they last {horizon:g} s"
            )
        return Window(self.start, min(self.stop, horizon))

    def cut(self, times: Array, values: Array, held: bool = False) -> tuple[Array, Array]:
        """Return the samples within the window, with linearly interpolated values at its ends.

        Values that are `held` between samples are not interpolated.

        A window that ends after the last sample is cut there.

        Parameters
        ----------
        times : (samples,)
        values : (runs, samples, ...)

        Raises
        ------
        EqtError
            If the window begins only after the last sample.
        """
        window = self.within(times)
        start, stop = times[0] + window.start, times[0] + window.stop
        tolerance = 1e-9 * (times[-1] - times[0])
        inside = np.flatnonzero((times >= start - tolerance) & (times <= stop + tolerance))
        cut_times, cut = times[inside], values[:, inside]
        if not inside.size or cut_times[0] > start + tolerance:
            cut_times = np.concatenate([[start], cut_times])
            cut = np.concatenate([_at(times, values, start, held)[:, None], cut], axis=1)
        if cut_times[-1] < stop - tolerance:
            cut_times = np.concatenate([cut_times, [stop]])
            cut = np.concatenate([cut, _at(times, values, stop, held)[:, None]], axis=1)
        return cut_times, cut

    @property
    def words(self) -> str:
        """`` from 20 s``, as it follows a name; empty for the whole horizon."""
        if math.isinf(self.stop):
            return f" from {self.start:g} s" if self.start else ""
        return f" {self.start:g}–{self.stop:g} s"

    def __str__(self) -> str:
        stop = "" if math.isinf(self.stop) else f"{self.stop:g}"
        return f"{self.start:g}:{stop}"


WHOLE = Window()
"""The whole horizon."""


def _at(times: Array, values: Array, t: float, held: bool) -> Array:
    """Interpolate values at one time between two samples, or return the earlier, if they hold."""
    right = int(np.clip(np.searchsorted(times, t), 1, len(times) - 1))
    fraction = (t - times[right - 1]) / (times[right] - times[right - 1])
    fraction *= not held
    return (1 - fraction) * values[:, right - 1] + fraction * values[:, right]


# Quantities: what is shown of them, and how they follow from signals -----------------------------


FLOAT = np.dtype("f8")

NO_SYMBOL = Symbol("", "")

LAST_RESORT = 9
"""Rank of a number that comes first only where a result has no other one of its role."""


class ValuePer(Enum):
    """The items for each of which a quantity has a value."""

    TRAJECTORY = auto()
    """Every run of every controller with a stored trajectory; the first of its dims is time."""
    DESIRED = auto()
    """The experiment, or the point of a sweep; the first of its dims is time."""
    INITIAL = auto()
    """Every initial state, which the controllers share."""
    RUN = auto()
    """Every run of every controller."""


@dataclass(frozen=True)
class Quantity:
    r"""A quantity as tables and figures show it.

    Attributes
    ----------
    name
        Name in result files and for commands.
    long_name
        Description in words, and the attribute in a result file.
    units
        Unit in terms of the unit of its signal, written ``{}``: ``({})^2 s``. In the quantities of
        a result, the unit itself. Empty for text.
    symbol
        Symbol; by default that of its first signal, empty without a signal.
    label
        Short name, with ``{}`` for the symbol: ``mean {}``; the long name if empty.
    formula
        Formula, with ``{}`` for the symbol, if the label does not show it: ``\int {}^2``.
    better
        Which values are better.
    counts
        Whether the values are 0 or 1, so that their mean is a share of the runs.
    role
        What it tells where laws are compared first: their error, or what they cost.
    rank
        Its place among the numbers that come first where laws are compared, or among the signals
        that a page draws; 0 of all others, and −1 of those that are omitted where space is limited.
    """

    name: str
    long_name: str
    units: str = "{}"
    symbol: Symbol = NO_SYMBOL
    label: str = ""
    formula: Symbol = NO_SYMBOL
    better: Better = "neither"
    counts: bool = False
    role: Literal["", "error", "cost"] = ""
    rank: int = 0

    def cost(self, values: Any) -> Any:
        """Return the values, or their negatives if higher is better; its own inverse."""
        return -values if self.better == "higher" else values

    def unit(self, of_signal: str) -> str:
        """Return its unit for a unit of its signal: (N m)^2 s for N m, N^2 s for N.

        ``mixed`` stays ``mixed``, and a square of 1 is omitted.
        """
        pattern = self.units
        if of_signal == "mixed" and "{}" in pattern:
            return of_signal
        if of_signal == "1":
            pattern = pattern.removeprefix("({})^2 ")
        return (pattern.replace("({})", "{}") if of_signal.isalpha() else pattern).format(of_signal)

    @property
    def plain(self) -> str:
        """Short name in plain characters: ``mean ‖τ‖``, ``effort from 20 s``."""
        return self._name + self.when

    @property
    def described(self) -> str:
        """Short name and formula in plain characters: ``effort ∫‖τ‖² dt``."""
        formula = self.formula.plain.replace("{}", self.symbol.plain)
        return f"{self._name} {formula}".rstrip() + self.when

    @property
    def _name(self) -> str:
        return self.label.replace("{}", self.symbol.plain) or self.long_name

    @property
    def when(self) -> str:
        """The window in words; empty where it is the whole run, or where the name says it."""
        return ""


@dataclass(frozen=True)
class Measure(Quantity):
    """A row of the table of quantities: how one follows from signals, and how files hold it.

    Attributes
    ----------
    per
        Items for each of which there is a value.
    signals
        Signals from which it is computed. The first one gives its unit, symbol and parts.
    dims, dtype
        Its dimensions besides those of `per`, and its type; None for text.
    stored
        Whether result files hold it; else it is computed from trajectories on request.
    of
        ``(times, *signals, **settings) -> (runs,)`` for signals ``(runs, samples, …)`` within the
        window; None if the run itself provides the value.
    settings
        Keys of the configuration that are arguments of `of`, by the names of the arguments, which
        are also those of attributes in a file.
    choices
        Keys of the configuration that change the row itself, by names of attributes in a file.
    chosen
        Returns the fields that they change.
    window
        Window over which it is taken.
    compared
        Default windows for comparisons of controllers.
    censored
        Whether NaN in a good run means: later than the end of the run.
    implied_by
        Another number per run from which this one follows if a file does not hold it: it has a
        value where this one is 1.
    constraint
        Whether it judges a constraint, between samples, too; then always over whole runs.
    notes
        Further attributes in a result file.
    stored_of
        Whether result files hold it for a vehicle.
    """

    per: ValuePer = ValuePer.RUN
    signals: tuple[str, ...] = ()
    dims: tuple[str, ...] = ()
    dtype: np.dtype[Any] | None = FLOAT
    stored: bool = True
    of: Callable[..., Any] | None = None
    settings: Mapping[str, str] = field(default_factory=dict)
    choices: Mapping[str, str] = field(default_factory=dict)
    chosen: Callable[..., Mapping[str, Any]] = dict
    window: Window = WHOLE
    compared: tuple[Window, ...] = ()
    censored: bool = False
    implied_by: str = ""
    constraint: bool = False
    notes: Mapping[str, Attribute] = field(default_factory=dict)
    stored_of: Callable[[Any], bool] = lambda vehicle: True

    def __post_init__(self) -> None:
        if self._signal is not None and self.symbol == NO_SYMBOL:
            object.__setattr__(self, "symbol", self._signal.symbol)

    def with_choices(self, values: Mapping[str, Any]) -> Measure:
        """Return the row for values of a configuration or a file; None keeps the default.

        Values that no configuration accepts are ignored.
        """
        choices = {
            name: float(values[name])
            for name in self.choices
            if isinstance(values.get(name), int | float | np.number) and 0 < values[name] < np.inf
        }
        return replace(self, **self.chosen(**choices)) if choices else self

    @property
    def windowed(self) -> bool:
        """Whether it can be taken over any window, not only over its own."""
        is_stored = all(signal_of(name) for name in self.signals)
        is_of_all = self.constraint or self._has_own_window or bool(self.settings)
        return self.of is not None and is_stored and not is_of_all

    @property
    def _has_own_window(self) -> bool:
        return "window_s" in self.choices

    @property
    def when(self) -> str:
        return "" if self._has_own_window else self.window.words

    @property
    def is_own(self) -> bool:
        """Whether it is a metric of the user's own; the file, too, then says which is better."""
        return "better" in self.notes

    @property
    def parted(self) -> bool:
        """Whether it has values for the parts of a norm, such as rotation and translation."""
        return self._of_norm and (self.windowed or self.per is ValuePer.TRAJECTORY)

    @property
    def stored_by_part(self) -> bool:
        """Whether result files hold it for the parts of a norm if their units differ."""
        is_number = self.per is ValuePer.RUN and self.of is not None and not self.settings
        return is_number and self.stored and self._of_norm

    def hold(self, holds: Mapping[str, float]) -> float:
        """Return the time between two changes of its first signal, s; 0 if that is not held."""
        return holds.get(self._signal.name, 0.0) if self._signal else 0.0

    @property
    def _signal(self) -> Signal | None:
        return signal_of(self.signals[0]) if self.signals else None

    @property
    def _of_norm(self) -> bool:
        return self._signal is not None and bool(self._signal.norm)

    @property
    def attributes(self) -> dict[str, Attribute]:
        """Attributes of the variable in a result file."""
        about: dict[str, Attribute] = {"units": self.units} if self.units else {}
        if self._has_own_window:
            about |= {"long_name": self.long_name, "window_s": self.window.stop}
            return {**about, **self.notes}
        ends = {f"{end}_s": getattr(self.window, end) for end in ("start", "stop")}
        changed = {key: x for key, x in ends.items() if x not in (WHOLE.start, WHOLE.stop)}
        words = self.long_name.removesuffix(" over the horizon") if changed else self.long_name
        return {**about, "long_name": words + self.when, **changed, **self.notes}

    def part(self, name: str) -> Measure:
        """Return the same quantity for one part of its norm, such as ``rotation``."""
        words = name.replace("_", " ")
        inside = self.label.replace("{}", f"{{}} {words}")
        return replace(
            self,
            name=f"{self.name}_{name}",
            long_name=f"{self.long_name}, {name} part",
            signals=(f"{self.signals[0]}_{name}", *self.signals[1:]),
            label=inside if "{}" in self.label else f"{self.label} {words}",
            stored=self.per is ValuePer.TRAJECTORY,
        )

    def measure(
        self, over: SampledRuns, signals: Mapping[str, Any], window: Window, **settings: float
    ) -> Any:
        """Compute its value in every run over a window, ``(runs,)``.

        Parameters
        ----------
        over
            The samples.
        signals
            Arrays ``(runs, samples, …)`` by name, or symbols for one sample of them.
        settings
            Values of the arguments in `settings`.

        Raises
        ------
        EqtError
            If the window starts after the last sample.
        """
        assert self.of is not None
        columns = [signals[name] for name in self.signals]
        window, hold = window.within(over.times), self.hold(over.holds)
        if window != WHOLE.within(over.times):
            over, columns = over.within(partial(window.cut, held=hold > 0), columns)
        over = copy(over)
        over.hold = hold
        return self.of(over, *columns, **settings)


# How quantities and numbers are written in tables, as plain text and in LaTeX ---------------------


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
    best_is = "*"

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

    def best(self, text: str) -> str:
        """Return the best number of several."""
        return self.best_is + text

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
    best_is = "bold"

    def text(self, words: str) -> str:
        return words.translate(str.maketrans(_LATEX))

    def name(self, quantity: Quantity) -> str:
        label = self.text(quantity.long_name.replace("||", "‖"))
        if quantity.label:
            label = quantity.label.replace("{}", f"${quantity.symbol.latex}$")
        formula = quantity.formula.latex.replace("{}", quantity.symbol.latex)
        when = quantity.when.replace("–", "--").replace(" s", r"\,s")
        return (f"{label} ${formula}$" if formula else label) + when

    def unit(self, unit: str) -> str:
        if unit in ("", "1", "mixed"):
            return super().unit(unit)
        return rf"$\mathrm{{{unit.replace(' ', chr(92) + ',')}}}$"

    def window(self, window: Window) -> str:
        return rf"{window.start:g}--{window.stop:g}\,s"

    def best(self, text: str) -> str:
        return rf"\textbf{{{text}}}"

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
    largest *= largest >= NOTHING
    has_interval = math.isfinite(half_width) and half_width > 0
    if not (has_interval or largest):
        return [fixed(x, 3) for x in values]
    digits = (1 if has_interval else 2) - math.floor(
        math.log10(half_width if has_interval else largest)
    )
    if DECIMAL[0] <= largest < DECIMAL[1]:
        return [fixed(x, min(12, max(0, digits))) for x in values]
    texts = []
    for value in values:
        if not math.isfinite(value):
            texts.append("-")
        elif abs(value) < 0.5 * 10.0**-digits:
            texts.append("0")
        else:  # so many decimal places of the number itself
            texts.append(f"{value:.{max(0, math.floor(math.log10(abs(value))) + digits)}e}")
    return texts


# Swept keys with their values as figures and tables show them -------------------------------------


@dataclass(frozen=True)
class SweptKey:
    """A key that takes several values in a sweep.

    Attributes
    ----------
    key
        Key of the configuration.
    values : (points,)
        Values as numbers; texts and matrices are numbered.
    texts
        Texts to display for the numbers: the numbered values, or expressions such as π/2.
    asks_log
        Whether the range of the sweep is logarithmic.
    unit
        The unit with which all values are written; empty if the key has its own unit.
    is_number
        Whether the values are numbers; else they number texts or matrices.
    label, unit_of_key
        Name of the key on an axis, with ``$…$`` for symbols, and its own unit; may be empty.
    """

    key: str
    values: Array
    texts: dict[float, str]
    asks_log: bool = False
    unit: str = ""
    is_number: bool = True
    label: str = ""
    unit_of_key: str = ""

    @property
    def levels(self) -> list[int]:
        """Values numbered in the order of their first occurrence."""
        numbers: dict[float, int] = {}
        return [numbers.setdefault(value, len(numbers)) for value in self.values.tolist()]

    @property
    def logarithmic(self) -> bool:
        """Whether the values are spread on a logarithmic scale rather than a linear one."""
        levels = np.unique(self.values)
        if self.asks_log:
            return True
        if not self.is_number or len(levels) < 3 or levels[0] <= 0:
            return False
        return bool(np.ptp(np.diff(np.log(levels))) / np.log(levels[-1] / levels[0]) < 1e-6)

    @property
    def in_degrees(self) -> SweptKey:
        """The key with angles in degrees, unless they are written in a unit or as expressions."""
        if self.unit_of_key != "rad" or self.unit or self.texts:
            return self
        return replace(self, values=np.degrees(self.values), unit="deg")

    def value(self, point: int) -> float | str:
        """Return the value at a point as configured."""
        value = float(self.values[point])
        return f"{value:g} {self.unit}" if self.unit else self.texts.get(value, value)

    @cached_property
    def names(self) -> dict[float, str]:
        """`texts` as figures and tables show them: what of mappings and lists differs, in words."""
        if self.is_number:
            return self.texts
        return dict(zip(self.texts, briefly(list(self.texts.values())), strict=True))

    def named(self, point: int) -> float | str:
        """`value`, with what stands for a text in figures and tables."""
        return self.names.get(float(self.values[point]), self.value(point))

    def at(self, point: int) -> str:
        """Return the value at a point as text."""
        value = self.named(point)
        return value if isinstance(value, str) else f"{value:.4g}".replace("-", "−")


def with_unit(text: str) -> tuple[float, str] | None:
    """Return number and unit of ``90 deg``; None for other texts."""
    from eqt_cli.base.expressions import constant
    from eqt_cli.base.units import split

    if parts := split(text):
        with suppress(ExpressionError):
            return constant(parts[0]), parts[1]
    return None


def constant_of(text: str) -> tuple[float, str] | None:
    """Return number and display of an expression such as ``"-pi/2"``; None for other texts."""
    from eqt_cli.base.expressions import constant

    plain = text.strip('"')
    with suppress(ExpressionError):
        return constant(plain), plain.replace("*pi", "π").replace("pi", "π").replace("-", "−")
    return None


def briefly(texts: Sequence[str]) -> list[str]:
    """JSON in as few words as tell the texts apart; ``lag, 0.05`` for a mapping.

    Of mappings, what all have in common is left out.
    """
    values: list[Any] = []
    for text in texts:
        try:
            values.append(json.loads(text))
        except (ValueError, RecursionError):
            values.append(text)
    words = [_in_words(value) for value in _differing(values)]
    return words if len(set(words)) == len(texts) else [_in_words(value) for value in values]


def _differing(values: list[Any]) -> list[Any]:
    """Mappings, or lists of one each, without the entries that all have in common."""
    if all(isinstance(value, list) and len(value) == 1 for value in values):
        return _differing([value[0] for value in values])
    if len(values) < 2 or not all(isinstance(value, dict) for value in values):
        return values
    first, *others = values
    same = {key for key in first if all(key in one and one[key] == first[key] for one in others)}
    left = [{key: value[key] for key in value if key not in same} for value in values]
    if len({key for value in left for key in value}) == 1 and all(left):
        return _differing([value[key] for value in left for key in value])
    return left


def _in_words(value: Any) -> str:
    """Without quotes, and without the braces around a mapping."""
    if isinstance(value, dict):
        kinds = [str(value["kind"])] if "kind" in value else []
        named = {key.replace("_", " "): entry for key, entry in value.items() if key != "kind"}
        others = (f"{key} {_in_words(entry)}" for key, entry in named.items())
        return ", ".join([*kinds, *others]) or "none"
    if isinstance(value, list):
        if len(value) == 1 and isinstance(value[0], dict):
            return _in_words(value[0])
        inner = (
            f"{{{_in_words(one)}}}" if isinstance(one, dict) else _in_words(one) for one in value
        )
        return f"[{', '.join(inner)}]" if value else "none"
    if isinstance(value, float | int) and not isinstance(value, bool):
        return f"{value:g}".replace("-", "−")
    return value if isinstance(value, str) else json.dumps(value)
