"""The filter of an exported law: its program, and instants at which it is checked."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.closed_loop.estimator_program import (
    MEASURED,
    POSE,
    STATE,
    VELOCITY,
    EstimatorProgram,
    estimator_program,
)
from eqt_cli.closed_loop.law_program import NUMBER, PERIOD
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import EqtError, Remedy
from eqt_cli.core.leaves import with_fields
from eqt_cli.core.registry import description, meanings
from eqt_cli.ensemble.seeds import Stream, generator_at
from eqt_cli.vehicle.sensors.channels import MEASURED as ARRIVED
from eqt_cli.vehicle.sensors.channels import Errors

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
        told = [f"input->{POSE}", f"input->{VELOCITY}"]
        return [*given, *told, *(f"next.{each.name}" for each in self.program.states)]


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
    assert flying.control is not None
    found: dict[str, list[Array]] = {"pose": [], "velocity": [], "arrived": []}
    estimates, holding = [], [channel.name for channel in flying.holding(G)]
    for k in range(INSTANTS):
        at = Errors(*(part[k] for part in errors))
        Q = G.exp(k * flying.control.period * V)
        states = states | flying.after_measuring(G, Q, V, at, states)
        Q_m, V_m = flying.as_arrived(G, Q @ at.pose, V + at.velocity, states)
        new = dict(zip(holding, 1.0 * (at.arrived >= ARRIVED), strict=True))
        fresh = np.array([new.get(fix.name, 1.0) for fix in flying.schedule(G).fixes])
        for name, values in zip(found, (Q_m, V_m, fresh), strict=True):
            found[name].append(values.ravel())
        Q_hat, V_hat = flying.estimated(G, states)
        estimates.append(np.concatenate([Q_hat.ravel(), V_hat]))
    return {name: np.array(rows) for name, rows in found.items()}, np.array(estimates)
