"""Certificates of what is between law and plant; each planted fault fails its own row."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest

from eqt_cli.analysis.certificates import Runs, Verdict
from eqt_cli.analysis.certificates.flight import (
    ActuatorsInClosedForm,
    Hold,
    NoiseCovariance,
    StreamsApart,
    _off_identity,
)
from eqt_cli.analysis.certificates.vehicle import ActuatorsAgain, CommandArrives, PlantMoves
from eqt_cli.analysis.evidence import second_actuators, second_forces, second_sensors
from eqt_cli.analysis.evidence.flight import VehicleRuns
from eqt_cli.config.source import read_config
from eqt_cli.execution.batches import batches
from eqt_cli.experiment.read_study import study
from eqt_cli.vehicle.actuators import actuators
from eqt_cli.vehicle.actuators.limit import Limit
from eqt_cli.vehicle.forces import forces
from eqt_cli.vehicle.sensors import sensors
from eqt_cli.vehicle.sensors.noise import Noise

CONFIG = """group: SO3
inertia: [1.0, 2.0, 2.5]
gains: {kp: 2, kd: 2}
reference: {torque: ["0.2*cos(t)", "0.1", 0]}
controllers: [eqt]
ensemble: {runs: 4, seed: 4}
time: {duration: 2, samples: 41}
actuators: [{kind: limit, limit: 1}, {kind: lag, time_constant: {uniform: [0.1, 0.2]}}]
control: {period: 0.1, delay: 1}
sensors: {pose: [{kind: noise, std: 0.01}], velocity: [{kind: noise, density: 0.01}]}
"""

CHECKS = (Hold, ActuatorsInClosedForm, NoiseCovariance, StreamsApart)


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    path = tmp_path_factory.mktemp("flight") / "c.yaml"
    path.write_text(CONFIG, encoding="utf-8")
    found = study(read_config(path))
    [batch] = batches(found, "eqt", np.arange(4))
    solution = batch.engine.solve(batch.problem)
    return VehicleRuns(batch.problem, solution.states, 4, np.arange(4))


def verdicts(flight):
    none = np.zeros(4)
    runs = Runs(
        "eqt", None, 1e-9, 0.05, flight.problem.times, None, none, none, none, none, None,
        flight=flight,
    )  # fmt: skip
    return [check().check(runs).verdict if check().applies(runs) else None for check in CHECKS]


def with_velocity_sensor(flight, sensor):
    loop = flight.problem.loop
    vehicle = replace(loop.vehicle, velocity_sensors=(sensor,))
    return replace(flight, problem=replace(flight.problem, loop=replace(loop, vehicle=vehicle)))


def changed(flight, stretch, change):
    states = flight.states.copy()
    where = flight.problem.loop.layout.slices[stretch]
    states[2, 7, where] = change(states[2, 7, where])
    return replace(flight, states=states)


def test_all_hold(flight):
    assert verdicts(flight) == [Verdict.HOLDS] * 4


def test_a_command_that_moves_between_instants(flight):
    found = verdicts(changed(flight, "vehicle.commands", lambda command: command + 1e-9))
    assert found == [Verdict.FAILS, *[Verdict.HOLDS] * 3]


def test_a_command_of_what_was_not_told(flight):
    errors = flight.problem.errors
    changed = errors._replace(velocity=errors.velocity + 1e-9)
    problem = replace(flight.problem, errors=changed)
    assert verdicts(replace(flight, problem=problem))[0] is Verdict.FAILS


def test_a_lag_that_is_elsewhere(flight):
    found = verdicts(changed(flight, "vehicle.actuators_1", lambda x: x + 1e-5))
    assert found == [Verdict.HOLDS, Verdict.FAILS, *[Verdict.HOLDS] * 2]


@pytest.mark.parametrize(
    ("registry", "forms"),
    [
        (forces, second_forces.FORMS),
        (actuators, second_actuators.FORMS),
        (sensors, second_sensors.FORMS),
    ],
    ids=["forces", "actuators", "sensors"],
)
def test_every_part_of_eqt_has_a_second_form(registry, forms):
    assert set(forms) == {part.name for part in registry.all() if "eqt_cli" in part.__module__}


@dataclass(frozen=True)
class Mine(Limit):
    """A part of a plugin, whose formula is known nowhere else."""

    name: ClassVar[str] = "mine"


def test_a_part_without_a_second_form_is_named(flight):
    loop = flight.problem.loop
    configured = loop.vehicle.configured
    configured = replace(configured, actuators=(Mine(1.0), *configured.actuators[1:]))
    vehicle = configured.of_run(loop.group)
    flight = replace(flight, problem=replace(flight.problem, loop=replace(loop, vehicle=vehicle)))
    none = np.zeros(4)
    runs = Runs("eqt", None, 1e-9, 0.05, flight.problem.times, None, none, none, none, none, None,
                flight=flight)  # fmt: skip
    for check in (ActuatorsAgain, PlantMoves, CommandArrives):
        row = check().check(runs)
        assert (row.verdict, row.remark) == (Verdict.UNDECIDED, "mine has no second form")


@pytest.mark.parametrize("count", [1, 2, 5, 1000])
def test_noise_of_0_is_beyond_its_bound_however_few_there_are(count):
    found = list(_off_identity(np.zeros((count, 2))))
    assert [measured > bound for measured, bound in found[:2]] == [True, True]
    normal = np.random.default_rng(3).standard_normal((count, 2))
    assert all(measured <= bound for measured, bound in _off_identity(normal))


@dataclass(frozen=True)
class TooLoud(Noise):
    """Of a variance that is not the one it says."""

    name: ClassVar[str] = "too loud"

    def errors(self, G, instants, period, random):
        return 2.0 * super().errors(G, instants, period, random)


@dataclass(frozen=True)
class OneStream(Noise):
    """The same in every run."""

    name: ClassVar[str] = "one stream"

    def errors(self, G, instants, period, random):
        return super().errors(G, instants, period, np.random.default_rng(2))


@pytest.mark.parametrize(
    ("sensor", "expected"),
    [
        (TooLoud(std=0.1), [Verdict.FAILS, Verdict.HOLDS]),
        (OneStream(std=0.1), [Verdict.HOLDS, Verdict.FAILS]),
    ],
)
def test_noise_that_is_not_what_was_asked_for(flight, sensor, expected):
    assert verdicts(with_velocity_sensor(flight, sensor))[2:] == expected
