"""A plain program of a rigid body with a push along one axis, for laws that are written by hand."""

import numpy as np
from scipy.integrate import solve_ivp

GRAVITY = 9.81
TIGHT = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14}


def hat(w):
    """ω^."""
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def of_heading(F, psi, up=1.0):
    """The attitude with its third axis along ±F, and the first in the plane of F and heading."""
    b3 = up * F / np.linalg.norm(F)
    b2 = np.cross(b3, [np.cos(psi), np.sin(psi), 0.0])
    b2 /= np.linalg.norm(b2)
    return np.column_stack([np.cross(b2, b3), b2, b3])


def flown(law, p, v, R, w, *, period, steps, J, mass, axis, inner=None, x=(), pulls=None):
    """Return p, v, R and ω at each period, ``(steps + 1, 18)``; `law` is called at its begin.

    Parameters
    ----------
    law
        Function of t, p, v, R and ω: the command, of three numbers and a push.
    inner
        Function of command, ω and own states x: torque and push, and the rates of x.
    pulls
        Force in space by t, p and v; default: weight, along −axis.
    """
    J, axis = np.asarray(J, float), np.asarray(axis, float)
    down = -axis * GRAVITY * mass
    state = np.concatenate([p, v, np.ravel(R), w, x])
    states = [state]
    for k in range(steps):
        p, v, R, w = state[:3], state[3:6], state[6:15].reshape(3, 3), state[15:18]
        command = law(k * period, p, v, R, w)

        def field(t, y, command=command):
            v, R, w = y[3:6], y[6:15].reshape(3, 3), y[15:18]
            wrench, rates = (command, np.zeros(0)) if inner is None else inner(command, w, y[18:])
            force = down if pulls is None else pulls(t, y[:3], v)
            rate = (wrench[:3] - np.cross(w, J * w)) / J
            pushed = (R @ (wrench[3] * axis) + force) / mass
            return np.concatenate([v, pushed, np.ravel(R @ hat(w)), rate, rates])

        state = solve_ivp(field, (k * period, (k + 1) * period), state, **TIGHT).y[:, -1]
        states.append(state)
    return np.array(states)[:, :18]


def start_of(problem):
    """p, v, R and ω of the first run of a problem at its start."""
    return rows_of(problem, problem.initial_states[:1])[0]


def rows_of(problem, states):
    """p, v, R and ω at flat states, ``(n, 18)``."""
    loop = problem.loop
    s = loop.tracking(0.0, states)
    R = s.Q[..., :3, :3]
    v = (R @ s.V[..., 3:, None])[..., 0]
    parts = [s.Q[..., :3, 3], v, R.reshape(*R.shape[:-2], 9), s.V[..., :3]]
    return np.concatenate(parts, axis=-1)


def parts_of(row):
    """p, v, R and ω of a row."""
    return row[:3], row[3:6], row[6:15].reshape(3, 3), row[15:18]
