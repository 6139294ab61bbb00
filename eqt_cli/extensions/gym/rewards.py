"""Rewards and ends of episodes: a stored metric, or a function of signals, if possible in C."""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array, Arrays, where
from eqt_cli.base.errors import EqtError, suggestion
from eqt_cli.base.registry import described
from eqt_cli.engines.native import held_rows, sampled
from eqt_cli.extensions.gym.stepping import Plant
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.loop.signals import existing, holds, outputs_of, values_at
from eqt_cli.numbers.program import COMPARISONS
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
        """Return its ``value``, 1 or 0 of a condition."""
        s = loop.tracking(t, state)

        def signal(name: str) -> Array:
            if name not in self.names:
                raise KeyError(name)  # it would be NaN, and no condition of it would hold
            return values_at(loop, s, state, (name,))[name]

        step = Step(signal, t, action, last)
        value = np.asarray(self.function(step))
        if value.dtype == bool:
            value = value.astype(float)
        if getattr(value.ravel()[:1].tolist()[0], "name", "") in COMPARISONS:  # of `less`
            value = where(value, 1.0, 0.0)
        return {"value": value.reshape(1, 1) + 0.0}


class Evaluated:
    """Signals, or a function of the user, in the states of a plant.

    Attributes
    ----------
    is_compiled
        Whether all of it is C.
    """

    def __init__(self, plant: Plant, function: Any, what: str) -> None:
        self._plant, self._what, self._function = plant, what, function
        self._signals = dict[str, tuple[Any, Array]]()
        lengths = (plant.loop.state_length, plant.actions, plant.actions)
        of_function = OfFunction(function, frozenset(signals_of(plant.loop)))
        program = sampled(of_function, plant.loop, lengths)
        self.is_compiled = program is not None
        self._program = program and (program, held_rows(plant.loop, plant.starts, program))
        if program is None:
            none = np.zeros((len(plant.tick), plant.actions))
            self(none, none)  # so that what is wrong with it is said now

    def __call__(self, action: Array, last: Array) -> Array:
        """Return its value of each run, ``(runs,)``."""
        plant = self._plant
        if self._program:
            return plant.evaluate(*self._program, (action, last))["value"][:, 0]
        t = plant.time
        try:
            value = plain(self._function(Step(self.signal, t, action, last)))
        except EqtError:
            raise
        except Exception as error:
            raise EqtError(
                f"{self._what}: the function fails: {described(error)}; it takes one argument, "
                "whose signals are arrays of a number for each run, so that np.where replaces if"
            ) from error
        if value.shape != (len(t),) or value.dtype.kind not in "fiub":
            raise EqtError(
                f"{self._what}: expected a number for each run, of shape ({len(t)},), got "
                f"{value.dtype} of shape {value.shape}"
            )
        return value

    def signal(self, name: str) -> Array:
        """Return a signal of the loop in the states of the plant."""
        if name not in self._signals:
            self._signals[name] = signal_program(self._plant, name, self._what)
        program, held = self._signals[name]
        return self._plant.evaluate(program, held)[name]


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

    So the mean over the steps of an episode that take time, or the sum, is minus the metric.

    Attributes
    ----------
    text
        It in words.
    """

    def __init__(self, plant: Plant, name: str) -> None:
        quantity = QUANTITIES.get(name)
        signals, adds = signals_of(plant.loop), [key for key, x in QUANTITIES.items() if _adds(x)]
        usual = [key for key in adds if QUANTITIES[key].signals[0] in signals]
        if not isinstance(quantity, Measure) or name not in usual:
            what = "is no mean and no integral over time, so it is no sum over steps"
            if quantity is None:
                what = f"unknown metric{suggestion(name, usual)}"
            elif name in adds:
                what = f"this loop has no signal '{quantity.signals[0]}', of which it is a number"
            raise EqtError(
                f"reward: {name}: {what}; give one of {', '.join(usual)}, or a function of the "
                "signals, as lambda x: -x.pose_error"
            )
        self.text, self._plant = f"-{name}", plant
        self._square = quantity.of is not time_mean
        self._name = quantity.signals[0]
        self._signal = signal_program(plant, self._name, "reward")
        self._held = quantity.hold(holds(plant.loop.vehicle)) > 0
        self._length = plant.period if self._square else 1.0
        self._before = np.zeros(len(plant.tick))

    def _now(self, which: Array | slice = slice(None)) -> Array:
        value = self._plant.evaluate(*self._signal, which=which)[self._name]
        return value * value if self._square else value

    def begin(self, which: Array) -> None:
        """Take the values at the starts of episodes that begin."""
        if not self._held:
            self._before[which] = self._now(which)

    def after_instant(self) -> None:
        """Take a value that is held from here to the next instant."""
        if self._held:
            self._before = self._now()

    def __call__(self, action: Array, last: Array) -> Array:
        """Return the reward of a step, ``(runs,)``: trapezoids, or held values."""
        if self._held:
            return -self._length * self._before
        before, self._before = self._before, self._now()
        return -self._length * (before + self._before) / 2


def _adds(quantity: Any) -> bool:
    """Return whether a quantity is stored, and a mean or an integral over the whole run."""
    whole = isinstance(quantity, Measure) and quantity.stored and not quantity.choices
    return whole and quantity.of in ADDED


class FunctionReward:
    """A function of the user, behind each step.

    Attributes
    ----------
    text
        Its source, or its name where there is none.
    """

    def __init__(self, plant: Plant, function: Function) -> None:
        self.text, self.function = source_of(function), Evaluated(plant, function, "reward")

    def begin(self, which: Array) -> None:
        """Nothing is remembered."""

    def after_instant(self) -> None:
        """Nothing is remembered."""

    def __call__(self, action: Array, last: Array) -> Array:
        """Return the reward of a step, ``(runs,)``."""
        return np.asarray(self.function(action, last), dtype=float)


def plain(values: Any) -> Array:
    """Return an array as it is; a `TypeError` where a part of its numbers would be lost."""
    array = np.ma.asarray(values)
    if np.iscomplexobj(array):
        raise TypeError("got complex numbers; take np.real(…)")
    if np.ma.is_masked(array):
        raise TypeError("got masked numbers, which say nothing; fill them")
    return array.data


def source_of(function: Any) -> str:
    """Return the text of a function as it is written, or its name."""
    try:
        return textwrap.dedent(inspect.getsource(function)).strip()
    except (OSError, TypeError):
        return str(getattr(function, "__qualname__", repr(function)))
