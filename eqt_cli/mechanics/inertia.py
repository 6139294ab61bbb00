"""Inertia tensors, constant or varying in time, and the force that compensates their change.

An inertia law gives, at a time t, the tensor 𝕀_t with its inverse, and a matrix A with
A + Aᵀ = 𝕀̇_t: the feedforward Ṡ*S⁻* P of Theorem 3.2 is A V. The paper's factor S, with
𝕀_t = S* 𝕀_0 S, is not unique; its choices differ by the skew part of A, a gyroscopic force
without power.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from eqt_cli.core.arrays import Array, apply_matrix, inverse_spd, stack, transpose
from eqt_cli.core.expressions import Expression
from eqt_cli.core.jets import value_and_derivative
from eqt_cli.core.leaves import STRUCTURE
from eqt_cli.groups import MatrixLieGroup


class InertiaLaw(ABC):
    """The inertia tensor as a function of time."""

    @abstractmethod
    def at(self, t: Any) -> Inertia:
        """Return the tensor at time t: a number, an array ``(samples,)`` or a symbol."""

    def matrix_at(self, t: Any) -> Array:
        """𝕀_t without its inverse, so that it may be singular."""
        return self.at(t).matrix

    def with_functions(self, new: Callable[[], Expression]) -> Self:
        """Return the law with a new function of time for each of its expressions."""
        return self


@dataclass(frozen=True)
class Inertia(InertiaLaw):
    """The inertia tensor 𝕀: g → g* as a matrix, at one time or, as a law of its own, at all times.

    Attributes
    ----------
    matrix, inverse : (..., m, m)
        𝕀 and 𝕀⁻¹.
    change : (..., m, m), optional
        A, with A + Aᵀ = 𝕀̇; None where the inertia is constant.
    """

    matrix: Array
    inverse: Array
    change: Array | None = None

    def momentum(self, V: Array) -> Array:
        """P = 𝕀 V."""
        return apply_matrix(self.matrix, V)

    def velocity(self, P: Array) -> Array:
        """V = δh/δP = 𝕀⁻¹ P, Hampsey et al. (2025), eq. (6) and (9)."""
        return apply_matrix(self.inverse, P)

    def feedforward(self, V: Array) -> Array | float:
        """Ṡ*S⁻* P = A V, Hampsey et al. (2025), eq. (11); 0.0 where the inertia is constant."""
        return 0.0 if self.change is None else apply_matrix(self.change, V)

    def rate_force(self, V: Array) -> Array | float:
        """𝕀̇ V; 0.0 where the inertia is constant."""
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
    """

    initial: Array
    factor: tuple[tuple[Expression, ...], ...] = field(metadata=STRUCTURE)

    def at(self, t: Any) -> Inertia:
        """𝕀_t, and A = Ṡᵀ 𝕀_0 S, since S⁻* P = 𝕀_0 S V."""
        S, rate = _matrix_and_rate(self.factor, t)
        image = self.initial @ S
        matrix = transpose(S) @ image
        return Inertia(matrix, inverse_spd(matrix), transpose(rate) @ image)

    def factor_at(self, t: Any) -> Array:
        """S_t."""
        return _matrix_and_rate(self.factor, t)[0]

    def matrix_at(self, t: Any) -> Array:
        """𝕀_t without its inverse, so that it may be singular."""
        S = self.factor_at(t)
        return transpose(S) @ self.initial @ S

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
    """

    matrix: tuple[tuple[Expression, ...], ...] = field(metadata=STRUCTURE)

    def at(self, t: Any) -> Inertia:
        """𝕀_t, and A = ½𝕀̇_t."""
        matrix, rate = _matrix_and_rate(self.matrix, t)
        return Inertia(matrix, inverse_spd(matrix), rate / 2)

    def matrix_at(self, t: Any) -> Array:
        """𝕀_t without its inverse, so that it may be singular."""
        return _matrix_and_rate(self.matrix, t)[0]

    def with_functions(self, new: Callable[[], Expression]) -> Self:
        """Return the law with any symmetric matrix."""
        lower = [[new() for _ in row[: i + 1]] for i, row in enumerate(self.matrix)]
        size = range(len(lower))
        rows = tuple(tuple(lower[max(i, j)][min(i, j)] for j in size) for i in size)
        return replace(self, matrix=rows)


def _matrix_and_rate(rows: tuple[tuple[Expression, ...], ...], t: Any) -> tuple[Array, Array]:
    """Return a matrix of expressions and its time derivative at t, ``(..., m, m)`` each."""
    pairs = [[value_and_derivative(entry, {"t": t}) for entry in row] for row in rows]
    size = len(rows)
    entries = stack([value for row in pairs for value, _ in row])
    rates = stack([rate for row in pairs for _, rate in row])
    shape = (*entries.shape[:-1], size, size)
    return entries.reshape(shape), rates.reshape(*rates.shape[:-1], size, size)


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
    for moments in G.principal_moments(matrices):
        low, middle, high = moments.T
        broken = np.flatnonzero(low + middle < high * (1 - ROUNDING))
        if broken.size:
            when = "" if len(times) == 1 else f" at t = {times[broken[0]]:g} s"
            return _in_words(moments[broken[0]]) + when
    return ""


def _in_words(moments: Array) -> str:
    low, middle, high = (f"{moment:.4g}" for moment in moments)
    return (
        f"principal moments {low}, {middle} and {high} kg m² violate the triangle inequality: "
        f"{low} + {middle} < {high}"
    )
