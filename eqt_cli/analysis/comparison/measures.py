"""What runs can be compared by: one number per run and window, with its symbol and its unit.

It knows neither files nor statistics.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import trapezoid

from eqt_cli.analysis.comparison.windows import WHOLE, Window
from eqt_cli.core.arrays import Array
from eqt_cli.results.metrics import EARLY_WINDOW, effort, time_mean

EARLY = Window(0.0, EARLY_WINDOW)
"""The paper's "first 5 seconds of the response" (§7)."""

SMALLEST_RATIO = 1e-12
"""L(t)/L(0) below which L is rounding and solver error, and says nothing about its rate."""


@dataclass(frozen=True)
class Measure:
    """A number per run.

    Attributes
    ----------
    name
        As written after ``--metric``.
    symbol, latex
        As shown in tables, in plain characters and between dollar signs.
    signals
        The stored signals that it needs over time; none if it only exists as a stored metric.
    units
        In terms of the unit of the first signal: ``{}`` stands for it.
    of
        ``(times, *signals) -> (runs,)``; signals are ``(runs, samples, …)`` within the window.
    stored
        The metric of a result file that is the same number over the window given with it.
    more_is_better
        Larger values are better ones, as for a rate of decay.
    parted
        The first signal is a norm that may have parts, such as rotation and translation.
    censored_at_horizon
        NaN in a run that is good says: later than the end of the run.
    windowed
        It has a value on any window, and not only on the whole horizon.
    by_default
        The windows on which it is compared unless the user chooses.
    only
        The window of a measure that has just one.
    """

    name: str
    symbol: str
    latex: str
    signals: tuple[str, ...]
    units: str
    of: Callable[..., Array] | None
    stored: tuple[tuple[str, Window], ...] = ()
    more_is_better: bool = False
    parted: bool = False
    censored_at_horizon: bool = False
    windowed: bool = True
    by_default: tuple[Window, ...] = ()
    only: Window = WHOLE

    def part(self, suffix: str) -> Measure:
        """The same of one part of the norm: ``_rotation``."""
        words = suffix.removeprefix("_").replace("_", " ")
        return replace(
            self,
            name=self.name + suffix,
            symbol=f"{self.symbol} {words}",
            latex=rf"{self.latex}\ \text{{{words}}}",
            signals=(self.signals[0] + suffix, *self.signals[1:]),
            stored=(),
        )


def stored_measure(name: str, long_name: str) -> Measure:
    """A measure that is nothing but a metric of the result file."""
    text = long_name.replace("_", r"\_").replace("||", r"$\|$")
    same = (window for measure in MEASURES for stored, window in measure.stored if stored == name)
    only = next(same, WHOLE)
    return Measure(
        name,
        long_name,
        rf"\text{{{text}}}",
        (),
        "{}",
        None,
        ((name, only),),
        windowed=False,
        only=only,
    )


def _mean(times: Array, values: Array) -> Array:
    return time_mean(times, values)


def _peak(times: Array, values: Array) -> Array:
    peak: Array = values.max(axis=-1)
    return peak


def _integral_of_square(times: Array, values: Array) -> Array:
    integral: Array = trapezoid(values**2, times, axis=-1)
    return integral


def _last(times: Array, values: Array) -> Array:
    last: Array = values[:, -1]
    return last


def _actuator_work(times: Array, torque: Array, velocity: Array) -> Array:
    """∫|⟨τ, V⟩| dt; a pairing is a power on every group, whatever the units of its coordinates."""
    power = np.abs(np.sum(torque * velocity, axis=-1))
    work: Array = trapezoid(power, times, axis=-1)
    return work


