"""Faults planted in the files of the vehicle: the rows of `eqt verify` that tell each of them.

Every fault is a wrong sign, factor, frame, order or number, as a slip of the pen makes them.
"""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from eqt_cli.analysis.certificates import Verdict
from eqt_cli.analysis.verification import verify_experiment
from eqt_cli.config.source import read_config
from eqt_cli.core.arrays import absolute, apply_matrix, clip, cross, norm, stack, where
from eqt_cli.core.leaves import with_fields
from eqt_cli.experiment.build import build
from eqt_cli.vehicle import Vehicle
from eqt_cli.vehicle.actuators.deadband import Deadband
from eqt_cli.vehicle.actuators.lag import Lag
from eqt_cli.vehicle.actuators.limit import Limit
from eqt_cli.vehicle.actuators.momentum_limit import MomentumLimit
from eqt_cli.vehicle.actuators.quantisation import Quantisation
from eqt_cli.vehicle.actuators.rate_limit import RateLimit
from eqt_cli.vehicle.actuators.thrusters import Thrusters
from eqt_cli.vehicle.component import VehiclePart
from eqt_cli.vehicle.forces.base import Force
from eqt_cli.vehicle.forces.drag import Drag
from eqt_cli.vehicle.forces.gravity_gradient import GravityGradient
from eqt_cli.vehicle.forces.gust import SINES, Gust
from eqt_cli.vehicle.forces.restoring import Restoring
from eqt_cli.vehicle.inertia import ConstantInertia, RelativeInertia, VaryingInertia
from eqt_cli.vehicle.numbers import Normal, Uniform
from eqt_cli.vehicle.sensors import Sensor
from eqt_cli.vehicle.sensors.bias import Bias
from eqt_cli.vehicle.sensors.channels import Channel
from eqt_cli.vehicle.sensors.noise import Noise

RUNNING = """group: SE3
gains: {kp: [2, 2, 2, 3], kd: [1, 1, 1, 3, 3, 3]}
reference: {torque: ["0.2*cos(t)", "0.1", 0, "0.1", "sin(t)", 0]}
controllers: [eqt]
initial: {pose: {kind: exp_normal, std: 0.5}, velocity: {kind: normal, std: 1.0}}
ensemble: {runs: 3, seed: 4}
time: {duration: 0.5, samples: 11}
solver: {engine: solve_ivp, rtol: 1.0e-8}
"""
CONSTANT = "inertia: [1.0, 2.0, 2.5, 3.0, 4.0, 5.0]\n"
ROWS = [[f"{2 + i} + t/{3 + i}" if i == j else 0 for j in range(6)] for i in range(6)]
MOVING = f"inertia: {{matrix: {ROWS}}}\n"
VARYING = f"plant: {{inertia: {{matrix: {ROWS}}}}}\n".replace("2 +", "3 +")

