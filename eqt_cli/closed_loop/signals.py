"""Signals over time, with symbols and units, and their computation from states.

Each signal is computed from the same laws that were integrated; none has a formula of its own
beyond a norm.
"""

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from eqt_cli.closed_loop import estimates
from eqt_cli.closed_loop.system import ClosedLoop
from eqt_cli.controllers import Controller
from eqt_cli.core.arrays import Array, absolute, frobenius, norm
from eqt_cli.groups import MatrixLieGroup, Part
from eqt_cli.groups.euclidean import heading_of, rigid_motions
from eqt_cli.mechanics.tracking import Tracking
from eqt_cli.vehicle import Vehicle

MIXED = "mixed"
"""The unit of a signal whose units differ between parts of the coordinates."""


THRUSTER, WHEEL = "thruster", "wheel"
"""Names of the dimensions of thrusters and of wheels."""


class LoopOutputs(NamedTuple):
    """Command of the law, outputs of the actuators and Lyapunov function, over time.

    Attributes
    ----------
    torque, command : (..., m)
        Torque of the actuators and command of the law, body frame.
    at_limit : (...)
        1 where an actuator is at its limit, else 0.
    thrust : (..., k)
        Thrust of each thruster.
    wheel_momentum, wheel_speed : (..., k)
        Momentum of each wheel, and its speed relative to the body.
    lyapunov : (...)
        Lyapunov function L of the law.
    attitude_error : (...)
        ‖R − R_c‖_F of a law that commands an attitude; NaN for others.
    """

    torque: Array
    command: Array
    at_limit: Array
    thrust: Array
    wheel_momentum: Array
    wheel_speed: Array
    lyapunov: Array
    attitude_error: Array


