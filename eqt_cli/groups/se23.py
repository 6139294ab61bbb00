"""SE_2(3), the extended poses [R v p] (Hampsey et al. (2025), Remark 6.3)."""

from eqt_cli.groups.euclidean import EuclideanGroup


class SE23(EuclideanGroup):
    """Extended poses of space, [R v p]; V = (ω, a, v) drives rotation, velocity and position."""

    name = "SE23"
    space = 3
    columns = ("velocity", "position")
    rates = ("a", "v")
    column_units = ("m/s", "m")
    force_units = ("N s", "N")
