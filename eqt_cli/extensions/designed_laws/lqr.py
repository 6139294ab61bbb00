"""Linear quadratic regulators along a reference, and the equivariant regulator."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from eqt_cli.base.arrays import Array, Arrays, apply_matrix, as_array, dot
from eqt_cli.base.errors import InputError, Problems, Remedy
from eqt_cli.base.option_types import Matrix
from eqt_cli.base.registry import Keys
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.laws import Designed, LinearPlant
from eqt_cli.components.matrix_groups import rigid, rigid_motions
from eqt_cli.components.mechanics import Tracking
from eqt_cli.components.motions import PlantModel, piece_at
from eqt_cli.components.pose_notation import square
from eqt_cli.numbers.leaves import STRUCTURE, with_fields

# The linear-quadratic regulator of a loop that is linearised about its reference ------------------


SWEEPS = 100
"""Largest number of passes through a periodic reference; each multiplies the distance from the
periodic solution by the square of the closed loop's decay over a period."""

SETTLED = 1e-10
"""Relative change of the value matrix over a period below which it is periodic."""


LEAST_DECAY = 1e-8
"""Least decay of the closed loop, relative to its fastest rate: the error of a double root, the
square root of rounding."""


@dataclass(frozen=True)
class LqrWeights(Keys):
    """The weights of the cost ∫ (εᵀW_ε ε + eᵀW_e e + uᵀW_u u) dt.

    Attributes
    ----------
    pose
        W_ε, positive semidefinite: number, diagonal or m×m matrix, in 1/rad², 1/m².
    velocity
        W_e, positive semidefinite, in (s/rad)², (s/m)².
    torque
        W_u, positive definite, in 1/(N m)², 1/N².
    """

    pose: Matrix = 1.0
    velocity: Matrix = 1.0
    torque: Matrix = 1.0


@dataclass(frozen=True)
class Regulator:
    """u = −K x, with what it minimises to first order, at one time or from one knot to the next.

    Attributes
    ----------
    gain : (m, n)
        K; from a knot on ``(4, m, n)``, the coefficients of a cubic in the time since, falling.
    value : (n, n)
        S; the cost from x is xᵀSx. ``(4, n, n)`` likewise.
    since : (1, 1)
        The time of the knot, s; None if K and S are constant.
    """

    gain: Array
    value: Array
    since: Array | None = None

    def gain_at(self, t: Any) -> Array:
        """Return K at time t, or at an array of times."""
        return self._at(self.gain, t)

    def value_at(self, t: Any) -> Array:
        """Return S likewise."""
        return self._at(self.value, t)

    def _at(self, matrices: Array, t: Any) -> Array:
        if self.since is None:
            return matrices
        elapsed = as_array(t)[..., None, None] - self.since
        a, b, c, d = (matrices[..., k, :, :] for k in range(4))
        at: Array = ((a * elapsed + b) * elapsed + c) * elapsed + d
        return at


@dataclass(frozen=True)
class ActuatorModel:
    """The states z of actuators and delays under a command: ż, or z a period later, is Fz + Gu.

    Attributes
    ----------
    transition : (k, k)
        F.
    inputs : (k, m)
        G.
    """

    transition: Array
    inputs: Array


@dataclass(frozen=True)
class RegulatorTable:
    """Regulators from one knot to the next.

    Attributes
    ----------
    knots : (k,)
        Times at which each begins, s.
    gains, values
        Their coefficients, ``(k, 4, m, n)`` and ``(k, 4, n, n)``.
    """

    knots: Array
    gains: Array
    values: Array

    @classmethod
    def through(cls, times: Array, regulators: Sequence[Regulator]) -> RegulatorTable:
        """Return the cubic splines through regulators at some times."""
        from scipy.interpolate import CubicSpline

        gains = CubicSpline(times, [regulator.gain for regulator in regulators]).c
        values = CubicSpline(times, [regulator.value for regulator in regulators]).c
        return cls(times[:-1], np.swapaxes(gains, 0, 1), np.swapaxes(values, 0, 1))

    def __repr__(self) -> str:
        """Return a digest, because the text of an array leaves out entries."""
        parts = (self.knots, self.gains, self.values)
        return hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest()

    def at(self, t: Any) -> Regulator:
        """Return the regulator from the last knot before time t, or those of an array of times."""
        row = piece_at(self.knots, t)
        return Regulator(self.gains[row], self.values[row], self.knots[row, None, None])


