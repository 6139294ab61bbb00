"""Checks the reference of an experiment over the whole horizon before any run."""

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from eqt_cli.closed_loop import ReferenceSystem
from eqt_cli.core.arrays import Array, frobenius, norm
from eqt_cli.core.error_origin import blamed
from eqt_cli.core.errors import ComponentError, EqtWarning
from eqt_cli.core.problems import Problems, dotted
from eqt_cli.engines import Problem, Status
from eqt_cli.engines.solve_ivp import SolveIvp
from eqt_cli.ensemble.poses import pose_distributions
from eqt_cli.experiment.experiment import Experiment
from eqt_cli.experiment.local_stability import Along, unstable
from eqt_cli.experiment.numerics import ill_conditioned, stiff
from eqt_cli.mechanics.tracking import Tracking
from eqt_cli.notation.poses import ANGLES, many_turns
from eqt_cli.vehicle.vehicle import ACTUATORS

SAMPLES = 2001
"""Number of times at which the reference is evaluated, besides both sides of known instants."""

RTOL = 1e-8
"""Relative tolerance for the integration of a reference."""

MOST_EVALUATIONS = 10_000
"""Largest number of evaluations of an integrated reference, so that a check takes seconds."""

MOST_WRITTEN = 1_000
"""Characters of a configuration above which the number of evaluations is reduced."""

LINEARISED = 9
"""Number of times at which a loop is linearised."""

GOLDEN = (5**0.5 - 1) / 2
"""Golden ratio. The fractional parts of its multiples are spread evenly without equal gaps."""

JUMP = 1e-6
"""Least jump relative to the largest value on the horizon."""


@dataclass(frozen=True)
class Horizon:
    """The reference at some times.

    Attributes
    ----------
    times : (n,)
        Times in increasing order, s.
    pose : (n, d, d)
        Q_d.
    velocity, acceleration, torque : (n, m)
        V_d, V̇_d and τ_d in the body frame; NaN where the reference is not finite.
    jumps
        Jumps of Q_d, V_d or τ_d as (time, name, size).
    spent
        Number of evaluations after which the integration stopped, at the last of the times; None if
        it reached the end.
    """

    times: Array
    pose: Array
    velocity: Array
    acceleration: Array
    torque: Array
    jumps: list[tuple[float, str, float]]
    spent: int | None = None

    @property
    def finite(self) -> Array:
        """Whether the reference is finite at each time."""
        parts = (frobenius(self.pose), norm(self.velocity), norm(self.torque))
        return np.isfinite(np.array(parts)).all(axis=0)


def reference_over_horizon(experiment: Experiment) -> Horizon:
    """Compute Q_d, V_d, V̇_d and τ_d over the horizon."""
    system = ReferenceSystem.of(next(iter(experiment.loops.values())))
    stop = float(experiment.times[-1])
    instants = np.array([t for t in system.instants if 0 < t < stop])
    times = np.unique([*np.linspace(0.0, stop, SAMPLES), *instants])
    Qd, Vd = experiment.initial_pose, experiment.initial_velocity
    state = system.initial_state(Qd, Vd, Qd, Vd)
    states = np.broadcast_to(state, (len(times), len(state)))
    spent = None
    if len(state):
        engine = SolveIvp(rtol=RTOL, atol=1e-3 * RTOL, max_steps=_affordable(experiment))
        solution = engine.solve(Problem(system, state[None], times))
        states = solution.states[0]
        if solution.status[0] == Status.STEP_LIMIT:
            spent = engine.max_steps
            known = int(np.isfinite(states).all(axis=-1).sum())
            times, states = times[:known], states[:known]
            instants = instants[instants <= times[-1]]
    with np.errstate(all="ignore"):
        s = system.tracking(times, states)
        torque = s.tau_d + 0 * s.P
        shown = Horizon(times, s.Qd, s.Vd, s.Vd_dot, torque, [], spent)
        if not len(instants):
            return shown
        where = np.searchsorted(times, instants)
        sides = [
            system.tracking(np.nextafter(instants, towards), states[where])
            for towards in (-np.inf, np.inf)
        ]
        jumps = list(_jumps(shown, instants, *sides))
    return replace(shown, jumps=sorted(jumps))


def _affordable(experiment: Experiment) -> int:
    """Return the allowed number of evaluations of the reference."""
    written = len(json.dumps(experiment.resolved))
    return int(MOST_EVALUATIONS * min(1.0, MOST_WRITTEN / written))


def _jumps(
    shown: Horizon, instants: Array, left: Tracking, right: Tracking
) -> Iterator[tuple[float, str, float]]:
    for what, scale, size in (
        ("Q_d", shown.pose, frobenius(right.Qd - left.Qd)),
        ("V_d", shown.velocity, norm(right.Vd - left.Vd)),
        ("τ_d", shown.torque, norm(right.tau_d - left.tau_d + 0 * left.P)),
    ):
        largest = np.nanmax(np.abs(scale)) if np.isfinite(scale).any() else 0.0
        for t, by in zip(instants, size, strict=True):
            if by > JUMP * largest:
                yield float(t), what, float(by)


def check_reference(shown: Horizon, most_torque: float | None, problems: Problems) -> list[str]:
    """Note where the reference is not finite, or needs more than a given torque.

    Returns
    -------
    list of str
        Remarks on jumps, which may be intended, and on a check that did not reach the end.
    """
    finite, sizes = shown.finite, norm(shown.torque)
    if not finite.all():
        t = shown.times[np.flatnonzero(~finite)[0]]
        problems.add(f"has no finite real value at about t = {t:.4g} s; correct its expressions")
    elif most_torque is not None and sizes.max() > most_torque:
        t = shown.times[sizes.argmax()]
        problems.add(
            f"needs a torque of {sizes.max():.4g} at t = {t:.4g} s, more than {most_torque:g}"
        )
    remarks = [f"{what} jumps by {by:.3g} at t = {t:g} s" for t, what, by in shown.jumps]
    if shown.spent is not None:
        until = f"t = {shown.times[-1]:.4g} s only, after {shown.spent:,} evaluations"
        remarks.append(f"checked until {until}")
    return remarks