FORCES = """plant:
  inertia: {relative: {uniform: [-0.1, 0.1]}}
  forces:
    - {kind: constant, force: [0.02, 0, {normal: [0, 0.3]}, 0.1, 0, 0]}
    - {kind: constant, force: [0.02, 0.1, 0, 0.1, 0, 0], frame: spatial}
    - {kind: drag, linear: [0.1, 0.2, 0.3, 1, 2, 3], quadratic: [0.1, 0.2, 0.3, 1, 2, 3]}
    - {kind: drag, linear: [0.1, 0.2, 0.3, 1, 2, 3], frame: spatial}
    - {kind: gust, std: 0.1, time_constant: 2.0}
    - kind: restoring
      weight: 10
      buoyancy: {uniform: [9, 11]}
      centre_of_mass: [0.1, 0, -0.2]
      centre_of_buoyancy: [0, 0.1, 0.3]
      up: [0, 0.1, 2]
    - {kind: gravity_gradient, rate: 0.3, inertia: [1, 2, 2.5]}
"""
ACTUATORS = """control: {period: 0.1, delay: 2}
actuators:
  - {kind: quantisation, resolution: 0.05}
  - {kind: deadband, width: 0.07}
  - {kind: momentum_limit, momentum: 5}
  - {kind: rate_limit, rate: 20.0}
  - {kind: limit, limit: [2, 2, 2, 8, 8, 8], norm: true}
  - {kind: limit, limit: 5}
  - {kind: lag, time_constant: {uniform: [0.1, 0.2]}}
"""
THRUSTERS = """plant:
  forces:
    - {kind: drag, quadratic: 0.5, current: [0.3, "0.2*sin(t)", {uniform: [0, 0.2]}]}
    - {kind: drag, linear: 0.5, current: [0.1, 0.2, 0.3], frame: spatial}
control: {period: 0.1}
actuators:
  - kind: thrusters
    thrusters:
      - {at: [0.4, 0.3, 0.1], along: [1, -1, 0], turns: 0.1}
      - {at: [0.4, -0.3, 0.1], along: [1, 1, 0]}
      - {at: [-0.4, 0.3, 0.1], along: [-1, -1, 0]}
      - {at: [-0.4, -0.3, 0.1], along: [-1, 1, 0]}
      - {at: [0.3, 0.5, 0], along: [0, 0, -1]}
      - {at: [0.3, -0.5, 0], along: [0, 0, -1]}
      - {at: [-0.3, 0.5, 0], along: [0, 0, -1]}
      - {at: [-0.3, -0.5, 0], along: [0, 0, -1]}
    low: -3
    high: {uniform: [3, 4]}
    time_constant: 0.2
    weights: [1, 2, 3, 4, 1, 1, 1, 1]
"""
SENSORS = """control: {period: 0.05}
sensors:
  pose: [{kind: noise, std: 0.01}, {kind: bias, value: {normal: [0, 0.01]}, walk: 0.01}]
  velocity: [{kind: noise, density: 0.01}, {kind: bias, value: 0.02}]
"""

SLOW = """control: {period: 0.05}
sensors:
  pose: [{kind: noise, std: 0.01, of: translation, period: 0.1, delay: 1, dropout: 0.4}]
  velocity: [{kind: noise, std: 0.01, period: 0.1}]
"""

EXPERIMENTS = {
    "forces": RUNNING + CONSTANT + FORCES,
    "actuators": RUNNING + CONSTANT + ACTUATORS,
    "sensors": RUNNING + CONSTANT + SENSORS,
    "slow sensors": RUNNING + CONSTANT + SLOW,
    "thrusters": RUNNING + CONSTANT + THRUSTERS,
    "bounded thrusters": RUNNING + CONSTANT + THRUSTERS + "    allocation: bounded\n",
    "true tensor": RUNNING + CONSTANT + "plant: {inertia: [2, 2, 2, 3, 4, {uniform: [5, 6]}]}\n",
    "tensor in time": RUNNING + CONSTANT + VARYING,
    "share of a tensor in time": RUNNING + MOVING + "plant: {inertia: {relative: 0.3}}\n",
}


# Where a fault is planted -------------------------------------------------------------------------


def in_method(owner, name, fault):
    """A fault in a method: `fault(original, self, *arguments)` takes its place."""

    def plant(monkeypatch):
        original = getattr(owner, name)
        monkeypatch.setattr(owner, name, lambda self, *rest: fault(original, self, *rest))

    return plant


def in_numbers(owner, **changes):
    """Numbers of a part that are others, by option: ``owner.numbers`` with a change of each."""

    def of_run(exact, part, G, random):
        found = exact(part, G, random)
        return with_fields(
            found, **{name: change(getattr(found, name)) for name, change in changes.items()}
        )

    return in_method(owner, "of_run", of_run)


def in_output(owner, fault):
    """What an actuator makes of a command, of the command and its numbers."""
    return in_method(owner, "output", lambda exact, part, G, u, x: fault(u, part))


def dropping_rates(exact, vehicle, s, torque):
    """𝕀̇ V of the plant left out."""
    true = vehicle.inertia.at(s.inertia, s.t)
    V_dot = true.velocity(s.G.ad_star(s.V, true.momentum(s.V)) + torque)
    return s.inertia.momentum(V_dot) + s.inertia.rate_force(s.V) - s.G.ad_star(s.V, s.P)


def momentum_of_the_model(exact, vehicle, s, torque):
    true = vehicle.inertia.at(s.inertia, s.t)
    V_dot = true.velocity(s.G.ad_star(s.V, s.P) + torque)
    return s.inertia.momentum(V_dot) - s.G.ad_star(s.V, s.P)


