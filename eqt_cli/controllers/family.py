"""The family of stabilising tracking laws τ(g, c, n, q), for every group."""

from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Literal

from eqt_cli.controllers.base import Controller
from eqt_cli.core.arrays import Array, dot
from eqt_cli.core.option_types import Real, Scale
from eqt_cli.mechanics.tracking import Tracking

Frame = Literal["spatial", "body"]

BODY_ENERGY = "½⟨𝕀e, e⟩ + Υ(Q_L)"
"""L of a law in the errors Q_L = Q_d⁻¹Q and e = V − Ad_{Q_L⁻¹}V_d."""


@dataclass(frozen=True)
class Family(Controller):
    """The (g, c, n, q) family: the paper's four laws and three classics are points of it.

    τ = τ_d − g·ad*_Ṽ 𝕀V_d − c·ad*_{V_d} 𝕀Ṽ + n·𝕀 ad_V V_d − q·ad*_Ṽ 𝕀Ṽ − damping
    − Ad*_{Q_d} L*_{Q_E}dΥ(Q_E)

    and, where the inertia varies, + Ṡ*S⁻* 𝕀Ṽ (Theorem 3.2); with damping
    Ad*_{Q_d} K_d Ad_{Q_d} Ṽ (spatial) or K_d Ṽ (body). All members with c + n = 1 change
    L = ½⟨𝕀Ṽ, Ṽ⟩ + Υ(Q_E) at the same rate, −⟨K_d V_E, V_E⟩ or −⟨K_d Ṽ, Ṽ⟩: the g- and q-terms
    are gyroscopic, and the c- and n-terms have the same power on every group. Generalises Hampsey
    et al. (2025), eq. (22), (23), (24) and the two laws after them.

    With the error in the body frame, the same formula holds with V_d replaced by ξ = Ad_{Q_L⁻¹}V_d,
    Ṽ by e = V − ξ, τ_d by τ_ξ = 𝕀ξ̇ + 𝕀̇ξ − ad*_ξ 𝕀ξ, and the force by −L*_{Q_L}dΥ(Q_L) of
    Q_L = Q_d⁻¹Q; its damping is K_d e.

    Attributes
    ----------
    gyroscopic
        g, the weight of −ad*_Ṽ 𝕀V_d.
    transport
        c, the weight of −ad*_{V_d} 𝕀Ṽ.
    connection
        n, the weight of 𝕀 ad_V V_d.
    damping
        The frame in which the Rayleigh tensor K_d is given. Default: that of the error.
    error
        The frame of the errors: Q Q_d⁻¹ (spatial) or Q_d⁻¹Q (body).
    quadratic
        q, the weight of −ad*_Ṽ 𝕀Ṽ.
    """

    name: ClassVar[str] = "family"
    matched: ClassVar[bool | None] = True

    gyroscopic: Annotated[Real, Scale("gyroscopic weight g")] = 1.0
    transport: Annotated[Real, Scale("transport weight c")] = 1.0
    connection: Annotated[Real, Scale("connection weight n")] = 0.0
    damping: Frame | None = None
    spatial: float = field(init=False, repr=False)
    error: Frame = "spatial"
    quadratic: Annotated[Real, Scale("quadratic weight q")] = 0.0
    has_quadratic: bool = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if self.error == "body" and self.damping == "spatial":
            raise ValueError("error: body always has damping: body; leave damping out")
        object.__setattr__(self, "damping", self.damping or self.error)
        # The frame as a number, so that one compiled law serves the whole family.
        object.__setattr__(self, "spatial", 1.0 if self.damping == "spatial" else 0.0)
        object.__setattr__(self, "has_quadratic", self.quadratic != 0)

    @property
    def structure(self) -> Hashable:
        """The same for all members in one frame; a law that overrides a method has another."""
        kind = type(self)
        methods = ("torque", "dissipation", "memory", "initial_memory", "memory_rate")
        inherited = all(getattr(kind, name) is getattr(Family, name) for name in methods)
        return (Family, self.error, self.has_quadratic) if inherited else super().structure

    @property
    def claims_decrease(self) -> bool | None:  # type: ignore[override]  # by its options
        """True on the plane c + n = 1, where both terms compensate the moving reference."""
        return abs(self.transport + self.connection - 1) <= 1e-12  # rounding of 0.1 + 0.9

    @property
    def energy(self) -> str:  # type: ignore[override]  # a constant of all other laws
        """L in the frame of the errors."""
        return Controller.energy if self.error == "spatial" else BODY_ENERGY

    def torque(self, s: Tracking) -> Array:
        """τ(g, c, n, q), body frame."""
        s = self._in_error_frame(s)
        feedforward = self._feedforward(s)
        if self.error == "body":  # the desired pose is I, and damping has one frame
            return feedforward - s.body_damping - s.gradient
        spatial_force = s.gradient + self.spatial * s.spatial_damping
        body_force = (1 - self.spatial) * s.body_damping
        return feedforward - body_force - s.G.Ad_star(s.Qd, spatial_force)

    def feedforward_torque(self, s: Tracking) -> Array:
        """τ_d and the terms with g, c, n and q."""
        return self._feedforward(self._in_error_frame(s))

    def lyapunov(self, s: Tracking) -> Array:
        """½⟨𝕀Ṽ, Ṽ⟩ + Υ(Q_E)."""
        return self._in_error_frame(s).lyapunov

    def velocity_error(self, s: Tracking) -> Array:
        """Ṽ, or e."""
        return self._in_error_frame(s).V_tilde

    def dissipation(self, s: Tracking) -> Array | None:
        """⟨K_d V_E, V_E⟩ or ⟨K_d Ṽ, Ṽ⟩, and off the plane c + n = 1 the power of these terms."""
        s = self._in_error_frame(s)
        off_plane = 1 - self.transport - self.connection
        added = dot(off_plane * s.P_tilde, s.G.ad(s.V, s.Vd))
        if self.error == "body":
            return dot(s.body_damping, s.V_tilde) + added
        damping = dot(self.spatial * s.spatial_damping, s.V_E)
        return damping + dot((1 - self.spatial) * s.body_damping, s.V_tilde) + added

    def _feedforward(self, s: Tracking) -> Array:
        quadratic = self.quadratic if self.has_quadratic else None
        return s.feedforward(self.gyroscopic, self.transport, self.connection, quadratic)

    def _in_error_frame(self, s: Tracking) -> Tracking:
        """Return the motion with the errors in their frame."""
        return s.relative if self.error == "body" else s


@dataclass(frozen=True)
class Member(Family):
    """A named point of the family, without options.

    A derived class may set other numbers.

    Attributes
    ----------
    weights
        (g, c, n, q).
    frames
        The frames of the error and of the damping.
    """

    weights: ClassVar[tuple[float, float, float, float]]
    frames: ClassVar[tuple[Frame, Frame]] = ("spatial", "spatial")

    gyroscopic: float = field(init=False)
    transport: float = field(init=False)
    connection: float = field(init=False)
    damping: Frame | None = field(init=False)
    error: Frame = field(init=False)
    quadratic: float = field(init=False)

    def __post_init__(self) -> None:
        names = ("gyroscopic", "transport", "connection", "quadratic", "error", "damping")
        bases = type(self).__mro__
        fixed = {name for kind in bases[: bases.index(Member)] for name in vars(kind)}
        for name, value in zip(names, (*self.weights, *self.frames), strict=True):
            if name not in fixed:
                object.__setattr__(self, name, value)
        super().__post_init__()
