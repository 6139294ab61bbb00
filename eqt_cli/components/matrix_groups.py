"""Rotations and motions of Euclidean space: SO(n), SE(n), SE_2(3) and vectors."""

import math
import re
from fractions import Fraction
from functools import reduce
from typing import Any, Self, TypeGuard

import numpy as np

from eqt_cli.base.arrays import (
    Array,
    apply,
    apply_matrix,
    cos,
    dot,
    frobenius,
    less,
    minimum,
    norm,
    ordered_product,
    sin,
    smooth_less,
    sqrt,
    stack,
    transpose,
    where,
)
from eqt_cli.base.errors import Problems, bare
from eqt_cli.components.groups import MatrixLieGroup, Part

# Rotations: functions of their angle that are smooth at 0, and matrices of other forms ------------
#
# The former are for floats and symbols. Each is a power series in a small quantity, of a function
# whose nearest singularity is removed first, so that few terms suffice. The latter, of quaternions
# (x, y, z, w), rotation vectors and Euler angles, have the operations of SciPy's `Rotation`, in its
# order, and give its bits (tests/components/test_quaternions.py). To import that module takes
# longer than NumPy and h5py.


FARTHEST = 2 * math.sqrt(2)
"""‖I − R‖_F of a half-turn, in the plane and in space."""

SINE_TERMS = 12
COTANGENT_TERMS = 14
STUMPFF_TERMS = 9
"""Numbers of terms; the truncation error is below a tenth of the last place of a double."""

SMALL_SQUARE = 1.0
"""θ² up to which `stumpff` is a series, beyond which differences lose two digits at the most."""


def distance_of_turn(angle: float) -> float:
    """Return ‖I − R‖_F = 2√2 sin(θ/2) of a rotation by an angle, rad."""
    return FARTHEST * math.sin(angle / 2)


def turn_of_distance(distance: Array) -> Any:
    """Return the angle, rad, of rotations with these ‖I − R‖_F; inverts `distance_of_turn`."""
    return 2 * apply("asin", minimum(distance / FARTHEST, 1.0))


def ratio_to_sine(c: Any) -> Any:
    """x / sin x of x = arccos c, for c from 0 to 1.

    The series is evaluated at x/4, in s = sin²(x/8) up to sin²(π/16), and the angle is doubled
    twice by 2x / sin 2x = (x / sin x) / cos x.
    """
    half = sqrt((1 + c) / 2)
    quarter = sqrt((1 + half) / 2)
    return _series(_OVER_SINE, (1 - quarter) / 2) / (half * quarter)


def inverse_jacobian_terms(square: Any) -> tuple[Any, Any]:
    """ψ = (1 − (θ/2) cot(θ/2)) / θ² and its derivative by θ², from θ² ≤ π².

    With x = θ/2, (1 − x cot x)/x² = 2/(π² − x²) + a series that converges for x < 2π.
    """
    v = square / 4
    pole = 1 / (math.pi**2 - v)
    value = 2 * pole + _series(_COTANGENT, v)
    slope = 2 * pole * pole + _series([n * d for n, d in enumerate(_COTANGENT)][1:], v)
    return value / 4, slope / 16


def stumpff(square: Any) -> tuple[Any, ...]:
    """c_0 … c_5 of θ², with c_k = 1/k! − θ²/(k + 2)! + …: c_0 = cos θ, c_1 = sin θ / θ.

    From c_2 = (1 − c_0)/θ² on each is (1/k! − c_k)/θ² of an earlier one, and a series where θ is
    small. They are the coefficients of the exponential of a turn, and of its integral.
    """
    small = smooth_less(square, SMALL_SQUARE)
    far = where(small, SMALL_SQUARE, square)
    angle = sqrt(far)
    terms = [cos(angle), sin(angle) / angle]
    for k in range(4):
        terms.append((1 / math.factorial(k) - terms[k]) / far)
    near = where(small, square, SMALL_SQUARE)
    return tuple(where(small, _series(_STUMPFF[k], near), closed) for k, closed in enumerate(terms))


