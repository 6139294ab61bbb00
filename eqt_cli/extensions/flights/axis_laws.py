"""Which law flew: gains of terms, their intervals and the delay, by instrumental variables.

A command u is a sum of terms θ_k x_k(t − d) of the errors that a log holds. Plain least squares is
biased if the log's state has noise that the law did not see: E[xxᵀ] contains its variance. So the
instruments z are the same terms at neighbouring rows, or at the same phase of other laps, whose
noise is another one: θ = (Σ zxᵀ)⁻¹ Σ zu (Söderström and Stoica 1983). The same products of the
residual, r(t) times r at these rows, measure what a structure leaves unexplained, without noise.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from eqt_cli.base.arrays import Array

BLOCKS = 16
"""Number of blocks of rows, by which intervals allow for correlation in time."""

NEAR = 0.04
"""Time over which rows before and after are instruments, s."""

MOST_DELAY, MOST_ROWS = 0.25, 30
"""Largest delay that is looked for, s, and in rows."""

MOST_USED = 20_000
"""Largest number of rows of a flight in sums."""

SURE, CONFIDENCE = 0.9995, 0.975
"""Quantiles of Student's t: a term is there beyond the first, and intervals end at the second."""

SMALL, UNSEEN = 0.001, 0.05
"""Shares of the command: a smaller term is none, and a term is absent if all of its interval is
less than the second."""

COLLINEAR = 1e-4
"""Smallest eigenvalue of the correlation of terms at which a motion tells them apart."""

ROUNDED = 1e-3
"""Least half of an interval relative to the value: more digits are of no use."""

STILL = 1e-9
"""Size of a term relative to the command at which it does not move."""

WIDE = 0.4
"""Width of an interval, relative to the value, beyond which a gain is not identifiable."""


@dataclass(frozen=True)
class Rows:
    """A flight: the command and the terms of a law along three axes, at the same times.

    Attributes
    ----------
    name
        The file.
    times : (n,)
        Rising times, s.
    command : (n, 3)
        u.
    terms
        By the name of a term, x ``(n, 3)``.
    good : (n,)
        Rows that count: finite, not at a limit, not switched off.
    limits
        The share of rows at a limit, by the axis.
    skip
        Number of neighbouring rows with which a row shares noise: more than 1 of differences.
    """

    name: str
    times: Array
    command: Array
    terms: Mapping[str, Array]
    good: Array
    limits: tuple[float, float, float] = (0.0, 0.0, 0.0)
    skip: int = 1
    cache: dict[tuple[str, int, float], tuple[Array, Array]] = field(default_factory=dict)

    @property
    def step(self) -> float:
        """The median time between rows, s."""
        return float(np.median(np.diff(self.times)))

    def with_instruments(self, name: str, axis: int, period: float) -> tuple[Array, Array]:
        """Return a term along an axis, or the command without a name, and its instrument."""
        key = name, axis, period
        if key not in self.cache:
            numbers = (self.terms[name] if name else self.command)[:, axis : axis + 1]
            self.cache[key] = numbers, neighbours(self, numbers, period)
        return self.cache[key]


class Sums(NamedTuple):
    """Sums over the rows of blocks, of the terms x, their instruments z and the command u.

    Attributes
    ----------
    zx, xx : (blocks, p, p)
    zu : (blocks, p)
    x, z, u
        The rows themselves, less the mean of their flight.
    block : (n,)
        The block of each row.
    times : (n,)
        Times of the rows, s.
    late : (n,)
        u at the rows that are instruments.
    """

    zx: Array
    xx: Array
    zu: Array
    x: Array
    z: Array
    u: Array
    late: Array
    block: Array
    times: Array


