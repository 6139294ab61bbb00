"""Attitude: the paper's section 7, eq. (23), (24) and the two laws after them, with its torque."""

from __future__ import annotations

from typing import Any

import numpy as np


def field(xp: Any, t: Any, y: Any, law: str, body: tuple[Any, ...]) -> Any:
    """The time derivative of (R, ω, R_d, ω_d)."""
    return motion_rate(xp, t, y, torque(xp, t, y, law, body), body)


def torque(xp: Any, t: Any, y: Any, law: str, body: tuple[Any, ...]) -> Any:
    """What a law asks for."""
    I, _, K_p, K_d = body
    R, w, R_d, w_d = _split(y)
    R_E = R @ R_d.T
    A = K_p @ R_E - R_E.T @ K_p.T
    proportional = R_d.T @ xp.array([A[2, 1], A[0, 2], A[1, 0]])
    error = w - w_d
    if law == "eqt":  # eq. (23)
        feedforward = xp.cross(error, I @ w_d) + xp.cross(w_d, I @ error)
    elif law == "gt":  # eq. (24)
        feedforward = (
            I @ xp.cross(w, w_d) / 2
            + xp.cross(w, I @ w_d) / 2
            + xp.cross(w_d, I @ w) / 2
            - xp.cross(w_d, I @ w_d)
        )
    elif law == "nog":
        feedforward = xp.cross(w_d, I @ error)
    elif law == "asym":
        feedforward = (
            xp.cross(error, I @ w_d) + xp.cross(w_d, I @ error) / 2 + I @ xp.cross(w, w_d) / 2
        )
    damping = K_d @ error if law == "gt" else R_d.T @ K_d @ R_d @ error
    return _desired_torque(xp, t) + feedforward - damping - proportional


def motion_rate(xp: Any, t: Any, y: Any, tau: Any, body: tuple[Any, ...]) -> Any:
    """The time derivative of (R, ω, R_d, ω_d) under a torque."""
    I, I_inverse, *_ = body
    R, w, R_d, w_d = _split(y)
    return xp.concatenate(
        [
            (R @ _skew(xp, w)).reshape(-1),
            I_inverse @ (xp.cross(I @ w, w) + tau),
            (R_d @ _skew(xp, w_d)).reshape(-1),
            I_inverse @ (xp.cross(I @ w_d, w_d) + _desired_torque(xp, t)),
        ]
    )


def _split(y: Any) -> tuple[Any, ...]:
    return y[:9].reshape(3, 3), y[9:12], y[12:21].reshape(3, 3), y[21:24]


def _desired_torque(xp: Any, t: Any) -> Any:
    return xp.array([xp.cos(t), xp.sin(t), xp.cos(t) * xp.sin(t)])


def _skew(xp: Any, w: Any) -> Any:
    return xp.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])


def start(Q: Any, V: Any, Q_d: Any, V_d: Any) -> Any:
    """The initial value."""
    return np.concatenate([Q.ravel(), V, Q_d.ravel(), V_d])


def motion(y: Any) -> tuple[Any, Any]:
    """R and ω in values ``(..., 24)``."""
    return y[..., :9].reshape(*y.shape[:-1], 3, 3), y[..., 9:12]
