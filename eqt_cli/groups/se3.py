"""SE(3), the rigid motions of space (Hampsey et al. (2025), Remark 6.3)."""

from eqt_cli.groups.euclidean import EuclideanGroup
from eqt_cli.groups.so3 import SO3


class SE3(EuclideanGroup):
    """Rigid motions of space; V = (ω, v), angular before linear velocity, in the body frame."""

    name = "SE3"
    space = 3
    columns = ("position",)
    rates = ("v",)
    column_units = ("m",)
    force_units = ("N",)
    rotation_group = SO3()
