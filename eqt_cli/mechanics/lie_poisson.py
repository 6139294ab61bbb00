"""The extended Lie-Poisson system on any matrix Lie group."""

from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup


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
