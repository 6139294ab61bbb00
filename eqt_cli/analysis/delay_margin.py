"""How much more delay a linear loop takes before it is unstable; it knows no law and no vehicle."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from eqt_cli.core.arrays import Array

PER_DECADE = 60
"""Frequencies at which the gain of a loop is looked at, beside those near its poles."""

NEAR_A_POLE = np.array([-30, -10, -3, -1, -0.3, 0.0, 0.3, 1, 3, 10, 30])
"""In units of its decay: so far from the frequency of a pole the gain is looked at, too."""

SLOWEST = 1e-4
"""Of the slowest pole that is not at rest: slower crossings are not looked for."""

BISECTIONS = 45
"""Of the interval between two frequencies, which then is as small as rounding."""

SAME = 1e-7
"""Moduli and whole numbers that differ by less are equal."""


class CutLoop(NamedTuple):
    """A loop, cut: ẋ = A x + B u, or x one period later, with y = C x; u = y closes it.

    Attributes
    ----------
    period
        s; None of a continuous loop.
    """

    A: Array
    B: Array
    C: Array
    period: float | None

    def gain(self, frequency: Array) -> Array:
        """G = C (p − A)⁻¹ B with p = iω, or e^(iωT) of a sampled loop, ``(k, m, m)``."""
        p = 1j * frequency if self.period is None else np.exp(1j * frequency * self.period)
        identity = np.eye(len(self.A))
        found: Array = self.C @ np.linalg.solve(p[:, None, None] * identity - self.A, self.B)
        return found

    def delayed(self, periods: int) -> Array:
        """The map of one period of a sampled loop with more delay, its commands in a queue."""
        n, m = self.B.shape
        if not periods:
            return self.A + self.B @ self.C
        found = np.zeros((n + periods * m, n + periods * m))
        found[:n, :n], found[:n, n : n + m], found[-m:, :n] = self.A, self.B, self.C
        found[n:-m, n + m :] += np.eye((periods - 1) * m)
        return found


def delay_margin(loop: CutLoop) -> float:
    """The least further delay with which a stable loop is not stable, s; infinite if there is none.

    A delay τ of the command leaves a root at p = iω, or e^(iωT), where an eigenvalue λ of the gain
    G is e^(iωτ): |λ| = 1 and τ = arg λ / ω. The least of these over all frequencies is the margin:
    a frequency sweep, and of one command the phase margin over the crossover frequency. The page
    on margins derives it.

    Of a sampled loop it is a whole number of periods, the last one with which the loop is stable:
    the eigenvalues with this number and with the next are computed.
    """
    found = sorted(_delays(loop))
    if loop.period is None:
        return found[0] if found else np.inf
    known = 0
    for delay in found:
        periods = int(np.ceil(delay / loop.period - SAME)) - 1
        if periods < known:
            continue
        if not _is_stable(loop, periods):  # a crossing was missed
            first = next(n for n in range(known, periods + 1) if not _is_stable(loop, n))
            return (first - 1) * loop.period
        known = periods + 1
        if not _is_stable(loop, known):
            return periods * loop.period
    return np.inf


def _is_stable(loop: CutLoop, periods: int) -> bool:
    return bool(np.abs(np.linalg.eigvals(loop.delayed(periods))).max() <= 1.0)


def _delays(loop: CutLoop) -> Iterator[float]:
    """Every delay that leaves a root on the boundary."""
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
    """Of the eigenvalues of the gain, in order, ``(k, m)``; continuous in the frequency."""
    return np.sort(np.abs(np.linalg.eigvals(loop.gain(frequencies))), axis=-1)


def _frequencies(loop: CutLoop) -> Array:
    """From far below the slowest pole to where the gain is less than 1, and dense near poles."""
    closed = loop.A + loop.B @ loop.C
    poles = np.concatenate([np.linalg.eigvals(loop.A), np.linalg.eigvals(closed)])
    if loop.period is not None:
        poles = np.log(poles[np.abs(poles) > 0].astype(complex)) / loop.period
        highest = np.pi / loop.period
    else:  # |G| ≤ |B| |C| / (ω − |A|)
        highest = 2 * (_size(loop.A) + _size(loop.B) * _size(loop.C))
    sizes = np.abs(poles)
    lowest = SLOWEST * min(sizes[sizes > SLOWEST * sizes.max()], default=highest)
    count = int(PER_DECADE * np.log10(highest / lowest)) + 2
    near = np.abs(poles.imag)[:, None] + np.abs(poles.real)[:, None] * NEAR_A_POLE
    found = np.concatenate([np.geomspace(lowest, highest, count), near.ravel()])
    return np.unique(found[(found >= lowest) & (found <= highest)])


def _size(matrix: Array) -> float:
    return float(np.linalg.norm(matrix, 2))
