"""One quadrotor job by eqt and by RotorPy: in a Python that runs already, and as a process."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeAlias

import numpy as np

import eqt_cli
from benchmarks.cases import Case, Motion, errors, load
from benchmarks.contenders import rotorpy_loop
from benchmarks.contenders.rotorpy_loop import RotorPy
from benchmarks.measure import in_turn
from benchmarks.process import spent
from eqt_cli.base.arrays import Array
from eqt_cli.engines.native import Native
from eqt_cli.engines.solve_ivp import SolveIvp

CONFIG = Path(__file__).with_name("quadrotor.yaml")

JOBS = ((1.0, 1), (6.0, 1), (6.0, 1000))
"""Duration, s, and runs."""

TIMED = 3
"""Runs by which RotorPy is timed where it flies one after the other."""

TIGHT = {"method": "DOP853", "rtol": 1e-9, "atol": 1e-12}
"""By these, RotorPy's error is that of `native`."""

Fly: TypeAlias = Callable[[Array], Motion]


@dataclass(frozen=True)
class Flight:
    """One way to do one job.

    Attributes
    ----------
    duration
        Of a run, s.
    way
        What integrates, and from where to where.
    wall, cpu
        Of the fastest of several, s; extrapolated from `timed_runs` where they are fewer.
    error
        Largest max(‖ΔQ‖_F, ‖ΔV‖) over the samples of the first `TIMED` runs to `solve_ivp` at
        1e-12; None of processes, which return no motion.
    """

    duration: float
    runs: int
    way: str
    wall: float
    cpu: float
    timed_runs: int
    error: float | None


def missing() -> dict[str, str]:
    """What is not installed, and how to install it."""
    found = {"RotorPy": rotorpy_loop.missing(), "RotorPy's batches": rotorpy_loop.missing_batches()}
    return {name: reason for name, reason in found.items() if reason}


def flights(repeats: int) -> Iterator[Flight]:
    """Every way to do every job; those of RotorPy only where it is installed."""
    for number, (duration, runs) in enumerate(JOBS):
        case = load(CONFIG.stem, runs, settings(duration), CONFIG.parent)
        exact = _solved(case, SolveIvp(rtol=1e-12, atol=1e-14), np.arange(min(runs, TIMED)))
        if number == 0 and Native.unavailable() is None:
            began = os.times()
            found = _solved(case, Native(), exact.runs)
            wall, cpu = since(began)
            way, error = "eqt `native`, first: compiles", float(errors(found, exact).max())
            yield Flight(duration, runs, way, wall, cpu, runs, error)
        ways = list(_ways(case))
        timed = in_turn([partial(fly, np.arange(count)) for _, count, fly in ways], repeats)
        for (way, count, _), (found, wall, cpu, _) in zip(ways, timed, strict=True):
            few, scale = exact.runs[:count], runs / count
            found = Motion(found.Q[:, : len(few)], found.V[:, : len(few)], few)
            error = float(errors(found, exact).max())
            yield Flight(duration, runs, way, wall * scale, cpu * scale, count, error)
        yield from _processes(duration, runs, repeats, first=number == 0)


def since(began: os.times_result) -> tuple[float, float]:
    """Wall time, and the CPU time of this process and of the compiler that it has called, s."""
    passed = np.subtract(os.times(), began)
    return float(passed[4]), float(passed[:4].sum())


def settings(duration: float) -> list[str]:
    """The configuration with another duration: a sample at each control instant."""
    samples = round(duration / rotorpy_loop.PERIOD) + 1
    return [f"time.duration={duration:g}", f"time.samples={samples}"]


def _ways(case: Case) -> Iterator[tuple[str, int, Fly]]:
    """Within one Python: name, how many runs are timed, and the flight of some runs."""
    runs = len(case.Q)
    if Native.unavailable() is None:
        yield "eqt `native`, compiled", runs, partial(_solved, case, Native())
        yield "eqt `run`, with checks and file", runs, partial(_stored, case)
    if rotorpy_loop.missing():
        return
    some, plain, tight = min(runs, TIMED), RotorPy(), RotorPy(TIGHT)
    yield "RotorPy `Environment`", some, partial(_flown, case, plain.environment)
    yield "RotorPy, steps of its vehicle", some, partial(_flown, case, plain.loop)
    yield "RotorPy, steps by DOP853 at 1e-9", some, partial(_flown, case, tight.loop)
    if not rotorpy_loop.missing_batches():
        for integrator in ("dopri5", "rk4"):
            way = f"RotorPy, a batch by {integrator} in torch"
            yield way, runs, partial(_batch, case, integrator)


def _solved(case: Case, engine: Native | SolveIvp, runs: Array) -> Motion:
    return case.motion([engine.solve(each.select(runs)) for each in case.problems], runs)


def _stored(case: Case, runs: Array) -> Motion:
    """As a user calls it: with error estimate, cross-check, metrics and the result file."""
    with TemporaryDirectory() as folder:
        given = {"ensemble.runs": len(runs), "time.duration": float(case.times[-1])}
        given["time.samples"] = len(case.times)
        stored = eqt_cli.run(eqt_cli.load_experiment(CONFIG, given), folder + "/result")
        with eqt_cli.open_result(stored) as result:
            Q, V = np.array(result["pose"]), np.array(result["velocity"])
    return Motion(Q, V, runs)


def _flown(
    case: Case, fly: Callable[[Array, Array, float], tuple[Array, Array]], runs: Array
) -> Motion:
    found = [fly(case.Q[run], case.V[run], case.times[-1]) for run in runs]
    Q, V = (np.array(each)[None] for each in zip(*found, strict=True))
    return Motion(Q, V, runs)


def _batch(case: Case, integrator: str, runs: Array) -> Motion:
    Q, V = RotorPy().batch(case.Q[runs], case.V[runs], case.times[-1], integrator)
    return Motion(Q[None], V[None], runs)


def _processes(duration: float, runs: int, repeats: int, first: bool) -> Iterator[Flight]:
    """From the start of Python to its end, by one thread, in turn."""
    few, more = 1, 1 + TIMED * (runs > 1)
    with TemporaryDirectory() as cache:
        given = [f"ensemble.runs={runs}", *settings(duration)]
        command = ["-m", "eqt_cli", "run", str(CONFIG), "--quiet", "--workers", "1", "--force"]
        command += ["--out", f"{cache}/result", *(word for key in given for word in ("--set", key))]
        programs = [command]
        if not rotorpy_loop.missing():
            programs += [["-c", rotorpy_loop.program(duration, n)] for n in sorted({few, more})]
        environment = {"XDG_CACHE_HOME": cache}
        compiling = spent(command, environment=environment)
        rounds = [
            [spent(each, environment=environment) for each in programs] for _ in range(repeats)
        ]
    if first:
        way = "process of `eqt run`, first: compiles"
        yield Flight(duration, runs, way, compiling.wall, compiling.cpu, runs, None)
    wall, cpu = (
        [min(getattr(each, name) for each in every) for every in zip(*rounds, strict=True)]
        for name in ("wall", "cpu")
    )
    yield Flight(duration, runs, "process of `eqt run`", wall[0], cpu[0], runs, None)
    if len(programs) == 1:
        return
    further = (runs - few) / max(more - few, 1)
    total = [each[1] + further * (each[-1] - each[1]) for each in (wall, cpu)]
    yield Flight(duration, runs, "process of RotorPy", *total, min(runs, more), None)