def remarks(experiment: Experiment, shown: Horizon | None = None) -> list[EqtWarning]:
    """Return remarks on an experiment and its reference, to be shown before it is run."""
    return [
        *experiment.remarks,
        *_angle_remarks(experiment),
        *_reference_remarks(experiment),
        *_actuator_remarks(experiment),
        *_estimator_remarks(experiment),
        *_numerical_remarks(experiment, shown),
        *map(EqtWarning, limits_below_reference(experiment, shown)),
    ]


def _angle_remarks(experiment: Experiment) -> Iterator[EqtWarning]:
    """Remark on angles that are written as numbers and exceed a full turn."""
    data = experiment.source.data
    own = {*ANGLES, *(name for kind in pose_distributions.all() for name in kind.angles)}
    for section, angles in (("reference", ANGLES), ("target", ANGLES), ("initial", own)):
        for path, text in many_turns(data.get(section), angles, (section,)):
            yield EqtWarning(f"{experiment.source.place(path)}: {dotted(path)}: {text}")


def _reference_remarks(experiment: Experiment) -> Iterator[EqtWarning]:
    """Yield the remarks of the reference."""
    place = experiment.source.place(("reference",))
    for text in next(iter(experiment.loops.values())).reference.remarks(experiment.group):
        yield EqtWarning(f"{place}: reference: {text}")


def _actuator_remarks(experiment: Experiment) -> Iterator[EqtWarning]:
    """Yield the remarks of the actuators."""
    vehicle = next(iter(experiment.loops.values())).vehicle
    for index, actuator in enumerate(vehicle.actuators):
        place = experiment.source.place((ACTUATORS, index))
        for text in actuator.remarks(experiment.group):
            yield EqtWarning(f"{place}: {ACTUATORS}[{index}]: {actuator.name} {text}")


def _estimator_remarks(experiment: Experiment) -> Iterator[EqtWarning]:
    """Remark on parts of the pose that no sensor measures."""
    vehicle = next(iter(experiment.loops.values())).vehicle
    if vehicle.estimator is None:
        return
    place = experiment.source.place(("estimator",))
    for part in vehicle.schedule(experiment.group).unmeasured:
        yield EqtWarning(
            f"{place}: estimator: nothing measures the {part}, so that the error of its estimate "
            "grows without bound; add an entry for it to sensors.pose"
        )


def _numerical_remarks(experiment: Experiment, shown: Horizon | None) -> Iterator[EqtWarning]:
    """Remark on the effects of rounding, stiffness and instability, at the section to change."""
    along, found = along_reference(experiment, shown), [("inertia", ill_conditioned(experiment))]
    try:
        with blamed(), threadpool_limits(1):  # threads slow down small matrices
            found.append(("gains", stiff(experiment, along)))
            if len(along.times) > 1:
                found += [("controllers", text) for text in unstable(experiment, along)]
    except ComponentError as error:
        found.append(("controllers", f"loops cannot be linearised: {error}"))
    for section, text in found:
        if text:
            yield EqtWarning(f"{experiment.source.place((section,))}: {section}: {text}")


def along_reference(experiment: Experiment, shown: Horizon | None) -> Along:
    """Return the reference at its start or, if it is known, at times spread over the horizon.

    The times are not multiples of each other, so that a rotating reference is sampled at different
    angles.
    """
    finite = np.flatnonzero(shown.finite) if shown is not None else ()
    if shown is None or not 1 < len(finite) == len(shown.times):
        start = np.zeros(1), experiment.initial_pose[None], experiment.initial_velocity[None]
        return Along(*start)
    shares = np.sort(np.arange(LINEARISED) * GOLDEN % 1.0)
    where = np.searchsorted(shown.times, shares * shown.times[-1])
    return Along(shown.times[where], shown.pose[where], shown.velocity[where])


def limits_below_reference(experiment: Experiment, shown: Horizon | None = None) -> list[str]:
    """Return sentences on actuators whose limits are below the torque of the reference alone.

    Numbers that are drawn for each run have their mean values.
    """
    loop = next(iter(experiment.loops.values()))
    if not loop.vehicle.limits:
        return []
    shown = shown or reference_over_horizon(experiment)
    times, torque, found = shown.times[shown.finite], shown.torque[shown.finite], []
    for index, actuator in enumerate(loop.vehicle.actuators):
        sizes = actuator.most(loop.group, times, torque) if actuator.limits else None
        if sizes is None or not len(sizes[0]):
            continue
        needed, limits = sizes
        with np.errstate(divide="ignore", invalid="ignore"):  # a limit may be 0
            over = np.where(needed > limits, needed / np.maximum(limits, 0.0), 0.0)
        when, axis = np.unravel_index(np.argmax(over), needed.shape)
        limit = float(np.broadcast_to(limits, needed.shape)[when, axis])
        if needed[when, axis] > limit:
            t = times[len(times) - len(needed) + when]
            names = actuator.thruster_names
            name = f"'{names[axis]}'" if names else actuator.name
            found.append(
                f"{ACTUATORS}[{index}]: {name} gives at most {actuator.limited}{limit:.4g}, but "
                f"the reference alone needs {needed[when, axis]:.4g} at t = {t:.4g} s; no law can "
                "follow it there"
            )
    return found
