"""A closed loop as one would write it for one purpose: matrices, one run, SciPy, EqT only.

It shares no line with eqt. Algebra and dual are spelled out by the basis of the matrices.
"""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm

TIGHT = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}


def hat(w):
    """The matrix of w ×."""
    return np.cross(np.eye(3), w)


def basis(group):
    """The basis of so(3), se(3) or se(2), rotation first."""
    if group == "SE2":
        tensor = np.zeros((3, 3, 3))
        tensor[0, 1, 0], tensor[0, 0, 1], tensor[1, 0, 2], tensor[2, 1, 2] = 1.0, -1.0, 1.0, 1.0
        return tensor
    d = {"SO3": 3, "SE3": 4}[group]
    tensor = []
    for k in range(3):
        E, (i, j) = np.zeros((d, d)), ((k + 1) % 3, (k + 2) % 3)
        E[j, i], E[i, j] = 1.0, -1.0
        tensor.append(E)
    for k in range(3 if d == 4 else 0):
        E = np.zeros((d, d))
        E[k, 3] = 1.0
        tensor.append(E)
    return np.array(tensor)


class Plain:
    """EqT on a plant of another inertia, with a push, a limit, a lag, and a clock for the law."""

    def __init__(self, group, inertia, kp, kd, torque, *, true=None, push=None, limit=np.inf):
        self.E = basis(group)
        self.m, self.d = len(self.E), self.E.shape[1]
        self.I, self.K, self.D = np.diag(inertia), kp * np.eye(self.d), kd * np.eye(self.m)
        self.J = self.I if true is None else np.diag(true)
        self.torque = torque
        self.low, self.high = limit if isinstance(limit, tuple) else (-limit, limit)
        self.push = (lambda t: np.zeros(self.m)) if push is None else push

    def hat(self, v):
        return np.einsum("i,ijk->jk", v, self.E)

    def vee(self, X):
        return np.einsum("ijk,jk->i", self.E, X) / np.einsum("ijk,ijk->i", self.E, self.E)

    def ad(self, v):
        V = self.hat(v)
        return np.array([self.vee(V @ E - E @ V) for E in self.E]).T

    def Ad(self, Q):
        inverse = np.linalg.inv(Q)
        return np.array([self.vee(Q @ E @ inverse) for E in self.E]).T

    def law(self, t, Q, V, Qd, Pd):
        """EqT: feedforward, damping in space, gradient of ½ tr((Q_E − I) K (Q_E − I)ᵀ)."""
        Vd = np.linalg.solve(self.I, Pd)
        slip, error = V - Vd, Q @ np.linalg.inv(Qd)
        forward = self.torque(t) - self.ad(slip).T @ Pd - self.ad(Vd).T @ (self.I @ slip)
        off = (error - np.eye(self.d)) @ self.K
        slope = np.array([np.sum(off * (error @ E)) for E in self.E])
        A = self.Ad(Qd)
        return forward - A.T @ (self.D @ (A @ slip) + slope)

    def start(self, Q, V, Qd, Vd):
        """Q, V, Q_d, P_d and the state of the lag."""
        return np.concatenate([Q.ravel(), V, Qd.ravel(), self.I @ Vd, np.zeros(self.m)])

    def split(self, y):
        n, m, d = self.d**2, self.m, self.d
        parts = np.split(y, [n, n + m, 2 * n + m, 2 * n + 2 * m])
        return parts[0].reshape(d, d), parts[1], parts[2].reshape(d, d), parts[3], parts[4]

    def field(self, t, y, command, lag):
        Q, V, Qd, Pd, x = self.split(y)
        limited = np.clip(command(t, y), self.low, self.high)
        torque = limited if lag is None else x
        V_dot = np.linalg.solve(self.J, self.ad(V).T @ (self.J @ V) + torque + self.push(t))
        Vd = np.linalg.solve(self.I, Pd)
        Pd_dot = self.ad(Vd).T @ Pd + self.torque(t)
        x_dot = np.zeros(self.m) if lag is None else (limited - x) / lag
        moving = (Q @ self.hat(V)).ravel(), V_dot, (Qd @ self.hat(Vd)).ravel(), Pd_dot, x_dot
        return np.concatenate(moving)

    def run(self, y, times, *, lag=None, period=None, delay=0):
        """The states at the times; continuous, or with a command held for a period."""
        if period is None:
            command = lambda t, y: self.law(t, *self.split(y)[:4])  # noqa: E731
            args = (command, lag)
            span = times[0], times[-1]
            return solve_ivp(self.field, span, y, t_eval=times, args=args, **TIGHT).y.T
        states, waiting = [y], [np.zeros(self.m)] * delay
        for k in range(round(times[-1] / period)):
            t = k * period
            waiting.append(self.law(t, *self.split(y)[:4]))
            held = waiting.pop(0)
            inside = times[(times > t + 1e-9) & (times < t + period + 1e-9)]
            stops = np.unique(np.append(inside, t + period).round(12))
            solved = solve_ivp(
                self.field,
                (t, t + period + 1e-12),
                y,
                t_eval=stops,
                args=(lambda t, y, held=held: held, lag),
                **TIGHT,
            ).y.T
            states += list(solved[: len(inside)])
            y = solved[-1]
        return np.array(states)


def exp(group, v):
    """The group exponential by SciPy."""
    return expm(np.einsum("i,ijk->jk", v, basis(group)))
