"""What the laws of §7 on SO(3) are made of, written as the paper does, with cross products."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from typing import ClassVar, Literal

from eqt_cli.analysis.certificates.base import Identity
from eqt_cli.analysis.certificates.cross_product import cross, is_rotations_of_space, vee
from eqt_cli.analysis.certificates.family_members import is_member
from eqt_cli.analysis.certificates.sample import Sample
from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.core.arrays import Array, apply_matrix, transpose
from eqt_cli.mechanics.inertia import Inertia
from eqt_cli.mechanics.tracking import Tracking


class Rigid:
    """A rigid body and its reference, in the symbols of §7."""

    def __init__(self, s: Tracking) -> None:
        self.w, self.wd, self.w_, self.taud = s.V, s.Vd, s.V - s.Vd, s.tau_d
        self._I, self._K_d = s.inertia.matrix, s.gains.K_d
        R_E = s.Q @ transpose(s.Qd)
        Rd_T = transpose(s.Qd)
        asymmetric = s.gains.K @ R_E - transpose(R_E) @ transpose(s.gains.K)
        self.proportional = apply_matrix(Rd_T, vee(asymmetric))
        self.spatial_damping = apply_matrix(Rd_T @ s.gains.K_d @ s.Qd, self.w_)
        self.body_damping = apply_matrix(s.gains.K_d, self.w_)

    def momentum(self, w: Array) -> Array:
        """𝕀ω."""
        return apply_matrix(self._I, w)

    def transport(self) -> Array:
        """ω_d × 𝕀ω̃."""
        return cross(self.wd, self.momentum(self.w_))

    def gyroscopic(self) -> Array:
        """ω̃ × 𝕀ω_d."""
        return cross(self.w_, self.momentum(self.wd))

    def connection(self) -> Array:
        """𝕀(ω × ω_d)."""
        return self.momentum(cross(self.w, self.wd))


class SO3Law(Identity):
    """A law of §7 against the paper's formula; `member` says which point of the family it is."""

    per_law: ClassVar[bool] = True
    member: ClassVar[tuple[float, float, float, Literal["spatial", "body"]]]

    def applies(self, loop: ClosedLoop) -> bool:
        """To this law on SO(3), with the constant inertia of §7."""
        constant = isinstance(loop.inertia, Inertia)
        return (
            constant
            and is_rotations_of_space(loop.group)
            and is_member(loop.controller, *self.member)
        )

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The controller's torque against the formula."""
        yield sample.loop.command(sample.s), self.torque(Rigid(sample.s))

    @abstractmethod
    def torque(self, b: Rigid) -> Array:
        """The paper's formula."""
