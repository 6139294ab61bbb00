"""An engine with steps of one length; its name sorts before those of eqt's engines."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from eqt_cli.extend import (
    Array,
    Count,
    Engine,
    Integrator,
    Positive,
    Problem,
    Problems,
    Span,
    SpanResult,
)


class Steps(Integrator):
    """Steps from each sample to the next."""

    def __init__(self, problem: Problem, engine: RungeKutta) -> None:
        super().__init__(problem)
        self.engine = engine

    def advance(self, span: Span, states: Array) -> SpanResult:
        """The states at all ends of intervals but the first."""
        field, y, steps, found = self.vector_field, states, 0, []
        with np.errstate(all="ignore"):
            for start, stop in zip(span.grid[:-1], span.grid[1:], strict=True):
                t, length = float(start), float(stop - start)
                count = max(self.engine.steps, int(np.ceil(length / self.engine.step)))
                h = length / count
                for _ in range(count):
                    k1 = field(t, y)
                    k2 = field(t + h / 2, y + h / 2 * k1)
                    k3 = field(t + h / 2, y + h / 2 * k2)
                    k4 = field(t + h, y + h * k3)
                    y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
                    t += h
                found.append(y)
                steps += count
        return SpanResult(y, np.stack([*found, y], axis=1)[:, : span.later], steps)


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

    def integrator(self, problem: Problem) -> Steps:
        """Steps between samples."""
        return Steps(problem, self)
