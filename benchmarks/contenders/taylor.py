"""eqt's taylor engine: the same laws, compiled."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from typing import Literal

from benchmarks.cases import Case, Motion
from benchmarks.contenders.base import Contender, Solve
from eqt_cli.engines import Solution
from eqt_cli.engines.taylor import Taylor


@dataclass(frozen=True)
class Compiled(Contender):
    """heyoka's Taylor method with one kind of generated code, on all cores."""

    code: Literal["full", "compact"] = "full"

    def missing(self) -> str | None:
        """heyoka."""
        return Taylor.unavailable()

    def prepare(self, case: Case, tolerance: float) -> Solve:
        """Compile for the first controller; the others are the same code."""
        engine = Taylor(tol=tolerance, code=self.code)
        engine.solve(case.problems[0].select(slice(0, 1)), lambda runs: None)
        workers = os.cpu_count() or 1

        def solve() -> list[Solution]:
            return [engine.solve(each, lambda runs: None, workers) for each in case.problems]

        return solve

    def motion(self, case: Case, solution: list[Solution]) -> Motion:
        """That of all runs."""
        return case.motion(solution)


FULL = Compiled("eqt taylor, full code", (1e-6, 1e-8, 1e-10, 1e-12, 1e-14), 1e-10)
CONTENDERS = [FULL, replace(FULL, name="eqt taylor, compact code", code="compact")]