def forces_with_the_other_sign(exact, vehicle, s, torque):
    for force in vehicle.forces:
        torque = torque - 2 * force.in_body(s.G, s.t, s.Q, s.V)
    return exact(vehicle, s, torque)


def held_at_once(exact, vehicle, G, asked, states, *solved):
    """The command does not wait."""
    now = np.concatenate([asked] * (vehicle.control.delay + 1), axis=-1)
    return exact(vehicle, G, asked, states, *solved) | {
        "held": exact(vehicle, G, asked, {**states, "commands": now}, *solved)["held"]
    }


def one_period_late(exact, vehicle, G):
    found = exact(vehicle, G)
    return found | {"commands": found["commands"] + G.dimension} if "commands" in found else found


def backwards(exact, vehicle, start=0):
    found = list(exact(vehicle, start))
    return iter(found[::-1])


def errors_with_the_other_sign(exact, vehicle, *rest):
    errors = exact(vehicle, *rest)
    return errors._replace(velocity=-errors.velocity)


def newest(exact, channel, value, held):
    return exact(channel, value, held[..., -channel.size :])


def as_a_body_force(exact, force, G, t, Q, V):
    return force.acting(G, t, Q, V)


def of_the_inverse_pose(exact, force, G, t, Q, V):
    if force.frame == "body":
        return exact(force, G, t, Q, V)
    return G.Ad_star(G.inverse(Q), force.acting(G, t, Q, G.Ad(Q, V)) + 0 * V)


def of_the_body_velocity(exact, force, G, t, Q, V):
    if force.frame == "body":
        return exact(force, G, t, Q, V)
    return G.Ad_star(Q, force.acting(G, t, Q, V) + 0 * V)


def quadratic_without_sign(exact, force, G, t, Q, V):
    return -apply_matrix(force.linear, V) - apply_matrix(force.quadratic, V * V)


def linear_in_the_square(exact, force, G, t, Q, V):
    return -apply_matrix(force.linear + force.quadratic, V)


def buoyancy_turns_the_other_way(exact, force, G, t, Q, V):
    up = (G.rotation(Q) * force.up[..., :, None]).sum(axis=-2)
    turn = cross(force.centre_of_buoyancy, force.buoyancy * up)
    zero = 0 * turn[..., 0]
    return exact(force, G, t, Q, V) - 2 * stack(
        [*(turn[..., k] for k in range(3)), zero, zero, zero]
    )


def up_in_the_body(exact, force, G, t, Q, V):
    return exact(force, G, t, np.swapaxes(Q, -1, -2), V)


def orbit_the_other_way(exact, force, G, t, Q, V):
    return exact(force, G, -t, Q, V)


def third_of_it(exact, force, G, t, Q, V):
    return exact(force, G, t, Q, V) / 3


def exchanged(exact, part, G, u, x):
    if part.norm:
        return exact(part, G, u, x)
    return clip(u, part.high, part.low)


def norm_along_each_axis(exact, part, G, u, x):
    if not part.norm:
        return exact(part, G, u, x)
    limit = part.limit
    return u / where(norm(u)[..., None] > limit, norm(u)[..., None] / limit, 1.0)


def without_the_period(exact, part, G, u, x, period):
    return exact(part, G, u, x, 1.0)


def no_lower_end(exact, part, G, u, x, period):
    h = x[..., G.dimension :]
    torque = np.minimum(u, (part.momentum - h) / period)
    return np.concatenate([torque, h + period * torque], axis=-1)


def from_0(exact, part, G, u, x, period):
    return exact(part, G, u, 0 * x, period)


def rounded_down(u, part):
    return part.resolution * np.floor(u / part.resolution)


def half_of_what_is_small(u, part):
    return where(absolute(u) < part.width, 0.5 * u, u)


def less_by_the_width(u, part):
    return u - clip(u, -part.width, part.width)


def with_first_entries(part):
    """A part whose vectors have their first entry everywhere."""
    vectors = {name: getattr(part, name) for name in part.vectors}
    known = {name: each for name, each in vectors.items() if each is not None}
    return with_fields(part, **{name: 0 * each + each[:1] for name, each in known.items()})


def twice_as_slow(exact, part, G, u, x):
    return exact(part, G, u, x) / 2


def in_the_spread(exact, sensor, G, period):
    return (
        np.asarray(sensor.density or 0.0) * np.sqrt(period)
        if sensor.std is None
        else exact(sensor, G, period)
    )


