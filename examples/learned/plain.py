"""The published law as its code has it, and mended, in a plain program: why its means are bad.

It shares nothing with eqt. 1,000 curves of their own, a start each; semi-implicit Euler at 100 Hz.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

RUNS, PERIOD, STEPS, SUBSTEPS = 1000, 0.02, 500, 2
MASS, FALL = 0.8, np.array([0.0, 0.0, 9.81])
J = np.array([[3063.0, 4.0, 0.0], [4.0, 1720.0, 28.0], [0.0, 28.0, 4585.0]]) * 1e-6
TURN = np.linalg.inv(J)
MOST = np.array([0.5, 0.5, 0.025])
KX, KV = np.array([44.142, 44.142, 26.112]), np.array([4.255, 4.255, 11.824])
KR, KW = np.array([710.390, 710.390, 17.223]), np.array([34.800, 34.800, 9.672])
SMALL = 1e-3  # s, over which R_c is differentiated

random = np.random.default_rng(5)


def uniform(*ends: float) -> Any:
    """Return numbers of all runs."""
    return random.uniform(-1, 1, (RUNS, len(ends))) * ends


A, W, F, C = (
    uniform(2, 2, 2, 2),
    uniform(3, 3, 3, 2),
    uniform(np.pi, np.pi, np.pi, np.pi),
    uniform(0.5, 0.5, 0.5, np.pi),
)
START = uniform(np.pi, 0.5, 0.5, 0.5, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1)


def curve(t: float, order: int = 0) -> Any:
    """Return a derivative of x, y, z and ψ."""
    wave = A * W**order * np.sin(W * t + F + order * np.pi / 2)
    return wave if order else wave + C


def hat(w: Any) -> Any:
    """Return ω^."""
    return np.cross(np.eye(3), w[:, None])  # its rows are e_i × ω


def vee(S: Any) -> Any:
    """Return the three entries that a skew matrix has."""
    return np.stack([S[:, 2, 1], S[:, 0, 2], S[:, 1, 0]], -1)


def of(M: Any, v: Any) -> Any:
    """Return M v."""
    return np.einsum("nij,nj->ni", M, v)


def along(a: Any, b: Any) -> Any:
    """Return a·b."""
    return (a * b).sum(1, keepdims=True)


def about_vertical(psi: Any) -> Any:
    """Return the rotation about the vertical."""
    c, s, o = np.cos(psi), np.sin(psi), 0 * psi
    return np.moveaxis(np.array([[c, -s, o], [s, c, o], [o, o, o + 1]]), -1, 0)


def tilted(F: Any) -> Any:
    """Return the shortest turn of the vertical to a direction, H₂ of the paper's reference."""
    x, y, z = (F / np.linalg.norm(F, axis=1, keepdims=True)).T
    d = 1 + z
    rows = [[1 - x * x / d, -x * y / d, x], [-x * y / d, 1 - y * y / d, y], [-x, -y, z]]
    return np.moveaxis(np.array(rows), -1, 0)


