"""The formulas of signals over time; and metrics of a user's own."""

import math
import re
from abc import abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import accumulate
from operator import attrgetter
from typing import Any, ClassVar, NamedTuple, TypeAlias, get_args

import numpy as np

from eqt_cli.base.arrays import Array, absolute, frobenius, less, norm, outside, sqrt, stack, where
from eqt_cli.base.errors import Problems, suggestion
from eqt_cli.base.registry import Component, Registry
from eqt_cli.base.stored import MIXED, OUTPUT, SIGNALS, Better, Signal
from eqt_cli.components.blocks import COMMAND, Now, beyond_limits, cut_axes, signals
from eqt_cli.components.estimators import pivots, symmetric
from eqt_cli.components.groups import MatrixLieGroup, Part, command_axes
from eqt_cli.components.laws import Controller, OuterLoop, output_units, outputs, stored_numbers
from eqt_cli.components.matrix_groups import heading_of, rigid, rigid_motions, turn_of_distance
from eqt_cli.components.mechanics import Tracking
from eqt_cli.components.vehicle import PROPELLANT, Vehicle, estimator_states, requested_torque
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.numbers.running import SampledRuns


def output_names(law: Controller, G: MatrixLieGroup) -> dict[str, str]:
    """Return the units of the stored numbers of a law, by names such as ``integral_1``."""
    units = output_units(law)
    return {
        f"{name}_{k + 1}" if length > 1 else name: units.get(name, "1")
        for name, length in outputs(law, G).items()
        for k in range(length)
    }


class LoopState(NamedTuple):
    """What signals follow from: all that a law reads, and what the loop makes of it."""

    s: Tracking
    loop: ClosedLoop
    now: Now
    lyapunov: Array

    @property
    def none(self) -> Array:
        """NaN, for what a loop does not have."""
        with np.errstate(invalid="ignore"):  # symbols compare NaN
            return self.s.P[..., 0] * 0.0 + np.nan


def _output(loop: ClosedLoop, s: Tracking) -> Array:
    """Return the numbers of the law that are stored, in the order of `output_names`."""
    law, empty = loop.controller, s.P[..., :0]
    numbers = stored_numbers(law, loop.seen(s))
    values = [numbers[name] + 0.0 * s.P[..., :1] for name in outputs(law, loop.group)]
    return np.concatenate([empty, *values], axis=-1)


Formula: TypeAlias = Callable[[LoopState], Array]


@dataclass(frozen=True)
class LoopSignal(Signal):
    """A signal, and how it follows from a loop.

    Attributes
    ----------
    formula
        How it follows from a state; of a norm, the matrix or vector that it is the norm of.
    stored_of
        Whether it is stored for a vehicle; for others it repeats another signal or is empty.
    only_there
        Whether it is NaN for vehicles without it.
    exists_on
        Whether it exists on a group.
    exists_for
        Whether it exists for a loop; it is stored if it does for that of any law.
    """

    formula: Formula = attrgetter("s")
    stored_of: Callable[[Vehicle], bool] = lambda vehicle: True
    only_there: bool = False
    exists_on: Callable[[MatrixLieGroup], bool] = lambda group: True
    exists_for: Callable[[ClosedLoop], bool] = lambda loop: True

    @property
    def long_name(self) -> str:
        """Its name in words."""
        return self.words or str(self.formula.__doc__).removesuffix(".")

    def units(self, group: MatrixLieGroup) -> str:
        """Return its unit on a group."""
        units = {self.unit_in(part) for part in group.parts}
        return units.pop() if len(units) == 1 else MIXED

    def parts(self, group: MatrixLieGroup) -> tuple[Part, ...]:
        """Return the parts with a norm of their own; empty if there is one part, or no norm."""
        if self.norm == "each":
            return tuple(
                replace(part, name=command_axes(group)[k].replace(" ", "_"), axes=slice(k, k + 1))
                for part in group.parts
                for k in range(group.dimension)[part.axes]
            )
        return group.parts if self.norm and len(group.parts) > 1 else ()

    def value(self, of: Array, part: Part | None = None) -> Array:
        """Return it, or its norm in a part, from what it is the norm of."""
        if self.norm == "entries":
            return frobenius(of if part is None else of[(..., *part.entries)])
        if self.norm == "axes":
            return norm(of if part is None else of[..., part.axes])
        if self.norm == "each":
            return outside(of if part is None else of[..., part.axes], 0.0, 0.5)
        return of


_WRITTEN: dict[str, LoopSignal] = {}
"""The signals whose formulas are here, by name."""


