"""The accelerometer: what it feels of a motion, and where it is mounted."""

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.random import Generator

from eqt_cli.base.arrays import Array, Arrays, apply_matrix
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import Real, Unit
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.laws import Controller
from eqt_cli.components.matrix_groups import EuclideanGroup, rigid
from eqt_cli.components.mechanics import Tracking
from eqt_cli.components.sensors import Sensor
from eqt_cli.components.vehicle import SENSOR, Vehicle, moving_sensors


def reads_specific_force(law: Controller) -> bool:
    """Return whether a law reads an accelerometer: if it says so by an attribute of this name."""
    return bool(getattr(law, "reads_specific_force", False))


@dataclass(frozen=True)
class Lever(Sensor):
    """An accelerometer that is not at the origin of the body: a + ω̇ × r + ω × (ω × r).

    Attributes
    ----------
    at
        r in the body frame, m.
    """

    name: ClassVar[str] = "lever"
    departs: ClassVar[str] = "accelerometer off the origin"

    at: Annotated[list[Real], Unit("m")]

    def errors(self, G: MatrixLieGroup, instants: int, period: float, random: Generator) -> Array:
        """Return 0: what it adds depends on the motion."""
        return np.zeros((instants, self.coordinates(G)))

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note a place that has not one number for each axis of space."""
        if isinstance(G, EuclideanGroup) and len(self.at) != G.space:
            problems.at("at").add(f"expected {G.space} numbers, got {len(self.at)}")


def felt(
    vehicle: Vehicle, s: Tracking, acting: Array, is_start: bool = False
) -> tuple[Array, Arrays]:
    """Return the specific force f = v̇ + ω × v − Rᵀg as sensors give it before errors.

    Gravity is the weight of `restoring` over the mass, so that nothing is felt in free fall.

    Parameters
    ----------
    acting : (..., m)
        The force that moves the law's model as the true plant, body frame.

    Returns
    -------
    force : (..., m)
        m/s²; 0 for the rotation.
    states
        Rates of the states of sensors or, at the start, these states.
    """
    G, V, states = rigid(s.G), s.V, dict[str, Array]()
    turns, moves = (part.axes for part in G.parts)
    V_dot = s.inertia.velocity(G.ad_star(V, s.P) - s.inertia.rate_force(V) + acting)
    turning, turning_rate = map(G.rotation_group.hat, (V[..., turns], V_dot[..., turns]))
    f: Any = V_dot[..., moves] + apply_matrix(turning, V[..., moves])
    true = vehicle.inertia_at(s)
    mass = true.matrix - (0.0 if true.added is None else true.added)
    for force in vehicle.forces:
        if (weight := getattr(force, "weight_alone", None)) is not None:
            W = weight.in_body(G, s.t, s.Q, V)[..., moves]
            f = f - W / mass[..., G.rotations, G.rotations, None]
    for lever in vehicle.more_sensors[1]:
        if isinstance(lever, Lever):
            f = f + apply_matrix(turning_rate + turning @ turning, np.array(lever.at))
    for k, sensor in moving_sensors(vehicle, "accelerometer"):
        name = f"{SENSOR}_{k}"
        x = f if is_start else s.vehicle[name]
        states[name] = x if is_start else sensor.state_rate(f, x)
        f = sensor.reading(f, x)
    return np.concatenate([0.0 * V[..., turns], f], axis=-1), states
