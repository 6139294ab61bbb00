"""The position and attitude controllers of PX4: against a plain program of their equations."""

import numpy as np
import pytest
import yaml
from case_tables import from_yaml
from plain_quadrotor import flown, parts_of, rows_of
from said import mentions
from scipy.spatial.transform import Rotation

from eqt_cli.extend import EqtError

# PX4 has FRD and NED; numbers beside its defaults are such that all limits are met.
J, MASS, PERIOD, STEPS, SLOW, G = np.array([0.0217, 0.0217, 0.04]), 2.0, 0.004, 150, 3, 9.81
HOVER, THR_MIN, THR_MAX, THR_MARGIN = 0.5, 0.12, 0.62, 0.3
TO_N = MASS * G / HOVER
POS_P, VEL_P, VEL_I = np.array([0.95, 0.95, 1.0]), np.array([1.8, 1.8, 4.0]), [0.4, 0.4, 2.0]
SPEED, UP, DOWN, TILT = 2.0, 0.6, 0.5, np.radians(35)
ATT_P, YAW_WEIGHT, MOST_RATES = np.array([6.5, 6.5, 2.8]), 0.4, np.radians([100, 100, 50])
RATE_LOOP = 25.0

CONFIG = {
    "group": "SE3",
    "inertia": [*J.tolist(), MASS, MASS, MASS],
    "model": {"forces": [{"kind": "restoring", "weight": MASS * G, "up": [0, 0, -1]}]},
    "reference": {
        "kind": "flat",
        "position": ["3*sin(t)", "2*cos(t) - 2", "-1 - sin(2*t)"],
        "heading": "0.8*t",
    },
    "controllers": [
        {
            "kind": "velocity_cascade",
            "attitude": {
                "kind": "rate",
                "kp": ATT_P.tolist(),
                "error": "reduced",
                "yaw_weight": YAW_WEIGHT,
                "limit": MOST_RATES.tolist(),
            },
            "position": {
                "kp": POS_P.tolist(),
                "kv": VEL_P.tolist(),
                "ki": VEL_I,
                "i_limit": 9.81,
                "horizontal_speed": SPEED,
                "up_speed": UP,
                "down_speed": DOWN,
                "tilt": "35 deg",
                "least": THR_MIN * TO_N,
                "most": THR_MAX * TO_N,
                "margin": THR_MARGIN * TO_N,
                "period": SLOW * PERIOD,
            },
            "along": [0, 0, -1],
        }
    ],
    "actuators": [{"kind": "rate_loop", "bandwidth": RATE_LOOP}],
    "control": {"period": PERIOD},
    "initial": {"pose": {"kind": "exp_normal", "std": 0.6}},
    "ensemble": {"runs": 1, "seed": 4},
    "time": {"duration": PERIOD * STEPS, "samples": STEPS + 1},
    "solver": {"rtol": 1e-12, "atol": 1e-13},
}


def setpoint(t):
    p = np.array([3 * np.sin(t), 2 * np.cos(t) - 2, -1 - np.sin(2 * t)])
    v = np.array([3 * np.cos(t), -2 * np.sin(t), -2 * np.cos(2 * t)])
    return p, v, np.array([-3 * np.sin(t), -2 * np.cos(t), 4 * np.sin(2 * t)]), 0.8 * t


def speed_within(first, second, most):
    """The sum of two velocities, of which the second is shortened first."""
    if np.linalg.norm(first + second) <= most:
        return first + second
    if np.linalg.norm(first) >= most:
        return first / np.linalg.norm(first) * most
    u = second / np.linalg.norm(second)
    return first + u * (-u @ first + np.sqrt((u @ first) ** 2 - first @ first + most**2))