def law(t: float, p: Any, R: Any, v: Any, w: Any, differences: bool, as_code: bool) -> Any:
    """Return thrust and torques."""
    rows = [curve(t + k * PERIOD) for k in range(5)]
    known = [curve(t, k) for k in range(5)]
    for k in range(1, 5) if differences else ():
        rows = [(b - a) / PERIOD for a, b in pairwise(rows)]
        known[k] = rows[0]
    x, xv, xa, xj, xs = (each[:, :3] for each in known)
    psi, psi_1, psi_2 = (each[:, 3] for each in known[:3])
    s, moved = R[:, :, 2], (R @ hat(w))[:, :, 2]
    F = -KX * (p - x) - KV * (v - xv) + xa + FALL
    thrust = along(s, F)
    acceleration = thrust * s - FALL
    F_1 = -KX * (v - xv) - KV * (acceleration - xa) + xj
    # The rate of (s·F) s has three terms; the code has the first along the wrong vector, and two.
    jerk = along(moved, F) * moved + along(s, F_1) * s
    if not as_code:
        jerk = (along(moved, F) + along(s, F_1)) * s + thrust * moved
    F_2 = -KX * (acceleration - xa) - KV * (jerk - xj) + xs

    def commanded(h: float) -> Any:
        heading = psi + psi_1 * h + psi_2 * h * h / 2
        return tilted(F + F_1 * h + F_2 * h * h / 2) @ about_vertical(heading)

    before, Rc, after = (commanded(h) for h in (-SMALL, 0.0, SMALL))
    first, second = (after - before) / (2 * SMALL), (after - 2 * Rc + before) / SMALL**2
    back = (R if as_code else Rc).swapaxes(1, 2)  # the code has R where R_c belongs
    spin = back @ first
    rate, change = vee(spin), vee(back @ second - spin @ spin)
    E = R.swapaxes(1, 2) @ Rc
    carried = of(E, rate)
    error = vee(0.5 * (E.swapaxes(1, 2) - E))
    asked = -KR * error - KW * (w - (rate if as_code else carried))
    asked += of(E, change) - np.cross(w, carried)
    torque = asked @ J + np.cross(w, w @ J)
    return np.clip(MASS * thrust, 0, 3 * MASS * 9.81), np.clip(torque, -MOST, MOST)


def flown(differences: bool, as_code: bool) -> None:
    """Fly, and print."""
    now, rate = curve(0), curve(0, 1)
    p, v, w = now[:, :3] + START[:, 1:4], rate[:, :3] + START[:, 4:7], START[:, 7:]
    R = about_vertical(now[:, 3] + START[:, 0])
    errors, yaws, rewards, h = [], [], [], PERIOD / SUBSTEPS
    for k in range(STEPS):
        thrust, torque = law(k * PERIOD, p, R, v, w, differences, as_code)
        for _ in range(SUBSTEPS):
            v = v + h * (thrust / MASS * R[:, :, 2] - FALL)
            w = w + h * (torque - np.cross(w, w @ J)) @ TURN
            w = np.clip(w, -100, 100)  # of runs that are lost
            p = p + h * v
            angle = np.linalg.norm(w, axis=1, keepdims=True) + 1e-12
            K, turn = hat(w / angle), (h * angle)[..., None]
            R = R @ (np.eye(3) + np.sin(turn) * K + (1 - np.cos(turn)) * K @ K)
        t = (k + 1) * PERIOD
        now, rate = curve(t), curve(t, 1)
        c, s = np.cos(now[:, 3]), np.sin(now[:, 3])
        x, y = R[:, 0, 1], R[:, 1, 1]
        yaw = np.abs(np.arctan2(c * x + s * y, c * y - s * x))
        e = np.linalg.norm(p - now[:, :3], axis=1)
        slow = 0.05 * np.linalg.norm(v - rate[:, :3], axis=1)
        slow += 0.01 * np.linalg.norm(w - R[:, 2] * rate[:, 3:], axis=1)
        near = np.exp([-e * e / 0.1, -e / 0.1, -e * e / 0.8])  # code, text, code at its first δ
        errors.append(e)
        yaws.append(yaw)
        rewards.append(15 * near - 4 * yaw - slow)
    e, yaw, reward = map(np.array, (errors, yaws, rewards))
    rms, steady, reward = np.sqrt((e * e).mean(0)), e[-100:].mean(0), reward.mean(0)
    text, wide = reward[1:].mean(1)
    reward = reward[0]
    print(
        f"{'forward differences' if differences else 'exact derivatives'}, "
        f"{'rates as in the code' if as_code else 'exact rates'}: "
        f"reward {reward.mean():.2f} ± {reward.std():.2f}, as in the text {text:.2f}, "
        f"with δ = 0.8 {wide:.2f}, "
        f"yaw {np.sqrt((yaw * yaw).mean(0)).mean():.3f}, "
        f"position {rms.mean():.3f} ± {rms.std():.2f}, median {np.median(rms):.3f}, "
        f"steady {1e3 * np.median(steady):.1f} mm, lost {(steady > 0.5).sum()}"
    )


if __name__ == "__main__":
    for as_code in (True, False):
        for differences in (True, False):
            flown(differences, as_code)
