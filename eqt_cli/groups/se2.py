"""SE(2), the rigid motions of the plane (Hampsey et al. (2025), Remark 6.3)."""

from typing import ClassVar

from eqt_cli.groups.euclidean import EuclideanGroup


class SE2(EuclideanGroup):
    """Rigid motions of the plane; V = (ω, v), angular before linear velocity, in the body frame."""

    name: ClassVar[str] = "SE2"
    space: ClassVar[int] = 2
    columns: ClassVar[tuple[str, ...]] = ("position",)
    column_units: ClassVar[tuple[str, ...]] = ("m",)
    force_units: ClassVar[tuple[str, ...]] = ("N",)
