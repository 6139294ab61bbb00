"""INDI, the momentum observer and the accelerometer against plain programs."""

import numpy as np
import pytest
import yaml
from plain import hat
from scipy.linalg import block_diag, expm
from scipy.signal import butter

T, LAG, CUTOFF, RATE = 0.002, 0.05, 20.0, 88.9
SUBSTEPS = 8  # of 0.25 ms; halving them changes V by less than 1e-11
J, MASS, G = np.diag([0.04, 0.05, 0.08]), 1.3, 9.81
V_D = np.array([0.3, -0.5, 0.9, 0.2, 0.1, -0.3])
DELTA = np.array([0.1, -0.2, 0.15, 0.8, -0.5, 0.6])
ARM, BIAS, SENSOR_LAG = np.array([0.1, -0.05, 0.02]), np.array([0.1, 0.2, -0.3]), 0.01

ATTITUDE = {
    "group": "SO3",
    "inertia": np.diag(J).tolist(),
    "gains": {"k_R": 4.0, "k_Omega": 0.8},
    "reference": {"kind": "constant", "velocity": V_D[:3].tolist()},
    "controllers": [
        {"kind": "indi", "law": "lee2010", "cutoff": CUTOFF},
        {"kind": "observer", "law": "lee2010", "rate": RATE},
    ],
    "plant": {
        "inertia": {"relative": 0.5},
        "forces": [{"kind": "constant", "force": DELTA[:3].tolist()}],
    },
    "actuators": [{"kind": "lag", "time_constant": LAG}],
    "control": {"period": T},
    "initial": {
        "pose": {"kind": "exp_normal", "std": 0.0, "centre": [0.4, -0.3, 0.5]},
        "velocity": {"kind": "fixed", "coordinates": [0.5, 0.2, -0.4]},
    },
    "ensemble": {"runs": 1},
    "time": {"duration": 0.3, "samples": 4},
    "solver": {"engine": "native", "rtol": 1e-12, "atol": 1e-13},
}
BODY = {
    "group": "SE3",
    "inertia": [*np.diag(J).tolist(), MASS, MASS, MASS],
    "gains": {"kp": 2.0, "kd": [0.8, 0.8, 0.8, 3.0, 3.0, 3.0]},
    "reference": {"kind": "constant", "velocity": V_D.tolist()},
    "model": {"forces": [{"kind": "restoring", "weight": MASS * G}]},
    "plant": {
        "forces": [
            {"kind": "restoring", "weight": MASS * G},
            {"kind": "constant", "force": DELTA.tolist()},
        ],
        "inertia": [*(1.5 * np.diag(J)).tolist(), *[1.5 * MASS] * 3],
    },
    "initial": {
        "pose": {"kind": "exp_normal", "std": 0.0, "centre": [0.4, -0.3, 0.5, 0.2, 0.1, -0.2]},
        "velocity": {"kind": "fixed", "coordinates": [0.5, 0.2, -0.4, 0.3, 0.0, 0.1]},
    },
}
MOUNTED = [
    {"kind": "lever", "at": ARM.tolist()},
    {"kind": "lag", "time_constant": SENSOR_LAG},
    {"kind": "bias", "value": BIAS.tolist()},
]


def vee(A):
    return np.array([A[2, 1] - A[1, 2], A[0, 2] - A[2, 0], A[1, 0] - A[0, 1]]) / 2


class Filter:
    """A Butterworth filter of SciPy in direct form, settled on its first input."""

    def __init__(self):
        self.b, self.a = butter(2, CUTOFF, fs=1 / T)
        self.x = self.y = None

    def __call__(self, x):
        if self.x is None:
            self.x = self.y = [x, x]
        y = self.b @ [x, *self.x] - self.a[1:] @ self.y
        self.x, self.y = [x, self.x[0]], [y, self.y[0]]
        return y


