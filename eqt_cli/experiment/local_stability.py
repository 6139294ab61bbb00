"""Determines whether the linearised loops of an experiment are stable."""

from collections.abc import Iterator
from functools import reduce
from math import log
from typing import NamedTuple

import numpy as np

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.closed_loop.linearised import Linearised, linearised
from eqt_cli.core.arrays import Array
from eqt_cli.experiment.experiment import Experiment
from eqt_cli.vehicle.vehicle import ACTUATORS, ESTIMATOR

DERIVATIVE = 1e-10
"""Largest error of an entry of a matrix, relative to its row: a hundred times that of the
differences."""

DEFECTIVE = 1e6
"""Condition number of an eigenvalue above which it counts as one of several that are equal. They
move as a root of the error, how far is tried."""

TRIALS = 4
"""Number of matrices, off by ten times the error, with which that is tried."""

MOST_ENTRIES = 100_000
"""Largest number of matrix entries over all times; at 9 times, this allows 105 states."""


class Along(NamedTuple):
    """The reference at some times.

    Attributes
    ----------
    times : (n,)
        Times, s.
    poses, velocities
        Q_d and V_d, ``(n, d, d)`` and ``(n, m)``.
    """

    times: Array
    poses: Array
    velocities: Array


class Growth(NamedTuple):
    """The growth of small errors of a linearised loop.

    Attributes
    ----------
    eigenvalue
        Eigenvalue of all times with the largest real part or, for a sampled law, modulus.
    at
        Time of this eigenvalue, s.
    rate
        Growth rate of its errors, 1/s; negative if they decay.
    is_stable
        Whether the errors decay; None if the errors of the matrix leave that open.
    """

    eigenvalue: complex
    at: float
    rate: float
    is_stable: bool | None


def growth(loop: Linearised, times: Array) -> Growth:
    """Return the growth of the errors of a loop at the worst time."""
    at_times = [_grown(loop, place) for place in range(len(loop.closed))]
    place = max(range(len(at_times)), key=lambda k: at_times[k].rate)
    stable = {each.is_stable for each in at_times}
    is_stable = False if False in stable else None if None in stable else True
    return at_times[place]._replace(at=float(times[place]), is_stable=is_stable)


def _grown(loop: Linearised, place: int) -> Growth:
    """Return the growth at one of the times.

    Each eigenvalue is known up to its condition number times the error of the matrix. LAPACK
    balances the matrix; that error is relative to each row, and so no fast state hides a slow one.
    """
    matrix = loop.closed[place]
    size = reduce(
        lambda M, phase: np.abs(phase.closed[place]) @ M, loop.phases, np.eye(len(matrix))
    )
    error = DERIVATIVE * size.max(axis=1, keepdims=True)
    eigenvalues, right = np.linalg.eig(matrix)
    eigenvalues = eigenvalues.astype(complex)
    scale = np.abs(right).max(axis=1, keepdims=True)
    scale[scale == 0] = 1.0
    try:
        left = np.abs(np.linalg.inv(right / scale)) / scale.T
    except np.linalg.LinAlgError:
        left = np.full(right.shape, np.inf)
    with np.errstate(invalid="ignore", over="ignore"):
        moves = (left @ error)[:, 0] * np.abs(right).sum(axis=0)
        rounding = np.finfo(float).eps * np.abs(eigenvalues).max()
        moves += len(matrix) * rounding * (left * np.abs(right).T).sum(axis=1)
    beyond = _beyond(loop, eigenvalues)
    doubtful = ~(np.abs(beyond) > moves)
    several = ~(moves < DEFECTIVE * DERIVATIVE * np.abs(eigenvalues).max())  # in any units
    if (doubtful & several).any():
        random = np.random.default_rng(0)
        shape = (TRIALS, *matrix.shape)
        tried = matrix + 10 * error * random.uniform(-1, 1, shape) * (matrix != 0)
        worst = _beyond(loop, np.linalg.eigvals(tried)).max()
        doubtful &= ~(several & (beyond < 0)) | (worst >= 0)
    rates = beyond
    if loop.cycle is not None:
        rates = np.log(np.maximum(np.abs(eigenvalues), np.finfo(float).tiny)) / loop.cycle
    which = int(rates.argmax())
    certain = beyond[~doubtful]
    is_stable = False if (certain > 0).any() else None if doubtful.any() else True
    return Growth(complex(eigenvalues[which]), 0.0, float(rates[which]), is_stable)


