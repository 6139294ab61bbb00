"""Every actuator written a second time, in floats and for one run.

A form takes a command, the actuator's states, and the period where it acts at an instant. It gives
the states after the instant, or their rates where there is none, and what it makes of the command.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eqt_cli.analysis.evidence.redrawn import Options, entries, redrawn
from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.actuators import Actuator

Acts = Callable[[Array, Array, float | None], tuple[Array, Array]]

Form = Callable[[Options, int], Acts]


def _limit(given: Options, m: int) -> Acts:
    """The command, or the nearest that is allowed; of a norm, the nearest in its direction."""
    if given["limit"] is None:
        least, most = (entries(given[name], m) for name in ("low", "high"))
        return lambda u, x, period: (0 * x, np.median([least + 0 * u, u, most + 0 * u], axis=0))
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


@dataclass(frozen=True)
class SecondThrusters:
    """Thrusters of one run: u becomes thrusts f within limits, T ẋ + x = f, and B x comes out.

    Attributes
    ----------
    given
        Their options.
    G
        The group.
    """

    given: Options
    G: MatrixLieGroup

    @cached_property
    def B(self) -> Array:
        """As given, or each place times its force."""
        if self.given["matrix"] is not None:
            return np.array(self.given["matrix"], dtype=float)
        found = []
        for each in self.given["thrusters"]:
            a = np.array(each.along) / np.sqrt(np.square(each.along).sum())
            if len(a) == 2:
                found.append([each.at[0] * a[1] - each.at[1] * a[0], *a])
            else:
                found.append([*(np.cross(each.at, a) + each.turns * a), *a])
        return np.array(found).T

    @property
    def bounded(self) -> bool:
        """Whether thrusts are solved for."""
        return bool(self.given["allocation"] == "bounded")

    def of_each(self, name: str) -> Array:
        """An option of every thruster."""
        return entries(self.given[name], self.B.shape[1])

    @cached_property
    def scale(self) -> Array:
        """1/√w."""
        given = self.given["weights"]
        return np.ones(self.B.shape[1]) if given is None else self.of_each("weights") ** -0.5

    def free(self, u: Array) -> Array:
        """The least Σ w f² with B f = u or nearest to it: f = S z, z the least of norm."""
        S = self.scale
        z = np.linalg.lstsq(self.B * S, u.reshape(-1, len(self.B)).T, rcond=1e-10)[0]
        return (S * z.T).reshape(*u.shape[:-1], -1)

    def nearest(self, u: Array) -> Array:
        """Within the limits, by SciPy."""
        from scipy.optimize import lsq_linear

        least, most, f = self.of_each("low"), self.of_each("high"), self.free(u)
        S = self.scale
        for run in zip(*np.nonzero(((f < least) | (f > most)).any(axis=-1)), strict=True):
            z = lsq_linear(
                self.B * S, u[run], (least / S, most / S), method="bvls", tol=1e-14, max_iter=1000
            ).x
            f[run] = S * z
        return f

    def __call__(self, u: Array, x: Array, period: float | None) -> tuple[Array, Array]:
        """As `Acts`."""
        k = self.B.shape[1]
        if self.bounded and period is not None:
            f = self.nearest(u)
            later = np.concatenate([f, x[..., k:]], axis=-1)
        elif self.bounded:
            f, later = x[..., :k], 0 * x
        else:
            f, later = self.free(u), 0 * x
            if self.given["low"] is not None:
                f = np.maximum(np.minimum(f, self.of_each("high")), self.of_each("low"))
        if self.given["time_constant"] is None:
            return later, f @ self.B.T
        lagging = x[..., -k:]
        if period is None:
            rate = (f - lagging) / self.of_each("time_constant")
            later = np.concatenate([later[..., :-k], rate], axis=-1)
        return later, lagging @ self.B.T

    def at_limit(self, u: Array, x: Array) -> Array:
        """Where a thruster is asked for more than its limit; or for its limit, where solved for."""
        least, most = self.of_each("low"), self.of_each("high")
        f = x[..., : self.B.shape[1]] if self.bounded else self.free(u)
        inside = (least < f) & (f < most) if self.bounded else (least <= f) & (f <= most)
        return np.array(~inside.all(axis=-1))


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

_SHORT = 1e-11
"""Relative: less than that is rounding."""


@dataclass(frozen=True)
class SecondActuator:
    """An actuator of one run.

    Attributes
    ----------
    acts
        Its form.
    states
        How many states it has.
    at_limit
        Where it is at a limit, from a command, its states and what it makes of the command.
    moves
        Whether it has rates.
    sampled
        Whether it acts at instants although it moves.
    """

    acts: Acts
    states: int
    at_limit: Callable[[Array, Array, Array], Array]
    moves: bool
    sampled: bool = False


def second_actuator(
    actuator: Actuator, G: MatrixLieGroup, random: np.random.Generator
) -> SecondActuator | None:
    """An actuator of one run; None where it has no second form."""
    given = redrawn(actuator, random)
    if actuator.name == "thrusters":
        again, lags = SecondThrusters(given, G), given["time_constant"] is not None
        states = (again.bounded + lags) * again.B.shape[1]
        limited = given["low"] is not None
        return SecondActuator(
            again,
            states,
            lambda u, x, passed: again.at_limit(u, x) if limited else _nowhere(u),
            lags,
            again.bounded,
        )
    form = FORMS.get(actuator.name)
    if form is None:
        return None
    states = STATES.get(actuator.name, 0) * G.dimension
    falls_short = _falls_short if actuator.limits else lambda u, x, passed: _nowhere(u)
    return SecondActuator(form(given, G.dimension), states, falls_short, actuator.name == "lag")


def _falls_short(u: Array, x: Array, passed: Array) -> Array:
    """Where less comes out than goes in, by more than rounding."""
    short: Array = (np.abs(u - passed) > _SHORT * (1 + np.abs(u))).any(axis=-1)
    return short


def _nowhere(u: Array) -> Array:
    return np.zeros(u.shape[:-1], dtype=bool)
