"""Rewards and ends of episodes: a stored metric, or a function of signals, if possible in C."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from eqt_cli.base.arrays import Array, Arrays, where
from eqt_cli.base.errors import EqtError, suggestion
from eqt_cli.base.registry import described
from eqt_cli.engines.native import held_rows, sampled
from eqt_cli.extensions.gym.sources import text_of
from eqt_cli.extensions.gym.stepping import Plant
from eqt_cli.extensions.gym.symbolic import symbolic
from eqt_cli.extensions.gym.trial import Terms, Trial
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.loop.signals import existing, holds, outputs_of, values_at
from eqt_cli.numbers.program import COMPARISONS, Constant, Program
from eqt_cli.results.metrics import QUANTITIES, effort, integral_of_square, time_mean
from eqt_cli.results.quantity import Measure

ADDED = time_mean, effort, integral_of_square
"""Formulas of metrics that are sums over the steps: a mean, and integrals of squares."""

Function = Callable[["Step"], Any]
"""What a user gives: from the signals behind a step to a number, or a condition, for each run."""


class Step:
    """What a function of the user reads behind a step, an array with an entry for each run.

    Every signal by its name, as ``x.pose_error``, exactly and not as measured.

    Attributes
    ----------
    t
        Time, s.
    action, last_action : (..., k)
        What the policy gave in this step and in the one before, within its limits.
    """

    def __init__(self, value: Callable[[str], Array], t: Any, action: Array, last: Array) -> None:
        self._value, self.t, self.action, self.last_action = value, t, action, last

    def __getattr__(self, name: str) -> Array:
        if name.startswith("_"):
            raise AttributeError(name)
        return self._value(name)


@dataclass(frozen=True)
class Signals:
    """Signals of the loop by name, as a function that an engine traces."""

    names: tuple[str, ...]

    def __call__(self, loop: ClosedLoop, t: Any, state: Array) -> Arrays:
        """Return them."""
        values = values_at(loop, loop.tracking(t, state), state, self.names)
        return {name: values[name] for name in self.names}


@dataclass(frozen=True)
class OfFunction:
    """A function of the user, as one that an engine traces, and the signals that it may read."""

    function: Function
    names: frozenset[str]

    def __call__(
        self, loop: ClosedLoop, t: Any, state: Array, action: Array, last: Array
    ) -> Arrays:
        """Return its numbers, 1 or 0 of a condition, in their order."""
        s = loop.tracking(t, state)

        def signal(name: str) -> Array:
            if name not in self.names:
                raise KeyError(name)  # it would be NaN, and no condition of it would hold
            return symbolic(values_at(loop, s, state, (name,))[name])

        time = np.empty(1, dtype=object)
        time[0] = t
        step = Step(signal, symbolic(time), symbolic(action), symbolic(last))
        terms = terms_in(self.function(step)).values()
        return {f"term{k}": _of_symbols(value) for k, value in enumerate(terms)}


def terms_in(value: Any) -> dict[str, Any]:
    """Return what a function gives by name; a single number has the name ""."""
    return dict(value) if isinstance(value, Mapping) else {"": value}


def _of_symbols(value: Any) -> Array:
    """Return the number of a run, 1 or 0 of a condition; a `ValueError` of another shape."""
    array = np.asarray(value)
    first = array.ravel()[0]
    if array.shape == () and not isinstance(first, int | float | np.number | np.bool_):
        raise ValueError("a sum over all environments")
    if array.shape not in ((), (1,)):
        raise ValueError("no number of a run")
    if getattr(first, "name", "") in COMPARISONS:  # of `less`
        array = where(array, 1.0, 0.0)
    return array.reshape(1, 1) * 1.0 if array.dtype == bool else array.reshape(1, 1) + 0.0


class Evaluated:
    """Signals, or a function of the user, in the states of a plant.

    Attributes
    ----------
    names
        Names of the numbers that the function gives; "" of a single one.
    is_compiled
        Whether all of it is C.
    """

    def __init__(self, plant: Plant, function: Any, what: str) -> None:
        self._plant, self._what, self._function = plant, what, function
        self._signals = dict[str, tuple[Any, Array]]()
        lengths = (plant.loop.state_length, plant.actions, plant.actions)
        of_function = OfFunction(function, frozenset(signals_of(plant.loop)))
        program = sampled(of_function, plant.loop, lengths)
        # A number that no signal changes has no shape.
        self._constant = program is not None and _is_constant(program)
        self.trial = Trial(plant, function, what, self._terms, self._program_of)
        self.names = [*self.trial.values]
        self._program: tuple[Program, Array] | None = None
        if program is not None:
            held = held_rows(plant.loop, plant.starts, program)
            if self.trial.agrees(program, held):
                self._program = program, held
        self.is_compiled = self._program is not None

    def __call__(self, action: Array, last: Array) -> dict[str, Array]:
        """Return its numbers of each run by name, ``(runs,)`` each."""
        plant = self._plant
        if self._program:
            arrays = plant.evaluate(*self._program, (action, last)).values()
            return {name: x[:, 0] for name, x in zip(self.names, arrays, strict=True)}
        return self._terms(self.signal, plant.time, action, last)

    def _terms(self, signal: Callable[[str], Array], t: Array, action: Array, last: Array) -> Terms:
        """Return the numbers that the function gives of some signals."""
        try:
            terms = terms_in(self._function(Step(signal, t, action, last)))
            values = {str(name): plain(value) for name, value in terms.items()}
        except EqtError:
            raise
        except Exception as error:
            raise EqtError(
                f"{self._what}: the function fails: {described(error)}; it takes one argument, "
                "whose signals are arrays of a number for each run, so that np.where replaces if"
            ) from error
        if not values:
            raise EqtError(f"{self._what}: expected a number for each run, got no terms")
        for name, value in values.items():
            if self._constant and value.shape == ():
                values[name] = value = np.full(len(t), float(value))
            if value.shape != (len(t),) or value.dtype.kind not in "fiub":
                raise EqtError(
                    f"{self._what}{f' {name!r}' if name else ''}: expected a number for each run, "
                    f"of shape ({len(t)},), got {value.dtype} of shape {value.shape}; the first "
                    "axis counts the environments, so sum over the last axis, as "
                    "(x.action**2).sum(axis=-1)"
                )
        return values

    def signal(self, name: str) -> Array:
        """Return a signal of the loop in the states of the plant."""
        program, held = self._program_of(name)
        return self._plant.evaluate(program, held)[name]

    def _program_of(self, name: str) -> tuple[Any, Array]:
        if name not in self._signals:
            self._signals[name] = signal_program(self._plant, name, self._what)
        return self._signals[name]


def _is_constant(program: Program) -> bool:
    """Whether some number of a program is constant."""
    constant = [isinstance(value, Constant) for value in program.values]
    return any(constant[place] for output in program.outputs for place in output.entries)


def signals_of(loop: ClosedLoop) -> list[str]:
    """Return the names of the signals that a loop has, and of the numbers of its law."""
    signals = [
        name
        for name, (signal, _) in existing(loop).items()
        if signal.exists_for(loop) and (signal.stored_of(loop.vehicle) or not signal.only_there)
    ]
    return [*signals, *outputs_of(loop)]


def signal_program(plant: Plant, name: str, what: str) -> tuple[Any, Array]:
    """Return the program of a signal and its held numbers."""
    names = signals_of(plant.loop)
    if name not in names:
        raise EqtError(
            f"{what}: this loop has no signal '{name}'{suggestion(name, names)}; there are: "
            f"{', '.join(names)}"
        )
    program = sampled(Signals((name,)), plant.loop, (plant.loop.state_length,))
    if program is None:
        raise EqtError(f"{what}: the signal '{name}' cannot be compiled; read another one")
    return program, held_rows(plant.loop, plant.starts, program)


class MetricReward:
    """Minus a stored metric: of a mean, its value in each step; of an integral, its part.

    So the mean over the steps of an episode that take time, or the sum, is minus the metric. A cost
    is the metric itself.

    Attributes
    ----------
    text
        It in words.
    """

    terms: ClassVar[dict[str, Array]] = {}

    def __init__(self, plant: Plant, name: str, what: str = "reward") -> None:
        quantity = QUANTITIES.get(name)
        signals, adds = signals_of(plant.loop), [key for key, x in QUANTITIES.items() if _adds(x)]
        usual = [key for key in adds if QUANTITIES[key].signals[0] in signals]
        if not isinstance(quantity, Measure) or name not in usual:
            lacks = "is no mean and no integral over time, so it is no sum over steps"
            if quantity is None:
                lacks = f"unknown metric{suggestion(name, usual)}"
            elif name in adds:
                lacks = f"this loop has no signal '{quantity.signals[0]}', of which it is a number"
            raise EqtError(
                f"{what}: {name}: {lacks}; give one of {', '.join(usual)}, or a function of the "
                "signals, as lambda x: -x.pose_error"
            )
        self._sign = -1.0 if what == "reward" else 1.0
        self.text, self._plant = f"-{name}" if what == "reward" else name, plant
        self._square = quantity.of is not time_mean
        self._name = quantity.signals[0]
        self._signal = signal_program(plant, self._name, what)
        self._held = quantity.hold(holds(plant.loop.vehicle)) > 0
        self._length = plant.period if self._square else 1.0
        self._before = np.zeros(len(plant.tick))

    def _now(self, which: Array | slice = slice(None)) -> Array:
        value = self._plant.evaluate(*self._signal, which=which)[self._name]
        return value * value if self._square else value

    def begin(self, which: Array | slice) -> None:
        """Take the values at the starts of episodes that begin."""
        if not self._held:
            self._before[which] = self._now(which)

    def after_instant(self) -> None:
        """Take a value that is held from here to the next instant."""
        if self._held:
            self._before = self._now()

    def __call__(self, action: Array, last: Array) -> Array:
        """Return the reward of a step, ``(runs,)``: trapezoids, or held values."""
        length = self._sign * self._length
        if self._held:
            return length * self._before
        before, self._before = self._before, self._now()
        return length * (before + self._before) / 2


def is_integral(name: str) -> bool:
    """Return whether a metric is an integral over the whole run, so the sum of its steps."""
    return _adds(quantity := QUANTITIES.get(name)) and quantity.of is not time_mean  # type: ignore[union-attr]


def _adds(quantity: Any) -> bool:
    """Return whether a quantity is stored, and a mean or an integral over the whole run."""
    whole = isinstance(quantity, Measure) and quantity.stored and not quantity.choices
    return whole and quantity.of in ADDED


class FunctionReward:
    """A function of the user, behind each step.

    Attributes
    ----------
    text
        Its expression, or its source or its name where there is none.
    terms
        Its terms in the last step by name; empty of a function that gives a single number.
    """

    def __init__(self, plant: Plant, function: Function, what: str = "reward") -> None:
        self.text, self.function = text_of(function), Evaluated(plant, function, what)
        self.terms = dict[str, Array]()

    def begin(self, which: Array | slice) -> None:
        """Nothing is remembered."""

    def after_instant(self) -> None:
        """Nothing is remembered."""

    def __call__(self, action: Array, last: Array) -> Array:
        """Return the reward of a step, ``(runs,)``: the sum of its terms."""
        terms = self.function(action, last)
        if "" not in terms:
            self.terms = terms
        first, *others = terms.values()
        return sum(others, start=np.asarray(first, dtype=float))


def plain(values: Any) -> Array:
    """Return an array as it is; a `TypeError` where a part of its numbers would be lost."""
    array = np.ma.asarray(values)
    if np.iscomplexobj(array):
        raise TypeError("got complex numbers; take np.real(…)")
    if np.ma.is_masked(array):
        raise TypeError("got masked numbers, which say nothing; fill them")
    if array.dtype.kind not in "fiubO":  # NumPy takes times, texts and records for floats
        raise TypeError(f"got {array.dtype}, which is no type of numbers")
    return array.data