def _signal(**conditions: Any) -> Callable[[Formula], Formula]:
    """Add the formula of a signal, whose docstring without the full stop is its name in words."""

    def added(formula: Formula) -> Formula:
        signal = vars(SIGNALS[formula.__name__])
        _WRITTEN[formula.__name__] = LoopSignal(**signal, formula=formula, **conditions)
        return formula

    return added


# The motion, and the torques ----------------------------------------------------------------------
#
# Each signal is computed from the same laws that were integrated; none has a formula of its own
# beyond a norm.


@_signal()
def pose(x: LoopState) -> Array:
    """pose Q."""
    return x.s.Q


@_signal()
def velocity(x: LoopState) -> Array:
    """body velocity V."""
    return x.s.V


@_signal()
def torque(x: LoopState) -> Array:
    """control torque tau, body frame."""
    return x.now["forces.torque"]


@_signal()
def pose_error(x: LoopState) -> Array:
    """pose error ||I - Q Qd^-1||_F."""
    return x.s.G.identity - x.s.Q_E


@_signal()
def velocity_error(x: LoopState) -> Array:
    """velocity error ||V - Vd||."""
    return x.s.V_tilde


@_signal()
def torque_norm(x: LoopState) -> Array:
    """torque norm ||tau||."""
    return x.now["forces.torque"]


@_signal()
def lyapunov(x: LoopState) -> Array:
    """Lyapunov function L."""
    return x.lyapunov


@_signal(exists_on=rigid_motions)
def position_error(x: LoopState) -> Array:
    """distance ||p - pd|| of the positions."""
    G = rigid(x.s.G)
    return frobenius(G.translations(x.s.Q) - G.translations(x.s.Qd))


def _rotations(group: MatrixLieGroup) -> list[Part]:
    return [part for part in group.parts if part.turns]


@_signal(exists_for=lambda loop: not loop.task.is_whole)
def pointing_error(x: LoopState) -> Array:
    """angle between the axis that points and where it is to point."""
    if x.loop.task.is_whole:
        return x.none
    distance = x.loop.task.part_error(x.s.Q, x.s.Qd, _rotations(x.s.G)[0])
    return turn_of_distance(distance) * (180 / np.pi)


@_signal(
    exists_on=lambda group: len(_rotations(group)) == 1, exists_for=attrgetter("task.is_whole")
)
def attitude_angle(x: LoopState) -> Array:
    """angle of the rotation R_E = R Rd^T."""
    [rotation] = _rotations(x.s.G)
    distance = frobenius((x.s.G.identity - x.s.Q_E)[(..., *rotation.entries)])
    return turn_of_distance(distance) * (180 / np.pi)


@_signal(exists_on=lambda group: rigid_motions(group) and group.space == 3)
def heading_error(x: LoopState) -> Array:
    """size of the turn about the vertical in R Rd^T."""
    return absolute(heading_of(rigid(x.s.G), x.s.Q_E)) * (180 / np.pi)


@_signal(exists_for=lambda loop: isinstance(loop.controller.formula, OuterLoop))
def attitude_command_error(x: LoopState) -> Array:
    """distance ||R - Rc||_F from the attitude that the law commands."""
    law = x.loop.controller.formula
    return law.attitude_error(x.loop.seen(x.s)) if isinstance(law, OuterLoop) else x.none


# The actuators ------------------------------------------------------------------------------------


@_signal(stored_of=lambda of: bool(of.actuators or of.control))
def command(x: LoopState) -> Array:
    """torque that the law asks for, body frame."""
    return requested_torque(x.loop.vehicle, x.now[COMMAND])


@_signal(stored_of=attrgetter("limits"))
def at_limit(x: LoopState) -> Array:
    """1 where an actuator is at its limit, else 0."""
    return beyond_limits(x.now)


@_signal(stored_of=lambda of: False)
def cut(x: LoopState) -> Array:
    """1 where limits change the command, else 0."""
    return cut_axes(x.now, x.loop.vehicle.limits)


@_signal(stored_of=attrgetter("burns"), only_there=True)
def burnt(x: LoopState) -> Array:
    """propellant that thrusters have burnt."""
    return x.s.vehicle.get(PROPELLANT, np.nan * x.s.P)[..., 0]


@_signal(stored_of=attrgetter("wheels"))
def stored_momentum(x: LoopState) -> Array:
    """momentum that the wheels store together, ||A h||."""
    return signals(x.now).get("stored_momentum", 0.0 * x.s.P[..., 0])


@_signal()
def law_output(x: LoopState) -> Array:
    """numbers of the law itself: its memory, and what else it gives."""
    return _output(x.loop, x.s)


