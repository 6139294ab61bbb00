"""States at which code is judged, and the terms in which it differs."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from eqt_cli.base.arrays import Array, Arrays, apply_matrix, least_squares
from eqt_cli.base.reporting import fixed
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.inertia import Inertia
from eqt_cli.components.laws import Controller, Family, Frame
from eqt_cli.components.mechanics import Gains, LawInput
from eqt_cli.loop.closed_loop import ClosedLoop, known_force
from eqt_cli.numbers.leaves import with_fields

# The states at which code is judged: drawn from strata, and searched for where code decides -------
#
# The search starts where a comparison in the code had one outcome, follows the slope of left −
# right to the other one, and draws more states there.


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
        inputs = self.inputs.mapped(lambda _: next(others))
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


@dataclass(frozen=True)
class OutcomeSearch:
    """Searches states with an outcome of a decision that no state has had.

    Attributes
    ----------
    watch
        Evaluates the code.
    """

    loop: ClosedLoop
    watch: Callable[[States], Watched]
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
            near = self.moved(again, self._any_steps(again))
            is_there = self.watch(near).outcomes[:, decision] & outcome
            rare = States.joined([rare, near.of(np.flatnonzero(is_there))])
        return rare.of(slice(RARE))

    def _crossed(self, states: States, seen: Watched, decision: int, outcome: int) -> States:
        """Follow the slope of a comparison until it has the other outcome."""
        reached = np.flatnonzero(seen.outcomes[:, decision])
        nearest = reached[np.argsort(np.abs(seen.apart[reached, decision]), kind="stable")]
        x = states.of(np.unique([*nearest[:STARTS], *self.random.permutation(reached)[:STARTS]]))
        for _ in range(STEPS):
            here = self.watch(x).apart[:, decision]
            k = self.axes(x)
            steps = np.tile(SHORT * np.eye(k), (x.rows, 1))
            seen = self.watch(self.moved(x.of(np.repeat(np.arange(x.rows), k)), steps))
            beside = np.where(seen.outcomes[:, decision] > 0, seen.apart[:, decision], np.nan)
            slope = np.nan_to_num((beside.reshape(-1, k) - here[:, None]) / SHORT)
            square = (slope * slope).sum(axis=-1, keepdims=True)
            newton = -here[:, None] * slope / np.where(square > 0, square, 1.0)
            straight = [length * newton for length in LENGTHS]
            steps = np.stack([*straight, *(self._any_steps(x) for _ in range(3))], axis=1)
            count = steps.shape[1]
            tried = self.moved(x.of(np.repeat(np.arange(x.rows), count)), steps.reshape(-1, k))
            seen = self.watch(tried)
            outcomes = seen.outcomes[:, decision]
            if (outcomes & outcome).any():
                return tried.of(np.flatnonzero(outcomes & outcome))
            far = np.where(outcomes > 0, np.abs(seen.apart[:, decision]), np.inf)
            best = far.reshape(-1, count).argmin(axis=1) + count * np.arange(x.rows)
            better = far[best] < np.abs(here)
            x = States.joined([x.of(~better), tried.of(best[better])])
        return x.of(slice(0))

    def axes(self, states: States) -> int:
        return 1 + 5 * self.loop.group.dimension + sum(part[0].size for part in states.parts[6:])

    def _any_steps(self, states: States) -> Array:
        """Return steps of any size in any direction, some along one axis."""
        shape = states.rows, self.axes(states)
        steps = self.random.standard_normal(shape)
        steps *= 10.0 ** self.random.uniform(-9, 0, (shape[0], 1))
        one = self.random.integers(shape[1], size=(shape[0], 1)) == np.arange(shape[1])
        return np.where((self.random.random((shape[0], 1)) < 0.5) & ~one, 0.0, steps)

    def moved(self, states: States, by: Array) -> States:
        """Return states moved by steps of t, Q, V, Q_d, V_d, V̇_d and the memory."""
        G, (t, Q, V, Qd, Vd, Vd_dot, *more) = self.loop.group, states.parts
        lengths = [1, *[G.dimension] * 5, *(part[0].size for part in more)]
        dt, q, v, qd, vd, vd_dot, *moves = np.split(by, np.cumsum(lengths)[:-1], axis=-1)
        moved = [part + dz.reshape(part.shape) for part, dz in zip(more, moves, strict=True)]
        if not isinstance(self.loop.inertia, Inertia):
            dt = 0 * dt
        # The steps of a pose are at most 1 long.
        q, qd = (x / np.maximum(1.0, np.linalg.norm(x, axis=-1, keepdims=True)) for x in (q, qd))
        turned, desired = Q @ G.exp(q), Qd @ G.exp(qd)
        rest = [turned, V + v, desired, Vd + vd, Vd_dot + vd_dot, *moved]
        return states.with_parts([t + dt[:, 0], *rest])


# Explains the torque of code in C by the parts of a law -------------------------------------------
#
# No formula of a law is written here. A part is the difference between two evaluations of the law:
# with and without a gain, an acceleration or a weight of the family. If the torque in C differs
# from the law, least squares over these parts explain the difference. Of a cascade, the push is
# explained first, and then the torque as that of the attitude law, whose V_d and V̇_d are Ω_c and
# Ω̇_c.


class Tolerance(NamedTuple):
    """Largest unexplained share of a torque, and least difference of a coefficient that counts."""

    left: float
    changed: float


COARSE = {"double": Tolerance(1e-9, 1e-7), "float": Tolerance(1e-4, 1e-3)}
"""For a complete explanation, with many roundings, as in the inverse of a sine."""

FINE = {"double": Tolerance(1e-13, 1e-12), "float": Tolerance(5e-5, 5e-5)}
"""For a small difference: some 500 roundings, whose unit is 2²⁹ times as large in float."""

ENOUGH = 60
"""Number of states used; each gives an equation per torque entry, for about a dozen unknowns."""

ASSUMED = 1.5
"""Cost of an assumed mistake, in units of a changed coefficient."""

VANISHES = 1e-12
"""Size relative to the torque below which a part is 0 on this group or with these gains."""


@dataclass(frozen=True)
class Question:
    """A law and the states at which its torque is computed.

    Attributes
    ----------
    loop
        The loop, with the law as a formula.
    inputs, memory
        Inputs and memory of the law, one row per state.
    adapted
        Whether the law reads its inputs in other frames or orders.
    """

    loop: ClosedLoop
    inputs: LawInput
    memory: Arrays
    adapted: bool = False

    def torque(
        self,
        *,
        law: Controller | None = None,
        inputs: LawInput | None = None,
        K: float = 1.0,
        K_d: float = 1.0,
        memory: Arrays | None = None,
    ) -> Array:
        """Return the torque of this or another law with scaled gains, ``(rows, m)``."""
        loop, inputs, law = self.loop, inputs or self.inputs, law or self.loop.controller
        gains = Gains(K * loop.gains.K, K_d * loop.gains.K_d)
        memory, names = self.memory if memory is None else memory, law.memory(loop.group)
        states = {name: z for name, z in memory.items() if name in names}
        with np.errstate(all="ignore"):
            force = known_force(loop, inputs.t, inputs.pose)
            s = inputs.tracking(loop.group, loop.inertia, gains, states, force)
            torque, _ = law.answer(s, loop.period)
        return s.command(torque) + 0.0 * inputs.velocity

    def of(self, where: Array) -> Question:
        """Return the question at some of the states."""
        return Question(self.loop, *States(self.inputs, dict(self.memory)).of(where))

    @property
    def forgetful(self) -> dict[str, Array]:
        """The memory set to 0."""
        return {name: 0 * values for name, values in self.memory.items()}

    @cached_property
    def frame(self) -> Frame:
        """Frame of the errors of the law."""
        return getattr(self.loop.controller, "error", "body")


# The parts ----------------------------------------------------------------------------------------

OTHERS = "all other parts of the law"
SYMMETRIC = "symmetric part of the pose error"
NOT_SKEW = " (the difference of Q_d⁻¹Q to its transpose is missing, or is of other matrices)"


LawParts = tuple[dict[str, Array], dict[str, float]]
"""The torques of the parts of a law by name, ``(rows, m)`` each, and their coefficients in it."""


def parts_of(question: Question, pose: LawInput, rest: LawInput) -> list[LawParts]:
    """Return the parts of a law for both ways to split the terms quadratic in velocities.

    Parameters
    ----------
    pose, rest
        Inputs of the stiffness, and of all other parts.
    """
    ask = question.torque
    still = rest.zeroed("desired_velocity", "desired_acceleration")
    stiffness = ask(inputs=pose) - ask(inputs=pose, K=0.0)
    damping = ask(inputs=rest) - ask(inputs=rest, K_d=0.0)
    of_velocity = ask(inputs=still) - ask(inputs=still, K_d=0.0)
    basic = {
        "stiffness": stiffness,
        "damping": of_velocity,
        "damping of the desired velocity": damping - of_velocity,
        "desired acceleration": ask(inputs=rest) - ask(inputs=rest.zeroed("desired_acceleration")),
    }
    if question.loop.known_forces:
        blind = replace(question, loop=replace(question.loop, known_forces=()))
        basic[KNOWN] = ask(inputs=rest) - blind.torque(inputs=rest)
    for name in question.memory:
        without = dict(question.memory) | {name: 0 * question.memory[name]}
        basic[name] = ask(inputs=rest) - ask(inputs=rest, memory=without)
    whole = basic["stiffness"] + ask(inputs=rest, K=0.0)
    return [_fitted(whole, basic, moving) for moving in _quadratic(question, rest)]


def _quadratic(question: Question, inputs: LawInput) -> list[dict[str, Array]]:
    """Return two splits of the terms quadratic in velocities, from the weights of the family."""
    unpushed = inputs.zeroed("desired_acceleration")
    nothing = question.forgetful

    def family(at: LawInput, **weights: float) -> Array:
        weighted = {"gyroscopic": 0.0, "transport": 0.0, **weights}
        law = Family(**weighted, error=question.frame)  # type: ignore[arg-type]  # floats only
        return question.torque(law=law, inputs=at, K=0.0, K_d=0.0, memory=nothing)

    def weighed(name: str, at: LawInput = unpushed) -> Array:
        return family(at, **{name: 1.0}) - family(at)

    of_reference = weighed("quadratic", unpushed.zeroed("velocity"))
    of_body = weighed("quadratic", unpushed.zeroed("desired_velocity"))
    g, c, n, q = map(weighed, ("gyroscopic", "transport", "connection", "quadratic"))
    return [
        {
            "gyroscopic": of_body,
            "transport": n,
            "gyroscopic of the desired velocity": of_reference,
            "gyroscopic, body with desired velocity": g + of_reference,
            "gyroscopic, desired velocity with body": c + of_reference,
        },
        {
            "gyroscopic (weight g)": g,
            "transport (weight c)": c,
            "connection (weight n)": n,
            "quadratic (weight q)": q,
            "driving torque": of_reference,
        },
    ]


def _fitted(torque: Array, basic: dict[str, Array], moving: dict[str, Array]) -> LawParts:
    """Find the coefficients of the parts in a law; the remainder becomes a further part."""
    scale = np.abs(torque).max()
    columns = {
        name: column
        for name, column in (basic | moving).items()
        if np.abs(column).max() > VANISHES * scale
    }
    expected = dict.fromkeys(basic.keys() & columns.keys(), 1.0)
    rest = torque - sum((columns[name] for name in basic if name in columns), 0 * torque)
    fitted = least_squares({name: columns[name] for name in moving if name in columns}, rest)
    for name, value in fitted.items():
        nearest = round(value * 2) / 2  # a multiple of one half, or a weight that the user set
        expected[name] = nearest if abs(value - nearest) < COARSE["double"].changed else value
        if expected[name] < 0:  # reported as "1.00 of 1"
            columns[name], expected[name] = -columns[name], -expected[name]
    left = rest - sum((expected[n] * columns[n] for n in fitted), 0 * torque)
    if np.abs(left).max() > COARSE["double"].left * scale:
        columns[OTHERS], expected[OTHERS] = left, 1.0
    return columns, expected


# Limits that follow a law -------------------------------------------------------------------------


SAME, REPEATED = 1e-9, 8
"""Share by which rounding moves a limit, and number of states that have it; no torque else has."""


class Limit(NamedTuple):
    """What may follow a law.

    Attributes
    ----------
    words
        The limit in words, which may ask for the width of a dead zone.
    passes : (states, m)
        Whether the torque of the law passes it.
    of
        Returns what becomes of a torque; its second argument is what the code has.
    before : (states, m)
        The last torque, from which that of a limited rate is counted; else 0.
    """

    words: str
    passes: Array
    of: Callable[[Array, Array], Array]
    before: Array

    def after(self, law: Array, torque: Array) -> Array:
        """Return what becomes of the torque of a law, where the code has `torque`."""
        return self.before + self.of(law - self.before, torque - self.before)


def limits(
    G: MatrixLieGroup, torque: Array, last: Iterable[Array] = (), period: float = 1.0
) -> list[Limit]:
    """Return the limits of which a torque has signs, and no limit.

    `last` is what the memory has that may be the last torque.
    """
    nothing, signs, zero = 0 * torque, list[Limit](), torque == 0

    def held(sizes: Array) -> Array:
        least, most = np.nanmin(sizes, axis=0), np.nanmax(sizes, axis=0)
        at = np.abs(sizes - most) <= SAME * np.abs(most)
        return at & (at.sum(axis=0) >= REPEATED) & (least < most)

    for before in (nothing, *last):
        y, per = (torque, 1.0) if before is nothing else (torque - before, period)
        words = "is clipped to {}" if before is nothing else "is limited in rate to {}/s"
        above, below = held(y), held(-y)
        high = np.where(above.any(axis=0), np.nanmax(y, axis=0), np.inf)
        low = np.where(below.any(axis=0), np.nanmin(y, axis=0), -np.inf)
        words = words.format(_spans(G, low / per, high / per))
        clip = partial(lambda low, high, x, _: np.clip(x, low, high), low, high)
        signs.append(Limit(words, ~(above | below), clip, before))
    if zero.sum() >= REPEATED:
        least = np.where(zero, np.inf, np.abs(torque) * (1 - SAME)).min(axis=0)
        least = np.where(zero.any(axis=0) & torque.any(axis=0), least, 0.0)
        words = f"has a dead zone of at most {_spans(G, -least, least)}"
        zone = Limit(words, ~zero, lambda x, _: np.where(np.abs(x) < least, 0.0, x), nothing)
        words = "has a dead zone of ±{:.4g}, beyond which the torque begins at 0"
        signs += [zone, Limit(words, ~zero, _shifted, nothing)]
    signs = [x for x in signs if ENOUGH <= x.passes.sum() < x.passes.size]
    return [*signs, Limit("", np.ones_like(zero), lambda x, _: x, nothing)]


def _shifted(x: Array, y: Array) -> Array:
    width = np.median(np.abs(x - y)[y != 0])
    return x - np.clip(x, -width, width)


def _spans(G: MatrixLieGroup, low: Array, high: Array) -> str:
    """Describe intervals of the entries of a torque."""
    units = [part.force_unit for part in G.parts for _ in range(G.dimension)[part.axes]]
    spans = [f"{a:.3g} to {b:.3g} {unit}" for a, b, unit in zip(low, high, units, strict=True)]
    spans = [re.sub(r"-(\S+) to \1 ", r"±\1 ", span) for span in spans]
    free = ("±inf ", "±0 ")
    axes = [f"{x} on axis {k}" for k, x in enumerate(spans, 1) if not x.startswith(free)]
    return ", ".join(axes) if len({*spans}) > 1 else spans[0]


# Explanation of code ------------------------------------------------------------------------------


@dataclass(frozen=True)
class TorqueExplanation:
    """A torque in C as a sum of the parts of a law.

    Attributes
    ----------
    assumed
        Assumed mistake of the code in words; "" if none is assumed.
    coefficients
        Coefficient of each part in the code, and in the law.
    left
        Unexplained share of the torque.
    tolerance
        What counts of both.
    limit
        The limit that follows, in words; "" if none does.
    """

    assumed: str
    coefficients: dict[str, tuple[float, float]]
    left: float
    tolerance: Tolerance
    limit: str = ""

    @property
    def is_complete(self) -> bool:
        """Whether only rounding is left unexplained."""
        return self.left <= self.tolerance.left

    @property
    def changed(self) -> dict[str, tuple[float, float]]:
        """Parts whose coefficients in the code and in the law differ."""
        return {
            name: (fitted, expected)
            for name, (fitted, expected) in self.coefficients.items()
            if abs(fitted - expected) > self.tolerance.changed * max(1.0, abs(expected))
        }

    @property
    def cost(self) -> float:
        """Cost of the explanation; the smaller, the simpler."""
        return len(self.changed) + (ASSUMED if self.assumed else 0.0)

    @property
    def words(self) -> str:
        """Description of the differences and of the equal parts."""
        if not self.is_complete:
            share = f"{100 * self.left:.2g} % of the torque"
            return f"no sum of the law's parts in any frame: {share} is none of them"
        lacking, others = [], []
        for name, (fitted, expected) in self.changed.items():
            # As many decimal places as tell it from 0 and from what is expected.
            apart = min(abs(fitted) or 1.0, abs(fitted - expected))
            shown = fixed(fitted, max(2, -math.floor(math.log10(apart) + 1e-9)))
            words = f"{name}: coefficient {shown} of {expected:g}"
            if abs(fitted) <= 10 * self.tolerance.changed:
                lacking.append(f"{name}: coefficient 0.00 of {expected:g}")
            elif name == SYMMETRIC:
                others.append(f"has {words}{NOT_SKEW}")
            elif expected and abs(fitted + expected) < 0.005 * abs(expected):
                others.append(f"has {words} (the sign is wrong)")
            else:
                others.append(f"has {words}")
        sentences = [self.assumed] if self.assumed else []
        if lacking:
            sentences.append(f"lacks {', '.join(lacking)}")
        sentences += [*others, self.limit] if self.limit else others
        same = [n for n, (_, e) in self.coefficients.items() if n not in self.changed and e]
        if same and self.changed:
            sentences.append(f"the same as in the law: {', '.join(same)}")
        return "; ".join(sentences)


def explained(
    question: Question, torque: Array, real: str, signs: Sequence[Limit] = ()
) -> TorqueExplanation:
    """Return the complete explanation of a torque in C with the smallest cost.

    If none is complete, return the one that leaves the smallest share unexplained. One that says
    nothing is made again, finely.

    Parameters
    ----------
    signs
        What `limits` returns of the torque.
    """
    explanations: list[TorqueExplanation] = []
    cheapest = None
    for limit in signs or limits(question.loop.group, torque)[-1:]:
        few, y, here = _few(question, torque, limit)
        for assumed, changed, pose, rest in assumptions(few):
            symmetric = _symmetric(changed)
            is_large = np.abs(symmetric).max() > COARSE["double"].left * np.abs(y).max()
            for columns, expected in parts_of(changed, pose, rest):
                if is_large:
                    columns[SYMMETRIC], expected[SYMMETRIC] = symmetric, 0.0
                explanations.append(in_parts((columns, expected), y, COARSE[real], assumed, here))
            complete = (x for x in explanations if x.is_complete)
            cheapest = min(complete, key=lambda x: x.cost, default=None)
            if cheapest and cheapest.cost <= ASSUMED:  # any other explanation assumes more
                break
        if cheapest:
            return cheapest if cheapest.words else explained_finely(question, torque, real)
    # An assumed mistake must at least halve the remainder.
    return min(explanations, key=lambda x: x.left * (2.0 if x.assumed else 1.0))


def explained_finely(question: Question, torque: Array, real: str) -> TorqueExplanation:
    """Return the explanation of a small difference, in the parts of the law alone."""
    few, y, limit = _few(question, torque, limits(question.loop.group, torque)[-1])
    parts = parts_of(few, few.inputs, few.inputs)
    return min((in_parts(x, y, FINE[real], "", limit) for x in parts), key=lambda x: x.left)


def _few(question: Question, torque: Array, limit: Limit) -> tuple[Question, Array, Limit]:
    """Return some states: those where a limit passes most, and others where it does not."""
    usable = np.flatnonzero(np.isfinite(torque + question.torque()).all(axis=1))
    rows = usable[np.argsort(-limit.passes[usable].sum(axis=1), kind="stable")]
    rows = np.r_[rows[:ENOUGH], usable[~limit.passes[usable].all(axis=1)][:ENOUGH]]
    here = limit._replace(passes=limit.passes[rows], before=limit.before[rows])
    return question.of(rows), torque[rows], here


def in_parts(
    parts: LawParts, torque: Array, tolerance: Tolerance, assumed: str = "", limit: Any = None
) -> TorqueExplanation:
    """Return a torque in C as a sum of parts, by least squares where a limit passes it."""
    columns, expected = parts
    passes, words = (limit.passes, limit.words) if limit else (1.0, "")
    law = sum((expected[n] * column for n, column in columns.items()), 0 * torque)
    zone = {"": np.sign(torque)} if "{" in words else {}
    passed = {name: passes * column for name, column in (columns | zone).items()}
    more = least_squares(passed, passes * (torque - law))
    words = words.format(-more.pop("", 0.0))
    law = law + sum((more[n] * column for n, column in columns.items()), 0 * torque)
    left = torque - (limit.after(law, torque) if limit else law)
    scale = np.sqrt((torque**2).mean()) or 1.0
    coefficients = {name: (expected[name] + more[name], expected[name]) for name in columns}
    return TorqueExplanation(
        assumed, coefficients, float(np.sqrt((left**2).mean()) / scale), tolerance, words
    )


def _symmetric(question: Question) -> Array:
    """Return the stiffness torque of the symmetric part of the pose error.

    It appears if the code does not subtract the transpose, or subtracts a wrong one.
    """
    G, inputs = question.loop.group, question.inputs
    error = G.inverse(inputs.desired_pose) @ inputs.pose
    basis = np.stack([G.hat(row) for row in np.eye(G.dimension)])
    rotates = np.array([np.allclose(B, -B.T) for B in basis])
    even = (error + error.swapaxes(-1, -2)) / 2
    entries = np.einsum("kij,nij->nk", np.abs(basis), even) / 2 * rotates
    stiffness = inputs.tracking(G, question.loop.inertia, question.loop.gains, {}).stiffness
    return -apply_matrix(stiffness, entries)


# Typical mistakes: frames, transposes, axes, units, options ---------------------------------------


Assumption = tuple[str, Question, LawInput, LawInput]
"""A mistake in words, "" for none; the law that the code then follows, the inputs of its stiffness,
and the inputs of all other parts."""


def assumptions(question: Question) -> Iterator[Assumption]:
    """Yield no mistake first, and then the known mistakes in code of a law."""
    inputs = question.inputs
    yield "", question, inputs, inputs
    yield from _of_frames(question)
    for words, faulty in _everywhere(question).items():
        yield words, question, faulty, faulty
    for words, changed in _other_laws(question):
        yield words, changed, inputs, inputs


def _of_frames(question: Question) -> Iterator[Assumption]:
    """Yield pose errors in the other frame, and desired velocities in a wrong frame or axis."""
    G, inputs = question.loop.group, question.inputs
    Q, Qd = inputs.pose, inputs.desired_pose
    Q_L = G.inverse(Qd) @ Q
    if question.frame == "body":
        exchanged, named = inputs._replace(pose=Qd @ Q @ G.inverse(Qd)), "Q Q_d⁻¹ for Q_d⁻¹Q"
        carrying = {
            "is not carried to the body frame": Q_L,
            "is carried the wrong way, by Q_d⁻¹Q for Q⁻¹Q_d": Q_L @ Q_L,
        }
    else:
        exchanged, named = inputs._replace(pose=G.inverse(Qd) @ Q @ Qd), "Q_d⁻¹Q for Q Q_d⁻¹"
        carrying = {"is carried to the body frame": G.inverse(Q_L)}
    frames = f"the frames are exchanged: the pose error is in the other frame, {named}"
    yield f"{frames}, wherever it occurs", question, exchanged, exchanged
    variants = {"": inputs}
    for words, by in carrying.items():
        both = _carried(question, inputs, by)
        variants[f"V_d {words}"] = both
        for name, alone in {"velocity": "V_d (not V̇_d)", "acceleration": "V̇_d (not V_d)"}.items():
            one = {f"desired_{name}": getattr(both, f"desired_{name}")}
            variants[f"{alone} {words}"] = inputs._replace(**one)
    for words, rest in variants.items():
        yield f"{frames}; {words}" if words else frames, question, exchanged, rest
        if words:
            yield words, question, inputs, rest
    for axis, unit in enumerate(np.eye(G.dimension) if G.dimension > 1 else ()):
        read = inputs._replace(
            desired_velocity=unit * inputs.desired_velocity,
            desired_acceleration=unit * inputs.desired_acceleration,
        )
        alone = f"V_d is read on axis {axis + 1} only"
        yield alone, question, inputs, read
        for words, by in carrying.items():
            yield f"{alone}; V_d {words}", question, inputs, _carried(question, read, by)


def _carried(question: Question, inputs: LawInput, by: Array) -> LawInput:
    """Return the inputs with desired velocity and acceleration in another frame."""
    G = question.loop.group
    return inputs._replace(
        desired_velocity=G.Ad(by, inputs.desired_velocity),
        desired_acceleration=G.Ad(by, inputs.desired_acceleration),
    )


def _everywhere(question: Question) -> dict[str, LawInput]:
    """Return the inputs with a value that the code reads wrongly everywhere."""
    G, inputs = question.loop.group, question.inputs
    Q, Qd, V = inputs.pose, inputs.desired_pose, inputs.velocity
    turned, desired = G.inverse(Q), G.inverse(Qd)
    return {
        "the pose is transposed": inputs._replace(pose=turned),
        "the desired pose is transposed": inputs._replace(desired_pose=desired),
        "both poses are transposed": inputs._replace(pose=turned, desired_pose=desired),
        "the pose and the desired pose are exchanged": inputs._replace(pose=Qd, desired_pose=Q),
        "V is carried to the spatial frame": inputs._replace(velocity=G.Ad(Q, V)),
        "V is carried from the spatial frame": inputs._replace(velocity=G.Ad(turned, V)),
        "V is converted to degrees": inputs._replace(velocity=np.degrees(V)),
        "V is converted from degrees": inputs._replace(velocity=np.radians(V)),
    }


def _other_laws(question: Question) -> Iterator[tuple[str, Question]]:
    """Yield the law with transposed gains, another frame, a missing option or later memory."""
    loop, law = question.loop, question.loop.controller
    for name, key in {"K": "kp", "K_d": "kd"}.items():
        tensor = getattr(loop.gains, name)
        turned = tensor.swapaxes(-1, -2)
        if np.any(turned != tensor):
            gains = replace(loop.gains, **{name: turned})
            yield f"{key} is transposed", _with(question, gains=gains)
    if isinstance(law, Family):
        frame: Frame = "body" if law.error == "spatial" else "spatial"
        weights = law.gyroscopic, law.transport, law.connection
        other = Family(*weights, error=frame, quadratic=law.quadratic)
        words = f"the frames are exchanged: all errors are in the {frame} frame"
        yield words, _with(question, controller=other)
    for field in fields(law):  # optional ones, such as the bound of an integral
        if field.init and field.default is None and getattr(law, field.name) is not None:
            without = replace(law, **{field.name: None})
            yield f"the option {field.name} is missing", _with(question, controller=without)
    if question.memory and loop.period:
        s = question.inputs.tracking(loop.group, loop.inertia, loop.gains, question.memory)
        rates = law.memory_rate(s)
        later = {name: z + loop.period * rates[name] for name, z in question.memory.items()}
        words = "memory advances before it is used, not after"
        yield words, replace(question, memory=later)


def _with(question: Question, **changes: Any) -> Question:
    return replace(question, loop=replace(question.loop, **changes))


RATES = {
    "none": "Ω_c and Ω̇_c are 0",
    "heading": "Ω_c and Ω̇_c are those of the heading",
    "reference": "Ω_c and Ω̇_c are those of the reference",
}
"""What code often has in place of the rates of the commanded attitude."""

NAMES = {"desired velocity": "Ω_c", "desired acceleration": "Ω̇_c"}
"""What the attitude law reads, by its names in a cascade."""

KNOWN = "known forces, such as gravity"


def explained_cascade(question: Question, wrench: Array, real: str) -> str:
    """Describe how the wrench of code differs from the cascade's."""
    finite = np.isfinite(wrench).all(axis=1) & np.isfinite(question.torque()).all(axis=1)
    usable = np.flatnonzero(finite)[:ENOUGH]
    few, wrench = question.of(usable), wrench[usable]
    push = _of_push(few, wrench, real)
    shares = {name: share for name, (share, _) in push.coefficients.items()}
    said, near = push.words, COARSE[real].changed
    others = [share for name, share in shares.items() if name != KNOWN]
    if said and push.is_complete and np.ptp(others) < near < abs(others[0] - 1.0):
        said = f"mass: coefficient {others[0]:.2f} of 1"
        if KNOWN in shares and abs(shares[KNOWN] - others[0]) > near:
            said += f", and of {KNOWN}: {shares[KNOWN]:.2f}"
    words = [f"push: {said}"] if said else []
    changed = _with_force(few, shares, near) if push.is_complete else None
    if changed is None:
        return "; ".join([*words, "the torque was not compared"])
    cascade: Any = changed.loop.controller
    inputs, laws = changed.inputs, {"": cascade}
    for rates, assumed in RATES.items():
        if rates != cascade.rates and (rates != "heading" or inputs.heading is not None):
            laws[assumed] = with_fields(cascade, rates=rates)
    candidates = []
    for assumed, law in laws.items():
        loop = replace(changed.loop, controller=law)
        s = inputs.tracking(loop.group, loop.inertia, loop.gains, changed.memory)
        read, turns = law.commanded(s).tracking, loop.group.parts[0].axes
        attitude = Question(loop.inside, LawInput.of(read), read.memory)
        torque = wrench[:, turns] - (law.torque(s)[:, turns] - law.inner.torque(read))
        explanation = explained(attitude, torque, real)
        cost = explanation.cost + (ASSUMED if assumed else 0.0)
        cost = cost if explanation.is_complete else np.inf
        candidates.append((cost, "; ".join(filter(None, [assumed, explanation.words]))))
    of_torque = min(candidates, key=lambda candidate: candidate[0])[1]
    for name, symbol in NAMES.items():
        of_torque = of_torque.replace(name, symbol)
    if of_torque:
        words.append(f"torque: {of_torque}")
    return "; ".join(words)


