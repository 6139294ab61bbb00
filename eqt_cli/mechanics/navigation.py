"""The navigation function Υ(Q) = ½ tr((Q − I) K (Q − I)ᵀ) and its gradient, on any group."""

from eqt_cli.core.arrays import Array, times, transpose
from eqt_cli.groups import MatrixLieGroup


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


def hessian_times(G: MatrixLieGroup, K: Array, x: Array) -> Array:
    """Return H x, ``(..., m)``: `gradient` to first order in a small error x."""
    return G.contract(times(G.hat(x), K))
