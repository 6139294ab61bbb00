"""Checks solutions against the theorems: energy, decrease of L, convergence, tracking.

Whether errors tend to 0 is judged from samples on a finite horizon.
"""

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from eqt_cli.analysis.certificates.base import Row, TrajectoryCheck, Verdict, joined
from eqt_cli.analysis.evidence.runs import ENERGY_PER_RTOL, STATES_PER_RTOL, Runs, largest
from eqt_cli.core.arrays import Array
from eqt_cli.results.metrics import ENERGY_SCALE

# These values were chosen on 2120 errors of 10 shipped experiments, with 20 runs per law, that were
# integrated over four times their horizon. "The bounds of convergence" in the documentation
# describes the effect of other values.

LEFT = 0.05
"""Largest final error of a settled run as a share of its largest error: 5 %, as for settling."""

DECAYING = 0.9
"""An error has settled only if the ratio of its means over the last two quarters of the horizon is
at most this. It then halves within 1.6 horizons, or approaches an offset."""

STALLED = 0.98
"""Ratio of the same means at or above which an error does not decay: halving would take more than 8
horizons. For L, which is quadratic in the error, the square of this ratio counts. Any value from
0.9 to 0.999 gives the same verdicts."""

STEADY = 0.2
"""Largest variation of a steady error over the last half of the horizon, relative to its mean. Slow
oscillations, whose means can stall for a while, vary more. Up to 0.4, no error that was judged
steady decayed later; at 0.1 and below, no real offset was found."""

SMALLEST_SCALE = 1e-6
"""Least scale of the motion; without any motion, errors are rounding."""


@dataclass(frozen=True)
class Approach:
    """The final behaviour of the error of every run.

    Attributes
    ----------
    left : (runs,)
        Final error as a share of the largest error of the run.
    level : (runs,)
        Mean error over the last quarter of the horizon.
    arrived : (runs,)
        Whether the error is within the solver's error, or at most `LEFT` remains and it still
        decays.
    stays : (runs,)
        Whether the error is an offset: above the solver's error and steady, while neither it nor L
        decays.
    """

    left: Array
    level: Array
    arrived: Array
    stays: Array

    @property
    def offsets(self) -> str:
        """Description of the offsets; empty if there are none."""
        if not self.stays.any():
            return ""
        typical = np.median(self.level[self.stays])
        return f"an error of {typical:.2g} stays in {self.stays.sum()} of {len(self.stays)} runs"


def approach(
    times: Array, errors: Array, rtol: float, size: float, lyapunov: Array | None = None
) -> Approach:
    """Judge the errors ``(runs, samples)`` of a motion with a given size, such as max ‖V_d‖.

    The solver's error is relative to the larger of that size and the largest error of the run.
    While L of a run still falls, its error is no offset: one error can stall while another decays.
    """
    duration = times[-1] - times[0]
    late = times >= times[-1] - duration / 4
    before = ~late & (times >= times[-1] - duration / 2)
    if not before.any():
        before = ~late
    level, largest = errors[:, late].mean(axis=1), errors.max(axis=1)
    solved = level <= STATES_PER_RTOL * rtol * np.maximum(largest, max(size, SMALLEST_SCALE))
    rest = _rest(errors, before, late)
    left = errors[:, -1] / np.where(largest > 0, largest, 1.0)
    arrived = solved | ((rest <= DECAYING) & (left <= LEFT))
    steady = np.ptp(errors[:, late | before], axis=1) <= STEADY * level
    stays = ~solved & (rest >= STALLED) & steady
    if lyapunov is not None:
        stays &= ~(_rest(lyapunov, before, late) < STALLED**2)
    return Approach(left, level, arrived, stays)


def _rest(values: Array, before: Array, late: Array) -> Array:
    """Return the ratio of the mean over the later samples to that over the earlier ones."""
    earlier = np.maximum(values[:, before].mean(axis=1), np.finfo(float).tiny)
    return values[:, late].mean(axis=1) / earlier


FIFTHS = 5
"""Number of parts of the horizon, of which the first, the middle and the last are compared."""


