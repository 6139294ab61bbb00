"""A hybrid and an adaptive law, whose states a result stores."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from eqt_cli.extend import (
    Array,
    Controller,
    MatrixLieGroup,
    Positive,
    Tracking,
    dot,
    less,
    norm,
    stack,
    transpose,
    where,
)


@dataclass(frozen=True)
class Hybrid(Controller):
    """Quaternion law with hysteresis, after Mayhew, Sanfelice and Teel (2011).

    Attributes
    ----------
    stiffness
        c, N m.
    delta
        Half of the width of the hysteresis, between 0 and 1.
    """

    name: ClassVar[str] = "hybrid"
    title: ClassVar[str] = "hybrid"
    departs: ClassVar[str] = "jumps at instants"

    stiffness: Positive = 4.0
    delta: Positive = 0.4

    def memory(self, G: MatrixLieGroup) -> Mapping[str, int]:
        """The quaternion that is followed without jumps, and the mode, 1 or −1."""
        return {"quaternion": 4, "mode": 1}

    def initial_memory(self, s: Tracking) -> Mapping[str, Array]:
        """The quaternion with a positive scalar part, and mode 1."""
        near = np.array([1.0, 1e-3, 1e-3, 1e-3])
        near = near + 0.0 * s.Q[..., :1, 0]
        return {"quaternion": self._quaternion(s, near), "mode": 1.0 + 0.0 * s.V[..., :1]}

    def _quaternion(self, s: Tracking, last: Array) -> Array:
        """Of ±q for R_dᵀR, the one near the last: q qᵀ is linear in the matrix."""
        R = transpose(s.Qd) @ s.Q
        a, b, c = (R[..., k, k] for k in range(3))
        x, y, z = (R[..., i, j] - R[..., j, i] for i, j in ((2, 1), (0, 2), (1, 0)))
        u, v, w = (R[..., i, j] + R[..., j, i] for i, j in ((1, 2), (0, 2), (0, 1)))
        rows = (
            (1 + a + b + c, x, y, z),
            (x, 1 + a - b - c, w, v),
            (y, w, 1 - a + b - c, u),
            (z, v, u, 1 - a - b + c),
        )
        q = stack([dot(stack(row), last) for row in rows])
        return q / norm(q)[..., None]

    def answer(self, s: Tracking, period: Any) -> tuple[Array, Mapping[str, Array]]:
        """The torque at an instant, and the states after it: here the mode jumps."""
        q = self._quaternion(s, s.memory["quaternion"])
        mode = s.memory["mode"]
        mode = where(less(mode * q[..., :1], -self.delta), -mode, mode)
        return self._torque(s, q, mode), {"quaternion": q, "mode": mode}

    def torque(self, s: Tracking) -> Array:
        """The torque between instants, which a sampled loop does not ask for."""
        return self._torque(s, s.memory["quaternion"], s.memory["mode"])

    def _torque(self, s: Tracking, q: Array, mode: Array) -> Array:
        r = s.relative
        return r.feedforward(0.0, 0.0, 1.0) - r.body_damping - self.stiffness * mode * q[..., 1:]


@dataclass(frozen=True)
class Adaptive(Controller):
    """A law that learns a constant torque of the body, θ, with ρ = e + c ∇Υ: its rate is γ ρ.

    Attributes
    ----------
    rate
        γ, N m per rad.
    weight
        c, 1/(N m s).
    """

    name: ClassVar[str] = "adaptive"
    title: ClassVar[str] = "adaptive"
    output_units: ClassVar[Mapping[str, str]] = {"estimate": "N m", "rho": "rad/s"}

    rate: Positive = 0.5
    weight: Positive = 0.3

    def memory(self, G: MatrixLieGroup) -> Mapping[str, int]:
        """The estimate of θ."""
        return {"estimate": G.dimension}

    def _rho(self, s: Tracking) -> Array:
        return s.relative.V_tilde + self.weight * s.relative.gradient

    def memory_rate(self, s: Tracking) -> Mapping[str, Array]:
        """Its rate, which a sampled loop takes for a period."""
        return {"estimate": self.rate * self._rho(s)}

    def torque(self, s: Tracking) -> Array:
        """τ, body frame."""
        r = s.relative
        return r.feedforward(0.0, 0.0, 1.0) - r.body_damping - r.gradient - s.memory["estimate"]

    def outputs(self, G: MatrixLieGroup) -> Mapping[str, int]:
        """What the result stores: the memory, and ρ."""
        return {**self.memory(G), "rho": G.dimension}

    def output(self, s: Tracking) -> Mapping[str, Array]:
        """Their values."""
        return {**s.memory, "rho": self._rho(s)}
