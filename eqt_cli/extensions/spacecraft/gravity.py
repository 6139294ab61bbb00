"""The gravity gradient, whose torque turns the long axis of a satellite towards the planet."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Self

import numpy as np

from eqt_cli.base.arrays import Array, apply_matrix, cos, cross, sin, stack
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import Real, Scale, Unit
from eqt_cli.components.forces import UNLIKE, Force
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.inertia import Inertia
from eqt_cli.components.matrix_groups import EuclideanGroup, check_turns_in_space
from eqt_cli.components.pose_notation import square
from eqt_cli.components.vehicle_parts import Matrix, Number, check_numbers, drawn
from eqt_cli.extensions.spacecraft.orbits import check_eccentricity, ellipse, place_on
from eqt_cli.numbers.leaves import with_fields


@dataclass(frozen=True)
class GravityGradient(Force):
    """3n²(a/r)³ c × 𝕁c on an orbit; c is the direction of the planet in the body frame.

    The orbit is in the xy plane of the spatial frame, with the planet at t = 0 along -x. Only for
    SO3 and SE3. Source: Hughes, Spacecraft Attitude Dynamics (1986), section 8.1.

    Attributes
    ----------
    rate
        n, rate of the orbit, rad/s: in the mean, √(GM/a³), where it is an ellipse.
    inertia
        𝕁 about the centre of mass, kg m².
    eccentricity
        e of the orbit; 0 of a circle.
    anomaly
        Angle from the perigee to the satellite at t = 0, rad.
    """

    name: ClassVar[str] = "gravity_gradient"
    departs: ClassVar[str] = "gravity gradient"

    rate: Annotated[Number, Scale("rate of the orbit", "rad/s")]
    inertia: Annotated[Matrix, Unit("kg m^2")]
    eccentricity: Real = 0.0
    anomaly: Annotated[Real, Scale("true anomaly", "rad")] = 0.0
    shape: Any = field(default=None, init=False, repr=False)

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return the force with the tensor as a matrix."""
        part = self.drawn(random)
        shape = ellipse(part.eccentricity, part.anomaly) if part.eccentricity else None
        changed = {"rate": np.array([part.rate]), "inertia": square(part.inertia, 3, G)}
        return with_fields(part, **changed, eccentricity=None, anomaly=None, shape=shape)

    def acting(self, G: MatrixLieGroup, t: Any, Q: Array, V: Array) -> Array:
        """Return the torque, with force 0 on SE3."""
        rate = self.rate[..., 0]
        assert isinstance(G, EuclideanGroup)
        angle, strength = rate * t, 3 * rate * rate
        if self.shape is None:
            along, across = cos(angle), sin(angle)
        else:
            along, across, near = place_on(self.shape, angle)
            strength = strength * near * near * near
        planet = stack([-along, -across, 0 * angle])
        c = (G.rotation(Q) * planet[..., :, None]).sum(axis=-2)  # Rᵀ of the direction in space
        torque = strength[..., None] * cross(c, apply_matrix(self.inertia, c))
        coordinates = [torque[..., k] for k in range(3)]
        return stack(coordinates + [0 * coordinates[0]] * (G.dimension - 3))

    def remarks(self, G: MatrixLieGroup, inertia: Inertia) -> Iterator[tuple[str, str]]:
        """Yield a remark on a tensor that is not the body's."""
        body = inertia.matrix[:3, :3]
        if (
            not inertia.matrix[:3, 3:].any()
            and np.abs(body - self.inertia).max() > UNLIKE * np.abs(body).max()
        ):
            diagonal = ", ".join(f"{x:.4g}" for x in np.diagonal(body))
            yield "inertia", f"differs from the body's, [{diagonal}]; correct one of the two"

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note groups other than SO3 and SE3, invalid numbers, and a frame other than body."""
        check_turns_in_space(self.name, G, problems)
        if self.frame != "body":
            problems.at("frame").add("gravity_gradient computes its own frame; remove this key")
        check_numbers(self.rate, problems.at("rate"))
        check_eccentricity(self.eccentricity, problems.at("eccentricity"))
        here = problems.at("inertia")
        check_numbers(self.inertia, here)
        if not here:
            with here.catching():
                square(drawn(self.inertia, None), 3, G)