def neighbours(rows: Rows, numbers: Array, period: float) -> Array:
    """Return numbers ``(n, k)`` replaced by their means over the rows that are instruments.

    Parameters
    ----------
    period
        Length of a lap, s: then the rows are those of other laps at the same phase. If it is 0,
        they are rows before and after, but for the next ones.
    """
    t = rows.times
    if not period:
        last = max(rows.skip + 2, round(NEAR / rows.step))
        kernel = np.ones(2 * last + 1)
        kernel[last - rows.skip : last + rows.skip + 1] = 0.0
        kernel /= kernel.sum()
        mean = np.full_like(numbers, np.nan)
        for k in range(numbers.shape[1]):
            if len(t) > 2 * last:
                mean[last:-last, k] = np.convolve(numbers[:, k], kernel, "valid")
        return mean
    laps = int((t[-1] - t[0]) / period) + 1
    total, count = np.zeros_like(numbers), np.zeros(len(t))
    for shift in (k * period for k in range(-laps, laps + 1) if k):
        inside = (t + shift >= t[0]) & (t + shift <= t[-1])
        for k in range(numbers.shape[1]):
            total[inside, k] += np.interp(t[inside] + shift, t, numbers[:, k])
        count += inside
    return np.where(count[:, None] > 0, total / np.maximum(count, 1)[:, None], np.nan)


