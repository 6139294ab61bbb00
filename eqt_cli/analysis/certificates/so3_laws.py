"""The laws of §7 on SO(3) for a constant inertia, as the paper writes them, with cross products."""

from abc import abstractmethod
from typing import Any, ClassVar

from eqt_cli.analysis.certificates.stabilisation import RigidBodyForm, vee
from eqt_cli.analysis.certificates.tracking_laws import MemberForm
from eqt_cli.core.arrays import Array, apply_matrix, cross, transpose
from eqt_cli.mechanics.tracking import Tracking


class Rigid:
    """A rigid body and its reference, in the symbols of §7."""

    def __init__(self, s: Tracking) -> None:
        self.w, self.wd, self.w_, self.taud = s.V, s.Vd, s.V - s.Vd, s.tau_d
        self.momentum = s.inertia.momentum  # 𝕀ω
        R_E, Rd_T = s.Q @ transpose(s.Qd), transpose(s.Qd)
        asymmetric = s.gains.K @ R_E - transpose(R_E) @ transpose(s.gains.K)
        self.proportional = apply_matrix(Rd_T, vee(asymmetric))
        self.spatial_damping = apply_matrix(Rd_T @ s.gains.K_d @ s.Qd, self.w_)
        self.body_damping = apply_matrix(s.gains.K_d, self.w_)
        self.transport = cross(self.wd, self.momentum(self.w_))  # ω_d × 𝕀ω̃
        self.gyroscopic = cross(self.w_, self.momentum(self.wd))  # ω̃ × 𝕀ω_d
        self.connection = self.momentum(cross(self.w, self.wd))  # 𝕀(ω × ω_d)


class SO3Law(RigidBodyForm, MemberForm):
    """A law of §7 against the paper's formula."""

    def torque(self, s: Tracking, law: Any) -> Array:
        """The formula, in the symbols of §7."""
        return self.of(Rigid(s))

    @abstractmethod
    def of(self, b: Rigid) -> Array:
        """The paper's formula."""


class SO3EqT(SO3Law):
    """τ_d + ω̃ × 𝕀ω_d + ω_d × 𝕀ω̃ − R_dᵀK_dR_d ω̃ − R_dᵀ(K_pR_E − R_EᵀK_pᵀ)^∨."""

    name: ClassVar[str] = "EqT on SO(3)"
    statement: ClassVar[str] = "eq. (23)"
    section: ClassVar[float] = 7.1
    law: ClassVar[str] = "eqt"

    def of(self, b: Rigid) -> Array:
        """The sum of its terms."""
        return b.taud + b.gyroscopic + b.transport - b.spatial_damping - b.proportional


class SO3GT(SO3Law):
    """τ_d + ½𝕀(ω × ω_d) + ½ω × 𝕀ω_d + ½ω_d × 𝕀ω − ω_d × 𝕀ω_d − K_d ω̃ − proportional term."""

    name: ClassVar[str] = "GT on SO(3)"
    statement: ClassVar[str] = "eq. (24)"
    section: ClassVar[float] = 7.2
    law: ClassVar[str] = "gt"

    def of(self, b: Rigid) -> Array:
        """The sum of its terms."""
        return (
            b.taud
            + b.connection / 2
            + cross(b.w, b.momentum(b.wd)) / 2
            + cross(b.wd, b.momentum(b.w)) / 2
            - cross(b.wd, b.momentum(b.wd))
            - b.body_damping
            - b.proportional
        )


class SO3NoG(SO3Law):
    """τ_d + ω_d × 𝕀ω̃ − R_dᵀK_dR_d ω̃ − proportional term."""

    name: ClassVar[str] = "nog on SO(3)"
    statement: ClassVar[str] = "§7, τ^nog"
    section: ClassVar[float] = 7.5
    law: ClassVar[str] = "nog"

    def of(self, b: Rigid) -> Array:
        """The sum of its terms."""
        return b.taud + b.transport - b.spatial_damping - b.proportional


class SO3Asym(SO3Law):
    """τ_d + ω̃ × 𝕀ω_d + ½ω_d × 𝕀ω̃ + ½𝕀(ω × ω_d) − R_dᵀK_dR_d ω̃ − proportional term."""

    name: ClassVar[str] = "asym on SO(3)"
    statement: ClassVar[str] = "§7, τ^asym"
    section: ClassVar[float] = 7.6
    law: ClassVar[str] = "asym"

    def of(self, b: Rigid) -> Array:
        """The sum of its terms."""
        return (
            b.taud
            + b.gyroscopic
            + b.transport / 2
            + b.connection / 2
            - b.spatial_damping
            - b.proportional
        )
