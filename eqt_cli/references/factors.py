"""Q(t) = Q_0 Π_k exp(a_k(t) ξ_k) with its velocity and acceleration, on any group.

It knows no kind of reference.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from eqt_cli.core.arrays import Array, apply_matrix
from eqt_cli.groups import MatrixLieGroup


class Factor(NamedTuple):
    """One factor exp(a(t) ξ).

    Attributes
    ----------
    vector : (..., m)
        ξ.
    axis, rates : (..., m), (..., k)
        The same as the group's `screw` gives it.
    a, rate, second : (..., 1)
        a, a' and a''.
    """

    vector: Array
    axis: Array
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
        A = G.exp_along(factor.axis, factor.a * factor.rates)
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
