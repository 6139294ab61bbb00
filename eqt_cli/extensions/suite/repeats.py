"""A second run of the suite on other training samples, and what it says of the first one.

Both are judged on the same held-out runs, so that only tuning differs. A verdict is reversed if
both runs resolve a pair of laws, and not in the same way.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.analysis.intervals import RESOLUTION, Interval, Word
from eqt_cli.base.errors import EqtError
from eqt_cli.base.reporting import Block, TextTable, count_of, fixed
from eqt_cli.cli import output
from eqt_cli.extensions.search.ratios import joined_over, logs_of, paired
from eqt_cli.extensions.suite.archive import Archive
from eqt_cli.extensions.suite.entrants import Law
from eqt_cli.extensions.suite.judging import Judged, tuned
from eqt_cli.extensions.suite.tasks import REFERENCE, Task, with_training
from eqt_cli.extensions.suite.verdicts import both_on_samples

Judgements = Mapping[str, Mapping[str, Judged]]
"""What laws did, by task and label."""

FURTHER = 100
"""Seeds between the training samples of the archive and those of the second run."""


@dataclass(frozen=True)
class Mean:
    """The geometric mean of the ratios of a law in both runs.

    Attributes
    ----------
    law, title
        Its label, and its name in tables.
    tasks
        Number of the tasks, those on which it does not fail.
    first, again
        The means, with their intervals.
    """

    law: str
    title: str
    tasks: int
    first: Interval
    again: Interval

    @property
    def share(self) -> float:
        """Their difference over √2 half-widths of the first.

        That is half the width of the interval of a difference of two independent means.
        """
        low, high = (math.log(end) for end in self.first[1:])
        difference = abs(math.log(self.first.value / self.again.value))
        if difference <= RESOLUTION:
            return 0.0
        return difference / (math.sqrt(2) * (high - low) / 2) if high > low else math.inf


@dataclass(frozen=True)
class Repeated:
    """What a second run says.

    Attributes
    ----------
    tasks, laws
        Which it has.
    pairs, both, once
        Number of pairs of laws on a task that do not fail, of those that both runs resolve, and
        of those that one of them resolves.
    reversed
        The reversed verdicts, in words.
    means
        Of the laws but GT.
    """

    tasks: tuple[str, ...]
    laws: tuple[str, ...]
    pairs: int
    both: int
    once: int
    reversed: list[str]
    means: list[Mean]

    def lines(self) -> list[Any]:
        """Return the answer, and the table of the means."""
        verdict = "no resolved verdict is reversed"
        if self.reversed:
            verdict = f"{count_of(len(self.reversed), 'resolved verdict')} reversed"
        lines: list[Any] = [
            f"{verdict}: of {count_of(self.pairs, 'pair')} of {count_of(len(self.laws), 'law')} on "
            f"{count_of(len(self.tasks), 'task')}, {self.both} are resolved both times, "
            f"{self.once} once",
            *(f"reversed {one}" for one in self.reversed),
        ]
        if not self.means:
            return lines
        near = sum(mean.share <= 1 for mean in self.means)
        lines.append(
            f"geometric means: {near} of {len(self.means)} differ by at most √2 half-widths"
        )
        rows = [
            [
                mean.title,
                str(mean.tasks),
                _interval(mean.first),
                _interval(mean.again),
                fixed(mean.share, 2),
            ]
            for mean in self.means
        ]
        header = ["law", "tasks", "archive", "again", "difference"]
        notes = [
            "tasks: on which the law does not fail; difference: of the logarithms, over √2 "
            "half-widths of the archive's interval"
        ]
        caption = "Geometric means of the ratios to GT, in both runs"
        table = TextTable("repeated", caption, header, [Block("", rows)], notes)
        return [*lines, "", output.laid_out(table)]

    def record(self) -> dict[str, Any]:
        """Return the numbers for programs."""
        means = [
            vars(mean) | {"first": [*mean.first], "again": [*mean.again], "share": mean.share}
            for mean in self.means
        ]
        return {**vars(self), "means": means}


def _interval(ends: Interval) -> str:
    value, low, high = (fixed(end, 3) for end in ends)
    return f"{value} [{low}, {high}]"


def repeat(
    archive: Archive,
    laws: Mapping[str, Law],
    tasks: Mapping[str, Task],
    seed: int | None,
    folder: Path,
    workers: int,
) -> Repeated:
    """Tune archived laws on other training samples, and compare with the archive.

    What the folder holds of earlier searches is used again.
    """
    first: dict[str, dict[str, Judged]] = {name: {} for name in tasks}
    again: dict[str, dict[str, Judged]] = {name: {} for name in tasks}
    for name, task in tasks.items():
        other = with_training(task, task.section.search.seed + FURTHER if seed is None else seed)
        _check_apart(task, other)
        for label, law in laws.items():
            if name in archive.laws[label].tasks:
                output.say(f"{label} on {name}")
                first[name][label] = archive.laws[label].tasks[name]
                again[name][label] = tuned(law, other, folder / label / name, workers)
    return compared(first, again, {label: law.title for label, law in archive.laws.items()})


def _check_apart(task: Task, other: Task) -> None:
    """Refuse training samples that the archive has, or held-out runs."""
    search, judged = task.section.search, task.section.judge.seed
    first = other.section.search.seed
    ours = range(first, first + search.samples)
    theirs = range(search.seed, search.seed + search.samples)
    if judged in ours or max(ours[0], theirs[0]) <= min(ours[-1], theirs[-1]):
        raise EqtError(
            f"--seed {first}: {task.name} would be tuned with seeds {first} to {ours[-1]}; leave "
            f"out {theirs[0]} to {theirs[-1]}, which the archive has, and {judged}, the held-out "
            "runs"
        )


def compared(first: Judgements, again: Judgements, titles: Mapping[str, str]) -> Repeated:
    """Compare two runs of the suite, which have the same laws and tasks."""
    whole = {
        name: [x for x in laws if _is_judged(laws[x]) and _is_judged(again[name][x])]
        for name, laws in first.items()
    }
    words = [
        (f"{one} against {other} on {name}", _word(first[name], one, other), word)
        for name, labels in whole.items()
        for one, other in combinations(labels, 2)
        if (word := _word(again[name], one, other))
    ]
    solved = [[word in (Word.BETTER, Word.WORSE) for word in pair] for _, *pair in words]
    laws = dict.fromkeys(label for of_task in first.values() for label in of_task)
    means = list[Mean]()
    for label in laws:
        of_law = [name for name, labels in whole.items() if {label, REFERENCE} <= {*labels}]
        if label != REFERENCE and of_law:
            both = [_mean(run, label, of_law) for run in (first, again)]
            means.append(Mean(label, titles[label], len(of_law), *both))
    return Repeated(
        tuple(first),
        tuple(laws),
        len(words),
        sum(map(all, solved)),
        sum(one != other for one, other in solved),
        [
            f"{name}: {one}, then {other}"
            for (name, one, other), resolved in zip(words, solved, strict=True)
            if all(resolved) and one is not other
        ],
        means,
    )


def _is_judged(judged: Judged) -> bool:
    return judged.is_whole and judged.is_finished


def _word(judgements: Mapping[str, Judged], one: str, other: str) -> Word:
    errors = both_on_samples(judgements[one], judgements[other])
    return paired(*errors, one, other, "", "lower").word


def _mean(judgements: Judgements, label: str, tasks: Sequence[str]) -> Interval:
    of_tasks = [judgements[name] for name in tasks]
    parts = [logs_of(*both_on_samples(laws[label], laws[REFERENCE])) for laws in of_tasks]
    return Interval(*np.exp(joined_over(parts, 0.95)).tolist())
