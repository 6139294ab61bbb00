"""Delay margins of linear loops. Does not know laws and vehicles."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from eqt_cli.core.arrays import Array

PER_DECADE = 60
"""Frequencies per decade at which the gain is evaluated, besides those near poles."""

NEAR_A_POLE = np.array([-30, -10, -3, -1, -0.3, 0.0, 0.3, 1, 3, 10, 30])
"""Offsets from the frequency of a pole, in units of its decay rate, for more frequencies."""

SLOWEST = 1e-4
"""Lowest searched frequency, as a share of the slowest pole that is not at the origin."""

AT_ORIGIN = 1e-8
"""Poles slower than this share of the fastest one are at the origin, but for rounding."""

BISECTIONS = 45
"""Number of bisections of a frequency interval, down to rounding."""

SAME = 1e-7
"""Tolerance for equal moduli and for whole numbers of periods."""

TRIED = 20
"""Numbers of periods that are all tried. A root may cross the boundary twice between two of them;
then crossings alone do not say which number is the first unstable one."""

ROUNDING = 1e-12
"""Distance of eigenvalues from the edge of stability within which rounding decides the side."""


class CutLoop(NamedTuple):
    """An open loop ẋ = A x + B u, y = C x, or its map over one period; u = y closes the loop.

    Attributes
    ----------
    period
        Period of a sampled loop, s; None for a continuous loop.
    """

    A: Array
    B: Array
    C: Array
    period: float | None

    def gain(self, frequency: Array) -> Array:
        """Return G = C (p − A)⁻¹ B, p = iω, or e^(iωT) for a sampled loop, ``(k, m, m)``."""
        p = 1j * frequency if self.period is None else np.exp(1j * frequency * self.period)
        identity = np.eye(len(self.A))
        found: Array = self.C @ np.linalg.solve(p[:, None, None] * identity - self.A, self.B)
        return found

    def delayed(self, periods: int) -> Array:
        """Return the map over one period of a sampled loop whose commands wait so many periods."""
        n, m = self.B.shape
        if not periods:
            return self.A + self.B @ self.C
        found = np.zeros((n + periods * m, n + periods * m))
        found[:n, :n], found[:n, n : n + m], found[-m:, :n] = self.A, self.B, self.C
        found[n:-m, n + m :] += np.eye((periods - 1) * m)
        return found


def delay_margin(loop: CutLoop) -> float:
    """Return the smallest added delay that makes a stable loop unstable, s; infinite if none does.

    A delay τ of the command puts a root at p = iω, or e^(iωT), if an eigenvalue λ of the gain G is
    e^(iωτ), that is |λ| = 1 and τ = arg λ / ω. The margin is the smallest such τ over all
    frequencies. For a single command it is the phase margin divided by the crossover frequency. The
    documentation page on margins derives this.

    For a sampled loop the margin is the largest whole number of periods with which the loop is
    stable: each of the first `TRIED` numbers is tried; beyond these, the numbers on both sides of
    every crossing.
    """
    found = sorted(_delays(loop))
    if loop.period is None:
        return found[0] if found else np.inf
    for known in range(1, TRIED + 1):
        if not _is_stable(loop, known):
            return (known - 1) * loop.period
    for delay in found:
        periods = int(np.ceil(delay / loop.period - SAME)) - 1
        if periods < known:
            continue
        if not _is_stable(loop, periods):  # a crossing was missed
            first = next(n for n in range(known, periods + 1) if not _is_stable(loop, n))
            return (first - 1) * loop.period
        known = int(np.floor(delay / loop.period + SAME)) + 1  # at the crossing, rounding decides
        if not _is_stable(loop, known):
            return periods * loop.period
    return np.inf


def _is_stable(loop: CutLoop, periods: int) -> bool:
    return bool(np.abs(np.linalg.eigvals(loop.delayed(periods))).max() <= 1.0 - ROUNDING)


def _delays(loop: CutLoop) -> Iterator[float]:
    """Yield all delays that put a root on the stability boundary."""
    frequencies = _frequencies(loop)
    above = _moduli(loop, frequencies) > 1.0
    index, place = np.nonzero(above[:-1] != above[1:])
    low, high, before = frequencies[index], frequencies[index + 1], above[index, place]
    for _ in range(BISECTIONS):
        middle = np.sqrt(low * high)
        is_low = (_moduli(loop, middle)[np.arange(len(place)), place] > 1.0) == before
        low, high = np.where(is_low, middle, low), np.where(is_low, high, middle)
    for crossing, values in zip(low, np.linalg.eigvals(loop.gain(low)), strict=True):
        phases = np.angle(values[np.abs(np.abs(values) - 1.0) < SAME])
        yield from (phases % (2 * np.pi) / crossing).tolist()


def _moduli(loop: CutLoop, frequencies: Array) -> Array:
    """Return the sorted moduli of the eigenvalues of the gain, ``(k, m)``."""
    return np.sort(np.abs(np.linalg.eigvals(loop.gain(frequencies))), axis=-1)


def _frequencies(loop: CutLoop) -> Array:
    """Return frequencies from below the slowest pole to a gain below 1, dense near poles."""
    closed = loop.A + loop.B @ loop.C
    poles = np.concatenate([np.linalg.eigvals(loop.A), np.linalg.eigvals(closed)])
    if loop.period is not None:
        poles = np.log(poles[np.abs(poles) > 0].astype(complex)) / loop.period
        highest = np.pi / loop.period
    else:  # |G| ≤ |B| |C| / (ω − |A|)
        highest = 2 * (_size(loop.A) + _size(loop.B) * _size(loop.C))
    sizes = np.abs(poles)
    lowest = SLOWEST * min(sizes[sizes > AT_ORIGIN * sizes.max()], default=highest)
    count = int(PER_DECADE * np.log10(highest / lowest)) + 2
    near = np.abs(poles.imag)[:, None] + np.abs(poles.real)[:, None] * NEAR_A_POLE
    found = np.concatenate([np.geomspace(lowest, highest, count), near.ravel()])
    return np.unique(found[(found >= lowest) & (found <= highest)])


def _size(matrix: Array) -> float:
    return float(np.linalg.norm(matrix, 2))
