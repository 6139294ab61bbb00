"""Whether the loops of an experiment are stable to first order, and what that leaves out."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.closed_loop.linearised import Linearised, linearised
from eqt_cli.core.arrays import Array
from eqt_cli.experiment.experiment import Experiment
from eqt_cli.vehicle.vehicle import ACTUATORS

UNCERTAIN = 1e-5
"""Of the fastest rate: a loop whose largest rate is as near to 0 as this is neither stable nor
unstable. Derivatives are right to 1e-12, and double roots to the square root of that."""

GONE = 0.1
"""Multipliers below this are no rates: a command that has left the queue is gone at once."""

MOST_ENTRIES = 100_000
"""Of matrices of a loop at all times: one of more than 105 states is not looked at at 9 times."""


class Along(NamedTuple):
    """The reference at some times.

    Attributes
    ----------
    times : (n,)
        s.
    poses, velocities
        Q_d and V_d, ``(n, d, d)`` and ``(n, m)``.
    """

    times: Array
    poses: Array
    velocities: Array


class Growth(NamedTuple):
    """How fast errors grow to first order.

    Attributes
    ----------
    eigenvalue
        The largest of all times: with the largest real part, or modulus where the law is sampled.
    at
        When, s.
    rate
        Of its errors, 1/s; negative where they decay.
    is_stable
        None where this is too near to 0.
    """

    eigenvalue: complex
    at: float
    rate: float
    is_stable: bool | None


def growth(loop: Linearised, times: Array) -> Growth:
    """How fast the errors of a loop grow, at the worst of the times."""
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
    """What to say of loops that are unstable, and the same at all times, in words."""
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
            + "; check the signs and sizes of its gains, and the delays; `eqt margins` says more"
        )


def small_loops(experiment: Experiment, along: Along) -> dict[str, ClosedLoop]:
    """Those of which matrices at so many times are computed at once, by the label of their law."""
    return {
        label: loop
        for label, loop in experiment.loops.items()
        if len(along.times) * loop.state_length**2 <= MOST_ENTRIES
    }


def size_of(found: Growth, loop: Linearised) -> float:
    """What decides of its eigenvalue: the real part, or the modulus where the law is sampled."""
    return found.eigenvalue.real if loop.period is None else abs(found.eigenvalue)


def left_out(loop: ClosedLoop) -> Iterator[str]:
    """What of a loop is not linear, or no part of a loop, by its place in the configuration."""
    vehicle = loop.vehicle
    for index, actuator in enumerate(vehicle.actuators):
        if actuator.linear_part is not actuator or actuator.limits:
            yield f"{ACTUATORS}[{index}] ({actuator.departs})"
    for place, sensor in vehicle.sensors().items():
        timing = [name for name in ("period", "dropout") if getattr(sensor, name)]
        yield f"{place} ({', '.join([sensor.departs, *timing])})"
    if vehicle.varies:
        yield "what is drawn for each run (means are used)"
