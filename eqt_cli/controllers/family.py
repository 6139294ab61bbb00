"""The family of stabilising tracking laws τ(g, c, n), written once for every group."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import ClassVar, Literal

from eqt_cli.controllers.base import Controller
from eqt_cli.core.arrays import Array, dot
from eqt_cli.core.numbers import Real
from eqt_cli.mechanics.tracking import Tracking


@dataclass(frozen=True)
class Family(Controller):
    """The (g, c, n) family, which holds the paper's four laws as single points.

    τ = τ_d − g·ad*_Ṽ 𝕀V_d − c·ad*_{V_d} 𝕀Ṽ + n·𝕀 ad_V V_d − damping − Ad*_{Q_d} L*_{Q_E}dΥ(Q_E)

    and, where the inertia varies by itself, + Ṡ*S⁻* 𝕀Ṽ (Theorem 3.2);
    with damping Ad*_{Q_d} K_d Ad_{Q_d} Ṽ (spatial) or K_d Ṽ (body). All members with c + n = 1
    change L = ½⟨𝕀Ṽ, Ṽ⟩ + Υ(Q_E) at the same rate, −⟨K_d V_E, V_E⟩ or −⟨K_d Ṽ, Ṽ⟩: the g-term is
    gyroscopic, and the c- and n-terms have the same power on every group. Generalises Hampsey et
    al. (2025), eq. (22), (23), (24) and the two laws after them.

    Attributes
    ----------
    gyroscopic
        g, the weight of −ad*_Ṽ 𝕀V_d.
    transport
        c, the weight of −ad*_{V_d} 𝕀Ṽ.
    connection
        n, the weight of 𝕀 ad_V V_d.
    damping
        The frame in which the Rayleigh tensor K_d is given.
    """

    name: ClassVar[str] = "family"
    title: ClassVar[str] = "family"

    gyroscopic: Real = 1.0
    transport: Real = 1.0
    connection: Real = 0.0
    damping: Literal["spatial", "body"] = "spatial"
    spatial: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        # The frame as a number, so that one compiled law serves the whole family.
        object.__setattr__(self, "spatial", 1.0 if self.damping == "spatial" else 0.0)

    @property
    def structure(self) -> Hashable:
        """The same for all members, which numbers tell apart; a law built on one has its own."""
        own = type(self)
        inherited = own.torque is Family.torque and own.dissipation is Family.dissipation
        return Family if inherited else super().structure

    @property
    def claims_decrease(self) -> bool | None:
        """On the plane c + n = 1, where the two terms make up for the moving reference."""
        return abs(self.transport + self.connection - 1) <= 1e-12  # rounding of 0.1 + 0.9

    def torque(self, s: Tracking) -> Array:
        """τ(g, c, n), body frame."""
        G = s.G
        feedforward = (
            s.tau_d
            - self.gyroscopic * G.ad_star(s.V_tilde, s.Pd)
            - self.transport * G.ad_star(s.Vd, s.P_tilde)
            + self.connection * s.inertia.momentum(G.ad(s.V, s.Vd))
            + s.inertia_force
        )
        spatial_force = s.gradient + self.spatial * s.spatial_damping
        body_force = (1 - self.spatial) * s.body_damping
        return feedforward - body_force - G.Ad_star(s.Qd, spatial_force)

    def dissipation(self, s: Tracking) -> Array | None:
        """⟨K_d V_E, V_E⟩ or ⟨K_d Ṽ, Ṽ⟩, and off the plane c + n = 1 also what its terms add."""
        off_plane = 1 - self.transport - self.connection
        return (
            dot(self.spatial * s.spatial_damping, s.V_E)
            + dot((1 - self.spatial) * s.body_damping, s.V_tilde)
            + dot(off_plane * s.P_tilde, s.G.ad(s.V, s.Vd))
        )
