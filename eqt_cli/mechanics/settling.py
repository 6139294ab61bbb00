"""How far a pose is from the desired one where every part of the group has its own threshold."""

from collections.abc import Mapping
from functools import reduce

from eqt_cli.core.arrays import Array, frobenius, maximum
from eqt_cli.groups import MatrixLieGroup, Part
from eqt_cli.groups.angles import distance_of_turn


def settling_error(
    G: MatrixLieGroup, Q: Array, Qd: Array, thresholds: Mapping[str, float]
) -> Array:
    """max_i ‖(Q − Q_d)_i‖_F / s_i over the parts i with a threshold; settled where at most 1.

    Of a translation it is ‖p − p_d‖, and of a rotation ‖R − R_d‖_F = 2√2 sin(θ/2) with the angle θ
    of the error: no choice of the spatial frame changes them, as it does p − R_E p_d in Q_E.

    Parameters
    ----------
    thresholds
        By the names of parts: the angle of a rotation, rad, and the distance of all else.
    """
    parts = [part for part in G.parts if part.name in thresholds]
    shares = [
        frobenius((Q - Qd)[(..., *part.entries)]) / as_distance(part, thresholds[part.name])
        for part in parts
    ]
    return reduce(maximum, shares)


def as_distance(part: Part, threshold: float) -> float:
    """The threshold of a part as a distance in the matrix of the pose."""
    return distance_of_turn(threshold) if part.turns else threshold
