"""SO(3), the rotations of space (Hampsey et al. (2025), Example 3.1)."""

from typing import ClassVar

from eqt_cli.groups.euclidean import EuclideanGroup


class SO3(EuclideanGroup):
    """Rotations of space; V is the body angular velocity ω."""

    name: ClassVar[str] = "SO3"
    space: ClassVar[int] = 3
