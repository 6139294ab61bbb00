"""Weight and buoyancy of a rigid body, on SE2 and SE3."""

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Self

import numpy as np

from eqt_cli.core.arrays import Array, moment, stack
from eqt_cli.core.errors import Problems
from eqt_cli.core.leaves import with_fields
from eqt_cli.core.option_types import Unit
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.groups.euclidean import EuclideanGroup, rigid_motions
from eqt_cli.mechanics.flatness import RigidMotion, unit_vector
from eqt_cli.vehicle.component import Number, check_numbers, drawn
from eqt_cli.vehicle.forces.base import Force

POINTS = ("centre_of_mass", "centre_of_buoyancy", "up")


@dataclass(frozen=True)
class Restoring(Force):
    """The weight acts at the centre of mass, downwards; the buoyancy at its own centre, upwards.

    With u the direction upwards in the body frame, the force is (B − W) u and the torque
    r_B × B u − r_G × W u. Only for SE2 and SE3, whose coordinates are torque and force.

    Attributes
    ----------
    weight, buoyancy
        W and B, N.
    centre_of_mass, centre_of_buoyancy
        r_G and r_B in the body frame, m.
    up
        The direction upwards in the spatial frame; its length does not matter. Default: the last
        axis, [0, 0, 1] on SE3 and [0, 1] on SE2.
    """

    name: ClassVar[str] = "restoring"
    departs: ClassVar[str] = "weight and buoyancy"

    weight: Annotated[Number, Unit("N")]
    buoyancy: Annotated[Number, Unit("N")] = 0.0
    centre_of_mass: Annotated[list[Number] | None, Unit("m")] = None
    centre_of_buoyancy: Annotated[list[Number] | None, Unit("m")] = None
    up: list[Number] | None = None

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return the force with `up` of length 1."""
        part: Any = super().of_run(G, random)
        assert isinstance(G, EuclideanGroup)
        up = np.eye(G.space)[-1] if part.up is None else part.up
        return with_fields(part, up=np.array(unit_vector(up)))

    @property
    def turns(self) -> bool:
        """Whether weight or buoyancy acts beside the origin."""
        return self.centre_of_mass is not None or self.centre_of_buoyancy is not None

    def in_space(self, G: EuclideanGroup, t: Any, moving: RigidMotion) -> Any:
        """Return (B − W) up, wherever the body points."""
        return (self.buoyancy - self.weight) * np.asarray(self.up)

    def acting(self, G: MatrixLieGroup, t: Any, Q: Array, V: Array) -> Array:
        """Return torque and force."""
        assert isinstance(G, EuclideanGroup)
        part: Any = self
        up = (G.rotation(Q) * part.up[..., :, None]).sum(axis=-2)  # Rᵀ up
        lift, weight = self.buoyancy * up, self.weight * up
        torque, force = 0.0 * up[..., : G.rotations], lift - weight
        if part.centre_of_buoyancy is not None:
            torque = torque + moment(part.centre_of_buoyancy, lift)
        if part.centre_of_mass is not None:
            torque = torque - moment(part.centre_of_mass, weight)
        return stack([each[..., k] for each in (torque, force) for k in range(each.shape[-1])])

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note groups other than SE2 and SE3, invalid points, and a direction that is 0."""
        if not rigid_motions(G):
            problems.add(f"restoring needs group SE2 or SE3, got {G.name}")
            return
        if self.frame != "body":
            problems.at("frame").add(
                "restoring fixes the frame of each of its numbers; remove this key"
            )
        for name in ("weight", "buoyancy"):
            check_numbers(getattr(self, name), problems.at(name))
        for name in POINTS:
            value = getattr(self, name)
            if value is not None and len(value) != G.space:
                problems.at(name).add(f"expected {G.space} numbers, got {len(value)}")
            elif value is not None:
                check_numbers(value, problems.at(name))
        if self.up is not None and not any(drawn(self.up, None)):
            problems.at("up").add("expected a direction, got a vector of zeros")
