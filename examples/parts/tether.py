"""A cable between a fixed point and the vehicle."""

from dataclasses import dataclass
from typing import Any, ClassVar

from eqt_cli.extend import (
    Array,
    Force,
    MatrixLieGroup,
    Number,
    Problems,
    apply_matrix,
    cross,
    dot,
    maximum,
    sqrt,
    stack,
    transpose,
)


@dataclass(frozen=True)
class Tether(Force):
    """A cable that pulls towards its anchor once it is taut, as a spring.

    Attributes
    ----------
    anchor
        Where it is held, in the spatial frame, m.
    at
        Where it is tied to the vehicle, in the body frame, m.
    length
        Up to which it is slack, m.
    stiffness
        N/m.
    """

    name: ClassVar[str] = "tether"
    departs: ClassVar[str] = "a tether"
    positive: ClassVar[tuple[str, ...]] = ("length", "stiffness")

    anchor: list[Number]
    at: list[Number]
    length: Number
    stiffness: Number

    def acting(self, G: MatrixLieGroup, t: Any, Q: Array, V: Array) -> Array:
        """Torque and force, body frame."""
        R, x = Q[..., :3, :3], Q[..., :3, 3]
        away = x + apply_matrix(R, self.at) - self.anchor
        distance = sqrt(dot(away, away) + 1e-12)[..., None]
        pull = self.stiffness * maximum(distance - self.length, 0.0) / distance
        force = apply_matrix(transpose(R), -pull * away)
        torque = cross(self.at, force)
        return stack([both[..., k] for both in (torque, force) for k in range(3)])

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Another group than SE3, points of another length."""
        if G.name != "SE3":
            problems.add(f"tether needs group SE3, got {G.name}")
        for name in ("anchor", "at"):
            if len(getattr(self, name)) != 3:
                problems.at(name).add("expected 3 numbers")
