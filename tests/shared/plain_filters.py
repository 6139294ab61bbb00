"""Filters as their papers write them: one run, matrices, `scipy.linalg.expm`, no line of eqt.

Kalman (1960) on R^n and on the circle; the left-invariant filter with a bias after Barrau and
Bonnabel (2017); the equivariant filter on the tangent group after van Goor, Hamel and Mahony (2023)
and Fornasier, Ng, Mahony and Weiss (2022); the filter of Mahony, Hamel and Pflimlin (2008), in its
passive form. An algebra is given by its basis, and all else is matrices.
"""

import numpy as np
from scipy.linalg import block_diag, expm

# The algebras, in the coordinates of the configurations ------------------------------------------


def logarithm(Q):
    """By two square roots (Denman and Beavers, 1976), and log Y = 2 artanh((Y − I)(Y + I)⁻¹)."""
    for _ in range(2):
        one = np.eye(len(Q))
        for _ in range(10):
            Q, one = (Q + np.linalg.inv(one)) / 2, (one + np.linalg.inv(Q)) / 2
    X = (Q - np.eye(len(Q))) @ np.linalg.inv(Q + np.eye(len(Q)))
    square, power, series = X @ X, X, 0 * X
    for k in range(1, 45, 2):
        series, power = series + power / k, power @ square
    return 8 * series


def basis(group):
    """The basis of so(2), so(3), se(2), se(3), se_2(3) or of R^n, rotation first."""
    if group.startswith("R"):
        n = int(group[1:])
        tensor = np.zeros((n, n + 1, n + 1))
        tensor[range(n), range(n), n] = 1.0
        return tensor
    dimension, columns = {
        "SO2": (2, 0),
        "SO3": (3, 0),
        "SE2": (2, 1),
        "SE3": (3, 1),
        "SE23": (3, 2),
    }[group]
    size, tensor = dimension + columns, []
    for i, j in [(1, 0)] if dimension == 2 else [(2, 1), (0, 2), (1, 0)]:
        E = np.zeros((size, size))
        E[i, j], E[j, i] = 1.0, -1.0
        tensor.append(E)
    for column in range(dimension, size):
        for row in range(dimension):
            E = np.zeros((size, size))
            E[row, column] = 1.0
            tensor.append(E)
    return np.array(tensor)


class Algebra:
    """What a basis says of its group."""

    def __init__(self, group):
        self.E = basis(group)
        self.m, self.d = self.E.shape[:2]

    def hat(self, v):
        return np.einsum("i,ijk->jk", v, self.E)

    def vee(self, X):
        return np.einsum("ijk,jk->i", self.E, X) / np.einsum("ijk,ijk->i", self.E, self.E)

    def exp(self, v):
        return expm(self.hat(v))

    def log(self, Q):
        return self.vee(logarithm(Q))

    def ad(self, v):
        V = self.hat(v)
        return np.array([self.vee(V @ E - E @ V) for E in self.E]).T

    def Ad(self, Q):
        return np.array([self.vee(Q @ E @ np.linalg.inv(Q)) for E in self.E]).T


# Kalman (1960): V_m = q̇ + b + n, ḃ white, q_m = q + n_p, on R^n and, nearby, on the circle ------


class Kalman:
    """The means of q and b of one coordinate, given all that is measured, and their covariance.

    No recursion: all that is random (the noise of each fix and velocity, the first bias and each of
    its steps) is one normal vector u, and what is measured depends on it linearly. Between two
    measured velocities, q moves by their mean; beyond the last one known, by that one.
    """

    def __init__(self, period, fixes, velocities, pose_std, velocity_std, bias_std, walk):
        """Ticks of all fixes and of all velocities, the first of each at 0, whenever known."""
        self.h, self.fixes, self.ticks = period, list(fixes), np.array(velocities)
        steps = walk * np.sqrt(period * np.diff(self.ticks))
        each = [len(self.fixes) * [pose_std], len(self.ticks) * [velocity_std], [bias_std], steps]
        self.D = np.diag(np.concatenate(each) ** 2)
        self.p, self.n, self.s = np.split(
            np.eye(len(self.D)), np.cumsum([len(self.fixes), len(self.ticks)])
        )

    def weights(self, tick, known):
        """Of the first `known` velocities in the way from 0 to a tick, s."""
        weights, ends = np.zeros(len(self.ticks)), [*self.ticks[1:known], np.inf]
        for j, (start, end) in enumerate(zip(self.ticks, ends, strict=False)):
            if end <= tick:
                weights[j : j + 2] += self.h * (end - start) / 2
            elif start < tick:
                weights[j] += self.h * (tick - start)
        return weights

    def error(self, tick, known):
        """Of q, by the first fix and these velocities alone: its row in u."""
        return -self.p[0] - self.weights(tick, known) @ (np.cumsum(self.s, axis=0) + self.n)

    def residuals(self, last_fix, q_m, V_m, known):
        """Of the fixes after the first, up to a tick, and their rows in u."""
        used = [i for i, at in enumerate(self.fixes) if 0 < at <= last_fix]
        rows = [self.error(self.fixes[i], known) + self.p[i] for i in used]
        y = [q_m[i] - q_m[0] - self.weights(self.fixes[i], known) @ V_m for i in used]
        return np.array(y), np.array(rows).reshape(-1, len(self.D))

    def estimate(self, tick, last_fix, q_m, V_m, known):
        """The mean of (q, b) at a tick, and its covariance."""
        y, R = self.residuals(last_fix, q_m, V_m, known)
        X = np.array([self.error(tick, known), self.s[self.ticks <= tick].sum(axis=0)])
        K = np.linalg.solve(R @ self.D @ R.T, R @ self.D @ X.T).T
        start = np.array([q_m[0] + self.weights(tick, known) @ V_m, 0.0])
        return start + K @ y, X @ self.D @ X.T - K @ R @ self.D @ X.T

    def innovations(self, last_fix, q_m, V_m, known):
        """Each residual less its mean given those before it, over its deviation."""
        y, R = self.residuals(last_fix, q_m, V_m, known)
        return np.linalg.solve(np.linalg.cholesky(R @ self.D @ R.T), y)