def _of_push(question: Question, wrench: Array, real: str) -> TorqueExplanation:
    """Return the push as a sum of the parts of F·b."""
    law: Any = question.loop.controller
    moves = question.loop.group.parts[1].axes
    without = {KNOWN: with_fields(law, known_forces=())}
    outer, gains = law.position, {"position error": "kx", "velocity error": "kv", "integral": "ki"}
    if outer.limit is None:
        for name, key in gains.items():
            if getattr(outer, key) is not None:
                without[name] = with_fields(law, position=with_fields(outer, **{key: 0.0}))
    else:
        still = with_fields(outer, kx=0.0, kv=0.0, ki=None)
        without["position feedback"] = with_fields(law, position=still)
    whole = question.torque()[:, moves]
    columns = {name: whole - question.torque(law=x)[:, moves] for name, x in without.items()}
    columns["desired acceleration"] = whole - sum(columns.values())
    least = VANISHES * np.abs(whole).max()
    columns = {name: column for name, column in columns.items() if np.abs(column).max() > least}
    return in_parts((columns, dict.fromkeys(columns, 1.0)), wrench[:, moves], COARSE[real])


def _with_force(question: Question, shares: dict[str, float], near: float) -> Question | None:
    """Return the law with the F of code: another mass, or no known forces; None for any other."""
    share, others = shares.get(KNOWN), [x for name, x in shares.items() if name != KNOWN]
    if np.ptp(others) > near:
        return None
    mass, loop = others[0], question.loop
    if share is None or abs(share - mass) < near:  # F has the same direction
        return question
    if abs(share) < near:
        return _with(question, controller=with_fields(loop.controller, known_forces=()))
    if abs(share - 1.0) > near or not isinstance(loop.inertia, Inertia):
        return None
    scale = np.ones(loop.group.dimension)
    scale[loop.group.parts[1].axes] = mass
    inertia = Inertia(loop.inertia.matrix * scale, loop.inertia.inverse / scale)
    return _with(question, inertia=inertia)
