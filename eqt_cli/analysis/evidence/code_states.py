"""The states at which code is judged: drawn from strata, and searched for where code decides.

The search starts where a comparison in the code had one outcome, follows the slope of left − right
to the other one, and draws more states there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.core.arrays import Array
from eqt_cli.mechanics.inertia import Inertia
from eqt_cli.mechanics.law_input import LawInput

STATES = 600
"""Number of states with a normal pose error and normal velocities."""

STRATUM = 150
"""Number of states of each further kind."""

SIZES = -3.0, 2.0
"""Exponents of 10 between which velocities, accelerations, pose errors and memories are scaled."""

NEAREST = -8.0
"""Exponent of 10 of the least distance to a half turn, to the start and to the horizon."""

LATEST = 4.0
"""Exponent of 10 of the latest time, in horizons."""

FARTHEST = 12.0
"""Exponent of 10 of the largest heading, rad."""

RARE = 20
"""Number of states that are wanted with each outcome of a decision."""

STARTS, STEPS = 12, 15
"""Numbers of states from which the other outcome is searched, and of steps from each."""

SHORT = 1e-6
"""Step of the differences that give the slope of a comparison."""

LENGTHS = (0.3, 1.0, 1.0 + 1e-9, 1.01, 1.5, 4.0)
"""Lengths that are tried, in those of a step that makes a linear comparison equal."""


class States(NamedTuple):
    """Inputs of a law, and its memory; a row for each state."""

    inputs: LawInput
    memory: dict[str, Array]

    @property
    def rows(self) -> int:
        """The number of states."""
        return len(self.inputs.velocity)

    @property
    def parts(self) -> list[Array]:
        """The parts of the inputs that there are, and of the memory."""
        inputs = [np.asarray(part) for part in self.inputs if part is not None]
        return [*inputs, *self.memory.values()]

    def with_parts(self, parts: Iterable[Array]) -> States:
        """Return states with other parts, in the order of `parts`."""
        others = iter(parts)
        inputs = self.inputs.each(lambda _: next(others))
        return States(inputs, dict(zip(self.memory, others, strict=True)))

    def of(self, where: Any) -> States:
        """Return some of the states."""
        return self.with_parts(part[where] for part in self.parts)

    def not_finite(self) -> States:
        """Return the first state with NaN, and with infinity, in every part in turn."""
        rows = [(k, bad) for k in range(len(self.parts)) for bad in (np.nan, np.inf)]
        parts = [np.repeat(part[:1].astype(float), len(rows), axis=0) for part in self.parts]
        for row, (k, bad) in enumerate(rows):
            parts[k][row] = bad
        return self.with_parts(parts)

    @classmethod
    def joined(cls, several: Sequence[States]) -> States:
        """Return the states of several."""
        parts = zip(*(states.parts for states in several), strict=True)
        return several[0].with_parts(map(np.concatenate, parts))


def drawn_states(loop: ClosedLoop, horizon: float, random: np.random.Generator) -> States:
    """Draw states and memory, with a moving reference.

    The first `STATES` are normal. Of the others, `STRATUM` each have velocities and accelerations
    of any size, pose errors of any size, a pose error near a half turn, a memory of any size, no
    error or no motion, and times next to the start, next to the horizon, or late. Times are within
    the horizon for an inertia that is prescribed over time.
    """
    G, m, formula = loop.group, loop.group.dimension, loop.controller.formula
    flat = loop.reference.flat_output(G, 0.0) if loop.controller.reads_flat_output else None
    moves = 0.0 if formula is not None and formula.tasks == ("stabilise",) else 1.0

    def power(low: float, high: float, shape: tuple[int, ...] = (STRATUM, 1)) -> Array:
        return 10.0 ** random.uniform(low, high, shape)

    def normal(count: int) -> States:
        Q, Qd = G.exp(random.standard_normal((2, count, m)))
        V, Vd, Vd_dot = random.standard_normal((3, count, m))
        t = random.uniform(0.0, horizon, count)
        lengths = loop.controller.memory(G).items()
        memory = {name: random.standard_normal((count, length)) for name, length in lengths}
        shapes = {} if flat is None else flat._asdict()
        output = {
            name: random.standard_normal((count, *part.shape))
            for name, part in shapes.items()
            if part is not None
        }
        return States(LawInput(t, Q, V, Qd, moves * Vd, moves * Vd_dot, **output), memory)

    def changed(**parts: Any) -> States:
        states = normal(STRATUM)
        parts = {name: change(getattr(states.inputs, name)) for name, change in parts.items()}
        return states._replace(inputs=states.inputs._replace(**parts))

    def wrong_by(x: Array) -> States:
        states = normal(STRATUM)
        pose = states.inputs.desired_pose @ G.exp(x)
        return states._replace(inputs=states.inputs._replace(pose=pose))

    def still(x: Array) -> Array:
        return np.where(random.random((len(x), *[1] * (x.ndim - 1))) < 0.5, 0.0, x)

    def resized(x: Array) -> Array:
        return power(*SIZES, (STRATUM, *[1] * (x.ndim - 1))) * x

    x = random.standard_normal((STRATUM, m))
    turned = np.pi * (1 - power(NEAREST, 0.0)) / np.linalg.norm(x, axis=-1, keepdims=True)
    of_motion = ["velocity", "desired_velocity", "desired_acceleration"]
    of_motion += [] if flat is None else ["position"]
    large = normal(STRATUM)
    parts = [
        normal(STATES),
        changed(**dict.fromkeys(of_motion, resized)),
        wrong_by(power(NEAREST, 1.0) * x),
        wrong_by(turned * x),
        wrong_by(0.0 * x),
        changed(**dict.fromkeys(of_motion, still)),
        large._replace(memory={name: resized(values) for name, values in large.memory.items()}),
    ]
    if flat is not None and flat.heading is not None:  # whose sine is computed in other ways
        far = np.where(np.arange(3) == 0, power(0.0, FARTHEST), 1.0)
        parts.append(changed(heading=lambda psi: far * psi))
    if isinstance(loop.inertia, Inertia):
        near = horizon * power(NEAREST, 0.0, (STRATUM,))
        parts += [
            changed(t=lambda t: np.where(t < horizon / 2, near, horizon - near)),
            changed(t=lambda t: horizon * power(0.0, LATEST, t.shape)),
        ]
    return States.joined(parts)


class Watched(NamedTuple):
    """What code does at states.

    Attributes
    ----------
    torque : (states, m)
        Its torque.
    outcomes : (states, decisions)
        1: the decision was true; 2: false; 3: both; 0: not reached.
    apart : (states, decisions)
        Left − right of a comparison, where that was nearest to 0.
    """

    torque: Array
    outcomes: Array
    apart: Array


Watch = Callable[[States], Watched]


@dataclass(frozen=True)
class OutcomeSearch:
    """Searches states with an outcome of a decision that no state has had.

    Attributes
    ----------
    watch
        Evaluates the code.
    """

    loop: ClosedLoop
    watch: Watch
    random: np.random.Generator

    def more(self, states: States, decision: int, outcome: int) -> States:
        """Return up to `RARE` states with an outcome of a decision; none if none is found."""
        seen = self.watch(states)
        there = np.flatnonzero(seen.outcomes[:, decision] & outcome)
        rare = states.of(there) if len(there) else self._crossed(states, seen, decision, outcome)
        for _ in range(3):
            if not 0 < rare.rows < RARE:
                break
            again = rare.of(self.random.integers(rare.rows, size=4 * RARE))
            near = self._moved(again, self._any_steps(again))
            is_there = self.watch(near).outcomes[:, decision] & outcome
            rare = States.joined([rare, near.of(np.flatnonzero(is_there))])
        return rare.of(slice(RARE))

    def _crossed(self, states: States, seen: Watched, decision: int, outcome: int) -> States:
        """Follow the slope of a comparison until it has the other outcome."""
        reached = np.flatnonzero(seen.outcomes[:, decision])
        nearest = reached[np.argsort(np.abs(seen.apart[reached, decision]), kind="stable")]
        others = self.random.permutation(reached)
        x = states.of(np.unique([*nearest[:STARTS], *others[:STARTS]]))
        for _ in range(STEPS):
            here = self.watch(x).apart[:, decision]
            k = self._axes(x)
            around = self._moved(_repeated(x, k), np.tile(SHORT * np.eye(k), (x.rows, 1)))
            seen = self.watch(around)
            beside = np.where(seen.outcomes[:, decision] > 0, seen.apart[:, decision], np.nan)
            slope = np.nan_to_num((beside.reshape(-1, k) - here[:, None]) / SHORT)
            square = (slope * slope).sum(axis=-1, keepdims=True)
            newton = -here[:, None] * slope / np.where(square > 0, square, 1.0)
            straight = [length * newton for length in LENGTHS]
            steps = np.stack([*straight, *(self._any_steps(x) for _ in range(3))], axis=1)
            count = steps.shape[1]
            tried = self._moved(_repeated(x, count), steps.reshape(-1, k))
            seen = self.watch(tried)
            outcomes = seen.outcomes[:, decision]
            if (outcomes & outcome).any():
                return tried.of(np.flatnonzero(outcomes & outcome))
            far = np.where(outcomes > 0, np.abs(seen.apart[:, decision]), np.inf)
            best = far.reshape(-1, count).argmin(axis=1) + count * np.arange(x.rows)
            better = far[best] < np.abs(here)
            x = States.joined([x.of(~better), tried.of(best[better])])
        return x.of(slice(0))

    def _axes(self, states: States) -> int:
        return 1 + 5 * self.loop.group.dimension + sum(part[0].size for part in states.parts[6:])

    def _any_steps(self, states: States) -> Array:
        """Return steps of any size in any direction, some along one axis."""
        shape = states.rows, self._axes(states)
        steps = self.random.standard_normal(shape)
        steps *= 10.0 ** self.random.uniform(-9, 0, (shape[0], 1))
        one = self.random.integers(shape[1], size=(shape[0], 1)) == np.arange(shape[1])
        return np.where((self.random.random((shape[0], 1)) < 0.5) & ~one, 0.0, steps)

    def _moved(self, states: States, by: Array) -> States:
        """Return states moved by steps of t, Q, V, Q_d, V_d, V̇_d and the memory."""
        G, (t, Q, V, Qd, Vd, Vd_dot, *more) = self.loop.group, states.parts
        lengths = [1, *[G.dimension] * 5, *(part[0].size for part in more)]
        dt, q, v, qd, vd, vd_dot, *moves = np.split(by, np.cumsum(lengths)[:-1], axis=-1)
        moved = [part + dz.reshape(part.shape) for part, dz in zip(more, moves, strict=True)]
        if not isinstance(self.loop.inertia, Inertia):
            dt = 0 * dt
        turned, desired = Q @ G.exp(_short(q)), Qd @ G.exp(_short(qd))
        rest = [turned, V + v, desired, Vd + vd, Vd_dot + vd_dot, *moved]
        return states.with_parts([t + dt[:, 0], *rest])


def _repeated(states: States, times: int) -> States:
    return states.of(np.repeat(np.arange(states.rows), times))


def _short(steps: Array) -> Array:
    """Return the steps of a pose, at most 1 long."""
    return steps / np.maximum(1.0, np.linalg.norm(steps, axis=-1, keepdims=True))
