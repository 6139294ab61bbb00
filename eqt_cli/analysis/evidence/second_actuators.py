"""Second, independent form of every actuator, in floats and for one run.

A form takes a command, the actuator's states, and the period if it acts at an instant. It returns
the states after the instant, or else their rates, and its output.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from eqt_cli.analysis.evidence.redrawn import Options, entries, redrawn
from eqt_cli.analysis.evidence.second_thrusters import SecondThrusters
from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.actuators import Actuator

Acts = Callable[[Array, Array, float | None], tuple[Array, Array]]

Form = Callable[[Options, int], Acts]


def _limit(given: Options, m: int) -> Acts:
    """Return the nearest allowed command; for a norm, the nearest in its direction."""
    if given["limit"] is None:
        low, high = (entries(given[name], m) for name in ("low", "high"))
        return lambda u, x, period: (0 * x, np.median([low + 0 * u, u, high + 0 * u], axis=0))
    limit = entries(given["limit"], m)

    def acts(u: Array, x: Array, period: float | None) -> tuple[Array, Array]:
        if not given["norm"]:
            return 0 * x, np.sign(u) * np.minimum(np.abs(u), limit)
        size = np.sqrt(((u / limit) ** 2).sum(axis=-1, keepdims=True))
        return 0 * x, u / np.maximum(size, 1.0)

    return acts


def _lag(given: Options, m: int) -> Acts:
    """T ẋ + x = u with the output x."""
    T = entries(given["time_constant"], m)
    return lambda u, x, period: (u / T - x / T, x)


def _deadband(given: Options, m: int) -> Acts:
    """Pass commands that are not smaller than the width."""
    width = entries(given["width"], m)
    return lambda u, x, period: (0 * x, u * (np.abs(u) >= width))


def _quantisation(given: Options, m: int) -> Acts:
    """Round to the nearest step."""
    step = entries(given["resolution"], m)
    return lambda u, x, period: (0 * x, step * np.rint(u / step))


def _rate_limit(given: Options, m: int) -> Acts:
    """Move towards the command by at most the rate times the period."""
    rate = entries(given["rate"], m)

    def acts(u: Array, x: Array, period: float | None) -> tuple[Array, Array]:
        if period is None:
            return 0 * x, x
        gap = u - x
        later = x + np.sign(gap) * np.minimum(np.abs(gap), rate * period)
        return later, later

    return acts


def _momentum_limit(given: Options, m: int) -> Acts:
    """Return the torque that moves the integral as the command would, within its range."""
    limit = entries(given["momentum"], m)

    def acts(u: Array, x: Array, period: float | None) -> tuple[Array, Array]:
        if period is None:
            return 0 * x, x[..., :m]
        h = x[..., m:]
        later = np.maximum(-limit, np.minimum(limit, h + u * period))
        torque = (later - h) / period
        return np.concatenate([torque, later], axis=-1), torque

    return acts


FORMS: dict[str, Form] = {
    "limit": _limit,
    "lag": _lag,
    "deadband": _deadband,
    "quantisation": _quantisation,
    "rate_limit": _rate_limit,
    "momentum_limit": _momentum_limit,
    "thrusters": lambda given, m: SecondThrusters(given),
}
"""By the registered name of the actuator."""

STATES = {"lag": 1, "rate_limit": 1, "momentum_limit": 2}
"""Number of states per axis of the actuators that have states."""

_SHORT = 1e-11
"""Relative difference below which two values differ only by rounding."""


@dataclass(frozen=True)
class SecondActuator:
    """An actuator of one run.

    Attributes
    ----------
    acts
        Form of the actuator.
    states
        Number of its states.
    at_limit
        Returns where it is at a limit, from a command, its states and its output.
    moves
        Whether its states have rates.
    sampled
        Whether it also acts at instants if its states have rates.
    """

    acts: Acts
    states: int
    at_limit: Callable[[Array, Array, Array], Array]
    moves: bool
    sampled: bool = False


def second_actuator(
    actuator: Actuator, G: MatrixLieGroup, random: np.random.Generator
) -> SecondActuator | None:
    """Return an actuator of one run; None if it has no second form."""
    form = FORMS.get(actuator.name)
    if form is None:
        return None
    acts = form(redrawn(actuator, random), G.dimension)
    if isinstance(acts, SecondThrusters):
        return SecondActuator(acts, acts.states, acts.at_limit, acts.lags, acts.bounded)
    states = STATES.get(actuator.name, 0) * G.dimension
    falls_short = _falls_short if actuator.limits else _nowhere
    return SecondActuator(acts, states, falls_short, actuator.name == "lag")


def _falls_short(u: Array, x: Array, passed: Array) -> Array:
    """Return where the output differs from the command by more than rounding."""
    short: Array = (np.abs(u - passed) > _SHORT * (1 + np.abs(u))).any(axis=-1)
    return short


def _nowhere(u: Array, x: Array, passed: Array) -> Array:
    return np.zeros(u.shape[:-1], dtype=bool)
