"""An engine with steps of one length; its name sorts before those of eqt's engines."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from eqt_cli.extend import Count, Engine, Positive, Problem, Problems, Progress, Solution, Status


@dataclass(frozen=True)
class RungeKutta(Engine):
    """The classical Runge-Kutta method on all runs at once.

    Attributes
    ----------
    rtol
        Is what the results are judged by; the error of a step is about step⁵.
    steps
        Between two samples, at the least.
    """

    name: ClassVar[str] = "rk4_fixed"

    rtol: Positive = 1e-8
    steps: Count = 1

    @property
    def step(self) -> float:
        """The longest step, s."""
        return float(0.5 * self.rtol**0.25)

    def tightened(self, factor: float) -> RungeKutta:
        """A smaller step."""
        return dataclasses.replace(self, rtol=self.rtol * factor)

    def check(self, problems: Problems) -> None:
        """Note a tolerance that asks for nothing."""
        if self.rtol >= 1:
            problems.at("rtol").add(f"expected less than 1, got {self.rtol:g}")

    def solve(self, problem: Problem, progress: Progress, workers: int = 1) -> Solution:
        """Steps between samples."""
        solution = Solution.empty(problem)
        field, times = problem.batched_loop().vector_field, problem.times
        y = problem.states.copy()
        solution.states[:, 0] = y
        intervals = len(times) - 1
        with np.errstate(all="ignore"):
            for sample in range(intervals):
                t, length = float(times[sample]), float(times[sample + 1] - times[sample])
                count = max(self.steps, int(np.ceil(length / self.step)))
                h = length / count
                for _ in range(count):
                    k1 = field(t, y)
                    k2 = field(t + h / 2, y + h / 2 * k1)
                    k3 = field(t + h / 2, y + h / 2 * k2)
                    k4 = field(t + h, y + h * k3)
                    y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
                    t += h
                solution.states[:, sample + 1] = y
                solution.steps[:] += count
                progress(problem.runs / intervals)
        for run in np.flatnonzero(~np.isfinite(solution.states).all(axis=(1, 2))):
            first = int(np.argmin(np.isfinite(solution.states[run]).all(axis=1)))
            solution.states[run, first:] = np.nan
            solution.status[run] = Status.NON_FINITE
            solution.messages[run] = f"t = {times[first]:.6g} s: the state is not finite"
        return solution
