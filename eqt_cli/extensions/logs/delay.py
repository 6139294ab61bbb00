"""Estimates by how much a measurement is later than what was wanted, with a standard error."""

from typing import Any, NamedTuple

import numpy as np

from eqt_cli.base.arrays import Array

MOST_DELAY, STEP, EXPLAINS, MOST_ROWS = 1.0, 0.02, 0.95, 300
"""The search starts at the delay nearest to 0, among those up to the first in these steps, s, with
which the error of about so many rows is the smallest one but for this share."""

LEVEL = 0.01
"""Probability with which one regression names a delay or a drift where there is none."""

BLOCKS = 10
"""Number of blocks that are left out in turn, because the errors of neighbours are correlated."""

DISTINCT, STRONG = 0.01, 10.0
"""Least share of the squared velocity that other frames do not imitate, and least F of the
instrument for it (Staiger and Stock 1997)."""

ITERATIONS = 20
"""Largest number of iterations of Gauss-Newton."""

EQUAL = 1e-10
"""Relative singular value below which frames are the same, as where a body never turns."""

LEAST_ERROR = 1e-6
"""Smallest standard error, s or s/s, and smallest change; clocks are no better."""


class Pair(NamedTuple):
    """A measured and a wanted series at the instants of one, to which the other is interpolated.

    Attributes
    ----------
    base, other
        The series of the instants, and the interpolated one, as `logs.Series`.
    side
        1 if the measured one is interpolated, −1 if the wanted one is.
    edges, armed
        Times at which something changes, and whether the rows after each count.
    """

    base: Any
    other: Any
    side: int
    edges: Array
    armed: Array

    def at(self, delay: Array | float = 0.0, how: str = "linear") -> list[Array]:
        """Return measured and wanted numbers without a delay, NaN where they do not count."""
        t = self.base.times
        other = self.other.at(t + self.side * delay, how, self.edges)
        counts = self.armed[np.searchsorted(self.edges, t, side="right")]
        base = np.where(counts[:, None], self.base.numbers, np.nan)
        return [other, base] if self.side == 1 else [base, other]

    def rows(self, delay: Array | float = 0.0, how: str = "linear") -> list[Array]:
        """Return times, measured and wanted numbers where both are known."""
        measured, goal = self.at(delay, how)
        both = np.isfinite(measured).all(axis=1) & np.isfinite(goal).any(axis=1)
        return [column[both] for column in (self.base.times, measured, goal)]

    def rate(self, delay: Array | float, width: float) -> Array:
        """Return the velocity of the interpolated series, its mean over some time."""
        t = self.base.times + self.side * delay
        ends = [t + width / 2, t - width / 2]
        spans = np.searchsorted(self.edges, ends)
        change = apart(*(self.other.at(end, "linear", self.edges) for end in ends))
        return np.where((spans[0] == spans[1])[:, None], change / width, np.nan)


class Delay(NamedTuple):
    """A delay in the middle of a recording, s, and its growth, s/s, with their standard errors.

    NaN where they are not significant. ``shift`` is the delay at the instants, s, and ``remark``
    says what else explains the errors.
    """

    late: Array = np.full(2, np.nan)
    errors: Array = np.full(2, np.nan)
    shift: Array | float = 0.0
    remark: str = ""

    def differs(self, late: Array | float, limit: float) -> Any:
        """Return whether delay and growth differ from others by so many standard errors."""
        return abs(self.late - late) > limit * self.errors


def turns(numbers: Array) -> Any:
    """Return the rotations of quaternions w, x, y, z; those of NaN are no turns."""
    from scipy.spatial.transform import Rotation  # slow to import

    real = np.where(np.isnan(numbers), [1.0, 0.0, 0.0, 0.0], numbers)
    return Rotation.from_quat(real, scalar_first=True)


def apart(a: Array, b: Array) -> Array:
    """Return a − b, or of attitudes the rotation vector of b⁻¹a, in the body frame."""
    if a.shape[1] != 4:
        return a - b
    return (turns(b).inv() * turns(a)).as_rotvec() + 0 * (a + b)[:, 1:]  # NaN stays NaN


