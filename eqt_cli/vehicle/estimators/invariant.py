"""The left-invariant extended Kalman filter."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.estimators.base import Estimate
from eqt_cli.vehicle.estimators.error_state import ErrorStateFilter


@dataclass(frozen=True)
class Invariant(ErrorStateFilter):
    """Left-invariant extended Kalman filter with a bias of the velocity.

    Barrau and Bonnabel, IEEE Trans. Autom. Control 62 (2017) 1797, with the bias beside the pose:
    the residual of a fix is ε + n, and a correction δ gives Q̂ exp(δ_ε) and b̂ + δ_b.
    """

    name: ClassVar[str] = "invariant"

    def output(self, G: MatrixLieGroup, residual: Array) -> Array:
        """Return [I 0]."""
        m = G.dimension
        H = np.zeros_like(residual, shape=(*residual.shape[:-1], m, 2 * m))
        H[...] = np.eye(m, 2 * m)
        return H

    def moved(self, G: MatrixLieGroup, now: Estimate, by: Array) -> Estimate:
        """Return Q̂ exp(δ_ε), b̂ + δ_b."""
        m = G.dimension
        return now._replace(pose=now.pose @ G.exp(by[..., :m]), bias=now.bias + by[..., m:])
