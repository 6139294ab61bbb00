"""Sensors with clocks, delays and losses, or states, of their own, against plain programs."""

from functools import cache

import numpy as np
import pytest
from case_tables import in_ci
from plain import hat
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import eqt_cli
from eqt_cli.api import load_experiment
from eqt_cli.base import yaml_source
from eqt_cli.components.initial_states import Stream, generator_at
from eqt_cli.components.mechanics import LawInput
from eqt_cli.config.document import read_config
from eqt_cli.config.preflight import build
from eqt_cli.config.study import study
from eqt_cli.runs.description import loop_in_words

SE3 = """group: SE3
inertia: [1.0, 2.0, 2.5, 3.0, 4.0, 5.0]
gains: {kp: [2, 2, 2, 3], kd: 2}
reference: {kind: constant, pose: {}}
controllers: [lee2010, {kind: goodarzi2013, ki: 0.2, bound: 0.5}]
initial: {pose: {kind: exp_normal, std: 0.4}, velocity: {kind: normal, std: 0.4}}
ensemble: {runs: 5, seed: 4}
time: {duration: 4, samples: 41}
control: {period: 0.1}
"""

SENSORS = """sensors:
  pose:
    - {kind: noise, std: [0.1, 0.2, 0.1], of: translation, period: 1.0, delay: 3}
    - {kind: bias, value: 0.02, walk: 0.02, of: translation, dropout: 0.4}
  velocity: [{kind: noise, density: 0.01, period: 0.2, delay: 1}]
"""

RUNS = [0, 1]
ARRIVING = [[True, False, True, True], [True, True, True, False]]
"""Of the positions of these runs, measured once a second."""

ENGINES = ["solve_ivp", in_ci("compiles what the other engine shows, too", "native")]


def with_engine(text, engine):
    return f"{text}solver: {{engine: {engine}}}\n"


# A rigid body with R, x and the body velocities w, v, and what its sensors tell ------------------


def moved(R, x, w, v, torque, force, duration, J, M):
    """The body after some time under a torque and a force that are held in its own frame."""

    def rates(t, y):
        R, w, v = y[:9].reshape(3, 3), y[12:15], y[15:]
        return np.concatenate(
            [
                (R @ hat(w)).ravel(),
                R @ v,
                (torque - np.cross(w, J * w) - np.cross(v, M * v)) / J,
                (force - np.cross(w, M * v)) / M,
            ]
        )

    start = np.concatenate([R.ravel(), x, w, v])
    y = solve_ivp(rates, (0, duration), start, method="DOP853", rtol=1e-9, atol=1e-11).y[:, -1]
    return y[:9].reshape(3, 3), y[9:12], y[12:15], y[15:]


