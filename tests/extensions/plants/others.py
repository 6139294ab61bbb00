"""The plants beside it in other conventions."""

import numpy as np
from scipy.spatial.transform import Rotation

m, g, J = 1.2, 9.81, np.diag([0.02, 0.025, 0.04])
D, l, c = np.array([0.1, 0.1, 0.2]), 0.12, 1.36e-7 / 5.57e-6


def accelerations(R, v, w, f):
    """Return v̇ in space and ω̇ in the body, of a quadrotor."""
    tau = np.array(
        [
            l * (f[0] - f[1] - f[2] + f[3]),
            l * (f[2] + f[3] - f[0] - f[1]),
            c * (f[0] - f[1] + f[2] - f[3]),
        ]
    )
    a = R @ np.array([0, 0, f.sum()]) / m - [0, 0, g] - R @ (D * (R.T @ v)) / m
    return a, np.linalg.solve(J, tau - np.cross(w, J @ w))


def filled(x, u):
    """Its state has Rᵀ row by row, three gyroscope biases, and the speeds of the rotors."""
    R, v, w, n = x[3:12].reshape(3, 3).T, x[12:15], x[15:18], x[21:25]
    a, b = accelerations(R, v, w, 5.57e-6 * (1000 * np.pi / 30 * n) ** 2)
    H = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    return np.hstack([v, (R @ H).T.ravel(), a, b, np.zeros(3), (u - n) / 0.05])


class Runge:
    """A step of Runge and Kutta's, with a quaternion that is made a unit one."""

    def __init__(self, mass=1.2):
        self.mass = mass

    def rate(self, x, u):
        q, v, w = x[3:7], x[7:10], x[10:]
        a, b = accelerations(Rotation.from_quat(q).as_matrix(), v, w, u)
        s = q[3]
        dq = 0.5 * np.hstack([s * w + np.cross(q[:3], w), -q[:3] @ w])
        return np.hstack([v, dq, a, b])

    def step(self, state, thrusts, dt):
        k1 = self.rate(state, thrusts)
        k2 = self.rate(state + dt / 2 * k1, thrusts)
        k3 = self.rate(state + dt / 2 * k2, thrusts)
        x = state + dt / 6 * (k1 + 2 * k2 + 2 * k3 + self.rate(state + dt * k3, thrusts))
        x[3:7] /= np.linalg.norm(x[3:7])
        return x


def degrees(p, angles, v, w, grams):
    """Roll, pitch and yaw in degrees, body velocity, thrusts in grams."""
    r, t, y = np.radians(angles)
    R = Rotation.from_euler("ZYX", [y, t, r]).as_matrix()
    w = np.radians(w)
    a, b = accelerations(R, R @ v, w, np.asarray(grams) * 9.81e-3)
    E = np.array(
        [
            [1, np.sin(r) * np.tan(t), np.cos(r) * np.tan(t)],
            [0, np.cos(r), -np.sin(r)],
            [0, np.sin(r) / np.cos(t), np.cos(r) / np.cos(t)],
        ]
    )
    return R @ v, np.degrees(E @ w), R.T @ a - np.cross(w, v), np.degrees(b)


def in_space(x, torque):
    """A turning body, with ω in space, deg/s."""
    q, w = x[:4], np.radians(x[4:])
    R, I = Rotation.from_quat(q).as_matrix(), np.diag([1.0, 2.0, 3.5])
    dq = 0.5 * np.hstack([q[3] * w - np.cross(q[:3], w), -q[:3] @ w])
    W = R.T @ w
    return np.hstack([dq, np.degrees(R @ np.linalg.solve(I, torque - np.cross(W, I @ W)))])


I = np.array([[0.02, 0.001, 0], [0.001, 0.025, -0.002], [0, -0.002, 0.04]])


def crooked(x, wrench):
    """Products of inertia, velocities in the body, and all of a wrench."""
    R, w, v = x[3:12].reshape(3, 3), x[12:15], x[15:]
    H = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    a = wrench[3:] / m - np.cross(w, v) - R.T @ [0, 0, g] - D * v / m
    return [R @ v, (R @ H).ravel(), np.linalg.solve(I, wrench[:3] - np.cross(w, I @ w)), a]
