"""A reference for bodies that are pushed along one body axis: position and heading say the rest."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any, ClassVar, Self

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array, apply, apply_matrix, less, norm, sqrt, stack, where
from eqt_cli.base.errors import Problems, Remedy
from eqt_cli.base.expressions import Expression, formula
from eqt_cli.base.extensions import functions_for
from eqt_cli.base.option_types import Kind, Real, Unit
from eqt_cli.base.registry import Keys
from eqt_cli.components import motions
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.matrix_groups import EuclideanGroup, rigid, rigid_motions
from eqt_cli.components.references import (
    ClosedReference,
    Reference,
    check_end,
    check_expressions,
    check_rising,
)
from eqt_cli.extensions.underactuated.attitude import attitude, check_along, sides
from eqt_cli.numbers.instants import instants_of
from eqt_cli.numbers.jets import Jet, series
from eqt_cli.numbers.leaves import STRUCTURE, with_fields

DEGREE = 7
"""Of the pieces of a motion of minimum snap."""

OF_FORCE = 2
"""Derivatives of the force that the angular acceleration needs."""

WEAK = 0.01
"""Share of the largest thrust below which its direction is taken as undecided."""

SAMPLES = 1001
"""Times at which the thrust is checked; between them by its rate."""

FREE, ALONG_VELOCITY = "free", "velocity"


@dataclass(frozen=True)
class Knot(Keys):
    """A position at a time.

    Attributes
    ----------
    t
        Time, s.
    position
        Position in space, m.
    velocity
        Velocity in space there, m/s, of the first and the last alone. Default: 0.
    """

    t: Annotated[Real, Unit("s")]
    position: Annotated[list[Real], Unit("m")]
    velocity: Annotated[list[Real] | None, Unit("m/s")] = None


@dataclass(frozen=True)
class FlatReference(ClosedReference):
    """The motion that a body pushed along one body axis makes on a path with a heading; SE2, SE3.

    The force that moves it, F = m p̈_d − known forces, must be along that axis: this decides the
    attitude, with a heading in space, and its rates. Known forces are those of `model`; they must
    not depend on the attitude, but for drag that is linear along the body's own axes (with
    `heading: free` the same along the two across the push), in air at rest or a constant wind.

    Attributes
    ----------
    position
        p_d in space, m: an expression in t for each axis.
    minimum_snap
        Instead: two or more positions in the order of time, `{t: 0, position: [0, 0, 1]}` each. The
        motion through them minimises ∫|d⁴p/dt⁴|² dt and is at rest at both ends, or has the
        `velocity` of the first and the last: polynomials of degree 7 with six continuous
        derivatives.
    of
        Instead: the positions of a `path`, or a motion of minimum snap through the poses of
        `waypoints` or of a `log`; poses of a file come with the velocities at the ends.
    heading
        ψ in space, rad: an expression in t (default 0); `velocity`: horizontally along ṗ_d; `free`:
        no law follows it, and Q_d has ψ = 0. SE3 only.
    along
        The body axis along which it is pushed. Default: the axis of the law, or the only direction
        in which the actuators push.
    """

    name: ClassVar[str] = "flat"

    position: list[str | float] | None = None
    minimum_snap: list[Knot] | None = None
    of: dict[str, Any] | None = None
    heading: str | float | None = field(default=None, metadata=STRUCTURE)
    along: list[Real] | None = None
    mass: float = field(default=0.0, init=False, repr=False, metadata=STRUCTURE)
    free: Any = field(default=(), init=False, repr=False, metadata=STRUCTURE)
    across: Any = field(default=(), init=False, repr=False, metadata=STRUCTURE)
    direction: Any = field(default=(), init=False, repr=False, metadata=STRUCTURE)
    inner: Any = field(default=None, init=False, repr=False, metadata=STRUCTURE)
    since: Any = field(default=None, init=False, repr=False)
    polynomials: Any = field(default=None, init=False, repr=False)

    # The motion.

    def flat_output(self, G: MatrixLieGroup, t: Any) -> motions.FlatOutput:
        """Return position and heading with their derivatives at time t."""
        position = self._position(G, t)
        no_heading = rigid(G).space == 2 or self.heading == FREE
        return motions.FlatOutput(position, None if no_heading else self._heading(position, t))

    def motion(self, G: MatrixLieGroup, t: Any) -> tuple[Array, Array, Array]:
        """Return the motion that follows from the position, the heading and the model."""
        G, position = rigid(G), self._position(G, t)
        psi = None if G.space == 2 else self._heading(position, t)
        alone = position.ndim == 2 and (psi is None or psi.ndim == 1)
        if alone:  # a symbol without batch axes is no array
            position, psi = position[None], None if psi is None else psi[None]
        turn = None if psi is None else Jet.of([psi[..., k] for k in range(OF_FORCE + 1)])
        ahead, side = self._sides(G, t, position)
        body = attitude(ahead, self.direction, turn, side=side)
        p, v, a = (position[..., k, :] for k in range(3))
        back = body.R.swapaxes(-1, -2)
        velocity = apply_matrix(back, v)
        turned = apply_matrix(G.rotation_group.hat(body.velocity), velocity)
        Q = G.assemble(body.R, p[..., None])
        pairs = ((body.velocity, velocity), (body.acceleration, apply_matrix(back, a) - turned))
        V, V_dot = (
            stack([vector[..., k] for vector in pair for k in range(vector.shape[-1])])
            for pair in pairs
        )
        return (Q[0], V[0], V_dot[0]) if alone else (Q, V, V_dot)

    def _sides(self, G: EuclideanGroup, t: Any, position: Array) -> tuple[Jet, Jet | None]:
        """Return what decides b₁ and, if it is another, b₂: F/m in space as series of order 2."""
        course = motions.FlatOutput(position).course(OF_FORCE + 1)
        still = np.eye(G.space), np.zeros(G.rotations)
        moving = motions.RigidMotion(G, *still, course.to_order(OF_FORCE), course.rate)
        a = Jet.of([position[..., k, :] for k in range(2, motions.ORDER + 1)])
        for force in self.free:
            a = a - force.in_space(G, Jet.time(t, OF_FORCE), moving) / self.mass
        if not self.across:
            return a, None
        beside = sides(G, a, moving.velocity, self.across, self.direction, self.mass)
        return beside[0], beside[-1]

    def _position(self, G: MatrixLieGroup, t: Any) -> Array:
        """Return p_d and its derivatives, ``(..., 5, n)``."""
        if self._knotted:
            return self._on_piece(G, t)
        if self.position is not None:
            axes = [series(axis, {"t": t}, motions.ORDER) for axis in self.expressions]
        else:
            Q = self.inner.series(G, t, motions.ORDER)
            axes = [Q[..., k, -1] for k in range(rigid(G).space)]
        return stack([_derivatives(axis) for axis in axes])

    def _on_piece(self, G: MatrixLieGroup, t: Any) -> Array:
        since, polynomials = self.since, self.polynomials
        if since is None:
            since, polynomials = self._piece(G, t)
        powers = [1.0, t - since]
        for p in range(2, DEGREE + 1):
            powers.append(powers[p // 2] * powers[p - p // 2])
        rows = [
            [math.perm(p, k) * powers[p - k] if p >= k else 0.0 for k in range(motions.ORDER + 1)]
            for p in range(DEGREE + 1)
        ]
        return stack([stack(row) for row in rows]) @ polynomials

    def _heading(self, position: Array, t: Any) -> Array:
        """Return ψ and its derivatives, ``(..., 3)``."""
        if self.heading != ALONG_VELOCITY:
            heading = 0.0 if self.heading in (None, FREE) else self.heading
            return _derivatives(series(formula(heading), {"t": t}, 2))
        x, y = (Jet.of([position[..., k, axis] for k in (1, 2, 3)]) for axis in (0, 1))
        turning: Any = (x * y.rate - y * x.rate) / (x * x + y * y)
        east, north = x.value, y.value
        speed, back = sqrt(east * east + north * north), less(east, 0.0)
        half = apply("atan", north / (speed + where(back, -east, east)))
        return stack(
            [where(back, np.pi - 2 * half, 2 * half), turning.value, turning.derivative(1)]
        )

    # What it is given by.

    @cached_property
    def expressions(self) -> list[Expression]:
        """The expressions of the position, parsed."""
        return [formula(entry) for entry in self.position or ()]

    @property
    def _knotted(self) -> bool:
        return self.position is None and not (self.inner is not None and self.inner.smooth)

    by_processor = _knotted  # LAPACK finds its polynomials

    def _pieces(self, G: MatrixLieGroup) -> tuple[Array, Array]:
        """Return the starts of the pieces, and their coefficients ``(N, 8, n)``, rising."""
        from scipy.interpolate import make_interp_spline  # slow to import

        if self.minimum_snap is not None:
            times = np.array([knot.t for knot in self.minimum_snap])
            points = np.array([knot.position for knot in self.minimum_snap], dtype=float)
        else:
            times = self.inner.knot_times(G)
            points = rigid(G).translations(self.inner.motion(G, times)[0])[..., 0]
        ends = np.zeros((2, points.shape[1]))
        if self.minimum_snap is not None:
            for k, knot in zip((0, 1), (self.minimum_snap[0], self.minimum_snap[-1]), strict=True):
                ends[k] = 0.0 if knot.velocity is None else knot.velocity
        written = getattr(self.inner, "points", None) or ()
        if self.inner is not None and (self.inner.files or any(x.velocity for x in written)):
            Q, V, _ = self.inner.motion(G, times[[0, -1]])
            ends = apply_matrix(rigid(G).rotation(Q), V[..., rigid(G).rotations :])
        rest = [(k, np.zeros(points.shape[1])) for k in (2, 3)]
        spline = make_interp_spline(
            times, points, DEGREE, bc_type=tuple([(1, v), *rest] for v in ends)
        )
        starts, powers = times[:-1], range(DEGREE + 1)
        between = np.stack([spline(starts, nu=k) / math.factorial(k) for k in powers], axis=1)
        starts = np.array([min(times[0], 0.0) - 1.0, *times])
        even = np.zeros((2, *between.shape[1:]))
        even[:, 0] = points[0] - ends[0] * (times[0] - starts[0]), points[-1]
        even[:, 1] = ends
        return starts, np.concatenate([even[:1], between, even[1:]])

    def _piece(self, G: MatrixLieGroup, t: Any) -> tuple[Array, Array]:
        """Return the start and the coefficients of the piece at a time, or at each of some."""
        starts, polynomials = self.prepared(G, self._pieces)
        k = motions.piece_at(starts, t)
        return starts[k], polynomials[k]

    def instants(self, G: MatrixLieGroup, until: float) -> Array:
        """Return the times at which an expression or a polynomial changes its piece."""
        expressions = list(self.expressions)
        if self.heading not in (None, FREE, ALONG_VELOCITY):
            expressions.append(formula(self.heading))
        instants = [instants_of(expressions, until)]
        if self._knotted:
            instants.append(self.prepared(G, self._pieces)[0])
        elif self.inner is not None:
            instants.append(self.inner.instants(G, until))
        return np.unique(np.concatenate(instants))

    def held(self, G: MatrixLieGroup, t: Any) -> Self | None:
        """Return the reference with the polynomial at a time."""
        if not self._knotted:
            return None
        since, polynomials = self._piece(G, t)
        return with_fields(self, since=np.asarray(since), polynomials=polynomials)

    @property
    def files(self) -> dict[str, str]:
        """The files of the reference in `of`."""
        inner = self.inner or self._of(None, Problems())
        names = [] if inner is None else list(inner.files.values())
        return {"of": names[0]} if names else {}

    def with_files(self, texts: Mapping[str, str]) -> Self:
        """Return the reference with the one in `of`, and the contents of its files."""
        inner = self._of(None, Problems())
        return with_fields(self, inner=None if inner is None else inner.with_files(texts))

    def _of(self, G: MatrixLieGroup | None, problems: Problems) -> Reference | None:
        from eqt_cli.components.references import references  # the registry imports this file

        if self.of is None:
            return None
        return Kind(references).read(self.of, problems, G)

    # What it knows of the plant.

    def initial(self, G: MatrixLieGroup, pose: Array, velocity: Array) -> tuple[Array, Array]:
        """Return Q_d(0) and V_d(0) of the motion, which a model decides; until then those given."""
        return super().initial(G, pose, velocity) if self.direction else (pose, velocity)

    def for_plant(self, G: MatrixLieGroup, plant: motions.PlantModel, problems: Problems) -> Self:
        """Return the reference with the model, after noting where no motion follows from it."""
        G, along = rigid(G), plant.along if self.along is None else self.along
        motions.check_rigid_body(G, plant.inertia, problems)
        if along is None:
            problems.at("along").add(
                "missing; no law, and no single direction of thrusters, says where the push points",
                Remedy("give it in the body frame, such as along: [0, 0, 1]"),
            )
        if problems:
            return self
        direction, even = motions.unit_vector(along), self.heading == FREE
        split = [force.apart(G, direction, even) for force in plant.forces]
        for force, halves in zip(plant.forces, split, strict=True):
            if halves is None:
                problems.add(
                    f"needs known forces that do not depend on the attitude, and {force.name} "
                    "does; only drag may, if linear along the body's axes in a constant wind",
                    Remedy("move it from model.forces to plant.forces"),
                )
        if problems:
            return self
        mass = float(plant.inertia.at(0.0).matrix[-1, -1])
        free, across = (free for free, _ in split), (drag for _, drag in split if drag)
        forces = {"free": tuple(free), "across": tuple(across)}
        moving = with_fields(self, mass=mass, direction=direction, **forces)
        moving._check_horizon(G, plant.horizon, problems)
        return moving

    def _check_horizon(self, G: EuclideanGroup, horizon: float, problems: Problems) -> None:
        """Note where a direction that the motion needs vanishes, or nearly does."""
        inside = self.instants(G, horizon)
        inside = inside[(inside > 0) & (inside < horizon)]
        times = np.unique([*np.linspace(0.0, horizon, SAMPLES), *inside])
        with np.errstate(all="ignore"):
            position = np.broadcast_to(
                self._position(G, times), (len(times), motions.ORDER + 1, G.space)
            )
            a, side = self._sides(G, times, position)
            force = np.stack([a.derivative(k) + 0.0 * position[:, 0] for k in (0, 1)])
            up = force[0] if side is None else side.value + 0.0 * position[:, 0]
        if not np.isfinite(force).all(axis=(0, 2)).any():
            problems.add("has no finite real value at any time; correct its expressions")
            return
        smallest, largest, t = _smallest(times, *force)
        if smallest <= WEAK * max(largest, np.linalg.norm(position[:, 2], axis=-1).max()):
            problems.add(
                f"needs a thrust of {self.mass * smallest:.2g} N at {t:.4g} s: no attitude follows",
                Remedy("change the motion there")
                if self.free
                else Remedy("give the weight of the body in model.forces"),
            )
        if self.heading == ALONG_VELOCITY:
            smallest, largest, t = _smallest(times, position[:, 1, :2], position[:, 2, :2])
            if smallest <= WEAK * largest:
                problems.at("heading").add(
                    f"has no direction at {t:.4g} s, where the velocity is {smallest:.2g} m/s "
                    "horizontally; give an expression"
                )
        elif G.space == 3:
            psi = np.broadcast_to(self._heading(position, times)[..., 0], times.shape)
            ahead = np.stack([np.cos(psi), np.sin(psi), 0.0 * psi], axis=-1)
            across = norm(np.cross(up, ahead)) / norm(up)
            if across.min() < WEAK:
                problems.at("heading").add(
                    f"is along the thrust at {times[across.argmin()]:.4g} s: no attitude follows; "
                    "choose another heading"
                )

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note groups other than SE2 and SE3, invalid positions, and an invalid heading."""
        if not rigid_motions(G):
            problems.add(f"flat needs group SE2 or SE3, got {G.name}")
            return
        n, ways = G.space, ("position", "minimum_snap", "of")
        chosen = [name for name in ways if getattr(self, name) is not None]
        if len(chosen) != 1:
            problems.add(f"expected one of {', '.join(ways)}, got {' and '.join(chosen) or 'none'}")
        if self.position is not None:
            check_expressions(self.position, n, G, problems.at("position"))
        if self.minimum_snap is not None:
            for index, knot in enumerate(self.minimum_snap):
                if len(knot.position) != n:
                    expected = f"expected {n} numbers, got {len(knot.position)}"
                    problems.at("minimum_snap", index, "position").add(expected)
                here = problems.at("minimum_snap", index, "velocity")
                check_end(knot.velocity, n, index, len(self.minimum_snap), here)
            check_rising(self.minimum_snap, problems.at("minimum_snap"))
        self._check_of(G, problems.at("of"))
        if self.heading is not None and n == 2:
            problems.at("heading").add("the plane has none; remove this key")
        elif self.heading not in (None, FREE, ALONG_VELOCITY):
            with problems.catching("heading"):
                formula(self.heading)
        check_along(self.along, n, problems)

    def _check_of(self, G: MatrixLieGroup, problems: Problems) -> None:
        inner = None if self.of is None else self._of(G, problems)
        if inner is None:
            return
        if not (inner.smooth or type(inner).knot_times is not Reference.knot_times):
            problems.add(
                f"a reference of kind {inner.name} has no jerk and snap everywhere; use path, "
                "waypoints or log, or minimum_snap"
            )
        elif self.inner is not None:
            self.inner.check(G, problems)

    def remarks(self, G: MatrixLieGroup) -> Iterator[str]:
        """Yield those of the reference in `of`, and the smoothing that a recording needs."""
        if self.inner is None:
            return
        yield from self.inner.remarks(G)
        if self.inner.files and self.inner.name != "waypoints":  # which says so itself
            times = self.inner.knot_times(G)
            for proposed in functions_for(purposes.proposed_smoothing):
                if not (sizes := proposed(G, times, self.inner.motion(G, times)[0])):
                    continue
                yield (
                    "goes through every row, noise included, which four derivatives make large; "
                    f"write `of: {{kind: waypoints, file: …, smoothing: {sizes}}}`"
                )


def _derivatives(x: Jet) -> Array:
    """Return a value and its derivatives along a new last axis."""
    return stack([x.derivative(k) for k in range(x.order + 1)])


def _smallest(times: Array, values: Array, rates: Array) -> tuple[float, float, float]:
    """Return the smallest norm along a curve with its time, found by its rates, and the largest."""
    half = np.diff(times).max() / 2
    square = np.maximum((rates * rates).sum(axis=-1), np.finfo(float).tiny)
    nearest = np.clip(-(values * rates).sum(axis=-1) / square, -half, half)
    sizes = np.linalg.norm(values + nearest[:, None] * rates, axis=-1)
    k = int(np.nanargmin(sizes))
    t = float(np.clip(times[k] + nearest[k], times[0], times[-1]))
    return float(sizes[k]), float(np.nanmax(np.linalg.norm(values, axis=-1))), t
