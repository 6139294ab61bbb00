"""Delays and lags along single axes: against a plain program."""

import numpy as np
import pytest
import yaml
from plain_quadrotor import GRAVITY, flown, of_heading, parts_of, rows_of
from said import mentions

from eqt_cli.extend import EqtError

J, MASS, PERIOD, STEPS, RATE_LOOP, LAG = np.array([0.02, 0.021, 0.04]), 1.2, 0.01, 40, 25.0, 0.05
UP = np.array([0.0, 0.0, 1.0])
CONFIG = {
    "group": "SE3",
    "inertia": [*J.tolist(), MASS, MASS, MASS],
    "model": {"forces": [{"kind": "restoring", "weight": MASS * GRAVITY}]},
    "reference": {"kind": "flat", "position": [0, 0, 1]},
    "controllers": [
        {
            "kind": "cascade",
            "attitude": {"kind": "rate", "kp": 8},
            "position": {"kx": 4, "kv": 3},
            "along": [0, 0, 1],
            "rates": "none",
        }
    ],
    "actuators": [
        {"kind": "delay", "ticks": [2, 2, 2, 0, 0, 1]},
        {"kind": "rate_loop", "bandwidth": RATE_LOOP},
        {"kind": "lag", "time_constant": [0, 0, 0, 0, 0, LAG]},
    ],
    "control": {"period": PERIOD},
    "initial": {"pose": {"kind": "exp_normal", "std": 0.3}},
    "ensemble": {"runs": 1, "seed": 3},
    "time": {"duration": PERIOD * STEPS, "samples": STEPS + 1},
    "solver": {"rtol": 1e-12, "atol": 1e-13},
}


def delayed():
    past = [np.zeros(4)] * 2

    def law(t, p, v, R, w):
        F = MASS * (GRAVITY * UP - 4 * (p - UP) - 3 * v)
        E = R.T @ of_heading(F, 0.0)
        e = np.array([E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]])
        past.append(np.array([*(8 * e / np.sqrt(1 + np.trace(E))), F @ R[:, 2]]))
        return np.array([*past[-3][:3], past[-2][3]])

    return law


def rate_loop(command, w, x):
    torque = J * RATE_LOOP * (command[:3] - w) + np.cross(w, J * w)
    return np.array([*torque, x[0]]), (command[3:] - x) / LAG


@pytest.mark.ci("a plain program integrates 40 periods")
@pytest.mark.parametrize("engine", ["native", "solve_ivp"])
def test_axes_lag_and_wait_on_their_own_as_in_a_plain_program(solved, engine):
    config = {**CONFIG, "solver": {**CONFIG["solver"], "engine": engine}}
    problem, solution = solved(yaml.safe_dump(config), "cascade")
    rows = rows_of(problem, solution.states[0])
    body = {"J": J, "mass": MASS, "axis": UP, "inner": rate_loop, "x": np.zeros(1)}
    states = flown(delayed(), *parts_of(rows[0]), period=PERIOD, steps=STEPS, **body)
    np.testing.assert_allclose(rows, states, rtol=0, atol=1e-10)


@pytest.mark.parametrize(
    ("part", "options", "message"),
    [
        (0, {"ticks": [1, 2]}, "actuators[0].ticks: expected a number, or 6 of them, got 2"),
        (0, {"ticks": -1}, "actuators[0].ticks: expected whole numbers from 0 to 1000, got -1"),
        (0, {"ticks": 0}, "actuators[0].ticks: expected a delay above 0 along an axis"),
        (2, {"time_constant": [0] * 6}, "actuators[2].time_constant[0]: …greater than 0, got 0"),
        (2, {"time_constant": [0] * 5 + [-1]}, "actuators[2].time_constant[5]: …greater than 0"),
    ],
)
def test_what_no_delay_or_lag_is_is_refused(experiment_of, part, options, message):
    parts = [{**one, **(options if k == part else {})} for k, one in enumerate(CONFIG["actuators"])]
    with pytest.raises(EqtError) as caught:
        experiment_of(yaml.safe_dump({**CONFIG, "actuators": parts}))
    assert mentions(str(caught.value), message)
