"""Finds recordings of one motion under another name, by another clock, or at other instants.

Two flights of one law differ by what disturbs them, which is mm at least. Two recordings of one
flight differ by rounding, and by how one of them was interpolated.
"""

import base64
from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.extensions.logs.logs import Series, matrices

TOLERANCE = 1e-4
"""Largest distance of one motion, rms, as a share of its size, which is the rms distance of its
places from their mean: 0.1 mm of a flight of 1 m. Tables are rounded to 1e-6, and motion capture
measures to 0.1 mm at best; flights of one law that were compared for this differ by 2 % and more.
"""

NOISE, STILL = 5e-6, 0.01
"""The same of small motions, m or rotations, so that noise of 1e-6 does not hide them; and the size
of motions that are too small to tell."""

SCREEN = 0.02
"""Distance on a grid, as a share of the size, beyond which motions are compared no further."""

STEP, MOST_STEPS = 0.05, 2**16
"""Step of this grid, s, and the largest number of its instants: long motions have longer steps."""

OVERLAP, LEAST_ROWS = 0.5, 10
"""Least common time, as a share of the shorter motion, and the least number of rows in it."""

CANDIDATES, ITERATIONS = 3, 8
"""Number of clock offsets that are tried further, and of steps by Gauss and Newton."""

MOST_ROWS = 2048
"""Number of rows that a kept motion has at most: 43 kB as text."""


