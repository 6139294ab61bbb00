"""Starts as they are drawn, from a desired pose and velocity."""

import numpy as np

from eqt_cli.config.experiment import Start


def draw_initial_states(G, poses, velocities, *, Qd, Vd, seed, runs):
    """Q(0) = Q_d(0)·draw and V(0) = V_d(0) + draw of each run, by NumPy."""
    start = Start(poses, velocities, {})
    numbers, errors = zip(*(start.numbers(G, seed, run) for run in runs), strict=True)
    return Qd @ poses.place(G, np.array(numbers)), Vd + np.array(errors)
