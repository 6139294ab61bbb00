"""The PID cascade of the Crazyflie: against a plain program in its units, and what is refused."""

import numpy as np
import pytest
import yaml
from case_tables import from_yaml
from plain_quadrotor import flown, parts_of, rows_of
from said import mentions
from scipy.spatial.transform import Rotation

from eqt_cli.extend import EqtError
from eqt_cli.loop.law_program import law_program
from eqt_cli.loop.linearised import linearised

PERIOD, SLOW, STEPS = 0.002, 5, 150
MASS, J = 0.029, np.array([16.57e-6, 16.66e-6, 29.26e-6])
# Of platform_defaults_cf2.h: N by count of the four motors together, and torques by count.
COUNT = 0.1125 / 65535
THRUST, TURN, YAW = 4 * COUNT, 2 * COUNT * 0.046 / 2**0.5, 4 * COUNT * 0.005964552
BASE, MIN, LAG = 36000, 20000, 0.05
DEG = float(np.degrees(1.0))
LIFT = 1000 * THRUST / MASS

CONFIG = {
    "group": "SE3",
    "inertia": [*J.tolist(), MASS, MASS, MASS],
    "model": {"forces": [{"kind": "restoring", "weight": MASS * 9.81}]},
    "reference": {
        "kind": "flat",
        "position": ["0.6*sin(2*t)", "0.5*cos(2*t)", "0.4*sin(3*t)"],
        "heading": "3 + t",
        "along": [0, 0, 1],
    },
    "controllers": [
        {
            "kind": "pid_cascade",
            "position": {"kp": 2, "ki": [0, 0, 0.5], "i_limit": 5000, "limit": 1.1},
            "velocity": {
                "kp": [25 / DEG, 25 / DEG, 25 * LIFT],
                "ki": [1 / DEG, 1 / DEG, 15 * LIFT],
                "limit": [20 / DEG, 20 / DEG, 32.767 * LIFT],
            },
            "attitude": {
                "kp": 6,
                "ki": [3, 3, 1],
                "kd": [0, 0, 0.35],
                "i_limit": [20 / DEG, 20 / DEG, 360 / DEG],
            },
            "rate": {
                "kp": [250 * TURN * DEG, 250 * TURN * DEG, 120 * YAW * DEG],
                "ki": [500 * TURN * DEG, 500 * TURN * DEG, 16.7 * YAW * DEG],
                "kd": [2.5 * TURN * DEG, 2.5 * TURN * DEG, 0],
                "i_limit": [33.3 / DEG, 33.3 / DEG, 166.7 / DEG],
                "limit": [32767 * TURN, 32767 * TURN, 32767 * YAW],
            },
            "period": SLOW * PERIOD,
            "hover": BASE * THRUST,
            "least": MIN * THRUST,
            "most": 65535 * THRUST,
        }
    ],
    "actuators": [{"kind": "lag", "time_constant": LAG}],
    "control": {"period": PERIOD},
    "initial": {"pose": {"kind": "exp_normal", "std": 0.3}},
    "ensemble": {"runs": 1, "seed": 2},
    "time": {"duration": PERIOD * STEPS, "samples": STEPS + 1},
    "solver": {"rtol": 1e-12, "atol": 1e-14},
}


def cap(angle):
    while angle > 180:
        angle -= 360
    while angle < -180:
        angle += 360
    return angle


class Pid:
    """One loop of pid.c, with the difference of the measurement and a limit of the output."""

    def __init__(self, kp, ki, kd, dt, i_limit=5000.0, limit=0.0, start=0.0):
        self.gains, self.dt, self.i_limit, self.limit = (kp, ki, kd), dt, i_limit, limit
        self.integral, self.last = 0.0, start

    def __call__(self, desired, measured, is_yaw=False):
        error, change = desired - measured, measured - self.last
        if is_yaw:
            error, change = cap(error), cap(change)
        self.integral = np.clip(self.integral + error * self.dt, -self.i_limit, self.i_limit)
        kp, ki, kd = self.gains
        out = kp * error - kd * change / self.dt + ki * self.integral
        self.last = measured
        return np.clip(out, -self.limit, self.limit) if self.limit else out


