"""Every actuator written a second time, in floats and for one run.

A form takes a command, the actuator's states, and the period where it acts at an instant. It gives
the states after the instant, or their rates where there is none, and what it makes of the command.
"""

from collections.abc import Callable

import numpy as np

from eqt_cli.analysis.evidence.redrawn import Options, entries, redrawn
from eqt_cli.core.arrays import Array
from eqt_cli.vehicle.actuators import Actuator

Acts = Callable[[Array, Array, float | None], tuple[Array, Array]]

Form = Callable[[Options, int], Acts]


def _limit(given: Options, m: int) -> Acts:
    """The command, or the nearest that is allowed; of a norm, the nearest in its direction."""
    limit = entries(given["limit"], m)

    def acts(u: Array, x: Array, period: float | None) -> tuple[Array, Array]:
        if not given["norm"]:
            return 0 * x, np.sign(u) * np.minimum(np.abs(u), limit)
        size = np.sqrt(((u / limit) ** 2).sum(axis=-1, keepdims=True))
        return 0 * x, u / np.maximum(size, 1.0)

    return acts


def _lag(given: Options, m: int) -> Acts:
    """T ẋ + x = u, and x comes out."""
    T = entries(given["time_constant"], m)
    return lambda u, x, period: (u / T - x / T, x)


def _deadband(given: Options, m: int) -> Acts:
    """What is not smaller than the width passes whole."""
    width = entries(given["width"], m)
    return lambda u, x, period: (0 * x, u * (np.abs(u) >= width))


def _quantisation(given: Options, m: int) -> Acts:
    """The nearest of the steps."""
    step = entries(given["resolution"], m)
    return lambda u, x, period: (0 * x, step * np.rint(u / step))


def _rate_limit(given: Options, m: int) -> Acts:
    """Towards the command, by the rate times the period at most."""
    rate = entries(given["rate"], m)

    def acts(u: Array, x: Array, period: float | None) -> tuple[Array, Array]:
        if period is None:
            return 0 * x, x
        way = u - x
        later = x + np.sign(way) * np.minimum(np.abs(way), rate * period)
        return later, later

    return acts


def _momentum_limit(given: Options, m: int) -> Acts:
    """What takes the integral to where the command would, or to the end of its range."""
    most = entries(given["momentum"], m)

    def acts(u: Array, x: Array, period: float | None) -> tuple[Array, Array]:
        if period is None:
            return 0 * x, x[..., :m]
        h = x[..., m:]
        later = np.maximum(-most, np.minimum(most, h + u * period))
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
}
"""By the registered name of the actuator."""

STATES = {"lag": 1, "rate_limit": 1, "momentum_limit": 2}
"""How many states along each axis an actuator has that has any."""


def second_actuator(actuator: Actuator, m: int, random: np.random.Generator) -> Acts | None:
    """An actuator of one run; None where it has no second form."""
    form = FORMS.get(actuator.name)
    return None if form is None else form(redrawn(actuator, random), m)