@dataclass(frozen=True)
class Lqr(Designed):
    """The linear-quadratic regulator about the reference, on every group.

    τ = τ_d − f_d − K (ε, e, z) with ε = log Q_L, Q_L = Q_d⁻¹Q, and e = V − Ad_{Q_L⁻¹}V_d; f_d are
    the forces of `model` at the reference. K minimises
    ∫ (εᵀW_ε ε + eᵀW_e e + uᵀW_u u) dt for the loop to first order about its reference, by the law's
    own inertia: from the algebraic Riccati equation where the linearised loop is constant, else
    from the Riccati differential equation, backwards from S at the end of the horizon, which is
    that of the loop as it is there, without end; with `periodic`, its periodic solution. Between
    `pieces` + 1 knots, K and S are cubic splines. Where control is sampled, the loop is discretised
    with its period, and the cost is a sum over the instants, times the period. z is the law's own
    model of delays and of linear actuators, which starts at 0 and knows no limits.

    L = xᵀSx is the cost from x to first order. No error of finite size is claimed to decay. The
    bits of K depend on the LAPACK library.

    Attributes
    ----------
    weights
        Weights of pose, velocity and torque.
    pieces
        Number of pieces of the horizon, from knot to knot.
    periodic
        Whether the motion repeats after the horizon; Q_d, V_d and τ_d must then be equal at both
        ends.
    """

    name: ClassVar[str] = "lqr"
    by_processor: ClassVar[bool] = True  # LAPACK finds its gains
    title: ClassVar[str] = "LQR"
    energy: ClassVar[str] = "xᵀSx"
    theorem: ClassVar[str] = ""
    matched: ClassVar[bool | None] = False
    reads_gains: ClassVar[bool] = False

    weights: LqrWeights = field(default=LqrWeights(), metadata=STRUCTURE)
    pieces: Annotated[int, Field(strict=True, ge=1, le=10_000)] = 100
    periodic: bool = False
    # Of the design; pydantic, which reads all types, knows no arrays.
    regulator: Any = field(default=None, init=False, repr=False)  # Regulator | None
    table: Any = field(default=None, init=False, repr=False, metadata=STRUCTURE)  # RegulatorTable
    actuators: Any = field(default=None, init=False, repr=False)  # ActuatorModel | None
    known_forces: Any = field(default=(), init=False, repr=False)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note weights that are not symmetric, or not definite enough."""
        for name in ("pose", "velocity", "torque"):
            with problems.at("weights").catching(name):
                matrix = square(getattr(self.weights, name), G.dimension, G)
                if not np.array_equal(matrix, matrix.T):
                    raise InputError(f"expected a symmetric matrix, got {matrix.tolist()}")
                least = np.linalg.eigvalsh(matrix).min()
                if least < 0 or (least == 0 and name == "torque"):
                    kind = "definite" if name == "torque" else "semidefinite"
                    raise InputError(
                        f"expected a positive {kind} matrix, got an eigenvalue of {least:.4g}"
                    )

    def for_plant(self, G: MatrixLieGroup, plant: PlantModel, problems: Problems) -> Lqr:
        """Return the law with the forces that it knows."""
        return with_fields(self, known_forces=plant.forces)

    # The design.

    def designed(self, G: MatrixLieGroup, plant: LinearPlant) -> Lqr:
        """Return the law with its gains for a linearised loop without feedback.

        Raises
        ------
        InputError
            If no gain makes the loop stable, or it is `periodic` and does not repeat.
        """
        if self.periodic and plant.differs:
            raise InputError(
                f"periodic: {plant.differs}",
                Remedy("leave periodic out, or give time.duration a period of the reference"),
            )
        n, m = plant.B.shape[-2:]
        Q, R = np.zeros((n, n)), square(self.weights.torque, m, G)
        for k, weight in enumerate((self.weights.pose, self.weights.velocity)):
            Q[k * m : (k + 1) * m, k * m : (k + 1) * m] = square(weight, m, G)
        design = _Design(plant, Q, R, self.periodic)
        states = slice(2 * m, n)
        model = ActuatorModel(plant.A[0][states, states], plant.B[0][states]) if n > 2 * m else None
        if len(plant.times) == 1:
            return with_fields(self, regulator=design.constant(0), actuators=model)
        return with_fields(self, table=design.over_time(), actuators=model)

    def instants(self, G: MatrixLieGroup, until: float) -> Array:
        """Return the knots."""
        return np.empty(0) if self.table is None else self.table.knots

    def held(self, G: MatrixLieGroup, t: Any) -> Regulator | None:
        """Return the regulator from time t to the next knot; None for constant gains."""
        return None if self.table is None else self._at(t)

    def with_held(self, held: Regulator | None) -> Lqr:
        """Return the law with this regulator."""
        return self if held is None else with_fields(self, regulator=held, table=None)

    # The law. Until it is designed, it is its feedforward alone.

    def _at(self, t: Any) -> Regulator | None:
        return self.regulator if self.table is None else self.table.at(t)

    def torque(self, s: Tracking) -> Array:
        """τ_d − f_d − K x, body frame."""
        now, torque = self._at(s.t), self.feedforward_torque(s)
        return torque if now is None else torque - apply_matrix(now.gain_at(s.t), self.state(s))

    def errors(self, s: Tracking) -> tuple[Array, Array]:
        """Return ε and e."""
        r = s.relative
        return s.G.log(r.Q), r.V_tilde

    def state(self, s: Tracking) -> Array:
        """Return x = (ε, e, z)."""
        return np.concatenate([*self.errors(s), *s.memory.values()], axis=-1)

    def feedforward_torque(self, s: Tracking) -> Array:
        """Return τ_d − f_d with the known forces f_d at the reference."""
        torque = s.tau_d + 0.0 * s.P  # broadcast to all runs
        for force in self.known_forces:
            torque = torque - force.in_body(s.G, s.t, s.Qd, s.Vd)
        return torque

    def lyapunov(self, s: Tracking) -> Array:
        """Return xᵀSx, the cost from x to first order."""
        x, now, n = self.state(s), self._at(s.t), 2 * s.G.dimension
        S = np.zeros((n, n)) if now is None else now.value_at(s.t)
        return dot(apply_matrix(S, x), x)

    def memory(self, G: MatrixLieGroup) -> Mapping[str, int]:
        """Return the length of the modelled states of the actuators."""
        model = self.actuators
        return {} if model is None else {"actuators": model.transition.shape[-1]}

    def memory_rate(self, s: Tracking) -> Arrays:
        """ż = Fz + Gu of a continuous loop."""
        model, u = self.actuators, self.torque(s) - self.feedforward_torque(s)
        if model is None:
            return {}
        moved = apply_matrix(model.transition, s.memory["actuators"])
        return {"actuators": moved + apply_matrix(model.inputs, u)}

    def answer(self, s: Tracking, period: Any) -> tuple[Array, Arrays]:
        """Return the command, and z one period later, which is Fz + Gu of a sampled loop."""
        return self.torque(s), self.memory_rate(s)


class _Design:
    """The Riccati equations of a linear plant with the weights Q of x and R of u."""

    def __init__(self, plant: LinearPlant, Q: Array, R: Array, periodic: bool = False) -> None:
        self.plant, self.periodic = plant, periodic
        step = plant.period or 1.0  # a sampled cost is a sum over instants, times the period
        self.Q, self.R = step * Q, step * R

    def constant(self, k: int) -> Regulator:
        """Return the regulator of the plant at the k-th time, by the algebraic equation."""
        from scipy.linalg import solve_continuous_are, solve_discrete_are

        sampled = self.plant.period is not None
        solve = solve_discrete_are if sampled else solve_continuous_are
        A, B = self.plant.A[k], self.plant.B[k]
        with suppress(np.linalg.LinAlgError, ValueError):  # there is no S, or it is not finite
            S = solve(A, B, self.Q, self.R)
            S = (S + S.T) / 2
            gain = self._gain(A, B, S)
            eigenvalues = np.linalg.eigvals(A - B @ gain)
            growth = np.abs(eigenvalues).max() - 1 if sampled else eigenvalues.real.max()
            if growth < -LEAST_DECAY * np.abs(eigenvalues).max():
                return Regulator(gain, S)
        raise InputError(
            "the loop to first order has no stabilising regulator: an error that does not decay by "
            "itself is moved by no command, or has no weight",
            Remedy("give weights.pose a weight along every axis, and check the actuators"),
        )

    def over_time(self) -> RegulatorTable:
        """Return the regulators over time, backwards from the end of the horizon."""
        times = self.plant.times
        S, regulators = self.constant(len(times) - 1).value, list[Regulator]()
        for _ in range(SWEEPS if self.periodic else 1):
            after, regulators = S, []
            for k in reversed(range(len(times))):
                regulators.append(self._earlier(k, S))
                S = regulators[-1].value
            if np.abs(S - after).max() <= SETTLED * np.abs(S).max():
                break
        return RegulatorTable.through(times, regulators[::-1])

    def _gain(self, A: Array, B: Array, S: Array) -> Array:
        if self.plant.period is None:
            return np.linalg.solve(self.R, B.T @ S)
        return np.linalg.solve(self.R + B.T @ S @ B, B.T @ S @ A)

    def _earlier(self, k: int, S: Array) -> Regulator:
        """Return the regulator at a knot from S at the next one or, for the last, at the end."""
        times, A, B, period = self.plant.times, self.plant.A, self.plant.B, self.plant.period
        following, n = min(k + 1, len(times) - 1), len(S)
        if period is None:
            if following > k:
                X = self._pieces[k] @ np.concatenate([np.eye(n), S])
                S = np.linalg.solve(X[:n].T, X[n:].T).T
                S = (S + S.T) / 2
            return Regulator(self._gain(A[k], B[k], S), S)
        instants = max(1, round((times[following] - times[k]) / period))
        for share in np.arange(instants)[::-1] / instants:
            A_now, B_now = (
                matrix[k] + share * (matrix[following] - matrix[k]) for matrix in (A, B)
            )
            gain = self._gain(A_now, B_now, S)
            S = self.Q + A_now.T @ S @ (A_now - B_now @ gain)
            S = (S + S.T) / 2
        return Regulator(gain, S)

    @cached_property
    def _pieces(self) -> Array:
        """How (X, SX) goes back by a piece: −Ṡ = AᵀS + SA − SBR⁻¹BᵀS + Q is linear in them.

        The matrix of a piece is the mean of those at its ends.
        """
        from scipy.linalg import expm

        A, B = self.plant.A, self.plant.B
        moved = B @ np.linalg.solve(self.R, np.swapaxes(B, 1, 2))
        weights = np.broadcast_to(self.Q, A.shape)
        hamiltonian = np.block([[A, -moved], [-weights, -np.swapaxes(A, 1, 2)]])
        steps = np.diff(self.plant.times)[:, None, None]
        return expm(-steps / 2 * (hamiltonian[1:] + hamiltonian[:-1]))


# The linear-quadratic regulator in the error coordinates of a symmetry of rigid motions -----------


@dataclass(frozen=True)
class Eqr(Lqr):
    """LQR in the error coordinates of a symmetry, an equivariant regulator (EqR); SE2 and SE3.

    The symmetry is a group with one element X for each attitude R, position x and velocity v or w;
    the error is log(X_d⁻¹X). Here v is in space and w = Rᵀv in the body. With R_L = R_dᵀR, its
    rotation vector θ, the left Jacobian J of θ, and p = R_dᵀ(x − x_d):

    - `direct_product`, X = (R, x, v) in SO(n) × ℝⁿ × ℝⁿ: ρ = p, α = R_dᵀ(v − v_d)
    - `pose_velocity`, X = ((R, x), w) in SE(n) × ℝⁿ: ρ = J⁻¹p, α = w − w_d + θ × w_d
    - `extended_pose`, X = (R, x, v) in SE_2(n): ρ = J⁻¹p, α = J⁻¹R_dᵀ(v − v_d)

    The law is `lqr` with the same gains, at ε = (θ, ρ) and e = (e_Ω, α − Ω_d × ρ), where
    e_Ω = Ω − R_LᵀΩ_d in every symmetry. These are the error log(X_d⁻¹X) in the coordinates that
    equal those of `lqr` to first order. So all symmetries have one Riccati equation, one cost and
    one loop for small errors, and differ for large errors only. The error log(XX_d⁻¹) of the
    spatial frame is Ad_{X_d} log(X_d⁻¹X) in each group, and gives the same law.

    The method and the names of the symmetries are those in the abstracts of arXiv 2207.04782
    (Hampsey, van Goor, Hamel, Mahony) and 2211.07045 (Hampsey, van Goor, Mahony). The papers
    themselves were not read. The formulas are derived here, with v or w, the logarithm and e_Ω as
    choices of their own.

    Attributes
    ----------
    symmetry
        The group: `direct_product`, `pose_velocity` or `extended_pose`.
    """

    name: ClassVar[str] = "eqr"
    title: ClassVar[str] = "EqR"

    symmetry: Literal["direct_product", "pose_velocity", "extended_pose"] = "extended_pose"

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note groups without one rotation and one translation, and weights that do not fit."""
        if rigid_motions(G):
            super().check(G, problems)
        else:
            problems.add(
                f"eqr needs a group of one rotation and one translation, SE2 or SE3, got {G.name}"
            )

    def errors(self, s: Tracking) -> tuple[Array, Array]:
        """Return (θ, ρ) and (e_Ω, α − Ω_d × ρ)."""
        G, r = rigid(s.G), s.relative
        k, R_L, epsilon = G.rotations, G.rotation(r.Q), G.log(r.Q)
        alpha = apply_matrix(R_L, s.V[..., k:]) - s.Vd[..., k:]
        turning = 0.0 * epsilon[..., :k]
        if self.symmetry == "direct_product":
            epsilon = np.concatenate([epsilon[..., :k], r.Q[..., : G.space, -1]], axis=-1)
        elif self.symmetry == "extended_pose":  # J⁻¹α
            alpha = G.log(G.assemble(R_L, alpha[..., None]))[..., k:]
        else:
            alpha, turning = s.V_tilde[..., k:], epsilon[..., :k]
        carried = G.ad(s.Vd, np.concatenate([turning, epsilon[..., k:]], axis=-1))
        return epsilon, np.concatenate([r.V_tilde[..., :k], alpha - carried[..., k:]], axis=-1)
