"""Laws that reject around a cascade that commands rates: against plain programs."""

import numpy as np
import pytest
import yaml
from case_tables import from_yaml
from plain_quadrotor import GRAVITY, flown, of_heading, parts_of, rows_of
from said import mentions

from eqt_cli.extend import EqtError

pytestmark = pytest.mark.needs("autopilots")

J, MASS, PERIOD, STEPS, RATE_LOOP = np.array([0.02, 0.021, 0.04]), 1.2, 0.01, 60, 25.0
KX, KV, KP, UP = 4.0, np.array([3.0, 3.0, 4.0]), 8.0, np.array([0.0, 0.0, 1.0])
FORCE, DRAG = np.array([1.1, -0.5, 0.7]), 0.3
START = [0, 0, 0, 0.4, -0.2, 0.3]
CASCADE = {
    "kind": "cascade",
    "attitude": {"kind": "rate", "kp": KP},
    "position": {"kx": KX, "kv": KV.tolist()},
    "along": [0, 0, 1],
    "rates": "none",
}
CONFIG = {
    "group": "SE3",
    "inertia": [*J.tolist(), MASS, MASS, MASS],
    "model": {"forces": [{"kind": "restoring", "weight": MASS * GRAVITY}]},
    "reference": {"kind": "flat", "position": ["sin(t)", "cos(2*t) - 1", "0.3*t"]},
    "actuators": [{"kind": "rate_loop", "bandwidth": RATE_LOOP}],
    "plant": {
        "forces": [
            {"kind": "restoring", "weight": MASS * GRAVITY},
            {"kind": "drag", "linear": [0, 0, 0, DRAG, DRAG, DRAG]},
            {"kind": "constant", "frame": "spatial", "force": [0, 0, 0, *FORCE.tolist()]},
        ]
    },
    "control": {"period": PERIOD},
    "initial": {"pose": {"kind": "exp_normal", "std": 0.2}},
    "ensemble": {"runs": 1, "seed": 1},
    "time": {"duration": PERIOD * STEPS, "samples": STEPS + 1},
    "solver": {"rtol": 1e-12, "atol": 1e-13},
}
LAWS = {
    "observer": {"kind": "observer", "rate": [8, 8, 8, 6, 6, 9]},
    "l1": {"kind": "l1", "cutoff": 5.5, "a": 5},
    "indi": {"kind": "indi", "cutoff": 2.0},
}


class Observer:
    def __init__(self, start):
        self.delta, self.P, self.rate = start, None, np.array([6.0, 6.0, 9.0])

    def __call__(self, v, acting):
        measured = MASS * v
        if self.P is None:
            P = measured - self.delta / self.rate
        else:
            P = self.P + PERIOD * (acting + self.delta)
        self.delta = self.rate * (measured - P)
        self.P = P - PERIOD * MASS * GRAVITY * UP
        return self.delta


class L1:
    def __init__(self, start):
        self.delta, self.P, self.a, self.c = start, None, 5.0, np.exp(-5.5 * PERIOD)

    def __call__(self, v, acting):
        measured, fall = MASS * v, np.exp(-self.a * PERIOD)
        if self.P is None:
            P = measured - (1 - fall) / (self.a * fall) * self.delta
        else:
            P = self.P + PERIOD * acting
        error = P - measured
        sigma = -self.a * fall / (1 - fall) * error
        self.P = P + PERIOD * (-MASS * GRAVITY * UP + sigma - self.a * error)
        self.delta = self.c * self.delta + (1 - self.c) * sigma
        return self.delta


class Indi:
    """A Butterworth filter of second order, as a difference equation of past values."""

    def __init__(self, start):
        self.start, self.past = start, []

    def __call__(self, v, acting):
        K = np.tan(np.pi * 2.0 * PERIOD)
        scale = 1 / (1 + np.sqrt(2) * K + K * K)
        b, a1 = K * K * scale, 2 * (K * K - 1) * scale
        a2 = (1 - np.sqrt(2) * K + K * K) * scale
        if not self.past:
            r = -self.start
            self.past = [(r, r), (r, r)]
        else:
            r = acting - MASS * GRAVITY * UP - MASS * (v - self.v) / PERIOD
        self.v = v
        (r1, y1), (r2, y2) = self.past
        y = b * (r + 2 * r1 + r2) - a1 * y1 - a2 * y2
        self.past = [(r, y), (r1, y1)]
        return -y


