"""Motions in closed form, Q(t) = Q_0 Π_k exp(a_k(t) ξ_k), on any group: products and splines.

It knows no kind of reference.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from eqt_cli.core.arrays import Array, apply_matrix
from eqt_cli.core.errors import InputError
from eqt_cli.groups import MatrixLieGroup

ROUNDING = 1e-14
"""A change of velocities, relative to the largest, that is no more than rounding."""

STALLED = 1e-10
"""A change below which the iteration may stop where it comes no further."""

MOST_ITERATIONS = 300

SAME_TIME = 1e-12
"""Relative: what times that are meant to be equal may differ by, as for engines."""

TINY = 1e-300


class Factor(NamedTuple):
    """One factor exp(a(t) ξ).

    Attributes
    ----------
    vector : (..., m)
        ξ.
    terms, rates : (..., 3, n), (..., k)
        The same as the group's `screw` gives it.
    a, rate, second : (..., 1)
        a, a' and a''.
    """

    vector: Array
    terms: Array
    rates: Array
    a: Array
    rate: Array
    second: Array


def motion_along(
    G: MatrixLieGroup, Q: Array, factors: Iterable[Factor]
) -> tuple[Array, Array, Array]:
    """Q, V = Q⁻¹Q̇ and V̇ of a product of factors.

    With A = exp(aξ), Q ← QA changes V to W + a'ξ with W = Ad_{A⁻¹}V, and V̇ to
    Ad_{A⁻¹}V̇ + a'[W, ξ] + a''ξ.

    Parameters
    ----------
    Q : (..., d, d)
        Q_0, which is constant.
    """
    V = V_dot = None
    for factor in factors:
        A = G.exp_along(factor.terms, factor.a * factor.rates)
        Q = Q @ A
        rate, second = factor.rate * factor.vector, factor.second * factor.vector
        if V is None or V_dot is None:
            V, V_dot = rate, second
            continue
        adjoint = G.Ad_matrix(G.inverse(A))
        W = apply_matrix(adjoint, V)
        V = W + rate
        V_dot = apply_matrix(adjoint, V_dot) + factor.rate * G.ad(W, factor.vector) + second
    assert V is not None and V_dot is not None
    return Q, V, V_dot


# Motions in pieces --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Pieces:
    """Q(t) = Q_i Π_k exp(a_ik(t − t_i) ξ_ik) from t_i to t_{i+1}, a_ik polynomials.

    Attributes
    ----------
    starts : (n,)
        t_i, s.
    poses : (n, d, d)
        Q_i.
    vectors : (n, factors, m)
        ξ_ik.
    coefficients : (n, factors, degree + 1)
        Of a_ik, in ascending powers.
    """

    starts: Array
    poses: Array
    vectors: Array
    coefficients: Array

    def at(self, G: MatrixLieGroup, t: Any) -> dict[str, Array]:
        """The numbers of the piece that a time, or each of some times, is in."""
        # An engine may begin a span at a sample time that is t_i but for rounding.
        late = t + SAME_TIME * np.maximum(1.0, np.abs(t))
        index = np.maximum(np.searchsorted(self.starts, late, side="right") - 1, 0)
        vectors = self.vectors[index]
        terms, rates = G.screw(vectors)
        return {
            "since": self.starts[index],
            "pose": G.pack(self.poses[index]),
            "vectors": vectors,
            "terms": terms,
            "rates": rates,
            "coefficients": self.coefficients[index],
        }


def motion_of_piece(
    G: MatrixLieGroup, piece: Mapping[str, Array], t: Any
) -> tuple[Array, Array, Array]:
    """Q, V and V̇ at time t by the numbers of `Pieces.at`, which may be symbols."""
    local = np.asarray(t) - piece["since"]
    coefficients = piece["coefficients"]
    a, rate, second = polynomial(coefficients, np.asarray(local)[..., None])
    factors = (
        Factor(
            piece["vectors"][..., k, :],
            piece["terms"][..., k, :, :],
            piece["rates"][..., k, :],
            a[..., k, None],
            rate[..., k, None],
            second[..., k, None],
        )
        for k in range(coefficients.shape[-2])
    )
    return motion_along(G, G.unpack(piece["pose"]), factors)


def polynomial(coefficients: Array, t: Array) -> tuple[Array, Array, Array]:
    """Σ c_p t^p with its first two derivatives; ``(..., degree + 1)`` and ``(...)``."""
    value = rate = second = 0.0 * coefficients[..., 0]
    for p in reversed(range(coefficients.shape[-1])):
        second = second * t + 2 * rate
        rate = rate * t + value
        value = value * t + coefficients[..., p]
    return value, rate, second


CUBIC = np.array([[0.0, 3.0, -3.0, 1.0], [0.0, 0.0, 3.0, -2.0], [0.0, 0.0, 0.0, 1.0]])
"""The cumulative Bernstein polynomials of degree 3 on [0, 1], which rise from 0 to 1."""


def spline(G: MatrixLieGroup, times: Array, poses: Array) -> Pieces:
    """The cubic spline through poses at times that need not be uniform.

    Each piece is a Bézier curve on the group, Q_i exp(β₁ω₁) exp(β₂ω₂) exp(β₃ω₃) with ω₁ = hV_i/3,
    ω₃ = hV_{i+1}/3 and ω₂ such that it ends in Q_{i+1} (Kim, Kim and Shin, SIGGRAPH 1995): it goes
    through the poses with the velocities V_i whatever these are. They are solved for, so that
    the acceleration has no jumps, and is 0 at both ends. In a vector space this is the natural
    cubic spline, which equals the B-spline through the same points.

    Parameters
    ----------
    times : (n + 1,)
    poses : (n + 1, d, d)

    Raises
    ------
    InputError
        Where consecutive poses are too far apart.
    """
    h = np.diff(times)[:, None]
    step = G.inverse(poses[:-1]) @ poses[1:]
    # Newton's method with the matrix of a vector space, where it takes one iteration.
    from scipy.linalg import solve_banded  # slow to import; readers of results do without

    matrix = np.zeros((3, len(times)))
    matrix[0, 1:] = matrix[2, :-1] = 1 / (3 * h[:, 0])
    matrix[1, :-1] += 2 / (3 * h[:, 0])
    matrix[1, 1:] += 2 / (3 * h[:, 0])
    V = np.zeros((len(times), G.dimension))
    sizes: list[float] = []
    for _ in range(MOST_ITERATIONS):
        first, last = h * V[:-1] / 3, h * V[1:] / 3
        middle = G.log(G.exp(-first) @ step @ G.exp(-last))
        jump = np.zeros_like(V)  # of the acceleration at each time, over 6
        jump[:-1] += (middle - first) / h**2
        jump[1:] -= (last - G.Ad(G.exp(-last), middle)) / h**2
        change = solve_banded((1, 1), matrix, jump)
        sizes.append(float(np.abs(change).max() / max(np.abs(V).max(), np.abs(change).max(), TINY)))
        stalled = len(sizes) > 5 and sizes[-1] < STALLED and sizes[-1] >= min(sizes[-4:-1])
        if sizes[-1] <= ROUNDING or stalled:
            vectors = np.stack([first, middle, last], axis=1)
            coefficients = CUBIC / h[:, :, None] ** np.arange(4)
            return Pieces(times[:-1], poses[:-1], vectors, coefficients)
        V = V + change
    raise InputError("no smooth motion was found through these poses; give more where they turn")


def eased(G: MatrixLieGroup, start: float, end: float, pose: Array, turn: Array) -> Pieces:
    """From rest to rest along the geodesic pose·exp(a·turn), before and after which it stands.

    a(s) = 10s³ − 15s⁴ + 6s⁵, whose velocity and acceleration are 0 at both ends.
    """
    quintic = np.array([0.0, 0.0, 0.0, 10.0, -15.0, 6.0]) / (end - start) ** np.arange(6)
    still = np.zeros(6)
    return Pieces(
        np.array([min(start, 0.0) - 1.0, start, end]),
        np.stack([pose, pose, pose @ G.exp(turn)]),
        np.stack([turn, turn, turn])[:, None],
        np.stack([still, quintic, still])[:, None],
    )
