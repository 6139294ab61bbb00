"""SO(2), the rotations of the plane (Hampsey et al. (2025), Remark 6.3)."""

from eqt_cli.groups.euclidean import EuclideanGroup


class SO2(EuclideanGroup):
    """Rotations of the plane; V is the angular velocity."""

    name = "SO2"
    space = 2
