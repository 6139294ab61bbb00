"""Laws with blocks of their own: against a plain program, and what may not stand there."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from case_tables import from_yaml
from said import mentions
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import eqt_cli
from eqt_cli.analysis.maps import map_tables
from eqt_cli.api.loading import open_at
from eqt_cli.extend import EqtError
from eqt_cli.results.quantity import Plain
from eqt_cli.runs.description import loop_in_words

EXAMPLE = Path(__file__).parents[3] / "examples" / "autopilot"
PERIOD, DURATION = 0.004, 0.2

# A plain program of examples/autopilot/autopilot.yaml, with `rates: none` of Lee's law --------

M, J, G, UP = 2.0, np.array([0.0217, 0.0217, 0.04]), 9.81, np.array([0.0, 0.0, 1.0])
DRAG, WIND = np.array([0.3, 0.3, 0.4]), np.array([1.5, 0.0, 0.0])
ARM, MOST, THRUST, LAG = 0.174, 1000.0, 8.55e-6, 0.02
RATIO = 1.37e-7 / THRUST
SIGNS = np.array([[1, 1, 1], [1, -1, -1], [-1, -1, 1], [-1, 1, -1]])  # of x, y and the turning
# Torques and push of unit thrusts: r × e₃ is (y, −x, 0).
MIX = np.array([[ARM * y, -ARM * x, RATIO * turns, 1.0] for x, y, turns in SIGNS]).T
P, I, D = np.array([0.15, 0.15, 0.2]), np.array([0.2, 0.2, 0.1]), np.array([0.003, 0.003, 0.0])


def desired(t):
    p = np.array([np.sin(t), np.cos(t) - 1, 0.3 * np.sin(2 * t)])
    v = np.array([np.cos(t), -np.sin(t), 0.6 * np.cos(2 * t)])
    return p, v, np.array([-np.sin(t), -np.cos(t), -1.2 * np.sin(2 * t)])


def force_and_attitude(t, p, v, kx, kv):
    """F/m of a position loop, and the attitude whose third axis it is, at heading 0."""
    pd, vd, ad = desired(t)
    u = kx * (p - pd) + kv * (v - vd)
    F = ad + G * UP - u / np.sqrt(1 + u @ u / 36.0)
    b3 = F / np.linalg.norm(F)
    b2 = np.cross(b3, [1.0, 0.0, 0.0])
    b2 /= np.linalg.norm(b2)
    return F, np.column_stack([np.cross(b2, b3), b2, b3])


def px4(t, p, v, R, w):
    F, Rc = force_and_attitude(t, p, v, 1.71, 1.8)
    E = R.T @ Rc
    axis = np.cross(UP, E[:, 2])
    size = np.linalg.norm(axis)
    tilt = Rotation.from_rotvec(axis / size * np.arctan2(size, E[2, 2]))
    quaternions = tilt, tilt.inv() * Rotation.from_matrix(E)
    q, about = (x.as_quat() * np.sign(x.as_quat()[3]) for x in quaternions)
    rates = np.array([6.5, 6.5, 2.8]) * 2 * np.array([q[0], q[1], about[2]])
    return np.array([*rates, M * F @ R[:, 2]])


def lee(t, p, v, R, w):
    F, Rc = force_and_attitude(t, p, v, 2.5, 2.8)
    E = Rc.T @ R - R.T @ Rc
    e = np.array([E[2, 1], E[0, 2], E[1, 0]]) / 2
    torque = -2.6 * e - np.array([0.42, 0.42, 0.4]) * w + np.cross(w, J * w)
    return np.array([*torque, M * F @ R[:, 2]])


def network(t, p, v, R, w):
    onnx = pytest.importorskip("onnx")
    stored = onnx.load(EXAMPLE / "policy.onnx").graph.initializer
    W1, c1, W2, c2 = (onnx.numpy_helper.to_array(x).astype(float) for x in stored)
    pd, vd, _ = desired(t)
    inputs = [np.clip(p - pd, -1.5, 1.5), np.clip(v - vd, -2, 2), R.ravel(), w]
    y = np.clip(W2 @ np.tanh(W1 @ np.concatenate(inputs) + c1) + c2, -1, 1)
    return np.array([2 * y[1], 2 * y[2], 0.5 * y[3], 19.62 + 20 * y[0]])


def after_rate_loop(command, w, x):
    """PX4's PID and filters, and `scale`: a wrench, and the rates of ω̂, ω̂', α and z."""
    hat, slope, alpha, z = x.reshape(4, 3)
    e = command[:3] - hat
    torque = P * e + z - D * alpha
    f, fd = 2 * np.pi * 40, 2 * np.pi * 20
    growth = np.maximum(1 - (e / np.radians(400)) ** 2, 0) * I * e
    rates = [slope, f * f * (w - hat) - np.sqrt(2) * f * slope, fd * (slope - alpha), growth]
    return np.array([6, 6, 1, 1]) * [*torque, command[3]], np.concatenate(rates)


def wanted_speeds(wrench):
    thrusts = np.clip(np.linalg.solve(MIX, wrench), 0.0, THRUST * MOST**2)
    return np.sqrt(thrusts / THRUST)


def flown(law, p, v, R, w):
    """Position and attitude at each period, from a start."""
    own = law is px4
    x0 = np.concatenate([w, np.zeros(9)]) if own else np.zeros(0)
    last = command = law(0.0, p, v, R, w)
    speeds = wanted_speeds(after_rate_loop(command, w, x0)[0] if own else command)
    state = np.concatenate([p, v, R.ravel(), w, speeds, x0])

    def field(t, y):
        v, R, w, speeds = y[3:6], y[6:15].reshape(3, 3), y[15:18], y[18:22]
        wrench, rates = after_rate_loop(last, w, y[22:]) if own else (last, np.zeros(0))
        torque, push = np.split(MIX @ (THRUST * speeds**2), [3])
        relative = R.T @ (v - WIND)
        acceleration = R @ (push * UP - DRAG * relative) / M - G * UP
        turning = (torque - np.cross(w, J * w)) / J
        hat = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
        spin = (wanted_speeds(wrench) - speeds) / LAG
        return np.concatenate([v, acceleration, (R @ hat).ravel(), turning, spin, rates])

    states = [state]
    for k in range(round(DURATION / PERIOD)):
        p, v, R, w = state[:3], state[3:6], state[6:15].reshape(3, 3), state[15:18]
        last, command = command, law(k * PERIOD, p, v, R, w)  # one period late
        times = k * PERIOD, (k + 1) * PERIOD
        state = solve_ivp(field, times, state, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
        states.append(state)
    return np.array(states)


@pytest.mark.ci("a plain program integrates 50 periods")
@pytest.mark.parametrize("engine", ["native", "solve_ivp"])
@pytest.mark.parametrize("law", [px4, lee, network])
def test_laws_with_and_without_own_blocks_fly_as_a_plain_program_does(
    solved, tmp_path, law, engine
):
    config = yaml.safe_load((EXAMPLE / "autopilot.yaml").read_text())
    (tmp_path / "policy.onnx").write_bytes((EXAMPLE / "policy.onnx").read_bytes())
    config["controllers"][1]["rates"] = "none"
    config["ensemble"]["runs"] = 1
    config["time"] = {"duration": DURATION, "samples": 51}
    config["solver"] = {"engine": engine, "rtol": 1e-12, "atol": 1e-13}
    labels = {px4: "PX4", lee: "Lee 2010", network: "network"}
    problem, solution = solved(yaml.safe_dump(config), labels[law])
    s = problem.loop.tracking(problem.times, solution.states)
    Q, V = s.Q[0], s.V[0]
    R = Q[0, :3, :3]
    states = flown(law, Q[0, :3, 3], R @ V[0, 3:], R, V[0, :3])
    assert np.abs(states[-1, :3] - states[0, :3]).max() > 0.05
    np.testing.assert_allclose(Q[:, :3, 3], states[:, :3], rtol=0, atol=1e-9)
    np.testing.assert_allclose(Q[:, :3, :3].reshape(-1, 9), states[:, 6:15], rtol=0, atol=1e-9)
    np.testing.assert_allclose(V[:, :3], states[:, 15:18], rtol=0, atol=2e-8)


# What may stand there -----------------------------------------------------------------------------


@from_yaml
def test_what_cannot_stand_within_a_law_is_refused(experiment_of, changes, said):
    changes = yaml.safe_load(changes)
    rate_loop = [{"kind": "rate_loop", "bandwidth": 30}]
    config = {
        "group": "SO3",
        "inertia": [0.02, 0.02, 0.04],
        "reference": {"kind": "constant"},
        "controllers": [
            {"kind": "rate", "kp": 6, "inner": changes.pop("inner", rate_loop)},
            {"kind": "lee2010", "gains": {"kp": 1, "kd": 0.1}},
        ],
        "actuators": [{"kind": "limit", "limit": 2}],
        "initial": {"pose": "haar"},
        "ensemble": {"runs": 2},
        "time": {"duration": 1},
    }
    with pytest.raises(EqtError) as caught:
        experiment_of(yaml.safe_dump(config | changes))
    assert mentions(str(caught.value), said)


@pytest.mark.ci("sweeps two laws")
def test_a_comparison_over_points_says_which_blocks_laws_do_not_share(tmp_path):
    blocks = [{"kind": "rate_loop", "bandwidth": 10}]
    config = {
        "group": "SO3",
        "inertia": [1, 1.2, 1.5],
        "reference": {"kind": "constant"},
        "gains": {"kp": 1.0, "kd": 1.0},
        "controllers": [{"kind": "rate", "kp": 2, "inner": blocks}, "eqt"],
        "ensemble": {"runs": 2, "seed": 1},
        "initial": {"pose": "haar"},
        "time": {"duration": 0.2, "samples": 5},
    }
    swept = eqt_cli.sweep(config, {"gains.kd": [1, 2]}, out=tmp_path / "swept")
    (wins,) = eqt_cli.compare_sweep(swept, metrics=["mean_pose_error"])
    with open_at(tmp_path / "swept") as result:
        note = map_tables(wins, result, Plain())[0].notes[0]
    assert "rate (rate_loop), EqT (none)" in note


def test_the_signal_path_has_inner_blocks_by_law():
    pid = [{"kind": "rate_loop", "bandwidth": 30}, {"kind": "scale", "factor": 6}]
    laws = [{"label": "PX4", "inner": pid}, {"label": "Lee", "inner": pid[1:]}, {"label": "gt"}]
    path, _ = loop_in_words({"controllers": laws})
    blocks = "inner blocks by law (PX4: rate_loop, scale; Lee: scale)"
    assert path == f"reference → law → {blocks} → plant → law"
