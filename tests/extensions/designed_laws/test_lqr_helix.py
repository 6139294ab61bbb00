"""LQR of a quadrotor on the helix of Lee, Leok and McClamroch (2010), against plain NumPy.

The reference, the linearised plant and the Riccati equations are written here once more, from the
equations of a rigid body that rotors push along one axis. Only the configuration is shared.
"""

import functools

import numpy as np
from plain import hat
from scipy.integrate import solve_ivp
from scipy.linalg import expm, solve_continuous_are, solve_discrete_are

import eqt_cli

J, MASS, G = np.array([0.0820, 0.0845, 0.1377]), 4.34, 9.81
LIFT = np.array([0.0, 0.0, -1.0])  # the rotors push up, and z points down
REPEATS = 2.0
"""Period of the body velocity along the helix, s."""
WEIGHTS = {"pose": [4, 4, 4, 2, 2, 2], "velocity": 0.5, "torque": [2, 2, 2, 0.1, 0.1, 0.1]}
ROTORS = [[0, 1, 0, -1], [-1, 0, 1, 0], [1, -1, 1, -1], [0] * 4, [0] * 4, [-1] * 4]


def config(**changes):
    return {
        "group": "SE3",
        "inertia": [*J.tolist(), MASS, MASS, MASS],
        "model": {"forces": [{"kind": "restoring", "weight": MASS * G, "up": LIFT.tolist()}]},
        "reference": {
            "kind": "flat",
            "position": ["0.4*t", "0.4*sin(pi*t)", "0.6*cos(pi*t)"],
            "heading": "pi*t",
        },
        "controllers": [{"kind": "lqr", "weights": WEIGHTS}],
        "actuators": [{"kind": "thrusters", "matrix": ROTORS}],
        "initial": {"pose": {"kind": "exp_normal", "std": 1e-2}},
        "ensemble": {"runs": 2, "seed": 1},
        "time": {"duration": REPEATS, "samples": 21},
        **changes,
    }


def table_of(pieces, **changes):
    law = {"kind": "lqr", "weights": WEIGHTS, "pieces": pieces}
    loaded = eqt_cli.load_experiment(config(controllers=[law], **changes))
    return loaded.experiment(0).loops["lqr"].controller.table


def ad(V):
    w, v = hat(V[:3]), hat(V[3:])
    return np.block([[w, np.zeros((3, 3))], [v, w]])


@functools.cache
def series():
    """Fourier coefficients of V_d, V̇_d and Rᵀe₃ over a period, differentiated as a series."""
    t = REPEATS * np.arange(128) / 128
    a = np.pi**2 * np.stack([0 * t, -0.4 * np.sin(np.pi * t), -0.6 * np.cos(np.pi * t)], 1)
    v = np.pi * np.stack(
        [0 * t + 0.4 / np.pi, 0.4 * np.cos(np.pi * t), -0.6 * np.sin(np.pi * t)], 1
    )
    force = MASS * (a - [0, 0, G])
    b3 = -force / np.linalg.norm(force, axis=1)[:, None]
    b2 = np.cross(b3, np.stack([np.cos(np.pi * t), np.sin(np.pi * t), 0 * t], 1))
    b2 /= np.linalg.norm(b2, axis=1)[:, None]
    R = np.stack([np.cross(b2, b3), b2, b3], -1)
    rate = 2j * np.pi * np.fft.fftfreq(128, REPEATS / 128)

    def slope(x):
        return np.fft.ifft(
            rate.reshape(-1, *[1] * (x.ndim - 1)) * np.fft.fft(x, axis=0), axis=0
        ).real

    turn = np.swapaxes(R, 1, 2) @ slope(R)
    V = np.concatenate(
        [np.stack([turn[:, 2, 1], turn[:, 0, 2], turn[:, 1, 0]], 1), (v[:, None] @ R)[:, 0]], 1
    )
    return rate, np.fft.fft(np.concatenate([V, slope(V), R[:, 2]], 1), axis=0) / 128


