"""SE(3), the rigid motions of space (Hampsey et al. (2025), Remark 6.3)."""

from typing import ClassVar

from eqt_cli.groups.euclidean import EuclideanGroup


class SE3(EuclideanGroup):
    """Rigid motions of space; V = (ω, v), angular before linear velocity, in the body frame."""

    name: ClassVar[str] = "SE3"
    space: ClassVar[int] = 3
    columns: ClassVar[tuple[str, ...]] = ("position",)
    column_units: ClassVar[tuple[str, ...]] = ("m",)
    force_units: ClassVar[tuple[str, ...]] = ("N",)
