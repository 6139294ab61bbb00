"""The reference of an experiment over the whole horizon, before anything is run."""

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
"""At which the reference is looked at, and on both sides of every known instant."""

RTOL = 1e-8
"""With which what of it is integrated is integrated."""

MOST_EVALUATIONS = 10_000
"""Of a reference that is integrated: a check takes seconds, however long the horizon is."""

MOST_WRITTEN = 1_000
"""Characters of an experiment; one of more has fewer evaluations, each of which takes longer."""

LINEARISED = 9
"""At so many of the times a loop is linearised."""

GOLDEN = (5**0.5 - 1) / 2
"""Its multiples, but for whole numbers, are spread evenly, and no two differences are the same."""

JUMP = 1e-6
"""Relative to the largest value on the horizon: what is less is not called a jump."""


@dataclass(frozen=True)
class Horizon:
    """The reference at some times.

    Attributes
    ----------
    times : (n,)
        s; in order.
    pose : (n, d, d)
    velocity, acceleration, torque : (n, m)
        Body frame. NaN from where the reference leaves the real numbers.
    jumps
        Where Q_d, V_d or τ_d jumps, as (time, what, by how much).
    spent
        The evaluations after which it was left, at the last of the times; None if at its end.
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
        """At which of the times the reference is real."""
        parts = (frobenius(self.pose), norm(self.velocity), norm(self.torque))
        return np.isfinite(np.array(parts)).all(axis=0)


def reference_over_horizon(experiment: Experiment) -> Horizon:
    """Q_d, V_d, V̇_d and τ_d from the start to the end."""
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
    """How many evaluations of its reference a check may take."""
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
    """Note where the reference leaves the real numbers, or asks for more than a given torque.

    Returns
    -------
    list of str
        Where it jumps, which may be meant, and how far it was looked at, if not to its end.
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
    """What a user should know of an experiment, and of its reference, before it is run."""
    return [
        *experiment.remarks,
        *_of_angles(experiment),
        *_of_reference(experiment),
        *_of_actuators(experiment),
        *_hard_on_numbers(experiment, shown),
        *map(EqtWarning, limits_below_reference(experiment, shown)),
    ]


def _of_angles(experiment: Experiment) -> Iterator[EqtWarning]:
    """Angles that are written as numbers, and turn more than once."""
    data = experiment.source.data
    own = {*ANGLES, *(name for kind in pose_distributions.all() for name in kind.angles)}
    for section, angles in (("reference", ANGLES), ("target", ANGLES), ("initial", own)):
        for path, said in many_turns(data.get(section), angles, (section,)):
            yield EqtWarning(f"{experiment.source.place(path)}: {dotted(path)}: {said}")


def _of_reference(experiment: Experiment) -> Iterator[EqtWarning]:
    """What a reference says of itself."""
    place = experiment.source.place(("reference",))
    for said in next(iter(experiment.loops.values())).reference.remarks(experiment.group):
        yield EqtWarning(f"{place}: reference: {said}")


def _of_actuators(experiment: Experiment) -> Iterator[EqtWarning]:
    """What actuators say of themselves."""
    vehicle = next(iter(experiment.loops.values())).vehicle
    for index, actuator in enumerate(vehicle.actuators):
        place = experiment.source.place((ACTUATORS, index))
        for said in actuator.remarks(experiment.group):
            yield EqtWarning(f"{place}: {ACTUATORS}[{index}]: {actuator.name} {said}")


def _hard_on_numbers(experiment: Experiment, shown: Horizon | None) -> Iterator[EqtWarning]:
    """What rounding or stiffness do, with the section that is the reason."""
    along, found = along_reference(experiment, shown), [("inertia", ill_conditioned(experiment))]
    try:
        with blamed(), threadpool_limits(1):  # small matrices, which threads take longer for
            found.append(("gains", stiff(experiment, along)))
            if len(along.times) > 1:
                found += [("controllers", said) for said in unstable(experiment, along)]
    except ComponentError as error:
        found.append(("controllers", f"loops cannot be linearised: {error}"))
    for section, said in found:
        if said:
            yield EqtWarning(f"{experiment.source.place((section,))}: {section}: {said}")


def along_reference(experiment: Experiment, shown: Horizon | None) -> Along:
    """The reference at its start, and at times spread over the horizon where that is known.

    They are no multiples of each other, so that a reference which turns is not met at the same
    angle only.
    """
    finite = np.flatnonzero(shown.finite) if shown is not None else ()
    if shown is None or not 1 < len(finite) == len(shown.times):
        start = np.zeros(1), experiment.initial_pose[None], experiment.initial_velocity[None]
        return Along(*start)
    shares = np.sort(np.arange(LINEARISED) * GOLDEN % 1.0)
    where = np.searchsorted(shown.times, shares * shown.times[-1])
    return Along(shown.times[where], shown.pose[where], shown.velocity[where])


def limits_below_reference(experiment: Experiment, shown: Horizon | None = None) -> list[str]:
    """Where an actuator gives less than the reference alone takes, in words, with both numbers.

    Numbers that are drawn for each run have their mean.
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
        taken, there = sizes
        with np.errstate(divide="ignore", invalid="ignore"):  # a limit may be 0
            over = np.where(taken > there, taken / np.maximum(there, 0.0), 0.0)
        when, axis = np.unravel_index(np.argmax(over), taken.shape)
        most = float(np.broadcast_to(there, taken.shape)[when, axis])
        if taken[when, axis] > most:
            t = times[len(times) - len(taken) + when]
            names = actuator.thruster_names
            who = f"'{names[axis]}'" if names else actuator.name
            found.append(
                f"{ACTUATORS}[{index}]: {who} gives at most {actuator.limited}{most:.4g}, but the "
                f"reference alone needs {taken[when, axis]:.4g} at t = {t:.4g} s; no law can "
                "follow it there"
            )
    return found