PLANTS = {
    # vehicle.py
    "plant: rate of its inertia dropped": (
        "tensor in time",
        in_method(Vehicle, "acting", dropping_rates),
    ),
    "plant: momentum of the believed inertia": (
        "true tensor",
        in_method(Vehicle, "acting", momentum_of_the_model),
    ),
    "plant: sign of the forces": (
        "forces",
        in_method(Vehicle, "acting", forces_with_the_other_sign),
    ),
    "actuators: in the reverse order": ("actuators", in_method(Vehicle, "_chain", backwards)),
    "delay: none": ("actuators", in_method(Vehicle, "after_instant", held_at_once)),
    "delay: one period too long": ("actuators", in_method(Vehicle, "states", one_period_late)),
    "measured velocity: sign of its errors": (
        "sensors",
        in_method(Vehicle, "measurement_errors", errors_with_the_other_sign),
    ),
    # sensors/channels.py
    "measurement: read before it arrives": ("slow sensors", in_method(Channel, "read", newest)),
    "measurement: the first one is late": (
        "slow sensors",
        in_method(
            Channel, "arrivals", lambda exact, channel, *rest: np.minimum(exact(channel, *rest), 1)
        ),
    ),
    "measurement: lost ones arrive": (
        "slow sensors",
        in_method(Sensor, "lost", lambda exact, sensor, count, random: np.zeros(count, dtype=bool)),
    ),
    "measurement: at every instant": (
        "slow sensors",
        in_method(
            Channel, "arrivals", lambda exact, channel, *rest: np.maximum(exact(channel, *rest), 1)
        ),
    ),
    # inertia.py
    "relative inertia: inverse unscaled": (
        "forces",
        in_method(
            RelativeInertia,
            "at",
            lambda exact, part, model, t: dataclasses.replace(
                exact(part, model, t), inverse=model.inverse
            ),
        ),
    ),
    "relative inertia: rate unscaled": (
        "share of a tensor in time",
        in_method(
            RelativeInertia,
            "at",
            lambda exact, part, model, t: dataclasses.replace(
                exact(part, model, t), change=model.change
            ),
        ),
    ),
    "relative inertia: 1 − r": ("forces", in_numbers(RelativeInertia, relative=lambda r: -r)),
    "true tensor: inverse of the diagonal's mean": (
        "true tensor",
        in_numbers(ConstantInertia, inverse=lambda A: np.eye(6) * np.trace(A) / 6),
    ),
    "true tensor in time: that of t = 0": (
        "tensor in time",
        in_method(
            VaryingInertia,
            "at",
            lambda exact, part, model, t: exact(part, model, 0 * t),
        ),
    ),
    # numbers.py, component.py
    "uniform: its middle": (
        "forces",
        in_method(Uniform, "draw", lambda exact, drawn, random: drawn.mean + 0 * random.random()),
    ),
    "normal: variance for deviation": (
        "forces",
        in_method(
            Normal,
            "draw",
            lambda exact, drawn, random: random.normal(drawn.normal[0], drawn.normal[1] ** 2),
        ),
    ),
    "options: the first entry for all": (
        "forces",
        in_method(
            VehiclePart,
            "of_run",
            lambda exact, part, G, random: with_first_entries(exact(part, G, random)),
        ),
    ),
    # actuators/
    "deadband: half passes": ("actuators", in_output(Deadband, half_of_what_is_small)),
    "deadband: less by the width": ("actuators", in_output(Deadband, less_by_the_width)),
    "lag: twice the time constant": (
        "actuators",
        in_numbers(Lag, time_constant=lambda T: 2 * T),
    ),
    "lag: half the rate": ("actuators", in_method(Lag, "state_rate", twice_as_slow)),
    "limit: low and high exchanged": ("actuators", in_method(Limit, "output", exchanged)),
    "limit: norm not in proportion": (
        "actuators",
        in_method(Limit, "output", norm_along_each_axis),
    ),
    "limit: at the limit where it is not": (
        "actuators",
        in_method(
            Limit,
            "at_limit",
            lambda exact, part, G, u, x: ~exact(part, G, u, x),
        ),
    ),
    "limit: most of another limit": (
        "actuators",
        in_method(
            Limit,
            "most",
            lambda exact, part, G, times, torque: (torque, torque),
        ),
    ),
    "momentum limit: without the period": (
        "actuators",
        in_method(MomentumLimit, "step", without_the_period),
    ),
    "momentum limit: no lower end": ("actuators", in_method(MomentumLimit, "step", no_lower_end)),
    "quantisation: rounded down": ("actuators", in_output(Quantisation, rounded_down)),
    "quantisation: half the step": (
        "actuators",
        in_numbers(Quantisation, resolution=lambda step: step / 2),
    ),
    "rate limit: without the period": (
        "actuators",
        in_method(RateLimit, "step", without_the_period),
    ),
    "rate limit: from 0": ("actuators", in_method(RateLimit, "step", from_0)),
    # forces/
    "frame: spatial as body": ("forces", in_method(Force, "in_body", as_a_body_force)),
    "frame: of the inverse pose": ("forces", in_method(Force, "in_body", of_the_inverse_pose)),
    "frame: velocity of the body": ("forces", in_method(Force, "in_body", of_the_body_velocity)),
    "drag: square without its sign": ("forces", in_method(Drag, "acting", quadratic_without_sign)),
    "drag: linear for quadratic": ("forces", in_method(Drag, "acting", linear_in_the_square)),
    "restoring: sign of buoyancy's torque": (
        "forces",
        in_method(Restoring, "acting", buoyancy_turns_the_other_way),
    ),
    "restoring: pose transposed": ("forces", in_method(Restoring, "acting", up_in_the_body)),
    "gravity gradient: factor 3": ("forces", in_method(GravityGradient, "acting", third_of_it)),
    "gravity gradient: orbit the other way": (
        "forces",
        in_method(GravityGradient, "acting", orbit_the_other_way),
    ),
    "gust: half the variance": (
        "forces",
        in_numbers(Gust, amplitude=lambda a: a / np.sqrt(2)),
    ),
    "gust: time constant for frequency": (
        "forces",
        in_numbers(Gust, frequency=lambda w: 4 * w),
    ),
    "gust: one sine too few": (
        "forces",
        in_numbers(Gust, amplitude=lambda a: a * np.sqrt(SINES / (SINES - 1))),
    ),
    "departures: none": (
        "forces",
        lambda monkeypatch: monkeypatch.setattr(Vehicle, "departures", ""),
    ),
    # thrusters.py, and the current of drag.py
    "thrusters: force before torque": (
        "thrusters",
        in_method(Thrusters, "columns", lambda exact, part, G: np.roll(exact(part, G), 3, axis=0)),
    ),
    "thrusters: weights left out": (
        "thrusters",
        in_method(
            Thrusters,
            "of_run",
            lambda exact, part, *rest: exact(with_fields(part, weights=None), *rest),
        ),
    ),
    "thrusters: half the rate": ("thrusters", in_method(Thrusters, "state_rate", twice_as_slow)),
    "thrusters: solved without limits": (
        "bounded thrusters",
        in_method(
            Thrusters,
            "solution",
            lambda exact, part, G, u: u @ part.inverse.swapaxes(-1, -2)[0],
        ),
    ),
    "current: in the body frame": (
        "thrusters",
        in_method(
            Drag,
            "_flow",
            lambda exact, part, G, t, Q: exact(with_fields(part, frame="spatial"), G, t, Q),
        ),
    ),
    "current: against the body": (
        "thrusters",
        in_method(Drag, "_flow", lambda exact, *rest: -exact(*rest)),
    ),
    # sensors/
    "noise: none": (
        "sensors",
        in_method(Noise, "errors", lambda exact, part, *rest: 0 * exact(part, *rest)),
    ),
    "noise: doubled": (
        "sensors",
        in_method(Noise, "white_deviation", lambda exact, part, *rest: 2 * exact(part, *rest)),
    ),
    "noise: density times √period": (
        "sensors",
        in_method(Noise, "white_deviation", in_the_spread),
    ),
    "bias: dropped": (
        "sensors",
        in_method(
            Bias,
            "errors",
            lambda exact, part, *rest: exact(dataclasses.replace(part, value=0.0), *rest),
        ),
    ),
    "bias: walk grows with the time": (
        "sensors",
        in_method(
            Bias,
            "errors",
            lambda exact, part, G, n, period, random: exact(part, G, n, period**2, random),
        ),
    ),
}


