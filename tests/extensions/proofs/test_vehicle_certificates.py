"""Certificates of what is between law and plant; each planted fault fails its own row."""

import re
from dataclasses import dataclass, fields, replace
from typing import ClassVar

import numpy as np
import pytest

from eqt_cli.components import blocks
from eqt_cli.components.vehicle_parts import RelativeInertia
from eqt_cli.config.document import read_config
from eqt_cli.config.study import study
from eqt_cli.engines.engine import Problem
from eqt_cli.extend import Noise
from eqt_cli.extensions.proofs.certificates import Runs, VehicleRuns, Verdict
from eqt_cli.extensions.proofs.run_checks import (
    HIGHEST,
    INTEGRALS,
    NODES,
    TO_CHEBYSHEV,
    MomentumBalance,
    NoiseCovariance,
    StepsEndAtTimes,
    _off_identity,
    window_times,
)
from eqt_cli.extensions.proofs.verification import TIGHTER
from eqt_cli.extensions.spacecraft.wheels import Wheels
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


def solved(folder, runs=4, config=CONFIG, label="eqt"):
    path = folder / "c.yaml"
    path.write_text(config, encoding="utf-8")
    [batch] = batches(study(read_config(path)), label, np.arange(runs))
    made = VehicleRuns(batch.problem, batch.engine.solve(batch.problem).states, 4, np.arange(runs))
    few = made.problem.select(np.arange(1))
    problem = StepsEndAtTimes.of(few, window_times(few))
    engine = batch.engine.tightened(TIGHTER)
    states, tolerances = engine.solve(problem).states, (engine.rtol, engine.atol)
    windows = VehicleRuns(problem, states, 4, np.arange(1), None, *tolerances)
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
    return {row.name for row in rows(runs) if row and row.verdict is Verdict.FAILS}


def test_all_hold(runs):
    assert verdicts(runs) == HOLD


OF_MANY = pytest.mark.ci("one of many faults")
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


def with_forces_of_the_other_sign(vehicle, s, torque, exact=blocks.acting_force):
    for force in vehicle.forces:
        torque = torque - 2 * force.in_body(s.G, s.t, s.Q, s.V)
    return exact(vehicle, s, torque)


def with_the_inverse_of_the_model(part, model, t, exact=RelativeInertia.at):
    return replace(exact(part, model, t), inverse=model.inverse)


def with_the_rate_of_the_model(part, model, t, exact=RelativeInertia.at):
    return replace(exact(part, model, t), change=model.change)


