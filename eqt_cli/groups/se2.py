"""SE(2), the rigid motions of the plane (Hampsey et al. (2025), Remark 6.3)."""

from eqt_cli.groups.euclidean import EuclideanGroup
from eqt_cli.groups.so2 import SO2


class SE2(EuclideanGroup):
    """Rigid motions of the plane; V = (ω, v), angular before linear velocity, in the body frame."""

    name = "SE2"
    space = 2
    columns = ("position",)
    rates = ("v",)
    column_units = ("m",)
    force_units = ("N",)
    rotation_group = SO2()