class PX4:
    """PositionControl, thrustToAttitude and AttitudeControl, in normalised thrusts."""

    def __init__(self):
        self.integral, self.calls, self.thrust, self.met = np.zeros(3), 0, None, set()

    def position(self, t, p, v):
        dt, (pd, vd, ad, _) = SLOW * PERIOD, setpoint(t)
        by_position = (pd - p) * POS_P
        wanted = by_position + vd
        wanted[:2] = speed_within(by_position[:2], vd[:2], SPEED)
        self.met |= {"speed"} if np.linalg.norm((by_position + vd)[:2]) > SPEED else set()
        wanted[2] = np.clip(wanted[2], -UP, DOWN)
        error = wanted - v
        acc = ad + error * VEL_P + self.integral
        body_z = np.array([-acc[0], -acc[1], G])
        body_z /= np.linalg.norm(body_z)
        if (angle := np.arccos(body_z[2])) > TILT:
            self.met.add("tilt")
            aside = body_z - [0, 0, body_z[2]]
            body_z = np.sin(TILT) * aside / np.linalg.norm(aside) + [0, 0, np.cos(TILT)]
        assert angle < np.pi / 2
        collective = min((acc[2] * HOVER / G - HOVER) / body_z[2], -THR_MIN)
        thrust = body_z * collective
        if (thrust[2] >= -THR_MIN and error[2] >= 0) or (thrust[2] <= -THR_MAX and error[2] <= 0):
            error[2] = 0.0
            self.met.add("vertical")
        wide = np.linalg.norm(thrust[:2])
        thrust[2] = max(thrust[2], -np.sqrt(THR_MAX**2 - min(wide, THR_MARGIN) ** 2))
        left = np.sqrt(max(THR_MAX**2 - thrust[2] ** 2, 0.0))
        if wide > left:
            thrust[:2] *= left / wide
            self.met.add("horizontal")
        produced = thrust[:2] * G / HOVER
        if acc[:2] @ acc[:2] > produced @ produced:
            error[:2] -= 2 / VEL_P[0] * (acc[:2] - produced)
            self.met.add("tracking")
        self.integral = self.integral + error * VEL_I * dt
        self.integral[2] = np.clip(self.integral[2], -G, G)
        return thrust

    def __call__(self, t, p, v, R, w):
        if self.calls % SLOW == 0:
            self.thrust = self.position(t, p, v)
        self.calls += 1
        b3 = -self.thrust / np.linalg.norm(self.thrust)
        psi = setpoint(t)[3]
        b1 = np.cross([-np.sin(psi), np.cos(psi), 0.0], b3)
        b1 /= np.linalg.norm(b1)
        Rd = np.column_stack([b1, np.cross(b3, b1), b3])
        return np.array([*self.rates(R, Rd), np.linalg.norm(self.thrust) * TO_N])

    def rates(self, R, Rd):
        axis, cosine = np.cross(R[:, 2], Rd[:, 2]), R[:, 2] @ Rd[:, 2]
        size = np.linalg.norm(axis)
        tilt = Rotation.from_rotvec(axis / size * np.arctan2(size, cosine))  # in the world
        reduced = tilt * Rotation.from_matrix(R)
        yaw = (reduced.inv() * Rotation.from_matrix(Rd)).as_quat()
        yaw *= np.sign(yaw[3])
        turns = np.sin(YAW_WEIGHT * np.arcsin(yaw[2])), np.cos(YAW_WEIGHT * np.arccos(yaw[3]))
        wanted = reduced * Rotation.from_quat([0, 0, *turns])
        error = (Rotation.from_matrix(R).inv() * wanted).as_quat()
        rates = 2 * error[:3] * np.sign(error[3]) * ATT_P / [1, 1, YAW_WEIGHT]
        self.met |= {"rates"} if np.any(np.abs(rates) > MOST_RATES) else set()
        return np.clip(rates, -MOST_RATES, MOST_RATES)


def rate_loop(command, w, x):
    torque = J * RATE_LOOP * (command[:3] - w) + np.cross(w, J * w)
    return np.array([*torque, command[3]]), np.zeros(0)


@pytest.mark.ci("a plain program integrates 150 periods")
@pytest.mark.parametrize("engine", ["native", "solve_ivp"])
def test_the_controllers_of_px4_fly_as_a_plain_program_does(solved, engine):
    config = {**CONFIG, "solver": {**CONFIG["solver"], "engine": engine}}
    problem, solution = solved(yaml.safe_dump(config), "velocity_cascade")
    rows, px4 = rows_of(problem, solution.states[0]), PX4()
    body = {"J": J, "mass": MASS, "axis": [0, 0, -1], "inner": rate_loop}
    states = flown(px4, *parts_of(rows[0]), period=PERIOD, steps=STEPS, **body)
    assert px4.met >= {"speed", "tracking", "rates"}
    np.testing.assert_allclose(rows, states, rtol=0, atol=1e-10)


def test_the_command_is_that_of_px4_at_one_instant(experiment_of):
    loop = experiment_of(yaml.safe_dump(CONFIG)).loops["velocity_cascade"]
    random, met = np.random.default_rng(1), set()
    for _ in range(60):
        p, v = random.normal(size=(2, 3)) * [[1.5], [1.0]]
        R = Rotation.random(random_state=random).as_matrix()
        Q, w, t = np.eye(4), random.normal(size=3), random.uniform(0, 6)
        Q[:3, :3], Q[:3, 3] = R, p
        state = loop.initial_state(Q[None], np.array([[*w, *(R.T @ v)]]), Q[None], np.zeros(6), t)
        px4 = PX4()
        expected = px4(t, p, v, R, w)
        met |= px4.met
        inputs = loop.law_input(t, state)
        command, later = loop.answer(inputs, loop.memory(state), PERIOD)
        np.testing.assert_allclose(command[0, [0, 1, 2, 5]], expected * [1, 1, 1, -1], atol=1e-10)
        np.testing.assert_allclose(later["integral"][0], px4.integral, atol=1e-12)
    assert met >= {"speed", "tilt", "horizontal", "tracking", "rates", "vertical"}


@from_yaml
def test_what_no_velocity_cascade_is_is_refused(experiment_of, changes, message):
    changes = yaml.safe_load(changes)
    law = {**CONFIG["controllers"][0], **changes.pop("law", {})}
    law["position"] = {**law["position"], **changes.pop("position", {})}
    law["attitude"] = {**law["attitude"], **changes.pop("attitude", {})}
    with pytest.raises(EqtError) as caught:
        experiment_of(yaml.safe_dump({**CONFIG, "controllers": [law], **changes}))
    assert mentions(str(caught.value), message)
