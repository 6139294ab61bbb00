"""The distance of a pose from the desired one, relative to a threshold for each part."""

from collections.abc import Mapping
from functools import reduce

from eqt_cli.core.arrays import Array, frobenius, maximum
from eqt_cli.groups import MatrixLieGroup, Part
from eqt_cli.groups.rotations import distance_of_turn


def settling_error(
    G: MatrixLieGroup, Q: Array, Qd: Array, thresholds: Mapping[str, float]
) -> Array:
    """Return max_i ‖(Q − Q_d)_i‖_F / s_i over the parts i with a threshold; at most 1 if settled.

    For a translation this is ‖p − p_d‖, for a rotation ‖R − R_d‖_F = 2√2 sin(θ/2) with the angle θ
    of the error. Unlike p − R_E p_d in Q_E, both do not depend on the choice of the spatial frame.

    Parameters
    ----------
    thresholds
        Thresholds by the names of parts: an angle, rad, for a rotation, a distance for other parts.
    """
    parts = [part for part in G.parts if part.name in thresholds]
    shares = [
        frobenius((Q - Qd)[(..., *part.entries)]) / as_distance(part, thresholds[part.name])
        for part in parts
    ]
    return reduce(maximum, shares)


def as_distance(part: Part, threshold: float) -> float:
    """Return the threshold of a part as a distance in the matrix of the pose."""
    return distance_of_turn(threshold) if part.turns else threshold
