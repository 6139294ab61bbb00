"""The paper's runs with a law that is evaluated at instants: eqt, a plain loop and MuJoCo."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec

import numpy as np
import yaml
from scipy.integrate import solve_ivp

from benchmarks.cases import CONFIGS, Case, Motion, errors, load
from benchmarks.contenders.mujoco_body import MuJoCo, RigidBody
from benchmarks.contenders.plain_loop import body, literal, starts
from benchmarks.literal.crazyflie import PERIOD, fly
from benchmarks.measure import fastest
from eqt_cli.base.arrays import Array
from eqt_cli.engines.engine import Engine
from eqt_cli.engines.native import Native
from eqt_cli.engines.solve_ivp import SolveIvp

PERIODS = (0.1, 0.01)
"""s: a law at 10 Hz and at 100 Hz."""

RTOL = 1e-9

STEP = 5e-3
"""s: of MuJoCo; its error is then as small as that of the others."""

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
        Largest max(‖ΔQ‖_F, ‖ΔV‖) to the first way, over the samples of the timed runs; of the
        Crazyflie, to `solve_ivp` at 1e-12, in two runs.
    """

    period: float
    way: str
    wall: float
    cpu: float
    runs: int
    timed_runs: int
    difference: float


def missing() -> dict[str, str]:
    """What is not installed, and how to install it."""
    return {} if _has_mujoco() else {"MuJoCo": "install it with pip install mujoco"}


def _has_mujoco() -> bool:
    return find_spec("mujoco") is not None


def sampled(repeats: int = 3) -> Iterator[Sampled]:
    """Every way at every period that is installed, the engine native first."""
    for period in PERIODS:
        case = load("paper", overrides=[f"control.period={period}"])
        runs = np.arange(len(case.Q))
        ways: list[tuple[str, Array, Callable[[Array], Motion]]] = [
            ("eqt solve_ivp", runs[:BLOCK], _by(case, SolveIvp(rtol=RTOL, atol=1e-3 * RTOL))),
            ("plain solve_ivp loop", runs[:1], partial(_plainly, case, period)),
        ]
        if Native.unavailable() is None:
            Native().solve(case.problems[0].select(slice(0, 1)))  # compiles
            ways.insert(0, ("eqt native", runs, _by(case, Native())))
        if _has_mujoco():
            stepped = partial(_stepped, case, period, _references(case, period))
            ways.append((f"MuJoCo, steps of {1000 * STEP:g} ms", runs[:1], stepped))
        first: Motion | None = None
        for way, some, solve in ways:
            found, wall, cpu, _ = fastest(lambda solve=solve, some=some: solve(some), repeats)
            first = first or found
            scale = len(runs) / len(some)
            difference = float(errors(found, first).max())
            timed = len(some) * len(case.problems)
            yield Sampled(period, way, wall * scale, cpu * scale, case.size, timed, difference)


def crazyflies(repeats: int = 3, runs: int = 800) -> Iterator[Sampled]:
    """The Crazyflie with two rates, by native and by a plain loop, without noise and draws."""
    case = load("crazyflie", runs, _undisturbed())
    every = np.arange(runs)
    ways: list[tuple[str, Array, Callable[[Array], Motion]]] = [
        ("plain loop, Runge-Kutta 4, a step a period", every[:2], partial(_flown, case))
    ]
    if Native.unavailable() is None:
        Native().solve(case.problems[0].select(slice(0, 1)))  # compiles
        ways.insert(0, ("eqt native", every, _by(case, Native())))
    exact = _by(case, SolveIvp(rtol=1e-12, atol=1e-14))(every[:2])
    for way, some, solve in ways:
        found, wall, cpu, _ = fastest(lambda solve=solve, some=some: solve(some), repeats)
        few, scale = Motion(found.Q[:, :2], found.V[:, :2], every[:2]), runs / len(some)
        off = float(errors(few, exact).max())
        yield Sampled(PERIOD, way, wall * scale, cpu * scale, runs, len(some), off)


def _undisturbed() -> list[str]:
    """What a plain program leaves out of `configs/crazyflie.yaml`."""
    given = yaml.safe_load((CONFIGS / "crazyflie.yaml").read_text(encoding="utf-8"))
    weight, drag, _ = given["plant"]["forces"]
    forces = [weight | {"weight": given["model"]["forces"][0]["weight"]}, drag]
    kept = {"controllers": given["controllers"][:1], "plant": {"forces": forces}}
    return ["sensors=null", *(f"{key}={json.dumps(value)}" for key, value in kept.items())]


def _flown(case: Case, runs: Array) -> Motion:
    found = [fly(case.Q[run], case.V[run], case.times) for run in runs]
    Q, V = (np.array(each)[None] for each in zip(*found, strict=True))
    return Motion(Q, V, runs)


def _by(case: Case, engine: Engine) -> Callable[[Array], Motion]:
    def solve(runs: Array) -> Motion:
        problems = [problem.select(runs) for problem in case.problems]
        found = [engine.solve(each) for each in problems]
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


def _references(case: Case, period: float) -> Array:
    """(R_d, ω_d) wherever the plain program has an instant or a sample; all runs share them."""
    equations, (y, *_) = literal(case), starts(case, np.array([0]))
    numbers, times = body(case), _grid(case, period)
    result = solve_ivp(
        lambda t, y: equations.field(np, t, y, "eqt", numbers),
        (times[0], times[-1]),
        y,
        method="DOP853",
        t_eval=times,
        rtol=1e-3 * RTOL,
        atol=1e-6 * RTOL,
    )
    found: Array = result.y.T[:, len(y) // 2 :]
    return found


def _grid(case: Case, period: float) -> Array:
    """The control instants and the sample times, evenly spaced."""
    interval = min(period, case.times[1] - case.times[0])
    grid: Array = interval * np.arange(round(case.times[-1] / interval) + 1)
    return grid


def _stepped(case: Case, period: float, references: Array, runs: Array) -> Motion:
    """MuJoCo's body, stepped by its Runge-Kutta method under the torque of the last instant."""
    equations, numbers, times = literal(case), body(case), _grid(case, period)
    interval = times[1]
    instant, sample = (round(each / interval) for each in (period, case.times[1] - case.times[0]))
    simulator = MuJoCo(RigidBody.of(numbers[0]))
    Q = np.empty((len(case.experiment.loops), len(runs), len(case.times), 3, 3))
    V = np.empty(Q.shape[:-1])
    for number, law in enumerate(case.experiment.loops):
        for row, run in enumerate(runs):
            R, x, w = case.Q[run], np.empty(0), case.V[run]
            simulator.start(R, x, w)
            for k, t in enumerate(times):
                if k % sample == 0:
                    Q[number, row, k // sample], V[number, row, k // sample] = R, w
                if k % instant == 0:
                    y = np.concatenate([R.ravel(), w, references[k]])
                    torque = equations.torque(np, t, y, law, numbers)
                R, x, w = simulator.steps(torque, STEP, round(interval / STEP))
    return Motion(Q, V, runs)