def plant(t):
    """A and B of ε̇ = e, and of 𝕀V̇ = ad*_V 𝕀V + weight + u with V = V_d + ad_{V_d}ε + e."""
    rate, coefficients = series()
    found = (np.exp(rate * t) @ coefficients).real
    V, V_dot, down = found[:6], found[6:12], found[12:]
    inertia = np.diag([*J, MASS, MASS, MASS])
    P = inertia @ V
    free = np.block([[hat(P[:3]), hat(P[3:])], [hat(P[3:]), np.zeros((3, 3))]]) + ad(V).T @ inertia
    slope = np.linalg.solve(inertia, free)
    falls = np.zeros((6, 6))
    falls[3:, :3] = G * hat(down)
    lower = [slope @ ad(V) - ad(V_dot) + falls, slope - ad(V)]
    A = np.block([[np.zeros((6, 6)), np.eye(6)], lower])
    B = np.zeros((12, 6))
    B[6:] = np.linalg.solve(inertia, np.diag([1.0, 1, 1, 0, 0, 1]))
    return A, B


Q = np.diag([4.0] * 3 + [2.0] * 3 + [0.5] * 6)
R = np.diag([2.0] * 3 + [0.1] * 3)


def values():
    """S as a function, integrated backwards from its stationary value at the end."""

    def riccati(before, flat):
        S, (A, B) = flat.reshape(12, 12), plant(REPEATS - before)
        return (A.T @ S + S @ A - S @ B @ np.linalg.solve(R, B.T @ S) + Q).ravel()

    end = solve_continuous_are(*plant(REPEATS), Q, R).ravel()
    bounds = {"rtol": 1e-9, "atol": 1e-9}
    found = solve_ivp(riccati, (0, REPEATS), end, "DOP853", dense_output=True, **bounds)
    return lambda t: found.sol(REPEATS - t).reshape(12, 12)


def test_gains_tend_to_those_of_the_riccati_equation():
    """At the knots of n pieces; without their h², those of n and 2n are right to h⁴."""
    times = np.linspace(0.0, REPEATS, 101)
    few, many = (table_of(pieces).at(times).gain_at(times) for pieces in (100, 200))
    S = values()
    expected = np.array([np.linalg.solve(R, plant(t)[1].T @ S(t)) for t in times])
    size = np.abs(expected).max()
    assert np.abs(few - expected).max() < 1e-2 * size
    assert np.abs(many - expected).max() < 2.5e-3 * size  # a quarter
    assert np.abs((4 * many - few) / 3 - expected).max() < 1e-5 * size


def test_gains_of_a_sampled_loop_are_those_of_the_difference_equation():
    """States ε, e, the command that acts and the one on its way; A of each period at its middle."""
    period = 0.04
    count = round(REPEATS / period)
    table, times = (
        table_of(count, control={"period": period, "delay": 1}),
        period * np.arange(count),
    )
    found = table.at(times).gain_at(times)
    B, steps = np.zeros((18, 6)), []
    B[12:] = np.eye(6)
    for k in range(count):
        rows = np.block([*plant((k + 0.5) * period)])
        both = expm(period * np.vstack([rows, np.zeros((6, 18))]))
        steps.append(np.vstack([both[:12], np.zeros((6, 18))]))
    cost, expected = np.zeros((18, 18)), []
    cost[:12, :12] = period * Q
    S = solve_discrete_are(steps[-1], B, cost, period * R)
    for A in reversed(steps):
        K = np.linalg.solve(period * R + B.T @ S @ B, B.T @ S @ A)
        S = cost + A.T @ S @ (A - B @ K)
        expected.insert(0, K)
    size = np.abs(expected).max()
    own = np.concatenate([found[:, :, :12], found[:, :, 18:24]], axis=-1)
    assert np.abs(own - expected).max() < 1e-9 * size  # differences of the loop; measured 9e-11
    assert np.abs(np.delete(found, [*range(12), *range(18, 24)], axis=-1)).max() < 1e-9 * size
