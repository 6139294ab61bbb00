"""Metrics: numbers per run that follow from its signals, each with formula, names and unit.

A new metric needs only this file. It knows neither files nor controllers.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from operator import attrgetter
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array, absolute, less, maximum, sqrt, where
from eqt_cli.core.over_time import SampledRuns
from eqt_cli.groups.rotations import turn_of_distance
from eqt_cli.results.quantity import Quantity
from eqt_cli.results.time_windows import WHOLE, Window
from eqt_cli.vehicle import Vehicle

SETTLING = "settling error, by parts"
"""Signal for settling with thresholds by part; a run has settled where it is at most 1."""

ESTIMATE_SETTLING = "settling error of the estimate, by parts"
"""Signal for the settling of the estimate, from Q̂⁻¹Q; settled where it is at most 1."""

MOST_FREEDOM = 100
"""Degrees of freedom of an error of pose and bias."""

INSIDE = 0.95
"""The probability with which the error of a consistent filter is within the ellipsoid."""

EARLY = Window(0.0, 5.0)
"""The paper's "first 5 seconds of the response" (§7)."""

ENERGY_SCALE = 1.0
"""Least scale of errors of L, J; else they are relative to L(0)."""

SMALLEST_RATIO = 1e-12
"""L(t)/L(0) below which L consists of rounding and solver errors, so that its rate is unknown."""


CLOSING = 0.25
"""Last share of the time in which offsets and noise are measured."""


def _as_it_flies(vehicle: Vehicle) -> bool:
    return not vehicle.is_ideal


_estimates, _knows_covariance = attrgetter("estimates"), attrgetter("knows_covariance")

# Formulas, (samples of runs, signals (runs, samples, …)) -> (runs,) ------------------------------


def time_mean(over: SampledRuns, values: Any) -> Any:
    """The mean over time, by the trapezoidal rule."""
    return over.mean(values)


def effort(over: SampledRuns, torque_norm: Any) -> Any:
    """∫‖τ‖² dt, by Simpson's rule on the samples."""
    return over.simpson(torque_norm * torque_norm)


def peak(over: SampledRuns, values: Any) -> Any:
    """The largest value at a sample; larger values between samples are missed."""
    return over.largest(values)


def final(over: SampledRuns, values: Any) -> Any:
    """The value at the last sample."""
    return over.final(values)


def mean_turn(over: SampledRuns, distances: Array) -> Any:
    """The mean angle over time, in degrees."""
    return over.mean(np.degrees(turn_of_distance(distances)))


def final_turn(over: SampledRuns, distances: Array) -> Any:
    """The angle at the last sample, in degrees."""
    return over.final(np.degrees(turn_of_distance(distances)))


def integral_of_square(over: SampledRuns, values: Any) -> Any:
    """∫x² dt, by the trapezoidal rule."""
    return over.integral(values * values)


def actuator_work(over: SampledRuns, torque: Any, velocity: Any) -> Any:
    """∫|⟨τ, V⟩| dt; the pairing is a power on every group, whatever the units."""
    return over.integral(absolute((torque * velocity).sum(axis=-1)))


def settling_time(over: SampledRuns, error: Any, threshold: float) -> Any:
    """The last time at which the error falls below the threshold; NaN if it ends above it.

    The crossing is interpolated linearly between samples. A run that is never above it settles at
    0.
    """
    before, time, earlier = over.before(error), over.time, over.before(over.time)
    below = where(less(threshold, error), 0.0, 1.0)
    comes_down = less(0.0, where(less(threshold, before), below, 0.0))
    fall = where(comes_down, before - error, 1.0)
    crossing = earlier + (before - threshold) / fall * (time - earlier)
    last = over.latest(crossing, comes_down)
    within = where(less(threshold, over.final(error)), np.nan, last)
    return where(less(over.largest(error), np.inf), within, np.nan)


