import numpy as np

M = np.diag([17.0, 24.2, 26.07])
J = np.diag([0.28, 0.32, 0.42])
W, B, zb = 112.8, 114.8, np.array([0, 0, 0.02])
Dl, Dq = np.array([4.03, 6.22, 5.18]), np.array([18.18, 21.66, 36.99])


def f(p, q, v, w, tau, F):
    x, y, z, s = q
    R = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - s * z), 2 * (x * z + s * y)],
            [2 * (x * y + s * z), 1 - 2 * (x * x + z * z), 2 * (y * z - s * x)],
            [2 * (x * z - s * y), 2 * (y * z + s * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    up = R.T @ np.array([0, 0, 1.0])
    Fb = F + (B - W) * up - Dl * v - Dq * np.abs(v) * v
    Tb = tau + np.cross(zb, B * up) - 0.07 * w - 1.55 * np.abs(w) * w
    vd = np.linalg.solve(M, Fb - np.cross(w, M @ v))
    wd = np.linalg.solve(J, Tb - np.cross(w, J @ w) - np.cross(v, M @ v))
    qv = q[:3]
    qd = 0.5 * np.array(
        [
            s * w[0] + y * w[2] - z * w[1],
            s * w[1] + z * w[0] - x * w[2],
            s * w[2] + x * w[1] - y * w[0],
            -qv @ w,
        ]
    )
    return R @ v, qd, vd, wd