@dataclass(frozen=True)
class Signal:
    """A quantity over time of one run.

    Attributes
    ----------
    name
        Its name in a result file.
    dims
        Dimensions beyond run and time: ``("row", "col")``, ``("axis",)`` or none.
    symbol
        Symbol of the paper, in LaTeX.
    long_name
        Its name in words.
    unit_in
        Its unit in a part of the coordinates.
    of
        Computes it from the tracking state and the outputs.
    of_part
        Computes a norm for one part of the coordinates; None for all other signals.
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
    dims: tuple[str, ...]
    symbol: str
    long_name: str
    unit_in: Callable[[Part], str]
    of: Callable[[Tracking, LoopOutputs], Array]
    of_part: Callable[[Tracking, LoopOutputs, Part], Array] | None = None
    stored_of: Callable[[Vehicle], bool] = lambda vehicle: True
    only_there: bool = False
    exists_on: Callable[[MatrixLieGroup], bool] = lambda group: True
    exists_for: Callable[[Controller], bool] = lambda law: True

    def units(self, group: MatrixLieGroup) -> str:
        """Return its unit on a group."""
        found = {self.unit_in(part) for part in group.parts}
        return found.pop() if len(found) == 1 else MIXED

    def parts(self, group: MatrixLieGroup) -> tuple[Part, ...]:
        """Return the parts with a norm of their own; empty if there is one part, or no norm."""
        return group.parts if self.of_part and len(group.parts) > 1 else ()


def _position_error(s: Tracking, given: LoopOutputs) -> Array:
    assert rigid_motions(s.G)
    return frobenius(s.G.translations(s.Q) - s.G.translations(s.Qd))


def _heading_error(s: Tracking, given: LoopOutputs) -> Array:
    assert rigid_motions(s.G)
    return absolute(heading_of(s.G, s.Q_E)) * (180 / np.pi)


_estimate = partial(Signal, stored_of=lambda vehicle: vehicle.estimates, only_there=True)
_filtered = partial(Signal, stored_of=lambda vehicle: vehicle.knows_covariance, only_there=True)

SIGNALS = (
    Signal(
        "pose", ("row", "col"), "Q", "pose Q", lambda part: part.pose_unit, lambda s, given: s.Q
    ),
    Signal(
        "velocity",
        ("axis",),
        "V",
        "body velocity V",
        lambda part: part.velocity_unit,
        lambda s, given: s.V,
    ),
    Signal(
        "torque",
        ("axis",),
        r"\tau",
        "control torque tau, body frame",
        lambda part: part.force_unit,
        lambda s, given: given.torque,
    ),
    Signal(
        "pose_error",
        (),
        r"\|I - Q_E\|_{\mathrm{F}}",
        "pose error ||I - Q Qd^-1||_F",
        lambda part: part.pose_unit,
        lambda s, given: frobenius(s.G.identity - s.Q_E),
        lambda s, given, part: frobenius((s.G.identity - s.Q_E)[(..., *part.entries)]),
    ),
    Signal(
        "velocity_error",
        (),
        r"\|V - V_d\|",
        "velocity error ||V - Vd||",
        lambda part: part.velocity_unit,
        lambda s, given: norm(s.V_tilde),
        lambda s, given, part: norm(s.V_tilde[..., part.axes]),
    ),
    Signal(
        "torque_norm",
        (),
        r"\|\tau\|",
        "torque norm ||tau||",
        lambda part: part.force_unit,
        lambda s, given: norm(given.torque),
        lambda s, given, part: norm(given.torque[..., part.axes]),
    ),
    Signal(
        "lyapunov",
        (),
        r"\mathcal{L}",
        "Lyapunov function L",
        lambda part: "J",
        lambda s, given: given.lyapunov,
    ),
    Signal(
        "position_error",
        (),
        r"\|p - p_d\|",
        "distance ||p - pd|| of the positions",
        lambda part: "m",
        _position_error,
        exists_on=rigid_motions,
    ),
    Signal(
        "heading_error",
        (),
        r"\psi_E",
        "size of the turn about the vertical in R Rd^T",
        lambda part: "deg",
        _heading_error,
        exists_on=lambda group: rigid_motions(group) and group.space == 3,
    ),
    Signal(
        "attitude_command_error",
        (),
        r"\|R - R_c\|_{\mathrm{F}}",
        "distance ||R - Rc||_F from the attitude that the law commands",
        lambda part: "1",
        lambda s, given: given.attitude_error,
        exists_for=lambda law: law.commands_attitude,
    ),
    Signal(
        "command",
        ("axis",),
        r"u",
        "torque that the law asks for, body frame",
        lambda part: part.force_unit,
        lambda s, given: given.command,
        stored_of=lambda vehicle: bool(vehicle.actuators or vehicle.control),
    ),
    Signal(
        "at_limit",
        (),
        r"s",
        "1 where an actuator is at its limit, else 0",
        lambda part: "1",
        lambda s, given: given.at_limit,
        stored_of=lambda vehicle: vehicle.limits,
    ),
    Signal(
        "thrust",
        (THRUSTER,),
        r"f",
        "thrust of each thruster",
        lambda part: "N",
        lambda s, given: given.thrust,
        stored_of=lambda vehicle: bool(vehicle.thruster_names),
    ),
    Signal(
        "wheel_momentum",
        (WHEEL,),
        r"h",
        "absolute momentum of each wheel about its axis",
        lambda part: "N m s",
        lambda s, given: given.wheel_momentum,
        stored_of=lambda vehicle: vehicle.wheels is not None,
    ),
    Signal(
        "wheel_speed",
        (WHEEL,),
        r"\Omega",
        "speed of each wheel relative to the body",
        lambda part: "rad/s",
        lambda s, given: given.wheel_speed,
        stored_of=lambda vehicle: bool(vehicle.wheels and vehicle.wheels[1].inertia is not None),
    ),
    _estimate(
        "estimated_pose",
        ("row", "col"),
        r"\hat{Q}",
        "estimated pose, at the last control instant",
        lambda part: part.pose_unit,
        lambda s, given: estimates.pose(s),
    ),
    _estimate(
        "estimated_velocity",
        ("axis",),
        r"\hat{V}",
        "estimated body velocity, at the last control instant",
        lambda part: part.velocity_unit,
        lambda s, given: estimates.velocity(s),
    ),
    _estimate(
        "estimated_bias",
        ("axis",),
        r"\hat{b}",
        "estimated bias of the measured velocity",
        lambda part: part.velocity_unit,
        lambda s, given: estimates.bias(s),
    ),
    _estimate(
        "estimate_error",
        (),
        r"\|I - \hat{Q}^{-1} Q\|_{\mathrm{F}}",
        "error of the estimated pose ||I - Qhat^-1 Q||_F, at the last control instant",
        lambda part: part.pose_unit,
        lambda s, given: estimates.distance(s),
        lambda s, given, part: estimates.distance(s, part),
    ),
    _estimate(
        "bias_error",
        (),
        r"\|b - \hat{b}\|",
        "error of the estimated bias ||b - bhat||, at the last control instant",
        lambda part: part.velocity_unit,
        lambda s, given: estimates.bias_norm(s),
        lambda s, given, part: estimates.bias_norm(s, part),
    ),
    _estimate(
        "pose_estimate_error",
        ("axis",),
        r"\varepsilon",
        "log(Qhat^-1 Q), at the last control instant",
        estimates.length_unit,
        lambda s, given: estimates.of_pose(s),
    ),
    _estimate(
        "bias_estimate_error",
        ("axis",),
        r"\tilde{b}",
        "b - bhat, at the last control instant",
        lambda part: part.velocity_unit,
        lambda s, given: estimates.of_bias(s),
    ),
    _filtered(
        "pose_estimate_std",
        ("axis",),
        r"\sigma_\varepsilon",
        "standard deviation of log(Qhat^-1 Q) by the filter",
        estimates.length_unit,
        lambda s, given: estimates.deviations(s)[..., : s.G.dimension],
    ),
    _filtered(
        "bias_estimate_std",
        ("axis",),
        r"\sigma_b",
        "standard deviation of b - bhat by the filter",
        lambda part: part.velocity_unit,
        lambda s, given: estimates.deviations(s)[..., s.G.dimension :],
    ),
    _filtered(
        "nees",
        (),
        r"\mathrm{NEES}",
        "squared error of the estimate, normalised by its covariance",
        lambda part: "1",
        lambda s, given: estimates.consistency(s)[0],
    ),
    _filtered(
        "nees_dof",
        (),
        r"n",
        "degrees of freedom of the normalised error",
        lambda part: "1",
        lambda s, given: estimates.consistency(s)[1],
    ),
    _filtered(
        "innovations",
        (),
        r"N",
        "number of normalised innovations so far",
        lambda part: "1",
        lambda s, given: estimates.innovations(s)[0],
    ),
    _filtered(
        "innovation_square",
        (),
        r"\nu^2",
        "mean square of the normalised innovations so far",
        lambda part: "1",
        lambda s, given: estimates.innovations(s)[1],
    ),
    _filtered(
        "innovation_correlation",
        (),
        r"\rho_1",
        "correlation of successive normalised innovations so far",
        lambda part: "1",
        lambda s, given: estimates.innovations(s)[2],
    ),
)
"""All signals, in the order of `compute`."""


def signal_of(name: str) -> Signal | None:
    """Return the signal of a name, which may end with a part: ``torque_norm_rotation``."""
    # The last one first: ``pose_error`` is no part of ``pose``.
    found = (signal for signal in reversed(SIGNALS) if f"{name}_".startswith(f"{signal.name}_"))
    return next(found, None)


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
    found = dict(at_state(loop, loop.tracking(times, states), loop.work(states)))
    if not knows_energy(loop, times, states):
        found["energy_balance"] = np.full_like(found["energy_balance"], np.nan)
    return found


def knows_energy(loop: ClosedLoop, times: Array, states: Array) -> bool:
    """Return whether L + W is a balance: whether the dissipation of the law is known."""
    return loop.dissipation(loop.tracking(times[:1], states[:, :1])) is not None


def at_state(
    loop: ClosedLoop, s: Tracking, work: Array, asked: Collection[str] = ()
) -> Iterator[tuple[str, Array]]:
    """Yield every signal and L + W, by name, as floats or symbols.

    Parameters
    ----------
    asked
        The requested signals of estimates, NaN where there is no estimate; if empty, all that
        exist.
    """
    command = loop.command(s)
    torque = loop.torque(s) if loop.vehicle.actuators or loop.vehicle.control else command
    attitude = loop.controller.attitude_error(s)
    if attitude is None:
        with np.errstate(invalid="ignore"):  # symbols compare NaN
            attitude = s.P[..., 0] * 0.0 + np.nan
    given = LoopOutputs(
        torque,
        command,
        loop.at_limit(s),
        loop.thrust(s),
        *loop.wheel_states(s),
        loop.lyapunov(s),
        attitude,
    )
    members = loop.vehicle.members
    for signal in SIGNALS:
        if not all(members.get(dim, True) for dim in signal.dims):
            continue
        if not signal.exists_on(loop.group):
            continue
        exists = not signal.only_there or signal.stored_of(loop.vehicle)
        always = not signal.only_there or (exists and not asked)
        found = [(signal.name, partial(signal.of, s, given))]
        for part in signal.parts(loop.group):
            assert signal.of_part is not None
            found.append((f"{signal.name}_{part.name}", partial(signal.of_part, s, given, part)))
        for name, of in found:
            if always or name in asked:
                # A compiled choice between numbers does not propagate NaN.
                yield name, of() if exists else of() + np.nan
    yield "energy_balance", given.lyapunov + work