def _over_sine() -> list[float]:
    """Return the coefficients of x / sin x in powers of sin²(x/2): ₂F₁(1, 1; 3/2; s)."""
    terms = [1.0]
    for n in range(1, SINE_TERMS):
        terms.append(terms[-1] * 2 * n / (2 * n + 1))
    return terms


def _cotangent() -> list[float]:
    """Return the coefficients of (1 − x cot x)/x² − 2/(π² − x²) in powers of x².

    By the differential equation of the cotangent, the coefficients d of 1 − x cot x in x² satisfy
    (2n + 1) d_n = d_1 d_{n−1} + … + d_{n−1} d_1.
    """
    d = [1 / 3]
    for n in range(2, COTANGENT_TERMS + 1):
        d.append(sum(a * b for a, b in zip(d, d[::-1], strict=True)) / (2 * n + 1))
    return [term - float(2 / Fraction(math.pi) ** (2 * n)) for n, term in enumerate(d, start=1)]


def _series(coefficients: list[float], x: Any) -> Any:
    """Return Σ c_n xⁿ, three terms at a time, because short chains make compiled code fast."""
    square = x * x
    cube, total = square * x, 0.0
    for start in reversed(range(0, len(coefficients), 3)):
        three = [*coefficients[start : start + 3], 0.0, 0.0][:3]
        total = total * cube + (three[0] + three[1] * x + three[2] * square)
    return total


_OVER_SINE, _COTANGENT = _over_sine(), _cotangent()
_STUMPFF = [[(-1) ** n / math.factorial(2 * n + k) for n in range(STUMPFF_TERMS)] for k in range(6)]


# Rotations of space -------------------------------------------------------------------------------


def rotation_of_quaternion(q: Array) -> Array:
    """Return the rotation of a unit quaternion, ``(..., 4) -> (..., 3, 3)``."""
    x, y, z, w = np.moveaxis(q, -1, 0)
    rows = (
        (x * x - y * y - z * z + w * w, 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), -x * x + y * y - z * z + w * w, 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), -x * x - y * y + z * z + w * w),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rotation_of_euler(sequence: str, angles: Array) -> Array:
    """Return the product of turns by these angles, rad, ``(..., n) -> (..., 3, 3)``.

    The axes of upper-case letters turn with the body, those of lower-case letters stay.
    """

    def joined(q: Array, turn: Array) -> Array:
        return _quaternion_product(q, turn) if sequence.isupper() else _quaternion_product(turn, q)

    half = np.asarray(angles) / 2
    turns = np.zeros((len(sequence), *half.shape[:-1], 4), dtype=half.dtype)
    for index, letter in enumerate(sequence.lower()):
        turns[index, ..., "xyz".index(letter)] = sin(half[..., index])
        turns[index, ..., 3] = cos(half[..., index])
    return rotation_of_quaternion(reduce(joined, turns))


def _quaternion_product(p: Array, q: Array) -> Array:
    vector = p[..., 3:] * q[..., :3] + q[..., 3:] * p[..., :3] + np.cross(p[..., :3], q[..., :3])
    scalar = p[..., 3] * q[..., 3]
    for k in range(3):
        scalar = scalar - p[..., k] * q[..., k]
    return np.concatenate([vector, scalar[..., None]], axis=-1)


# Rotations of R^n acting on k translation columns: SO(n), SE(n) and SE_2(3) in one description ----
#
# A pose is the matrix [[R, x_1 … x_k], [0, I]]. The left Jacobian of SO(3) is SciPy's; this module
# arranges the parts by columns and knows no law.


SMALLEST_RATE = 1e-12
"""Smallest rate of rotation relative to the whole vector; a smaller one is rounding."""


TINY = 1e-300
"""A divisor in place of 0, which changes no other divisor."""

FAR_TRACE = 0.0
"""Trace of a rotation by 120°; beyond this angle, a quaternion is divided by another entry than q₀.

Near 120°, both formulas amplify a drift from the group by about the same factor, so a solver sees
no step between them. At 162°, they differed by ten times the tolerance.
"""


