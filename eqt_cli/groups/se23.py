"""SE_2(3), the extended poses [R v p] (Hampsey et al. (2025), Remark 6.3)."""

from typing import ClassVar

from eqt_cli.groups.euclidean import EuclideanGroup


class SE23(EuclideanGroup):
    """Extended poses of space, [R v p]; V = (ω, a, v) drives rotation, velocity and position."""

    name: ClassVar[str] = "SE23"
    space: ClassVar[int] = 3
    columns: ClassVar[tuple[str, ...]] = ("velocity", "position")
    column_units: ClassVar[tuple[str, ...]] = ("m/s", "m")
    force_units: ClassVar[tuple[str, ...]] = ("N s", "N")