# The estimate that a law reads, and its quality, at the last control instant ----------------------
#
# Every formula reads the estimator's states, which are among those of the vehicle, and returns NaN
# where there is no estimator, as at some points of a sweep.


_estimate = partial(_signal, stored_of=attrgetter("estimates"), only_there=True)
_filtered = partial(_signal, stored_of=attrgetter("knows_covariance"), only_there=True)


def estimator_state(s: Tracking, name: str, like: Array) -> Array:
    """Return the estimator state of this name; NaN in the shape of `like` if there is none."""
    states: Mapping[str, Array] = estimator_states(s.vehicle)
    return states[name] if name in states else np.nan + 0.0 * like


def error(s: Tracking) -> Array:
    """Return the estimation error (ε, b̃, …) = (log(Q̂⁻¹Q), b − b̂, …), ``(..., n)``, n ≥ 2m."""
    return estimator_state(s, "error", np.concatenate([s.P, s.P], axis=-1))


def of_pose(s: Tracking) -> Array:
    """Return the error ε of the estimated pose."""
    return error(s)[..., : s.G.dimension]


def of_bias(s: Tracking) -> Array:
    """Return the error b̃ of the estimated bias."""
    return error(s)[..., s.G.dimension : 2 * s.G.dimension]


def deviations(s: Tracking) -> Array:
    """Return the standard deviations, the roots of the diagonal of Σ, ``(..., 2m)``."""
    entries = _covariance(s)[..., range(2 * s.G.dimension), range(2 * s.G.dimension)]
    return sqrt(where(less(0.0, entries), entries, 0.0))


def consistency(s: Tracking) -> tuple[Array, Array]:
    """Return (ε, b̃)ᵀ Σ⁻¹ (ε, b̃) and the number of its degrees of freedom, ``(...)`` each."""
    d, y = pivots(_covariance(s), error(s))
    square = freedom = 0.0 * d[0]
    for pivot, value in zip(d, y, strict=True):
        counts = less(0.0, pivot)
        square = square + where(counts, value * value / where(counts, pivot, 1.0), 0.0)
        freedom = freedom + where(counts, 1.0, 0.0)
    return square, freedom


def of_innovations(s: Tracking) -> tuple[Array, Array, Array]:
    """Return the number, mean square and lag-one correlation of the innovations."""
    sums = estimator_state(s, "innovations", stack([s.P[..., 0]] * 3))
    count, squares, products = (sums[..., k] for k in range(3))
    some = less(0.5, count)
    mean = where(some, squares / where(some, count, 1.0), np.nan)
    positive = less(0.0, squares)
    return count, mean, where(positive, products / where(positive, squares, 1.0), np.nan)


