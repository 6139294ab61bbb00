"""The check of a file of judged laws: runs computed again, and a judgement on fresh runs.

A file is data, and what it holds of a law's source is only text. A law of a user is run only from a
file that the user of the check names, after a comparison of its hash.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from typing import Any

import numpy as np

from eqt_cli.analysis.intervals import NEGLIGIBLE, Interval
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError
from eqt_cli.extensions.search.ratios import joined_over, logs_of
from eqt_cli.extensions.suite.archive import Archive, JudgedLaw
from eqt_cli.extensions.suite.entrants import Law
from eqt_cli.extensions.suite.judging import Judged, Values, held_out
from eqt_cli.extensions.suite.tasks import Task, digest_of, with_judge
from eqt_cli.extensions.suite.verdicts import both_on_samples

CONFIDENCE = 0.95
"""That no task of a law that was not fitted to the public runs is called optimistic."""

SPENT = 1e-9
"""Relative difference of the mean cost above which it is another one; errors must be equal."""

MORE_SPENT = 1.2
"""What a law may spend on fresh runs, as a multiple of what the file states, over the same of the
reference law. That is 0.93 to 1.09 for 63 laws on tasks of the archive at three seeds each; the
limit leaves twice the largest excess. Runs that are not drawn could state any cost."""


@dataclass(frozen=True)
class Recomputed:
    """Held-out runs that were computed again.

    Attributes
    ----------
    law, task, sample
        Whose they are, at the gains of which training sample; counted from 1.
    runs, differing
        How many, and how many are not equal to the bit.
    largest
        Largest relative difference; infinite where a run fails in one of them only.
    """

    law: str
    task: str
    sample: int
    runs: int
    differing: int
    largest: float


@dataclass(frozen=True)
class Optimism:
    """What a law's ratio to the reference law gains on the public runs against fresh ones.

    Attributes
    ----------
    law, task
        Whose it is; all tasks together have the task "".
    public, fresh
        The ratios on both.
    factor
        The fresh one over the public one, with its interval over the runs of both.
    failed
        Number of fresh runs that failed.
    spent
        What the law spends on the fresh runs, as a multiple of what the file states, over the same
        of the reference law, since all runs of a seed can cost more; 1 for all tasks together.
    """

    law: str
    task: str
    public: float
    fresh: float
    factor: Interval
    failed: int = 0
    spent: float = 1.0

    @property
    def spends_more(self) -> bool:
        """Whether the law spends more on fresh runs than the file states."""
        return not self.spent <= MORE_SPENT  # nor what is no number

    @property
    def is_optimistic(self) -> bool:
        """Whether the fresh ratio is worse by more than `NEGLIGIBLE`, beyond doubt, or dearer."""
        return self.failed > 0 or self.spends_more or self.factor.low > 1 + NEGLIGIBLE


def fresh_seed(law: JudgedLaw, tasks: Mapping[str, Task]) -> int:
    """Return the seed of the fresh runs, drawn from the hash of law, gains and tasks.

    Who has chosen law and gains cannot choose it, and one more try of them has another one.
    """
    gains = {name: judged.values for name, judged in sorted(law.tasks.items())}
    text = json.dumps([law.digest, gains, digest_of(dict(tasks))], sort_keys=True)
    return int(sha256(text.encode()).hexdigest()[:15], 16)


def drawn_samples(law: JudgedLaw, names: Sequence[str], share: float) -> list[tuple[str, int]]:
    """Return tasks and samples to compute again; the hash of the numbers draws them."""
    numbers = sha256()
    for name in names:
        numbers.update(law.tasks[name].errors.astype("<f4").tobytes())
    there = [
        (name, sample)
        for name in names
        for sample, values in enumerate(law.tasks[name].values)
        if values is not None
    ]

    def rank(pair: tuple[str, int]) -> str:
        return sha256(f"{numbers.hexdigest()} {pair[0]} {pair[1]}".encode()).hexdigest()

    return sorted(sorted(there, key=rank)[: math.ceil(share * len(there))])


def recomputed(
    law: Law, judged: JudgedLaw, task: Task, samples: Sequence[int], workers: int
) -> list[Recomputed]:
    """Compute the held-out runs of a law at some of its gains again, and compare."""
    of_task = judged.tasks[task.name]
    points = [values for sample in samples if (values := of_task.values[sample]) is not None]
    errors, spent = held_out(law.in_task(task), task, points, workers)
    return [
        _compared(judged.label, task.name, sample, of_task, errors[row], float(spent[row]))
        for row, sample in enumerate(samples)
    ]


def _compared(
    law: str, task: str, sample: int, of_task: Judged, errors: Array, spent: float
) -> Recomputed:
    stored, runs = of_task.errors[sample], len(errors)
    if len(stored) != runs:
        return Recomputed(law, task, sample + 1, runs, runs, math.inf)
    differs = ~((stored == errors) | (np.isnan(stored) & np.isnan(errors)))
    with np.errstate(invalid="ignore"):
        size = np.abs(errors - stored) / np.maximum(np.abs(errors), np.abs(stored))
    largest = float(np.where(np.isnan(size), np.inf, size)[differs].max(initial=0.0))
    other = abs(spent / float(of_task.spent[sample]) - 1)
    if not other <= SPENT and np.isfinite(spent):
        differs, largest = np.ones(runs, bool), max(largest, other)
    return Recomputed(law, task, sample + 1, runs, int(differs.sum()), largest)


def optimism(
    laws: tuple[Law, Law],
    judged: tuple[JudgedLaw, JudgedLaw],
    tasks: Mapping[str, Task],
    workers: int,
) -> list[Optimism]:
    """Judge a law and the reference law on fresh runs, and compare with the public ones.

    The interval of each is so wide that it holds for all tasks together.
    """
    seed, rows = fresh_seed(judged[0], tasks), list[Optimism]()
    confidence = 1 - (1 - CONFIDENCE) / (len(tasks) + 1)
    parts = list[tuple[tuple[Array, Array], tuple[Array, Array]]]()
    for name, task in tasks.items():
        public = (judged[0].tasks[name], judged[1].tasks[name])
        if not (public[0].is_whole and public[1].is_whole):
            continue
        renewed = with_judge(task, seed)
        errors, costs = list[Array](), list[Array]()
        for law, of_law in zip(laws, public, strict=True):
            points: list[Values] = [dict(values) for values in of_law.values if values is not None]
            of_errors, of_costs = held_out(law.in_task(task), renewed, points, workers)
            errors.append(of_errors)
            costs.append(of_costs)
        times, of_reference = (
            _times(float(np.mean(cost)), float(np.mean(one.spent)))
            for cost, one in zip(costs, public, strict=True)
        )
        spent = _times(times, of_reference)
        failed = int(np.isnan(errors[0]).sum())
        good: Array = np.isfinite(np.concatenate(errors)).all(axis=0)
        a, b = errors[0][:, good], errors[1][:, good]
        samples = max(len(a), len(b))
        a, b = (np.broadcast_to(numbers, (samples, int(good.sum()))) for numbers in (a, b))
        parts.append((logs_of(a, b), logs_of(*both_on_samples(*public))))
        rows.append(_optimism(judged[0].label, name, parts[-1:], confidence, failed, spent))
    if len(parts) > 1:
        rows.append(_optimism(judged[0].label, "", parts, confidence))
    return rows


def _times(fresh: float, stated: float) -> float:
    """Return a cost as a multiple of a stated one, which may be 0, or missing in a file."""
    if fresh == stated:
        return 1.0
    return fresh / stated if stated > 0 else math.inf


def _optimism(
    law: str,
    task: str,
    parts: Sequence[tuple[tuple[Array, Array], tuple[Array, Array]]],
    confidence: float,
    failed: int = 0,
    spent: float = 1.0,
) -> Optimism:
    """Return the optimism on a task, or over several.

    Gains are the same on both, so only the runs count. Twice the mean of what fresh runs say and
    of minus what public ones say is their difference.
    """
    fresh = float(np.mean([logs.mean() for (logs, _), _ in parts]))
    public = float(np.mean([logs.mean() for _, (logs, _) in parts]))
    terms = []
    for (of_fresh, fresh_runs), (of_public, public_runs) in parts:
        terms += [(np.array([of_fresh.mean()]), fresh_runs)]
        terms += [(np.array([-of_public.mean()]), public_runs)]
    half = joined_over(terms, confidence)
    factor = Interval(*(math.exp(2 * x) for x in half))
    return Optimism(law, task, math.exp(public), math.exp(fresh), factor, failed, spent)


def other_keys(law: Law, judged: JudgedLaw, tasks: Mapping[str, Task]) -> list[str]:
    """Return what a file changes of the tasks besides numbers of the law, as ``task: key``.

    A law that is judged with less noise than the others computes equal numbers again.
    """
    return [
        f"{name}: {key}"
        for name, task in tasks.items()
        for key in dict.fromkeys(key for of in judged.tasks[name].values for key in of or {})
        if not law.tunes_key(key, task)
    ]


def stale_tasks(archive: Archive, tasks: Mapping[str, Task]) -> list[str]:
    """Return the tasks of a file that are not those of this eqt."""
    return [
        name
        for name, digest in archive.tasks.items()
        if name not in tasks or tasks[name].digest != digest
    ]


def check_shapes(archive: Archive, tasks: Mapping[str, Task], name: str) -> None:
    """Refuse a file with other numbers of runs or samples than its tasks have.

    Raises
    ------
    EqtError
        With the law, the task and both numbers.
    """
    stale = stale_tasks(archive, tasks)
    for law in archive.laws.values():
        for of, judged in law.tasks.items():
            if of in stale or of not in tasks or of not in archive.tasks:
                continue
            (samples, runs), section = judged.errors.shape, tasks[of].section
            if runs != section.judge.runs or samples not in (1, section.search.samples):
                raise EqtError(
                    f"{name}: {law.label} on {of}: expected {section.judge.runs} held-out runs of "
                    f"1 or {section.search.samples} samples, got {runs} of {samples}; write it "
                    "anew by eqt suite pack"
                )


def record_of(row: Any) -> dict[str, Any]:
    """Return a row for programs."""
    record = {**vars(row)}
    if isinstance(row, Optimism):
        record |= {"factor": list(row.factor), "optimistic": row.is_optimistic}
    return record
