"""The Crazyflie of `configs/crazyflie.yaml` without noise, gusts and draws, as a user writes it.

A position loop at 100 Hz, Lee's attitude law at 500 Hz with a delay of one period, rotors with a
lag, drag in a wind; steps by Runge and Kutta's method of order 4. z is up.
"""

from __future__ import annotations

import numpy as np

from eqt_cli.base.arrays import Array

J, MASS, WEIGHT = np.array([1.43e-5, 1.43e-5, 2.89e-5]), 0.03, 0.2943
KX, KV, LIMIT = 4.0, 3.0, 6.0
KR, KW = 2.0e-3, np.array([3.4e-4, 3.4e-4, 4.6e-4])
ARM, K_THRUST, K_MOMENT = 0.0304, 2.3e-8, 7.8e-10
FASTEST, LAG = 2500.0, 0.072
DRAG = np.array([7.33e-3, 7.33e-3, 5.40e-3])
PERIOD, OUTER = 2e-3, 5
"""s, and in how many of them the position loop is evaluated once."""

UP = np.array([0.0, 0.0, 1.0])
X, Y, TURNS = ARM * np.array([[1, 1, -1, -1], [1, -1, -1, 1], [1, -1, 1, -1]])
MIX = np.array([Y, -X, TURNS / ARM * K_MOMENT / K_THRUST, np.ones(4)])
"""Torque and push of the thrusts."""

UNMIX = np.linalg.inv(MIX)


def cross(a: Array, b: Array) -> Array:
    """The cross product of two vectors, without what `numpy.cross` does for arrays of any shape."""
    x, y, z = a
    u, v, w = b
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])


def hat(w: Array) -> Array:
    """The matrix of the cross product with a vector."""
    x, y, z = w
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def desired(t: float) -> tuple[list[Array], list[Array]]:
    """The position with four derivatives, and the direction of the heading with two."""
    s, c, s2, c2 = np.sin(t), np.cos(t), np.sin(2 * t), np.cos(2 * t)
    position = [
        np.array([0.8 * s, 0.4 * s2, 1 + 0.1 * c]),
        np.array([0.8 * c, 0.8 * c2, -0.1 * s]),
        np.array([-0.8 * s, -1.6 * s2, -0.1 * c]),
        np.array([-0.8 * c, -3.2 * c2, 0.1 * s]),
        np.array([0.8 * s, 6.4 * s2, 0.1 * c]),
    ]
    psi, rate, bend = 0.3 * np.sin(t / 2), 0.15 * np.cos(t / 2), -0.075 * np.sin(t / 2)
    ahead = np.array([np.cos(psi), np.sin(psi), 0.0])
    left = np.array([-np.sin(psi), np.cos(psi), 0.0])
    return position, [ahead, rate * left, bend * left - rate**2 * ahead]


def unit(q: Array, q1: Array, q2: Array) -> tuple[Array, Array, Array]:
    """The direction of q and its first two derivatives."""
    size = np.sqrt(q @ q)
    n = q / size
    rate = n @ q1
    n1 = (q1 - n * rate) / size
    return n, n1, (q2 - n * (n1 @ q1 + n @ q2) - 2 * n1 * rate) / size


def crossed(a: tuple[Array, ...], b: tuple[Array, ...]) -> tuple[Array, Array, Array]:
    """The cross product of a and b, and its first two derivatives."""
    return (
        cross(a[0], b[0]),
        cross(a[1], b[0]) + cross(a[0], b[1]),
        cross(a[2], b[0]) + 2 * cross(a[1], b[1]) + cross(a[0], b[2]),
    )


