"""Position and attitude: the laws on SE(3), K = blkdiag(K_R, k_x), torque of configs/se3.yaml."""

from __future__ import annotations

from typing import Any

import numpy as np

WEIGHTS = {"eqt": (1, 1, 0), "gt": (0.5, 0.5, 0.5), "nog": (0, 1, 0), "asym": (1, 0.5, 0.5)}


def field(xp: Any, t: Any, y: Any, law: str, body: tuple[Any, ...]) -> Any:
    """The time derivative of (R, x, V, R_d, x_d, V_d), V = (ω, v) in the body frame."""
    I, I_inverse, K, K_d = body
    R, x, V = y[:9].reshape(3, 3), y[9:12], y[12:18]
    R_d, x_d, V_d = y[18:27].reshape(3, 3), y[27:30], y[30:36]
    tau_d = xp.array(
        [
            0.03 * xp.cos(t),
            0.03 * xp.sin(t),
            0.03 * xp.cos(t) * xp.sin(t),
            0.3 * xp.cos(t),
            0.3 * xp.cos(t / 2),
            0.3 * xp.sin(2 * t),
        ]
    )
    R_E = R @ R_d.T
    x_E = x - R_E @ x_d
    A = K[:3, :3] @ R_E - R_E.T @ K[:3, :3]
    gradient = xp.concatenate([xp.array([A[2, 1], A[0, 2], A[1, 0]]), K[3, 3] * R_E.T @ x_E])
    g, c, n = WEIGHTS[law]
    error = V - V_d
    feedforward = (
        -g * _ad_star(xp, error, I @ V_d)
        - c * _ad_star(xp, V_d, I @ error)
        + n * I @ _ad(xp, V, V_d)
    )
    spatial = law != "gt"
    E = _Ad(xp, R_d, x_d, error) if spatial else error
    damping = _Ad_star(xp, R_d, x_d, K_d @ E) if spatial else K_d @ E
    tau = tau_d + feedforward - damping - _Ad_star(xp, R_d, x_d, gradient)
    return xp.concatenate(
        [
            (R @ _skew(xp, V[:3])).reshape(-1),
            R @ V[3:],
            I_inverse @ (_ad_star(xp, V, I @ V) + tau),
            (R_d @ _skew(xp, V_d[:3])).reshape(-1),
            R_d @ V_d[3:],
            I_inverse @ (_ad_star(xp, V_d, I @ V_d) + tau_d),
        ]
    )


def _ad(xp: Any, V: Any, U: Any) -> Any:
    turn = xp.cross(V[:3], U[:3])
    return xp.concatenate([turn, xp.cross(V[:3], U[3:]) + xp.cross(V[3:], U[:3])])


def _ad_star(xp: Any, V: Any, P: Any) -> Any:
    turn = xp.cross(P[:3], V[:3]) + xp.cross(P[3:], V[3:])
    return xp.concatenate([turn, xp.cross(P[3:], V[:3])])


def _Ad(xp: Any, R: Any, x: Any, V: Any) -> Any:
    return xp.concatenate([R @ V[:3], R @ V[3:] + xp.cross(x, R @ V[:3])])


def _Ad_star(xp: Any, R: Any, x: Any, P: Any) -> Any:
    return xp.concatenate([R.T @ (P[:3] - xp.cross(x, P[3:])), R.T @ P[3:]])


def _skew(xp: Any, w: Any) -> Any:
    return xp.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])


def start(Q: Any, V: Any, Q_d: Any, V_d: Any) -> Any:
    """The initial value."""
    parts = [Q[:3, :3].ravel(), Q[:3, 3], V, Q_d[:3, :3].ravel(), Q_d[:3, 3], V_d]
    return np.concatenate(parts)


def motion(y: Any) -> tuple[Any, Any]:
    """Q and V in values ``(..., 36)``."""
    Q = np.zeros((*y.shape[:-1], 4, 4))
    Q[..., 3, 3] = 1.0
    Q[..., :3, :3] = y[..., :9].reshape(*y.shape[:-1], 3, 3)
    Q[..., :3, 3] = y[..., 9:12]
    return Q, y[..., 12:18]
