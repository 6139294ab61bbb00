"""Certificates of what is between law and plant; each planted fault fails its own row."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest

from eqt_cli.analysis.certificates import Runs, VehicleRuns, Verdict
from eqt_cli.analysis.run_checks import (
    MomentumBalance,
    NoiseCovariance,
    _off_identity,
    window_times,
)
from eqt_cli.components.sensors import Noise
from eqt_cli.components.vehicle import Vehicle
from eqt_cli.components.vehicle_parts import ScaledInertia
from eqt_cli.config.source import read_config
from eqt_cli.config.study import study
from eqt_cli.runs.batches import batches

ROWS = "[[2 + sin(t), 0, 0.1], [0, 3, 0], [0.1, 0, 4 + 0.5*t]]"
CONFIG = f"""group: SO3
inertia: {{matrix: {ROWS}}}
gains: {{kp: 2, kd: 2}}
reference: {{torque: ["0.2*cos(t)", "0.1", 0]}}
controllers: [eqt]
ensemble: {{runs: 4, seed: 4}}
time: {{duration: 2, samples: 41}}
solver: {{rtol: 1.0e-7}}
plant:
  inertia: {{relative: 0.3}}
  forces: [{{kind: constant, force: [0.3, 0, 0.1], frame: spatial}}, {{kind: drag, linear: 0.2}}]
actuators: [{{kind: limit, limit: 1}}, {{kind: lag, time_constant: {{uniform: [0.1, 0.2]}}}}]
control: {{period: 0.1, delay: 1}}
sensors: {{pose: [{{kind: noise, std: 0.01}}], velocity: [{{kind: noise, density: 0.01}}]}}
"""

CHECKS = (MomentumBalance, NoiseCovariance)
HOLD = [Verdict.HOLDS] * 2


def solved(folder, runs=4, config=CONFIG):
    path = folder / "c.yaml"
    path.write_text(config, encoding="utf-8")
    [batch] = batches(study(read_config(path)), "eqt", np.arange(runs))
    made = VehicleRuns(batch.problem, batch.engine.solve(batch.problem).states, 4, np.arange(runs))
    problem = replace(made.problem.select(np.arange(1)), times=window_times(made))
    windows = VehicleRuns(problem, batch.engine.solve(problem).states, 4, np.arange(1))
    return replace(made, windows=windows)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    return solved(tmp_path_factory.mktemp("runs"))


def rows(vehicle):
    none = np.zeros(4)
    runs = Runs(
        "eqt", None, 1e-7, 0.05, vehicle.problem.times, None, none, none, none, none, None,
        vehicle=vehicle,
    )  # fmt: skip
    return [check().check(runs) if check().applies(runs) else None for check in CHECKS]


def verdicts(vehicle):
    return [row and row.verdict for row in rows(vehicle)]


def with_velocity_sensor(runs, sensor):
    loop = runs.problem.loop
    vehicle = replace(loop.vehicle, velocity_sensors=(sensor,))
    return replace(runs, problem=replace(runs.problem, loop=replace(loop, vehicle=vehicle)))


def failing(runs):
    return {row.name for row in rows(runs) if row.verdict is Verdict.FAILS}


def test_all_hold(runs):
    assert verdicts(runs) == HOLD


OF_MANY = pytest.mark.slow("one of many faults")
SHORT = CONFIG.replace("duration: 2, samples: 41", "duration: 0.5, samples: 11")


# The momentum balance -----------------------------------------------------------------------------


def without_the_rate_of_the_inertia(vehicle, s, torque):
    true = vehicle.inertia.at(s.inertia, s.t)
    for force in vehicle.forces:
        torque = torque + force.in_body(s.G, s.t, s.Q, s.V)
    V_dot = true.velocity(s.G.ad_star(s.V, true.momentum(s.V)) + torque)
    return s.inertia.momentum(V_dot) + s.inertia.rate_force(s.V) - s.G.ad_star(s.V, s.P)


def with_the_momentum_of_the_model(vehicle, s, torque):
    true = vehicle.inertia.at(s.inertia, s.t)
    for force in vehicle.forces:
        torque = torque + force.in_body(s.G, s.t, s.Q, s.V)
    V_dot = true.velocity(s.G.ad_star(s.V, s.P) - true.rate_force(s.V) + torque)
    return s.inertia.momentum(V_dot) + s.inertia.rate_force(s.V) - s.G.ad_star(s.V, s.P)


def with_forces_of_the_other_sign(vehicle, s, torque, exact=Vehicle.acting):
    for force in vehicle.forces:
        torque = torque - 2 * force.in_body(s.G, s.t, s.Q, s.V)
    return exact(vehicle, s, torque)


def with_the_inverse_of_the_model(part, model, t, exact=ScaledInertia.at):
    return replace(exact(part, model, t), inverse=model.inverse)


def with_the_rate_of_the_model(part, model, t, exact=ScaledInertia.at):
    return replace(exact(part, model, t), change=model.change)


@pytest.mark.parametrize(
    ("owner", "method", "fault"),
    [
        (Vehicle, "acting", without_the_rate_of_the_inertia),
        pytest.param(Vehicle, "acting", with_the_momentum_of_the_model, marks=OF_MANY),
        pytest.param(Vehicle, "acting", with_forces_of_the_other_sign, marks=OF_MANY),
        pytest.param(ScaledInertia, "at", with_the_inverse_of_the_model, marks=OF_MANY),
        (ScaledInertia, "at", with_the_rate_of_the_model),
    ],
    ids=lambda value: getattr(value, "__name__", value),
)
def test_a_plant_that_does_not_obey_its_equation(owner, method, fault, monkeypatch, tmp_path):
    monkeypatch.setattr(owner, method, fault)
    found = failing(solved(tmp_path, runs=1, config=SHORT))
    assert found - {NoiseCovariance.name} == {MomentumBalance.name}


def test_a_plant_whose_states_are_a_thousandth_off(runs):
    states = runs.windows.states.copy()
    states[:, 1:18, runs.problem.loop.layout.slices["momentum"]] *= (
        1 + np.linspace(0, 1e-3, 17)[:, None]
    )
    assert failing(replace(runs, windows=replace(runs.windows, states=states))) == {
        MomentumBalance.name
    }


SAMPLED = ("control", "sensors")


def test_without_a_clock_only_the_momentum_is_balanced(tmp_path):
    kept = (line for line in SHORT.splitlines() if line.split(":")[0] not in SAMPLED)
    config = "\n".join(kept)
    assert verdicts(solved(tmp_path, 1, config)) == [Verdict.HOLDS, None]


# Noise --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 2, 5, 1000])
def test_noise_of_0_is_beyond_its_bound_however_few_there_are(count):
    found = list(_off_identity(np.zeros((count, 2))))
    assert [measured > bound for measured, bound, _ in found[:2]] == [True, True]
    normal = np.random.default_rng(3).standard_normal((count, 2))
    assert all(measured <= bound for measured, bound, _ in _off_identity(normal))


@dataclass(frozen=True)
class TooLoud(Noise):
    """Of a variance that is not the one it says."""

    name: ClassVar[str] = "too loud"

    def errors(self, G, instants, period, random):
        return 2.0 * super().errors(G, instants, period, random)


def test_noise_that_is_louder_than_it_says(runs):
    assert failing(with_velocity_sensor(runs, TooLoud(std=0.1))) == {NoiseCovariance.name}