def flown(s, law, linear="differences", mounted=False, limit=np.inf, turns_only=False):
    """Q and V after 0.3 s: RK4 between instants, the laws as they are published."""
    kp, kd = (2.0, [0.8] * 3) if turns_only else (2.0, [0.8] * 3 + [3.0] * 3)
    n = 3 if turns_only else 6
    inertia = block_diag(J, MASS * np.eye(3))
    true, H = 1.5 * inertia, Filter()
    R, p = s.Q[0, 0][:3, :3], (np.zeros(3) if turns_only else s.Q[0, 0][:3, 3])
    V = np.concatenate([s.V[0, 0], np.zeros(6 - n)])
    weight = 0.0 if turns_only else MASS * G
    delta, V_d = (np.concatenate([x[:n], np.zeros(6 - n)]) for x in (DELTA, V_D))

    def coadjoint(V, P):
        return np.concatenate(
            [np.cross(P[:3], V[:3]) + np.cross(P[3:], V[3:]), np.cross(P[3:], V[:3])]
        )

    def rates(y, command):
        R, V, x = y[:9].reshape(3, 3), y[12:18], y[18:24]
        force = x + delta + np.concatenate([np.zeros(3), -weight * R[2]])
        V_dot = np.linalg.solve(true, coadjoint(V, true @ V) + force)
        f = V_dot[3:] + np.cross(V[:3], V[3:]) + weight / (1.5 * MASS) * R[2]
        if mounted:
            f = f + np.cross(V_dot[:3], ARM) + np.cross(V[:3], np.cross(V[:3], ARM))
        moves = [(R @ hat(V[:3])).ravel(), R @ V[3:], V_dot, (command - x) / LAG]
        return np.concatenate([*moves, (f - y[24:]) / SENSOR_LAG]), f

    y = np.concatenate([R.ravel(), p, V, np.zeros(6), np.zeros(3)])
    y[24:] = rates(y, np.zeros(6))[1]
    u_hat, last, P_hat, found = np.zeros(6), V, inertia @ V, []
    for k in range(150):
        R, p, V = y[:9].reshape(3, 3), y[9:12], y[12:18]
        pose = np.zeros((4, 4))
        pose[:3, :3], pose[:3, 3] = hat(V_d[:3]), V_d[3:]
        pose = expm(k * T * pose)
        R_L, p_L = pose[:3, :3].T @ R, pose[:3, :3].T @ (p - pose[:3, 3])
        xi = np.concatenate([R_L.T @ V_d[:3], R_L.T @ (V_d[3:] + np.cross(V_d[:3], p_L))])
        rate = np.concatenate(
            [np.cross(V[:3], xi[:3]), np.cross(V[:3], xi[3:]) + np.cross(V[3:], xi[:3])]
        )
        force = kp * np.concatenate([2 * vee(R_L), R_L.T @ p_L])
        damping = np.array([*kd, *[0.0] * (6 - n)]) * (V - xi)
        nu = -inertia @ rate - damping - force  # 𝕀ν
        if law == "observer":
            delta_hat = RATE * (inertia @ V - P_hat)
            u = nu - coadjoint(V, inertia @ V) - delta_hat
        elif linear == "differences":
            u = nu + H(u_hat - inertia @ (V - last) / T)
        else:
            measured = y[24:] + BIAS if mounted else rates(y, np.zeros(6))[1]
            felt = np.concatenate([J @ (V - last)[:3] / T, MASS * measured])
            u = nu + H(u_hat - felt)
            u[3:] += MASS * np.cross(V[:3], V[3:]) + weight * R[2]
        known = np.concatenate([np.zeros(3), -weight * R[2]]) if law == "observer" else 0.0
        command = np.clip(u - known, -limit, limit)
        u_hat, last = u_hat + (1 - np.exp(-T / LAG)) * (command - u_hat), V
        if law == "observer":
            P_hat = P_hat + T * (coadjoint(V, inertia @ V) + u_hat + known + delta_hat)
        for _ in range(SUBSTEPS):
            h = T / SUBSTEPS
            a = rates(y, command)[0]
            b = rates(y + h / 2 * a, command)[0]
            c = rates(y + h / 2 * b, command)[0]
            d = rates(y + h * c, command)[0]
            y = y + h / 6 * (a + 2 * b + 2 * c + d)
        if (k + 1) % 50 == 0:
            found.append(y.copy())
    return np.array(found)


@pytest.mark.parametrize("engine", ["native", "solve_ivp"])
@pytest.mark.parametrize("law", ["indi", "observer"])
@pytest.mark.parametrize("limit", [None, 0.3])
def test_on_attitudes_a_run_is_that_of_a_plain_program(solved, engine, law, limit):
    """Within 1e-9: the engines' tolerance, over 150 periods."""
    text = ATTITUDE | {"solver": ATTITUDE["solver"] | {"engine": engine}}
    if limit:
        cut = {"kind": "limit", "limit": limit}
        text = text | {"actuators": [cut, *ATTITUDE["actuators"]]}
    problem, solution = solved(yaml.safe_dump(text), label=law)
    s = problem.loop.tracking(problem.times, solution.states)
    found = flown(s, law, limit=limit or np.inf, turns_only=True)
    np.testing.assert_allclose(s.Q[0, 1:].reshape(3, 9), found[:, :9], rtol=0, atol=1e-9)
    np.testing.assert_allclose(s.V[0, 1:], found[:, 12:15], rtol=0, atol=1e-9)


@pytest.mark.parametrize("engine", ["native", "solve_ivp"])
@pytest.mark.parametrize(
    ("law", "linear", "mounted"),
    [
        ("indi", "differences", False),
        ("indi", "accelerometer", False),
        ("indi", "accelerometer", True),
        ("observer", "differences", False),
    ],
)
def test_on_rigid_motions_a_run_is_that_of_a_plain_program(solved, engine, law, linear, mounted):
    """A heavier body with its weight and a wrench, its accelerometer mounted off the origin."""
    text = ATTITUDE | BODY | {"solver": ATTITUDE["solver"] | {"engine": engine}}
    text["controllers"] = [dict(entry) for entry in ATTITUDE["controllers"]]
    text["controllers"][0]["linear"] = linear
    if mounted:
        text["sensors"] = {"accelerometer": MOUNTED}
    problem, solution = solved(yaml.safe_dump(text), label=law)
    s = problem.loop.tracking(problem.times, solution.states)
    found = flown(s, law, linear, mounted)
    np.testing.assert_allclose(s.Q[0, 1:, :3, :3].reshape(3, 9), found[:, :9], rtol=0, atol=1e-9)
    np.testing.assert_allclose(s.Q[0, 1:, :3, 3], found[:, 9:12], rtol=0, atol=1e-9)
    np.testing.assert_allclose(s.V[0, 1:], found[:, 12:18], rtol=0, atol=1e-9)
