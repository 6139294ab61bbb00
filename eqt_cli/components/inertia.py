"""The inertia of a mechanical system, and what it is worth at critical points."""

from __future__ import annotations

import operator
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import lru_cache, reduce
from itertools import chain
from typing import Any, Self

import numpy as np

from eqt_cli.base.arrays import (
    Array,
    apply_matrix,
    inverse_spd,
    maximum,
    minimum,
    sqrt,
    stack,
    transpose,
)
from eqt_cli.base.expressions import Expression
from eqt_cli.components.groups import MatrixLieGroup, ProductGroup, principal_moments
from eqt_cli.components.matrix_groups import EuclideanGroup
from eqt_cli.numbers.instants import instants_of
from eqt_cli.numbers.jets import value_and_derivative
from eqt_cli.numbers.leaves import STRUCTURE

# Inertia tensors, constant or varying in time, and the force that compensates their change --------
#
# An inertia law gives, at a time t, the tensor 𝕀_t with its inverse, and a matrix A with
# A + Aᵀ = 𝕀̇_t: the feedforward Ṡ*S⁻* P of Theorem 3.2 is A V. The paper's factor S, with
# 𝕀_t = S* 𝕀_0 S, is not unique; its choices differ by the skew part of A, a gyroscopic force
# without power.


class InertiaLaw(ABC):
    """The inertia tensor as a function of time."""

    @abstractmethod
    def at(self, t: Any) -> Inertia:
        """Return the tensor at time t: a number, an array ``(samples,)`` or a symbol."""

    def matrix_at(self, t: Any) -> Array:
        """𝕀_t without its inverse, so that it may be singular."""
        return self.at(t).matrix

    def instants(self, G: MatrixLieGroup, until: float) -> Array:
        """Return the times at which an expression changes its piece, and of short pulses."""
        return instants_of(self.expressions, until)

    @property
    def expressions(self) -> list[Expression]:
        """The expressions in t."""
        return []

    def with_functions(self, new: Callable[[], Expression]) -> Self:
        """Return the law with a new function of time for each of its expressions."""
        return self


@dataclass(frozen=True)
class Inertia(InertiaLaw):
    """The inertia tensor 𝕀: g → g* as a matrix, at one time or, as a law, at all times.

    Attributes
    ----------
    matrix, inverse : (..., m, m)
        𝕀 and 𝕀⁻¹.
    change : (..., m, m), optional
        A, with A + Aᵀ = 𝕀̇; None where the inertia is constant.
    added : (m, m), optional
        The part of 𝕀 that moves with a current; None where it is not known.
    leaves
        Whether mass leaves or joins at the velocity of the body, so that 𝕀V̇ = ad*_V P + τ.
    """

    matrix: Array
    inverse: Array
    change: Array | None = None
    added: Array | None = field(default=None, kw_only=True, compare=False, metadata=STRUCTURE)
    leaves: bool = field(default=False, kw_only=True, metadata=STRUCTURE)

    def momentum(self, V: Array) -> Array:
        """P = 𝕀 V."""
        return apply_matrix(self.matrix, V)

    def velocity(self, P: Array) -> Array:
        """V = δh/δP = 𝕀⁻¹ P, Hampsey et al. (2025), eq. (6) and (9)."""
        return apply_matrix(self.inverse, P)

    def feedforward(self, V: Array) -> Array | float:
        """Ṡ*S⁻* P = A V, Hampsey et al. (2025), eq. (11); 0.0 if constant, or if mass leaves."""
        return 0.0 if self.change is None or self.leaves else apply_matrix(self.change, V)

    def rate_force(self, V: Array) -> Array | float:
        """𝕀̇ V, which slows the body as 𝕀 grows; 0.0 if constant, or if mass leaves."""
        return 0.0 if self.leaves else self._rate(V)

    def leaving(self, V: Array) -> Any:
        """𝕀̇ V, the rate of the momentum that mass takes along or brings; 0.0 if none leaves."""
        return self._rate(V) if self.leaves else 0.0

    def _rate(self, V: Array) -> Any:
        if self.change is None:
            return 0.0
        return apply_matrix(self.change + transpose(self.change), V)

    def at(self, t: Any) -> Inertia:
        """Return this tensor at every time."""
        return self


