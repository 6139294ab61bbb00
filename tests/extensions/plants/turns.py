import numpy as np

J = np.diag([1.0, 2.0, 3.5])


def f(t, y, u):
    R, w = y[:9].reshape(3, 3), y[9:]
    H = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    Rd = R @ H
    wd = np.linalg.inv(J) @ (u - np.cross(w, J @ w))
    return np.hstack([Rd.ravel(), wd])
