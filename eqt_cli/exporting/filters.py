"""The filter of an exported law: its program, and instants at which it is checked.

An estimator by itself is a program from measurements and its states to a law's input. Its states
are those that a law needs: neither those that only judge the estimate, nor the initial error of a
simulated run, are part of it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from eqt_cli.closed_loop.law_program import NUMBER, PERIOD, Entry, by_part, sizes
from eqt_cli.closed_loop.system import ClosedLoop
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import EqtError, EqtWarning, Remedy
from eqt_cli.core.leaves import leaves, with_fields, with_leaves
from eqt_cli.core.registry import description, meanings
from eqt_cli.core.reporting import reporter
from eqt_cli.ensemble.spread import Stream, generator_at
from eqt_cli.program import Program, traced
from eqt_cli.vehicle.estimators.base import Estimator, Measurement
from eqt_cli.vehicle.sensors.channels import MEASURED as ARRIVED
from eqt_cli.vehicle.sensors.channels import Errors

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
    d, m, fixes = G.size, G.dimension, [channel.part.name for channel in schedule.fixes]
    measured = (
        Entry(POSE, (d, d), "Q as it is measured", by_part(G, "pose_unit")),
        Entry(VELOCITY, (m,), "V as it is measured", by_part(G, "velocity_unit")),
        Entry("arrived", (len(fixes),), f"1 where a part of Q is new: {', '.join(fixes)}"),
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
        after = own.after(now, Measurement(Q, V, fresh, Q, 0.0 * V), kept)
        estimate = {POSE: G.unpack(after["pose"])[0], VELOCITY: after["velocity"][0]}
        return estimate | {STATE + each.name: after[each.name][0] for each in states}

    groups = sizes({MEASURED: measured, NUMBER: numbers, STATE: states}) | {NUMBER + PERIOD: 1}
    return EstimatorProgram(estimator, measured, numbers, states, traced(step, groups))


INSTANTS = 40
"""Number of instants at which the filter is checked."""

TOLERANCE = {"double": 1e-9, "float": 1e-2}
"""Largest difference by rounding between the filter and eqt's over these instants, in the units of
the pose and of the velocity."""


@dataclass(frozen=True)
class ExportedFilter:
    """The filter of a loop, to be written as C.

    Attributes
    ----------
    program
        The filter as a program.
    measured : (instants, n)
        Measurements at the instants of the check, by name.
    estimates : (instants, n)
        Estimates of eqt there: pose and velocity.
    """

    program: EstimatorProgram
    measured: dict[str, Array]
    estimates: Array

    @property
    def kind(self) -> str:
        """Name of the filter in a configuration."""
        return self.program.estimator.name

    @property
    def about(self) -> str:
        """Description of the filter in a sentence."""
        return description(type(self.program.estimator))

    def meaning(self, option: str) -> str:
        """Return the meaning of an option."""
        return meanings(type(self.program.estimator)).get(option, "")

    def arguments(self) -> list[str]:
        """Return the arguments of the emitted function, in the order of the program."""
        entries = {MEASURED + each.name: f"measured->{each.name}" for each in self.program.measured}
        entries |= {NUMBER + each.name: f"options->{each.name}" for each in self.program.numbers}
        entries |= {STATE + each.name: f"filter->{each.name}" for each in self.program.states}
        entries[NUMBER + PERIOD] = f"&numbers->{PERIOD}"
        given = [entries[group] for group, _ in self.program.step.inputs]
        estimate = [f"input->{POSE}", f"input->{VELOCITY}"]
        return [*given, *estimate, *(f"next.{each.name}" for each in self.program.states)]


def exported_filter(loop: ClosedLoop, label: str, seed: int) -> ExportedFilter | None:
    """Return the filter of a loop; None where the law reads measurements.

    Raises
    ------
    EqtError
        If measurements arrive late.
    """
    vehicle, G = loop.vehicle, loop.group
    if vehicle.estimator is None:
        return None
    if vehicle.clocks:
        reporter().remark(
            EqtWarning(
                f"{label}: the filter acts every {vehicle.tick:g} s, other parts at instants of "
                "their own; only the law is written as C, which reads pose and velocity"
            )
        )
        return None
    if vehicle.schedule(G).depth:
        raise EqtError(
            f"{label}: a filter whose measurements arrive late is not written as C",
            Remedy("remove `delay` from the sensors, or the key estimator"),
        )
    return ExportedFilter(estimator_program(loop), *_flown(loop, seed))


def _flown(loop: ClosedLoop, seed: int) -> tuple[dict[str, Array], Array]:
    """Return measurements of a motion with constant velocity, and the estimates of eqt."""
    G, flying = loop.group, loop.vehicle
    flying = replace(flying, estimator=with_fields(flying.estimator, initial_error=None))
    random_of = partial(generator_at, seed, Stream.VEHICLE, 0)
    errors = flying.measurement_errors(G, INSTANTS, random_of)
    V = 0.3 * random_of("the motion of an exported filter").standard_normal(G.dimension)
    states = {name: np.zeros(count) for name, count in flying.states(G).items()}
    flown: dict[str, list[Array]] = {"pose": [], "velocity": [], "arrived": []}
    estimates, holding = [], [channel.name for channel in flying.holding(G)]
    for k in range(INSTANTS):
        at = Errors(*(part[k] for part in errors))
        Q = G.exp(k * flying.tick * V)
        states = states | flying.after_measuring(G, Q, V, at, states)
        Q_m, V_m = flying.as_arrived(G, Q @ at.pose, V + at.velocity, states)
        new = dict(zip(holding, 1.0 * (at.arrived >= ARRIVED), strict=True))
        fresh = np.array([new.get(fix.name, 1.0) for fix in flying.schedule(G).fixes])
        for name, values in zip(flown, (Q_m, V_m, fresh), strict=True):
            flown[name].append(values.ravel())
        Q_hat, V_hat = flying.estimated(G, states)
        estimates.append(np.concatenate([Q_hat.ravel(), V_hat]))
    return {name: np.array(rows) for name, rows in flown.items()}, np.array(estimates)