@dataclass(frozen=True)
class FactoredInertia(InertiaLaw):
    """𝕀_t = S_tᵀ 𝕀_0 S_t with S given as expressions in t, as in Theorem 3.2.

    Attributes
    ----------
    initial : (m, m)
        𝕀_0.
    factor
        m rows of m expressions; S(0) = I.
    leaves
        As of an `Inertia`.
    """

    initial: Array
    factor: tuple[tuple[Expression, ...], ...] = field(metadata=STRUCTURE)
    leaves: bool = field(default=False, metadata=STRUCTURE)

    def at(self, t: Any) -> Inertia:
        """𝕀_t, and A = Ṡᵀ 𝕀_0 S, since S⁻* P = 𝕀_0 S V."""
        S, rate = _matrix_and_rate(self.factor, t)
        image = self.initial @ S
        matrix = transpose(S) @ image
        return Inertia(matrix, inverse_spd(matrix), transpose(rate) @ image, leaves=self.leaves)

    def factor_at(self, t: Any) -> Array:
        """S_t."""
        return _matrix_and_rate(self.factor, t)[0]

    def matrix_at(self, t: Any) -> Array:
        """𝕀_t without its inverse, so that it may be singular."""
        S = self.factor_at(t)
        return transpose(S) @ self.initial @ S

    @property
    def expressions(self) -> list[Expression]:
        """Those of S."""
        return [*chain(*self.factor)]

    def with_functions(self, new: Callable[[], Expression]) -> Self:
        """Return the law with any factor."""
        return replace(self, factor=tuple(tuple(new() for _ in row) for row in self.factor))


@dataclass(frozen=True)
class PrescribedInertia(InertiaLaw):
    """𝕀_t given as expressions in t; the feedforward takes the symmetric choice A = ½𝕀̇.

    Attributes
    ----------
    matrix
        m rows of m expressions.
    leaves
        As of an `Inertia`.
    """

    matrix: tuple[tuple[Expression, ...], ...] = field(metadata=STRUCTURE)
    leaves: bool = field(default=False, metadata=STRUCTURE)

    def at(self, t: Any) -> Inertia:
        """𝕀_t, and A = ½𝕀̇_t."""
        matrix, rate = _matrix_and_rate(self.matrix, t)
        return Inertia(matrix, inverse_spd(matrix), rate / 2, leaves=self.leaves)

    def matrix_at(self, t: Any) -> Array:
        """𝕀_t without its inverse, so that it may be singular."""
        return _matrix_and_rate(self.matrix, t)[0]

    @property
    def expressions(self) -> list[Expression]:
        """Those of 𝕀."""
        return [*chain(*self.matrix)]

    def with_functions(self, new: Callable[[], Expression]) -> Self:
        """Return the law with any symmetric matrix."""
        lower = [[new() for _ in row[: i + 1]] for i, row in enumerate(self.matrix)]
        size = range(len(lower))
        rows = tuple(tuple(lower[max(i, j)][min(i, j)] for j in size) for i in size)
        return replace(self, matrix=rows)


def _matrix_and_rate(rows: tuple[tuple[Expression, ...], ...], t: Any) -> tuple[Array, Array]:
    """Return a matrix of expressions and its time derivative at t, ``(..., m, m)`` each."""
    pairs = [value_and_derivative(entry, {"t": t}) for row in rows for entry in row]
    entries, rates = (stack(list(parts)) for parts in zip(*pairs, strict=True))
    size = len(rows)
    matrix = entries.reshape(*entries.shape[:-1], size, size)
    return matrix, rates.reshape(*rates.shape[:-1], size, size)


ROUNDING = 1e-9
"""Tolerance relative to the largest moment, which in a flat body is the sum of the others."""

INSTANTS = 101
"""Number of instants of the horizon at which a varying inertia is checked."""


def matrices_at(law: InertiaLaw, times: Array) -> Array:
    """Return 𝕀_t at some times, ``(n, m, m)``, also where it is singular or not finite."""
    with np.errstate(all="ignore"):
        matrix = law.matrix_at(times)
    return np.broadcast_to(matrix, (len(times), *matrix.shape[-2:]))


def over_horizon(law: InertiaLaw, horizon: float) -> tuple[Array, Array]:
    """Return instants of the horizon, one for a constant inertia, and `matrices_at` them."""
    times = np.zeros(1) if isinstance(law, Inertia) else np.linspace(0.0, horizon, INSTANTS)
    return times, matrices_at(law, times)


