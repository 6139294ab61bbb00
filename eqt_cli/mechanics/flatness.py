"""The attitude that a force asks for, where actuators push a body along one of its axes.

Such a push and torques move a body to any place: along its motion, the force F says where this
axis must point, and a heading says the rest. The rates of the attitude follow from those of F.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from eqt_cli.core.arrays import Array, apply_matrix, cos, cross, dot, norm, sin, stack, transpose
from eqt_cli.core.errors import Problems, Remedy
from eqt_cli.core.jets import Jet
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.groups.euclidean import EuclideanGroup
from eqt_cli.mechanics.inertia import Inertia, InertiaLaw

PARALLEL = 1e-9
"""Largest part of a push across the others, relative to the largest, that counts as 0."""

ROUNDING = 1e-12
"""Largest entry of an inertia, relative to its largest, that counts as 0."""

ORDER = 4
"""The derivatives of the position that decide the angular acceleration: snap, and all below."""


class FlatOutput(NamedTuple):
    """What decides the motion of such a body.

    Attributes
    ----------
    position : (..., 5, n)
        p_d in space and its derivatives to the fourth, m, m/s, ….
    heading : (..., 3)
        ψ and its derivatives to the second, rad, rad/s, rad/s²; None where it is free, and in the
        plane, where the force decides the attitude.
    """

    position: Array
    heading: Array | None = None

    def course(self, order: int) -> Jet:
        """Return p_d as a series."""
        return Jet.of([self.position[..., k, :] for k in range(order + 1)])

    def turn(self, order: int) -> Jet | None:
        """Return ψ as a series, of order 2 at most."""
        psi = self.heading
        return None if psi is None else Jet.of([psi[..., k] for k in range(order + 1)])


class PlantModel(NamedTuple):
    """What a law or a reference knows of the plant.

    Attributes
    ----------
    inertia
        The inertia of the law.
    forces
        The forces of `model`, with their mean numbers.
    pushes : (n, k)
        The forces of the thrusters on a rigid body, body frame; None without thrusters.
    exact
        Whether the plant moves as the model does.
    horizon
        The duration of the runs, s.
    flat
        The flat output of the reference at t = 0; None if it has none.
    along : (n,)
        The body axis along which a rigid body is pushed; None if nothing says it.
    period
        Control period, s; None for laws that act continuously.
    """

    inertia: InertiaLaw
    forces: tuple[Any, ...]
    pushes: Array | None
    exact: bool
    horizon: float
    flat: FlatOutput | None = None
    along: Any = None
    period: float | None = None


@dataclass(frozen=True)
class RigidMotion:
    """A motion near a time, as far as a model knows it: Ω̇ is what a law decides, and so left out.

    Attributes
    ----------
    rotation, turning
        R and Ω, ``(..., n, n)`` and ``(..., 1 or 3)``.
    position, velocity
        p and ṗ in space as series, ``(..., n)``.
    """

    group: EuclideanGroup
    rotation: Array
    turning: Array
    position: Jet
    velocity: Jet

    @cached_property
    def _rotation(self) -> Any:
        """R exp(τΩ^) as a series."""
        derivatives, spin = [self.rotation], self.group.rotation_group.hat(self.turning)
        for _ in range(self.position.order):
            derivatives.append(derivatives[-1] @ spin)
        return Jet.of(derivatives)

    @cached_property
    def pose(self) -> Any:
        """Q as a series, ``(..., n + 1, n + 1)``."""
        R, n = self._rotation, self.group.space
        columns = [[*(R[..., i, j] for i in range(n)), 0.0] for j in range(n)]
        columns.append([*(self.position[..., i] for i in range(n)), 1.0])
        return stack([stack(column) for column in columns])

    @cached_property
    def twist(self) -> Any:
        """V, body frame, as a series."""
        velocity: Any = (self._rotation.swapaxes(-1, -2) @ self.velocity[..., None])[..., 0]
        turning = [self.turning[..., k] for k in range(self.group.rotations)]
        return stack([*turning, *(velocity[..., k] for k in range(self.group.space))])


class Attitude(NamedTuple):
    """An attitude and its rates.

    Attributes
    ----------
    R : (..., n, n)
        Attitude.
    velocity, acceleration
        Ω with Ṙ = RΩ^, and Ω̇: ``(..., 3)``, in the plane ``(..., 1)``.
    """

    R: Array
    velocity: Array
    acceleration: Array


def attitude(
    force: Jet, along: tuple[float, ...], heading: Jet | None, R: Array | None = None
) -> Attitude:
    """Return the attitude whose body axis `along` has the direction n of a force F ≠ 0 in space.

    In the plane, F decides it. In space, b₃ is the axis ±along that is nearer to the third one of
    the body, b₂ = b₃ × b₁d/|b₃ × b₁d| with b₁d = (cos ψ, sin ψ, 0), and b₁ = b₂ × b₃. Without a
    heading it is the one next to R, and turns with n × ṅ, which has no part along n.

    Parameters
    ----------
    force
        F, ``(..., n)``. The rates are those of its order; those above it are 0.
    along
        Unit vector.
    R : (..., 3, 3)
        Attitude of the body, where there is no heading.
    """
    n = force / norm(force)[..., None]  # type: ignore[arg-type]  # a series acts as an array
    if len(along) == 2:
        return _in_plane(n, along)
    return _next_to(n, along, R) if heading is None else _headed(n, along, heading)


def _in_plane(n: Any, along: tuple[float, ...]) -> Attitude:
    x, y = n[..., 0], n[..., 1]
    c = along[0] * x.value + along[1] * y.value
    s = along[0] * y.value - along[1] * x.value
    R = stack([stack([c, s]), stack([-s, c])])  # its columns
    velocity = x * y.rate - y * x.rate if n.order else None
    return Attitude(R, *(each[..., None] for each in _rates(velocity, 0.0 * c)))


def _headed(n: Any, along: tuple[float, ...], heading: Any) -> Attitude:
    b3: Any = n if along[2] >= 0 else -n
    c, s = cos(heading), sin(heading)
    x, y, z = (b3[..., k] for k in range(3))
    b2: Any = stack([-(z * s), z * c, x * s - y * c])
    b2 = b2 / norm(b2)[..., None]
    b1: Any = cross(b2, b3)
    R = stack([b1.value, b2.value, b3.value])
    velocity = None
    if n.order:
        turning = b2.rate
        velocity = stack([dot(b3, turning), dot(b1, b3.rate), -dot(b1, turning)])
    attitude = Attitude(R, *_rates(velocity, 0.0 * b3.value))
    axes = _axes(along)
    if np.array_equal(axes, np.eye(3)):
        return attitude
    R, *rates = attitude
    return Attitude(R @ axes.T, *(apply_matrix(axes, each) for each in rates))


def _next_to(n: Any, along: tuple[float, ...], R: Any) -> Attitude:
    v, rows = apply_matrix(R, np.array(along)), transpose(R)
    w = cross(v, n.value)[..., None, :]
    turned = cross(w, rows)  # w × each column of R
    rows = rows + turned + cross(w, turned) / (1.0 + dot(v, n.value))[..., None, None]
    velocity = cross(n, n.rate) if n.order else None
    rates = (apply_matrix(rows, each) for each in _rates(velocity, 0.0 * v))
    return Attitude(transpose(rows), *rates)


def _rates(velocity: Any, zero: Any) -> tuple[Any, Any]:
    """Return the value of a series and its rate; 0 above its order, and for None."""
    if velocity is None:
        return zero, zero
    return velocity.value, velocity.derivative(1) if velocity.order else zero


def _axes(along: tuple[float, ...]) -> Array:
    """Return the body axes that become b₁, b₂ and b₃, as columns."""
    third = np.array(along) * (1.0 if along[2] >= 0 else -1.0)
    ahead = np.eye(3)[0 if abs(third[0]) < 0.9 else 2]
    first = ahead - (ahead @ third) * third
    first = first / np.linalg.norm(first)
    return np.stack([first, np.cross(third, first), third], axis=-1)


def third_axis(along: tuple[float, ...]) -> Array:
    """Return the body axis about which a heading turns, ``(3,)``."""
    return _axes(along)[:, 2]


def only_direction(pushes: Array) -> Array | None:
    """Return the unit vector along which all pushes ``(n, k)`` are; None if there is none."""
    sizes = np.linalg.norm(pushes, axis=0)
    first = pushes[:, sizes.argmax()] / sizes.max()
    across = np.abs(pushes - np.outer(first, first @ pushes)).max()
    return None if across > PARALLEL * sizes.max() else first


def check_along(along: Sequence[float] | None, n: int, problems: Problems) -> None:
    """Note a body axis that is no direction in space."""
    if along is not None and (len(along) != n or not any(along)):
        problems.at("along").add(f"expected a direction of {n} numbers, got {along}")


def unit_vector(along: Any) -> tuple[float, ...]:
    """Return the numbers of a body axis of length 1."""
    scaled = np.asarray(along, dtype=float) / np.abs(along).max()  # whose square is a float
    return tuple((scaled / np.linalg.norm(scaled)).tolist())


def check_rigid_body(G: MatrixLieGroup, inertia: InertiaLaw, problems: Problems) -> None:
    """Note an inertia other than diag(J, m I)."""
    turns, moves = (part.axes for part in G.parts)
    if not isinstance(inertia, Inertia):
        problems.add("needs a constant inertia diag(J, m I)", Remedy("write `inertia` as numbers"))
        return
    M, size = inertia.matrix, ROUNDING * np.abs(inertia.matrix).max()
    mass = M[moves, moves]
    if np.abs(M[turns, moves]).max() > size:
        problems.add(
            "needs an inertia diag(J, m I), and this one couples rotation and translation",
            Remedy("move the frame of the body to its centre of mass"),
        )
    elif np.abs(mass - mass[0, 0] * np.eye(len(mass))).max() > size:
        problems.add(
            "needs an inertia diag(J, m I), and this one has masses that differ by direction",
            Remedy("use a law of SE2 or SE3 for a body with added mass"),
        )
