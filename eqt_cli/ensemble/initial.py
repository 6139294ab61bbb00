"""The initial states of an ensemble's runs."""

from collections.abc import Iterable

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.ensemble.poses import PoseDistribution
from eqt_cli.ensemble.seeds import Stream, generator
from eqt_cli.ensemble.velocities import VelocityDistribution
from eqt_cli.groups import MatrixLieGroup


def draw_initial_states(
    G: MatrixLieGroup,
    poses: PoseDistribution,
    velocities: VelocityDistribution,
    *,
    Qd: Array,
    Vd: Array,
    seed: int,
    runs: Iterable[int],
) -> tuple[Array, Array]:
    """Return Q(0) = Q_d(0)·draw and V(0) = V_d(0) + draw for each run.

    The pose is drawn before the velocity, both from the stream of the run.

    Returns
    -------
    poses : (runs, d, d)
    velocities : (runs, m)
    """
    pose_numbers, velocity_errors = [], []
    for run in runs:
        random = generator(seed, Stream.INITIAL_STATE, run)
        pose_numbers.append(poses.draw_of_run(G, random, run))
        velocity_errors.append(velocities.draw_of_run(G, random, run))
    return Qd @ poses.place(G, np.array(pose_numbers)), Vd + np.array(velocity_errors)