def _covariance(s: Tracking) -> Array:
    """Return the covariance of (ε, b̃, …), ``(..., n, n)``; other errors stand behind them in Σ."""
    n = error(s).shape[-1]
    entries = estimator_state(s, "covariance", stack([s.P[..., 0]] * (n * (n + 1) // 2)))
    return symmetric(entries, (math.isqrt(8 * entries.shape[-1] + 1) - 1) // 2)[..., :n, :n]


@_estimate()
def estimated_pose(x: LoopState) -> Array:
    """estimated pose, at the last control instant."""
    return x.s.G.unpack(estimator_state(x.s, "pose", x.s.G.pack(x.s.Q)))


@_estimate()
def estimated_velocity(x: LoopState) -> Array:
    """estimated body velocity, at the last control instant."""
    return estimator_state(x.s, "velocity", x.s.P)


@_estimate()
def estimated_bias(x: LoopState) -> Array:
    """estimated bias of the measured velocity."""
    return estimator_state(x.s, "bias", x.s.P)


@_estimate()
def estimate_error(x: LoopState) -> Array:
    """error of the estimated pose ||I - Qhat^-1 Q||_F, at the last control instant."""
    return x.s.G.identity - x.s.G.exp(of_pose(x.s))


@_estimate()
def bias_error(x: LoopState) -> Array:
    """error of the estimated bias ||b - bhat||, at the last control instant."""
    return of_bias(x.s)


@_estimate()
def pose_estimate_error(x: LoopState) -> Array:
    """log(Qhat^-1 Q), at the last control instant."""
    return of_pose(x.s)


@_estimate()
def bias_estimate_error(x: LoopState) -> Array:
    """b - bhat, at the last control instant."""
    return of_bias(x.s)


@_filtered()
def pose_estimate_std(x: LoopState) -> Array:
    """standard deviation of log(Qhat^-1 Q) by the filter."""
    return deviations(x.s)[..., : x.s.G.dimension]


@_filtered()
def bias_estimate_std(x: LoopState) -> Array:
    """standard deviation of b - bhat by the filter."""
    return deviations(x.s)[..., x.s.G.dimension :]


@_filtered()
def nees(x: LoopState) -> Array:
    """squared error of the estimate, normalised by its covariance."""
    return consistency(x.s)[0]


@_filtered()
def nees_dof(x: LoopState) -> Array:
    """degrees of freedom of the normalised error."""
    return consistency(x.s)[1]


@_filtered()
def innovations(x: LoopState) -> Array:
    """number of normalised innovations so far."""
    return of_innovations(x.s)[0]


@_filtered()
def innovation_square(x: LoopState) -> Array:
    """mean square of the normalised innovations so far."""
    return of_innovations(x.s)[1]


@_filtered()
def innovation_correlation(x: LoopState) -> Array:
    """correlation of successive normalised innovations so far."""
    return of_innovations(x.s)[2]


# Signals of actuators, whose formulas are in their files ------------------------------------------


FORMULAS = {name: _WRITTEN[name] for name in SIGNALS}
"""All signals but those of actuators, by name, in the order of `compute`."""


def formulas_of(vehicle: Vehicle) -> dict[str, LoopSignal]:
    """Return `FORMULAS`, and the signals that the actuators of a vehicle show."""

    def of_actuator(name: str) -> Formula:
        return lambda x: signals(x.now)[name]

    return FORMULAS | {
        name: LoopSignal(**vars(signal), formula=of_actuator(name))
        for name, signal in vehicle.shows.items()
        if signal.words
    }


# Evaluation ---------------------------------------------------------------------------------------


def holds(vehicle: Vehicle) -> dict[str, float]:
    """Return the signals that are held between ticks, with the time between two changes, s."""
    if vehicle.control is None:
        return {}
    period = vehicle.tick if vehicle.clocks else vehicle.control.period
    held = [] if vehicle.moving else ["torque", "torque_norm"]
    held += [] if any(part.limits for part in vehicle.moving) else ["at_limit", "cut"]
    return dict.fromkeys(held, period)


def compute(loop: ClosedLoop, times: Array, states: Array) -> dict[str, Array]:
    """Compute all signals at the sample times, and the energy balance L + W.

    Parameters
    ----------
    loop
        Closed loop with parameters that broadcast over ``(runs, samples)``.
    times : (samples,)
    states : (runs, samples, n)

    Returns
    -------
    dict
        One array ``(runs, samples, …)`` per signal, and ``energy_balance``, L(t) + W(t), which is
        NaN where the dissipation is not known.
    """
    values = dict(at_state(loop, loop.tracking(times, states), loop.work(states)))
    if not knows_energy(loop, times, states):
        values["energy_balance"] = np.full_like(values["energy_balance"], np.nan)
    return values


def knows_energy(loop: ClosedLoop, times: Array, states: Array) -> bool:
    """Return whether L + W is a balance: whether the dissipation of the law is known."""
    return loop.dissipation(loop.tracking(times[:1], states[:, :1])) is not None


def at_state(
    loop: ClosedLoop, s: Tracking, work: Array, names: Collection[str] = ()
) -> Iterator[tuple[str, Array]]:
    """Yield every signal and L + W, by name, as floats or symbols.

    Parameters
    ----------
    names
        The requested signals of estimates, NaN where there is no estimate; if empty, all that
        exist.
    """
    state = LoopState(s, loop, loop.now(s), loop.lyapunov(s))
    for name, (signal, part) in existing(loop).items():
        exists = not signal.only_there or signal.stored_of(loop.vehicle)
        if not signal.only_there or (exists and not names) or name in names:
            value = signal.value(signal.formula(state), part)
            # A compiled choice between numbers does not propagate NaN.
            yield name, value if exists else value + np.nan
    yield "energy_balance", state.lyapunov + work


def existing(loop: ClosedLoop) -> dict[str, tuple[LoopSignal, Part | None]]:
    """Return the signals of a loop and those of their parts, by name."""
    vehicle, lengths = loop.vehicle, {OUTPUT: outputs(loop.controller, loop.group)}
    return {
        f"{signal.name}_{part.name}" if part else signal.name: (signal, part)
        for signal in formulas_of(vehicle).values()
        if all(lengths.get(dim, True) for dim in signal.dims) and signal.exists_on(loop.group)
        for part in (None, *signal.parts(loop.group))
    }


# Metrics of a user's own --------------------------------------------------------------------------


@dataclass(frozen=True)
class Metric(Component):
    """A number of each run, from its signals; the first line of the docstring is its long name.

    Attributes
    ----------
    signals
        What `of` is given: signals by name, and numbers of the laws, such as their memory, which
        are NaN for a law without them.
    units
        Its unit. ``{}`` stands for the unit of the first signal, as in ``({})^2 s``.
    better
        Which values are better: ``lower``, ``higher`` or ``neither``.
    censored
        Whether NaN means: later than the end of the run. The number then counts as the horizon, as
        a settling time does.
    constraint
        Whether it judges a constraint. It is then taken of the whole of each run, whatever
        `measure` says, and of times between the samples, too: so many that `lines` are right.
    """

    signals: ClassVar[tuple[str, ...]]
    units: ClassVar[str]
    better: ClassVar[Better]
    censored: ClassVar[bool] = False
    constraint: ClassVar[bool] = False

    @abstractmethod
    def of(self, over: SampledRuns, *signals: Any) -> Any:
        """Return the number of each run, ``(runs,)``.

        It is compiled if it goes along the time by the functions of `over` alone; else it is
        computed from stored samples.

        Parameters
        ----------
        over
            The samples, with `mean`, `integral`, `largest`, `smallest`, `initial`, `final`, …
        signals : (runs, samples, …)
            The values at the samples; a number of a law has no last axis if it is a single one.
        """

    def lines(self, over: SampledRuns, *signals: Any) -> Array:
        """Return what a constraint takes as straight between times, ``(runs, times, k)``.

        By default the signals; to 1e-6, whatever their unit.
        """
        return np.concatenate([x.reshape(*x.shape[:2], -1) for x in signals], axis=-1)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note problems of its options."""

    def lacking(self, loop: ClosedLoop) -> list[str]:
        """Return the signals that a loop does not have."""
        return [x for x in self.signals if x not in existing(loop) and x not in outputs_of(loop)]

    def unknown(self, loops: Collection[ClosedLoop]) -> str:
        """Return what it reads that no loop has, in words; "" if there is nothing."""
        names = sorted({name for loop in loops for name in (*existing(loop), *outputs_of(loop))})
        for name in self.signals:
            if name not in names:
                hint = suggestion(name, names) or f"; there are: {', '.join(names)}"
                return f"metric {self.name} reads '{name}', but no loop has it{hint}"
        return ""

    def wrong(self, loops: Collection[ClosedLoop]) -> Iterator[str]:
        """Yield what is wrong with what its class says."""
        if not (re.fullmatch(r"[A-Za-z]\w*", self.name, re.ASCII) and self.name.isidentifier()):
            yield f"metric {self.name!r}: expected a name of letters, digits and _"
        if self.better not in get_args(Better):
            words = ", ".join(get_args(Better))
            yield f"metric {self.name}: better: expected {words}, got {self.better!r}"
        if not self.signals:
            yield f"metric {self.name} reads no signal; name at least one in `signals`"
        for name in sorted(set(self.signals)):
            if any(name in existing(loop) and name in outputs_of(loop) for loop in loops):
                both = "a signal and a number of a law"
                yield f"metric {self.name} reads '{name}', {both}; rename this"

    def signals_at(self, loop: ClosedLoop, states: Array, times: Array) -> list[Array]:
        """Return the values of its signals in some states."""
        values = values_at(loop, loop.tracking(times, states), states, self.signals)
        return [values[name] for name in self.signals]


NO_ENTRY = "; what `eqt compare RESULT --metric NAME` computes of any result needs no entry"
metrics = Registry("metric", "metrics", Metric, ("loop.signals",), NO_ENTRY)


def outputs_of(loop: ClosedLoop) -> Mapping[str, int]:
    """Return the lengths of the numbers of a law, by name."""
    return outputs(loop.controller, loop.group)


def values_at(
    loop: ClosedLoop, s: Tracking, states: Array, names: Collection[str]
) -> dict[str, Array]:
    """Return signals, and numbers of the law, by these names, as floats or symbols.

    A single number of the law has no last axis.
    """
    lengths = outputs_of(loop)
    pieces = np.split(_output(loop, s), list(accumulate(lengths.values()))[:-1], axis=-1)
    pairs = zip(lengths, pieces, strict=False)  # no numbers are one empty piece
    values = {name: v[..., 0] if v.shape[-1] == 1 else v for name, v in pairs}
    values |= dict(at_state(loop, s, loop.work(states), names))
    return {name: value for name, value in values.items() if name in names}
