"""Judges a task: whether it tells laws apart, copies another task, or tells only of the search."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from eqt_cli.analysis.intervals import Word
from eqt_cli.base.reporting import brief, fixed
from eqt_cli.extensions.search.ratios import paired
from eqt_cli.extensions.suite.archive import Archive
from eqt_cli.extensions.suite.tasks import REFERENCE
from eqt_cli.extensions.suite.verdicts import both_on_samples

RESOLVED = 0.5
"""Least share of pairs of laws of which a task says which is better."""

COPY = 0.9
"""Rank correlation of laws with another task from which a task is a copy of it."""

FEWEST_SHARED = 5
"""Number of laws of two tasks below which their orders are not compared."""


@dataclass(frozen=True)
class Proposal:
    """What a task is good for.

    Attributes
    ----------
    task
        Its name.
    laws
        Number of laws that do not fail on it.
    failing
        Labels of those that do.
    resolved, alike
        Shares of the pairs of laws of which one is better, and that do not differ.
    nearest, correlation
        The task whose order of laws is most alike, and Kendall's rank correlation with it.
    spread, noise
        Standard deviations of the logarithms of errors over laws, and, of one law against the
        reference law, over training samples.
    tuning
        What tuning is worth: the middle ratio of the error at the starting gains.
    """

    task: str
    laws: int
    failing: tuple[str, ...]
    resolved: float
    alike: float
    nearest: str
    correlation: float
    spread: float
    noise: float
    tuning: float

    @property
    def faults(self) -> list[str]:
        """Say why it is no task for a suite; empty if it is one."""
        faults = []
        if self.resolved < RESOLVED:
            faults.append("does not discriminate")
        if self.alike >= RESOLVED:
            faults.append("is saturated: most laws do not differ")
        if self.correlation >= COPY:
            faults.append(f"is redundant: it orders laws as {self.nearest} does")
        if not self.spread > self.noise:
            faults.append("is decided by tuning noise")
        return faults

    def lines(self) -> list[str]:
        """Return the answer and its numbers."""
        verdict = "; ".join(self.faults) or "discriminates, and is no copy of another task"
        lines = [
            f"{self.task} {verdict}.",
            f"resolved   {100 * self.resolved:.0f} % of the pairs of {self.laws} laws; "
            f"{100 * self.alike:.0f} % do not differ",
            f"spread     laws differ by {_percent(self.spread)}, one law by "
            f"{_percent(self.noise)} from training sample to training sample",
            f"tuning     is worth a factor of {brief(self.tuning, 3)} in the middle law",
        ]
        if self.nearest:
            nearest = f"rank correlation {fixed(self.correlation, 2)} with {self.nearest}"
            lines.insert(2, f"nearest    {nearest}")
        if self.failing:
            lines.append(f"failing    {', '.join(self.failing)}")
        return lines

    def record(self) -> dict[str, Any]:
        """Return the numbers for programs."""
        return {**vars(self), "failing": list(self.failing), "faults": self.faults}


def _percent(deviation: float) -> str:
    return f"{100 * deviation:.2g} %" if math.isfinite(deviation) else "-"


def proposal(task: str, of_task: Archive, suite: Archive) -> Proposal:
    """Judge a task by the laws that were judged on it, beside the tasks of a suite."""
    judged = {name: law.tasks[task] for name, law in of_task.laws.items() if task in law.tasks}
    whole = {
        name: judged_law
        for name, judged_law in judged.items()
        if judged_law.is_whole and judged_law.is_finished
    }
    words = [
        paired(*both_on_samples(whole[a], whole[b]), a, b, "", "lower").word
        for a, b in combinations(whole, 2)
    ]
    resolved = [word in (Word.BETTER, Word.WORSE) for word in words]
    alike = [word is Word.ALIKE for word in words]
    means = {name: float(judged_law.errors.mean()) for name, judged_law in whole.items()}
    near = _nearest(task, means, suite)
    noises = []
    if REFERENCE in whole:
        base = whole[REFERENCE].errors.mean(axis=1)
        for name, judged_law in whole.items():
            if name != REFERENCE and len(judged_law.errors) == len(base) > 1:
                noises.append(float(np.std(np.log(judged_law.errors.mean(axis=1) / base), ddof=1)))
    worth = [x.start / float(x.errors.mean()) for x in whole.values() if math.isfinite(x.start)]
    return Proposal(
        task,
        len(whole),
        tuple(name for name in judged if name not in whole),
        float(np.mean(resolved)) if resolved else 0.0,
        float(np.mean(alike)) if alike else 0.0,
        *near,
        float(np.std(np.log(list(means.values())), ddof=1)) if len(means) > 1 else 0.0,
        float(np.median(noises)) if noises else math.nan,
        float(np.median(worth)) if worth else math.nan,
    )


def _nearest(task: str, means: Mapping[str, float], suite: Archive) -> tuple[str, float]:
    """Return the task of the suite with the most similar order of laws, and the correlation."""
    best = "", -1.0
    for other in suite.tasks:
        if other == task:
            continue
        shared = [
            name
            for name in means
            if name in suite.laws
            and other in suite.laws[name].tasks
            and suite.laws[name].tasks[other].is_whole
        ]
        if len(shared) >= FEWEST_SHARED:
            theirs = [float(suite.laws[name].tasks[other].errors.mean()) for name in shared]
            correlation = kendall([means[name] for name in shared], theirs)
            best = max(best, (other, correlation), key=lambda pair: pair[1])
    return best


def kendall(first: list[float], second: list[float]) -> float:
    """Return Kendall's rank correlation of numbers without ties."""
    pairs = combinations(range(len(first)), 2)
    signs = [np.sign((first[a] - first[b]) * (second[a] - second[b])) for a, b in pairs]
    return float(np.mean(signs))
