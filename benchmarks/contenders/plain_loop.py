"""The loop that most users write: one call of solve_ivp per run.

It integrates a few runs of each controller only; its time for all of them is extrapolated.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.cases import Case, Motion
from benchmarks.contenders.base import Contender, Solve
from eqt_cli.base.arrays import Array

RUNS_PER_CONTROLLER = 5


def literal(case: Case) -> ModuleType:
    """The group's equations as a user writes them."""
    return import_module(f"benchmarks.literal.{case.experiment.group.name.lower()}")


def body(case: Case) -> tuple[Array, ...]:
    """Inertia, its inverse, and the gains."""
    loop = case.problems[0].loop
    inertia = loop.inertia.at(0.0)
    return inertia.matrix, inertia.inverse, loop.gains.K, loop.gains.K_d


def starts(case: Case, runs: Array) -> Array:
    """Initial values of some runs, the same for every controller."""
    Qd, Vd = case.experiment.desired.pose, case.experiment.desired.velocity
    return np.array([literal(case).start(case.Q[run], case.V[run], Qd, Vd) for run in runs])


def written_out(a: Array, b: Array) -> Array:
    """The cross product of two vectors, without what `numpy.cross` does for arrays of any shape."""
    x, y, z = a
    u, v, w = b
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])


WRITTEN_OUT = SimpleNamespace(**vars(np) | {"cross": written_out})
"""NumPy with that cross product."""


@dataclass(frozen=True)
class PlainLoop(Contender):
    """DOP853, run by run, on the literal equations.

    Attributes
    ----------
    xp
        What the equations call: numpy, or it with another cross product.
    """

    xp: Any = np

    def prepare(self, case: Case, tolerance: float) -> Solve:
        """Nothing to compile."""
        field, numbers = literal(case).field, body(case)
        runs = _runs(case)

        def one(law: str, y: Array) -> Array:
            result = solve_ivp(
                lambda t, y: field(self.xp, t, y, law, numbers),
                (case.times[0], case.times[-1]),
                y,
                method="DOP853",
                t_eval=case.times,
                rtol=tolerance,
                atol=tolerance * 1e-3,
            )
            y_at_samples: Array = result.y.T
            return y_at_samples

        def solve() -> Array:
            laws = case.experiment.loops
            return np.array([[one(law, y) for y in starts(case, runs)] for law in laws])

        return solve

    def motion(self, case: Case, solution: Any) -> Motion:
        """That of the runs that were integrated."""
        Q, V = literal(case).motion(solution)
        return Motion(Q, V, _runs(case))


def _runs(case: Case) -> Array:
    """Evenly spaced, so neither the easiest nor the hardest."""
    every = max(1, len(case.Q) // RUNS_PER_CONTROLLER)
    return np.arange(0, len(case.Q), every)[:RUNS_PER_CONTROLLER]


_TOLERANCES = (1e-5, 1e-7, 1e-9, 1e-11)

CONTENDERS = [
    PlainLoop("plain solve_ivp loop", _TOLERANCES, 1e-9),
    PlainLoop("plain loop, × written out", _TOLERANCES, 1e-9, WRITTEN_OUT),
]
