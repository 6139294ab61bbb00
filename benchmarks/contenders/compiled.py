"""eqt's compiled engine: the same laws, as a C compiler makes them."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass

from benchmarks.cases import Case, Motion
from benchmarks.contenders.base import Contender, Solve
from eqt_cli.engines.choice import unavailable
from eqt_cli.engines.engine import Engine, Problem, Solution
from eqt_cli.engines.native import STEP_SHARE, Native


@dataclass(frozen=True)
class Compiled(Contender):
    """An engine on all cores.

    Attributes
    ----------
    engine
        The one with a tolerance of a step.
    """

    engine: Callable[[float], Engine]

    def missing(self) -> str | None:
        """What the engine needs."""
        return unavailable(type(self.engine(self.headline)))

    def prepare(self, case: Case, tolerance: float) -> Solve:
        """Compile for the first controller; the others are the same code, so all go together."""
        engine = self.engine(tolerance)
        engine.solve(case.problems[0].select(slice(0, 1)))
        workers = os.cpu_count() or 1
        together = Problem.joined(case.problems)
        runs = case.problems[0].runs

        def solve() -> list[Solution]:
            found = engine.solve(together, workers)
            parts = [slice(start, start + runs) for start in range(0, together.runs, runs)]
            return [
                Solution(found.states[p], found.status[p], found.steps[p], found.messages[p])
                for p in parts
            ]

        return solve

    def motion(self, case: Case, solution: list[Solution]) -> Motion:
        """That of all runs."""
        return case.motion(solution)


def native(tolerance: float) -> Engine:
    """DOP853 in C."""
    return Native(rtol=tolerance / STEP_SHARE, atol=tolerance / STEP_SHARE)


CONTENDERS = [Compiled("eqt native", (1e-6, 1e-8, 1e-10, 1e-11, 6e-13, 1e-14), 6e-13, native)]
