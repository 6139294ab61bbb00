"""The attitude that a force asks for, where actuators push a body along one of its axes.

Such a push and torques move a body to any place: along its motion, the force F says where this axis
must point, and a heading says the rest. The rates of the attitude follow from those of F.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from eqt_cli.base.arrays import Array, apply_matrix, cos, cross, dot, norm, sin, stack, transpose
from eqt_cli.base.errors import Problems
from eqt_cli.components.matrix_groups import EuclideanGroup
from eqt_cli.components.motions import body_axes
from eqt_cli.numbers.jets import Jet


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
    force: Jet, along: tuple[float, ...], heading: Jet | None, R: Any = None, side: Any = None
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
    side
        With a heading, what b₂ is perpendicular to; then b₁ is so to F. Default: F, for both.
    """
    n = force / norm(force)[..., None]  # type: ignore[arg-type]  # a series acts as an array
    if len(along) == 2:
        return _in_plane(n, along)
    return _next_to(n, along, R) if heading is None else _headed(n, along, heading, side)


def sides(
    G: EuclideanGroup, force: Any, velocity: Any, drags: Sequence[Any], along: Any, mass: Any
) -> list[Any]:
    """Return F/m + (D_k − D_b) U/m for each axis b_k of the body across b, of drag −D U.

    There F = −D_b U + … is without the part of the drag that has no axis. A push along b gives F
    where each b_k is perpendicular to its own of these: the attitude still follows from the motion
    (Faessler, Franchi and Scaramuzza, IEEE Robotics and Automation Letters 3(2), 2018).
    """
    across = body_axes(along)[:, :-1].T
    beside = [sum(drag.beside(G, axis, velocity) / mass for drag in drags) for axis in across]
    return [force + term for term in beside]


def _in_plane(n: Any, along: tuple[float, ...]) -> Attitude:
    x, y = n[..., 0], n[..., 1]
    c = along[0] * x.value + along[1] * y.value
    s = along[0] * y.value - along[1] * x.value
    R = stack([stack([c, s]), stack([-s, c])])  # its columns
    velocity = x * y.rate - y * x.rate if n.order else None
    return Attitude(R, *(rate[..., None] for rate in _rates(velocity, 0.0 * c)))


def _headed(n: Any, along: tuple[float, ...], heading: Any, side: Any) -> Attitude:
    b3: Any = n if along[2] >= 0 else -n
    c, s = cos(heading), sin(heading)
    up: Any = b3 if side is None else side if along[2] >= 0 else -side
    x, y, z = (up[..., k] for k in range(3))
    b2: Any = stack([-(z * s), z * c, x * s - y * c])
    b2 = b2 / norm(b2)[..., None]
    if side is not None:
        b3 = b3 - dot(b3, b2)[..., None] * b2
        b3 = b3 / norm(b3)[..., None]
    b1: Any = cross(b2, b3)
    R = stack([b1.value, b2.value, b3.value])
    velocity = None
    if n.order:
        turning = b2.rate
        velocity = stack([dot(b3, turning), dot(b1, b3.rate), -dot(b1, turning)])
    attitude = Attitude(R, *_rates(velocity, 0.0 * b3.value))
    axes = body_axes(along)
    if np.array_equal(axes, np.eye(3)):
        return attitude
    R, *rates = attitude
    return Attitude(R @ axes.T, *(apply_matrix(axes, rate) for rate in rates))


def _next_to(n: Any, along: tuple[float, ...], R: Any) -> Attitude:
    v, rows = apply_matrix(R, np.array(along)), transpose(R)
    w = cross(v, n.value)[..., None, :]
    turned = cross(w, rows)  # w × each column of R
    rows = rows + turned + cross(w, turned) / (1.0 + dot(v, n.value))[..., None, None]
    velocity = cross(n, n.rate) if n.order else None
    rates = (apply_matrix(rows, derivative) for derivative in _rates(velocity, 0.0 * v))
    return Attitude(transpose(rows), *rates)


def _rates(velocity: Any, zero: Any) -> tuple[Any, Any]:
    """Return the value of a series and its rate; 0 above its order, and for None."""
    if velocity is None:
        return zero, zero
    return velocity.value, velocity.derivative(1) if velocity.order else zero


def third_axis(along: tuple[float, ...]) -> Array:
    """Return the body axis about which a heading turns, ``(3,)``."""
    return body_axes(along)[:, 2]


def check_along(along: Sequence[float] | None, n: int, problems: Problems) -> None:
    """Note a body axis that is no direction in space."""
    if along is not None and (len(along) != n or not any(along)):
        problems.at("along").add(f"expected a direction of {n} numbers, got {along}")
