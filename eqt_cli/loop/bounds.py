"""Bounds of errors at which runs end as failed: the section `failed_when`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np

from eqt_cli.base.arrays import absolute, less, maximum
from eqt_cli.base.errors import Problems, suggestion
from eqt_cli.base.option_types import Written, number_of, shown
from eqt_cli.base.units import base_of, factor, offered
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.loop.signals import existing

SHORT = {
    "position": "position_error",
    "attitude": "attitude_angle",
    "pointing": "pointing_error",
    "heading": "heading_error",
    "velocity": "velocity_error_translation",
    "rate": "velocity_error_rotation",
}
"""Errors by the words of a user, and the signals that they are."""


@dataclass(frozen=True)
class Bounds:
    """The largest sizes of signals, at which a run ends as failed.

    Attributes
    ----------
    most, units
        By the names of signals: their bounds, in their units.
    """

    most: Mapping[str, float]
    units: Mapping[str, str]

    def crossed(self, value_of: Callable[[str], Any]) -> Any:
        """Return whether an error is beyond its bound, by the values of signals at an instant."""
        return less(1.0, reduce(maximum, self.shares([value_of(name) for name in self.most])))

    def shares(self, values: Sequence[Any]) -> list[Any]:
        """Return the sizes of the signals, each divided by its bound."""
        return [absolute(x) / most for x, most in zip(values, self.most.values(), strict=True)]


def read(
    written: Mapping[str, Any], loops: Mapping[str, ClosedLoop], problems: Problems
) -> dict[str, float]:
    """Return bounds in m, rad, s, N, …, by the names of signals, from those of a user."""
    by_law = {label: signals_of(loop) for label, loop in loops.items()}
    units, (part, *others) = next(iter(by_law.values())), next(iter(loops.values())).group.parts
    of_it = "" if others else f"_{part.name}"  # of the only part there is no signal of its own
    words = {word: name.removesuffix(of_it) for word, name in SHORT.items()}
    words = {word: name for word, name in words.items() if name in units}
    usual, most = [*words, *units], dict[str, float]()
    if not written:
        problems.add(f"expected at least one bound of {', '.join(usual)}")
    for word, value in written.items():
        here, name = problems.at(word), words.get(word, word)
        lacking = [label for label, of_law in by_law.items() if name not in of_law]
        if len(lacking) == len(loops):
            hint = suggestion(word, usual) or f"; expected some of {', '.join(usual)}"
            here.add(f"no error that all laws have{hint}")
        elif lacking:
            here.add(f"{', '.join(lacking)} has no {name}, and a bound is for every law")
        elif name in most:
            here.add(f"is {name}, which has a bound already; remove one")
        else:
            most[name] = _positive(value, units[name], here)
    return most


def bounds_of(most: Mapping[str, float], loop: ClosedLoop) -> Bounds:
    """Return bounds as `read` gives them, for a loop."""
    units = signals_of(loop)
    in_units = {k: x * (factor(base_of(units[k]), units[k]) or 1.0) for k, x in most.items()}
    return Bounds(in_units, {name: units[name] for name in most})


def signals_of(loop: ClosedLoop) -> dict[str, str]:
    """Return the units of the signals of one number that a loop has, by name."""
    return {
        name: signal.unit_in(part) if part else signal.units(loop.group)
        for name, (signal, part) in existing(loop).items()
        if not signal.dims and signal.exists_for(loop) and not signal.only_there
    }


def _positive(value: Any, unit: str, problems: Problems) -> float:
    """Return a number in the unit in which eqt keeps it; note what is none above 0."""
    base = base_of(unit)
    try:
        number = number_of(Written(value, [base]) if isinstance(value, str) else value)
    except ValueError as error:
        problems.add(str(error))
        return 1.0
    if not isinstance(number, int | float) or isinstance(number, bool) or not 0 < number < np.inf:
        problems.add(f"expected {offered(base)}, greater than 0, got {shown(value)}")
        return 1.0
    if unit == "deg" and number >= np.pi:
        problems.add(
            f"no angle is above 180 deg, and {shown(value)} is {np.degrees(number):.6g} deg; a "
            f"number without a unit is in rad: write '{shown(value)} deg'"
            if not isinstance(value, str)
            else f"expected an angle below 180 deg, got {value}"
        )
    return float(number)
