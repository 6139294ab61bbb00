"""Interpolates a run, aligns a recording with it, and says what of its errors the run explains."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import InputError
from eqt_cli.base.reporting import Block, TextTable, brief, count_of, fixed, percent
from eqt_cli.components.groups import MatrixLieGroup, Part
from eqt_cli.components.motions import Pieces, through
from eqt_cli.extensions.logs.recording import WRENCH, recorded_names
from eqt_cli.extensions.logs.recording_check import Recording
from eqt_cli.results.quantity import Plain
from eqt_cli.results.result import Result, check_stored

FEWEST = 20
"""Least number of rows, and of samples of the run, for an alignment."""

MOST_INSTANTS = 50_000
"""Largest number of instants at which a recording is compared."""

LEAST_OVERLAP = 0.5
"""Least overlap as a share of the shorter of the two."""

LARGEST_ROTATION = 2.0
"""Largest rotation within a window, rad; near π an increment would jump."""

CONSTANT_WITHIN = 1e-5
"""Relative change below which a velocity counts as constant, because engines err as much."""

LEAST_CORRELATION = 0.5
"""Least correlation at the estimated offset."""

LEAST_MISFIT_RATIO = 1.5
"""Least ratio of the misfit of every other offset to that of the best."""

LARGEST_RELATIVE_ERROR = 0.1
"""Largest standard error of the offset relative to the width of the peak."""

LEAST_NOISE = 0.05
"""Least noise as a share of the variance of a measured coordinate."""

BLOCKS = 20
"""Number of blocks for the standard error, because the errors of neighbours are correlated."""

LEAST_ERROR = 1e-6
"""Smallest reported standard error, s; clocks are no better."""

ITERATIONS, CONVERGED = 20, 1e-9
"""Gauss-Newton: largest number of iterations, and final change relative to the time step."""

WHAT_TO_DO = "give the offset of the clock in the mapping, as `time: {offset: 0.137}`"


@dataclass(frozen=True)
class Alignment:
    """The alignment of the clock of a recording with that of a run.

    Attributes
    ----------
    offset
        Offset to add to the times of the recording, s.
    error
        Standard error of the offset, s; NaN if the mapping gives the offset.
    correlation
        Correlation of the two motions; NaN if the mapping gives the offset.
    by
        Name of the compared quantity; empty if the mapping gives the offset.
    """

    offset: float
    error: float = np.nan
    correlation: float = np.nan
    by: str = ""

    @property
    def in_words(self) -> str:
        """Description for notes."""
        if not self.by:
            return "clock offset from the mapping"
        error, offset = max(self.error, LEAST_ERROR), fixed(self.offset, 4, signed=True)
        return (
            f"clock offset {offset} s, standard error {error:.1g} s, from the {self.by}; "
            f"correlation {self.correlation:.3f}"
        )


def aligned(recording: Recording, times: Array, run: Pieces) -> Alignment:
    """Estimate the clock offset of a recording relative to a run.

    Parameters
    ----------
    times : (n,)
        Times of the run's samples, s.
    run
        The run as a motion.

    Raises
    ------
    InputError
        If the offset cannot be determined.
    """
    for what, count in (("rows", len(recording.times)), ("samples of the run", len(times))):
        if count < FEWEST:
            raise _unknown(recording, f"expected {FEWEST} {what} or more, got {count}")
    begin, end = recording.times[[0, -1]]
    step = max(float(np.median(np.diff(recording.times))), float(end - begin) / MOST_INSTANTS)
    instants = begin + step * np.arange(int((end - begin) / step * (1 + 1e-9)) + 1)
    seen = _resampled(recording, instants)
    measured = np.flatnonzero(np.isfinite(recording.velocities).all(axis=0)).tolist()
    signals = _signals(seen, measured, times, run)
    peaks = [_peak(signal, float(begin), times, step) for signal in signals]
    if not peaks:
        raise _unknown(recording, "its rows are too far apart for the run")
    best = max(peaks, key=lambda peak: (not peak.doubt, peak.quality))
    if best.doubt:
        raise _unknown(recording, best.doubt)
    models = [_of_poses(seen, times, run)]
    if measured:
        models.append(_of_velocities(seen, measured, times, run))
    candidates = [_refined(model, best, step) for model in models]
    alignment = min(candidates, key=lambda candidate: candidate.error)
    if not np.isfinite(alignment.error):
        raise _unknown(recording, f"the motions differ too much around {best.offset:.3g} s")
    if alignment.error > LARGEST_RELATIVE_ERROR * best.width:
        raise _unknown(recording, f"the offset is uncertain by ± {alignment.error:.2g} s")
    return alignment


def _unknown(recording: Recording, reason: str) -> InputError:
    return InputError(f"{recording.name}: cannot be aligned with the run: {reason}; {WHAT_TO_DO}")


def _resampled(recording: Recording, instants: Array) -> Recording:
    """Interpolate with constant velocity between two rows; NaN in the gaps."""
    G, times = recording.group, recording.times
    row = np.clip(np.searchsorted(times, instants, side="right") - 1, 0, len(times) - 2)
    share = (instants - times[row]) / (times[row + 1] - times[row])
    inner = (share > 1e-6) & (share < 1 - 1e-6)  # rows at the ends of a gap are real
    real = ~(np.isin(row, recording.gaps) & inner)
    row, part = row[real], share[real, None]
    poses = np.full((len(instants), G.size, G.size), np.nan)
    velocities = np.full((len(instants), G.dimension), np.nan)
    before, V = recording.poses[row], recording.velocities
    poses[real] = before @ G.exp(part * G.log(G.inverse(before) @ recording.poses[row + 1]))
    velocities[real] = (1 - part) * V[row] + part * V[row + 1]
    return replace(recording, times=instants, poses=poses, velocities=velocities)


# Search over all offsets --------------------------------------------------------------------------


_ComparedSignal = tuple[Array, Callable[[Array], Array]]
"""A compared quantity: of the recording at its instants, and of the run at any time, NaN outside
the run."""


class _Peak(NamedTuple):
    """The best offset by a signal, and the reason to doubt it."""

    offset: float
    correlation: float
    quality: float = -1.0
    """Ratio of the misfit of the next best offset to that of the best."""
    width: float = 0.0
    doubt: str = ""


def _signals(
    seen: Recording, measured: list[int], times: Array, run: Pieces
) -> Iterator[_ComparedSignal]:
    """Yield the measured coordinates of the velocity, and increments of the pose over windows."""
    from scipy.interpolate import CubicSpline  # slow to import; readers of results do without

    G, count = seen.group, len(seen.times)
    poses, velocities, _ = run.motion(G, times)
    if measured:
        spline = CubicSpline(times, velocities[:, measured], extrapolate=False)
        yield seen.velocities[:, measured], spline
    step, window = float(seen.times[1] - seen.times[0]), 1
    turns = [part.axes for part in G.parts if part.turns]
    real = ~np.isnan(seen.poses[:, 0, 0])
    while window <= count // 4:
        early = times <= times[-1] - window * step
        if early.sum() < FEWEST:
            return
        later, _, _ = run.motion(G, times[early] + window * step)
        simulated = G.log(G.inverse(poses[early]) @ later)
        angles = (np.linalg.norm(simulated[:, axes], axis=1) for axes in turns)
        if any(angle.max() > LARGEST_ROTATION for angle in angles):
            return
        both = real[:-window] & real[window:]
        increments = np.full((count - window, G.dimension), np.nan)
        first, last = seen.poses[:-window][both], seen.poses[window:][both]
        increments[both] = G.log(G.inverse(first) @ last)
        yield increments, CubicSpline(times[early], simulated, extrapolate=False)
        window *= 2


def _peak(signal: _ComparedSignal, begin: float, times: Array, step: float) -> _Peak:
    measured, simulated_at = signal
    grid = times[0] + step * np.arange(int((times[-1] - times[0]) / step * (1 + 1e-9)) + 1)
    simulated = simulated_at(grid)
    real = simulated[np.isfinite(simulated).all(axis=1)]
    if not real.std(axis=0).max() > CONSTANT_WITHIN * np.sqrt(np.mean(real**2)):
        return _Peak(0.0, -1.0, doubt="the velocity of the run is constant")
    # Weight a coordinate by its noise: the variance that the run does not have.
    whole = np.nanvar(measured, axis=0)
    scale = np.sqrt(np.maximum(whole - real.var(axis=0), LEAST_NOISE * whole))
    scale[scale == 0.0] = 1.0
    correlation = _correlations(measured / scale, simulated / scale)
    if not np.isfinite(correlation).any():
        return _Peak(0.0, -1.0, doubt="they have too little in common")
    correlation = np.nan_to_num(correlation, nan=-1.0)
    best = int(np.argmax(correlation))
    # The ends of the peak, beyond which the heights rise again
    rises = np.diff(correlation) > 0
    left, right = np.flatnonzero(~rises[:best]), np.flatnonzero(rises[best:])
    first = int(left[-1]) + 1 if len(left) else 0
    last = best + int(right[0]) if len(right) else len(correlation) - 1
    others = correlation.copy()
    others[first : last + 1] = -1.0
    other, top = int(np.argmax(others)), float(correlation[best])
    offset = float(grid[0]) - begin + step * (best - (len(measured) - 1))
    quality = (1 - float(others[other])) / max(1 - top, 1e-12)
    doubt = ""
    if top < LEAST_CORRELATION:
        doubt = (
            f"the motions correlate by {top:.2f} at most, and {LEAST_CORRELATION:g} is needed; "
            "check the number of the run, the units and the axes of the body"
        )
    elif quality < LEAST_MISFIT_RATIO:
        two = sorted([offset, offset + step * (other - best)])
        doubt = f"offsets of {two[0]:.3g} s and {two[1]:.3g} s fit about equally well"
    return _Peak(offset, top, quality, step * (last - first), doubt)


def _correlations(measured: Array, simulated: Array) -> Array:
    """Return the correlation at every shift over the common instants; NaN if these are too few.

    Shift k maps row i of the recording to sample i + k − (n − 1) of the run. The correlation is 1
    only for equal motions. It is less for motions that are multiples of each other, such as
    different parts of a decay.
    """
    size = len(measured) + len(simulated) - 1
    padded = 1 << size.bit_length()

    def over_shifts(a: Array, b: Array) -> Array:
        product = np.fft.rfft(a, padded, axis=0) * np.conj(np.fft.rfft(b, padded, axis=0))
        return np.roll(np.fft.irfft(product, axis=0), len(measured) - 1, axis=0)[:size]

    def centred(values: Array) -> tuple[Array, Array]:
        real = np.isfinite(values).all(axis=1, keepdims=True)
        return np.where(real, values - np.nanmean(values, axis=0), 0.0), real.astype(float)

    (x, here), (y, there) = centred(measured), centred(simulated)
    count = np.round(over_shifts(there, here))
    enough = count >= max(LEAST_OVERLAP * min(here.sum(), there.sum()), FEWEST / 2)
    sums = over_shifts(there, x), over_shifts(y, here)
    n = np.where(enough, count, 1.0)
    both = over_shifts(y, x) - sums[0] * sums[1] / n
    squares = over_shifts(there, x * x) + over_shifts(y * y, here)
    squares = squares - (sums[0] ** 2 + sums[1] ** 2) / n
    total, squares, enough = both.sum(axis=1), squares.sum(axis=1), enough[:, 0]
    moves = squares > CONSTANT_WITHIN * squares.max()  # below this, only rounding is left
    return np.where(enough & moves, 2 * total / np.where(moves, squares, 1.0), np.nan)


# Refinement of one offset -------------------------------------------------------------------------


class _Model(NamedTuple):
    """A least-squares model of the offset and of constants that an offset does not explain."""

    by: str
    constants: Array
    at: Callable[[float, Array], tuple[Array, Array, Array]]
    """Residuals ``(n, k)``, and how offset ``(n, k)`` and constants ``(n, k, c)`` reduce them."""
    moved: Callable[[Array, Array], Array]
    """Returns the constants after a change."""


def _of_velocities(seen: Recording, measured: list[int], times: Array, run: Pieces) -> _Model:
    """Return the model of body velocities, with a constant bias of each coordinate."""
    from scipy.interpolate import CubicSpline  # slow to import; readers of results do without

    _, V, _ = run.motion(seen.group, times)
    spline = CubicSpline(times, V[:, measured], extrapolate=False)
    rate = spline.derivative()

    def at(offset: float, bias: Array) -> tuple[Array, Array, Array]:
        t = seen.times + offset
        constants = np.broadcast_to(np.eye(len(bias)), (len(t), len(bias), len(bias)))
        return seen.velocities[:, measured] - spline(t) - bias, rate(t), constants

    return _Model("body velocities", np.zeros(len(measured)), at, np.add)


def _of_poses(seen: Recording, times: Array, run: Pieces) -> _Model:
    """Return the model of poses Q, with a constant world frame C such that C Q_s is near Q."""
    G = seen.group

    def at(offset: float, frame: Array) -> tuple[Array, Array, Array]:
        t = seen.times + offset
        inside = (times[0] <= t) & (t <= times[-1]) & ~np.isnan(seen.poses[:, 0, 0])
        Q, V, _ = run.motion(G, t[inside])
        if not frame.any():
            middle = int(inside.sum()) // 2
            frame[...] = seen.poses[inside][middle] @ G.inverse(Q[middle])
        left, rates = np.full((2, len(t), G.dimension), np.nan)
        constants = np.full((len(t), G.dimension, G.dimension), np.nan)
        left[inside] = G.log(G.inverse(frame @ Q) @ seen.poses[inside])
        rates[inside], constants[inside] = V, G.Ad_matrix(G.inverse(Q))
        return left, rates, constants

    return _Model("poses", np.zeros((G.size, G.size)), at, lambda C, c: C @ G.exp(c))


def _refined(model: _Model, peak: _Peak, step: float) -> Alignment:
    """Refine a peak of the correlation by Gauss-Newton least squares."""
    offset, constants = peak.offset, model.constants
    for _ in range(ITERATIONS):
        left, rates, held = model.at(offset, constants)
        real = np.isfinite(left).all(axis=1)
        left, J = left[real], np.concatenate([rates[real, :, None], held[real]], axis=-1)
        noise = np.mean(left**2, axis=0)
        weights = 1 / np.maximum(noise, max(1e-9 * float(noise.max()), 1e-30))
        inverse = np.linalg.pinv(np.einsum("nki,k,nkj->ij", J, weights, J), hermitian=True)
        pushes = np.einsum("nki,k,nk->ni", J, weights, left)
        change = inverse @ pushes.sum(axis=0)
        offset += float(np.clip(change[0], -step, step))
        constants = model.moved(constants, change[1:])
        if abs(change[0]) < CONVERGED * step:
            break
    # Neighbouring errors are correlated, but sums over blocks hardly are. If only a few blocks
    # determine the offset, their deviation is unreliable, and the one of independent errors counts.
    blocks = [block.sum(axis=0) for block in np.array_split(pushes, BLOCKS)]
    together = float(np.linalg.norm([inverse[0] @ block for block in blocks]))
    error = max(together, float(np.sqrt(inverse[0, 0])))
    if abs(offset - peak.offset) > peak.width / 2:
        error = np.inf  # the iteration left the peak
    return Alignment(offset, error, peak.correlation, model.by)


NEEDED = ("pose", "velocity", "torque", "desired_pose", "desired_velocity", "desired_torque")


MOST_ROWS = 20_000
"""Largest number of compared rows; a longer recording is shown."""

VARIES = 0.3
"""Relative variation below which a difference of poses counts as constant."""

SAME_TIME = 1e-9
"""Tolerance for rows at the ends of a run, as a share of its length."""


@dataclass(frozen=True)
class Course:
    """A motion that is cubic on the group between samples, with a linearly interpolated wrench.

    Attributes
    ----------
    group
        G.
    times : (n,)
        Times of the samples, s.
    pose : (n, d, d)
    velocity, wrench : (n, m)
        The samples, in the body frame.
    """

    group: MatrixLieGroup
    times: Array
    pose: Array
    velocity: Array
    wrench: Array

    @cached_property
    def pieces(self) -> Pieces:
        """The motion without the wrench."""
        return through(self.group, self.times, self.pose, self.velocity)

    def at(self, t: Array) -> "Course":
        """Return the motion at times ``(n,)`` within the samples."""
        pose, velocity, _ = self.pieces.motion(self.group, t)
        axes = [np.interp(t, self.times, along) for along in self.wrench.T]
        return Course(self.group, t, pose, velocity, np.stack(axes, axis=-1))


@dataclass(frozen=True)
class Error:
    """Errors of pose, velocity or wrench in the body frame.

    Attributes
    ----------
    quantity
        ``pose``, ``velocity`` or ``wrench``.
    measured, simulated : (n, m)
        Errors of the recording and of the run relative to the reference: log Q_d⁻¹Q, V − V_d,
        τ − τ_d; NaN in coordinates that were not measured.
    difference : (n, m)
        Error of the recording relative to the run.
    """

    quantity: str
    measured: Array
    simulated: Array
    difference: Array

    def unit(self, part: Part) -> str:
        """Return the unit of a part of the coordinates."""
        if self.quantity == "pose":
            return part.error_unit
        return part.velocity_unit if self.quantity == "velocity" else part.force_unit


@dataclass(frozen=True)
class MeasuredRun:
    """A recording aligned with a run of a controller.

    Attributes
    ----------
    label, title, run
        Label and display name of the controller, and number of the run.
    recording
        The rows within the run, at most `MOST_ROWS`, in the time of the run.
    rows
        Number of all rows within the run.
    alignment
        Alignment of the clock.
    simulated, reference
        The run, and its reference.
    """

    label: str
    title: str
    run: int
    recording: Recording
    rows: int
    alignment: Alignment
    simulated: Course
    reference: Course

    @cached_property
    def errors(self) -> list[Error]:
        """Errors of the measured quantities at the times of the recording."""
        G, seen = self.recording.group, self.recording
        run, wanted = self.simulated.at(seen.times), self.reference.at(seen.times)

        def apart(P: Array, Q: Array) -> Array:
            return G.log(G.inverse(Q) @ P)

        return [
            Error(name, less(actual, desired), less(here, desired), less(actual, here))
            for name, less, actual, here, desired in (
                ("pose", apart, seen.poses, run.pose, wanted.pose),
                ("velocity", np.subtract, seen.velocities, run.velocity, wanted.velocity),
                ("wrench", np.subtract, seen.wrenches, run.wrench, wanted.wrench),
            )
            if not np.isnan(actual).all()
        ]

    @property
    def notes(self) -> list[str]:
        """Notes on the rows, the clock, the gaps, and missing measurements."""
        seen, gaps = self.recording, len(self.recording.gaps)
        missing = f", {count_of(gaps, 'gap')}" if gaps else ""
        first, last = (round(t, 6) + 0.0 for t in seen.times[[0, -1]].tolist())
        count = (
            f"{len(seen.times)} of " if self.rows > len(seen.times) else ""
        ) + f"{self.rows} rows"
        notes = [
            f"{seen.name}: {count} from {first:.4g} to {last:.4g} s of run "
            f"{self.run}{missing}; {self.alignment.in_words}"
        ]
        notes += self._world_differences()
        names = recorded_names(seen.group, WRENCH)
        if names and np.isnan(seen.wrenches).all():
            notes.append(f"No wrench was measured; record it in columns {', '.join(names)}")
        return notes

    def _world_differences(self) -> Iterator[str]:
        """Note the parts whose difference from the run is nearly constant and exceeds its error."""
        G, seen, pose = self.recording.group, self.recording, self.errors[0]
        apart = G.log(seen.poses @ G.inverse(self.simulated.at(seen.times).pose))
        for part in G.parts:
            of_part, mean = apart[:, part.axes], apart[:, part.axes].mean(axis=0)
            varies = np.sum((of_part - mean) ** 2) > VARIES**2 * np.sum(of_part**2)
            if varies or _size(pose.difference, part) <= _size(pose.simulated, part):
                continue
            size = float(np.linalg.norm(mean))
            amount = f"{np.degrees(size):.3g} deg" if part.turns else f"{size:.3g} {part.pose_unit}"
            yield (
                f"The {part.name.replace('_', ' ')} of the recording differs from the run's "
                f"by {amount} throughout; check `world` and `attitude` of the mapping, or move its "
                "poses to the world of the reference"
            )


def _size(values: Array, part: Part) -> float:
    return float(np.sum(values[:, part.axes] ** 2))


def _part(recording: Recording, first: int, last: int, step: int) -> Recording:
    """Return every `step`-th row from `first` to before `last`."""
    rows = slice(first, last, step)
    names = "times", "poses", "velocities", "wrenches", "speeds"
    measured = {name: getattr(recording, name)[rows] for name in names}
    gaps = np.unique((recording.gaps - first) // step)
    inside = (gaps >= 0) & (gaps < len(measured["times"]) - 1)
    return replace(recording, **measured, gaps=gaps[inside])


def measured_runs(
    result: Result,
    recording: Recording,
    controllers: Sequence[int],
    run: int,
    who: str = "a comparison with a recording",
) -> list[MeasuredRun]:
    """Align a recording with a run of several controllers.

    The clock of the recording is aligned once, with the controller whose run fits it best.

    Parameters
    ----------
    controllers
        Indices of the controllers; if empty, all whose run did not fail.
    who
        Name of the caller for messages.

    Raises
    ------
    EqtError
        If the result does not hold the run, or the recording cannot be aligned with it.
    """
    result.single(f"{who} needs a single experiment")
    check_stored(result, *NEEDED, who=f"{who} needs")
    G, times = recording.group, result.times
    states = [result.trajectory(name, run) for name in NEEDED[:3]]
    reference = Course(G, times, *(result[name] for name in NEEDED[3:]))
    simulated = {
        int(k): Course(G, times, *(values[k] for values in states))
        for k in np.flatnonzero(result.good[:, run])
    }
    for k in controllers or [k for k in range(len(result.labels)) if not simulated]:
        if k not in simulated:
            raise result.error(f"run {run} of {result.labels[k]} failed; choose another")
    courses = {result.titles[k]: course for k, course in simulated.items()}
    fit = Alignment(0.0) if recording.timed else _best_aligned(recording, courses)
    late = recording.times + fit.offset
    slack = SAME_TIME * (times[-1] - times[0])
    inside = np.flatnonzero((times[0] - slack <= late) & (late <= times[-1] + slack))
    if len(inside) < 2:
        raise InputError(
            f"{recording.name}: expected two rows or more within the run, from {times[0]:.6g} to "
            f"{times[-1]:.6g} s, got {len(inside)}: its times are from {late[0]:.6g} to "
            f"{late[-1]:.6g} s; change time.offset of the mapping, or leave it out"
        )
    first, last = int(inside[0]), int(inside[-1]) + 1
    shown = _part(recording, first, last, -(-(last - first) // MOST_ROWS))
    shown = replace(shown, times=shown.times + fit.offset)
    return [
        MeasuredRun(
            result.labels[k], result.titles[k], run, shown, last - first, fit, course, reference
        )
        for k, course in simulated.items()
        if not controllers or k in controllers
    ]


def _best_aligned(recording: Recording, courses: Mapping[str, Course]) -> Alignment:
    """Return the alignment with the run that correlates best; runs by titles of controllers."""
    alignments, errors = [], []
    for title, course in courses.items():
        try:
            alignment = aligned(recording, course.times, course.pieces)
        except InputError as error:
            errors.append(error)
        else:
            alignments.append(replace(alignment, by=f"{alignment.by} of {title}"))
    if not alignments:
        raise errors[0]
    return max(alignments, key=lambda alignment: alignment.correlation)


ShownIn = Callable[[str, str], tuple[str, float]]
"""The unit in which a quantity is shown, and the factor to it, from its name and its unit."""


@dataclass(frozen=True)
class Share:
    """The share of a measured error that a run explains.

    Attributes
    ----------
    quantity, part, axis, unit
        The quantity (``pose``, ``velocity`` or ``wrench``), the part of the coordinates, the axis
        (empty for all axes of the part), and the unit.
    measured, simulated, difference
        Root mean squares over the rows of the measured error, the simulated error, and their
        difference.
    explained
        1 − difference² / measured²: 1 if the run has the measured error, 0 if the run is as far
        from the recording as the reference is, and negative if it is farther.
    """

    quantity: str
    part: str
    axis: str
    unit: str
    measured: float
    simulated: float
    difference: float
    explained: float


@dataclass(frozen=True)
class Explanation:
    """The shares of the errors of a recording that the run of a controller explains.

    Attributes
    ----------
    controller, title, run
        Label and display name of the controller, and number of the run.
    offset, offset_error
        Clock offset of the recording and its standard error, s; NaN if the offset was given.
    rows
        Number of compared rows.
    shares
        Shares by quantity, part and axis.
    notes
        Notes on the compared rows, on missing measurements, and on the file.
    """

    controller: str
    title: str
    run: int
    offset: float
    offset_error: float
    rows: int
    shares: list[Share]
    notes: list[str]


def explained(measured: MeasuredRun, shown_in: ShownIn) -> Explanation:
    """Compute the shares of the errors of a recording that the run explains, in units of a user."""
    seen, G = measured.recording, measured.recording.group
    return Explanation(
        measured.label,
        measured.title,
        measured.run,
        measured.alignment.offset,
        measured.alignment.error,
        len(seen.times),
        [share for error in measured.errors for share in _shares(G, error, shown_in)],
        [*measured.notes, *(f"{seen.name}: {note}" for note in seen.notes)],
    )


def _shares(G: MatrixLieGroup, error: Error, shown_in: ShownIn) -> Iterator[Share]:
    for part in G.parts:
        axes = list(range(*part.axes.indices(G.dimension)))
        complete = [axis for axis in axes if not np.isnan(error.measured[:, axis]).any()]
        if not complete:
            continue
        chosen = [("", complete)]
        if len(axes) > 1:
            chosen += [(G.axis_names[axis], [axis]) for axis in complete]
        unit, by = shown_in(error.quantity, error.unit(part))
        for name, of in chosen:
            every = error.measured, error.simulated, error.difference
            squares = (np.sum(values[:, of] ** 2, axis=1) for values in every)
            first, second, left = (by * float(np.sqrt(np.mean(square))) for square in squares)
            share = 1 - (left / first) ** 2 if first > 0 else np.nan
            yield Share(error.quantity, part.name, name, unit, first, second, left, share)


@purposes.findings_on_a_recording
def findings(
    explanations: Sequence[Explanation], measured: Path, write: Plain, whole: bool
) -> tuple[dict[str, Any], list[dict[str, Any]], list[TextTable], list[str]]:
    """Return what `eqt compare --measured` prints: a document, rows, tables and remarks.

    Rows of single axes are in the table of one law, and of several if it is `whole`.
    """
    several = len(explanations) > 1
    records: list[dict[str, Any]] = []
    blocks = []
    for law in explanations:
        about = {key: getattr(law, key) for key in ("controller", "run", "rows", "offset")}
        records += [about | asdict(share) for share in law.shares]
        shares = [share for share in law.shares if whole or not several or not share.axis]
        rows = [_row(share, write) for share in shares]
        blocks.append(Block(write.text(law.title) if several else "", rows))
    notes = [
        "Errors relative to the reference, in the body frame: root mean squares over the rows. "
        "Explained: 1 − difference² / measured error². It is 100 % where the run has the measured "
        "error, 0 % where it is as far from the recording as the reference is, and negative where "
        "it is farther.",
        *(f"{note}." for note in explanations[0].notes),
    ]
    whose = "each law" if several else explanations[0].title
    table = TextTable(
        "measured",
        write.text(f"How much of the measured error run {explanations[0].run} of {whose} explains"),
        ["error of", "axis", "unit", "measured", "simulated", "difference", "explained"],
        blocks,
        [write.text(note) for note in notes],
        spare=("simulated",),
        keys=2,
    )
    next_step = "next: --verbose prints every axis, --against LAW one law"
    remarks = [next_step] if several and not whole else []
    document = {"measured": str(measured), "controllers": list(map(asdict, explanations))}
    return document, records, [table], remarks


def _row(share: Share, write: Plain) -> list[str]:
    numbers = (share.measured, share.simulated, share.difference)
    is_explained = share.explained == share.explained
    return [
        write.text(f"{share.quantity}, {share.part.replace('_', ' ')}"),
        write.text(share.axis.lstrip("ωv") if share.axis else "all"),
        write.unit(share.unit),
        *(write.number(brief(number, 3)) for number in numbers),
        write.text(percent(share.explained)) if is_explained else "-",
    ]