class EuclideanGroup(MatrixLieGroup):
    """SO(n) ⋉ (R^n)^k for n = 2 or 3, coordinates in the order rotation, x_1, …, x_k.

    Attributes
    ----------
    space
        n, the dimension of the space that the rotations act on.
    columns
        A name for each of the k translation columns, as written in a configuration.
    rates
        A letter for the velocity of each column, used in the names of coordinates.
    column_units
        Units of each column; its velocity is in the same unit per second.
    """

    space: int
    compact_times_vector: bool | None = True  # SO(n) ⋉ (R^n)^k is in the class of Remark 6.3
    columns: tuple[str, ...] = ()
    rates: tuple[str, ...] = ()
    column_units: tuple[str, ...] = ()
    force_units: tuple[str, ...] = ()

    @property
    def rotation_group(self) -> "EuclideanGroup":
        """SO(n), the group of its rotations; itself if it has no translations."""
        return self

    def __init__(self) -> None:
        n, k = self.space, len(self.columns)
        generators = _rotation_generators(n)
        self.rotations = len(generators)
        basis = np.zeros((self.rotations + n * k, n + k, n + k))
        basis[: self.rotations, :n, :n] = generators
        for column in range(k):
            for row in range(n):
                basis[self.rotations + n * column + row, row, n + column] = 1.0
        self.basis, self._generators = basis, generators
        axes = ("x", "y", "z")[:n]
        angular = ("ω",) if n == 2 else tuple("ω" + axis for axis in axes)
        self.axis_names = angular + tuple(f"{rate}{axis}" for rate in self.rates for axis in axes)

    @property
    def parts(self) -> tuple[Part, ...]:
        """The rotation, if there is one, then each translation column."""
        n = self.space
        rotation = slice(0, self.rotations)
        entries = slice(0, n), slice(0, n)
        angular = Part("rotation", rotation, entries, "1", "rad/s", "N m", turns=True)
        parts = [angular] if self.rotations else []
        for index, unit in enumerate(self.column_units):
            axes = slice(self.rotations + n * index, self.rotations + n * (index + 1))
            entries = (slice(0, n), slice(n + index, n + index + 1))
            name = "translation" if len(self.columns) == 1 else self.columns[index]
            rate = "m/s" if unit == "m" else "m/s^2"
            parts.append(Part(name, axes, entries, unit, rate, self.force_units[index]))
        return tuple(parts)

    @property
    def compact(self) -> bool:
        """Whether there are no translations, which are unbounded."""
        return not self.columns

    def principal_moments(self, inertia: Array) -> tuple[Array, ...]:
        """Return the eigenvalues of J − B M⁻¹ Bᵀ, of the blocks [[J, B], [Bᵀ, M]], in space."""
        if self.rotations != 3 or len(self.columns) > 1:
            return ()
        k = self.rotations
        J, B, M = inertia[..., :k, :k], inertia[..., :k, k:], inertia[..., k:, k:]
        about_centre = J - B @ np.linalg.solve(M, transpose(B)) if self.columns else J
        return (np.linalg.eigvalsh(about_centre),)

    def rotation(self, Q: Array) -> Array:
        """The rotation matrix, ``(..., d, d) -> (..., n, n)``."""
        return Q[..., : self.space, : self.space]

    def translations(self, Q: Array) -> Array:
        """The translation columns, ``(..., d, d) -> (..., n, k)``."""
        return Q[..., : self.space, self.space :]

    def assemble(self, rotation: Any, translations: Array) -> Array:
        """The pose with these matrices, ``(..., n, n), (..., n, k) -> (..., d, d)``."""
        dtype = np.result_type(rotation, translations)
        batch = np.broadcast_shapes(rotation.shape[:-2], translations.shape[:-2])
        like = translations if isinstance(rotation, np.ndarray) else rotation
        Q = np.zeros_like(like, shape=(*batch, self.size, self.size), dtype=dtype)
        Q[...] = self.identity
        Q[..., : self.space, : self.space] = rotation
        Q[..., : self.space, self.space :] = translations
        return Q

    def inverse(self, Q: Array) -> Array:
        """[[Rᵀ, −Rᵀx], [0, I]]."""
        n = self.space
        inverse = Q.copy()
        inverse[..., :n, :n] = transpose(self.rotation(Q))
        if self.columns:
            inverse[..., :n, n:] = -(inverse[..., :n, :n] @ self.translations(Q))
        return inverse

    def gram_rate(self, Q: Array, V: Array) -> Array:
        """Return the rate without the constant part RᵀR = I."""
        rate = super().gram_rate(Q, V)
        rate[..., : self.space, : self.space] = 0.0
        return rate

    def Ad_matrix(self, Q: Array) -> Array:
        """[[A, 0], [−(E·x) A, R]] with A = R in space and 1 in the plane, for each column x.

        Column j of E·x is E_j x, so that (E·x) ω = ω × x in space.
        """
        n, angular = self.space, slice(0, self.rotations)
        R = self.rotation(Q)
        if n == 3 and not self.columns:
            return R
        matrix = np.zeros_like(Q, shape=(*Q.shape[:-2], self.dimension, self.dimension))
        A = R if n == 3 else np.eye(1)
        matrix[..., angular, angular] = A
        for index in range(len(self.columns)):
            rows = slice(self.rotations + n * index, self.rotations + n * (index + 1))
            x = Q[..., :n, n + index]
            moment = transpose(apply_matrix(self._generators, x[..., None, :]))
            matrix[..., rows, angular] = -moment @ A
            matrix[..., rows, rows] = R
        return matrix

    def exp(self, V: Array) -> Array:
        """R = I + c_1 ω^ + c_2 ω^², and (I + c_2 ω^ + c_3 ω^²) x of each column x."""
        n, turn, columns = self.space, V[..., : self.rotations], transpose(self._columns(V))
        _, c1, c2, c3, *_ = (c[..., None] for c in stumpff(stack([dot(turn, turn)])))
        W = (turn @ self._generators.reshape(self.rotations, -1)).reshape(*turn.shape[:-1], n, n)
        W2 = W @ W
        R = np.eye(n) + c1 * W + c2 * W2
        moved = (np.eye(n) + c2 * W + c3 * W2) @ columns if self.columns else columns
        return self.assemble(R, moved)

    def jacobian(self, x: Array) -> Array:
        """A polynomial in ad_x, whose eigenvalues are 0 and ±iθ, as in `log_force`."""
        turn, ad = x[..., : self.rotations], self.ad_matrix(x)
        square = stack([dot(turn, turn)])[..., None]
        _, _, c2, c3, c4, c5 = stumpff(square)
        twice = ad @ ad
        one = np.eye(self.dimension)
        if not self.columns or self.space == 2:
            return one + c2 * ad + c3 * twice
        # With double roots, also the slopes of c_2 and c_3 by θ²: (k c_{k+2} − c_{k+1})/2.
        odd, even = (c3 - 2 * c4) / 2, (c4 - 3 * c5) / 2
        excess = twice + square * one
        return one + ad @ (c2 * one + odd * excess) + twice @ (c3 * one + even * excess)

    def cayley(self, V: Array) -> Array:
        """R = ((1 − |c|²)I + 2c^ + 2ccᵀ) / (1 + |c|²) of coordinates c; columns are unchanged."""
        n, c, R = self.space, V[..., : self.rotations], np.eye(self.space)
        if self.rotations:
            square = stack([dot(c, c)])[..., None]  # without batch axes, a symbol is no array
            c_hat = (c @ self._generators.reshape(self.rotations, -1)).reshape(*c.shape[:-1], n, n)
            even = np.eye(n) * (1 - square)
            if n == 3:
                even = even + 2 * c[..., :, None] * c[..., None, :]
            R = (even + 2 * c_hat) / (1 + square)
        return self.assemble(R, transpose(self._columns(V)))

    def screw(self, V: Array) -> tuple[Array, Array, Array]:
        """Return a frame whose last axis is the axis of rotation (in space), numbers and the rate.

        The first number is 1 or −1, or 0 without rotation. The others are the velocities of the
        columns divided by the rate, which is 1 without rotation.
        """
        omega, columns = V[..., : self.rotations], self._columns(V)
        rates = norm(omega)[..., None]
        rotates = rates > SMALLEST_RATE * norm(V)[..., None]
        rates = np.where(rotates, rates, 1.0)
        axis = np.where(rotates, omega / rates, 0.0)
        rotation = np.broadcast_to(np.eye(self.space), (*V.shape[:-1], self.space, self.space))
        if self.rotations == 3:
            # Rotations that map e_z to the axes, with as many zeros as possible
            z = np.where(rotates, axis, [0.0, 0.0, 1.0])
            y = np.cross(z, np.eye(3)[np.argmin(np.abs(z), axis=-1)])
            y = y / norm(y)[..., None]
            rotation, axis = np.stack([np.cross(y, z), y, z], axis=-1), 1.0 * rotates
            columns = ordered_product(columns, rotation)
        frame = self.assemble(rotation, np.zeros((*V.shape[:-1], self.space, len(self.columns))))
        columns = (columns / rates[..., None]).reshape(*V.shape[:-1], -1)
        return frame, np.concatenate([axis, columns], axis=-1), rates

    def along(self, numbers: Array, angles: Array) -> Array:
        """Return a rotation about the last axis, with the velocities of the columns."""
        U = angles * numbers
        if self.rotations < 3:
            return U
        return np.concatenate([np.zeros((*U.shape[:-1], 2), dtype=U.dtype), U], axis=-1)

    def exp_along(self, numbers: Array, angles: Array) -> Array:
        """I + θX + ω(1 − cos φ)X² + (φ − sin φ)X³ with φ = ωθ and ω = 1, −1 or 0.

        X⁴ = −X² with rotation, and X² = 0 without. The factors of columns stay accurate where φ is
        small and the translation along the axis is large.
        """
        n = self.space
        batch = np.broadcast_shapes(numbers.shape[:-1], angles.shape[:-1])
        dtype = np.result_type(numbers, angles)
        Q = np.zeros_like(angles, shape=(*batch, self.size, self.size), dtype=dtype)
        Q[...] = self.identity
        if not self.rotations:
            Q[..., :n, n] = angles * numbers
            return Q
        sense = numbers[..., :1]
        phi = sense * angles
        if not self.columns:
            sine, cosine = sin(phi), cos(phi)
        else:
            half = sin(phi / 2)
            sine, versine = 2 * half * cos(phi / 2), 2 * half * half
            cosine, lag = 1 - versine, phi - sine
        Q[..., 0, :1] = Q[..., 1, 1:2] = cosine
        Q[..., 0, 1:2], Q[..., 1, :1] = -sine, sine
        for index in range(len(self.columns)):
            first = 1 + n * index
            x, y, *z = (numbers[..., k : k + 1] for k in range(first, first + n))
            column = slice(n + index, n + index + 1)
            Q[..., 0, column] = angles * x - sense * (lag * x + versine * y)
            Q[..., 1, column] = angles * y - sense * (lag * y - versine * x)
            if z:
                Q[..., 2, column] = angles * z[0]
        return Q

    def log(self, Q: Array) -> Array:
        """log in closed form, with rotation angles in [0, π] (n = 3) or [−π, π] (n = 2)."""
        c, y = self.half_turn(Q)
        omega = ratio_to_sine(stack([c])) * y
        if not self.columns:
            return omega
        psi, _ = inverse_jacobian_terms(stack([dot(omega, omega)]))
        W = (omega @ self._generators.reshape(self.rotations, -1)).reshape(self.rotation(Q).shape)
        X = self.translations(Q)
        twice = W @ X
        X = X - twice / 2 + psi[..., None] * (W @ twice)  # J(ω)⁻¹ x
        columns = transpose(X).reshape(*omega.shape[:-1], X.shape[-1] * X.shape[-2])
        return np.concatenate([omega, columns], axis=-1)

    def log_force(self, x: Array, p: Array) -> Array:
        """J_r⁻ᵀ(x) p with J_r⁻¹ = ad_x/2 + (ad_x/2) coth(ad_x/2), a polynomial in ad_x.

        The eigenvalues of ad_x are 0 and ±iθ, the latter as double roots where translations omega
        with the rotation, so that values and slopes of the even part determine its polynomial.
        """
        omega = x[..., : self.rotations]
        square = stack([dot(omega, omega)])
        psi, slope = inverse_jacobian_terms(square)
        once = self.ad_star(x, p)
        twice = self.ad_star(x, once)
        if not self.columns or self.space == 2:
            return p + once / 2 + psi * twice
        fourth = self.ad_star(x, self.ad_star(x, twice))
        return p + once / 2 + (psi - square * slope) * twice - slope * fourth

    def half_turn(self, Q: Array) -> tuple[Array, Array]:
        """cos(θ/2) ≥ 0 and 2 sin(θ/2) times the unit axis, ``(...)`` and ``(..., 3)`` or 1.

        This is twice the vector part of the unit quaternion of the shorter rotation, which changes
        its sign where the angle passes π. The other entries of the quaternion are computed from one
        that is large enough to divide by (Shepperd, J. Guidance and Control 1 (1978) 223).
        """
        R = self.rotation(Q)
        if self.space == 2:
            c, s = R[..., 0, 0], R[..., 1, 0]
            far = smooth_less(1 + 2 * c, FAR_TRACE)
            square = where(far, 2 - 2 * c, 2 + 2 * c)
            w, y = where(far, 2 * s, square), where(far, square, 2 * s)
            scale = where(less(w, 0.0), -1.0, 1.0) / sqrt(square)
            return scale * w / 2, stack([scale * y])
        diagonal = [R[..., k, k] for k in range(3)]
        trace = diagonal[0] + diagonal[1] + diagonal[2]
        sines = [R[..., k - 1, k - 2] - R[..., k - 2, k - 1] for k in range(3)]
        sums = [R[..., k - 1, k - 2] + R[..., k - 2, k - 1] for k in range(3)]
        far = smooth_less(trace, FAR_TRACE)
        first, second, third = diagonal
        is_second = smooth_less(first, second)
        is_third = smooth_less(where(is_second, second, first), third)

        def chosen(w: Any, x: Any, y: Any, z: Any) -> Any:
            return where(far, where(is_third, z, where(is_second, y, x)), w)

        # 4 q_k² and 4 q_k q for the chosen entry q_k.
        square = chosen(1 + trace, *(1 + 2 * diagonal[k] - trace for k in range(3)))
        w = chosen(square, *sines)
        entries = [
            chosen(sines[0], square, sums[2], sums[1]),
            chosen(sines[1], sums[2], square, sums[0]),
            chosen(sines[2], sums[1], sums[0], square),
        ]
        scale = where(less(w, 0.0), -1.0, 1.0) / sqrt(square)
        return scale * w / 2, stack([scale * entry for entry in entries])

    def drift(self, Q: Array) -> Array:
        """Return ‖RᵀR − I‖_F; the other entries of a pose cannot drift."""
        R = self.rotation(Q)
        return frobenius(transpose(R) @ R - np.eye(self.space))

    def rotation_towards(self, direction: Array) -> Array:
        """Return the rotation of a quaternion (n = 3) or complex number (n = 2), normalised first.

        Normal directions give the Haar measure: ``(..., 4)`` or ``(..., 2) -> (..., n, n)``.
        """
        unit = direction / norm(direction)[..., None]
        if unit.shape[-1] == 2:
            s, c = unit[..., 0], unit[..., 1]
            return np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2)
        return rotation_of_quaternion(unit)

    def _columns(self, V: Array) -> Array:
        return V[..., self.rotations :].reshape(*V.shape[:-1], len(self.columns), self.space)


