"""The control of Theorem 6.2, computed through G ⋉ g*, is the law EqT of the body frame."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from eqt_cli.analysis.certificates.base import Identity
from eqt_cli.analysis.certificates.family_members import is_member
from eqt_cli.analysis.certificates.sample import Sample
from eqt_cli.analysis.certificates.theorem_6_2 import tracking_control
from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.core.arrays import Array


class EquivariantControl(Identity):
    """τ_d + Ad^τ_{X_d⁻¹}(V_E, τ_E) is the torque of (g, c, n) = (1, 1, 0) with spatial damping."""

    name: ClassVar[str] = "control through G ⋉ g*"
    statement: ClassVar[str] = "Theorem 6.2, eq. (20), (22)"
    section: ClassVar[float] = 6.2
    per_law: ClassVar[bool] = True

    def applies(self, loop: ClosedLoop) -> bool:
        """To EqT, under whatever name."""
        return is_member(loop.controller, 1.0, 1.0, 0.0, "spatial")

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The controller's torque against the theorem's."""
        yield sample.loop.command(sample.s), tracking_control(sample.s)