class Motion(NamedTuple):
    """A motion by its own clock.

    Attributes
    ----------
    times : (n,)
        Rising times, s.
    places : (n, k)
        Positions, m, or the entries of rotations.
    """

    times: Array
    places: Array

    @property
    def size(self) -> float:
        """The rms distance of its places from their mean."""
        return float(np.sqrt(np.sum(self.places.var(axis=0))))

    def at(self, t: Array) -> Array:
        """Return the places at some times, interpolated linearly."""
        return np.stack([np.interp(t, self.times, x) for x in self.places.T], axis=-1)

    def on_grid(self, step: float) -> Array:
        """Return the places at instants so far apart, from the first row."""
        return self.at(np.arange(self.times[0], self.times[-1], step))

    def as_text(self) -> str:
        """Return the motion as text of at most `MOST_ROWS` rows."""
        rows = slice(None, None, -(-len(self.times) // MOST_ROWS))
        whole = np.column_stack([self.times[rows], self.places[rows]])
        numbers = np.concatenate([whole[:1], whole - whole[0]]).astype("<f8")
        head, rest = numbers[:1], numbers[1:].astype("<f4")
        return base64.b64encode(head.tobytes() + rest.tobytes()).decode() + f" {whole.shape[1]}"


def motion_from(text: str) -> Motion:
    """Return a motion that `Motion.as_text` wrote."""
    words, width = text.split()
    data, count = base64.b64decode(words), int(width)
    head = np.frombuffer(data[: 8 * count], "<f8")
    whole = head + np.frombuffer(data[8 * count :], "<f4").reshape(-1, count)
    return Motion(whole[:, 0], whole[:, 1:])


def motion_of(measured: Mapping[str, Series]) -> Motion | None:
    """Return the positions of a recording, or its rotations if it has no position that moves."""
    if one := measured.get("position"):
        motion = Motion(one.times, one.numbers)
        if len(one.times) and motion.size > STILL:
            return motion
    if (one := measured.get("attitude")) and len(one.times):
        return Motion(one.times, matrices(one.numbers).reshape(-1, 9))
    return None


class Twin(NamedTuple):
    """Two recordings of one motion.

    Attributes
    ----------
    name, first
        The recording, and the one before it.
    later
        By how much its clock is ahead, s.
    distance
        The rms distance of both, m or of the entries of rotations.
    """

    name: str
    first: str
    later: float
    distance: float

    @property
    def words(self) -> str:
        """What is the same, and by which clock."""
        clock = f", by a clock {abs(self.later):.6g} s " if abs(self.later) > 1e-6 else ""
        way = ("ahead" if self.later > 0 else "behind") if clock else ""
        return f"the same motion{clock}{way}, to {self.distance:.1g}"


def twins(motions: Mapping[str, Motion]) -> Iterator[Twin]:
    """Yield recordings whose motion an earlier one has, too."""
    usable = {
        name: motion
        for name, motion in motions.items()
        if len(motion.times) >= LEAST_ROWS and motion.size > STILL
    }
    if len(usable) < 2:
        return
    origin = next(iter(usable.values())).places.mean(axis=0)
    longest = max(float(motion.times[-1] - motion.times[0]) for motion in usable.values())
    grids = {}
    for name, motion in usable.items():
        if motion.places.shape[1] == len(origin):
            grids[name] = _Grid.of(motion, origin, max(STEP, longest / MOST_STEPS))
    repeated = set[str]()
    for first, second in combinations(grids, 2):
        if second in repeated or first in repeated:
            continue
        for shift in _shifts(grids[first], grids[second]):
            late, distance = _distance(usable[first], usable[second], shift)
            if distance <= max(TOLERANCE * usable[first].size, NOISE):
                repeated.add(second)
                yield Twin(second, first, late, distance)
                break


class _Grid(NamedTuple):
    """A motion on a grid: its squares summed from the start, and its transform."""

    step: float
    begin: float
    size: float
    squares: Array
    transform: Array

    @classmethod
    def of(cls, motion: Motion, origin: Array, step: float) -> "_Grid":
        places = motion.on_grid(step) - origin
        squares = np.concatenate([[0.0], np.cumsum(np.sum(places**2, axis=1))])
        length = 2 ** int(np.ceil(np.log2(2 * len(places))))
        transform = np.fft.rfft(places, length, axis=0)
        return cls(step, float(motion.times[0]), motion.size, squares, transform)


def _shifts(a: _Grid, b: _Grid) -> Iterator[float]:
    """Yield the clock offsets at which two motions are nearest, if they are near anywhere.

    With an offset of k steps, the mean squared distance is that of both alone less twice their
    correlation; between steps, it is a parabola.
    """
    n, m = len(a.squares) - 1, len(b.squares) - 1
    length = 2 ** int(np.ceil(np.log2(n + m)))
    one, other = (_stretched(x.transform, length) for x in (a, b))
    correlation = np.fft.irfft(np.sum(one * other.conj(), axis=1), length)
    k = np.arange(-(m - 1), n)
    begin, end = np.maximum(k, 0), np.minimum(k + m, n)
    counts = end - begin
    sums = a.squares[end] - a.squares[begin] + b.squares[end - k] - b.squares[begin - k]
    squares = np.full(len(k) + 2, np.inf)
    enough = counts >= OVERLAP * min(n, m)
    squares[1:-1][enough] = ((sums - 2 * correlation[k]) / np.maximum(counts, 1))[enough]
    left, here, right = squares[:-2], squares[1:-1], squares[2:]
    lows = np.flatnonzero((here <= left) & (here <= right) & np.isfinite(here))
    vertices = list[tuple[float, float]]()
    for low in lows.tolist():
        x, y = 0.0, float(here[low])
        bend = left[low] - 2 * here[low] + right[low]
        if np.isfinite(bend) and bend > 0:
            x = float((left[low] - right[low]) / (2 * bend))
            y -= float((left[low] - right[low]) ** 2 / (8 * bend))
        vertices.append((max(y, 0.0), float(k[low]) + x))
    for y, x in sorted(vertices)[:CANDIDATES]:
        if y <= (SCREEN * a.size) ** 2:
            yield b.begin - a.begin - x * a.step


def _distance(a: Motion, b: Motion, shift: float) -> tuple[float, float]:
    """Return offset and rms distance of two motions by the best clock of b, s(t) = (1 + e) t + c.

    The rows of one are compared with the other between its rows; which of both was interpolated
    is not known, and so both ways are tried.
    """
    ways = [_fitted(a, b, shift), _fitted(b, a, -shift)]
    ways[1] = -ways[1][0], ways[1][1]
    return min(ways, key=lambda way: way[1])


def _fitted(a: Motion, b: Motion, shift: float) -> tuple[float, float]:
    t, middle = a.times, float(a.times.mean())
    clock, distance = np.array([shift, 0.0]), np.inf
    steps = np.diff(b.times)
    slopes = Motion(b.times[:-1], np.diff(b.places, axis=0) / steps[:, None])
    for _ in range(ITERATIONS):
        s = t + clock[0] + clock[1] * (t - middle)
        inside = (s >= b.times[0]) & (s <= b.times[-1])
        if inside.sum() < LEAST_ROWS:
            return shift, np.inf
        since = (t - middle)[inside]
        errors = a.places[inside] - b.at(s[inside])
        here = np.sqrt(np.mean(np.sum(errors**2, axis=1)))
        if not here < 0.999 * distance:
            break
        best, distance = clock, float(here)
        rows = np.clip(np.searchsorted(b.times, s[inside], side="right") - 1, 0, len(steps) - 1)
        speed = slopes.places[rows]
        X = np.stack([speed.ravel(), (speed * since[:, None]).ravel()], axis=-1)
        clock = clock + np.linalg.lstsq(X, errors.ravel(), rcond=None)[0]
    return float(best[0]), distance


def _stretched(transform: Array, length: int) -> Any:
    """Return the transform of a motion with more zeros behind it."""
    if 2 * (len(transform) - 1) == length:
        return transform
    places = np.fft.irfft(transform, axis=0)
    return np.fft.rfft(places, length, axis=0)
