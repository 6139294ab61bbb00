"""What a quantity of a result is: its names, its unit, and how it follows from signals."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum, auto
from functools import partial
from typing import Any, Literal

import numpy as np

from eqt_cli.closed_loop.signals import signal_of
from eqt_cli.core.over_time import OverTime
from eqt_cli.results.time_windows import WHOLE, Window
from eqt_cli.store.table import Attribute
from eqt_cli.vehicle import Vehicle

FLOAT = np.dtype("f8")

Better = Literal["lower", "higher", "neither"]
"""Which values of a quantity are the better ones."""

_IN_PLAIN = (
    (r"_{\mathrm{F}}", ""),
    (r"\,\mathrm{d}t", " dt"),
    (r"\mathcal{L}", "L"),
    (r"\sqrt{L}", "√L"),
    (r"\|", "‖"),
    (r"\tau", "τ"),
    (r"\int ", "∫"),
    (r"\langle ", "⟨"),
    (r" \rangle", "⟩"),
    ("^2", "²"),
    ("-", "−"),
)
"""The mathematics of symbols and formulas, and the characters that stand for it."""


class ValuePer(Enum):
    """What a quantity has one value for, before its own dimensions."""

    TRAJECTORY = auto()
    """Every run of every controller whose trajectory is kept; the first of its dims is time."""
    DESIRED = auto()
    """The experiment, or the point of a sweep; the first of its dims is time."""
    INITIAL = auto()
    """Every initial state, which the controllers share."""
    RUN = auto()
    """Every run of every controller."""


@dataclass(frozen=True)
class Quantity:
    r"""A row of the table of quantities.

    Attributes
    ----------
    name
        As in a result file, and as commands take it.
    long_name
        What it is, in words; the attribute in a result file.
    per
        What there is one value for.
    units
        In terms of the unit of its signal, for which ``{}`` stands: ``({})^2 s``. In the quantities
        of a result, the unit itself. Nothing for text.
    signals
        The signals that it is computed from; it takes unit, symbol and parts of the first.
    own_symbol
        In LaTeX, where it is not that of the first signal.
    label
        Its short name, with ``{}`` for the symbol: ``mean {}``; the long name if empty.
    formula
        In LaTeX, with ``{}`` for the symbol, where the label does not say it: ``\int {}^2``.
    better
        Which values are the better ones.
    dims, dtype
        Its dimensions beyond those that `per` stands for, and its type; None for text.
    stored
        A result file holds it; all others are computed from trajectories when asked for.
    of
        ``(times, *signals, **settings) -> (runs,)``, of signals ``(runs, samples, …)`` within the
        window; None where the run itself hands it over.
    settings
        Keys of the configuration that `of` takes, by the names of arguments and of attributes.
    choices
        Keys of the configuration that change the row itself, by names of attributes in a file.
    chosen
        The fields that they change.
    window
        Over which it is taken; where that is the whole run, it can be taken over any other as well.
    compared
        The windows over which controllers are compared by it unless a user chooses.
    censored
        NaN in a run that is good says: later than the end of the run.
    counts
        Its values are 0 or 1, and their mean is a share of the runs.
    told_by
        Where a file does not hold it: another number per run, which has a value where this is 1.
    of_turns
        It is there only where the norm is a distance ‖I − R‖_F of rotations.
    diagnostic
        It says how good the numbers are, and is left out where there is no room for all.
    stored_of
        The vehicles of whose runs a result file holds it.
    notes
        Further attributes in a result file.
    """

    name: str
    long_name: str
    per: ValuePer = ValuePer.RUN
    units: str = "{}"
    signals: tuple[str, ...] = ()
    own_symbol: str = ""
    label: str = ""
    formula: str = ""
    better: Better = "neither"
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
    counts: bool = False
    told_by: str = ""
    of_turns: bool = False
    diagnostic: bool = False
    notes: Mapping[str, Attribute] = field(default_factory=dict)
    stored_of: Callable[[Vehicle], bool] = lambda vehicle: True

    def with_choices(self, values: Mapping[str, Any]) -> Quantity:
        """The row that values, of a configuration or a file, make of it; None leaves the default.

        What is no number that a configuration takes is ignored.
        """
        known = {
            name: float(values[name])
            for name in self.choices
            if isinstance(values.get(name), int | float | np.number) and 0 < values[name] < np.inf
        }
        return replace(self, **self.chosen(**known)) if known else self

    @property
    def windowed(self) -> bool:
        """Whether it can be taken over any window, and not only over its own."""
        known = all(signal_of(name) for name in self.signals)
        return self.of is not None and known and self.window == WHOLE and not self.settings

    @property
    def parted(self) -> bool:
        """Whether it has values for the parts of a norm, such as rotation and translation."""
        return self._of_norm and (self.windowed or self.per is ValuePer.TRAJECTORY)

    @property
    def stored_by_part(self) -> bool:
        """Whether a result file holds it for the parts of a norm that have units of their own."""
        is_number = self.per is ValuePer.RUN and self.of is not None and not self.settings
        return is_number and self.stored and self._of_norm

    @property
    def _of_norm(self) -> bool:
        signal = signal_of(self.signals[0]) if self.signals else None
        return signal is not None and signal.of_part is not None

    @property
    def symbol(self) -> str:
        """In LaTeX: its own, or that of its first signal; nothing without a signal."""
        signal = signal_of(self.signals[0]) if self.signals else None
        return self.own_symbol or (signal.symbol if signal else "")

    def cost(self, values: Any) -> Any:
        """The values, or their negatives where more of it is better; undoes itself."""
        return -values if self.better == "higher" else values

    @property
    def attributes(self) -> dict[str, Attribute]:
        """What a result file says of it."""
        units = {"units": self.units} if self.units else {}
        window = {} if self.window == WHOLE else {"window_s": self.window.stop}
        return {**units, "long_name": self.long_name, **window, **self.notes}

    def unit(self, of_signal: str) -> str:
        """Its unit where its signal has this one: (N m)^2 s of N m, N^2 s of N.

        ``mixed`` gives ``mixed``, and 1 is left out of squares.
        """
        pattern = self.units
        if of_signal == "mixed" and "{}" in pattern:
            return of_signal
        if of_signal == "1":
            pattern = pattern.removeprefix("({})^2 ")
        return (pattern.replace("({})", "{}") if of_signal.isalpha() else pattern).format(of_signal)

    @property
    def plain(self) -> str:
        """Its short name in plain characters: ``mean ‖τ‖``, ``effort``."""
        return self.label.replace("{}", plain(self.symbol)) or self.long_name

    @property
    def plain_formula(self) -> str:
        """Its formula in plain characters; nothing where the short name says it."""
        return plain(self.formula.replace("{}", self.symbol))

    @property
    def described(self) -> str:
        """Short name and formula in plain characters: ``effort ∫‖τ‖² dt``."""
        return f"{self.plain} {self.plain_formula}".rstrip()

    def part(self, name: str) -> Quantity:
        """The same of one part of its norm: ``rotation``."""
        words = name.replace("_", " ")
        inside = self.label.replace("{}", f"{{}} {words}")
        return replace(
            self,
            name=f"{self.name}_{name}",
            long_name=f"{self.long_name}, {name} part",
            signals=(f"{self.signals[0]}_{name}", *self.signals[1:]),
            label=inside if "{}" in self.label else f"{self.label} {words}",
            stored=self.per is ValuePer.TRAJECTORY,
            chosen=partial(self._chosen_of_part, name),
        )

    def _chosen_of_part(self, part: str, **known: float) -> dict[str, Any]:
        fields = self.chosen(**known)
        found = replace(self, **fields).part(part)
        return {name: getattr(found, name) for name in fields}

    def measure(
        self, over: OverTime, signals: Mapping[str, Any], window: Window, **settings: float
    ) -> Any:
        """Its value in every run over a window, ``(runs,)``.

        Parameters
        ----------
        over
            The samples.
        signals
            Arrays ``(runs, samples, …)`` by name, or what stands for one sample of them.
        settings
            What `settings` names.

        Raises
        ------
        EqtError
            If the window begins only after the last sample.
        """
        assert self.of is not None
        columns = [signals[name] for name in self.signals]
        window = window.within(over.times)
        if window != WHOLE.within(over.times):
            over, columns = over.within(window.cut, columns)
        return self.of(over, *columns, **settings)

    def is_same_as(self, other: Quantity) -> bool:
        """Whether both are one number wherever they are taken over one window."""
        return self.name == other.name or (
            self.of is not None and (self.of, self.signals) == (other.of, other.signals)
        )


def plain(latex: str) -> str:
    r"""A symbol or formula in plain characters: ``‖I − Q_E‖`` of ``\|I - Q_E\|_{\mathrm{F}}``."""
    for command, characters in _IN_PLAIN:
        latex = latex.replace(command, characters)
    return latex