def force(t: float, p: Array, v: Array, R: Array, W: Array) -> tuple[Array, Array, Array]:
    """The force per mass that the position loop asks for, and two derivatives by the model."""
    (x, x1, x2, x3, x4), _ = desired(t)
    g, b, b1 = WEIGHT / MASS * UP, R[:, 2], R @ cross(W, UP)
    e, e1 = p - x, v - x1
    u = KX * e + KV * e1
    q = 1 / np.sqrt(1 + u @ u / LIMIT**2)
    A = x2 - q * u + g
    push = A @ b
    e2 = push * b - g - x2
    u1 = KX * e1 + KV * e2
    q1 = -(q**3) * (u @ u1) / LIMIT**2
    A1 = x3 - q1 * u - q * u1
    e3 = (A1 @ b + A @ b1) * b + push * b1 - x3
    u2 = KX * e2 + KV * e3
    q2 = (-3 * q**2 * q1 * (u @ u1) - q**3 * (u1 @ u1 + u @ u2)) / LIMIT**2
    return A, A1, x4 - q2 * u - 2 * q1 * u1 - q * u2


def thrusts(t: float, R: Array, W: Array, F: tuple[Array, Array, Array]) -> Array:
    """What Lee's attitude law and the push ask of the rotors."""
    c3 = unit(*F)
    c2 = unit(*crossed(c3, tuple(desired(t)[1])))
    c1 = crossed(c2, c3)
    E = np.stack([c1[0], c2[0], c3[0]]) @ R
    Wc = np.array([c3[0] @ c2[1], c1[0] @ c3[1], c2[0] @ c1[1]])
    Wc1 = [c3[1] @ c2[1] + c3[0] @ c2[2], c1[1] @ c3[1] + c1[0] @ c3[2]]
    Wc1 = np.array([*Wc1, c2[1] @ c1[1] + c2[0] @ c1[2]])
    error = np.array([E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]]) / 2
    carried = E.T @ Wc
    torque = -KR * error - KW * (W - carried) + cross(W, J * W)
    torque = torque - J * (cross(W, carried) - E.T @ Wc1)
    asked = UNMIX @ np.append(torque, MASS * (F[0] @ R[:, 2]))
    return np.clip(asked, 0.0, K_THRUST * FASTEST**2)


def rate(t: float, y: Array, speeds: Array) -> Array:
    """The derivative of position, velocity, attitude, rates and speeds under asked speeds."""
    v, R, W, now = y[3:6], y[6:15].reshape(3, 3), y[15:18], y[18:]
    wrench = MIX @ (K_THRUST * now * now)
    wind = np.array([0.5 + 0.3 * np.sin(0.7 * t), 0.2 * np.cos(1.1 * t), 0.0])
    body = wrench[3] * UP - DRAG * (R.T @ (v - wind))
    W1 = (wrench[:3] - cross(W, J * W)) / J
    v1 = R @ body / MASS - WEIGHT / MASS * UP
    return np.concatenate([v, v1, (R @ hat(W)).ravel(), W1, (speeds - now) / LAG])


def fly(Q: Array, V: Array, times: Array) -> tuple[Array, Array]:
    """Poses and body velocities at times that are control instants."""
    R, W, p, v = Q[:3, :3], V[:3], Q[:3, 3], Q[:3, :3] @ V[3:]
    F = force(0.0, p, v, R, W)
    given = np.sqrt(thrusts(0.0, R, W, F) / K_THRUST)
    y, h = np.concatenate([p, v, R.ravel(), W, given]), PERIOD
    kept, every = [y], round((times[1] - times[0]) / h)
    for k in range(round(times[-1] / h)):
        t, R, W = k * h, y[6:15].reshape(3, 3), y[15:18]
        if k % OUTER == 0:
            F = force(t, y[:3], y[3:6], R, W)
        asked = np.sqrt(thrusts(t, R, W, F) / K_THRUST)
        k1 = rate(t, y, given)
        k2 = rate(t + h / 2, y + h / 2 * k1, given)
        k3 = rate(t + h / 2, y + h / 2 * k2, given)
        k4 = rate(t + h, y + h * k3, given)
        y, given = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4), asked
        if (k + 1) % every == 0:
            kept.append(y)
    found = np.array(kept)
    Q = np.broadcast_to(np.eye(4), (len(found), 4, 4)).copy()
    Q[:, :3, :3], Q[:, :3, 3] = found[:, 6:15].reshape(-1, 3, 3), found[:, :3]
    v = (np.swapaxes(Q[:, :3, :3], 1, 2) @ found[:, 3:6, None])[..., 0]
    return Q, np.concatenate([found[:, 15:18], v], axis=1)
