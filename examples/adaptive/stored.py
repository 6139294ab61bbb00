"""The geometric adaptive law as a public benchmark stores it; see docs/experiments/adaptive.md.

Read from `controller/geometric_adaptive_controller.py` of AdaptiveQuadBench (the fork
valmik/AdaptiveQuadBench, commit 4857541, https://github.com/valmik/AdaptiveQuadBench); of it, only
the two lines of the position are here.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from eqt_cli.extend import Array, Cascade, MatrixLieGroup, Positive, Tracking, dot, less, where


@dataclass(frozen=True)
class StoredAdaptive(Cascade):
    """A cascade with the push f + θ̂·R e₃, θ̂' = γ (ė + c₁ e), in space: the sign is the wrong one.

    The paper has F − θ̂. While |θ̂| ≥ B, θ̂' is projected.

    Attributes
    ----------
    gamma, c1, bound
        γ, N/m; c₁, 1/s; and B, N.
    """

    name: ClassVar[str] = "stored_adaptive"
    title: ClassVar[str] = "geo-a, as stored"

    gamma: Positive = 1.0
    c1: Positive = 2.46
    bound: Positive = 2.0

    def memory(self, G: MatrixLieGroup) -> Mapping[str, int]:
        """θ̂, beside those of the cascade."""
        return {**super().memory(G), "estimate": 3}

    def initial_memory(self, s: Tracking) -> Mapping[str, Array]:
        """0, and those of the cascade."""
        return {**super().initial_memory(s), "estimate": 0.0 * s.V[..., :3]}

    def rate(self, s: Tracking) -> Array:
        """The rate of θ̂."""
        errors, theta = self.loop_errors(s), s.memory["estimate"]
        rate = self.gamma * (errors[..., -3:] + self.c1 * errors[..., -6:-3])
        size = dot(theta, theta)[..., None]
        radial = theta * dot(rate, theta)[..., None] / (size + 1e-12)
        return where(less(size, self.bound * self.bound + 0.0 * size), rate, rate - radial)

    def memory_rate(self, s: Tracking) -> Mapping[str, Array]:
        """That of θ̂, and those of the cascade."""
        return {**super().memory_rate(s), "estimate": self.rate(s)}

    def answer(self, s: Tracking, period: Any) -> tuple[Array, Mapping[str, Array]]:
        """The command, and θ̂ a period later, beside the memory of the cascade."""
        command, later = super().answer(s, period)
        return command, {**later, "estimate": s.memory["estimate"] + period * self.rate(s)}

    def wrench(self, s: Tracking, torque: Array) -> Array:
        """The command, with the estimate in the push."""
        axis = np.array(self.direction)
        b = s.Q[..., :3, :3] @ axis
        added = np.concatenate([0.0 * torque, dot(s.memory["estimate"], b)[..., None] * axis], -1)
        return super().wrench(s, torque) + added