# On groups: rows are the coordinates that a fix measures ------------------------------------------


def covariance_of(m, *deviations):
    """Of independent coordinates, m with each of these deviations: a number, or m."""
    return np.diag(np.concatenate([np.ones(m) * each for each in deviations]) ** 2)


class ErrorStateFilter:
    """What both have: the covariance of pose, bias and the noise n̂ of the last velocity."""

    def __init__(self, group, period, velocity_std, bias_walk, Q, b, covariance):
        self.A, self.h, self.noise, self.P = Algebra(group), period, 0.0 * b, covariance
        self.stds = velocity_std, np.sqrt(period) * bias_walk

    def mean(self, first, last, share):
        return (1 - share) * (first - self.noise) + share * last

    def advance(self, A, B, D, carry, share, drift):
        """(ε, b̃, n) by ε ← Aε + B(b̃ + (1 − β)n + β(n' + w)), b̃ ← D b̃ + w, n ← n'.

        n' and w are of the body, and `carry` is from there to the frame of B, and of D.
        """
        m, (white, walk) = self.A.m, self.stds
        (start, end), one, none = carry, np.eye(m), np.zeros((m, m))
        share, drift = (np.diag(x * np.ones(m)) for x in (share, drift))
        held = np.diag(1.0 * (np.diag(share) == 0))
        F = np.block([[A, B, B @ start @ (one - share)], [none, D, none], [none, none, held]])
        both = B @ start @ share
        N = np.block([[both, both], [none, end], [one - held, -held]])
        u = block_diag(white**2 * one, walk**2 * drift)
        self.P, self.noise = F @ self.P @ F.T + N @ u @ N.T, held @ self.noise


class InvariantFilter(ErrorStateFilter):
    """Q̂, b̂ and the covariance of (ε, b̃, n) with Q = Q̂ exp ε and b = b̂ + b̃."""

    def __init__(self, group, period, velocity_std, bias_walk, Q, b, covariance):
        super().__init__(group, period, velocity_std, bias_walk, Q, b, covariance)
        self.pose, self.bias = Q, b

    def predict(self, first, last, share=0.5, drift=1.0):
        """Through a period, from the velocities measured at its ends."""
        A, m, V = self.A, self.A.m, self.mean(first, last, share) - self.bias
        rate = np.block([[-A.ad(V), -np.eye(m)], [np.zeros((m, 2 * m))]])
        F = expm(self.h * rate)
        self.pose = self.pose @ A.exp(self.h * V)
        one = np.eye(m)
        self.advance(F[:m, :m], F[:m, m:], one, (one, one), share, drift)

    def correct(self, residual, rows, noise):
        """By a fix whose residual is in the body frame, of these coordinates.

        Returns the residual in the coordinates in which its covariance is 1, one after the other.
        """
        m = self.A.m
        H = np.eye(3 * m)[rows]
        S = H @ self.P @ H.T + noise
        K = self.P @ H.T @ np.linalg.inv(S)
        step = K @ residual
        self.pose, self.bias = self.pose @ self.A.exp(step[:m]), self.bias + step[m : 2 * m]
        self.noise = self.noise + step[2 * m :]
        self.P = (np.eye(3 * m) - K @ H) @ self.P
        return np.linalg.solve(np.linalg.cholesky(S), residual)

    def nees(self, Q, b):
        e = np.concatenate([self.A.log(np.linalg.inv(self.pose) @ Q), b - self.bias])
        return e @ np.linalg.solve(self.P[: len(e), : len(e)], e)