def not_rigid(G: MatrixLieGroup, law: InertiaLaw, horizon: float) -> str:
    """Describe why no rigid body can have this inertia; empty if one can.

    Principal moments about the centre of mass, J₁ ≤ J₂ ≤ J₃, are sums of squared distances over the
    mass, so that they satisfy the triangle inequality J₁ + J₂ ≥ J₃.
    """
    times, matrices = over_horizon(law, horizon)
    if isinstance(law, Inertia) and law.added is not None:
        matrices = matrices - law.added
    others = principal_moments(G, with_other_products(G, matrices))
    for moments, other in zip(principal_moments(G, matrices), others, strict=True):
        low, middle, high = moments.T
        broken = np.flatnonzero(low + middle < high * (1 - ROUNDING))
        if broken.size:
            when = "" if len(times) == 1 else f" at t = {times[broken[0]]:g} s"
            low, middle, high = other[broken[0]]
            hint = OTHER_SIGN if low > 0 and low + middle >= high * (1 - ROUNDING) else ""
            J = [f"{moment:.4g}" for moment in moments[broken[0]]]
            return (
                f"principal moments {J[0]}, {J[1]} and {J[2]} kg m² violate the triangle "
                f"inequality: {J[0]} + {J[1]} < {J[2]}{when}{hint}"
            )
    return ""


OTHER_SIGN = (
    " (with the other sign of its products of inertia it would be one: off the diagonal stands "
    "−∫xy dm)"
)


def with_other_products(G: MatrixLieGroup, matrices: Array) -> Array:
    """Return tensors with the other sign of their products of inertia."""
    signs = np.ones((G.dimension, G.dimension))
    for part in G.parts:
        if part.turns:
            signs[part.axes, part.axes] = 2 * np.eye(len(signs[part.axes])) - 1
    return matrices * signs


UNEQUAL, DENSITIES = 10, (1e-2, 1e5)
"""Ratio of masses by direction, and mean densities within the radius of gyration, kg/m³, beyond
which moments and masses look exchanged."""


def in_other_order(G: MatrixLieGroup, law: InertiaLaw) -> str:
    """Return a remark on an inertia of a body whose masses stand before its moments; or ""."""
    now = law.at(0.0)
    M = now.matrix if now.added is None else now.matrix - now.added
    k = 0 if G.translation is None else G.translation.axes.start
    n = G.dimension - k
    if not k or _is_plausible(M[:k, :k], M[k:, k:]) or not _is_plausible(M[n:, n:], M[:n, :n]):
        return ""
    return (
        "looks as if masses stood before moments of inertia, as in Fossen's order; on "
        f"{G.name} the rotation comes first: move the last {k} rows and columns to the front; or "
        "the moments are not in kg m^2"
    )


def _is_plausible(moments: Array, masses: Array) -> bool:
    sizes, mass = np.linalg.eigvalsh(masses), np.trace(masses) / len(masses)
    radius = np.sqrt(np.trace(moments) / len(moments) / mass)
    low, high = DENSITIES
    is_dense = low <= mass / (4 / 3 * np.pi * radius**3) <= high
    return bool(is_dense and sizes[-1] <= UNEQUAL * sizes[0])


# The critical points of the navigation function Υ, in closed form where the group allows it -------
#
# On SO(n) ⋉ (R^n)^k with the weight K = [[A, B], [Bᵀ, C]] the translations of a critical point
# follow from its rotation, X = −(R − I) B C⁻¹. The rest is Υ of the rotation alone, with the Schur
# complement A − B C⁻¹Bᵀ as its weight. Its critical points are I and half-turns: in space about the
# unit eigenvectors of that weight, where a repeated eigenvalue has a whole eigenspace of them.


SAME_EIGENVALUE = 1e-9
"""Relative distance up to which eigenvalues of the weight count as equal.

It allows for numbers written in decimal and for rounding of their eigenvalues.
"""


