"""Where a law fails: which drawn number, or which start, tells its bad runs from the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eqt_cli.analysis.intervals import holm
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError
from eqt_cli.base.stored import Status
from eqt_cli.components.groups import group_named
from eqt_cli.extensions.failures.drawn import PREFIX, SUFFIX
from eqt_cli.results.result import Result
from eqt_cli.results.summary import compared_first

LEAST = 5
"""Least number of runs that failed, and of others, that are compared."""

WORST = 0.1
"""Share of the runs that are compared with the others where too few fail."""

LEVEL = 0.05
"""Probability of any false finding in one answer."""


ROUNDING = 1e-9
"""Relative difference of numbers that are one and the same, such as the angle of a start."""

NOT_OF_THE_LAW = (Status.BY_ROUNDING, Status.WORKER_LOST)
"""Failures that say nothing about a law: the runs are left out."""


@dataclass(frozen=True)
class Candidate:
    """A number that is known of each run before it begins.

    Attributes
    ----------
    name
        The key of a drawn number, or a number of the start.
    unit
        Its unit; "1" for a pure number.
    values : (runs,)
        Its values.
    """

    name: str
    unit: str
    values: Array

    @property
    def differs(self) -> bool:
        """Whether it differs between runs by more than rounding."""
        return bool(np.ptp(self.values) > ROUNDING * np.abs(self.values).max())

    @property
    def ends(self) -> Array:
        """The distance from its median: large at both ends."""
        return np.abs(self.values - np.median(self.values))


@dataclass(frozen=True)
class BadRuns:
    """The runs of a law that went wrong.

    Attributes
    ----------
    controller
        Index of the law.
    bad, others : (runs,)
        Whether each run went wrong, or did not; neither for runs that rounding decides.
    words
        What went wrong.
    """

    controller: int
    bad: Array
    others: Array
    words: str

    @property
    def counts(self) -> tuple[int, int]:
        """Number of bad runs, and of the others."""
        return int(self.bad.sum()), int(self.others.sum())


@dataclass(frozen=True)
class Cause:
    """How a number differs between bad runs and the others.

    Attributes
    ----------
    candidate
        The number.
    way
        Where the bad runs lie: `high`, `low`, `at both ends` or `in the middle`.
    p_value
        Of the rank test, after Holm.
    share
        Share of pairs of a bad run and another one in which the bad one lies more so; 0.5 for no
        difference.
    cut
        The value, or the distance from the median, that parts bad from other runs best.
    beyond, within : (2,)
        Number of bad runs and of all runs on the side of the bad ones, and on the other.
    """

    candidate: Candidate
    way: str
    p_value: float
    share: float
    cut: float
    beyond: tuple[int, int]
    within: tuple[int, int]

    @property
    def telling(self) -> bool:
        """Whether the test finds a difference."""
        return self.p_value <= LEVEL


def known_before(result: Result) -> list[Candidate]:
    """Return the drawn numbers and the starts of all runs of a single experiment."""
    numbers = [
        Candidate(
            result.long_name(name).removesuffix(SUFFIX), result.units(name) or "1", result[name]
        )
        for name in result.names
        if name.startswith(PREFIX)
    ]
    return [number for number in (*numbers, *_starts(result)) if number.differs]


def _starts(result: Result) -> list[Candidate]:
    """Return sizes and coordinates of the errors of pose and velocity at the start."""
    needed = ("initial_pose", "initial_velocity", "desired_pose", "desired_velocity")
    if not all(map(result.has, needed)):
        return []
    Q, V, Qd, Vd = (result[name] for name in needed)
    G = group_named(result.group_name)
    x = G.log(G.inverse(Qd[0]) @ Q)
    candidates = []
    for part in G.parts:
        several = len(G.parts) > 1 or part.dimension == 1
        of = f"of the {part.name} " if several and part.dimension > 1 else ""
        for what, values, unit in (
            ("pose error", x, part.error_unit),
            ("velocity error", V - Vd[0], part.velocity_unit),
        ):
            there = values[:, part.axes]
            if part.dimension > 1:
                size = np.linalg.norm(there, axis=1)
                candidates.append(Candidate(f"initial {what} {of}".strip(), unit, size))
            names = list(G.axis_names[part.axes])
            candidates += [
                Candidate(f"initial {what} {name}", unit, values)
                for name, values in zip(names, there.T, strict=True)
            ]
    return candidates


def bad_runs(result: Result, controller: int) -> BadRuns:
    """Return the runs of a law that failed or did not settle, or the worst tenth."""
    status, runs = result.status[controller], result.runs
    decided = ~np.isin(status, NOT_OF_THE_LAW)
    bad = decided & (status != Status.OK)
    words = "failed"
    if result.has("settling_time"):
        unsettled = (status == Status.OK) & result.censored("settling_time", controller)
        words = " or ".join(
            word
            for word, any_ in (("failed", bad.any()), ("did not settle", unsettled.any()))
            if any_
        )
        bad = bad | unsettled
    if bad.sum() >= LEAST <= (decided & ~bad).sum():
        return BadRuns(controller, bad, decided & ~bad, words)
    least = min(LEAST, int(decided.sum()) // 2)  # of few runs, to be drawn, which tell nothing
    count = max(least, round(WORST * decided.sum()))
    name = compared_first(result)[0]
    values = np.where(decided, result.metric(name, controller), -np.inf)
    values = np.where(decided & (status != Status.OK), np.inf, values)
    order = np.argsort(-np.nan_to_num(values, nan=np.inf), kind="stable")
    bad = np.zeros(runs, dtype=bool)
    bad[order[:count]] = True
    worst = "tenth" if count > least else f"{count} runs"
    words = f"worst {worst} by {result.quantity(name).plain}"
    return BadRuns(controller, bad, decided & ~bad, words)


def causes(candidates: Sequence[Candidate], laws: Sequence[BadRuns]) -> list[list[Cause]]:
    """Compare bad runs of each law with the others in each number, the most telling first.

    Each number is tested twice, by its value and by its distance from the median, with the
    two-sided rank test of Wilcoxon, Mann and Whitney. The p-values are adjusted after Holm over
    all tests of all laws.
    """
    from scipy.stats import mannwhitneyu  # slow to import

    if not candidates:
        return [[] for _ in laws]
    numbers = [[candidate.values, candidate.ends] for candidate in candidates]
    values = np.array(numbers)  # (numbers, 2, runs)
    of_laws = [mannwhitneyu(values[..., law.bad], values[..., law.others], axis=-1) for law in laws]
    adjusted = holm(np.ravel([test.pvalue for test in of_laws])).reshape(len(laws), -1, 2)
    rows = []
    for law, test, p_values in zip(laws, of_laws, adjusted, strict=True):
        shares = test.statistic / np.prod(law.counts)
        better = p_values.argmin(axis=1)
        law_rows = [
            _finding(candidate, law, int(k), float(p[k]), float(share[k]))
            for candidate, k, p, share in zip(candidates, better, p_values, shares, strict=True)
        ]
        rows.append(sorted(law_rows, key=lambda row: (row.p_value, -abs(row.share - 0.5))))
    return rows


def _finding(
    candidate: Candidate, law: BadRuns, of_ends: int, p_value: float, share: float
) -> Cause:
    values = candidate.ends if of_ends else candidate.values
    sign = 1.0 if share >= 0.5 else -1.0
    if of_ends:
        way = "at both ends" if share >= 0.5 else "in the middle"
    else:
        way = "high" if share >= 0.5 else "low"
    cut = sign * _cut(sign * values[law.bad], sign * values[law.others])
    beyond = sign * values >= sign * cut
    sides = [
        (int((side & law.bad).sum()), int((side & (law.bad | law.others)).sum()))
        for side in (beyond, ~beyond)
    ]
    return Cause(candidate, way, p_value, max(share, 1 - share), float(cut), *sides)


def _cut(bad: Array, others: Array) -> float:
    """Return the value from which on the share of bad runs is most above that of others."""
    cuts = np.unique(bad)
    ahead = np.searchsorted(np.sort(bad), cuts) / len(bad)  # below the cut
    behind = np.searchsorted(np.sort(others), cuts) / len(others)
    return float(cuts[np.argmax(behind - ahead)])


def of_result(result: Result, names: Sequence[str], who: str) -> list[tuple[BadRuns, list[Cause]]]:
    """Return the bad runs of each law, and what tells them from the others.

    Parameters
    ----------
    who
        Who asks, for messages.

    Raises
    ------
    EqtError
        Of a sweep, of an unknown law, or where nothing differs between runs.
    """
    result.single(f"{who} compares the runs of one experiment")
    chosen = [result.position_of(name) for name in names] or range(len(result.labels))
    candidates = known_before(result)
    if not candidates:
        raise EqtError(
            f"{result.path}: {who} compares runs, and all are alike: nothing is drawn, and all "
            "start alike; give a distribution, such as plant.inertia: {relative: {uniform: [-0.2, "
            "0.2]}}"
        )
    laws = [bad_runs(result, controller) for controller in chosen]
    return list(zip(laws, causes(candidates, laws), strict=True))