def translations(run, ticks):
    """The errors of the position every ten periods, and which of them arrive."""
    noise = generator_at(4, Stream.VEHICLE, run, "sensors.pose[0]")
    white = noise.standard_normal((ticks // 10, 3)) * [0.1, 0.2, 0.1]
    steps = generator_at(4, Stream.VEHICLE, run, "sensors.pose[1]").standard_normal(
        (ticks // 10, 3)
    )
    walk = 0.02 + 0.02 * np.concatenate([np.zeros((1, 3)), np.cumsum(steps[1:], axis=0)])
    radio = generator_at(4, Stream.VEHICLE, run, "measured_pose_translation.arrived")
    arrives = radio.random(ticks // 10) >= 0.4
    arrives[0] = True
    return white + walk, arrives


K, J, M = np.diag([2.0, 2.0, 2.0, 3.0]), np.array([1.0, 2.0, 2.5]), np.array([3.0, 4.0, 5.0])


def asked(R, x, w, v):
    """Slope of ½ tr((Q − I) K (Q − I)ᵀ), damper, and what cancels the gyroscopic terms."""
    Q = np.block([[R, x[:, None]], [np.zeros((1, 3)), 1.0]])
    slope = Q.T @ (Q - np.eye(4)) @ K
    turns = [np.trace(hat(e).T @ slope[:3, :3]) for e in np.eye(3)]
    torque = -np.array(turns) - 2 * w + np.cross(w, J * w) + np.cross(v, M * v)
    return torque, -slope[:3, 3] - 2 * v + np.cross(w, M * v)


@cache
def flown(start, run, ticks):
    """Poses and velocities at the instants, by what is measured, held, late and lost."""
    R, x, w, v = (np.array(part) for part in start)
    error, arrives = translations(run, ticks)
    rates = generator_at(4, Stream.VEHICLE, run, "sensors.velocity[0]")
    noise = rates.standard_normal((ticks // 2, 6)) * 0.01 / np.sqrt(0.2)
    fixes, velocities, found = [], [], []
    for k in range(ticks):
        found.append((R, x, w, v))
        if k % 10 == 0 and arrives[k // 10]:
            fix = x + R @ error[k // 10]
        if k % 2 == 0:
            velocity = np.concatenate([w, v]) + noise[k // 2]
        fixes.append(fix)
        velocities.append(velocity)
        told = velocities[max(k - 1, 0)]
        torque, force = asked(R, fixes[max(k - 3, 0)], told[:3], told[3:])
        R, x, w, v = moved(R, x, w, v, torque, force, 0.1, J, M)
    return found


@pytest.mark.parametrize("engine", ENGINES)
def test_a_slow_late_and_lossy_position_is_that_of_a_plain_program(solved, engine):
    problem, solution = solved(with_engine(SE3 + SENSORS, engine), label="lee2010", runs=RUNS)
    s = problem.loop.tracking(problem.times, solution.states)
    assert [translations(run, 40)[1].tolist() for run in RUNS] == ARRIVING
    for index, run in enumerate(RUNS):
        Q, V = s.Q[index], s.V[index]
        start = (
            tuple(map(tuple, Q[0, :3, :3])),
            tuple(Q[0, :3, 3]),
            tuple(V[0, :3]),
            tuple(V[0, 3:]),
        )
        for k, (R, x, w, v) in enumerate(flown(start, run, 40)):
            np.testing.assert_allclose(Q[k, :3, :3], R, rtol=0, atol=1e-7)  # of 1e-9 a step
            np.testing.assert_allclose(Q[k, :3, 3], x, rtol=0, atol=1e-7)
            np.testing.assert_allclose(V[k], np.concatenate([w, v]), rtol=0, atol=1e-7)


# Engines, neighbours, sessions --------------------------------------------------------------------


@pytest.mark.parametrize("engine", ENGINES)
def test_bits_do_not_depend_on_neighbours_threads_or_memory(solved, engine):
    """Of a law with memory, which is asked at the same instants."""
    text = with_engine(SE3.replace("duration: 4", "duration: 1") + SENSORS, engine)
    _, together = solved(text, label="goodarzi2013")
    _, some = solved(text, label="goodarzi2013", runs=[3, 1], workers=2)
    expected = together.states[[3, 1]]
    if engine == "solve_ivp":  # a run of it depends on its block
        np.testing.assert_allclose(some.states, expected, rtol=0, atol=1e-7)
    else:
        np.testing.assert_array_equal(some.states, expected)


def test_a_sweep_over_sensors_is_ragged_where_states_are(tmp_path):
    path = tmp_path / "c.yaml"
    swept = """sweep:
  - grid:
      sensors.pose[0].period: [0.5, 1.0]
      sensors.pose[0].delay: [0, 3]
      sensors.pose[0].std: [0.0, 0.1]
"""
    path.write_text(SE3 + SENSORS + swept, encoding="utf-8")
    found = study(read_config(path))
    lengths = [found.experiment(points[0]).loops["lee2010"].state_length for points in found.shapes]
    assert [len(points) for points in found.shapes] == [4, 4]
    assert lengths[1] - lengths[0] == 9  # three more positions are on their way


# What is said -------------------------------------------------------------------------------------


def test_the_signal_path_says_when_a_part_is_measured(tmp_path):
    path = tmp_path / "c.yaml"
    text = SENSORS.replace("period: 0.2, delay: 1", "of: rotation")
    path.write_text(SE3 + text, encoding="utf-8")
    resolved = build(read_config(path)).resolved
    pose = "pose (translation: noise, bias every 1 s, 3 periods late, 40 % lost)"
    assert loop_in_words(resolved) == (
        f"reference → law → hold 0.1 s → plant → {pose}, velocity (rotation: noise) → law",
        f"Loop: sampled every 0.1 s; measured {pose}; measured velocity (rotation: noise).",
    )


# Sensors whose states follow the motion, such as a gyroscope that lags ----------------------------


PERIOD, INERTIA, BIAS = 0.1, 2.0, 0.1

LOOP = f"""group: R1
inertia: {INERTIA}
gains: {{kp: 2, kd: 2}}
reference: {{kind: constant, velocity: [0.3]}}
controllers: [eqt]
initial: {{pose: {{kind: exp_normal, std: 0.6}}, velocity: {{kind: normal, std: 0.4}}}}
ensemble: {{runs: 2, seed: 4}}
time: {{duration: 2, samples: 21}}
control: {{period: {PERIOD}}}
"""


@pytest.mark.parametrize("engine", ["solve_ivp", "native"])
def test_a_law_reads_the_velocity_of_a_lagging_gyroscope(solved, engine):
    """While a command is held, V is linear in time, and the lag's answer has a closed form."""
    sensors = "{kind: lag, time_constant: {uniform: [0.2, 0.4]}}, {kind: bias, value: 0.1}"
    text = f"{LOOP}sensors: {{velocity: [{sensors}]}}\nsolver: {{engine: {engine}}}\n"
    problem, solution = solved(text)
    loop = problem.batched_loop(extra_axes=1)
    s = loop.tracking(problem.times, solution.states)
    T = loop.vehicle.moving_sensors[0].time_constant[:, 0]
    assert T[0] != T[1]
    x = [s.V[:, 0]]
    for k in range(20):
        V, slope = s.V[:, k], loop.command(s)[:, k] / INERTIA
        settled = V - slope * T
        x.append(settled + slope * PERIOD + (x[-1] - settled) * np.exp(-PERIOD / T))
    told = LawInput.of(s)._replace(velocity=np.stack(x, axis=1) + BIAS)
    law = loop.controller.torque(told.tracking(loop.group, loop.inertia, loop.gains, {}))
    # The solver's rtol is 1e-9.
    np.testing.assert_allclose(loop.command(s)[:, :-1], law[:, :-1], rtol=0, atol=1e-8)


@pytest.mark.needs("proofs")
def test_margins_contain_the_lag_of_a_gyroscope():
    """The eigenvalues are those of a plain linear system (x, v, measured v, held u)."""
    lag = "sensors: {velocity: [{kind: lag, time_constant: 0.3}]}"
    experiment = load_experiment(yaml_source.load(LOOP + lag, "text").data)
    [loop] = experiment.base.loops.values()
    Q, V = loop.group.exp(np.array([[0.0], [1.0], [0.0]])), np.array([[0.0], [0.0], [1.0]])
    Qd, Vd = loop.group.exp(np.zeros((3, 1))), np.zeros((3, 1))
    torque = loop.controller.torque(loop.tracking(0.0, loop.initial_state(Q, V, Qd, Vd)))[:, 0]
    A = np.zeros((4, 4))
    A[0, 1], A[1, 3], A[2, 1], A[2, 2] = 1, 1 / INERTIA, 1 / 0.3, -1 / 0.3
    answer = np.diag([1.0, 1.0, 1.0, 0.0])
    answer[3, :3] = torque[1] - torque[0], 0, torque[2] - torque[0]
    expected = np.abs(np.linalg.eigvals(expm(A * PERIOD) @ answer)).max()
    [found] = eqt_cli.margins(experiment).laws
    np.testing.assert_allclose(found.size, expected, rtol=1e-7)  # of differences
    assert not eqt_cli.margins(experiment).left_out