def sums_of(
    flights: Sequence[Rows], axis: int, names: Sequence[str], delay: int, period: float
) -> Sums:
    """Return the sums of all flights for a delay of so many rows."""
    parts = []
    for place, rows in enumerate(flights):
        pairs = [rows.with_instruments(name, axis, period) for name in ("", *names)]
        (u, late), *columns = pairs
        x, z = (np.concatenate(some, axis=1) for some in zip(*columns, strict=True))
        n = len(u) - delay
        x, z, u, late = x[:n], z[:n], u[delay:], late[delay:]
        good = rows.good[:n] & rows.good[delay:]
        good &= np.isfinite(np.hstack([x, z, u, late])).all(axis=1)
        used = np.flatnonzero(good)
        used = used[:: max(1, len(used) // MOST_USED)]
        some = [part[used] - part[used].mean(axis=0) for part in (x, z, u, late) if len(used)]
        if some:
            time = rows.times[delay:][used]
            parts.append([*some, np.full(len(used), place), time])
    if not parts:
        none, empty = np.empty(0), np.empty((0, len(names)))
        square = np.zeros((1, len(names), len(names)))
        return Sums(square, square, square[:, 0], empty, empty, none, none, none, none)
    x, z, u, late, number, time = (np.concatenate(column) for column in zip(*parts, strict=True))
    block: Any = np.arange(len(u)) * BLOCKS // len(u)
    if len(flights) >= BLOCKS:
        block = np.asarray(number, int)
    blocks = int(block.max()) + 1
    zx, xx = np.zeros((2, blocks, len(names), len(names)))
    zu = np.zeros((blocks, len(names)))
    for k in range(blocks):
        here = block == k
        zx[k], xx[k] = z[here].T @ x[here], x[here].T @ x[here]
        zu[k] = z[here].T @ u[here, 0]
    return Sums(zx, xx, zu, x, z, u[:, 0], late[:, 0], block, time)


def solved(zx: Array, zu: Array) -> Array:
    """Return θ = (Σ zxᵀ)⁻¹ Σ zu, of least norm in scaled terms where terms are alike."""
    scale = np.sqrt(np.maximum(np.abs(np.diag(zx)), 1e-300))
    return np.linalg.lstsq(zx / np.outer(scale, scale), zu / scale, rcond=1e-9)[0] / scale


class Estimate(NamedTuple):
    """The gains of an axis.

    Attributes
    ----------
    values, errors : (p,)
        Gains, and their standard errors by leaving out blocks.
    freedom
        Degrees of freedom of Student's t.
    unexplained, noise
        Rms of what is left without noise, and of all that is left, as shares of the command.
    alike
        Terms that this motion cannot tell apart.
    worst
        The time at which most is left, s.
    """

    values: Array
    errors: Array
    freedom: int
    unexplained: float
    noise: float
    alike: tuple[int, ...]
    worst: float

    def half(self, quantile: float = CONFIDENCE) -> Array:
        """Return half the width of intervals."""
        from scipy.special import stdtrit  # slow to import

        return float(stdtrit(self.freedom, quantile)) * self.errors


def estimate(sums: Sums) -> Estimate:
    """Return the gains by sums over blocks, with their standard errors."""
    values, count = solved(sums.zx.sum(axis=0), sums.zu.sum(axis=0)), len(sums.zx)
    without = [
        solved(sums.zx.sum(axis=0) - sums.zx[k], sums.zu.sum(axis=0) - sums.zu[k])
        for k in range(count)
    ]
    spread = np.array(without) - np.mean(without, axis=0)
    errors = np.sqrt((count - 1) / count * (spread**2).sum(axis=0))
    r, near = sums.u - sums.x @ values, sums.late - sums.z @ values
    size = float(np.mean(sums.u**2)) or 1.0
    both = r * near
    left = np.array([both[sums.block == k].mean() for k in range(count)])
    worst = float(sums.times[sums.block == int(np.argmax(left))].mean())
    xx = sums.xx.sum(axis=0)
    scale = np.sqrt(np.maximum(np.diag(xx), 1e-300))
    sizes, directions = np.linalg.eigh(xx / np.outer(scale, scale))
    alike = set[int]()
    for k in np.flatnonzero(sizes < COLLINEAR):
        alike |= {int(j) for j in np.flatnonzero(np.abs(directions[:, k]) > 0.3)}
    share = np.sqrt(max(float(both.mean()), 0.0) / size)
    noise = np.sqrt(float(np.mean(r**2)) / size)
    return Estimate(values, errors, count - 1, share, noise, tuple(sorted(alike)), worst)


UNCLEAR = "not identifiable"
"""The word for a gain that flights do not determine."""


class Gain(NamedTuple):
    """A gain of a term along an axis.

    Attributes
    ----------
    axis, term
        Its axis, and the name of the term.
    value, low, high
        The gain and its 95 % interval.
    word
        Empty, or why it is not one: ``none``, ``not identifiable``, ``wrong sign``.
    """

    axis: str
    term: str
    value: float
    low: float
    high: float
    word: str = ""


class AxisLaw(NamedTuple):
    """The law along an axis.

    Attributes
    ----------
    gains
        The gains of all terms.
    unexplained, noise, worst
        As in `Estimate`.
    alike
        The names of terms that the motion cannot tell apart.
    size
        Rms of the command, less its mean.
    """

    gains: list[Gain]
    unexplained: float
    noise: float
    worst: float
    alike: tuple[str, ...]
    size: float


def law_along(
    flights: Sequence[Rows],
    axis: int,
    names: Sequence[str],
    optional: Sequence[str],
    delay: int,
    period: float,
) -> AxisLaw:
    """Return the gains of the terms that are there, with a word for the others."""
    terms, absent, letter = list(names), dict[str, Gain](), "xyz"[axis]
    while True:
        sums = sums_of(flights, axis, terms, delay, period)
        size = float(np.sqrt(np.mean(sums.u**2))) if len(sums.u) else 0.0
        if len(sums.u) < 4 * BLOCKS or not size:
            every = [Gain(letter, x, np.nan, np.nan, np.nan, UNCLEAR) for x in names]
            return AxisLaw(every, np.nan, np.nan, np.nan, tuple(terms), size)
        spans = sums.x.std(axis=0) / size
        if (spans <= STILL).any():
            name = terms.pop(int(np.argmin(spans)))
            absent[name] = Gain(letter, name, np.nan, np.nan, np.nan, UNCLEAR)
            continue
        numbers = estimate(sums)
        k = _weakest(numbers, terms, optional, spans)
        if k is None:
            break
        value, half = float(numbers.values[k]), float(numbers.half()[k])
        word = "none" if (abs(value) + half) * spans[k] <= UNSEEN else UNCLEAR
        absent[terms[k]] = Gain(letter, terms[k], value, value - half, value + half, word)
        terms.pop(k)
    alike = tuple(terms[k] for k in numbers.alike)
    step = max(rows.step for rows in flights)
    gains = absent | {gain.term: gain for gain in _gains(numbers, terms, spans, letter, step)}
    every = [gains[name] for name in names]
    return AxisLaw(every, numbers.unexplained, numbers.noise, numbers.worst, alike, size)


def _weakest(
    numbers: Estimate, names: Sequence[str], optional: Sequence[str], spans: Array
) -> int | None:
    """Return the optional term that is least sure; None if all are there."""
    sure, values = numbers.half(SURE), np.abs(numbers.values)
    weak = [
        k
        for k, name in enumerate(names)
        if name in optional and (values[k] < sure[k] or values[k] * spans[k] < SMALL)
    ]
    return min(weak, key=lambda k: values[k] / (numbers.errors[k] or 1e-300), default=None)


def _gains(
    numbers: Estimate, names: Sequence[str], spans: Array, letter: str, step: float
) -> Iterator[Gain]:
    """Yield the gains of terms that stay."""
    half = np.maximum(numbers.half(), ROUNDED * np.abs(numbers.values))
    if "integral" in names and "stiffness" in names:  # sums of a law before or behind a row
        half[names.index("stiffness")] += abs(numbers.values[names.index("integral")]) * step / 2
    for k, name in enumerate(names):
        value, width, word = float(numbers.values[k]), float(half[k]), ""
        if k in numbers.alike:
            word = UNCLEAR
        elif width > abs(value) and (abs(value) + width) * spans[k] <= UNSEEN:
            word = "none"
        elif 2 * width > WIDE * abs(value):
            word = UNCLEAR
        elif value < 0 and name not in ("feedforward", "gyroscopic"):
            word = "wrong sign"
        yield Gain(letter, name, value, value - width, value + width, word)


class Left(NamedTuple):
    """What a structure leaves of the command, as shares of its square, of all axes.

    Attributes
    ----------
    total, blocks
        Without noise, and by block.
    whole
        With noise.
    """

    total: float
    blocks: Array
    whole: float


def unexplained(flights: Sequence[Rows], names: Sequence[str], delay: int, period: float) -> Left:
    """Return what a structure leaves of the command."""
    total, blocks, power, whole = 0.0, np.zeros(BLOCKS), 0.0, 0.0
    for axis in range(3):
        sums = sums_of(flights, axis, names, delay, period)
        if len(sums.u) < 4 * BLOCKS or not (size := float(np.mean(sums.u**2))):
            continue
        theta = solved(sums.zx.sum(axis=0), sums.zu.sum(axis=0))
        r = sums.u - sums.x @ theta
        both, weight = r * (sums.late - sums.z @ theta), 1 / size
        total, power = total + weight * float(both.mean()), power + 1
        whole += weight * float(np.mean(r**2))
        parts = np.arange(len(both)) * BLOCKS // len(both)
        blocks += weight * np.bincount(parts, both, BLOCKS) / np.bincount(parts, minlength=BLOCKS)
    return Left(total / power, blocks / power, whole / power) if power else NOTHING


NOTHING = Left(np.inf, np.zeros(BLOCKS), np.inf)

SHARP = 0.5
"""A delay is the one of the least residual with noise if all others leave that much more: then the
law saw the noise of the log."""


def delay_of(
    flights: Sequence[Rows], names: Sequence[str], period: float
) -> tuple[int, tuple[int, int]]:
    """Return the delay that leaves least, in rows, and those that the flights cannot exclude."""
    h = max(rows.step for rows in flights)
    most = max(1, min(MOST_ROWS, round(MOST_DELAY / h)))
    left = [unexplained(flights, names, d, period) for d in range(most + 1)]
    best = int(np.argmin([one.total for one in left]))
    whole = np.array([one.whole for one in left])
    sharp = int(np.argmin(whole))
    if whole[sharp] <= SHARP * np.delete(whole, sharp).min(initial=np.inf):
        return sharp, (sharp, sharp)
    # Of each delay, whether it leaves more than the best one, by Student's t over blocks
    possible = [best]
    for d, one in enumerate(left):
        more = one.blocks - left[best].blocks
        error = more.std(ddof=1) / np.sqrt(len(more))
        if d != best and one.total - left[best].total < 2.0 * error:
            possible.append(d)
    return best, (min(possible), max(possible))
