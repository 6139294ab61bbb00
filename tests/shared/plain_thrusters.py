"""Thrusters and a current as one would write them for one purpose, on a closed loop of `plain`.

It shares no line with eqt. Each thruster is a point with a direction; the medium moves past it.
"""

import numpy as np
import plain
from scipy.optimize import lsq_linear


def column(at, along, turns=0.0):
    """Torque and force of a thrust of 1 N: r × a + c a and a; in the plane one torque."""
    a = np.array(along) / np.linalg.norm(along)
    if len(a) == 3:
        return np.concatenate([np.cross(at, a) + turns * a, a])
    return np.array([at[0] * a[1] - at[1] * a[0], a[0], a[1]])


class Vehicle(plain.Plain):
    """EqT on a plant with k thrusters, limited and lagging one by one, and drag in a current."""

    def __init__(self, group, inertia, kp, kd, torque, thrusters, low, high, *, lag=None, **more):
        self.linear, self.quadratic = more.pop("linear", 0.0), more.pop("quadratic", 0.0)
        self.current, self.bounded = more.pop("current", None), more.pop("bounded", False)
        super().__init__(group, inertia, kp, kd, torque)
        self.B = np.array([column(**each) for each in thrusters]).T
        k = self.B.shape[1]
        self.low, self.high = (np.broadcast_to(each, k) for each in (low, high))
        self.T = None if lag is None else np.broadcast_to(lag, k)

    def start(self, Q, V, Qd, Vd):
        return np.concatenate([super().start(Q, V, Qd, Vd)[: -self.m], np.zeros(self.B.shape[1])])

    def thrusts(self, wanted):
        """Of least norm, cut off one by one; or the nearest within the limits."""
        if self.bounded:
            return lsq_linear(self.B, wanted, (self.low, self.high), tol=1e-14).x
        return np.clip(self.B.T @ np.linalg.solve(self.B @ self.B.T, wanted), self.low, self.high)

    def drag(self, t, Q, V):
        slip, n = V.copy(), self.d - 1
        if self.current is not None:
            slip[-n:] -= Q[:n, :n].T @ self.current(t)
        return -self.linear * slip - self.quadratic * np.abs(slip) * slip

    def field(self, t, y, command, _):
        Q, V, Qd, Pd, x = self.split(y)
        wanted = command(t, y)
        f = wanted if len(wanted) == len(x) else self.thrusts(wanted)
        torque = self.B @ (f if self.T is None else x)
        V_dot = np.linalg.solve(self.I, self.ad(V).T @ (self.I @ V) + torque + self.drag(t, Q, V))
        Vd = np.linalg.solve(self.I, Pd)
        Pd_dot = self.ad(Vd).T @ Pd + self.torque(t)
        x_dot = np.zeros_like(x) if self.T is None else (f - x) / self.T
        moving = (Q @ self.hat(V)).ravel(), V_dot, (Qd @ self.hat(Vd)).ravel(), Pd_dot, x_dot
        return np.concatenate(moving)

    def law(self, t, Q, V, Qd, Pd):
        """What is solved for at an instant is held as thrusts."""
        wanted = super().law(t, Q, V, Qd, Pd)
        return self.thrusts(wanted) if self.bounded else wanted
