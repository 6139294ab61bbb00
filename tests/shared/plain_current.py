"""A vehicle in a current by Fossen's equations (2021), of plain NumPy; it shares no line with eqt.

M_R ν̇ + C_R(ν)ν + M_A ν̇_r + C_A(ν_r)ν_r + D(ν_r)ν_r = τ, with his order ν = (v, ω). The medium is
at rest in a frame that moves with it, in which a body of the displaced mass has no weight.
"""

import numpy as np
from scipy.integrate import solve_ivp

ORDER = [3, 4, 5, 0, 1, 2]
"""From (ω, v) to (v, ω), and back."""


def skew(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def coriolis(M, nu):
    """Fossen's C(ν) of a symmetric M."""
    linear, angular = (M[rows] @ nu for rows in (slice(3), slice(3, 6)))
    upper = np.hstack([np.zeros((3, 3)), -skew(linear)])
    return np.vstack([upper, np.hstack([-skew(linear), -skew(angular)])])


class Vehicle:
    """Without control, or with a torque that is a function of R, p and (ω, v)."""

    def __init__(self, rigid, added, linear, quadratic, current, rate, **more):
        matrices = [np.asarray(M, dtype=float) for M in (rigid, added, linear, quadratic)]
        matrices = [np.diag(M) if M.ndim == 1 else M for M in matrices]
        self.R, self.A, self.linear, self.quadratic = (M[np.ix_(ORDER, ORDER)] for M in matrices)
        self.current, self.rate = current, rate
        self.weight, self.buoyancy = more.get("weight", 0.0), more.get("buoyancy", 0.0)
        self.at_weight, self.at_buoyancy = more.get("at_weight", [0] * 3), more.get("at", [0] * 3)
        self.control = more.get("control", lambda R, p, V: np.zeros(6))

    def acceleration(self, t, R, p, V):
        """(ω, v) has this rate."""
        nu = np.asarray(V)[ORDER]
        flow = np.append(R.T @ self.current(t), np.zeros(3))
        pushed = np.append(R.T @ self.rate(t), np.zeros(3))
        turning = np.append(-np.cross(nu[3:], flow[:3]), np.zeros(3))
        slip = nu - flow
        force = self.control(R, p, V)[ORDER] - coriolis(self.R, nu) @ nu
        force = force - coriolis(self.A, slip) @ slip + self.A @ (turning + pushed)
        force = force - self.linear @ slip - self.quadratic @ (np.abs(slip) * slip)
        up = R.T @ [0, 0, 1]
        lift = self.buoyancy * (up + pushed[:3] / 9.80665)
        for at, each in ((self.at_weight, -self.weight * up), (self.at_buoyancy, lift)):
            force = force + np.append(each, np.cross(at, each))
        return np.linalg.solve(self.R + self.A, force)[ORDER]

    def field(self, t, y):
        R, p, V = y[:9].reshape(3, 3), y[9:12], y[12:]
        rates = (R @ skew(V[:3])).ravel(), R @ V[3:], self.acceleration(t, R, p, V)
        return np.concatenate(rates)

    def run(self, R, p, V, times):
        """R, p and V at some times."""
        start, span = np.concatenate([np.ravel(R), p, V]), (times[0], times[-1])
        solved = solve_ivp(self.field, span, start, "DOP853", times, rtol=1e-11, atol=1e-12)
        return solved.y[:9].T.reshape(-1, 3, 3), solved.y[9:12].T, solved.y[12:].T
