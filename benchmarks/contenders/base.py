"""What a contender is; it knows no other."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from benchmarks.cases import Case, Motion

Solve = Callable[[], Any]
"""What is timed; it returns the contender's own kind of solution."""


@dataclass(frozen=True)
class Contender(ABC):
    """A way to integrate the runs of a case, with a tolerance.

    Attributes
    ----------
    name
        As written in tables and figures.
    tolerances
        Those of the work-precision diagram.
    headline
        The tolerance of the table, one of `tolerances`.
    """

    name: str
    tolerances: tuple[float, ...]
    headline: float

    def missing(self) -> str | None:
        """What has to be installed first; None where it can run."""
        return None

    def plays(self, case: Case) -> bool:
        """Whether it knows the case's equations."""
        return True

    @abstractmethod
    def prepare(self, case: Case, tolerance: float) -> Solve:
        """Compile what there is to compile; the function that comes back is timed by itself."""

    @abstractmethod
    def motion(self, case: Case, solution: Any) -> Motion:
        """The motion in a solution; its time does not count."""