@pytest.mark.parametrize(
    ("owner", "method", "fault"),
    [
        (blocks, "acting_force", without_the_rate_of_the_inertia),
        pytest.param(blocks, "acting_force", with_the_momentum_of_the_model, marks=OF_MANY),
        pytest.param(blocks, "acting_force", with_forces_of_the_other_sign, marks=OF_MANY),
        pytest.param(RelativeInertia, "at", with_the_inverse_of_the_model, marks=OF_MANY),
        (RelativeInertia, "at", with_the_rate_of_the_model),
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


STIFF = """group: SE3
inertia: [0.02, 0.03, 0.04, 1.4, 1.4, 1.4]
gains: {kp: 2, kd: 1.5}
reference: {kind: constant}
controllers: [eqt]
plant: {forces: [{kind: payload, mass: 0.3, at: [0.1, 0, -0.1], since: 0.6, lasts: 0.8}]}
initial: {pose: {kind: exp_normal, std: 0.5}}
ensemble: {runs: 1, seed: 2}
time: {duration: 20, samples: 401}
"""


@pytest.mark.ci("compiles a loop, in which a mode of 75 1/s limits the step")
def test_steps_end_where_the_force_is_integrated(tmp_path):
    """Only rounding is left; at samples inside steps, it is ten times as much."""
    vehicle = solved(tmp_path, 1, STIFF)
    [row, _] = rows(vehicle)
    assert row.verdict is Verdict.HOLDS
    assert row.measured < 1e-15
    problem = Problem(**{x.name: getattr(vehicle.windows.problem, x.name) for x in fields(Problem)})
    [batch] = batches(study(read_config(tmp_path / "c.yaml")), "eqt", np.arange(1))
    windows = replace(vehicle.windows, states=batch.engine.tightened(TIGHTER).solve(problem).states)
    [row, _] = rows(replace(vehicle, windows=windows))
    assert 5e-15 < row.measured < 1e-13  # by dense output, 1000 times the tolerance


@pytest.mark.ci("compiles a loop")
def test_windows_end_where_a_payload_is_released_at_a_drawn_time(tmp_path):
    """Released from a moving body, it takes a momentum along that no force gives."""
    drawn = STIFF.replace("kd: 1.5", "kd: 1").replace("std: 0.5", "std: 1").replace("20,", "4,")
    drawn = drawn.replace("since: 0.6, lasts: 0.8", "until: {uniform: [0.4, 1.6]}")
    [row, _] = rows(solved(tmp_path, 1, drawn.replace("401", "3")))
    assert row.verdict is Verdict.HOLDS


@pytest.mark.ci("compiles a loop")
def test_a_force_too_fast_for_its_windows_is_not_judged(tmp_path):
    """With three samples a window is 5 s; its bound would pass a force that is 30 % off."""
    force = '[{kind: expression, force: ["0.3*sin(40*t)", 0, 0, 0, 0, 0]}]'
    fast = re.sub(r"forces: .*}", f"forces: {force}}}", STIFF).replace(
        "20, samples: 401", "10, samples: 3"
    )
    assert verdicts(solved(tmp_path, 1, fast))[0] is Verdict.UNDECIDED


@pytest.mark.parametrize("order", [0, 1], ids=["jump", "kink"])
def test_the_highest_coefficients_bound_the_error_of_an_integral(order):
    """The errors are known by closed forms, wherever the force jumps or bends."""
    places = np.linspace(-1, 1, 4001)
    forces = np.maximum(NODES - places[:, None], 0) ** order * (NODES >= places[:, None])
    exact = (1 - places) ** (order + 1) / (order + 1)
    polynomials = TO_CHEBYSHEV @ forces[..., None]
    lost = np.abs(polynomials[:, -HIGHEST:, 0]).sum(axis=1)
    assert (np.abs(polynomials[..., 0] @ INTEGRALS - exact) <= 0.55 * lost + 1e-15).all()


# A body with three wheels: moment of inertia (kg m²), largest momentum of a wheel (N m s), and the
# duration of a turn (s), all rounded.
SATELLITES = {
    "1U CubeSat": (0.002, 0.002, 20),
    "12U CubeSat": (0.2, 0.05, 60),
    "satellite of 500 kg": (300, 10, 200),
    "space station": (1e8, 1e4, 6000),
}


def satellite(name, clock=True):
    J, h, T = SATELLITES[name]
    sizes = [J, 0.9 * J, 0.6 * J]
    return f"""group: SO3
inertia: {sizes}
gains: {{kp: {50 * J / T**2}, kd: {20 * J / T}}}
reference:
  {{kind: slew, from: {{rotvec: [0, 0, 0]}}, to: {{rotvec: [1.2, 0.8, -0.6]}}, duration: {T}}}
controllers: [lee2010]
actuators:
  - kind: wheels
    axes: [[1, 0.1, 0], [0, 1, 0.2], [0.3, 0, 1]]
    start: [{h / 2}, {-h / 2}, {h / 3}]
{f"control: {{period: {T / 20}}}" if clock else ""}
initial: {{velocity: {{kind: fixed, coordinates: [{0.1 / T}, 0, {-0.2 / T}]}}}}
ensemble: {{runs: 1}}
time: {{duration: {T}, samples: 21}}
solver: {{rtol: 1.0e-6, atol: 1.0e-10}}
"""


def with_more_gyroscopic_torque(part, G, V, x, exact=Wheels.reaction):
    force, rate = exact(part, G, V, x)
    return 1.01 * force, rate


def with_less_torque_on_the_wheels(part, G, command, x, exact=Wheels.state_rate):
    return 0.99 * exact(part, G, command, x)


BEYOND_1U = ("12U CubeSat", "satellite of 500 kg", "space station")
SOME = [pytest.param(name, marks=OF_MANY) for name in BEYOND_1U]
WHEEL_FAULTS = (
    ("reaction", with_more_gyroscopic_torque),
    pytest.param("state_rate", with_less_torque_on_the_wheels, marks=OF_MANY),
)
CLOCKS = [pytest.param(True, id="sampled"), pytest.param(False, id="continuous", marks=OF_MANY)]


@pytest.mark.parametrize("clock", CLOCKS)
@pytest.mark.parametrize("name", ["1U CubeSat", *SOME])
def test_wheels_and_body_keep_their_momentum(name, clock, tmp_path):
    """Without a force from outside, R(𝕁ω + A h) stays, here by NumPy from the states."""
    vehicle = solved(tmp_path, 1, satellite(name, clock), "lee2010")
    windows = vehicle.windows
    s = windows.loop.tracking(windows.problem.times, windows.states)
    J, h, _ = SATELLITES[name]
    axes = np.array([[1, 0.1, 0], [0, 1, 0.2], [0.3, 0, 1]]).T
    axes /= np.linalg.norm(axes, axis=0)
    stored = s.vehicle["actuators_0"][0] @ axes.T
    total = np.einsum("tij,tj->ti", s.Q[0], s.V[0] * [J, 0.9 * J, 0.6 * J] + stored)
    assert np.abs(total - total[0]).max() < 1e-8 * h  # the tolerance of the windows is 1e-9
    [row, _] = rows(vehicle)
    assert row.verdict is Verdict.HOLDS
    assert row.bound < 1e-6 * h


@pytest.mark.parametrize("clock", CLOCKS)
@pytest.mark.parametrize(("method", "fault"), WHEEL_FAULTS)
@pytest.mark.parametrize("name", ["1U CubeSat", *SOME])
def test_wheels_with_a_fault_of_one_percent(name, method, fault, clock, monkeypatch, tmp_path):
    monkeypatch.setattr(Wheels, method, fault)
    assert failing(solved(tmp_path, 1, satellite(name, clock), "lee2010")) == {MomentumBalance.name}


@pytest.mark.parametrize("name", ["1U CubeSat", *SOME])
def test_a_satellite_without_wheels_whose_states_are_one_percent_off(name, tmp_path):
    before, _, after = satellite(name).partition("  - kind: wheels")
    lag = f"  - {{kind: lag, time_constant: {SATELLITES[name][2] / 50}}}\ncontrol:"
    text = before + lag + after.partition("control:")[2]
    runs = solved(tmp_path, 1, text, "lee2010")
    assert failing(runs) == set()
    states = runs.windows.states.copy()
    states[:, 1:18, runs.problem.loop.layout.slices["momentum"]] *= (
        1 + np.linspace(0, 0.01, 17)[:, None]
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