def rigid_motions(group: MatrixLieGroup) -> TypeGuard[EuclideanGroup]:
    """Return whether a group is SE(n): one rotation and one translation."""
    return isinstance(group, EuclideanGroup) and bool(group.rotations) and len(group.columns) == 1


def rigid(group: MatrixLieGroup) -> EuclideanGroup:
    """Return a group that is known to be SE(n)."""
    assert rigid_motions(group)
    return group


def heading_of(G: EuclideanGroup, Q: Array) -> Array:
    """ψ in the only split exp(ψ e_z) exp(θ e) of a rotation of space with e ⟂ e_z, ``(...)``, rad.

    From −π to π; 0 for half turns about horizontal axes, which have no heading.
    """
    c, y = G.half_turn(Q)
    sine = y[..., 2] / 2  # of ψ/2, as c is its cosine, both times the cosine of θ/2
    return 4 * apply("atan", sine / (c + sqrt(c * c + sine * sine) + TINY))


def _rotation_generators(n: int) -> Array:
    """Return the basis of so(n): E_i u = e_i × u, or a counter-clockwise rotation for n = 2."""
    if n == 2:
        return np.array([[[0.0, -1.0], [1.0, 0.0]]])
    generators = np.zeros((3, 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        generators[i, k, j], generators[i, j, k] = 1.0, -1.0
    return generators


class SO2(EuclideanGroup):
    """Rotations of the plane; V is the angular velocity."""

    name = "SO2"
    space = 2


class SO3(EuclideanGroup):
    """Rotations of space; V is the body angular velocity ω."""

    name = "SO3"
    space = 3


class WithPosition(EuclideanGroup):
    """Groups with one translation column, a position in m."""

    columns = ("position",)
    rates = ("v",)
    column_units = ("m",)
    force_units = ("N",)


class SE2(WithPosition):
    """Rigid motions of the plane; V = (ω, v), angular before linear velocity, in the body frame."""

    name = "SE2"
    space = 2
    rotation_group = SO2()


class SE3(WithPosition):
    """Rigid motions of space; V = (ω, v), angular before linear velocity, in the body frame."""

    name = "SE3"
    space = 3
    rotation_group = SO3()


class SE23(EuclideanGroup):
    """Extended poses of space, [R v p]; V = (ω, a, v) drives rotation, velocity and position."""

    name = "SE23"
    space = 3
    columns = ("velocity", "position")
    rates = ("a", "v")
    column_units = ("m/s", "m")
    force_units = ("N s", "N")


# R^n: translations without rotations, for products of groups --------------------------------------


class VectorGroup(WithPosition):
    """Vectors of R^n under addition, R1 to R9, as matrices [[I, x], [0, 1]]; V is ẋ."""

    name = "R<n>"

    def __init__(self, n: int) -> None:
        self.space = n
        self.rotations = 0
        self.basis = np.zeros((n, n + 1, n + 1))
        self.basis[range(n), range(n), n] = 1.0
        self.axis_names = tuple(f"v{index + 1}" for index in range(n))
        self.name = f"R{n}"

    @classmethod
    def named(cls, name: str) -> Self | None:
        """Return R^3 for R3."""
        match = re.fullmatch(r"r([1-9])", bare(name))
        return cls(int(match.group(1))) if match else None

    @classmethod
    def examples(cls) -> tuple[str, ...]:
        """A line and a space."""
        return "R1", "R3"

    def Ad_matrix(self, Q: Array) -> Array:
        """I: the group is commutative."""
        return np.broadcast_to(np.eye(self.space), (*Q.shape[:-2], self.space, self.space))

    def exp(self, V: Array) -> Array:
        """I + V^."""
        return self.identity + self.hat(V)

    def log(self, Q: Array) -> Array:
        """The translation."""
        return Q[..., : self.space, self.space]

    def jacobian(self, x: Array) -> Array:
        """I: the group is commutative."""
        return np.broadcast_to(np.eye(self.space), (*x.shape[:-1], self.space, self.space))

    def log_force(self, x: Array, p: Array) -> Array:
        """p: the logarithm is linear."""
        return p

    def drift(self, Q: Array) -> Array:
        """0: the varying entries are free."""
        return np.zeros(Q.shape[:-2])


def check_turns_in_space(name: str, G: MatrixLieGroup, problems: Problems) -> None:
    """Note that a component needs a body with one attitude in space."""
    if not (isinstance(G, EuclideanGroup) and G.space == 3 and G.rotations and len(G.columns) < 2):
        problems.add(f"{name} needs group SO3 or SE3, got {G.name}")