@dataclass(frozen=True)
class Fifths:
    """Root mean squares of a signal over three fifths of the horizon, ``(runs,)`` each.

    Attributes
    ----------
    first, middle, last
        Values over the first, the middle and the last fifth.
    """

    first: Array
    middle: Array
    last: Array

    @classmethod
    def of(cls, times: Array, values: Array) -> "Fifths | None":
        """Compute them from a signal ``(runs, samples)``; None if a fifth has no sample."""
        part = (times - times[0]) / (times[-1] - times[0]) * FIFTHS
        inside = [
            (part >= k - _SLACK) & (part <= k + 1 + _SLACK) for k in (0, FIFTHS // 2, FIFTHS - 1)
        ]
        if not all(here.any() for here in inside):
            return None
        return cls(*(np.sqrt((values[:, here] ** 2).mean(axis=1)) for here in inside))

    @property
    def left(self) -> float:
        """Median over runs of the ratio of the last to the first."""
        return _median_ratio(self.last, self.first)

    def still_falls(self) -> bool:
        """Whether the last is less than the middle, in the median over runs."""
        return _median_ratio(self.last, self.middle) < STALLED


_SLACK = 1e-9
"""Tolerance for samples at the ends of a fifth, as a share of a fifth."""


def _median_ratio(one: Array, other: Array) -> float:
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(one == 0, 0.0, one / other)
    return float(np.median(ratio))


NOT_STORED = "the result holds no trajectories"

GROWTH = 0.01
"""Relative growth of L over the second half of the horizon that contradicts convergence."""


TRACKED = 0.5
"""Largest ratio of the error over the last fifth to that over the first fifth. In the shipped
configurations it is at most 0.16, except for a slow sliding mode (0.71) and for forces unknown to
the laws (0.58)."""

SPAN = 1 - 1 / FIFTHS
"""Time from the first fifth of the horizon to the last, as a share of the horizon."""

GROWN = 1.0
"""The same with unknown forces, noise or limits, which can keep any error from decaying."""


class LyapunovCheck(TrajectoryCheck):
    """A statement about a law's own L, with the reference of the law's source."""

    statement: ClassVar[str] = "Theorems 3.2, 6.2"

    def check(self, runs: Runs) -> Row:
        """Judge the runs, and add the function L and its theorem."""
        row = self.judge(runs)
        remark = joined(row.remark, runs.own_function)
        return replace(row, statement=runs.theorem or row.statement, remark=remark)

    @abstractmethod
    def judge(self, runs: Runs) -> Row:
        """Judge the runs."""


class GroupDrift(TrajectoryCheck):
    """Q(t) ∈ G: no integrator of eqt projects, so the drift shows the integrator's error."""

    name: ClassVar[str] = "poses stay in the group"
    statement: ClassVar[str] = "eq. (5)"
    section: ClassVar[float] = 3.0

    def check(self, runs: Runs) -> Row:
        """The largest distance from the group over runs and samples."""
        if not runs.count:
            return self.undecided(runs)
        bound = STATES_PER_RTOL * runs.rtol
        return self.compared(largest(runs.group_drift), bound, runs.remark, runs.label)


class EnergyBalance(LyapunovCheck):
    """L(t) + ∫(dissipation − ⟨δ, y⟩) = L(0) at every sample, relative to max(L(0), 1 J).

    δ is the force unknown to the law: effects of actuators, forces and a different inertia.
    """

    name: ClassVar[str] = "energy balance"
    section: ClassVar[float] = 6.3

    def judge(self, runs: Runs) -> Row:
        """The largest residual of the runs."""
        if not runs.count:
            return self.undecided(runs)
        if np.isnan(runs.energy_residual).all():
            remark = "the law does not say what it dissipates"
            return self.row(Verdict.UNCLAIMED, remark=remark, controller=runs.label)
        bound = ENERGY_PER_RTOL * runs.rtol
        return self.compared(largest(runs.energy_residual), bound, runs.remark, runs.label)


class LyapunovDecrease(LyapunovCheck):
    """The largest rise of L between samples, relative to max(L(0), 1 J)."""

    name: ClassVar[str] = "decrease of L"
    section: ClassVar[float] = 6.31

    def judge(self, runs: Runs) -> Row:
        """Judge the largest rise, which only the integrator's error may cause."""
        label, L = runs.label, runs.lyapunov
        if L is None or not len(L):
            return self.undecided(runs, "" if L is not None else NOT_STORED)
        rises = np.diff(L, axis=1).max(axis=1) / np.maximum(L[:, 0], ENERGY_SCALE)
        measured, bound = max(largest(rises), 0.0), ENERGY_PER_RTOL * runs.rtol
        if runs.departures:
            return self.row(Verdict.NOT_COVERED, measured, bound, runs.departures, label)
        if runs.claims_decrease:
            return self.compared(measured, bound, runs.remark, label)
        known = runs.claims_decrease is not None
        remark = "not claimed of this law" if known else "the law says nothing"
        return self.row(Verdict.UNCLAIMED, measured, bound, remark, label)


class Convergence(LyapunovCheck):
    """An error tends to 0: it has decayed at the horizon, still decays, or is an offset.

    A finite horizon cannot refute a limit; only a growing L does.
    """

    def arrived(
        self, runs: Runs, final: Array, near: Array, left: Approach | None, bound: float | None
    ) -> Row:
        """Count the runs that have not settled, and report the decay rate of L and offsets.

        Parameters
        ----------
        final
            The measured value of every run.
        near
            Whether each run is within the bound.
        found
            Final behaviour of the errors of the runs with stored trajectories.
        bound
            Bound of the measured value; None if it has no scale.
        """
        label = runs.label
        if not len(final):
            return self.undecided(runs)
        arrived = near.copy()
        if left is not None:
            arrived[: len(left.arrived)] &= left.arrived
        late = int(np.count_nonzero(~arrived))
        rate, span = runs.decay_rate(), float(runs.times[-1] - runs.times[0])
        claimed = runs.claims_decrease and np.isfinite(rate)
        remark = joined(
            f"{late} of {len(final)} runs not converged at {runs.times[-1]:g} s" if late else "",
            left.offsets if left else NOT_STORED,
            f"L decays at {rate:.2g} 1/s (median)" if claimed else "",
            runs.remark,
        )
        if runs.departures:
            verdict, remark = Verdict.NOT_COVERED, joined(runs.departures, remark)
        elif not late and left is not None:
            verdict = Verdict.HOLDS
        elif not runs.claims_decrease:
            verdict = Verdict.UNCLAIMED
        else:
            verdict = Verdict.FAILS if rate * span / 2 < -GROWTH else Verdict.UNDECIDED
        return self.row(verdict, largest(final), bound, remark, label)


class PoseConvergence(Convergence):
    """‖I − Q_E‖_F at the horizon: below the settling threshold, and a small share is left."""

    name: ClassVar[str] = "Q → Q_d"
    section: ClassVar[float] = 6.32

    def judge(self, runs: Runs) -> Row:
        """The final pose errors."""
        final, errors, bound = runs.final_pose_error, runs.pose_error, runs.threshold
        L = runs.lyapunov
        left = None if errors is None else approach(runs.times, errors, runs.rtol, 1.0, L)
        if runs.settled is not None:
            return self.arrived(runs, final, runs.settled, left, None)
        return self.arrived(runs, final, final <= bound, left, bound)


class MomentumConvergence(Convergence):
    """‖V − V_d‖ at the horizon relative to its largest value in the run.

    It vanishes with P − P_d = 𝕀(V − V_d), and the ratio does not depend on units.
    """

    name: ClassVar[str] = "P → P_d"
    section: ClassVar[float] = 6.33

    def judge(self, runs: Runs) -> Row:
        """The velocity errors."""
        final, errors = runs.final_velocity_error, runs.velocity_error
        if errors is None:
            return self.arrived(runs, final, np.isfinite(final), None, None)
        left = approach(runs.times, errors, runs.rtol, runs.desired_speed, runs.lyapunov)
        return self.arrived(runs, left.left, left.arrived, left, LEFT)


class Tracks(TrajectoryCheck):
    """The errors of pose and velocity over the last fifth of the horizon, relative to the first.

    The median over runs counts. This needs no theorem and no claim, so every law is checked.
    """

    name: ClassVar[str] = "tracks"
    statement: ClassVar[str] = "measured on the runs"
    section: ClassVar[float] = 6.34

    def check(self, runs: Runs) -> Row:
        """Judge the worse of the two errors."""
        given = (
            ("pose", runs.pose_error, runs.threshold),
            ("velocity", runs.velocity_error, LEFT * runs.desired_speed),
        )
        endings: dict[str, tuple[float, Verdict, str]] = {}
        for name, errors, near in given:
            if errors is None or not len(errors):
                return self.undecided(runs, "" if errors is not None else NOT_STORED)
            fifths = Fifths.of(runs.times, errors)
            if fifths is None:
                return self.undecided(runs, f"{len(runs.times)} samples are too few")
            endings[name] = fifths.left, *self._ending(runs, errors, near, fifths)
        left, worst, _ = max(endings.values(), key=lambda each: (_WORSE.index(each[1]), each[0]))
        both = ", ".join(f"{name} {ratio:.2g}" for name, (ratio, *_) in endings.items())
        doubts = dict.fromkeys(why for _, verdict, why in endings.values() if verdict is worst)
        remark = joined(both, *doubts, runs.remark)
        bound = GROWN if runs.departures else TRACKED
        return self.row(worst, left, bound, remark, runs.label)

    def _ending(
        self, runs: Runs, errors: Array, near: float, fifths: Fifths
    ) -> tuple[Verdict, str]:
        """Judge an error, with the reason; values below `near` count as none."""
        left, closing = fifths.left, float(np.median(fifths.last))
        size = max(float(np.median(errors.max(axis=1))), runs.desired_speed, SMALLEST_SCALE)
        near = max(near, STATES_PER_RTOL * runs.rtol * size)
        if left < TRACKED or closing < near:
            return Verdict.HOLDS, ""
        if fifths.still_falls() or _falls(runs):
            return Verdict.UNDECIDED, "the error still falls"
        if runs.rate is not None and runs.rate * SPAN * (runs.times[-1] - runs.times[0]) < -np.log(
            TRACKED
        ):
            words = f"small errors decay at {runs.rate:.2g} 1/s, too slowly for this horizon"
            return Verdict.UNDECIDED, words
        if _start_on_reference(runs):
            return Verdict.UNDECIDED, "the runs begin on the reference"
        if runs.departures and (left <= GROWN or not _has_grown(runs)):
            return Verdict.UNDECIDED, runs.departures
        if runs.claims_decrease and not _has_grown(runs):
            return Verdict.UNDECIDED, "L has not grown"
        return Verdict.FAILS, "the error no longer falls"


_WORSE = (Verdict.HOLDS, Verdict.UNDECIDED, Verdict.FAILS)


def _falls(runs: Runs) -> bool:
    """Whether L still falls: an error may then stall, or grow on a short horizon."""
    fifths = _root_of_L(runs)
    return fifths is not None and fifths.still_falls()


def _has_grown(runs: Runs) -> bool:
    """Whether L is larger at the end than at the start, or unknown.

    Runs that start at rest near an unstable equilibrium need time: their velocity error grows at
    first, while L stays nearly constant.
    """
    fifths = _root_of_L(runs)
    return fifths is None or fifths.left > 1 + ENERGY_PER_RTOL * runs.rtol


def _root_of_L(runs: Runs) -> Fifths | None:
    """Return the means of √L, which scales like the errors; None without L."""
    L = runs.lyapunov
    return None if L is None or not len(L) else Fifths.of(runs.times, np.sqrt(np.abs(L)))


def _start_on_reference(runs: Runs) -> bool:
    """Whether both errors are small at the start."""
    pose, velocity = runs.pose_error, runs.velocity_error
    assert pose is not None and velocity is not None
    small = LEFT * max(runs.desired_speed, SMALLEST_SCALE)
    near = np.median(pose[:, 0]) <= runs.threshold and np.median(velocity[:, 0]) <= small
    return bool(near)
