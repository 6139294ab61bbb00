"""Sensors with a rate, a delay and dropouts of their own, against a plain program."""

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from eqt_cli.config.signal_path import loop_in_words, signal_path
from eqt_cli.config.source import read_config
from eqt_cli.core.errors import ConfigError
from eqt_cli.ensemble.spread import Stream, generator_at
from eqt_cli.experiment.build import build
from eqt_cli.experiment.read_study import study

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

ENGINES = [
    "solve_ivp",
    pytest.param("native", marks=pytest.mark.slow("compiles what the other engine shows, too")),
]


def with_engine(text, engine):
    return f"{text}solver: {{engine: {engine}}}\n"


# A rigid body with R, x and the body velocities w, v, and what its sensors tell ------------------


def hat(w):
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


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
    assert signal_path(resolved) == (
        f"reference → law → hold 0.1 s → plant → {pose}, velocity (rotation: noise) → law"
    )
    assert loop_in_words(resolved) == (
        f"Loop: sampled every 0.1 s; measured {pose}; measured velocity (rotation: noise)."
    )


@pytest.mark.parametrize(
    ("control", "sensors", "messages"),
    [
        (
            "{period: 0.1}",
            "{pose: [{kind: noise, std: 1, of: position}]}",
            ["sensors.pose[0].of: SE3 has no part 'position'; choose one of rotation, translation"],
        ),
        (
            "{period: 0.1}",
            "{pose: [{kind: noise, std: [1, 1], of: translation}]}",
            ["sensors.pose[0].std: expected 3 entries for the translation of SE3, got 2"],
        ),
        (
            "{period: 0.1}",
            "{pose: [{kind: noise, std: 1, dropout: 1.0}]}",
            [
                "sensors.pose[0].dropout: expected a probability of at least 0 and less than 1, "
                "got 1"
            ],
        ),
        (
            "{period: 0.1}",
            "{pose: [{kind: noise, std: 1, delay: 0.1}]}",
            ["sensors.pose[0].delay: expected a whole number, got 0.1"],
        ),
        (
            "{period: 0.1}",
            "{pose: [{kind: noise, std: -1}, {kind: noise, std: 1, period: 1, of: translation}, "
            "{kind: bias, period: 0.5}]}",
            [
                "sensors.pose[0].std: expected a standard deviation of at least 0, got -1",
                "sensors.pose[2].period: entries of one part share their period: sensors.pose[1] "
                "gives 1 for the translation, and this entry 0.5; give it at one of them",
            ],
        ),
        # A broken section is not a missing one.
        (
            "{period: 0.1, delay: 0.02}",
            "{pose: [{kind: noise, std: 1, period: 0.25}]}\n"
            "actuators: [{kind: limit, limit: -1}, {kind: rate_limit, rate: 1}]",
            [
                "control.delay: expected a whole number, got 0.02",
                "actuators[0].limit: expected a number greater than 0, got -1",
            ],
        ),
        # An entry keeps its number where one before it is wrong.
        (
            "",
            "{}\nactuators: [{kind: limit, limit: -1}, {kind: rate_limit, rate: 1}]",
            [
                "actuators[0].limit: expected a number greater than 0, got -1",
                "actuators[1]: rate_limit acts at control instants; set control.period",
            ],
        ),
    ],
)
def test_what_is_wrong_is_said_once_and_at_its_place(tmp_path, control, sensors, messages):
    path = tmp_path / "c.yaml"
    text = SE3.replace("control: {period: 0.1}\n", f"control: {control}\n" if control else "")
    path.write_text(f"{text}sensors: {sensors}\n", encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        build(read_config(path))
    assert [f"{each.path}: {each.message}" for each in caught.value.problems] == messages
