import numpy as np

m, g, J = 1.2, 9.81, np.diag([0.02, 0.025, 0.04])
D = np.diag([0.1, 0.1, 0.2])
l, c = 0.12, 1.36e-7 / 5.57e-6
M = np.array([[1, 1, 1, 1], [l, -l, -l, l], [-l, -l, l, l], [c, -c, c, -c]])


def rot(q):
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def f(x, u):
    q, v, w = x[3:7], x[7:10], x[10:13]
    T, tx, ty, tz = M @ u
    R = rot(q)
    a = R @ np.array([0, 0, T]) / m - np.array([0, 0, g]) - R @ D @ R.T @ v / m
    wd = np.linalg.solve(J, np.array([tx, ty, tz]) - np.cross(w, J @ w))
    wx, wy, wz = w
    Om = np.array([[0, -wx, -wy, -wz], [wx, 0, wz, -wy], [wy, -wz, 0, wx], [wz, wy, -wx, 0]])
    return np.concatenate([v, 0.5 * Om @ q, a, wd])
