"""A quadrotor as many simulators have it: p, q (w first), v in space, ω in the body."""

import numpy as np
from scipy.spatial.transform import Rotation

m, g, J = 1.2, 9.81, np.array([0.02, 0.025, 0.04])
l, c = 0.12, 1.36e-7 / 5.57e-6
drag = np.array([0.1, 0.1, 0.2])


def rate(x, n):
    """Return ẋ for rotors at n rpm."""
    q, v, w = x[3:7], x[7:10], x[10:13]
    f = 5.57e-6 * (n * np.pi / 30) ** 2
    R = Rotation.from_quat(np.roll(q, -1)).as_matrix()
    force = R @ [0, 0, f.sum()] - R @ (drag * (R.T @ v))
    torque = [
        l * (f[0] - f[1] - f[2] + f[3]),
        l * (f[2] + f[3] - f[0] - f[1]),
        c * (f[0] - f[1] + f[2] - f[3]),
    ]
    turn = 0.5 * np.hstack([-q[1:] @ w, q[0] * w + np.cross(q[1:], w)])
    return np.hstack([v, turn, force / m - [0, 0, g], torque / J])


def step(x, n, dt):
    """Return x after dt by Heun's method."""
    k = rate(x, n)
    x = x + dt / 2 * (k + rate(x + dt * k, n))
    x[3:7] /= np.linalg.norm(x[3:7])
    return x