FORCE, PLANT = "forces are those of the configuration", "plant moves by its forces"
ACTUATOR, ARRIVES = "actuators are those of the configuration", "command arrives after its delay"
HELD = "measurements are held and arrive late"
CLOSED_FORM = "actuator follows its closed form"
TOLD, COVARIANCE = "measurements err as configured", "noise has its covariance"

EXPECTED = {
    **{fault: {FORCE, PLANT} for fault, (where, _) in PLANTS.items() if where == "forces"},
    **{fault: {ACTUATOR} for fault, (where, _) in PLANTS.items() if where == "actuators"},
    **{fault: {TOLD} for fault, (where, _) in PLANTS.items() if where == "sensors"},
    **{fault: {HELD} for fault, (where, _) in PLANTS.items() if where == "slow sensors"},
    **{fault: {PLANT} for fault in PLANTS if fault.split(":")[0] == "plant"},
    **{fault: {PLANT} for fault in PLANTS if "relative" in fault or "true tensor" in fault},
    "delay: one period too long": {ACTUATOR, ARRIVES},
    "lag: half the rate": {ACTUATOR, CLOSED_FORM},
    "thrusters: force before torque": {ACTUATOR, PLANT},
    "thrusters: weights left out": {ACTUATOR},
    "thrusters: half the rate": {ACTUATOR, CLOSED_FORM},
    "thrusters: solved without limits": {ACTUATOR},
    "current: in the body frame": {FORCE, PLANT},
    "current: against the body": {FORCE, PLANT},
    "limit: most of another limit": set(),  # of a hypothesis, which cannot fail
    "departures: none": set(),  # words
    "noise: none": {TOLD, COVARIANCE},
    "noise: doubled": {TOLD, COVARIANCE},
    "noise: density times √period": {TOLD, COVARIANCE},
}