class EquivariantFilter(ErrorStateFilter):
    """T = [[Q̂, Q̂ b̂^], [0, Q̂]] in the tangent group, and the covariance of its error.

    The error is T of the truth times T̂⁻¹, (QQ̂⁻¹, Ad_Q̂(b − b̂)), in the coordinates (log, identity).
    Beside it is the noise of the last velocity, in the body.
    """

    def __init__(self, group, period, velocity_std, bias_walk, Q, b, covariance):
        super().__init__(group, period, velocity_std, bias_walk, Q, b, covariance)
        self.T = self.element(Q, b)
        self.P = self.carried(covariance)

    def element(self, Q, b):
        return np.block([[Q, Q @ self.A.hat(b)], [0 * Q, Q]])

    @property
    def pose(self):
        return self.T[: self.A.d, : self.A.d]

    @property
    def bias(self):
        return self.A.vee(np.linalg.inv(self.pose) @ self.T[: self.A.d, self.A.d :])

    def carried(self, covariance):
        """From the body frame to that of space."""
        both = block_diag(self.A.Ad(self.pose), self.A.Ad(self.pose), np.eye(self.A.m))
        return both @ covariance @ both.T

    def predict(self, first, last, share=0.5, drift=1.0):
        """ε̇_r = −ε_b, ε̇_b = ad_{Ad_Q̂ V̂} ε_b, with noise that is Ad_Q̂ of the body's."""
        A, m, b, V = self.A, self.A.m, self.bias, self.mean(first, last, share) - self.bias
        one, none, start = np.eye(m), np.zeros((m, m)), A.Ad(self.pose)
        F = expm(self.h * np.block([[none, -one], [none, A.ad(start @ V)]]))
        self.T = self.element(self.pose @ A.exp(self.h * V), b)
        carry = start, A.Ad(self.pose)
        self.advance(one, F[:m, m:], F[m:, m:], carry, share, drift)

    def correct(self, residual, rows, noise):
        """n = log(exp(−ε) exp(r)) is r − (1 − ½ad_r)ε to third order; the rest is in space.

        Returns what the invariant filter does.
        """
        A, full = self.A, np.zeros(self.A.m)
        full[rows] = residual
        back = np.linalg.inv(A.Ad(self.pose))
        C = np.hstack([(np.eye(A.m) - A.ad(full) / 2) @ back, np.zeros((A.m, 2 * A.m))])[rows]
        S = C @ self.P @ C.T + noise
        K = self.P @ C.T @ np.linalg.inv(S)
        u, s, n = np.split(K @ residual, 3)
        u, s, self.noise = A.hat(u), A.hat(s), self.noise + n
        self.T = expm(np.block([[u, s], [0 * u, u]])) @ self.T
        self.P = (np.eye(3 * A.m) - K @ C) @ self.P
        return np.linalg.solve(np.linalg.cholesky(S), residual)

    def nees(self, Q, b):
        off = self.A.log(Q @ np.linalg.inv(self.pose))
        e = np.concatenate([off, self.A.Ad(self.pose) @ (b - self.bias)])
        return e @ np.linalg.solve(self.P[: len(e), : len(e)], e)


class PassiveFilter:
    """Mahony, Hamel, Pflimlin (2008): R̂̇ = R̂ (Ω_y − b̂ + k_P ω)_×, b̂̇ = −k_I ω on SO(3).

    ω = vex of the antisymmetric part of R̂ᵀR_y. What a fix tells acts at once, for the time between
    two of them.
    """

    def __init__(self, R, b, kp, ki, period, between):
        self.A, self.pose, self.bias = Algebra("SO3"), R, b
        self.kp, self.ki, self.h, self.between = kp, ki, period, between

    def predict(self, omega_y):
        self.pose = self.pose @ self.A.exp(self.h * (omega_y - self.bias))

    def correct(self, R_y):
        off = self.pose.T @ R_y
        skew = (off - off.T) / 2
        omega = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
        self.pose = self.pose @ self.A.exp(self.between * self.kp * omega)
        self.bias = self.bias - self.between * self.ki * omega


class GradientFilter:
    """The same on any group: down the slope of ½‖Q̂⁻¹Q_m − I‖²_F, by the square of each generator.

    What a fix tells of a coordinate acts at once, for the time between two of them.
    """

    def __init__(self, group, period, pose, kp, ki, between):
        self.A, self.h, self.pose, self.bias = Algebra(group), period, pose, 0.0 * kp
        self.kp, self.ki, self.between = kp, ki, np.array(between)

    def predict(self, first, last, share, drift):
        V_m = (1 - share) * first + share * last
        self.pose = self.pose @ self.A.exp(self.h * (V_m - self.bias))

    def correct(self, off, rows):
        slope = [np.sum((off - np.eye(self.A.d)) * (off @ E)) / np.sum(E * E) for E in self.A.E]
        step = np.zeros(self.A.m)
        step[rows] = (self.between * slope)[rows]
        self.pose = self.pose @ self.A.exp(self.kp * step)
        self.bias = self.bias - self.ki * step