def delay_of(pair: Pair, body: Any = None) -> Delay:
    """Return the delay and its growth if one of them is significant.

    Parameters
    ----------
    body
        Attitudes, for an offset that is constant in the body.
    """
    from scipy.stats import t as student  # slow to import

    grid = np.arange(-MOST_DELAY, MOST_DELAY + STEP / 2, STEP)
    times, numbers = (rows[:: 1 + len(rows) // MOST_ROWS] for rows in pair.base[1:3])
    many = np.tile(times, len(grid)), np.tile(numbers, (len(grid), 1))
    tiled = pair._replace(base=pair.base._replace(times=many[0], numbers=many[1]))
    compared = apart(*tiled.at(np.repeat(grid, len(times)))).reshape(len(grid), len(times), -1)
    errors = np.ma.masked_invalid(compared)
    counts = errors.count(axis=1).max(axis=1)
    spreads = errors.var(axis=1).sum(axis=1).filled(np.inf)
    spreads[2 * counts <= counts[len(grid) // 2]] = np.inf
    near = grid[EXPLAINS**2 * spreads <= spreads.min()]
    start = float(near[np.argmin(abs(near))])
    if abs(start) > MOST_DELAY - STEP:
        return Delay()
    limit = float(student.ppf(1 - LEVEL / 4, BLOCKS - 1))  # of two tests, with two sides
    fullest, best = Delay(), Delay()
    for frames in (9, 3, 0):
        best = _fit(pair, body, start, frames)
        fullest = best if np.isnan(fullest.late[0]) else fullest
        if best.differs(0.0, limit).any():
            break
    else:
        return Delay()
    if fullest.differs(best.late, limit).any():
        return Delay(remark="another frame explains these errors, and a delay does not")
    remarks = []
    if frames < 9:
        remarks.append("this motion does not tell the delay from an offset or turn of the frame")
    if best.differs(0.0, limit)[1]:
        growth = f"{1e3 * best.late[1]:.3g} ± {1e3 * best.errors[1]:.1g} ms per s"
        remarks.append(f"the delay grows by {growth}, as where a clock is fast or slow")
    return best._replace(remark="; ".join(remarks))


def _fit(pair: Pair, body: Any, start: float, frames: int) -> Delay:
    """Regress the errors on velocity, velocity times time, and the errors of so many frames.

    The slopes of the interpolated rows share the noise of the errors, and velocities by other rows
    do not: they are the instruments (two-stage least squares). The standard errors leave out one
    block in turn (CV3 of MacKinnon, Nielsen and Webb 2023).
    """
    t, step = pair.base.times, float(np.median(np.diff(pair.other.times)))
    late, middle = np.array([start, 0.0]), np.nan
    for _ in range(ITERATIONS):
        delay = late[0] + late[1] * np.nan_to_num(t - middle)
        measured, goal = pair.at(delay)
        errors, others = apart(measured, goal), _frames(t, goal, body)[..., :frames]
        # Over less than a row, and between rows that are not interpolated
        slopes = [-pair.rate(delay, width) for width in (1e-3 * step, 4 * step)]
        real = np.isfinite(errors + sum(slopes) + others.sum(axis=-1))
        if real.sum() < 4 * BLOCKS:
            break
        middle = np.mean(t[real.any(axis=1)][[0, -1]]) if np.isnan(middle) else middle
        since, W = (t - middle)[:, None], others[real]
        X, Z = (np.column_stack([v[real], (v * since)[real], W]) for v in slopes)
        first = np.column_stack([X[:, 0], Z[:, 0]])
        x, z = (first - W @ np.linalg.lstsq(W, first)[0]).T
        unlike, noise = x @ z, (x @ x) * (z @ z) - (x @ z) ** 2
        is_strong = len(x) * unlike**2 > STRONG * noise
        if not (is_strong and unlike > DISTINCT * first[:, 0] @ first[:, 1]):
            break
        scale = np.linalg.norm(Z, axis=0) + 1e-300
        blocks = [np.array_split(a, BLOCKS) for a in (Z / scale, X / scale, errors[real, None])]
        of_blocks = (
            np.array([*map(np.matmul, map(np.transpose, blocks[0]), a)]) for a in blocks[1:]
        )
        # With all rows, and without a block
        N, h = (np.concatenate([[a.sum(axis=0)], a.sum(axis=0) - a]) for a in of_blocks)
        changes = (np.linalg.pinv(N, EQUAL) @ h)[:, :2, 0] / scale[:2]
        late = late + changes[0]
        if abs(changes[0, 0]) < LEAST_ERROR:
            error = np.linalg.norm(changes[1:] - changes[0], axis=0) * np.sqrt(1 - 1 / BLOCKS)
            return Delay(late, np.maximum(error, LEAST_ERROR), delay)
    return Delay()


def _frames(t: Array, goal: Array, body: Any) -> Array:
    """Return the errors of an offset, a small turn, and an offset in the body, by axis.

    Of attitudes, these are turns of the frames of the body and of space.
    """
    columns = [np.broadcast_to(np.eye(3), (len(t), 3, 3))]
    if goal.shape[1] == 4:
        columns.append(turns(goal).inv().as_matrix())
    else:
        columns.append(np.cross(np.eye(3), np.nan_to_num(goal)[:, None]).swapaxes(1, 2))
    if body:
        attitudes = body.at(t)
        columns.append(turns(attitudes).as_matrix() + 0 * attitudes[:, 1:, None])
    return np.concatenate(columns, axis=-1)
