"""Signals over time, each by its formula."""

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from operator import attrgetter
from typing import Any, Literal

import numpy as np

from eqt_cli.base.arrays import Array, absolute, frobenius, less, norm, sqrt, stack, where
from eqt_cli.components.estimators import pivots, symmetric
from eqt_cli.components.groups import MatrixLieGroup, Part
from eqt_cli.components.laws import Controller
from eqt_cli.components.matrix_groups import heading_of, rigid_motions
from eqt_cli.components.mechanics import Tracking
from eqt_cli.components.vehicle import Vehicle, estimator_states
from eqt_cli.loop.closed_loop import ClosedLoop

# The estimate that a law is given, and its quality, at the last control instant -------------------
#
# Every function reads the estimator's states, which are among those of the vehicle, and returns NaN
# where there is no estimator, as at some points of a sweep.


def kept(s: Tracking, name: str, like: Array) -> Array:
    """Return the estimator state of this name; NaN in the shape of `like` if there is none."""
    states: Mapping[str, Array] = estimator_states(s.vehicle)
    return states[name] if name in states else np.nan + 0.0 * like


def pose(s: Tracking) -> Array:
    """Return the estimated pose Q̂."""
    return s.G.unpack(kept(s, "pose", s.G.pack(s.Q)))


def error(s: Tracking) -> Array:
    """Return the estimation error (ε, b̃) = (log(Q̂⁻¹Q), b − b̂), ``(..., 2m)``."""
    return kept(s, "error", np.concatenate([s.P, s.P], axis=-1))


def of_pose(s: Tracking) -> Array:
    """Return the error ε of the estimated pose."""
    return error(s)[..., : s.G.dimension]


def of_bias(s: Tracking) -> Array:
    """Return the error b̃ of the estimated bias."""
    return error(s)[..., s.G.dimension :]


def difference(s: Tracking) -> Array:
    """Return I − Q̂⁻¹Q."""
    return s.G.identity - s.G.exp(of_pose(s))


def deviations(s: Tracking) -> Array:
    """Return the standard deviations, the roots of the diagonal of Σ, ``(..., 2m)``."""
    n = 2 * s.G.dimension
    rows, columns = np.triu_indices(n)
    entries = _covariance(s)[..., np.flatnonzero(rows == columns)]
    return sqrt(where(less(0.0, entries), entries, 0.0))


def consistency(s: Tracking) -> tuple[Array, Array]:
    """Return (ε, b̃)ᵀ Σ⁻¹ (ε, b̃) and the number of its degrees of freedom, ``(...)`` each."""
    d, y = pivots(symmetric(_covariance(s), 2 * s.G.dimension), error(s))
    square = freedom = 0.0 * d[0]
    for pivot, value in zip(d, y, strict=True):
        counts = less(0.0, pivot)
        square = square + where(counts, value * value / where(counts, pivot, 1.0), 0.0)
        freedom = freedom + where(counts, 1.0, 0.0)
    return square, freedom


def innovations(s: Tracking) -> tuple[Array, Array, Array]:
    """Return the number, mean square and lag-one correlation of the innovations."""
    sums = kept(s, "innovations", stack([s.P[..., 0]] * 3))
    count, squares, products = (sums[..., k] for k in range(3))
    some = less(0.5, count)
    mean = where(some, squares / where(some, count, 1.0), np.nan)
    known = less(0.0, squares)
    return count, mean, where(known, products / where(known, squares, 1.0), np.nan)


