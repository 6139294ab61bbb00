import numpy as np

m, g = 1.2, 9.81
Jx, Jy, Jz = 0.02, 0.025, 0.04
D = np.array([0.1, 0.1, 0.2])


def rpy_matrix(a):
    cr, cp, cy = np.cos(a)
    sr, sp, sy = np.sin(a)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def step(x, u, dt):
    x = np.array(x)
    p, a, v, w = x[0:3], x[3:6], x[6:9], x[9:12]
    T, tau = u[0], u[1:4]
    R = rpy_matrix(a)
    acc = R[:, 2] * T / m + np.array([0, 0, -g]) - R @ (D * (R.T @ v)) / m
    wd = np.array(
        [
            (tau[0] + (Jy - Jz) * w[1] * w[2]) / Jx,
            (tau[1] + (Jz - Jx) * w[0] * w[2]) / Jy,
            (tau[2] + (Jx - Jy) * w[0] * w[1]) / Jz,
        ]
    )
    sr, cr = np.sin(a[0]), np.cos(a[0])
    tp, cp = np.tan(a[1]), np.cos(a[1])
    ad = np.array(
        [
            w[0] + sr * tp * w[1] + cr * tp * w[2],
            cr * w[1] - sr * w[2],
            (sr * w[1] + cr * w[2]) / cp,
        ]
    )
    v2 = v + dt * acc
    return np.concatenate([p + dt * v2, a + dt * ad, v2, w + dt * wd])
