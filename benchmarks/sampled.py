"""The paper's runs with a law that is evaluated at instants: eqt against a plain loop."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.cases import Case, Motion, errors, load
from benchmarks.contenders.plain_loop import body, literal, starts
from benchmarks.measure import fastest
from eqt_cli.core.arrays import Array
from eqt_cli.engines import Engine
from eqt_cli.engines.solve_ivp import SolveIvp
from eqt_cli.engines.taylor import Taylor

PERIODS = (0.1, 0.01)
"""s: a law at 10 Hz and at 100 Hz."""

RTOL = 1e-9

BLOCK = 100
"""Runs of one law by which solve_ivp is timed: one of its blocks."""


@dataclass(frozen=True)
class Sampled:
    """One way at one period.

    Attributes
    ----------
    way
        What integrates.
    wall, cpu
        Of the fastest of several, s, for all runs of the paper by one thread.
    runs, timed_runs
        How many there are, and how many were integrated; times are extrapolated.
    difference
        Largest max(‖ΔQ‖_F, ‖ΔV‖) to the first way, over the samples of the timed runs.
    """

    period: float
    way: str
    wall: float
    cpu: float
    runs: int
    timed_runs: int
    difference: float


def sampled(repeats: int = 3) -> Iterator[Sampled]:
    """Every way at every period, the taylor engine first, where it is installed."""
    for period in PERIODS:
        case = load("paper", overrides=[f"control.period={period}"])
        runs = np.arange(len(case.Q))
        ways: list[tuple[str, Array, Callable[[Array], Motion]]] = [
            ("eqt solve_ivp", runs[:BLOCK], _by(case, SolveIvp(rtol=RTOL, atol=1e-3 * RTOL))),
            (
                "plain solve_ivp loop",
                runs[:1],
                partial(_plainly, case, period),
            ),
        ]
        if Taylor.unavailable() is None:
            engine = Taylor(code="full")
            engine.solve(case.problems[0].select(slice(0, 1)), lambda done: None)  # compiles
            ways.insert(0, ("eqt taylor", runs, _by(case, engine)))
        first: Motion | None = None
        for way, some, solve in ways:
            found, wall, cpu, _ = fastest(lambda solve=solve, some=some: solve(some), repeats)
            first = first or found
            scale = len(runs) / len(some)
            difference = float(errors(found, first).max())
            timed = len(some) * len(case.problems)
            yield Sampled(period, way, wall * scale, cpu * scale, case.size, timed, difference)


def _by(case: Case, engine: Engine) -> Callable[[Array], Motion]:
    def solve(runs: Array) -> Motion:
        problems = [problem.select(runs) for problem in case.problems]
        found = [engine.solve(each, lambda done: None) for each in problems]
        return case.motion(found, runs)

    return solve


def _plainly(case: Case, period: float, runs: Array) -> Motion:
    """A call of solve_ivp from each instant to the next, with the torque of the first."""
    equations, numbers, times = literal(case), body(case), case.times
    steps = round(times[-1] / period)
    found = []
    for law in case.experiment.loops:
        for y in starts(case, runs):
            at_samples = np.empty((len(times), len(y)))
            for k in range(steps):
                start, stop = k * period, min((k + 1) * period, times[-1])
                torque = equations.torque(np, start, y, law, numbers)
                here = (times >= start - 1e-9) & (times < stop - 1e-9)
                result = solve_ivp(
                    lambda t, y, torque=torque: equations.motion_rate(np, t, y, torque, numbers),
                    (start, stop),
                    y,
                    method="DOP853",
                    t_eval=np.append(np.maximum(times[here], start), stop),
                    rtol=RTOL,
                    atol=1e-3 * RTOL,
                )
                at_samples[here], y = result.y.T[:-1], result.y[:, -1]
            at_samples[-1] = y
            found.append(at_samples)
    shape = len(case.experiment.loops), len(runs), len(times), -1
    Q, V = equations.motion(np.array(found).reshape(shape))
    return Motion(Q, V, runs)