def decay_rate(over: SampledRuns, lyapunov: Array) -> Array:
    """λ of √L ~ e^{−λt}: half the least-squares slope of −log L; NaN without a slope.

    √L is proportional to small errors. Only samples before L first falls below `SMALLEST_RATIO` of
    its initial value count.
    """
    start, times = over.initial(lyapunov), over.times
    usable = np.cumprod(lyapunov > SMALLEST_RATIO * start, axis=-1).astype(bool)
    logs = np.log(np.where(usable, lyapunov, 1.0))
    count = usable.sum(axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        t = np.where(
            usable, times - (usable * times).sum(axis=-1, keepdims=True) / count[:, None], 0
        )
        slope = (t * logs).sum(axis=-1) / (t * t).sum(axis=-1)
    return np.where(count > 1, -slope / 2, np.nan)


def largest_rise(over: SampledRuns, lyapunov: Array) -> Array:
    """The largest growth of L above an earlier value, relative to L(0)."""
    rise = over.largest(lyapunov - np.minimum.accumulate(lyapunov, axis=-1))
    with np.errstate(invalid="ignore", divide="ignore"):
        relative: Array = np.where(rise > 0, rise / lyapunov[:, 0], rise)
    return relative


def energy_residual(over: SampledRuns, lyapunov: Any, balance: Any) -> Any:
    """max |L + W − L(0)| / max(L(0), 1 J), from L and L + W.

    W is 0 at the start, except for a law with memory that jumps there.
    """
    residual = over.largest(absolute(balance - over.initial(balance)))
    return residual / over.final(maximum(over.initial(lyapunov), ENERGY_SCALE))


def settled(over: SampledRuns, error: Array, threshold: float) -> Array:
    """1 if the error ends within the threshold, else 0; the mean is the share of runs."""
    within = np.isfinite(settling_time(over, error, threshold)).astype(float)
    return np.where(np.isfinite(error).all(axis=-1), within, np.nan)


def closing_rms(over: SampledRuns, values: Any, share: float = CLOSING) -> Any:
    """The root mean square over the last share of the time."""
    return sqrt(over.closing_mean(values * values, share))


def root_mean_square(over: SampledRuns, values: Any) -> Any:
    """√(∫x² dt / T), by the trapezoidal rule."""
    return sqrt(over.mean(values * values))


def mean_ratio(over: SampledRuns, values: Any, others: Any) -> Any:
    """The mean over time of one over the other."""
    return over.mean(values / others)


def share_inside(over: SampledRuns, square: Any, freedom: Any) -> Any:
    """The share of the samples with a square below its χ² limit."""
    from scipy.special import chdtri  # slow to import; readers of results do without

    limit = 0.0 * freedom
    for count in range(1, MOST_FREEDOM + 1):
        limit = where(less(count - 0.5, freedom), float(chdtri(count, 1 - INSIDE)), limit)
    inside = where(less(square, limit), 1.0, where(less(square, np.inf), 0.0, np.nan))
    return over.weighted(np.ones(len(over.times)), inside) / len(over.times)


# Rows that depend on keys of the configuration ---------------------------------------------------


def _early(window_s: float = EARLY.stop) -> dict[str, Any]:
    return {
        "window": Window(0.0, window_s),
        "long_name": f"mean ||tau|| over the first {window_s:g} s",
        "label": f"mean {{}}, first {window_s:g} s",
    }


def by_thresholds_of_parts(quantity: Quantity, thresholds: Mapping[str, float]) -> Quantity:
    """Return a row that uses the settling threshold, for separate thresholds of the parts."""
    assert quantity.of is not None
    words = quantity.long_name.replace("||I - Q_E||_F", "the largest error of a part")
    words = words.replace("||I - Qhat^-1 Q||_F", "the largest error of a part of the estimate")
    return replace(
        quantity,
        long_name=words.replace("the settling threshold", "its settling threshold"),
        signals=(ESTIMATE_SETTLING if quantity.signals == ("estimate_error",) else SETTLING,),
        of=partial(quantity.of, threshold=1.0),
        settings={},
        notes={f"threshold_{name}": value for name, value in thresholds.items()},
    )


# The table ---------------------------------------------------------------------------------------

_less_is_better = partial(Quantity, better="lower")
_compared = partial(_less_is_better, compared=(WHOLE,))
_integrated_square = partial(_compared, units="({})^2 s", formula=r"\int {}^2\,\mathrm{d}t")


def _statistic(of: Callable[..., Any], label: str, words: str) -> Callable[..., Quantity]:
    """Return what makes the row of a statistic over time, from a name, a signal and its words."""

    def row(name: str, signal: str, what: str, **more: Any) -> Quantity:
        fields: dict[str, Any] = {"of": of, "label": label, "better": "lower"} | more
        return Quantity(name, words.format(what), signals=(signal,), **fields)

    return row


_mean = _statistic(time_mean, "mean {}", "mean {} over the horizon")
_peak = _statistic(peak, "largest {}", "largest {} at the samples")
_final = _statistic(final, "final {}", "{} at the end")
_rms = _statistic(root_mean_square, "rms of {}", "root mean square of {} over the horizon")
_turns = {"units": "deg", "stored": False, "of_turns": True}
_mean_turn = partial(
    _statistic(mean_turn, "mean attitude error", "mean angle of {} over the horizon"), **_turns
)
_final_turn = partial(
    _statistic(final_turn, "final attitude error", "angle of {} at the end"), **_turns
)
_settling = partial(
    _statistic(settling_time, "settling time", "last time {} leaves the settling threshold"),
    units="s",
    settings={"threshold": "settling_threshold"},
    censored=True,
    compared=(WHOLE,),
)


def _closing(name: str, signal: str, what: str) -> Quantity:
    """Return the row of a root mean square over the last share of the time."""

    def chosen(share_of_time: float = CLOSING) -> dict[str, Any]:
        usual = share_of_time == CLOSING
        words = "the last quarter" if usual else f"the last {100 * share_of_time:g} %"
        return {
            "of": closing_rms if usual else partial(closing_rms, share=min(share_of_time, 1.0)),
            "long_name": f"root mean square of {what} over {words} of the time",
            "label": "closing rms of {}" + ("" if usual else f", last {100 * share_of_time:g} %"),
            "notes": {"share_of_time": share_of_time},
        }

    return _compared(
        name,
        signals=(signal,),
        stored_of=_as_it_flies,
        choices={"share_of_time": "closing_window"},
        chosen=chosen,
        **chosen(),
    )


METRICS = (
    _mean("mean_torque", "torque_norm", "||tau||", stored=False, compared=(EARLY, WHOLE)),
    _integrated_square(
        "effort",
        "control effort, integral of ||tau||^2",
        signals=("torque_norm",),
        label="effort",
        of=effort,
    ),
    _peak("peak_torque", "torque_norm", "||tau||", compared=(WHOLE,)),
    _less_is_better(
        "early_torque",
        signals=("torque_norm",),
        of=time_mean,
        choices={"window_s": "early_window"},
        chosen=_early,
        **_early(),
    ),
    _compared(
        "actuator_work",
        "integral of |<tau, V>|",
        units="J",
        signals=("torque", "velocity"),
        label="actuator work",
        formula=r"\int |\langle \tau, V \rangle|\,\mathrm{d}t",
        stored=False,
        of=actuator_work,
    ),
    _mean("mean_pose_error", "pose_error", "||I - Q_E||_F", compared=(WHOLE,)),
    _integrated_square(
        "squared_pose_error",
        "integral of ||I - Q_E||_F^2",
        signals=("pose_error",),
        label="squared error",
        stored=False,
        of=integral_of_square,
    ),
    _final("final_pose_error", "pose_error", "||I - Q_E||_F"),
    _mean_turn("mean_attitude_error", "pose_error", "the attitude error", compared=(WHOLE,)),
    _final_turn("final_attitude_error", "pose_error", "the attitude error"),
    _rms("position_rms", "position_error", "||p - pd||", compared=(WHOLE,)),
    _peak("peak_position_error", "position_error", "||p - pd||"),
    _final("final_position_error", "position_error", "||p - pd||"),
    _rms("heading_rms", "heading_error", "the heading error", label="rms of the heading error"),
    _rms("attitude_command_rms", "attitude_command_error", "||R - Rc||_F"),
    _mean("mean_velocity_error", "velocity_error", "||V - Vd||", stored=False, compared=(WHOLE,)),
    _final("final_velocity_error", "velocity_error", "||V - Vd||"),
    _settling("settling_time", "pose_error", "||I - Q_E||_F"),
    Quantity(
        "decay_rate",
        "half the slope of -log L",
        units="1/s",
        signals=("lyapunov",),
        own_symbol=r"\sqrt{\mathcal{L}}",
        label="decay rate of {}",
        better="higher",
        stored=False,
        of=decay_rate,
        compared=(WHOLE,),
    ),
    _less_is_better(
        "lyapunov_rise",
        "largest rise of L above an earlier value, relative to L(0)",
        units="1",
        signals=("lyapunov",),
        label="largest rise of {}, relative to {}(0)",
        stored=False,
        of=largest_rise,
    ),
    Quantity(
        "settled",
        "1 if ||I - Q_E||_F ends within the settling threshold, else 0",
        units="1",
        signals=("pose_error",),
        label="settled",
        better="higher",
        of=settled,
        settings={"threshold": "settling_threshold"},
        compared=(WHOLE,),
        counts=True,
        told_by="settling_time",
        stored_of=_as_it_flies,
    ),
    _compared(
        "saturated_share",
        "share of the time at which an actuator is at its limit",
        units="1",
        signals=("at_limit",),
        label="share of time at a limit",
        of=time_mean,
        stored_of=attrgetter("limits"),
    ),
    _closing("closing_pose_error", "pose_error", "||I - Q_E||_F"),
    _closing("closing_torque", "torque_norm", "||tau||"),
    _rms(
        "estimate_rms",
        "estimate_error",
        "||I - Qhat^-1 Q||_F",
        compared=(WHOLE,),
        stored_of=_estimates,
    ),
    _rms("bias_rms", "bias_error", "||b - bhat||", stored_of=_estimates),
    _settling(
        "estimate_settling_time",
        "estimate_error",
        "||I - Qhat^-1 Q||_F",
        label="settling time of the estimate",
        stored_of=_estimates,
    ),
)
"""Metrics that compare controllers, in the order of tables; result files hold those `stored`."""

_ratio = partial(Quantity, units="1", stored_of=_knows_covariance)

CONSISTENCY = (
    _ratio(
        "nees_ratio",
        "mean of NEES over its degrees of freedom; 1 of a consistent filter",
        signals=("nees", "nees_dof"),
        label="NEES per degree of freedom",
        of=mean_ratio,
    ),
    _ratio(
        "ellipsoid_share",
        "share of the samples whose error is within the 95 % ellipsoid; 0.95 of a consistent "
        "filter",
        signals=("nees", "nees_dof"),
        label="share within the 95 % ellipsoid",
        of=share_inside,
    ),
    _ratio(
        "final_innovation_square",
        "mean square of the normalised innovations; 1 of a consistent filter",
        signals=("innovation_square",),
        label="mean square of innovations",
        of=final,
    ),
    _ratio(
        "final_innovation_correlation",
        "correlation of successive normalised innovations; 0 of a consistent filter",
        signals=("innovation_correlation",),
        label="correlation of innovations",
        of=final,
    ),
)
"""Whether a filter is consistent: numbers that rank no laws."""