def _covariance(s: Tracking) -> Array:
    """Return the entries of the covariance Σ on and above its diagonal."""
    n = 2 * s.G.dimension
    return kept(s, "covariance", stack([s.P[..., 0]] * (n * (n + 1) // 2)))


# Signals over time, with symbols and units, and their computation from states ---------------------
#
# Each signal is computed from the same laws that were integrated; none has a formula of its own
# beyond a norm.


MIXED = "mixed"
"""The unit of a signal whose units differ between parts of the coordinates."""


THRUSTER, WHEEL = "thruster", "wheel"
"""Names of the dimensions of thrusters and of wheels."""


@dataclass(frozen=True)
class Signal:
    """A quantity over time of one run.

    Attributes
    ----------
    name
        Its name in a result file.
    symbol
        Symbol of the paper, in LaTeX.
    long_name
        Its name in words.
    unit
        Its unit, or the attribute of a part of the coordinates that has it: ``pose_unit``.
    dims
        Dimensions beyond run and time: ``("row", "col")``, ``("axis",)`` or none.
    norm
        Whether it is the norm of the ``entries`` of a matrix, or along the ``axes`` of the
        coordinates; a norm also exists for each part of them.
    stored_of
        Whether it is stored for a vehicle; for others it repeats another signal or is empty.
    only_there
        Whether it is NaN for vehicles without it.
    exists_on
        Whether it exists on a group.
    exists_for
        Whether it exists for a law; it is stored if it does for any.
    """

    name: str
    symbol: str
    long_name: str
    unit: str
    dims: tuple[str, ...] = ()
    norm: Literal["", "entries", "axes"] = ""
    stored_of: Callable[[Vehicle], bool] = lambda vehicle: True
    only_there: bool = False
    exists_on: Callable[[MatrixLieGroup], bool] = lambda group: True
    exists_for: Callable[[Controller], bool] = lambda law: True

    def unit_in(self, part: Part) -> str:
        """Return its unit in a part of the coordinates."""
        return str(getattr(part, self.unit, self.unit))

    def units(self, group: MatrixLieGroup) -> str:
        """Return its unit on a group."""
        units = {self.unit_in(part) for part in group.parts}
        return units.pop() if len(units) == 1 else MIXED

    def parts(self, group: MatrixLieGroup) -> tuple[Part, ...]:
        """Return the parts with a norm of their own; empty if there is one part, or no norm."""
        return group.parts if self.norm and len(group.parts) > 1 else ()

    def value(self, of: Array, part: Part | None = None) -> Array:
        """Return it, or its norm in a part, from what it is the norm of."""
        if self.norm == "entries":
            return frobenius(of if part is None else of[(..., *part.entries)])
        if self.norm == "axes":
            return norm(of if part is None else of[..., part.axes])
        return of


_estimate = partial(Signal, stored_of=attrgetter("estimates"), only_there=True)
_filtered = partial(Signal, stored_of=attrgetter("knows_covariance"), only_there=True)
MATRIX, VECTOR = ("row", "col"), ("axis",)
LAST = ", at the last control instant"

SIGNALS = (
    Signal("pose", "Q", "pose Q", "pose_unit", MATRIX),
    Signal("velocity", "V", "body velocity V", "velocity_unit", VECTOR),
    Signal("torque", r"\tau", "control torque tau, body frame", "force_unit", VECTOR),
    Signal(
        "pose_error",
        r"\|I - Q_E\|_{\mathrm{F}}",
        "pose error ||I - Q Qd^-1||_F",
        "pose_unit",
        norm="entries",
    ),
    Signal(
        "velocity_error", r"\|V - V_d\|", "velocity error ||V - Vd||", "velocity_unit", norm="axes"
    ),
    Signal("torque_norm", r"\|\tau\|", "torque norm ||tau||", "force_unit", norm="axes"),
    Signal("lyapunov", r"\mathcal{L}", "Lyapunov function L", "J"),
    Signal(
        "position_error",
        r"\|p - p_d\|",
        "distance ||p - pd|| of the positions",
        "m",
        exists_on=rigid_motions,
    ),
    Signal(
        "heading_error",
        r"\psi_E",
        "size of the turn about the vertical in R Rd^T",
        "deg",
        exists_on=lambda group: rigid_motions(group) and group.space == 3,
    ),
    Signal(
        "attitude_command_error",
        r"\|R - R_c\|_{\mathrm{F}}",
        "distance ||R - Rc||_F from the attitude that the law commands",
        "1",
        exists_for=attrgetter("commands_attitude"),
    ),
    Signal(
        "command",
        "u",
        "torque that the law asks for, body frame",
        "force_unit",
        VECTOR,
        stored_of=lambda vehicle: bool(vehicle.actuators or vehicle.control),
    ),
    Signal(
        "at_limit",
        "s",
        "1 where an actuator is at its limit, else 0",
        "1",
        stored_of=attrgetter("limits"),
    ),
    Signal(
        "thrust",
        "f",
        "thrust of each thruster",
        "N",
        (THRUSTER,),
        stored_of=attrgetter("thruster_names"),
    ),
    Signal(
        "wheel_momentum",
        "h",
        "absolute momentum of each wheel about its axis",
        "N m s",
        (WHEEL,),
        stored_of=attrgetter("wheels"),
    ),
    Signal(
        "wheel_speed",
        r"\Omega",
        "speed of each wheel relative to the body",
        "rad/s",
        (WHEEL,),
        stored_of=lambda vehicle: bool(vehicle.wheels and vehicle.wheels[1].inertia is not None),
    ),
    _estimate("estimated_pose", r"\hat{Q}", f"estimated pose{LAST}", "pose_unit", MATRIX),
    _estimate(
        "estimated_velocity", r"\hat{V}", f"estimated body velocity{LAST}", "velocity_unit", VECTOR
    ),
    _estimate(
        "estimated_bias",
        r"\hat{b}",
        "estimated bias of the measured velocity",
        "velocity_unit",
        VECTOR,
    ),
    _estimate(
        "estimate_error",
        r"\|I - \hat{Q}^{-1} Q\|_{\mathrm{F}}",
        f"error of the estimated pose ||I - Qhat^-1 Q||_F{LAST}",
        "pose_unit",
        norm="entries",
    ),
    _estimate(
        "bias_error",
        r"\|b - \hat{b}\|",
        f"error of the estimated bias ||b - bhat||{LAST}",
        "velocity_unit",
        norm="axes",
    ),
    _estimate(
        "pose_estimate_error", r"\varepsilon", f"log(Qhat^-1 Q){LAST}", "length_unit", VECTOR
    ),
    _estimate("bias_estimate_error", r"\tilde{b}", f"b - bhat{LAST}", "velocity_unit", VECTOR),
    _filtered(
        "pose_estimate_std",
        r"\sigma_\varepsilon",
        "standard deviation of log(Qhat^-1 Q) by the filter",
        "length_unit",
        VECTOR,
    ),
    _filtered(
        "bias_estimate_std",
        r"\sigma_b",
        "standard deviation of b - bhat by the filter",
        "velocity_unit",
        VECTOR,
    ),
    _filtered(
        "nees", r"\mathrm{NEES}", "squared error of the estimate, normalised by its covariance", "1"
    ),
    _filtered("nees_dof", "n", "degrees of freedom of the normalised error", "1"),
    _filtered("innovations", "N", "number of normalised innovations so far", "1"),
    _filtered(
        "innovation_square", r"\nu^2", "mean square of the normalised innovations so far", "1"
    ),
    _filtered(
        "innovation_correlation",
        r"\rho_1",
        "correlation of successive normalised innovations so far",
        "1",
    ),
)
"""All signals, in the order of `compute`."""


def signal_of(name: str) -> Signal | None:
    """Return the signal of a name, which may end with a part: ``torque_norm_rotation``."""
    # The last one first: ``pose_error`` is no part of ``pose``.
    matching = (signal for signal in reversed(SIGNALS) if f"{name}_".startswith(f"{signal.name}_"))
    return next(matching, None)


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
    of = _formulas(loop, s)
    members = loop.vehicle.members
    for signal in SIGNALS:
        has_members = all(members.get(dim, True) for dim in signal.dims)
        if not (has_members and signal.exists_on(loop.group)):
            continue
        exists = not signal.only_there or signal.stored_of(loop.vehicle)
        always = not signal.only_there or (exists and not names)
        named = {f"{signal.name}_{part.name}": part for part in signal.parts(loop.group)}
        for name, part in {signal.name: None, **named}.items():
            if always or name in names:
                value = signal.value(of[signal.name](), part)
                # A compiled choice between numbers does not propagate NaN.
                yield name, value if exists else value + np.nan
    yield "energy_balance", of["lyapunov"]() + work


def _formulas(loop: ClosedLoop, s: Tracking) -> dict[str, Callable[[], Array]]:
    """Return how each signal follows from a state; of norms, what they are the norm of."""
    G: Any = s.G  # with translations, where positions exist
    m = s.G.dimension
    command = loop.command(s)
    torque = loop.torque(s) if loop.vehicle.actuators or loop.vehicle.control else command
    attitude = loop.controller.attitude_error(s)
    if attitude is None:
        with np.errstate(invalid="ignore"):  # symbols compare NaN
            attitude = s.P[..., 0] * 0.0 + np.nan
    at_limit, thrust = loop.at_limit(s), loop.vehicle.thrust(G, command, s.vehicle)
    momentum, speed = loop.vehicle.wheel_states(G, s.V, s.vehicle)
    L = loop.lyapunov(s)
    return {
        "pose": lambda: s.Q,
        "velocity": lambda: s.V,
        "torque": lambda: torque,
        "pose_error": lambda: G.identity - s.Q_E,
        "velocity_error": lambda: s.V_tilde,
        "torque_norm": lambda: torque,
        "lyapunov": lambda: L,
        "position_error": lambda: frobenius(G.translations(s.Q) - G.translations(s.Qd)),
        "heading_error": lambda: absolute(heading_of(G, s.Q_E)) * (180 / np.pi),
        "attitude_command_error": lambda: attitude,
        "command": lambda: command,
        "at_limit": lambda: at_limit,
        "thrust": lambda: thrust,
        "wheel_momentum": lambda: momentum,
        "wheel_speed": lambda: speed,
        "estimated_pose": lambda: pose(s),
        "estimated_velocity": lambda: kept(s, "velocity", s.P),
        "estimated_bias": lambda: kept(s, "bias", s.P),
        "estimate_error": lambda: difference(s),
        "bias_error": lambda: of_bias(s),
        "pose_estimate_error": lambda: of_pose(s),
        "bias_estimate_error": lambda: of_bias(s),
        "pose_estimate_std": lambda: deviations(s)[..., :m],
        "bias_estimate_std": lambda: deviations(s)[..., m:],
        "nees": lambda: consistency(s)[0],
        "nees_dof": lambda: consistency(s)[1],
        "innovations": lambda: innovations(s)[0],
        "innovation_square": lambda: innovations(s)[1],
        "innovation_correlation": lambda: innovations(s)[2],
    }