def _beyond(loop: Linearised, eigenvalues: Array) -> Array:
    """Return how far eigenvalues are beyond the edge of stability; negative within."""
    return eigenvalues.real if loop.cycle is None else np.abs(eigenvalues) - 1.0


def unstable_or_slow(experiment: Experiment, along: Along) -> Iterator[str]:
    """Yield sentences on unstable loops, and on slow ones, that do not depend on time."""
    horizon = experiment.config.time.duration
    for label, loop in small_loops(experiment, along).items():
        with np.errstate(all="ignore"):
            linear = linearised(loop, *along)
        if not (linear.is_constant and np.isfinite(linear.closed).all()):
            continue
        largest = growth(linear, along.times)
        if largest.is_stable and -largest.rate * horizon < log(2.0):
            yield (
                f"the loop of '{label}' is slower than the runs last: small errors take "
                f"{log(2.0) / -largest.rate:.3g} s to halve, and time.duration is {horizon:g} s; "
                "check the sizes of its gains, or take a longer duration"
            )
        if largest.is_stable is not False:
            continue
        size = size_of(largest, linear)
        per = "a period" if linear.period == linear.cycle else f"in {linear.cycle:g} s"
        many = "" if linear.period is None else f" (eigenvalue {size:.4g} {per})"
        omitted = ", ".join(each.words for each in left_out(loop))
        yield (
            f"the loop of '{label}' is unstable: small errors grow at {largest.rate:.3g} 1/s{many}"
            + (f", leaving out {omitted}" if omitted else "")
            + "; check the signs and sizes of its gains, and the delays; `eqt margins` shows more"
        )


def small_loops(experiment: Experiment, along: Along) -> dict[str, ClosedLoop]:
    """Return the loops whose matrices at all times are small enough, by label."""
    return {
        label: loop
        for label, loop in experiment.loops.items()
        if len(along.times) * loop.state_length**2 <= MOST_ENTRIES
    }


def size_of(grown: Growth, loop: Linearised) -> float:
    """Return the real part of the eigenvalue or, for a sampled law, its modulus."""
    return grown.eigenvalue.real if loop.period is None else abs(grown.eigenvalue)


class LeftOut(NamedTuple):
    """A part that a linearised loop leaves out.

    Attributes
    ----------
    words
        Its place in the configuration, and what it does.
    stabilises, destabilises
        Whether an unstable loop could be stable with it, and a stable one unstable.
    """

    words: str
    stabilises: bool = True
    destabilises: bool = True


def left_out(loop: ClosedLoop, linear: Linearised | None = None) -> Iterator[LeftOut]:
    """Yield the parts that a linearised loop leaves out."""
    vehicle = loop.vehicle
    for index, actuator in enumerate(vehicle.actuators):
        if actuator.linear_part is not actuator or actuator.limits:
            what = "only the limits of the " * isinstance(actuator.linear_part, type(actuator))
            # At a limit no loop is pushed harder: what grows from small errors, grows.
            yield LeftOut(f"{ACTUATORS}[{index}] ({what}{actuator.departs})", not actuator.limits)
    for place, sensor in vehicle.sensors().items():
        loses = ["dropout"] if getattr(sensor, "dropout", None) else []
        if sensor.states(loop.group) and not loses:
            continue  # its states are part of the loop
        yield LeftOut(f"{place} ({', '.join([sensor.departs, *loses])})", bool(loses), bool(loses))
    if vehicle.estimator is not None and not (linear and linear.about.loop.vehicle.estimator):
        yield LeftOut(f"{ESTIMATOR} ({vehicle.estimator.departs})")
    elif linear and not linear.about.is_settled:
        yield LeftOut(f"{ESTIMATOR} (its covariance has not settled)")
    if vehicle.varies:
        yield LeftOut("what is drawn for each run (means are used)")