@dataclass(frozen=True)
class CriticalSet:
    """A connected set of critical points of Υ: one point, or a manifold of them.

    Attributes
    ----------
    name
        A description: ``half-turn about (1, 0, 0)``.
    dimension
        The dimension of the set: 0 for a point.
    Q : (d, d)
        A point of the set.
    hessian : (m,)
        The eigenvalues of the Hessian of Υ there, rising.
    axes : (n, k), or None
        For half-turns in space, an orthonormal basis of their axes.
    offset : (n, k), or None
        For half-turns in space, D, with the translations (I − R) D at a rotation R of the set.
    factors
        For a product, one set per factor.
    """

    name: str
    dimension: int
    Q: Array
    hessian: Array
    axes: Array | None = None
    offset: Any = None
    factors: tuple[CriticalSet, ...] = ()

    @property
    def nullity(self) -> int:
        """The number of eigenvalues of the Hessian that are 0."""
        return int((np.abs(self.hessian) <= self._zero).sum())

    @property
    def index(self) -> int:
        """The number of negative eigenvalues: directions in which Υ falls."""
        return int((self.hessian < -self._zero).sum())

    @property
    def _zero(self) -> float:
        return SAME_EIGENVALUE * float(np.abs(self.hessian).max(initial=0.0))

    def squared_distance(self, Q: Array) -> Array:
        """Return the least ‖Q − Q_c‖_F² over points Q_c of the set, ``(..., d, d) -> (...)``."""
        if self.factors:
            start, total = 0, np.zeros(Q.shape[:-2])
            for factor in self.factors:
                place = slice(start, start + len(factor.Q))
                total = total + factor.squared_distance(Q[..., place, place])
                start = place.stop
            return total
        if self.axes is None or self.axes.shape[1] == 1:
            return _square_norm(Q - self.Q)
        return self._distance_to_half_turns(Q, self.axes)

    def _distance_to_half_turns(self, Q: Array, axes: Array) -> Array:
        """With R_n = 2nnᵀ − I the squared distance is a constant minus a quadratic form in n."""
        size, D = len(axes), self.offset
        R, Y = Q[..., :size, :size], Q[..., :size, size:] - 2 * D
        trace = _sum(R[..., axis, axis] for axis in range(size))
        constant = _square_norm(R) + size + 2 * trace + _square_norm(Y)
        if axes.shape[1] == size and not D.any():
            # A rotation does not change its axis, so the largest eigenvalue of R + Rᵀ is 2.
            return maximum(constant - 4, 0.0)
        form = 2 * (R + transpose(R)) - 2 * (D @ transpose(Y) + Y @ D.T) - 4 * D @ D.T
        finite = np.isfinite(constant)  # failed runs are NaN, which LAPACK does not accept
        within = np.where(finite[..., None, None], axes.T @ form @ axes, 0.0)
        return np.maximum(constant - np.linalg.eigvalsh(within)[..., -1], 0.0)


def _square_norm(matrices: Array) -> Array:
    """Return ‖A‖_F² of each matrix."""
    rows, columns = matrices.shape[-2:]
    entries = (matrices[..., i, j] for i in range(rows) for j in range(columns))
    return _sum(entry * entry for entry in entries)


def _sum(terms: Iterable[Array]) -> Any:
    """Return the sum of floats or symbols in the order of the terms, so that both round alike."""
    return reduce(operator.add, terms, 0.0)


def critical_sets(G: MatrixLieGroup, K: Array) -> list[CriticalSet] | None:
    """Return all critical sets of Υ, the identity first; None where they are not known.

    Parameters
    ----------
    K : (d, d)
        Symmetric weight for which the identity is a non-degenerate minimum, or the k c cᵀ of an
        axis.
    """
    if isinstance(G, ProductGroup):
        return _of_product(G, K)
    if isinstance(G, EuclideanGroup):
        return _of_rigid_motions(G, K)
    return None


def common_weight(K: Array) -> Array:
    """Return weights with the critical points of K, ``(..., d, d)``; one ``(d, d)`` if all agree.

    Multiples of the identity have the critical points of the identity.
    """
    one = np.eye(K.shape[-1])
    weights = np.where((K == K[..., :1, :1] * one).all(axis=(-2, -1), keepdims=True), one, K)
    flat = weights.reshape(-1, *K.shape[-2:])
    return flat[0] if (flat == flat[0]).all() else weights


def distance_to_unstable(G: MatrixLieGroup, K: Array, Q: Array) -> Array:
    """Return the least ‖Q − Q_c‖_F over critical points of Υ other than I, ``(...)``.

    NaN where there are none, or they are not known. K may vary along the first axis of Q. A weight
    of another group, as that of a cascade's attitude law, has none.
    """
    if K.shape[-1] != G.size:
        return np.full(Q.shape[:-2], np.nan)
    if K.ndim > 2:
        weights, which = np.unique(K.reshape(len(K), -1), axis=0, return_inverse=True)
        distances = np.empty(Q.shape[:-2])
        for index, weight in enumerate(weights):
            mine = which.reshape(-1) == index
            distances[mine] = distance_to_unstable(G, weight.reshape(K.shape[-2:]), Q[mine])
        return distances
    unstable = _unstable_sets(G, np.asarray(K, dtype=float).tobytes())
    if not unstable:
        return np.full(Q.shape[:-2], np.nan)
    return sqrt(reduce(minimum, [points.squared_distance(Q) for points in unstable]))


