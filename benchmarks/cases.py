"""What is integrated: the runs of a shipped configuration, with an exact solution to judge by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eqt_cli.base.arrays import Array, frobenius, norm
from eqt_cli.config.document import read_config
from eqt_cli.config.experiment import Experiment
from eqt_cli.config.preflight import build
from eqt_cli.engines.engine import Problem, Solution
from eqt_cli.engines.solve_ivp import SMALLEST_RTOL, SolveIvp

CONFIGS = Path(__file__).parents[1] / "configs"


@dataclass(frozen=True)
class Motion:
    """Poses and body velocities at the sample times.

    Attributes
    ----------
    Q : (controllers, runs, samples, d, d)
    V : (controllers, runs, samples, m)
    runs : (runs,)
        Which runs of the case these are.
    """

    Q: Array
    V: Array
    runs: Array


@dataclass(frozen=True)
class Case:
    """The same runs for every contender.

    Attributes
    ----------
    name
        Of the configuration.
    experiment
        With the closed loops, in the order of the controllers.
    problems
        All runs of each controller, as eqt integrates them.
    Q, V
        Initial poses and velocities, the same for all controllers.
    """

    name: str
    experiment: Experiment
    problems: list[Problem]
    Q: Array
    V: Array

    @property
    def times(self) -> Array:
        """Sample times, s."""
        return self.experiment.times

    @property
    def size(self) -> int:
        """The number of runs over all controllers."""
        return sum(problem.runs for problem in self.problems)

    def motion(self, solutions: list[Solution], runs: Array | None = None) -> Motion:
        """What one solution per controller says of the true (not the desired) motion."""
        parts = [
            problem.loop.tracking(self.times, solution.states)
            for problem, solution in zip(self.problems, solutions, strict=True)
        ]
        runs = np.arange(self.problems[0].runs) if runs is None else runs
        return Motion(np.stack([s.Q for s in parts]), np.stack([s.V for s in parts]), runs)


def load(
    name: str, runs: int | None = None, overrides: Sequence[str] = (), folder: Path = CONFIGS
) -> Case:
    """A configuration, with another number of runs per controller where one is given."""
    counted = [] if runs is None else [f"ensemble.runs={runs}"]
    experiment = build(read_config(folder / f"{name}.yaml", [*overrides, *counted]))
    start, ensemble = experiment.start, experiment.config.ensemble
    G = experiment.group
    pairs = (start.numbers(G, ensemble.seed, run) for run in range(ensemble.runs))
    numbers, errors = map(np.array, zip(*pairs, strict=True))
    Qd, Vd = experiment.desired.pose, experiment.desired.velocity
    Q, V = Qd @ start.poses.place(G, numbers), Vd + errors
    problems = [
        Problem(loop, loop.initial_state(Q, V, Qd, Vd), experiment.times)
        for loop in experiment.loops.values()
    ]
    return Case(name, experiment, problems, Q, V)


def exact(case: Case) -> Motion:
    """By `solve_ivp` at its smallest tolerance; no contender has its steps.

    Blocks of 50 runs take a thirtieth of the time of single runs, whose poses and velocities differ
    from theirs by at most 3e-13 (paper) and 3e-12 (se3), measured on 16 runs of each.
    """
    engine = SolveIvp(rtol=SMALLEST_RTOL, atol=1e-3 * SMALLEST_RTOL, block=50)
    return case.motion([engine.solve(each) for each in case.problems])


def errors(found: Motion, reference: Motion) -> Array:
    """max over samples of max(‖ΔQ‖_F, ‖ΔV‖), ``(controllers, runs)``, of the runs found."""
    dQ = frobenius(found.Q - reference.Q[:, found.runs])
    dV = norm(found.V - reference.V[:, found.runs])
    largest: Array = np.maximum(dQ, dV).max(axis=-1)
    return largest
