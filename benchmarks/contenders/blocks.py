"""eqt's solve_ivp engine: runs in vectorised blocks that share their steps."""

from __future__ import annotations

from dataclasses import dataclass

from threadpoolctl import threadpool_limits

from benchmarks.cases import Case, Motion
from benchmarks.contenders.base import Contender, Solve
from eqt_cli.engines.engine import Solution
from eqt_cli.engines.solve_ivp import SolveIvp


@dataclass(frozen=True)
class Blocks(Contender):
    """DOP853 on blocks of a given number of runs."""

    block: int | None = None

    def prepare(self, case: Case, tolerance: float) -> Solve:
        """Nothing to compile."""
        engine = SolveIvp(rtol=tolerance, atol=tolerance * 1e-3, block=self.block)

        def solve() -> list[Solution]:
            with threadpool_limits(1):  # as eqt runs it
                return [engine.solve(each) for each in case.problems]

        return solve

    def motion(self, case: Case, solution: list[Solution]) -> Motion:
        """That of all runs."""
        return case.motion(solution)


TOLERANCES = (1e-5, 1e-7, 1e-9, 1e-11)
CONTENDERS = [
    Blocks("eqt blocks of 200", TOLERANCES, 1e-9, block=200),
    Blocks("eqt blocks (default)", TOLERANCES, 1e-9),
]
