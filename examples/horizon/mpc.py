"""A predictive attitude law in NumPy and SciPy: one Gauss-Newton step a period, warm-started.

It minimises the cost of `lqr` over a horizon, Σ (pose |log(Q_d⁻¹Q)|² + velocity |V − ξ|² +
torque |τ − τ_d|²) dt with ξ = Ad_{Q_L⁻¹} V_d, and `end` times that of the last state, within the
limits of the torque. It knows τ_d at the reference, not where the body is. Where a `rate` limits
each |V_i|, what is beyond it is penalised: a soft constraint, which has a plan also from a start
that violates it.
"""

import numpy as np
from scipy.optimize import lsq_linear

SMALL = 1e-6


def log(R):
    """Rotation vectors of matrices, ``(..., 3)``; not at half turns."""
    axis = np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0],
                     R[..., 1, 0] - R[..., 0, 1]], axis=-1) / 2  # fmt: skip
    sine, cosine = np.linalg.norm(axis, axis=-1), (np.trace(R, axis1=-2, axis2=-1) - 1) / 2
    angle = np.arctan2(sine, cosine)
    return axis * np.where(sine > 1e-9, angle / np.maximum(sine, 1e-9), 1.0)[..., None]


def exp(x):
    """Rotation matrices of rotation vectors, by Rodrigues' formula."""
    angle = np.linalg.norm(x, axis=-1)[..., None, None]
    K = np.zeros((*x.shape, 3))
    K[..., 2, 1], K[..., 0, 2], K[..., 1, 0] = (x[..., k] for k in range(3))
    K = K - np.swapaxes(K, -1, -2)
    a, b = np.sinc(angle / np.pi), 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    return np.eye(3) + a * K + b * K @ K


class Horizon:
    """One object flies one run: it keeps the torques of its last plan."""

    def __init__(self, J, dt, limit, pose, velocity, torque, end, rate=np.inf):
        self.J, self.dt, self.limit, self.rate_limit = np.array(J), dt, limit, rate
        self.weights = np.sqrt(dt * np.repeat([pose, velocity, torque], 3))
        self.end, self.plan = np.sqrt(end), None

    def compute(self, pose, velocity, later_pose, later_velocity, later_torque):
        """Return the first torque of the plan."""
        steps = len(later_pose)
        first = later_torque if self.plan is None else np.vstack([self.plan[1:], self.plan[-1:]])
        plan = np.clip(first, -self.limit, self.limit)
        start = pose, velocity, later_pose, later_velocity, later_torque
        # The plan, and one with a little more of each torque: the slopes by differences.
        changes = SMALL * np.vstack([np.zeros(3 * steps), np.eye(3 * steps)])
        residuals = self.residuals(plan + changes.reshape(-1, steps, 3), *start)
        slope = (residuals[1:] - residuals[0]).T / SMALL
        low, high = -self.limit - plan.ravel(), self.limit - plan.ravel()
        step = lsq_linear(slope, -residuals[0], (low - 1e-9, high + 1e-9), method="bvls").x
        self.plan = np.clip(plan + step.reshape(steps, 3), -self.limit, self.limit)
        return self.plan[0]

    def residuals(self, plans, Q, V, Qd, Vd, tau_d):
        """Weighted errors of plans ``(n, steps, 3)``: pose, velocity and torque at each step."""
        Q, V = np.broadcast_to(Q, (len(plans), 3, 3)), np.broadcast_to(V, plans[:, 0].shape)
        rows = []
        for k in range(plans.shape[1]):
            for _ in range(SUBSTEPS):  # the midpoint rule, on the group
                half = V + self.dt / SUBSTEPS / 2 * self.rate(V, plans[:, k])
                V = V + self.dt / SUBSTEPS * self.rate(half, plans[:, k])
                Q = Q @ exp(self.dt / SUBSTEPS * half)
            relative = np.swapaxes(Q, -1, -2) @ Qd[k]
            errors = np.hstack([-log(relative), V - relative @ Vd[k], plans[:, k] - tau_d[k]])
            last = k == plans.shape[1] - 1
            rows.append(errors * self.weights * np.repeat([self.end if last else 1.0, 1.0], [6, 3]))
            if np.isfinite(self.rate_limit):
                rows.append(PENALTY * np.maximum(np.abs(V) - self.rate_limit, 0.0))
        return np.hstack(rows)

    def rate(self, V, torque):
        """Euler's equations, 𝕀V̇ = (𝕀V) × V + τ."""
        return (np.cross(self.J * V, V) + torque) / self.J


SUBSTEPS, PENALTY = 2, 10.0
