"""The stored metrics, and the table of all quantities of a result."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from operator import attrgetter
from types import MappingProxyType
from typing import Any, get_args

import numpy as np

from eqt_cli.base.arrays import Array, absolute, less, maximum, sqrt, where
from eqt_cli.base.errors import printable
from eqt_cli.base.registry import registry, summary
from eqt_cli.base.stored import SIGNALS, Better, Signal, Status, Symbol, signal_of
from eqt_cli.numbers.running import SampledRuns, changes_missed
from eqt_cli.results.quantity import LAST_RESORT, WHOLE, Measure, ValuePer, Window

# Metrics: numbers per run that follow from its signals, each with formula, names and unit ---------
#
# A new metric needs only this file. It knows neither files nor controllers.


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


_estimates, _knows_covariance, _burns = map(attrgetter, ("estimates", "knows_covariance", "burns"))


def _as_it_flies(vehicle: Any) -> bool:
    return not vehicle.is_ideal


# Formulas, (samples of runs, signals (runs, samples, …)) -> (runs,) ------------------------------


def time_mean(over: SampledRuns, values: Any) -> Any:
    """The mean over time, by the trapezoidal rule; of held values, by their sum."""
    return over.mean(values)


def effort(over: SampledRuns, torque_norm: Any) -> Any:
    """∫‖τ‖² dt, by Simpson's rule; of held values, by their sum."""
    return over.simpson(torque_norm * torque_norm)


def peak(over: SampledRuns, values: Any) -> Any:
    """The largest value at a sample; larger values between samples are missed."""
    return over.largest(values)


def final(over: SampledRuns, values: Any) -> Any:
    """The value at the last sample."""
    return over.final(values)


def integral_of_square(over: SampledRuns, values: Any) -> Any:
    """∫x² dt, by the trapezoidal rule; of held values, by their sum."""
    return over.integral(values * values)


def actuator_work(over: SampledRuns, torque: Any, velocity: Any) -> Any:
    """∫|⟨τ, V⟩| dt; the pairing is a power on every group, whatever the units.

    A held torque is constant from sample to sample, and the velocity is not.
    """
    power = absolute((torque * velocity).sum(axis=-1))
    if not over.hold or changes_missed(over.times, over.hold).any():
        return SampledRuns(over.times).integral(power)
    ends = absolute((torque[:, :-1] * velocity[:, 1:]).sum(axis=-1))
    return ((power[:, :-1] + ends) / 2 * np.diff(over.times)).sum(axis=-1)


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


def settled(over: SampledRuns, error: Any, threshold: float) -> Any:
    """1 if the error ends within the threshold, else 0; the mean is the share of runs."""
    within = where(less(settling_time(over, error, threshold), np.inf), 1.0, 0.0)
    return where(less(over.largest(error), np.inf), within, np.nan)


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


def _early(window_s: float = EARLY.stop) -> dict[str, Any]:
    return {
        "window": Window(0.0, window_s),
        "long_name": f"mean ||tau|| over the first {window_s:g} s",
        "label": f"mean {{}}, first {window_s:g} s",
    }


INTEGRALS = (time_mean, effort, integral_of_square, actuator_work, root_mean_square, closing_rms)
"""Formulas that are as accurate as the samples are close."""


# The table ---------------------------------------------------------------------------------------

_less_is_better = partial(Measure, better="lower")
_compared = partial(_less_is_better, compared=(WHOLE,))
_integrated_square = partial(
    _compared, units="({})^2 s", formula=Symbol(r"\int {}^2\,\mathrm{d}t", "∫{}² dt")
)


def _statistic(of: Callable[..., Any], label: str, words: str) -> Callable[..., Measure]:
    """Return what makes the row of a statistic over time, from a name, a signal and its words."""

    def row(name: str, signal: str, what: str, **more: Any) -> Measure:
        fields: dict[str, Any] = {"of": of, "label": label, "better": "lower"} | more
        return Measure(name, words.format(what), signals=(signal,), **fields)

    return row


