"""Whether small errors of a linearised loop decay, and what the loop leaves out.

Knows matrices and their errors; `linearised.py` computes them.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.components.accelerometer import Lever
from eqt_cli.components.laws import ReadsLimits
from eqt_cli.components.sensors import DynamicSensor
from eqt_cli.components.vehicle import ESTIMATOR, Vehicle, place_of
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.loop.linearised import Linearised

DERIVATIVE = 1e-10
"""Largest error of an entry of a matrix, relative to its row: a hundred times the error of the
differences."""

DEFECTIVE = 1e6
"""Condition number of an eigenvalue above which it counts as one of several that are equal. They
move as a root of the error, how far is tried."""

TRIALS = 4
"""Number of matrices, off by ten times the error, with which that is tried."""


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


def growth(loop: Linearised) -> Growth:
    """Return the growth of the errors of a loop at the worst time."""
    at_times = [_grown(loop, place) for place in range(len(loop.closed))]
    place = max(range(len(at_times)), key=lambda k: at_times[k].rate)
    stable = {state.is_stable for state in at_times}
    is_stable = False if False in stable else None if None in stable else True
    return at_times[place]._replace(at=float(loop.about.times[place]), is_stable=is_stable)


def _grown(loop: Linearised, place: int) -> Growth:
    """Return the growth at one of the times.

    Each eigenvalue is known up to its condition number times the error of the matrix. LAPACK
    balances the matrix; that error is relative to each row, and so no fast state hides a slow one.
    """
    matrix = loop.closed[place]
    size = np.eye(len(matrix))
    for phase in loop.phases:
        size = np.abs(phase.closed[place]) @ size
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
        random = np.random.default_rng(0).uniform(-1, 1, (TRIALS, *matrix.shape))
        tried = matrix + 10 * error * random * (matrix != 0)
        worst = _beyond(loop, np.linalg.eigvals(tried)).max()
        doubtful &= ~(several & (beyond < 0)) | (worst >= 0)
    rates = growth_rates(loop, eigenvalues)
    which = int(rates.argmax())
    is_stable = False if (beyond[~doubtful] > 0).any() else None if doubtful.any() else True
    return Growth(complex(eigenvalues[which]), 0.0, float(rates[which]), is_stable)


def growth_rates(loop: Linearised, eigenvalues: Array) -> Array:
    """Return the growth rates of the errors of eigenvalues of the closed loop, 1/s."""
    if loop.cycle is None:
        return eigenvalues.real
    return np.log(np.maximum(np.abs(eigenvalues), np.finfo(float).tiny)) / loop.cycle


def _beyond(loop: Linearised, eigenvalues: Array) -> Array:
    """Return how far eigenvalues are beyond the edge of stability; negative within."""
    return eigenvalues.real if loop.cycle is None else np.abs(eigenvalues) - 1.0


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


def _left_out_of(vehicle: Vehicle) -> Iterator[LeftOut]:
    """Yield the parts of actuators that a linearised loop leaves out."""
    for index, actuator in enumerate(vehicle.actuators):
        place = place_of(vehicle, index)
        if getattr(actuator, "time_constant_down", None) is not None:
            yield LeftOut(f"{place} (the shorter of its two time constants)")
        if actuator.linear_part is not actuator or actuator.limits:
            is_linear = isinstance(actuator.linear_part, type(actuator))
            what = "only the limits of the " if is_linear else ""
            # At a limit no loop is pushed harder: what grows from small errors, grows.
            yield LeftOut(f"{place} ({what}{actuator.departs})", not actuator.limits)


def left_out(loop: ClosedLoop, linear: Linearised | None = None) -> Iterator[LeftOut]:
    """Yield the parts that a linearised loop leaves out."""
    vehicle = loop.vehicle
    if free := loop.task.words(loop.gains):
        yield LeftOut(f"{free} (task: {loop.task.kind} leaves it)", False, False)
    yield from _left_out_of(vehicle)
    if isinstance(loop.controller, ReadsLimits) and loop.controller.acting:
        yield LeftOut("the anti-windup (the loop is that off its limits)", stabilises=False)
    for place, sensor in vehicle.sensors().items():
        loses = ["dropout"] if getattr(sensor, "dropout", None) else []
        if isinstance(sensor, DynamicSensor | Lever) and not loses:
            continue  # it is part of the loop
        errors = f"only its {sensor.departs.removeprefix('measurements with ')}"
        yield LeftOut(f"{place} ({', '.join([errors, *loses])})", bool(loses), bool(loses))
    if vehicle.estimator is not None and not (linear and linear.about.loop.vehicle.estimator):
        yield LeftOut(f"{ESTIMATOR} ({vehicle.estimator.departs})")
    elif linear and not linear.about.is_settled:
        yield LeftOut(f"{ESTIMATOR} (only what its covariance still changes)")
    if vehicle.varies:
        yield LeftOut("numbers drawn for each run (means are used)")
