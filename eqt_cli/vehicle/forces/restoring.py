"""Weight and buoyancy of a submerged body on SE3."""

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from eqt_cli.core.arrays import Array, cross, stack
from eqt_cli.core.leaves import with_fields
from eqt_cli.core.problems import Problems
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.groups.euclidean import EuclideanGroup
from eqt_cli.vehicle.forces.base import Force
from eqt_cli.vehicle.numbers import Number, check_numbers, drawn

POINTS = ("centre_of_mass", "centre_of_buoyancy", "up")


@dataclass(frozen=True)
class Restoring(Force):
    """The weight acts at the centre of mass, downwards; the buoyancy at its own centre, upwards.

    With u the direction upwards in the body frame, the force is (B − W) u and the torque
    r_B × B u − r_G × W u. Only for SE3, whose coordinates are torque and force.

    Attributes
    ----------
    weight, buoyancy
        W and B, N.
    centre_of_mass, centre_of_buoyancy
        r_G and r_B in the body frame, m.
    up
        The direction upwards in the spatial frame; its length does not matter.
    """

    name: ClassVar[str] = "restoring"
    departs: ClassVar[str] = "weight and buoyancy"

    weight: Number
    buoyancy: Number = 0.0
    centre_of_mass: list[Number] | None = None
    centre_of_buoyancy: list[Number] | None = None
    up: list[Number] | None = None

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return the force with `up` of length 1, and with default points filled in."""
        part: Any = super().of_run(G, random)
        up = np.array([0.0, 0.0, 1.0]) if part.up is None else part.up
        mass, buoyancy = (
            np.zeros(3) if point is None else point
            for point in (part.centre_of_mass, part.centre_of_buoyancy)
        )
        found: Self = with_fields(
            part, up=up / np.linalg.norm(up), centre_of_mass=mass, centre_of_buoyancy=buoyancy
        )
        return found

    def acting(self, G: MatrixLieGroup, t: Any, Q: Array, V: Array) -> Array:
        """Return torque and force."""
        assert isinstance(G, EuclideanGroup)
        part: Any = self
        up = (G.rotation(Q) * part.up[..., :, None]).sum(axis=-2)  # Rᵀ up
        lift, weight = self.buoyancy * up, self.weight * up
        torque = cross(part.centre_of_buoyancy, lift) - cross(part.centre_of_mass, weight)
        force = lift - weight
        return stack([*(torque[..., k] for k in range(3)), *(force[..., k] for k in range(3))])

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note groups other than SE3, invalid points, and a direction that is 0."""
        in_space = isinstance(G, EuclideanGroup) and G.space == 3 and len(G.columns) == 1
        if not in_space:
            problems.add(f"restoring needs group SE3, got {G.name}")
        if self.frame != "body":
            problems.at("frame").add(
                "restoring fixes the frame of each of its numbers; remove this key"
            )
        for name in ("weight", "buoyancy"):
            check_numbers(getattr(self, name), problems.at(name))
        for name in POINTS:
            value = getattr(self, name)
            if value is not None and len(value) != 3:
                problems.at(name).add(f"expected 3 numbers, got {len(value)}")
            elif value is not None:
                check_numbers(value, problems.at(name))
        if self.up is not None and not any(drawn(self.up, None)):
            problems.at("up").add("expected a direction, got a vector of zeros")
