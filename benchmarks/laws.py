"""What each law costs the engine `native`: CPU time per run and state, measured in turn."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from benchmarks import cases
from eqt_cli.engines.library import with_comparison_sides
from eqt_cli.engines.native import Native, programs

CASE = "reviewers"
"""The configuration with the laws of other papers beside the paper's own."""


@dataclass(frozen=True)
class LawTime:
    """One law, its runs solved by one thread, compiled before.

    Attributes
    ----------
    of_the_paper
        Whether configs/paper.yaml has it.
    states
        The length of a flat state.
    comparisons
        How many events the law needs.
    steps
        Of a run, their mean.
    cpu
        The least of several, of all runs, s.
    """

    law: str
    of_the_paper: bool
    runs: int
    states: int
    comparisons: int
    steps: float
    cpu: float

    @property
    def microseconds(self) -> float:
        """Per run and state."""
        return 1e6 * self.cpu / (self.runs * self.states)


def laws(runs: int | None, repeats: int) -> list[LawTime]:
    """Every law of the case, all in turn `repeats` times, so that load is the same to all."""
    case = cases.load(CASE, runs)
    own = set(cases.load("paper", 1).experiment.loops)
    loops = case.experiment.loops
    engine = Native()
    least, steps = dict.fromkeys(loops, np.inf), dict.fromkeys(loops, 0.0)
    for _ in range(repeats + 1):  # the first compiles
        for law, problem in zip(loops, case.problems, strict=True):
            began = time.process_time()
            solution = engine.solve(problem)
            least[law] = min(least[law], time.process_time() - began)
            steps[law] = float(solution.steps.mean())
    return [
        LawTime(
            law=law,
            of_the_paper=law in own,
            runs=problem.runs,
            states=loops[law].state_length,
            comparisons=with_comparison_sides(programs(loops[law]).field)[1],
            steps=steps[law],
            cpu=least[law],
        )
        for law, problem in zip(loops, case.problems, strict=True)
    ]


def per_run_and_state(times: Iterable[LawTime]) -> float:
    """µs, of all these laws together."""
    found = list(times)
    return 1e6 * sum(each.cpu for each in found) / sum(each.runs * each.states for each in found)


def ratio(times: list[LawTime]) -> float:
    """Of the other papers' laws to the paper's."""
    others = per_run_and_state(each for each in times if not each.of_the_paper)
    return others / per_run_and_state(each for each in times if each.of_the_paper)
