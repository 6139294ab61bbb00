"""An engine as a plugin: the classical Runge-Kutta method with steps of one length."""

import dataclasses
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from eqt_cli.extend import Array, Engine, Integrator, Positive, Problem, Span, SpanResult


class Steps(Integrator):
    """Takes the steps of a span, and a cubic between the ends of a step for its samples."""

    def __init__(self, problem: Problem, longest: float) -> None:
        super().__init__(problem)
        self.longest = longest

    def advance(self, span: Span, states: Array) -> SpanResult:
        """All runs side by side; eqt sees which of them are no longer finite."""
        longest = min(self.longest, span.longest)
        count = int(np.ceil((span.stop - span.start) / longest))
        grid, f = np.linspace(span.start, span.stop, count + 1), self.vector_field
        times = span.grid[1 : 1 + span.later]
        samples = np.empty((len(states), span.later, states.shape[1]))
        y, k1 = states, f(span.start, states)
        for t, end in pairwise(grid):
            h, y0, f0 = end - t, y, k1
            k2 = f(t + h / 2, y + h / 2 * k1)
            k3 = f(t + h / 2, y + h / 2 * k2)
            k4 = f(end, y + h * k3)
            y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            k1 = f(end, y)
            for k in np.flatnonzero((times > t) & (times <= end)):
                x = (times[k] - t) / h
                chord = (1 - 2 * x) * (y - y0) + (x - 1) * h * f0 + x * h * k1
                samples[:, k] = (1 - x) * y0 + x * y + x * (x - 1) * chord
        return SpanResult(y, samples, count)


@dataclass(frozen=True)
class RungeKutta(Engine):
    """The classical Runge-Kutta method on all runs at once.

    Attributes
    ----------
    rtol
        The accuracy that the results are judged by; a step of h s has an error of about h⁵.
    """

    name = "runge_kutta"

    rtol: Positive = 1e-8

    def integrator(self, problem: Problem) -> Steps:
        """With the step that the tolerance asks for."""
        return Steps(problem, 0.5 * self.rtol**0.25)

    def tightened(self, factor: float) -> "RungeKutta":
        """A shorter step."""
        return dataclasses.replace(self, rtol=self.rtol * factor)
