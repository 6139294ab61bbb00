"""eqt's taylor engine: the same laws, compiled."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from typing import Literal

from benchmarks.cases import Case, Motion
from benchmarks.contenders.base import Contender, Solve
from eqt_cli.engines import Problem, Solution
from eqt_cli.engines.taylor import Taylor


@dataclass(frozen=True)
class Compiled(Contender):
    """heyoka's Taylor method with one kind of generated code, on all cores."""

    code: Literal["full", "compact"] = "full"

    def missing(self) -> str | None:
        """heyoka."""
        return Taylor.unavailable()

    def prepare(self, case: Case, tolerance: float) -> Solve:
        """Compile for the first controller; the others are the same code, so all go together."""
        engine = Taylor(tol=tolerance, code=self.code)
        engine.solve(case.problems[0].select(slice(0, 1)), lambda runs: None)
        workers = os.cpu_count() or 1
        together = Problem.joined(case.problems)
        runs = case.problems[0].runs

        def solve() -> list[Solution]:
            found = engine.solve(together, lambda runs: None, workers)
            parts = [slice(start, start + runs) for start in range(0, together.runs, runs)]
            return [
                Solution(found.states[p], found.status[p], found.steps[p], found.messages[p])
                for p in parts
            ]

        return solve

    def motion(self, case: Case, solution: list[Solution]) -> Motion:
        """That of all runs."""
        return case.motion(solution)


FULL = Compiled("eqt taylor, full code", (1e-6, 1e-8, 1e-10, 1e-12, 1e-14), 1e-10)
CONTENDERS = [FULL, replace(FULL, name="eqt taylor, compact code", code="compact")]