def by_hand(estimator, lateral=True):
    push = [0.0]

    def law(t, p, v, R, w):
        delta = estimator(v, R @ (push[0] * UP))
        pd = np.array([np.sin(t), np.cos(2 * t) - 1, 0.3 * t])
        vd = np.array([np.cos(t), -2 * np.sin(2 * t), 0.3])
        ad = np.array([-np.sin(t), -4 * np.cos(2 * t), 0.0])
        F = MASS * (ad + GRAVITY * UP - KX * (p - pd) - KV * (v - vd)) - lateral * delta
        E = R.T @ of_heading(F, 0.0)
        e = np.array([E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]])
        push[0] = F @ R[:, 2] - (not lateral) * delta @ R[:, 2]
        return np.array([*(KP * e / np.sqrt(1 + np.trace(E))), push[0]])

    return law


def rate_loop(command, w, x):
    torque = J * RATE_LOOP * (command[:3] - w) + np.cross(w, J * w)
    return np.array([*torque, command[3]]), np.zeros(0)


def pulls(t, p, v):
    return -MASS * GRAVITY * UP - DRAG * v + FORCE


@pytest.mark.ci("plain programs integrate 60 periods")
@pytest.mark.parametrize("engine", ["native", "solve_ivp"])
@pytest.mark.parametrize("options", [{}, {"estimate": START}, {"lateral": False}], ids=str)
@pytest.mark.parametrize("kind", [Observer, L1, Indi])
def test_the_estimated_force_tilts_as_in_a_plain_program(solved, kind, options, engine):
    name = kind.__name__.lower()
    config = {**CONFIG, "controllers": [{**LAWS[name], "law": CASCADE, **options}]}
    config["solver"] = {**config["solver"], "engine": engine}
    problem, solution = solved(yaml.safe_dump(config), name)
    rows = rows_of(problem, solution.states[0])
    estimator = kind(np.array(options.get("estimate", [0.0] * 6)[3:]))
    law = by_hand(estimator, options.get("lateral", True))
    body = {"J": J, "mass": MASS, "axis": UP, "inner": rate_loop, "pulls": pulls}
    states = flown(law, *parts_of(rows[0]), period=PERIOD, steps=STEPS, **body)
    np.testing.assert_allclose(rows, states, rtol=0, atol=1e-10)
    s = problem.loop.tracking(problem.times, solution.states)
    assert not np.any(s.memory["disturbance"][..., :3])  # no torque is estimated


@pytest.mark.ci("compiles two laws")
@pytest.mark.parametrize("offset", [0.0, np.linalg.norm(FORCE) / MASS / KX])
def test_a_steady_force_leaves_no_offset_around_rates(solved, offset):
    wind = {"kind": "constant", "frame": "spatial", "force": [0, 0, 0, *FORCE.tolist()]}
    law = CASCADE if offset else {"kind": "observer", "rate": 6, "law": CASCADE}
    config = {
        **CONFIG,
        "reference": {"kind": "flat", "position": [0, 0, 1]},
        "plant": {"forces": [CONFIG["plant"]["forces"][0], wind]},
        "controllers": [law],
        "time": {"duration": 8, "samples": 3},
        "solver": {"engine": "native"},
    }
    problem, solution = solved(yaml.safe_dump(config), law["kind"])
    end = rows_of(problem, solution.states[0])[-1, :3]
    np.testing.assert_allclose(np.linalg.norm(end - UP), offset, rtol=1e-4, atol=1e-5)


@from_yaml
def test_what_cannot_be_estimated_around_rates_is_refused(experiment_of, changes, message):
    law = {"kind": "observer", "rate": 8, "law": CASCADE, **yaml.safe_load(changes)}
    with pytest.raises(EqtError) as caught:
        experiment_of(yaml.safe_dump({**CONFIG, "controllers": [law]}))
    assert mentions(str(caught.value), message)
