"""SO(3), the rotations of space (Hampsey et al. (2025), Example 3.1)."""

from eqt_cli.groups.euclidean import EuclideanGroup


class SO3(EuclideanGroup):
    """Rotations of space; V is the body angular velocity ω."""

    name = "SO3"
    space = 3