class Crazyflie:
    """controllerPid, with the outer loops at every fifth call; pitch as a turn about y."""

    def __init__(self, angles, rates):
        slow = SLOW * PERIOD
        self.x, self.y = (Pid(2, 0, 0, slow, limit=1.1) for _ in range(2))
        self.z = Pid(2, 0.5, 0, slow, limit=1.1)
        self.vx, self.vy = (Pid(25, 1, 0, slow, limit=22) for _ in range(2))
        self.vz = Pid(25, 15, 0, slow, limit=65535 // 2 / 1000)
        gains = [(6, 3, 0, PERIOD, 20), (6, 3, 0, PERIOD, 20), (6, 1, 0.35, PERIOD, 360)]
        self.angles = [Pid(*k, start=a) for k, a in zip(gains, angles, strict=True)]
        gains = [(250, 500, 2.5, PERIOD, 33.3)] * 2 + [(120, 16.7, 0, PERIOD, 166.7)]
        self.rates = [Pid(*k, limit=32767, start=w) for k, w in zip(gains, rates, strict=True)]
        self.calls, self.thrust, self.roll, self.pitch = 0, 0.0, 0.0, 0.0

    def __call__(self, t, p, v, R, w):
        yaw, pitch, roll = Rotation.from_matrix(R).as_euler("ZYX", degrees=True)
        desired = np.array([0.6 * np.sin(2 * t), 0.5 * np.cos(2 * t), 0.4 * np.sin(3 * t)])
        if self.calls % SLOW == 0:
            c, s = np.cos(np.radians(yaw)), np.sin(np.radians(yaw))
            turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
            (x, y, z), (px, py, pz), (vx, vy, vz) = turn @ desired, turn @ p, turn @ v
            wx, wy, wz = self.x(x, px), self.y(y, py), self.z(z, pz)
            self.pitch = np.clip(self.vx(wx, vx), -20, 20)
            self.roll = np.clip(-self.vy(wy, vy), -20, 20)
            self.thrust = np.clip(self.vz(wz, vz) * 1000 + BASE, MIN, 65535)
        self.calls += 1
        wanted = self.roll, self.pitch, cap(np.degrees(3 + t))
        of_angles = zip(self.angles, wanted, (roll, pitch, yaw), (False, False, True), strict=True)
        rates = [pid(a, b, is_yaw) for pid, a, b, is_yaw in of_angles]
        of_rates = zip(self.rates, rates, np.degrees(w), strict=True)
        counts = np.array([pid(a, b) for pid, a, b in of_rates])
        return np.array([*(counts * [TURN, TURN, YAW]), self.thrust * THRUST])


@pytest.mark.ci("a plain program integrates 150 periods")
@pytest.mark.parametrize("engine", ["native", "solve_ivp"])
def test_the_cascade_of_the_crazyflie_flies_as_a_plain_program_does(solved, engine):
    config = {**CONFIG, "solver": {**CONFIG["solver"], "engine": engine}}
    problem, solution = solved(yaml.safe_dump(config), "pid_cascade")
    rows = rows_of(problem, solution.states[0])
    p, v, R, w = parts_of(rows[0])
    yaw, pitch, roll = Rotation.from_matrix(R).as_euler("ZYX", degrees=True)
    law = Crazyflie([roll, pitch, yaw], np.degrees(w))
    body = {"J": J, "mass": MASS, "axis": [0, 0, 1]}
    motors = {"inner": lambda command, w, x: (x, (command - x) / LAG), "x": np.zeros(4)}
    states = flown(law, p, v, R, w, period=PERIOD, steps=STEPS, **body, **motors)
    scale = np.abs(states).max(axis=0)
    assert scale[15:].max() > 1
    np.testing.assert_allclose(rows, states, rtol=0, atol=1e-10)


def test_the_loop_is_linearised_and_exported_with_all_its_loops(experiment_of):
    at_rest = {"kind": "setpoints", "points": [{"t": 0, "position": [0, 0, 1]}]}
    law = {key: x for key, x in CONFIG["controllers"][0].items() if key != "hover"}
    config = {**CONFIG, "reference": at_rest, "controllers": [law]}
    loop = experiment_of(yaml.safe_dump(config)).loops["pid_cascade"]
    closed = linearised(loop, np.zeros(1), np.eye(4)[None], np.zeros((1, 6)))
    assert np.abs(np.linalg.eigvals(closed.closed[0])).max() < 1
    names = {entry.name for entry in law_program(loop).numbers}
    assert {"rate_kp", "hover", "least", "most"} <= names


@from_yaml
def test_what_no_pid_cascade_is_is_refused(experiment_of, changes, message):
    changes = yaml.safe_load(changes)
    law = {**CONFIG["controllers"][0], **changes.pop("law", {})}
    law = {key: x for key, x in law.items() if x is not None}
    config = {**CONFIG, "controllers": [law], **changes}
    with pytest.raises(EqtError) as caught:
        experiment_of(yaml.safe_dump({key: x for key, x in config.items() if x is not None}))
    assert mentions(str(caught.value), message)
