"""An estimator by itself as a program: from measurements and its states to a law's input.

It is what is exported. Its states are those that a law needs: neither those that only judge the
estimate, nor the initial error of a simulated run, are part of it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eqt_cli.closed_loop.law_program import NUMBER, PERIOD, Entry, by_part
from eqt_cli.closed_loop.system import ClosedLoop
from eqt_cli.core.arrays import Array
from eqt_cli.core.leaves import leaves, with_fields, with_leaves
from eqt_cli.program import Program, traced
from eqt_cli.vehicle.estimators.base import Estimator, Measured
from eqt_cli.vehicle.estimators.schedule import Schedule

MEASURED, STATE = "measured_", "state_"
POSE, VELOCITY = "pose", "velocity"

QUALITY = ("error", "innovations", "last_innovation")
"""States that judge an estimate and that it does not need."""


@dataclass(frozen=True)
class EstimatorProgram:
    """An estimator on a group, with its inputs and outputs.

    Attributes
    ----------
    estimator
        The estimator as it flies; it starts at the first fix.
    measured
        Measured ``pose`` and ``velocity``, and ``arrived``, 1 for each part of the pose that has a
        new measurement.
    numbers
        Its options.
    states
        Its states, all 0 before the first call.
    step
        Program of ``pose``, ``velocity`` and the states after an instant; it takes the ``period``
        as well.
    """

    estimator: Estimator
    measured: tuple[Entry, ...]
    numbers: tuple[Entry, ...]
    states: tuple[Entry, ...]
    step: Program

    @property
    def values(self) -> dict[str, Array]:
        """The options, by name."""
        return leaves(self.estimator)


def estimator_program(loop: ClosedLoop) -> EstimatorProgram:
    """Return the program of a loop's estimator; its measurements arrive without delay."""
    G, vehicle = loop.group, loop.vehicle
    assert vehicle.estimator is not None
    estimator, schedule = with_fields(vehicle.estimator, initial_error=None), vehicle.schedule(G)
    d, m = G.size, G.dimension
    measured = (
        Entry(POSE, (d, d), "Q as it is measured", by_part(G, "pose_unit")),
        Entry(VELOCITY, (m,), "V as it is measured", by_part(G, "velocity_unit")),
        Entry("arrived", (len(schedule.fixes),), "1 where a part of Q is new: " + _named(schedule)),
    )
    numbers = tuple(Entry(path, value.shape, path) for path, value in leaves(estimator).items())
    lengths = estimator.states(schedule)
    states = tuple(
        Entry(name, (length,), name) for name, length in lengths.items() if name not in QUALITY
    )

    def step(given: Mapping[str, Array]) -> Mapping[str, Array]:
        def one(prefix: str, entry: Entry) -> Array:
            return given[prefix + entry.name].reshape(1, *entry.shape)

        now: Any = replace(schedule, period=given[NUMBER + PERIOD][0])
        own = with_leaves(estimator, {each.source: one(NUMBER, each) for each in numbers})
        Q, V, fresh = (one(MEASURED, each) for each in measured)
        Q = G.unpack(G.pack(Q))
        kept = {name: np.zeros((1, lengths[name])) for name in QUALITY if name in lengths}
        kept |= {each.name: one(STATE, each) for each in states}
        after = own.after(now, Measured(Q, V, fresh, Q, 0.0 * V), kept)
        told = {POSE: G.unpack(after["pose"])[0], VELOCITY: after["velocity"][0]}
        return told | {STATE + each.name: after[each.name][0] for each in states}

    groups = {
        prefix + entry.name: math.prod(entry.shape)
        for prefix, entries in ((MEASURED, measured), (NUMBER, numbers), (STATE, states))
        for entry in entries
    }
    return EstimatorProgram(
        estimator, measured, numbers, states, traced(step, groups | {NUMBER + PERIOD: 1})
    )


def _named(schedule: Schedule) -> str:
    return ", ".join(channel.part.name for channel in schedule.fixes)
