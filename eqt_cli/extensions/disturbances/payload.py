"""A payload: a mass that joins the body, with its weight, and that it releases."""

from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Self

import numpy as np

from eqt_cli.base.arrays import Array, inverse_spd, stack
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import Positive, Real, Scale, Unit
from eqt_cli.components.forces import GRAVITY, Force, Restoring
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.inertia import Inertia
from eqt_cli.components.matrix_groups import EuclideanGroup, rigid_motions
from eqt_cli.components.motions import RigidMotion
from eqt_cli.components.vehicle_parts import Number, Presence, Timed, TrueInertia
from eqt_cli.numbers.jets import value_and_derivative
from eqt_cli.numbers.leaves import STRUCTURE, with_fields


@dataclass(frozen=True)
class LoadedInertia(TrueInertia):
    """The inertia of a body of a run, and of a point mass while it is there.

    Attributes
    ----------
    body
        The inertia without the mass; None for that of the model.
    load : (m, m)
        m BᵀB, with the mass m and the velocity B V of the point.
    presence
        When the mass is there; None: always.
    """

    body: TrueInertia | None
    load: Any
    presence: Presence | None

    @property
    def unloaded(self) -> TrueInertia | None:
        """The inertia without the mass; None for that of the model."""
        return self.body and self.body.unloaded

    def instants(self, G: MatrixLieGroup, until: float) -> Array:
        """Return those of the body; the payload has its own."""
        return np.empty(0) if self.body is None else self.body.instants(G, until)

    def at(self, model: Inertia, t: Any) -> Inertia:
        """Return the tensor at time t."""
        body = model if self.body is None else self.body.at(model, t)
        if self.presence is None:
            matrix = body.matrix + self.load
            return Inertia(matrix, inverse_spd(matrix), body.change, added=body.added)
        times = {"t": t} | self.presence.drawn
        pair = value_and_derivative(self.presence.share, times)
        share, rate = (stack([x])[..., None] for x in pair)
        matrix, change = body.matrix + share * self.load, rate * self.load / 2
        if body.change is not None:
            change = body.change + change
        return Inertia(matrix, inverse_spd(matrix), change, added=body.added)


@dataclass(frozen=True)
class Payload(Timed, Force):
    """A point mass that the body carries: its weight, and its part of the true inertia.

    Momentum is kept as it joins from rest: with the masses M and m, v becomes M v/(M + m). In the
    time `over`, its share rises by a `smoothstep`. Released, it leaves with the velocity of its
    point and takes its momentum along, so that the velocity of the body does not jump. Laws do not
    know the mass; where the entry is in `model`, they know the weight. Only for SE2 and SE3.

    Attributes
    ----------
    mass
        m, kg.
    at
        Its place in the body frame, m. Default: the origin.
    since
        When it begins to join, s. Default: it is there from the start on.
    until
        When it is released, s. Default: never.
    lasts
        Instead of `until`: how long after `since` it is released, s.
    over
        How long it takes to join, s.
    gravity
        Acceleration of its weight, m/s².
    up
        The direction upwards in the spatial frame, as of `restoring`.
    """

    name: ClassVar[str] = "payload"
    departs: ClassVar[str] = "payload"
    positive: ClassVar[tuple[str, ...]] = ("mass", *Timed.positive)

    mass: Annotated[Number, Scale("mass of the payload", "kg")]
    at: Annotated[list[Number] | None, Unit("m")] = None
    over: Annotated[Positive, Scale("time in which the payload joins", "s")] = field(
        default=0.01, metadata=STRUCTURE
    )
    gravity: Annotated[Positive, Scale("gravity", "m/s^2")] = GRAVITY
    up: list[Real] | None = None
    weight: Any = field(default=None, init=False, repr=False)
    load: Any = field(default=None, init=False, repr=False)

    @property
    def rising(self) -> float:
        """The time in which it joins, s."""
        return self.over

    def loaded(self, inertia: TrueInertia | None) -> TrueInertia:
        """Return the true inertia of a run with the payload; None stands for that of the model."""
        return LoadedInertia(inertia, self.load, self.presence)

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return the payload with its weight, a force of `restoring`, and its inertia m BᵀB."""
        assert isinstance(G, EuclideanGroup)
        part = self.drawn(random)
        weight = Restoring(part.mass * self.gravity, centre_of_mass=part.at, up=self.up)
        point = np.append(np.zeros(G.space) if part.at is None else part.at, 1.0)
        moved = (G.basis[:, : G.space] @ point).T
        numbers = {"weight": weight.of_run(G, None), "load": part.mass * moved.T @ moved}
        return with_fields(part, mass=None, at=None, up=None, **numbers)

    def acting(self, G: MatrixLieGroup, t: Any, Q: Array, V: Array) -> Array:
        """Return torque and force of the weight."""
        wrench: Array = self.weight.acting(G, t, Q, V)
        return wrench if self.presence is None else self.presence.at(t) * wrench

    @property
    def turns(self) -> bool:
        """Whether the weight acts beside the origin."""
        return self.at is not None if self.weight is None else bool(self.weight.turns)

    def in_space(self, G: EuclideanGroup, t: Any, moving: RigidMotion) -> Any:
        """Return the weight, wherever the body points."""
        weight = self.weight.in_space(G, t, moving)
        return weight if self.presence is None else self.presence.at(t) * weight

    @property
    def weight_alone(self) -> Self:
        """The payload: no accelerometer feels its weight."""
        return self

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note groups without a position, and a place or a time that is none."""
        if not rigid_motions(G):
            problems.add(f"needs group SE2 or SE3, got {G.name}")
            return
        for name in ("at", "up"):
            values = getattr(self, name)
            if values is not None and len(values) != G.space:
                problems.at(name).add(f"expected {G.space} numbers, got {len(values)}")
