"""Heyoka: Taylor's method, compiled by LLVM from the literal equations, a few runs at a time."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from types import SimpleNamespace
from typing import Any

import numpy as np

from benchmarks.cases import Case, Motion
from benchmarks.contenders.base import Contender, Solve
from benchmarks.contenders.plain_loop import WRITTEN_OUT, body, literal, starts


@dataclass(frozen=True)
class Heyoka(Contender):
    """Steps of the order that suits the tolerance, of each run by itself."""

    def missing(self) -> str | None:
        """heyoka."""
        if find_spec("heyoka"):
            return None
        return "heyoka is not installed (pip install --group bench)"

    def prepare(self, case: Case, tolerance: float) -> Solve:
        """Compile each law for as many runs as fill a vector."""
        import heyoka

        lanes = heyoka.recommended_simd_size()
        y = starts(case, np.arange(len(case.Q)))
        length, count = y.shape[1], len(y)
        filled = np.resize(y, (-(-count // lanes) * lanes, length))
        numbers = SimpleNamespace(
            **vars(WRITTEN_OUT) | {"sin": heyoka.sin, "cos": heyoka.cos, "sqrt": heyoka.sqrt}
        )
        symbols = np.array(heyoka.make_vars(*(f"y{k}" for k in range(length))))

        def compiled(law: str) -> Any:
            rates = literal(case).field(numbers, heyoka.time, symbols, law, body(case))
            zero = heyoka.expression(0.0)  # a rate may be a float
            equations = [(y, zero + rate) for y, rate in zip(symbols, rates, strict=True)]
            start = np.ascontiguousarray(filled[:lanes].T)
            return heyoka.taylor_adaptive_batch(equations, start, tol=tolerance)

        integrators = [compiled(law) for law in case.experiment.loops]
        grid = np.repeat(np.asarray(case.times)[:, None], lanes, axis=1)

        def solve() -> list[Any]:
            return [_solved(integrator, filled, grid)[:count] for integrator in integrators]

        return solve

    def motion(self, case: Case, solution: list[Any]) -> Motion:
        """That of all runs."""
        Q, V = literal(case).motion(np.array(solution))
        return Motion(Q, V, np.arange(len(case.Q)))


def _solved(integrator: Any, starts: Any, grid: Any) -> Any:
    """The states of all runs at all samples, ``(runs, samples, n)``."""
    found = []
    for first in range(0, len(starts), grid.shape[1]):
        integrator.state[:] = starts[first : first + grid.shape[1]].T
        integrator.set_time(grid[0].copy())
        *_, states = integrator.propagate_grid(grid)
        found.append(np.moveaxis(states, -1, 0))
    return np.concatenate(found)


CONTENDERS = [Heyoka("heyoka (Taylor)", (1e-6, 1e-9, 1e-12), 1e-9)]
