"""The states at which an exported law is checked: states of runs, and random ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from eqt_cli.closed_loop.law_input import LawInput
from eqt_cli.closed_loop.law_program import MEMORY, TOLD, LawProgram
from eqt_cli.core.arrays import Array, norm
from eqt_cli.core.errors import EqtError
from eqt_cli.ensemble.seeds import Stream, generator
from eqt_cli.execution.batches import batches
from eqt_cli.experiment.experiment import Experiment
from eqt_cli.experiment.study import Study
from eqt_cli.groups import MatrixLieGroup

RUNS = 20
"""Number of runs of a law that are integrated, unless there are fewer."""

RANDOM = 1000
"""Number of random states beside the states of the runs."""

HALF_TURNS = 100
"""Number of random states 1e-2 to 1e-16 rad from a half turn, where a group has such."""


@dataclass(frozen=True)
class States:
    """The inputs and the memory of a law at many states.

    Attributes
    ----------
    inputs
        ``(states, length)`` for each group of inputs that varies.
    runs
        Number of runs.
    along
        Number of states from runs; the others are random.
    """

    inputs: Mapping[str, Array]
    runs: int
    along: int

    @property
    def count(self) -> int:
        """Number of states."""
        return len(next(iter(self.inputs.values())))

    def at(self, states: Array | slice) -> dict[str, Array]:
        """Return the inputs at some states."""
        return {name: values[states] for name, values in self.inputs.items()}


def states_of(experiment: Experiment, label: str, law: LawProgram, workers: int = 1) -> States:
    """Return the states of a law in the first runs of an experiment, and random ones of that size.

    Raises
    ------
    EqtError
        If all of these runs fail.
    """
    config = experiment.config
    runs = min(RUNS, config.ensemble.runs)
    ensemble = config.ensemble.model_copy(update={"runs": runs})
    few = replace(experiment, config=config.model_copy(update={"ensemble": ensemble}))
    [batch] = batches(Study(None, few), label, np.arange(runs))
    solution = batch.engine.solve(batch.problem, workers)
    good = np.flatnonzero(solution.status == 0)
    if not len(good):
        raise EqtError(
            f"{label}: all of the first {runs} runs fail, so that there is no state to check the "
            f"exported law at: {solution.messages[0]}"
        )
    problem = batch.problem.select(good)
    loop, states = problem.batched_loop(extra_axes=1), solution.states[good]
    with np.errstate(all="ignore"):
        told, memory = loop.told(problem.times, states), loop.memory(states)
    told = told._replace(t=np.broadcast_to(problem.times, states.shape[:2]))
    given = _rows(law, told, memory, states.shape[:2])
    random = generator(config.ensemble.seed, Stream.EXPORTED_STATES, list(few.loops).index(label))
    count = len(next(iter(given.values())))
    drawn = _random(given, loop.group, random)
    inputs = {name: np.concatenate([values, drawn[name]]) for name, values in given.items()}
    return States(inputs, len(good), count)


def _rows(
    law: LawProgram, told: LawInput, memory: Mapping[str, Array], batch: tuple[int, ...]
) -> dict[str, Array]:
    found = {
        TOLD + entry.name: np.broadcast_to(getattr(told, entry.source), (*batch, *entry.shape))
        for entry in law.told
    }
    found |= {MEMORY + entry.name: memory[entry.source] for entry in law.memory}
    rows = {name: np.array(values).reshape(np.prod(batch), -1) for name, values in found.items()}
    finite = np.logical_and.reduce([np.isfinite(values).all(axis=1) for values in rows.values()])
    return {name: values[finite] for name, values in rows.items()}


def _random(
    given: Mapping[str, Array], G: MatrixLieGroup, random: np.random.Generator
) -> dict[str, Array]:
    """Return states with any error of the pose, and all else as large as in the runs."""
    chosen = random.integers(0, len(given[f"{TOLD}t"]), RANDOM)
    errors = random.standard_normal((RANDOM, G.dimension))
    for part in G.parts:
        if part.turns:
            turn = errors[:HALF_TURNS, part.axes]
            angle = np.pi - 10.0 ** random.uniform(-16, -2, (HALF_TURNS, 1))
            errors[:HALF_TURNS, part.axes] = turn * angle / norm(turn)[:, None]
    error = G.exp(errors)
    found = {}
    for name, values in given.items():
        if name in (f"{TOLD}t", f"{TOLD}desired_pose"):
            found[name] = values[chosen]
        elif name == f"{TOLD}pose":
            desired = given[f"{TOLD}desired_pose"][chosen].reshape(-1, G.size, G.size)
            found[name] = (desired @ error).reshape(RANDOM, -1)
        else:
            size = np.abs(values).max(axis=0)
            found[name] = size * random.uniform(-1, 1, (RANDOM, len(size)))
    return found