SYMPTOMS = {"tracks", "energy balance", "error system by itself"}
"""What a run shows of a fault depends on where it starts; the cause does not."""

FAST = (
    "plant: rate of its inertia dropped",
    "relative inertia: rate unscaled",
    "deadband: half passes",
    "restoring: sign of buoyancy's torque",
    "bias: dropped",
    "measurement: lost ones arrive",
)
"""One of every kind; `make test-all` plants all of them."""


def red_rows(experiment, tmp_path):
    """The rows that fail."""
    path = tmp_path / "c.yaml"
    path.write_text(EXPERIMENTS[experiment], encoding="utf-8")
    found = verify_experiment(build(read_config(path)))
    return {row.name for row in found.rows if row.verdict is Verdict.FAILS}


@pytest.mark.parametrize(
    "experiment",
    [
        pytest.param(name, marks=[pytest.mark.slow("verifies a whole experiment")] * (k > 2))
        for k, name in enumerate(EXPERIMENTS)
    ],
)
def test_without_a_fault_nothing_is_red(experiment, tmp_path):
    assert red_rows(experiment, tmp_path) == set()


@pytest.mark.parametrize(
    "fault",
    [
        pytest.param(fault, marks=[pytest.mark.slow("one of many faults")] * (fault not in FAST))
        for fault in PLANTS
    ],
)
def test_a_fault_turns_the_rows_red_that_are_about_it(fault, monkeypatch, tmp_path):
    experiment, plant = PLANTS[fault]
    plant(monkeypatch)
    assert red_rows(experiment, tmp_path) - SYMPTOMS == EXPECTED[fault]


# The table of all of them -------------------------------------------------------------------------

PAGE = Path(__file__).parents[2] / "docs" / "explanation" / "planted_faults.md"


def table():
    """All planted faults, with the rows that they turn red, as it stands on the page."""
    lines = ["| fault | rows of `eqt verify` that turn red |", "|---|---|"]
    for fault in PLANTS:
        lines.append(f"| {fault} | {'; '.join(sorted(EXPECTED[fault])) or 'none'} |")
    return "\n".join(lines)


def test_the_page_has_the_table_of_all_faults():
    """To mend it, put there what `table()` gives."""
    assert table() in PAGE.read_text(encoding="utf-8")


def test_the_page_says_how_many_are_told():
    told = sum(bool(rows) for rows in EXPECTED.values())
    said = f"`eqt verify` tells {told} of these {len(PLANTS)} faults."
    assert said in PAGE.read_text(encoding="utf-8")
