"""Cuts the runs of an experiment into parts. Does not know files or the content of runs.

The runs of a controller are numbered in (point, run) order: entry e is run e mod R of point e div
R. A part consists of consecutive entries of one controller. The cut depends only on the sizes, so
that results do not depend on where and when parts are computed.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import cached_property
from itertools import accumulate
from typing import TYPE_CHECKING, Any, Self

if TYPE_CHECKING:
    from eqt_cli.base.arrays import Array

MANY_PARTS = 4000
"""Number of parts above which parts become larger instead; each costs some milliseconds."""


@dataclass(frozen=True)
class Box:
    """Entries of a part that are rectangular in (point, run).

    Attributes
    ----------
    rows
        Rows of its entries in the part.
    points, runs
        Points of the entries, and runs of each point.
    """

    rows: slice
    points: slice
    runs: slice

    @property
    def shape(self) -> tuple[int, int]:
        """The number of points and of runs."""
        return self.points.stop - self.points.start, self.runs.stop - self.runs.start


@dataclass(frozen=True)
class StudyPart:
    """Entries `start` to `stop` of one controller, of an experiment with `runs` runs per point."""

    number: int
    controller: int
    start: int
    stop: int
    runs: int

    def __len__(self) -> int:
        return self.stop - self.start

    @property
    def points(self) -> Array:
        """The point of every entry."""
        return self._entries // self.runs

    @property
    def run_numbers(self) -> Array:
        """The run of every entry."""
        return self._entries % self.runs

    @property
    def _entries(self) -> Array:
        import numpy as np  # `eqt show` of an unfinished folder does not need it

        return np.arange(self.start, self.stop)

    def boxes(self, limit: int) -> Iterator[Box]:
        """Yield the entries as at most three boxes.

        Only the first `limit` runs of each point count, and `rows` count those.
        """
        row, entry = 0, self.start
        while entry < self.stop:
            point, first = divmod(entry, self.runs)
            whole = (self.stop - entry) // self.runs if first == 0 else 0
            last = self.runs if whole else min(self.runs, first + self.stop - entry)
            points = slice(point, point + max(whole, 1))
            runs = slice(min(first, limit), min(last, limit))
            count = (points.stop - points.start) * (runs.stop - runs.start)
            if count:
                yield Box(slice(row, row + count), points, runs)
            row += count
            entry += (points.stop - points.start) * (last - first)


@dataclass(frozen=True)
class Plan:
    """All parts of an experiment.

    Attributes
    ----------
    points, runs, controllers
        Sizes of the experiment; `runs` is the number for each point and controller.
    size
        Number of entries of a part; the last part of a controller may have fewer.
    """

    points: int
    runs: int
    controllers: int
    size: int

    def __len__(self) -> int:
        return -(-self.entries // self.size) * self.controllers

    @property
    def entries(self) -> int:
        """The number of runs of each controller, over all points."""
        return self.points * self.runs

    @property
    def total(self) -> int:
        """The number of runs over all points and controllers."""
        return self.entries * self.controllers

    def part(self, number: int) -> StudyPart:
        """Return part `number`. The controllers alternate, as they share the initial states."""
        index, controller = divmod(number, self.controllers)
        start = index * self.size
        return StudyPart(number, controller, start, min(start + self.size, self.entries), self.runs)


@dataclass(frozen=True)
class Plans:
    """The parts of several plans with common numbers."""

    plans: tuple[Plan, ...]

    def __len__(self) -> int:
        return self._ends[-1]

    @cached_property
    def _ends(self) -> list[int]:
        return list(accumulate(len(plan) for plan in self.plans))

    @property
    def total(self) -> int:
        """The number of runs of all plans."""
        return sum(plan.total for plan in self.plans)

    def where(self, number: int) -> tuple[int, int]:
        """Return the index of the plan of a part, and the part's number in it."""
        index = bisect_right(self._ends, number)
        return index, number - (self._ends[index - 1] if index else 0)

    def runs_of(self, number: int) -> int:
        """Return the number of runs of a part."""
        index, inner = self.where(number)
        return len(self.plans[index].part(inner))

    @property
    def data(self) -> Any:
        """The plans as data for JSON: a single plan, or a list."""
        listed = [asdict(plan) for plan in self.plans]
        return listed[0] if len(listed) == 1 else listed

    @classmethod
    def of_data(cls, data: Any) -> Self:
        """Return the plans of `data`; raises a TypeError for invalid data."""
        return cls(tuple(Plan(**entry) for entry in (data if isinstance(data, list) else [data])))