def decay_rate(times: Array, lyapunov: Array) -> Array:
    """λ of √L ~ e^{−λt}: half the least-squares slope of −log L; NaN where L has no slope.

    √L is the size of the error, for small ones. Only samples before L first comes below
    `SMALLEST_RATIO` of its initial value take part.
    """
    start = lyapunov[:, :1]
    usable = np.cumprod(lyapunov > SMALLEST_RATIO * start, axis=-1).astype(bool) & (start > 0)
    logs = np.log(np.where(usable, lyapunov, 1.0))
    count = usable.sum(axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        t = np.where(
            usable, times - (usable * times).sum(axis=-1, keepdims=True) / count[:, None], 0
        )
        slope = (t * logs).sum(axis=-1) / (t * t).sum(axis=-1)
    rate: Array = np.where(count > 1, -slope / 2, np.nan)
    return rate


def largest_rise(times: Array, lyapunov: Array) -> Array:
    """The largest growth of L above an earlier value of it, relative to L(0)."""
    rise = (lyapunov - np.minimum.accumulate(lyapunov, axis=-1)).max(axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        relative: Array = np.where(rise > 0, rise / lyapunov[:, 0], rise)
    return relative


MEASURES = (
    Measure(
        "mean_torque",
        "mean ‖τ‖",
        r"\overline{\|\tau\|}",
        ("torque_norm",),
        "{}",
        _mean,
        stored=(("early_torque", EARLY),),
        parted=True,
        by_default=(EARLY, WHOLE),
    ),
    Measure(
        "effort",
        "∫‖τ‖² dt",
        r"\int \|\tau\|^2\,\mathrm{d}t",
        ("torque_norm",),
        "({})^2 s",
        effort,
        stored=(("effort", WHOLE),),
        parted=True,
        by_default=(WHOLE,),
    ),
    Measure(
        "peak_torque",
        "max ‖τ‖",
        r"\max \|\tau\|",
        ("torque_norm",),
        "{}",
        _peak,
        stored=(("peak_torque", WHOLE),),
        parted=True,
        by_default=(WHOLE,),
    ),
    Measure(
        "actuator_work",
        "∫|⟨τ, V⟩| dt",
        r"\int |\langle \tau, V \rangle|\,\mathrm{d}t",
        ("torque", "velocity"),
        "J",
        _actuator_work,
        by_default=(WHOLE,),
    ),
    Measure(
        "mean_pose_error",
        "mean ‖I − Q_E‖",
        r"\overline{\|I - Q_E\|_{\mathrm{F}}}",
        ("pose_error",),
        "{}",
        _mean,
        stored=(("mean_pose_error", WHOLE),),
        parted=True,
        by_default=(WHOLE,),
    ),
    Measure(
        "squared_pose_error",
        "∫‖I − Q_E‖² dt",
        r"\int \|I - Q_E\|_{\mathrm{F}}^2\,\mathrm{d}t",
        ("pose_error",),
        "({})^2 s",
        _integral_of_square,
        parted=True,
        by_default=(WHOLE,),
    ),
    Measure(
        "final_pose_error",
        "final ‖I − Q_E‖",
        r"\|I - Q_E\|_{\mathrm{F}}\ \text{at the end}",
        ("pose_error",),
        "{}",
        _last,
        stored=(("final_pose_error", WHOLE),),
        parted=True,
    ),
    Measure(
        "mean_velocity_error",
        "mean ‖V − V_d‖",
        r"\overline{\|V - V_d\|}",
        ("velocity_error",),
        "{}",
        _mean,
        parted=True,
        by_default=(WHOLE,),
    ),
    Measure(
        "final_velocity_error",
        "final ‖V − V_d‖",
        r"\|V - V_d\|\ \text{at the end}",
        ("velocity_error",),
        "{}",
        _last,
        stored=(("final_velocity_error", WHOLE),),
        parted=True,
    ),
    Measure(
        "settling_time",
        "settling time",
        r"\text{settling time}",
        (),
        "s",
        None,
        stored=(("settling_time", WHOLE),),
        censored_at_horizon=True,
        windowed=False,
        by_default=(WHOLE,),
    ),
    Measure(
        "decay_rate",
        "decay rate of √L",
        r"\text{decay rate of } \sqrt{\mathcal{L}}",
        ("lyapunov",),
        "1/s",
        decay_rate,
        more_is_better=True,
        by_default=(WHOLE,),
    ),
    Measure(
        "lyapunov_rise",
        "largest rise of L, relative to L(0)",
        r"\text{largest rise of } \mathcal{L} / \mathcal{L}(0)",
        ("lyapunov",),
        "1",
        largest_rise,
    ),
)
"""All measures that are more than a stored metric, in the order of tables."""
