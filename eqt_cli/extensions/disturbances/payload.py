"""A payload: a mass that joins the body, with its weight."""

from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Self

import numpy as np

from eqt_cli.base.arrays import Array, inverse_spd, stack
from eqt_cli.base.errors import Problems
from eqt_cli.base.expressions import Expression, formula
from eqt_cli.base.option_types import Positive, Real, Scale, Unit
from eqt_cli.components.forces import GRAVITY, Force, Restoring
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.inertia import Inertia
from eqt_cli.components.matrix_groups import EuclideanGroup
from eqt_cli.components.motions import RigidMotion
from eqt_cli.components.vehicle_parts import TrueInertia
from eqt_cli.numbers.instants import instants_of
from eqt_cli.numbers.jets import value_and_derivative
from eqt_cli.numbers.leaves import STRUCTURE, with_fields


@dataclass(frozen=True)
class LoadedInertia(TrueInertia):
    """The inertia of a body and of a point mass from a time on.

    Attributes
    ----------
    body
        The inertia without the mass; None for that of the model.
    mass
        m, kg.
    at_point
        r, its place in the body frame, m.
    present
        0 before it joins and 1 after.
    load : (m, m)
        m BᵀB, with the velocity B V of the point.
    """

    body: TrueInertia | None
    mass: float
    at_point: tuple[float, ...] | None = field(metadata=STRUCTURE)
    present: Expression = field(metadata=STRUCTURE)
    load: Any = field(default=None, init=False, repr=False)

    @property
    def varies(self) -> bool:
        """Whether the body differs from run to run."""
        return self.body is not None and self.body.varies

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return the inertia with the body of the run."""
        assert isinstance(G, EuclideanGroup)
        body = None if self.body is None else self.body.of_run(G, random)
        point = np.append(np.zeros(G.space) if self.at_point is None else self.at_point, 1.0)
        moved = (G.basis[:, : G.space] @ point).T
        return with_fields(self, body=body, load=self.mass * moved.T @ moved)

    def instants(self, G: MatrixLieGroup, until: float) -> Array:
        """Return the time at which the mass joins, and those of the body."""
        times = instants_of([self.present], until)
        return times if self.body is None else np.append(times, self.body.instants(G, until))

    def at(self, model: Inertia, t: Any) -> Inertia:
        """Return the tensor at time t."""
        body = model if self.body is None else self.body.at(model, t)
        pair = value_and_derivative(self.present, {"t": t})
        share, rate = (stack([x])[..., None] for x in pair)
        matrix, change = body.matrix + share * self.load, rate * self.load / 2
        if body.change is not None:
            change = body.change + change
        return Inertia(matrix, inverse_spd(matrix), change, added=body.added)


@dataclass(frozen=True)
class Payload(Force):
    """A point mass that the body carries: its weight, and its part of the true inertia.

    Momentum is kept as it joins from rest: with the masses M and m, v becomes M v/(M + m). In the
    time `over`, its share rises by a `smoothstep`. Laws do not know the mass; where the entry is in
    `model`, they know the weight. Only for SE2 and SE3.

    Attributes
    ----------
    mass
        m, kg.
    at
        Its place in the body frame, m. Default: the origin.
    since
        When it begins to join, s. Default: it is there from the start on.
    over
        How long that takes, s.
    gravity
        Acceleration of its weight, m/s².
    up
        The direction upwards in the spatial frame, as of `restoring`.
    """

    name: ClassVar[str] = "payload"
    departs: ClassVar[str] = "payload"

    mass: Annotated[Positive, Scale("mass of the payload", "kg")]
    at: Annotated[list[Real] | None, Unit("m")] = None
    since: Annotated[Real | None, Scale("start of the payload", "s")] = field(
        default=None, metadata=STRUCTURE
    )
    over: Annotated[Positive, Scale("time in which the payload joins", "s")] = field(
        default=0.01, metadata=STRUCTURE
    )
    gravity: Annotated[Positive, Scale("gravity", "m/s^2")] = GRAVITY
    up: list[Real] | None = None
    weight: Any = field(default=None, init=False, repr=False)

    @property
    def present(self) -> Expression:
        """0 before it joins and 1 after."""
        if self.since is None:
            return formula(1.0)
        return formula(f"smoothstep(t, {self.since!r}, {self.since + self.over!r})")

    def loaded(self, inertia: TrueInertia | None) -> TrueInertia:
        """Return the true inertia with the payload; None stands for that of the model."""
        at = None if self.at is None else tuple(self.at)
        return LoadedInertia(inertia, self.mass, at, self.present)

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return the payload with its weight, a force of `restoring`."""
        weight = Restoring(self.mass * self.gravity, centre_of_mass=self.at, up=self.up)
        return with_fields(self, weight=weight.of_run(G, random), at=None, up=None)

    def instants(self, G: MatrixLieGroup, until: float) -> Array:
        """Return the time at which it joins."""
        return instants_of([self.present], until)

    def acting(self, G: MatrixLieGroup, t: Any, Q: Array, V: Array) -> Array:
        """Return torque and force of the weight."""
        wrench: Array = self.weight.acting(G, t, Q, V)
        return stack([self.present.evaluate({"t": t})]) * wrench

    @property
    def turns(self) -> bool:
        """Whether the weight acts beside the origin."""
        return self.at is not None if self.weight is None else bool(self.weight.turns)

    def in_space(self, G: EuclideanGroup, t: Any, moving: RigidMotion) -> Any:
        """Return the weight, wherever the body points."""
        share = self.present.evaluate({"t": t})
        return stack([share * axis for axis in self.weight.in_space(G, t, moving)])

    @property
    def weight_alone(self) -> Self:
        """The payload: no accelerometer feels its weight."""
        return self

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note groups without a position, and a place or a time that is none."""
        if not isinstance(G, EuclideanGroup):
            problems.add(f"needs group SE2 or SE3, got {G.name}")
            return
        for name in ("at", "up"):
            values = getattr(self, name)
            if values is not None and len(values) != G.space:
                problems.at(name).add(f"expected {G.space} numbers, got {len(values)}")
        if self.since is not None and self.since < 0:
            problems.at("since").add(f"expected at least 0 s, got {self.since:g} s")
