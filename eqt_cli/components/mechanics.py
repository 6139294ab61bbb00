"""Lie-Poisson dynamics, navigation functions, tracking errors and L, as in the paper."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, ClassVar, Literal, NamedTuple, Self, TypeAlias, TypeVar

import numpy as np

from eqt_cli.base.arrays import Array, Arrays, apply_matrix, dot, times, transpose
from eqt_cli.components.groups import MatrixLieGroup, Part
from eqt_cli.components.inertia import Inertia, InertiaLaw
from eqt_cli.components.matrix_groups import distance_of_turn
from eqt_cli.components.motions import FlatOutput
from eqt_cli.numbers.leaves import with_fields

T = TypeVar("T")

# The extended Lie-Poisson system on any matrix Lie group ------------------------------------------


def lie_poisson(G: MatrixLieGroup, Q: Array, P: Array, V: Array, tau: Array) -> tuple[Array, Array]:
    """Return the vector field (Q̇, Ṗ) = (Q V^, ad*_V P + τ).

    Hampsey et al. (2025), eq. (5). With V = 𝕀⁻¹P it is a mechanical system with kinetic energy
    ½⟨P, 𝕀⁻¹P⟩; with V free it is the paper's extended system, eq. (14).

    Parameters
    ----------
    Q : (..., d, d)
        Pose.
    P, tau : (..., m)
        Momentum and force, in the dual basis.
    V : (..., m)
        Body velocity.
    """
    return Q @ G.hat(V), G.ad_star(V, P) + tau


# The navigation function Υ(Q) = ½ tr((Q − I) K (Q − I)ᵀ) and its gradient, on any group -----------


def potential(G: MatrixLieGroup, K: Array, Q: Array) -> Array:
    """Return Υ(Q), on SO(3) equal to tr(K(I − Q)), Hampsey et al. (2025), Example 3.4.

    Parameters
    ----------
    K : (..., d, d)
        Symmetric weight, `gains.kp`.
    Q : (..., d, d)
        Pose, or pose error.
    """
    D = Q - G.identity
    return (D * times(D, K)).sum(axis=(-2, -1)) / 2


def gradient(G: MatrixLieGroup, K: Array, Q: Array) -> Array:
    """Return the left-trivialised gradient L*_Q dΥ(Q) ∈ g*, with entries tr((Q − I) K (Q E_i)ᵀ).

    On SO(3) it is (K Q − Qᵀ K)^∨, Hampsey et al. (2025), eq. (13).
    """
    return G.contract(transpose(Q) @ times(Q - G.identity, K))


def gradient_rate(G: MatrixLieGroup, K: Array, Q: Array, V: Array) -> Array:
    """Return the rate of `gradient` along a motion with body velocity V, Q̇ = Q V^.

    It is the covector of (d(QᵀQ)/dt − Q̇ᵀ)K.
    """
    return G.contract(times(G.gram_rate(Q, V) - transpose(Q @ G.hat(V)), K))


def hessian_at_identity(G: MatrixLieGroup, K: Array) -> Array:
    """Return H_ij = tr(E_i K E_jᵀ), ``(..., m, m)``.

    I is a non-degenerate minimum of Υ exactly if H is positive definite. On SO(3) with
    K = diag(λ) its eigenvalues are the sums λ_i + λ_j, i ≠ j.
    """
    return G.contract(G.basis @ K[..., None, :, :])


# The semidirect product G ⋉ g*: states (Q, P), inputs (V, τ), and the error X X_d⁻¹ ---------------
#
# The paper's structure, on any group of the registry. Pairs are plain tuples of arrays with leading
# batch axes.


State = tuple[Array, Array]
"""X = (Q, P) ∈ G ⋉ g*: a pose ``(..., d, d)`` and a momentum ``(..., m)``."""
Input = tuple[Array, Array]
"""U = (V, τ) in the algebra of G ⋉ g*: a velocity and a force, both ``(..., m)``."""


@dataclass(frozen=True)
class Semidirect:
    """The group G ⋉ g* over a matrix Lie group G."""

    G: MatrixLieGroup

    @property
    def identity(self) -> State:
        """(I, 0)."""
        return self.G.identity, np.zeros(self.G.dimension)

    def compose(self, X: State, Y: State) -> State:
        """(Q_1 Q_2, Ad*_{Q_2} P_1 + P_2), Hampsey et al. (2025), eq. (15)."""
        (Q1, P1), (Q2, P2) = X, Y
        return Q1 @ Q2, self.G.Ad_star(Q2, P1) + P2

    def inverse(self, X: State) -> State:
        """(Q⁻¹, −Ad*_{Q⁻¹} P)."""
        Q, P = X
        Q_inverse = self.G.inverse(Q)
        return Q_inverse, -self.G.Ad_star(Q_inverse, P)

    def Ad(self, Y: State, U: Input) -> Input:
        """(Ad_Q V, Ad*_{Q⁻¹}(ad*_V P + τ)), Hampsey et al. (2025), eq. (27)."""
        (Q, P), (V, tau) = Y, U
        return self.G.Ad(Q, V), self.G.Ad_star(self.G.inverse(Q), self.G.ad_star(V, P) + tau)

    def error(self, X: State, X_d: State) -> State:
        """E = X X_d⁻¹ = (Q Q_d⁻¹, Ad*_{Q_d⁻¹}(P − P_d)), Hampsey et al. (2025), eq. (17)."""
        return self.compose(X, self.inverse(X_d))

    def error_input(self, X_d: State, U: Input, U_d: Input) -> Input:
        """U_E = (V_E, τ_E) = Ad_{X_d}(U − U_d), Hampsey et al. (2025), eq. (19)."""
        return self.Ad(X_d, (U[0] - U_d[0], U[1] - U_d[1]))

    def closed_loop_input(self, X_d: State, tau_d: Array, U_E: Input) -> Array:
        """τ = τ_d + Ad^τ_{X_d⁻¹}(V_E, τ_E), the force that gives the error the input U_E.

        Hampsey et al. (2025), eq. (20).
        """
        _, tau = self.Ad(self.inverse(X_d), U_E)
        return tau_d + tau


def as_distance(part: Part, threshold: float) -> float:
    """Return the threshold of a part as a distance in the matrix of the pose."""
    return distance_of_turn(threshold) if part.turns else threshold


# The true and the desired state, the errors between them, and the Lyapunov function L -------------
#
# This is all that a control law may read. Each quantity is computed once, on its first use.


@dataclass(frozen=True)
class Gains:
    """Navigation weight K (`gains.kp`, d×d) and Rayleigh tensor K_d (`gains.kd`, m×m).

    Like the inertia, they may carry leading batch axes, or be symbols.
    """

    K: Array
    K_d: Array


Setpoint: TypeAlias = Literal["position", "velocity", "full"]

SETPOINTS: dict[str, int] = {"position": 0, "velocity": 1, "full": 2}
"""What a law may know of the reference, with the derivatives that this has; `full`: all."""


def pose_error(G: MatrixLieGroup, Q: Array, Qd: Array) -> Array:
    """Q_E = Q Q_d⁻¹, the error in the spatial frame, Hampsey et al. (2025), eq. (17)."""
    return Q @ G.inverse(Qd)


@dataclass(frozen=True)
class Tracking:
    """All that a control law reads: group, inertia, gains, time, state, desired state, errors.

    Attributes
    ----------
    G
        Group, with `hat`, `Ad`, `ad_star` and `inverse`.
    inertia
        Inertia 𝕀 at this time, with `momentum` and `velocity`.
    gains
        Weights `K` of the potential and `K_d` of the damping.
    t
        Time, s.
    Q, Qd : (..., d, d)
        True and desired pose.
    P, Pd : (..., m)
        True and desired momentum.
    tau_d : (..., m)
        Torque that drives the desired state, body frame.
    memory
        The law's own states by name, ``(..., length)`` each.
    vehicle
        The states of actuators by name, which a law must not read.
    flat
        The flat output of the reference, for laws that read it.
    flux : (..., 3)
        The magnetic field in the body, T, for laws that read it.
    ahead
        For laws with a `preview`: returns what they read of `LATER`. A function, because a sampled
        law needs it at its instants only.
    known_force : (..., m)
        The force that the loop takes from the torque of the law, body frame; None for none.
    specific_force : (..., n)
        What an accelerometer measures, m/s², for laws that read it.
    """

    G: MatrixLieGroup
    inertia: Inertia
    gains: Gains
    t: Any
    Q: Array
    P: Array
    Qd: Array
    Pd: Array
    tau_d: Array
    memory: Mapping[str, Array] = field(default_factory=dict)
    vehicle: Mapping[str, Array] = field(default_factory=dict)
    flat: FlatOutput | None = None
    flux: Any = None
    ahead: Callable[[], Arrays] | None = None
    known_force: Array | None = None
    specific_force: Any = None

    def command(self, torque: Array) -> Array:
        """Return τ − f, what the loop commands for a torque of the law."""
        return torque if self.known_force is None else torque - self.known_force

    @cached_property
    def V(self) -> Array:
        """Body velocity V = 𝕀⁻¹P."""
        return self.inertia.velocity(self.P)

    @cached_property
    def Vd(self) -> Array:
        """Desired body velocity V_d = 𝕀⁻¹P_d."""
        return self.inertia.velocity(self.Pd)

    @cached_property
    def Vd_dot(self) -> Array:
        """V̇_d = 𝕀⁻¹(τ_d + ad*_{V_d} P_d − 𝕀̇V_d), the desired acceleration."""
        return self.inertia.velocity(self.Pd_dot - self.inertia.rate_force(self.Vd))

    @cached_property
    def Pd_dot(self) -> Array:
        """Ṗ_d = τ_d + ad*_{V_d} P_d."""
        return self.G.ad_star(self.Vd, self.Pd) + self.tau_d

    @cached_property
    def V_tilde(self) -> Array:
        """Ṽ = V − V_d, body frame."""
        return self.V - self.Vd

    @cached_property
    def P_tilde(self) -> Array:
        """P̃ = P − P_d = 𝕀Ṽ, body frame."""
        return self.P - self.Pd

    @cached_property
    def relative(self) -> Tracking:
        """The same motion with the errors of the body frame, Q_d⁻¹Q and V − ξ.

        The desired velocity carried to the body is ξ = Ad_{Q_L⁻¹} V_d with Q_L = Q_d⁻¹Q; it
        changes at the rate ξ̇ = Ad_{Q_L⁻¹} V̇_d − ad_V ξ, and the torque that drives it is
        τ_ξ = 𝕀ξ̇ + 𝕀̇ξ − ad*_ξ 𝕀ξ. The pose is replaced by Q_L, the desired pose by I, and its
        momentum and torque by (𝕀ξ, τ_ξ). Then all errors of this class are those of the body
        frame, so that one formula serves both frames: Ṽ is V − ξ, Q_E is Q_L, and the gradient
        is L*_{Q_L}dΥ(Q_L).
        """
        G = self.G
        Q_L = G.inverse(self.Qd) @ self.Q
        carry = G.Ad_matrix(G.inverse(Q_L))
        xi = apply_matrix(carry, self.Vd)
        xi_dot = apply_matrix(carry, self.Vd_dot) - G.ad(self.V, xi)
        # A measured V need not follow from P.
        return with_fields(self, Q=Q_L, Qd=G.identity, V=self.V).following(xi, xi_dot)

    def following(self, Vd: Array, Vd_dot: Array) -> Tracking:
        """Return the motion with another desired velocity V_d and its rate V̇_d."""
        G, inertia = self.G, self.inertia
        Pd, Pd_dot = inertia.momentum(Vd), inertia.momentum(Vd_dot) + inertia.rate_force(Vd)
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        following = Following(**values | {"Pd": Pd, "tau_d": Pd_dot - G.ad_star(Vd, Pd)})
        return with_fields(following, V=self.V, Vd=Vd, Vd_dot=Vd_dot, Pd_dot=Pd_dot)

    def at_setpoint(self, setpoint: str) -> Tracking:
        """Return the motion as a law knows it; derivatives of the reference above are 0."""
        if setpoint == "full":
            return self
        order = SETPOINTS[setpoint]
        s = with_fields(self, flat=self.flat and self.flat.up_to(order), V=self.V)
        return s.following(min(order, 1.0) * self.Vd, 0.0 * self.Vd)

    @cached_property
    def _of_law(self) -> dict[str, Any]:
        return {}

    def once(self, name: str, compute: Callable[[Tracking], T]) -> T:
        """Return a quantity that a law alone has of this state, which is computed once."""
        if name not in self._of_law:
            self._of_law[name] = compute(self)
        value: T = self._of_law[name]
        return value

    @cached_property
    def Q_E(self) -> Array:
        """Q_E = Q Q_d⁻¹, Hampsey et al. (2025), eq. (17)."""
        return pose_error(self.G, self.Q, self.Qd)

    @cached_property
    def V_E(self) -> Array:
        """V_E = Ad_{Q_d} Ṽ, the first part of Hampsey et al. (2025), eq. (19)."""
        return self.G.Ad(self.Qd, self.V_tilde)

    @cached_property
    def inertia_force(self) -> Array | float:
        """Ṡ*S⁻* P̃, which compensates the change of the inertia; 0.0 where it is constant.

        Hampsey et al. (2025), eq. (11) in the tracking errors: with 𝕀̄_t = S̄* 𝕀_0 S̄ and
        S̄ = S Ad_{Q_d⁻¹}, the feedforward of Theorem 3.2 is −ad*_{V_d} P̃ + Ṡ*S⁻* P̃ in the body
        frame.
        """
        return self.inertia.feedforward(self.V_tilde)

    def feedforward(self, g: Any, c: Any, n: Any, q: Any = None) -> Array:
        """τ_d − g ad*_Ṽ 𝕀V_d − c ad*_{V_d} 𝕀Ṽ + n 𝕀 ad_V V_d + Ṡ*S⁻* 𝕀Ṽ − q ad*_Ṽ 𝕀Ṽ.

        The terms with g and q have no power. Without q, its term is left out.
        """
        momentum = g * self.Pd
        if q is not None:
            momentum = momentum + q * self.P_tilde
        return self._driving(self.G.ad_star(self.V_tilde, momentum), c, n) + self.inertia_force

    def _driving(self, gyroscopic: Array, c: Any, n: Any) -> Array:
        """τ_d − gyroscopic − c ad*_{V_d} 𝕀Ṽ + n 𝕀 ad_V V_d."""
        G = self.G
        carried = n * self.inertia.momentum(G.ad(self.V, self.Vd))
        return self.tau_d - gyroscopic - G.ad_star(self.Vd, c * self.P_tilde) + carried

    @cached_property
    def cancelling_feedforward(self) -> Array:
        """Ṗ_d − ad*_V P + Ṡ*S⁻* 𝕀Ṽ, equal to `feedforward` with (1, 1, 0, 1).

        It leaves d(𝕀Ṽ)/dt = Ṡ*S⁻* 𝕀Ṽ.
        """
        return self.Pd_dot - self.G.ad_star(self.V, self.P) + self.inertia_force

    @cached_property
    def gradient(self) -> Array:
        """L*_{Q_E} dΥ(Q_E), spatial frame."""
        return gradient(self.G, self.gains.K, self.Q_E)

    @cached_property
    def gradient_rate(self) -> Array:
        """The rate at which `gradient` changes."""
        return gradient_rate(self.G, self.gains.K, self.Q_E, self.V_E)

    @cached_property
    def stiffness(self) -> Array:
        """The Hessian of Υ at I, `gradient` for a small error, ``(..., m, m)``."""
        return hessian_at_identity(self.G, self.gains.K)

    def linear_gradient(self, x: Array) -> Array:
        """H x: `gradient` to first order in the coordinates x of a small error."""
        return self.G.contract(times(self.G.hat(x), self.gains.K))

    @property
    def kinetic_error(self) -> Array:
        """½⟨𝕀Ṽ, Ṽ⟩."""
        return dot(self.P_tilde, self.V_tilde) / 2

    @cached_property
    def spatial_damping(self) -> Array:
        """K_d V_E, the Rayleigh force in the spatial frame."""
        return apply_matrix(self.gains.K_d, self.V_E)

    @cached_property
    def body_damping(self) -> Array:
        """K_d Ṽ, the Rayleigh force in the body frame."""
        return apply_matrix(self.gains.K_d, self.V_tilde)

    @property
    def lyapunov(self) -> Array:
        """L = ½⟨P_E, 𝕀̄_t⁻¹P_E⟩ + Υ(Q_E) = ½⟨P̃, Ṽ⟩ + Υ(Q_E), Theorems 3.2 and 6.2."""
        return self.kinetic_error + potential(self.G, self.gains.K, self.Q_E)


class Following(Tracking):
    """A motion whose desired velocity is given with its rate, so that τ_d follows from them."""

    def _driving(self, gyroscopic: Array, c: Any, n: Any) -> Array:
        """As above with τ_d = 𝕀V̇_d + 𝕀̇V_d − ad*_{V_d} P_d, with fewer products."""
        G, inertia = self.G, self.inertia
        driving = inertia.momentum(self.Vd_dot + n * G.ad(self.V, self.Vd))
        carried = G.ad_star(self.Vd, self.Pd + c * self.P_tilde)
        return driving + inertia.rate_force(self.Vd) - gyroscopic - carried


# Base class of components that are given over time, in a file or in pieces ------------------------


class TimeVarying:
    """A component of a loop that may be given over time, in a file or in pieces."""

    def ends(self, G: MatrixLieGroup) -> tuple[float, float]:
        """Return the times between which it is given, s."""
        return -np.inf, np.inf

    def gaps(self, G: MatrixLieGroup) -> list[tuple[float, float]]:
        """Return the begin and the length of each gap, s."""
        return []

    # Files of the component.

    reader: ClassVar[str] = ""
    """The function of an extension that makes texts of its files; "" where they are texts."""

    @property
    def files(self) -> dict[str, str]:
        """The files that it needs, relative to the configuration, by the options that name them."""
        return {}

    def with_files(self, texts: Mapping[str, str]) -> Self:
        """Return the component with the contents of its files, given by their names."""
        return self

    # Instants, known in advance, at which it changes.

    def instants(self, G: MatrixLieGroup, until: float) -> Array:
        """Return the sorted times up to `until` at which an engine must end a step, s."""
        return np.empty(0)

    def held(self, G: MatrixLieGroup, t: Any) -> Any:
        """Return the component from time t to the next instant, with that piece's numbers.

        None if no number changes at the instants.
        """
        return None


# The input of a law at an instant: the interface between a law and the vehicle that it flies ------
#
# Besides it, a law needs only its own numbers and its memory, in a simulation as in firmware.


AXES = {"t": 0, "pose": 2, "desired_pose": 2, "position": 2, "later_pose": 3, "later_velocity": 2}
AXES |= {"later_torque": 2, "later_position": 3}
"""The number of axes of each part of an input that is not a vector."""

LATER = ("later_pose", "later_velocity", "later_torque", "later_position")
"""The parts of an input that only laws with a preview have."""

NOT_IN_CODE = ("specific_force",)
"""The last part of an input, which no code of a user has."""


class LawInput(NamedTuple):
    """The input of a law, body frame.

    Attributes
    ----------
    t
        Time, s.
    pose, desired_pose : (..., d, d)
        Measured Q, and Q_d.
    velocity, desired_velocity, desired_acceleration : (..., m)
        Measured V, and V_d and V̇_d.
    position : (..., 5, n)
        p_d and its derivatives to the fourth; only for laws that read the flat output.
    heading : (..., 3)
        ψ and its derivatives to the second; None also where the heading is free.
    flux : (..., 3)
        The measured magnetic field; only for laws that read it.
    later_pose, later_velocity : (..., k, d, d) and (..., k, m)
        Q_d and V_d at k later times; only for laws with a `preview`.
    later_torque, later_position : (..., k, m) and (..., k, 5, n)
        τ_d by the law's inertia, and p_d as `position`, at these times, where the law reads them.
    specific_force : (..., n)
        The measured specific force, in body axes; only for laws that read it.
    """

    t: Any
    pose: Array
    velocity: Array
    desired_pose: Array
    desired_velocity: Array
    desired_acceleration: Array
    position: Any = None  # Array | None, as the next
    heading: Any = None
    flux: Any = None
    later_pose: Any = None
    later_velocity: Any = None
    later_torque: Any = None
    later_position: Any = None
    specific_force: Any = None

    @classmethod
    def of(cls, s: Tracking) -> LawInput:
        """Return the input of a law at a tracking state."""
        optional, later = (*(s.flat or (None, None)), s.flux), s.ahead() if s.ahead else {}
        later = {**later, "specific_force": s.specific_force}
        return cls(s.t, s.Q, s.V, s.Qd, s.Vd, s.Vd_dot, *optional, **later)

    def mapped(self, function: Callable[[Any], Any]) -> LawInput:
        """Return the input with a function applied to every part that there is."""
        return LawInput._make(None if part is None else function(part) for part in self)

    def zeroed(self, *names: str) -> LawInput:
        """Return the input with some of its parts set to 0."""
        return self._replace(**{name: 0 * getattr(self, name) for name in names})

    def at_later(self, k: int) -> LawInput:
        """Return the input with the reference of a later time in place of the one now."""
        Q, V = self.later_pose[..., k, :, :], self.later_velocity[..., k, :]
        return self._replace(desired_pose=Q, desired_velocity=V)

    def rows(self, names: Iterable[str]) -> Array:
        """Return some parts side by side, ``(states, …)``; matrices are row by row."""
        batch, columns = self.velocity.shape[:-1], []
        for name in names:
            part = np.asarray(getattr(self, name))
            shape = part.shape[part.ndim - AXES.get(name, 1) :]
            columns.append(np.broadcast_to(part, (*batch, *shape)).reshape(math.prod(batch), -1))
        return np.concatenate(columns, axis=-1)

    def tracking(
        self,
        G: MatrixLieGroup,
        inertia: InertiaLaw,
        gains: Gains,
        memory: Mapping[str, Array],
        known_force: Array | None = None,
    ) -> Tracking:
        """Return the tracking state that the law reads, with momenta by its own inertia."""
        now, Q, Qd = inertia.at(self.t), self.pose, self.desired_pose
        P = now.momentum(self.velocity)
        flat = None if self.position is None else FlatOutput(self.position, self.heading)
        later = {n: part for n in LATER if (part := getattr(self, n)) is not None}
        ahead = (lambda: later) if later else None
        # In place of P_d and τ_d, until `following` gives them, is P.
        of_loop = flat, self.flux, ahead, known_force, self.specific_force
        tracking = Tracking(G, now, gains, self.t, Q, P, Qd, P, P, memory, {}, *of_loop)
        tracking = with_fields(tracking, V=self.velocity)
        return tracking.following(self.desired_velocity, self.desired_acceleration)
