"""The equivariant filter on the tangent group."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from eqt_cli.core.arrays import Array, apply_matrix, transpose
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.estimators.base import Estimate
from eqt_cli.vehicle.estimators.error_state import ErrorStateFilter, mirrored


@dataclass(frozen=True)
class Eqf(ErrorStateFilter):
    """Equivariant filter whose symmetry is the tangent group G ⋉ g.

    Its error is (QQ̂⁻¹, Ad_Q̂ b̃) = exp(ε_r, ε_b) in that group, so that ε_r = Ad_Q̂ ε and
    ε_b = Ad_Q̂ b̃ to first order: ε̇_r = −ε_b, ε̇_b = ad_{Ad_Q̂ V̂} ε_b. A correction is the exponential
    of the tangent group, from the left, and Σ stays as it is in these coordinates. A fix is read to
    third order, r = (I − ½ad_r) ε + n. Here Σ is kept in the body frame, by Ad_Q̂⁻¹, where the same
    Φ moves it.

    Fornasier, Ng, Brommer, Böhm, Mahony, Weiss, IEEE Robot. Autom. Lett. 7 (2022) 12118 (Overcoming
    Bias); Fornasier, Ge, van Goor, Mahony, Weiss, Automatica 182 (2025) 112495 (Equivariant
    Symmetries for Inertial Navigation Systems).
    """

    name: ClassVar[str] = "eqf"

    def output(self, G: MatrixLieGroup, residual: Array) -> Array:
        """Return [I − ½ad_r  0]."""
        m = G.dimension
        H = np.zeros_like(residual, shape=(*residual.shape[:-1], m, 2 * m))
        H[..., :m] = np.eye(m) - G.ad_matrix(residual) / 2
        return H

    def moved(self, G: MatrixLieGroup, now: Estimate, by: Array) -> Estimate:
        """Return Q̂ exp(δ_ε), b̂ + J(−δ_ε) δ_b, and Σ transported by Ad_{exp(−δ_ε)}."""
        m, S = G.dimension, now.covariance
        step = G.exp(by[..., :m])
        bias = now.bias + apply_matrix(G.jacobian(-by[..., :m]), by[..., m:])
        carry = G.Ad_matrix(G.inverse(step))
        covariance = np.zeros_like(S)
        for rows in (slice(0, m), slice(m, 2 * m)):
            for columns in (slice(0, m), slice(m, 2 * m)):
                covariance[..., rows, columns] = carry @ S[..., rows, columns] @ transpose(carry)
        return Estimate(now.pose @ step, bias, mirrored(covariance))
