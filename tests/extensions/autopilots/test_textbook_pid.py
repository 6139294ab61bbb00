"""A rate loop without a filter of the gyro: against a plain program."""

import numpy as np
import pytest
import yaml
from plain_quadrotor import flown

J, PERIOD, STEPS = np.array([0.02, 0.021, 0.04]), 0.01, 30
P, INTEGRAL, D, FF, MOST, CUTOFF = 0.4, np.array([0.9, 0.9, 0.2]), 0.004, 0.05, 0.02, 15.0
PART = {
    "kind": "rate_loop",
    "gains": P,
    "ki": INTEGRAL.tolist(),
    "kd": D,
    "feedforward": FF,
    "i_limit": MOST,
    "d_cutoff": CUTOFF,
}
CONFIG = {
    "group": "SO3",
    "inertia": J.tolist(),
    "reference": {"kind": "constant"},
    "controllers": [{"kind": "rate", "kp": 6}],
    "control": {"period": PERIOD},
    "initial": {"pose": "haar", "velocity": {"kind": "normal", "std": 1.0}},
    "ensemble": {"runs": 1, "seed": 5},
    "time": {"duration": PERIOD * STEPS, "samples": STEPS + 1},
    "solver": {"rtol": 1e-12, "atol": 1e-13},
}


def rates(t, p, v, R, w):
    E = R.T
    e = np.array([E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]])
    return np.array([*(6 * e / np.sqrt(1 + np.trace(E))), 0.0])


@pytest.mark.ci("a plain program integrates 30 periods")
@pytest.mark.parametrize("engine", ["native", "solve_ivp"])
@pytest.mark.parametrize("derivative", ["rate", "error"])
def test_a_pid_without_a_filter_of_the_gyro_is_that_of_a_plain_program(solved, derivative, engine):
    config = {**CONFIG, "solver": {**CONFIG["solver"], "engine": engine}}
    config["actuators"] = [{**PART, "derivative": derivative}]
    problem, solution = solved(yaml.safe_dump(config), "rate")
    s = problem.loop.tracking(problem.times, solution.states)

    def pid(command, w, x):
        seen, z = x[:3], x[3:]
        e = command[:3] - w
        alpha = 2 * np.pi * CUTOFF * (w - (derivative == "error") * command[:3] - seen)
        growth = np.maximum(1 - (e / np.radians(400)) ** 2, 0) * INTEGRAL * e
        growth = np.where((np.abs(z) >= MOST) & (growth * z > 0), 0.0, growth)
        torque = P * e + z - D * alpha + FF * command[:3]
        return np.array([*torque, 0.0]), np.concatenate([alpha, growth])

    R, w = s.Q[0, 0], s.V[0, 0]
    start = np.concatenate([w, np.zeros(3)])
    body = {"J": J, "mass": 1.0, "axis": [0, 0, 0], "inner": pid, "x": start}
    still = np.zeros(3), np.zeros(3)
    states = flown(rates, *still, R, w, period=PERIOD, steps=STEPS, **body)
    tolerance = {"rtol": 0, "atol": 1e-9}  # kinks at the limit of the integral
    np.testing.assert_allclose(s.Q[0].reshape(-1, 9), states[:, 6:15], **tolerance)
    np.testing.assert_allclose(s.V[0], states[:, 15:18], **tolerance)