_mean = partial(_statistic(time_mean, "mean {}", "mean {} over the horizon"), compared=(WHOLE,))
_peak = _statistic(peak, "largest {}", "largest {} at the samples")
_final = _statistic(final, "final {}", "{} at the end")
_rms = _statistic(root_mean_square, "rms of {}", "root mean square of {} over the horizon")
_rms_of_estimate = partial(_rms, stored_of=_estimates)
_settling = partial(
    _statistic(settling_time, "settling time", "last time {} leaves the settling threshold"),
    units="s",
    settings={"threshold": "settling_threshold"},
    censored=True,
    compared=(WHOLE,),
)


def _closing(name: str, signal: str, what: str, **more: Any) -> Measure:
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
        **more,
    )


AXIS, OF_AXIS = "pointing_error", "pointing error"

METRICS = (
    _mean(f"mean_{AXIS}", AXIS, OF_AXIS, label="mean pointing error", role="error", rank=2),
    _final(f"final_{AXIS}", AXIS, OF_AXIS, label="final pointing error", compared=(WHOLE,)),
    _mean("mean_torque", "torque_norm", "||tau||", compared=(EARLY, WHOLE)),
    _integrated_square(
        "effort",
        "control effort, integral of ||tau||^2",
        signals=("torque_norm",),
        label="effort",
        of=effort,
        role="cost",
        rank=4,
    ),
    _peak("peak_torque", "torque_norm", "||tau||", compared=(WHOLE,), rank=5),
    _less_is_better(
        "early_torque",
        signals=("torque_norm",),
        of=time_mean,
        choices={"window_s": "early_window"},
        chosen=_early,
        role="cost",
        rank=LAST_RESORT,
        **_early(),
    ),
    _compared(
        "actuator_work",
        "integral of |<tau, V>|",
        units="J",
        signals=("torque", "velocity"),
        label="actuator work",
        formula=Symbol(r"\int |\langle \tau, V \rangle|\,\mathrm{d}t", "∫|⟨τ, V⟩| dt"),
        stored=False,
        of=actuator_work,
    ),
    _mean("mean_pose_error", "pose_error", "||I - Q_E||_F", role="error", rank=LAST_RESORT),
    _integrated_square(
        "squared_pose_error",
        "integral of ||I - Q_E||_F^2",
        signals=("pose_error",),
        label="squared error",
        stored=False,
        of=integral_of_square,
    ),
    _final("final_pose_error", "pose_error", "||I - Q_E||_F"),
    _mean(
        "mean_attitude_error",
        "attitude_angle",
        "attitude error",
        label="mean attitude error",
        role="error",
        rank=3,
    ),
    _final(
        "final_attitude_error", "attitude_angle", "the attitude error", label="final attitude error"
    ),
    _peak(
        "peak_attitude_error", "attitude_angle", "attitude error", label="largest attitude error"
    ),
    _mean("mean_position_error", "position_error", "||p - pd||"),
    _rms("position_rms", "position_error", "||p - pd||", compared=(WHOLE,), role="error", rank=1),
    _peak("peak_position_error", "position_error", "||p - pd||"),
    _final("final_position_error", "position_error", "||p - pd||", compared=(WHOLE,)),
    _rms("heading_rms", "heading_error", "the heading error", label="rms of the heading error"),
    _rms("attitude_command_rms", "attitude_command_error", "||R - Rc||_F"),
    _mean("mean_velocity_error", "velocity_error", "||V - Vd||", stored=False),
    _final("final_velocity_error", "velocity_error", "||V - Vd||"),
    _settling("settling_time", "pose_error", "||I - Q_E||_F", rank=6),
    Measure(
        "decay_rate",
        "half the slope of -log L",
        units="1/s",
        signals=("lyapunov",),
        symbol=Symbol(r"\sqrt{\mathcal{L}}", "√L"),
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
    Measure(
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
        implied_by="settling_time",
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
    _mean(
        "cut_share",
        "cut",
        "of 1 where limits change the command, else 0,",
        label="share of time that limits change the command",
        compared=(),
        stored_of=attrgetter("limits"),
    ),
    _final("propellant", "burnt", "mass", label="propellant", compared=(WHOLE,), stored_of=_burns),
    _final("final_stored_momentum", "stored_momentum", "||A h||", stored_of=attrgetter("wheels")),
    _closing("closing_pose_error", "pose_error", "||I - Q_E||_F"),
    _closing(
        "closing_attitude_error", "attitude_angle", "the attitude error", stored=False, compared=()
    ),
    _closing("closing_torque", "torque_norm", "||tau||"),
    _rms_of_estimate("estimate_rms", "estimate_error", "||I - Qhat^-1 Q||_F", compared=(WHOLE,)),
    _rms_of_estimate("bias_rms", "bias_error", "||b - bhat||"),
    _settling(
        "estimate_settling_time",
        "estimate_error",
        "||I - Qhat^-1 Q||_F",
        label="settling time of the estimate",
        stored_of=_estimates,
    ),
)
"""Metrics that compare controllers, in the order of tables; result files hold those `stored`."""

_ratio = partial(Measure, units="1", stored_of=_knows_covariance)

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


# The table of all quantities that a result holds or that follow from it, by name ------------------


STATUS_MEANINGS = "; ".join(
    f"{status.value} {status.name.lower()}" for status in Status if status >= 0
)

DESIRED = {"desired_pose": "pose", "desired_velocity": "velocity", "desired_torque": "torque"}
"""Stored quantities of the reference, and the signal that each corresponds to."""


def over_time(signal: Signal) -> Measure:
    """Return the row of a signal over time; files say the symbol of one that has `words`."""
    return Measure(
        signal.name,
        signal.words or signal.name.replace("_", " "),
        per=ValuePer.TRAJECTORY,
        signals=(signal.name,),
        symbol=signal.symbol,
        label="{}",
        dims=("time", *signal.dims),
        rank=signal.rank,
        notes={"symbol": signal.symbol.plain} if signal.words else {},
    )


_DESIRED = tuple(
    Measure(
        name,
        name.replace("_", " ") + ", from a separate solve",
        per=ValuePer.DESIRED,
        signals=(like,),
        symbol=Symbol(*(text + "_d" for text in SIGNALS[like].symbol)),
        label="{}",
        dims=("time", *SIGNALS[like].dims),
    )
    for name, like in DESIRED.items()
)

_INITIAL = tuple(
    Measure(f"initial_{x}", words, per=ValuePer.INITIAL, signals=(x,), dims=SIGNALS[x].dims)
    for x, words in (
        ("pose", "pose at the start, same for all laws"),
        ("velocity", "body velocity at the start"),
    )
)

_pure = partial(Measure, units="1")
_mixed = partial(Measure, units="mixed")

_OF_THE_RUN = (
    _pure("steps", "work of the solver, as its engine counts it", dtype=np.dtype("i8")),
    _pure("group_drift", "largest distance from the group", label="drift from the group", rank=-1),
    _pure(
        "energy_residual",
        "largest |L + W - L(0)| / max(L(0), 1 J)",
        signals=("lyapunov", "energy_balance"),
        label="energy residual",
        of=energy_residual,
    ),
    Measure(
        "unstable_distance",
        "smallest ||Q_E - Qc||_F, Qc critical points other than I",
        signals=("pose",),
        rank=-1,
    ),
    _mixed(
        "error_estimate",
        "largest max(||dQ||_F, ||dV||) against a tighter solve",
        label="error estimate",
    ),
    _mixed(
        "reference_residual",
        "distance of the run's own reference to desired_pose, desired_velocity",
        label="residual of the reference",
        rank=-1,
    ),
    _pure("status", "end of the run", dtype=np.dtype("i4"), notes={"meanings": STATUS_MEANINGS}),
    Measure("message", "why the run failed", units="", dtype=None),
)
"""Quality of the numbers, and outcome of the run; the run provides those without a formula."""


def over(row: Measure, window: Window) -> Measure:
    """Return a row over a window; what judges the numbers of a run is of all of it.

    A number at the end of the runs stays what it is.
    """
    at_the_end = row.of is final and math.isinf(window.stop)
    if at_the_end or row.of is energy_residual or not row.windowed:
        return row
    return replace(row, window=window)


QUANTITIES = {
    quantity.name: quantity
    for quantity in (
        *map(over_time, SIGNALS.values()),
        *_DESIRED,
        *_INITIAL,
        *METRICS,
        *CONSISTENCY,
        *_OF_THE_RUN,
    )
}
"""All quantities by name; the stored ones are in the order of result files."""

RANKED = sorted(
    (q for q in QUANTITIES.values() if q.per is ValuePer.RUN and 0 < q.rank < LAST_RESORT),
    key=attrgetter("rank"),
)
"""The numbers that come first where laws are compared."""

SUMMARY = (
    f"settling_time mean_{AXIS} final_{AXIS} mean_attitude_error mean_position_error position_rms "
    "final_attitude_error final_position_error early_torque mean_torque peak_torque "
    "mean_pose_error final_pose_error final_velocity_error energy_residual"
).split()
"""The numbers of a summary in its order: means over runs, and the largest energy residual."""

MEASURED = tuple(q for q in QUANTITIES.values() if q.per is ValuePer.RUN and q.of and q.stored)
"""Stored quantities that are computed from the signals of a run."""


def own_quantity(metric: type[Any], **more: Any) -> Measure:
    """Return the row of a metric of the user's own, which is `better` in the file, too."""
    name, words, better = metric.name, summary(metric).removesuffix("."), metric.better
    more |= {"units": metric.units, "signals": metric.signals, "constraint": metric.constraint}
    return _user_quantity(name, words, better, metric.censored, **more)


def _user_quantity(name: str, words: str, better: Better, censored: bool, **more: Any) -> Measure:
    more |= {"label": name.replace("_", " "), "better": better, "censored": censored}
    notes = {"better": better, "censored": int(censored)}
    if more.get("constraint"):
        notes["constraint"] = 1
    return Measure(name, words, notes=notes, compared=(WHOLE,), **more)


def _number(value: Any, default: float) -> float:
    """Return a number of a file, or the default where it is none."""
    is_number = isinstance(value, int | float | np.number)
    return float(value) if is_number and 0 < value < np.inf else default


def quantity_of(
    name: str, long_name: str = "", attributes: Mapping[str, Any] = MappingProxyType({})
) -> Measure:
    """Return the row of a variable by its name in a result file, and its attributes there.

    A part of a norm has the row of the norm with its own name. A metric of the user's own has the
    row of its file, or of its plugin. An unknown variable is a number per run without a formula.
    """
    if name in QUANTITIES:
        return QUANTITIES[name].with_choices(attributes)
    for better in get_args(Better):
        if attributes.get("better") == better:
            units, late = str(attributes.get("units", "")), attributes.get("censored") == 1
            of_all = attributes.get("constraint") == 1
            row = _user_quantity(
                name, long_name or name, better, late, units=units, constraint=of_all
            )
            start, stop = (attributes.get(f"{end}_s") for end in ("start", "stop"))
            return replace(row, window=Window(_number(start, 0.0), _number(stop, math.inf)))
    for row in MEASURED:
        if name.startswith(f"{row.name}_") and row.stored_by_part:
            return row.with_choices(attributes).part(name.removeprefix(f"{row.name}_"))
    if not attributes and name in (plugins := registry("metrics")).names():
        return own_quantity(plugins.get(name))
    if isinstance(plain := attributes.get("symbol"), str):
        return over_time(Signal(name, Symbol("", printable(plain)), "", words=long_name or name))
    if (signal := signal_of(name)) and signal.norm:
        return QUANTITIES[signal.name].part(name.removeprefix(f"{signal.name}_"))
    return Measure(name, long_name or name, units="")
