"""Determines whether the linearised loops of an experiment are stable."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.closed_loop.linearised import Linearised, linearised
from eqt_cli.core.arrays import Array
from eqt_cli.experiment.experiment import Experiment
from eqt_cli.vehicle.vehicle import ACTUATORS, ESTIMATOR

UNCERTAIN = 1e-5
"""Largest rate, relative to the fastest one, below which stability is undecided. Derivatives are
accurate to 1e-12, and double roots to the square root of that."""

GONE = 0.1
"""Multipliers below this are not rates: they belong to commands that leave the queue."""

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
        Whether the errors decay; None if the rate is too near to 0.
    """

    eigenvalue: complex
    at: float
    rate: float
    is_stable: bool | None


def growth(loop: Linearised, times: Array) -> Growth:
    """Return the growth of the errors of a loop at the worst time."""
    eigenvalues = loop.eigenvalues.astype(complex)
    rates, known = eigenvalues.real, np.abs(eigenvalues)
    if loop.period is not None:
        logarithms = np.log(np.where(known > 0.0, eigenvalues, np.finfo(float).tiny)) / loop.period
        rates, known = logarithms.real, np.where(known > GONE, np.abs(logarithms), 0.0)
    when, which = np.unravel_index(rates.argmax(), rates.shape)
    rate = float(rates[when, which])
    is_stable = None if abs(rate) <= UNCERTAIN * known.max() else rate < 0
    return Growth(complex(eigenvalues[when, which]), float(times[when]), rate, is_stable)


def unstable(experiment: Experiment, along: Along) -> Iterator[str]:
    """Yield sentences on unstable loops that do not depend on time."""
    for label, loop in small_loops(experiment, along).items():
        found = linearised(loop, *along)
        if not found.is_constant or (largest := growth(found, along.times)).is_stable is not False:
            continue
        size = size_of(largest, found)
        many = "" if found.period is None else f" (eigenvalue {size:.4g} a period)"
        omitted = ", ".join(left_out(loop))
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


def size_of(found: Growth, loop: Linearised) -> float:
    """Return the real part of the eigenvalue or, for a sampled law, its modulus."""
    return found.eigenvalue.real if loop.period is None else abs(found.eigenvalue)


def left_out(loop: ClosedLoop) -> Iterator[str]:
    """Yield the parts that a linearised loop leaves out, by their places in the configuration."""
    vehicle = loop.vehicle
    for index, actuator in enumerate(vehicle.actuators):
        if actuator.linear_part is not actuator or actuator.limits:
            yield f"{ACTUATORS}[{index}] ({actuator.departs})"
    for place, sensor in vehicle.sensors().items():
        timing = [name for name in ("period", "dropout") if getattr(sensor, name)]
        yield f"{place} ({', '.join([sensor.departs, *timing])})"
    if vehicle.estimator is not None:
        yield f"{ESTIMATOR} ({vehicle.estimator.departs})"
    if vehicle.varies:
        yield "what is drawn for each run (means are used)"
