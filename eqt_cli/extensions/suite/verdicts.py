"""What the suite says of laws: ratios to the reference law by task, and over all tasks.

The ratio of a task is that of two tuned laws, with the interval of `eqt tune`. Over tasks it is the
geometric mean, whose interval is over training samples and held-out runs; the tasks are fixed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eqt_cli.analysis.intervals import UNKNOWN, Interval, Word
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import Problems
from eqt_cli.extensions.search.exchanges import NOT_FINISHED
from eqt_cli.extensions.search.law_search import range_of
from eqt_cli.extensions.search.ratios import AT_AN_END, Ratio, joined_over, logs_of, paired
from eqt_cli.extensions.suite.archive import Archive, JudgedLaw
from eqt_cli.extensions.suite.entrants import parsed, shipped_laws
from eqt_cli.extensions.suite.judging import Judged
from eqt_cli.extensions.suite.tasks import REFERENCE, Task

FAILS = "fails"
"""Verdict on a law that fails in a held-out run, or that has no gains that spend so little."""

VERDICTS = (
    *(str(Word.BETTER), str(Word.ALIKE), str(Word.UNDECIDED), str(Word.WORSE)),
    *(NOT_FINISHED, FAILS),
)
"""All verdicts on a law on a task."""

EQUAL = 0.05
"""Difference of what a law spends on held-out runs from what the reference law does, as a share,
that is told: it holds for 15 of 63 laws on tasks of the archive. The bound is no measure, since the
held-out runs are others than those of the search: one and the same law spends 15 % less to 4 % more
on them in the mean over the training samples, and 31 % less to 13 % more on one sample."""

MOST_SPENT = 1.15
"""Share of what all may spend above which a law does not compare with them: a search may go 10 %
above it, and held-out runs cost laws of the archive up to 4 % more than those of the search, in the
mean over the training samples. The largest share in the archive is 1.03."""


@dataclass(frozen=True)
class TaskVerdict:
    """A law against the reference law on one task.

    Attributes
    ----------
    law, task
        Their names.
    ratio
        Ratio of the means of the errors; None where the law fails.
    spent
        What the law spends on the held-out runs, as a share of what it may.
    tuning
        Mean error at the starting gains, in that at the found ones.
    """

    law: str
    task: str
    judged: Judged
    ratio: Ratio | None
    spent: float
    tuning: float

    @property
    def verdict(self) -> str:
        """One of `VERDICTS`."""
        return FAILS if self.ratio is None else self.ratio.verdict

    @property
    def failure(self) -> str:
        """Say what failed; empty if nothing did."""
        judged = self.judged
        lacking = len(judged.values) - int(judged.with_gains.sum())
        if lacking:
            return f"no gains on {lacking} of {len(judged.values)} samples"
        if judged.failed:
            return f"failed {judged.failed}/{judged.runs}"
        return f"spends {self.spent:.2f} of the effort" if self.spent > MOST_SPENT else ""

    def record(self) -> dict[str, Any]:
        """Return the verdict for programs."""
        ratio = self.ratio
        numbers = {
            "ratio": ratio.value if ratio else math.nan,
            "low": ratio.low if ratio else math.nan,
            "high": ratio.high if ratio else math.nan,
            "median_run": ratio.median if ratio else math.nan,
            "better_in": ratio.ahead if ratio else math.nan,
        }
        return {
            "law": self.law,
            "task": self.task,
            "verdict": self.verdict,
            **numbers,
            "failed": self.judged.failed,
            "runs": self.judged.runs,
            "samples": len(self.judged.values),
            "effort": self.spent,
            "last_gain": float(np.max(self.judged.gained, initial=0.0)),
            "tuning": self.tuning,
            "stated_gains": self.judged.is_stated,
        }


@dataclass(frozen=True)
class Overall:
    """A law over a whole set of tasks.

    Attributes
    ----------
    law, tasks
        The law, and the set: ``all``, ``attitude`` or ``pose``.
    count
        Number of tasks in the set.
    ratio
        Geometric mean of the ratios, with its interval; unknown where the law fails in a task.
    least, largest
        The ratios of single tasks.
    verdicts
        How often there is each of `VERDICTS`.
    without
        The least and the largest geometric mean where one of the tasks is left out.
    """

    law: str
    tasks: str
    count: int
    ratio: Interval
    least: float
    largest: float
    verdicts: dict[str, int]
    without: tuple[float, float] = (math.nan, math.nan)

    def record(self) -> dict[str, Any]:
        """Return the numbers for programs."""
        ends = {"geometric_mean": self.ratio.value, "low": self.ratio.low, "high": self.ratio.high}
        spread = {"least": self.least, "largest": self.largest}
        spread |= dict(zip(("without_least", "without_largest"), self.without, strict=True))
        counts = {f"share_{word.replace(' ', '_')}": n for word, n in self.verdicts.items()}
        return {"law": self.law, "tasks": self.tasks, "count": self.count, **ends, **spread} | {
            name: number / self.count for name, number in counts.items()
        }


def verdict(law: JudgedLaw, reference: JudgedLaw, task: Task) -> TaskVerdict:
    """Judge a law on a task, on which both were judged."""
    one, other = law.tasks[task.name], reference.tasks[task.name]
    _, bound = task.cost
    spent = float(np.nanmean(one.spent)) / bound if np.isfinite(one.spent).any() else math.nan
    ratio = None
    if one.is_whole and spent <= MOST_SPENT:
        a, b = both_on_samples(one, other)
        ratio = paired(a, b, law.label, reference.label, task.section.objective, "lower")
        open_ones = [x.label for x in (law, reference) if not x.tasks[task.name].is_finished]
        ratio = replace(ratio, unfinished=tuple(open_ones))
    mean = float(np.nanmean(one.errors)) if one.runs > one.failed else math.nan
    return TaskVerdict(law.label, task.name, one, ratio, spent, one.start / mean)


def both_on_samples(one: Judged, other: Judged) -> tuple[Array, Array]:
    """Return the errors of two laws on the same samples, ``(samples, runs)``.

    A law with stated gains has the same ones on all samples.
    """
    samples = max(len(one.errors), len(other.errors))
    a, b = (
        np.broadcast_to(judgement.errors, (samples, judgement.errors.shape[1]))
        for judgement in (one, other)
    )
    return a, b


def verdicts(archive: Archive, tasks: Mapping[str, Task]) -> list[TaskVerdict]:
    """Judge all laws on all tasks on which they were judged, task by task."""
    reference = archive.laws.get(REFERENCE)
    if reference is None:
        return []
    return [
        verdict(law, reference, task)
        for task in tasks.values()
        if task.name in reference.tasks
        for law in archive.laws.values()
        if task.name in law.tasks
    ]


def sets_of(tasks: Mapping[str, Task]) -> dict[str, list[str]]:
    """Return the sets of tasks over which laws are judged: all, and those for one kind of law."""
    kinds = dict.fromkeys(task.section.laws for task in tasks.values())
    sets = {"all": list(tasks)}
    if len(kinds) > 1:
        for kind in kinds:
            sets[kind] = [name for name, task in tasks.items() if task.section.laws == kind]
    return sets


def overall(
    of_tasks: Sequence[TaskVerdict], archive: Archive, tasks: Mapping[str, Task]
) -> list[Overall]:
    """Judge all laws over the whole sets of tasks; a law without one of the tasks has no row."""
    rows = []
    for name, members in sets_of(tasks).items():
        for law in archive.laws.values():
            of_law = [
                judgement
                for judgement in of_tasks
                if judgement.law == law.label and judgement.task in members
            ]
            if len(of_law) == len(members):
                rows.append(_overall(law, archive.laws[REFERENCE], name, of_law))
    return rows


def _overall(
    law: JudgedLaw, reference: JudgedLaw, name: str, of_law: Sequence[TaskVerdict]
) -> Overall:
    counts = {word: sum(judgement.verdict == word for judgement in of_law) for word in VERDICTS}
    values = [judgement.ratio.value for judgement in of_law if judgement.ratio is not None]
    mean = UNKNOWN
    finished = all(not x.ratio.unfinished for x in of_law if x.ratio is not None)
    if len(values) == len(of_law) and finished:
        parts = [
            logs_of(*both_on_samples(law.tasks[judgement.task], reference.tasks[judgement.task]))
            for judgement in of_law
        ]
        mean = Interval(*(math.exp(x) for x in joined_over(parts, 0.95)))
    ends = (min(values), max(values)) if values else (math.nan, math.nan)
    without = (math.nan, math.nan)
    if mean is not UNKNOWN and len(values) > 1:
        logs = np.log(values)
        means = np.exp((logs.sum() - logs) / (len(logs) - 1))
        without = float(means.min()), float(means.max())
    return Overall(law.label, name, len(of_law), mean, *ends, counts, without)


def at_ends(law: JudgedLaw, task: Task) -> list[str]:
    """Return the numbers of a shipped law whose best values are at an end of their ranges."""
    shipped = shipped_laws().get(law.label)
    if shipped is None or shipped.digest != law.digest:
        return []
    ends, judged = [], law.tasks[task.name]
    for key, written in shipped.over(task).items():
        axis = range_of(parsed(written), Problems())
        # A pack may hold other keys, or lists.
        best = [v[key] for v in judged.values if v and isinstance(v.get(key), float)]
        if axis is None or axis.times:
            continue
        at = [
            f"{end:g}"
            for end in (axis.low, axis.high)
            if any(abs(value - end) <= AT_AN_END * end for value in best)
        ]
        ends += [f"{key.rpartition('.')[2]} {end}" for end in at]
    return ends