@lru_cache(maxsize=64)
def _unstable_sets(G: MatrixLieGroup, weight: bytes) -> tuple[CriticalSet, ...]:
    """Return all sets but the identity, where they are known; cached for all runs of a weight."""
    return tuple(critical_sets(G, np.frombuffer(weight).reshape(G.size, G.size)) or ())[1:]


def _of_rigid_motions(G: EuclideanGroup, K: Array) -> list[CriticalSet]:
    n = G.space
    A, B, C = K[:n, :n], K[:n, n:], K[n:, n:]
    D = B @ np.linalg.inv(C) if G.columns else np.zeros((n, 0))
    sets = [CriticalSet("identity", 0, G.identity, _hessian(G, K, G.identity))]
    if not G.rotations:
        return sets
    if n == 2:
        R = -np.eye(2)
        Q = G.assemble(R, (np.eye(2) - R) @ D)
        return [*sets, CriticalSet("half-turn", 0, Q, _hessian(G, K, Q))]
    values, vectors = np.linalg.eigh(A - B @ D.T)
    for axes in _eigenspaces(values, vectors):
        R = 2 * np.outer(axes[:, 0], axes[:, 0]) - np.eye(3)
        Q = G.assemble(R, (np.eye(3) - R) @ D)
        sets.append(CriticalSet(_name(axes), axes.shape[1] - 1, Q, _hessian(G, K, Q), axes, D))
    if sets[0].nullity:  # K = k c cᵀ of `task: point`: turns about c keep Υ = 0
        turns = replace(sets[0], name=f"turns about {_direction(vectors[:, -1])}", dimension=1)
        return [turns, sets[1]]
    return sets


def _of_product(G: ProductGroup, K: Array) -> list[CriticalSet] | None:
    """Υ is a sum over the factors, because off-diagonal blocks of K do not enter the trace."""
    from scipy.linalg import block_diag  # slow to import, and not needed to read results

    sets = [CriticalSet("", 0, np.zeros((0, 0)), np.zeros(0))]
    for factor, place in zip(G.factors, G.places, strict=True):
        of_factor = critical_sets(factor, K[place, place])
        if of_factor is None:
            return None
        sets = [
            CriticalSet(
                name=f"{left.name} × {right.name}" if left.name else right.name,
                dimension=left.dimension + right.dimension,
                Q=block_diag(left.Q, right.Q) if left.name else right.Q,
                hessian=np.sort(np.concatenate([left.hessian, right.hessian])),
                factors=(*left.factors, right),
            )
            for left in sets
            for right in of_factor
        ]
    return sets


def _hessian(G: MatrixLieGroup, K: Array, Q: Array) -> Array:
    """Return the eigenvalues of the Hessian at a critical point, ∂²Υ(Q exp(V)) at V = 0.

    With Q exp(V) = Q + Q V^ + ½Q V^² + … its entries are
    tr(Q E_i K (Q E_j)ᵀ) + ½ tr((Q − I) K (Q{E_i, E_j})ᵀ).
    """
    E = G.basis
    moved = Q @ E
    first = np.einsum("iab,bc,jac->ij", moved, K, moved)
    pairs = E[:, None] @ E[None]
    twice = Q @ (pairs + pairs.swapaxes(0, 1))
    second = np.einsum("ab,ijab->ij", (Q - G.identity) @ K, twice) / 2
    return np.linalg.eigvalsh(first + second)


def _eigenspaces(values: Array, vectors: Array) -> list[Array]:
    """Return orthonormal bases of the eigenspaces, ``(n, k)`` each, by rising eigenvalue."""
    last = np.flatnonzero(np.diff(values) > SAME_EIGENVALUE * np.abs(values).max())
    return np.split(vectors, last + 1, axis=1)


def _name(axes: Array) -> str:
    if axes.shape[1] == 3:
        return "half-turns about every axis"
    if axes.shape[1] == 2:
        normal = np.cross(axes[:, 0], axes[:, 1])
        return f"half-turns about every axis normal to {_direction(normal)}"
    return f"half-turn about {_direction(axes[:, 0])}"


def _direction(axis: Array) -> str:
    """Format an axis to three digits, with its largest entry positive."""
    axis = axis * np.sign(axis[np.abs(axis).argmax()])
    return "(" + ", ".join(f"{round(float(entry), 3) + 0.0:g}" for entry in axis) + ")"
