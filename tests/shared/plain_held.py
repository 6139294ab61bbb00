"""Sampled loops as one would write them, at 1e-13: SciPy's DOP853 begins anew at each instant.

It shares no line with eqt.
"""

import numpy as np
import plain
from plain_filters import PassiveFilter
from scipy.integrate import solve_ivp

INERTIA = {"SO3": [1.0, 2.0, 2.5], "SE2": [1.5, 3.0, 4.0], "SE3": [1.0, 2.0, 2.5, 3.0, 4.0, 5.0]}
START = np.array([0.9, -0.5, 0.7, 0.3, -0.2, 0.4])
OFF = np.array([0.2, -0.1, 0.15])
"""The first error of the estimate."""


def torque(t, m):
    """That of the reference, N m and N."""
    return np.array([0.3 * np.cos(t), 0.2 * np.sin(t), 0.1, 0.2, 0.0, 0.05 * np.cos(2 * t)])[:m]


class NoG(plain.Plain):
    """EqT without its gyroscopic term."""

    def law(self, t, Q, V, Qd, Pd):
        slip = V - np.linalg.solve(self.I, Pd)
        return super().law(t, Q, V, Qd, Pd) + self.ad(slip).T @ Pd


class Lee(plain.Plain):
    """Lee, Leok and McClamroch (2010), eq. (8), (9) and (11), on SO(3), where K = k_R/2 I."""

    def law(self, t, Q, V, Qd, Pd):
        Wd = np.linalg.solve(self.I, Pd)
        Wd_dot = np.linalg.solve(self.I, np.cross(Pd, Wd) + self.torque(t))
        turn = Q.T @ Qd
        e_R, e_W = self.vee(turn.T - turn) / 2, V - turn @ Wd
        steady = np.cross(V, self.I @ V)
        steady -= self.I @ (np.cross(V, turn @ Wd) - turn @ Wd_dot)
        return steady - 2 * self.K[0, 0] * e_R - self.D @ e_W


LAWS = {"eqt": plain.Plain, "nog": NoG, "lee2010": Lee}


def motion(group, law, period, count, lag=None, delay=0, limit=np.inf, estimator=False):
    """Q and V at all instants; kp 1.5, kd 1.2; the filter reads a fix at each."""
    m = len(INERTIA[group])
    loop = LAWS[law](group, INERTIA[group], 1.5, 1.2, lambda t: torque(t, m), limit=limit)
    first = plain.exp(group, START[:m])
    y = loop.start(first, START[:m][::-1], np.eye(loop.d), np.zeros(m))
    off = plain.exp(group, -OFF) if estimator else None
    read = PassiveFilter(first @ off, 0 * OFF, 0.6, 0.2, period, period) if estimator else None
    found, waiting, before = [y], [np.zeros(m)] * delay, y
    for k in range(count):
        Q, V, Qd, Pd, _ = loop.split(y)
        if read:
            if k:
                read.predict((V + loop.split(before)[1]) / 2)
            read.correct(Q)
            Q, V, before = read.pose, V - read.bias, y
        waiting.append(loop.law(k * period, Q, V, Qd, Pd))
        held, span = waiting.pop(0), (k * period, (k + 1) * period)
        y = solve_ivp(
            loop.field,
            span,
            y,
            args=(lambda t, y, held=held: held, lag),
            method="DOP853",
            rtol=1e-13,
            atol=1e-14,
        ).y[:, -1]
        found.append(y)
    found = np.array(found)
    n = loop.d**2
    return found[:, :n].reshape(-1, loop.d, loop.d), found[:, n : n + m]
