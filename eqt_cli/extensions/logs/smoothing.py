"""Smooth motions near measured poses, on their group.

In a vector space this is the cubic smoothing spline,
which minimises Σ|y_i − f(t_i)|² + λ ∫|f''|² (Reinsch, Numerische Mathematik 10, 1967). With QᵀQ and
R of that article, the second derivatives at the inner knots solve (R + λQᵀQ)u = Qᵀy, and the
residual is λQu. On a group, differences of neighbours are logarithms, and residuals are
log(Q_i⁻¹P_i); motions of constant velocity are not changed.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import InputError, Problems
from eqt_cli.components.groups import MatrixLieGroup, Part
from eqt_cli.components.waypoints import WaypointsReference
from eqt_cli.extensions.logs.recording_check import log_of, notes

SMALLEST, LARGEST = 1e-6, 1e11
"""Range of λ relative to the cube of the mean step: below it, nothing is smoothed; above it,
rounding becomes visible."""

SETTLED = 1e-12
"""Change of the poses at which the iteration has converged, relative to the largest residual."""

MATCHED = 1e-4
"""Relative tolerance of a residual with respect to the requested deviation."""

MAX_ITERATIONS, MAX_MATCHES = 200, 20

FEWEST = 5
"""Smallest number of poses for cross-validation."""

NOISE = 0.1
"""Acceleration by noise from row to row, m/s² or rad/s², above which smoothing is proposed."""

MOST_ROWS = 2000
"""Largest number of rows, in the middle of a recording, whose noise is estimated."""


class Smoothed(NamedTuple):
    """Poses on a smooth motion.

    Attributes
    ----------
    poses : (n, d, d)
    residuals
        For each part, the root mean square of |log(Q_i⁻¹P_i)|.
    weights
        λ of each part.
    """

    poses: Array
    residuals: list[float]
    weights: list[float]


@purposes.proposed_smoothing
def proposed_smoothing(G: MatrixLieGroup, times: Array, poses: Array) -> str:
    """Return the option `smoothing` that the noise of a recording asks for; "" if it is small."""
    first = max(0, (len(times) - MOST_ROWS) // 2)
    times, poses = times[first : first + MOST_ROWS], poses[first : first + MOST_ROWS]
    with suppress(InputError, np.linalg.LinAlgError):  # times far apart, or nearly equal
        sizes = smoothed(G, times, poses, [None] * len(G.parts)).residuals
        if max(sizes) > NOISE * np.median(np.diff(times)) ** 2:
            pairs = zip(G.parts, sizes, strict=True)
            return f"{{{', '.join(f'{part.name}: {size:.2g}' for part, size in pairs)}}}"
    return ""


class _Bending:
    """The banded matrices of the second derivatives at the knots."""

    def __init__(self, times: Array) -> None:
        h = np.diff(times)
        self.steps, self.mean = h, float(h.mean())
        self.inverse = 1 / h
        a, c = self.inverse[:-1], self.inverse[1:]
        self.middle = -(a + c)
        self.R = np.zeros((3, len(h) - 1))
        self.R[0] = (h[:-1] + h[1:]) / 3
        self.R[1, :-1] = h[1:-1] / 6
        self.squares = np.zeros_like(self.R)
        self.squares[0] = a**2 + self.middle**2 + c**2
        self.squares[1, :-1] = self.middle[:-1] * c[:-1] + c[:-1] * self.middle[1:]
        self.squares[2, :-2] = c[:-2] * c[1:-1]

    def of_steps(self, steps: Array) -> Array:
        """Return Qᵀy from the differences of neighbours, ``(n − 1, m)``."""
        return np.diff(steps * self.inverse[:, None], axis=0)

    def spread(self, u: Array) -> Array:
        """Return Qu."""
        product = np.zeros((len(self.steps) + 1, u.shape[1]))
        product[:-2] += u * self.inverse[:-1, None]
        product[1:-1] += u * self.middle[:, None]
        product[2:] += u * self.inverse[1:, None]
        return product

    def residual(self, weight: float, differences: Array) -> Array:
        """Return λQu for the solution u of (R + λQᵀQ)u = Qᵀy."""
        from scipy.linalg import solveh_banded  # slow to import, and not needed to read results

        bands = self.R + weight * self.squares
        return weight * self.spread(solveh_banded(bands, differences, lower=True))

    def freedom(self, weight: float) -> float:
        """Return tr(I − A) of the smoothing matrix A: n − 2 − tr(R(R + λQᵀQ)⁻¹).

        The inverse is needed on the bands of R only (Hutchinson and de Hoog, Numerische Mathematik
        47, 1985).
        """
        from scipy.linalg import cholesky_banded

        factor = cholesky_banded(self.R + weight * self.squares, lower=True)
        pivots, first, second = factor[0] ** 2, factor[1] / factor[0], factor[2] / factor[0]
        here = beside = next_here = 0.0  # entries of the inverse in the two rows below
        trace = 0.0
        bands = (np.flip(band).tolist() for band in (pivots, first, second, *self.R[:2]))
        for d, one, two, r, s in zip(*bands, strict=True):
            far = -one * beside - two * next_here
            near = -one * here - two * beside
            entry = 1 / d - one * near - two * far
            trace += r * entry + 2 * s * near
            next_here, here, beside = here, entry, near
        return len(self.steps) - 1 - trace


def smoothed(
    G: MatrixLieGroup, times: Array, poses: Array, deviations: Sequence[float | None]
) -> Smoothed:
    """Return poses on a smooth motion near the given ones.

    Parameters
    ----------
    times : (n,)
    poses : (n, d, d)
    deviations
        The residual requested for each part of the group; None for the λ that minimises
        generalised cross-validation.

    Raises
    ------
    InputError
        If there are too few poses, or they are too far apart.
    """
    if len(times) < FEWEST:
        raise InputError(f"expected at least {FEWEST} waypoints to smooth, got {len(times)}")
    bending, axes = _Bending(times), [part.axes for part in G.parts]
    differences = bending.of_steps(_steps(G, poses))
    aims = list(deviations)
    for _ in range(MAX_MATCHES):
        pairs = zip(axes, aims, strict=True)
        weights = [_weight_of(bending, differences[:, part], aim) for part, aim in pairs]
        smooth, remaining = _solved(G, bending, poses, list(zip(axes, weights, strict=True)))
        residuals = [_size(remaining[:, part]) for part in axes]
        largest = LARGEST * bending.mean**3
        off = [
            deviation is not None
            and abs(residual / deviation - 1) > MATCHED
            and not (weight >= largest and residual < deviation)
            for deviation, residual, weight in zip(deviations, residuals, weights, strict=True)
        ]
        if not any(off):
            break
        for k, deviation in enumerate(deviations):
            if off[k] and deviation is not None:  # the λ of a vector space is not exact on a group
                aims[k] = aims[k] * deviation / residuals[k]  # type: ignore[operator]  # None only where the deviation is
    return Smoothed(smooth, residuals, weights)


def _solved(
    G: MatrixLieGroup, bending: _Bending, poses: Array, parts: list[tuple[slice, float]]
) -> tuple[Array, Array]:
    """Return poses whose residuals are λQu with their second derivatives u, and the residuals.

    Newton's method with the matrix of a vector space, where one iteration suffices.
    """
    smooth = poses
    for _ in range(MAX_ITERATIONS):
        actual = G.log(G.inverse(smooth) @ poses)
        differences = bending.of_steps(_steps(G, smooth))
        differences += bending.of_steps(np.diff(actual, axis=0))
        wanted = np.zeros_like(actual)
        for part, weight in parts:
            wanted[:, part] = bending.residual(weight, differences[:, part])
        change = actual - wanted
        smooth = smooth @ G.exp(change)
        size = float(np.abs(change).max())
        if size <= SETTLED * max(float(np.abs(wanted).max()), 1.0):
            return smooth, G.log(G.inverse(smooth) @ poses)
        if not np.isfinite(size):
            break
    raise InputError(
        "no smooth motion was found near these poses; give a smaller deviation, or more poses "
        "where they turn"
    )


def _steps(G: MatrixLieGroup, poses: Array) -> Array:
    return G.log(G.inverse(poses[:-1]) @ poses[1:])


def _size(residuals: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(residuals * residuals, axis=1))))


def _range(bending: _Bending) -> tuple[float, float]:
    """Return the logarithms of the smallest and the largest λ."""
    return tuple(np.log(np.array([SMALLEST, LARGEST]) * bending.mean**3).tolist())


def _weight_of(bending: _Bending, differences: Array, aim: float | None) -> float:
    """Return the λ that gives a residual, which grows with λ; by cross-validation without one."""
    if aim is None:
        return _cross_validated_weight(bending, differences)

    def excess(power: float) -> float:
        size = _size(bending.residual(float(np.exp(power)), differences))
        return float(np.log(max(size, 1e-300) / aim))

    from scipy.optimize import brentq

    low, high = _range(bending)
    if excess(low) >= 0:
        return float(np.exp(low))
    if excess(high) <= 0:
        return float(np.exp(high))
    return float(np.exp(brentq(excess, low, high, xtol=1e-6)))


def _cross_validated_weight(bending: _Bending, differences: Array) -> float:
    """Return the λ that minimises generalised cross-validation, n Σ|r_i|² / tr(I − A)²."""

    def score(power: float) -> float:
        weight = float(np.exp(power))
        size, freedom = _size(bending.residual(weight, differences)), bending.freedom(weight)
        return float(np.log(max(size, 1e-300)) - np.log(freedom))

    from scipy.optimize import minimize_scalar

    grid = np.linspace(*_range(bending), 41)  # the best of a grid, refined
    best = int(np.argmin([score(float(power)) for power in grid]))
    bounds = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    minimum = minimize_scalar(score, bounds=bounds, method="bounded", options={"xatol": 1e-8})
    return float(np.exp(minimum.x))


# What a reference through waypoints asks ----------------------------------------------------------


SHORTFALL = 0.01
"""Relative amount by which a residual may be below the requested deviation without a remark."""


@purposes.reference_smoothing
def smoothed_waypoints(reference: WaypointsReference, G: MatrixLieGroup) -> Smoothed:
    """Return the waypoints of a reference on a smooth motion."""
    rows, deviations = reference.waypoints(G), reference.deviations(G, Problems())
    return reference.prepared(G, lambda group: smoothed(group, *rows, deviations), "smoothed")


@purposes.remarks_on_waypoints
def remarks(reference: WaypointsReference, G: MatrixLieGroup) -> Iterator[str]:
    """Yield the oddities of the file of a reference, and the residuals of smoothing."""
    if reference.file is not None:
        yield from (f"{reference.file}: {note}" for note in notes(log_of(reference, G)))
    if reference.smoothing is None:
        if reference.file and (sizes := proposed_smoothing(G, *reference.waypoints(G))):
            yield f"goes through every row, noise included; add `smoothing: {sizes}`"
        return
    residuals = smoothed_waypoints(reference, G).residuals
    requested = reference.deviations(G, Problems())
    for part, residual, deviation in zip(G.parts, residuals, requested, strict=True):
        size = _in_words(part, residual)
        if deviation is not None and residual < (1 - SHORTFALL) * deviation:
            size += f" instead of {_in_words(part, deviation)}, and cannot be larger"
        yield f"smoothed: the root mean square residual of {part.name} is {size}"


def _in_words(part: Part, residual: float) -> str:
    """Format a residual of a part of the group with its unit."""
    size, unit = (math.degrees(residual), "deg") if part.turns else (residual, part.pose_unit)
    return f"{size:.3g} {unit}"
