"""The gravity gradient, whose torque turns the long axis of a satellite towards the planet."""

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Self

import numpy as np

from eqt_cli.core.arrays import Array, apply_matrix, cos, cross, sin, stack
from eqt_cli.core.errors import Problems
from eqt_cli.core.leaves import with_fields
from eqt_cli.core.option_types import Scale
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.groups.euclidean import EuclideanGroup
from eqt_cli.notation.poses import square
from eqt_cli.vehicle.component import Matrix, Number, check_numbers, drawn
from eqt_cli.vehicle.forces.base import Force


@dataclass(frozen=True)
class GravityGradient(Force):
    """3n² c × 𝕁c on a circular orbit; c is the direction of the planet in the body frame.

    The orbit is in the xy plane of the spatial frame, with the planet at t = 0 along -x. Only for
    SO3 and SE3. Source: Hughes, Spacecraft Attitude Dynamics (1986), section 8.1.

    Attributes
    ----------
    rate
        n, the rate of the orbit, rad/s.
    inertia
        𝕁 about the centre of mass, kg m²: a list (its diagonal) or three rows.
    """

    name: ClassVar[str] = "gravity_gradient"
    departs: ClassVar[str] = "gravity gradient"

    rate: Annotated[Number, Scale("rate of the orbit", "rad/s")]
    inertia: Matrix

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return the force with the tensor as a matrix."""
        part = self.drawn(random)
        return with_fields(part, rate=np.array([part.rate]), inertia=square(part.inertia, 3, G))

    def acting(self, G: MatrixLieGroup, t: Any, Q: Array, V: Array) -> Array:
        """Return the torque, with force 0 on SE3."""
        rate = self.rate[..., 0]
        assert isinstance(G, EuclideanGroup)
        angle = rate * t
        planet = stack([-cos(angle), -sin(angle), 0 * angle])
        c = (G.rotation(Q) * planet[..., :, None]).sum(axis=-2)  # Rᵀ of the direction in space
        factor = (3 * rate * rate)[..., None]
        torque = factor * cross(c, apply_matrix(self.inertia, c))
        coordinates = [torque[..., k] for k in range(3)]
        return stack(coordinates + [0 * coordinates[0]] * (G.dimension - 3))

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note groups other than SO3 and SE3, invalid numbers, and a frame other than body."""
        if not (isinstance(G, EuclideanGroup) and G.space == 3 and len(G.columns) < 2):
            problems.add(f"gravity_gradient needs group SO3 or SE3, got {G.name}")
        if self.frame != "body":
            problems.at("frame").add("gravity_gradient computes its own frame; remove this key")
        check_numbers(self.rate, problems.at("rate"))
        here = problems.at("inertia")
        check_numbers(self.inertia, here)
        if not here:
            with here.catching():
                square(drawn(self.inertia, None), 3, G)
