import numpy as np

m, g = 1.2, 9.81
J = np.array([0.02, 0.025, 0.04])
kf, km, l = 5.57e-6, 1.36e-7, 0.12
d = np.array([0.1, 0.1, 0.2])


def cross(a, b):
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def hat(w):
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


class Drone:
    def rates(self, p, R, v, w, n):
        """Forward, right, down; v in the body; n in rpm."""
        s = (n * np.pi / 30) ** 2
        f = kf * s
        F = np.array([0, 0, -f.sum()]) + R.T @ np.array([0, 0, m * g]) - d * v
        L = l * (-f[0] + f[1] + f[2] - f[3]) * -1
        M = l * (f[0] + f[1] - f[2] - f[3])
        N = km * (s[0] - s[1] + s[2] - s[3]) * -1
        tau = np.array([L, M, N])
        vd = F / m - cross(w, v)
        wd = (tau - cross(w, J * w)) / J
        return {"p": R @ v, "R": R @ hat(w), "v": vd, "w": wd}
