"""Compares laws in C with the laws that they claim to be: rows for `eqt verify`."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from eqt_cli.analysis.certificates import Row, Verdict
from eqt_cli.analysis.exact import UNIT, lifted, value_of
from eqt_cli.base.arrays import Array
from eqt_cli.components.laws import controllers
from eqt_cli.components.mechanics import LawInput
from eqt_cli.extensions.firmware.code_evidence import (
    RARE,
    OutcomeSearch,
    Question,
    States,
    Watched,
    drawn_states,
    explained,
    explained_cascade,
    sum_of,
)
from eqt_cli.extensions.firmware.user_code import described
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.numbers.leaves import leaves, with_leaves

ALONG_RUNS = 500
"""Number of states of runs."""

BOUNDED = 24
"""Least number of states at which the bound of rounding errors is computed, which takes long."""

MOST_BOUNDED = 400
"""Most of these; they are those with the largest differences relative to the torque."""

SEARCHES = 3
"""Times that outcomes are searched; others become reachable by those that were found."""

ARRANGED = 8.0
"""Factor of the bound of eqt's formula, because the code may arrange the formula differently."""

MEMORY_ROUNDINGS = 1e3
"""Rounding errors of the largest entry of a memory that a period may add."""

ROUNDOFF = {"double": UNIT, "float": 2.0**-24}
"""Relative rounding error of one operation."""


OUTCOMES = {1: "true", 2: "false"}
"""Outcomes of a decision."""


@dataclass(frozen=True)
class Judged:
    """A law in code, and the states at which it is evaluated.

    Attributes
    ----------
    label
        Label of the law.
    loop
        The loop with the code.
    drawn
        States drawn from strata.
    along
        States of runs; None if no run is good.
    """

    label: str
    loop: ClosedLoop
    drawn: States
    along: States | None
    random: np.random.Generator

    @property
    def law(self) -> Any:
        """The law in code."""
        return self.loop.controller

    def watched(self, states: States) -> Watched:
        """Return torque and outcomes at states, from the code that keeps its outcomes."""
        loop = self.loop
        with np.errstate(all="ignore"):  # inputs may be not finite
            s = states.inputs.tracking(loop.group, loop.inertia, loop.gains, states.memory)
            return Watched(*self.law.watched(s, loop.period))

    @cached_property
    def is_watched(self) -> bool:
        """Whether the outcomes are known: the code that keeps them computes the same torques."""
        if self.law.decisions is None:
            return False
        torque, _ = self.loop.answer(*self.drawn, self.loop.period)
        calls = self.watched(self.drawn)
        return bool(calls.outcomes.any()) and np.array_equal(torque, calls.torque, equal_nan=True)

    @cached_property
    def states(self) -> States:
        """The drawn states, and those that were searched for outcomes that are rare."""
        states = self.drawn
        if not self.is_watched:
            return states
        search = OutcomeSearch(self.loop, self.watched, self.random)
        for _ in range(SEARCHES):
            outcomes, count = self.watched(states).outcomes, states.rows
            rare = [
                search.more(states, place, side)
                for place, decision in enumerate(self.law.decisions)
                for side in (OUTCOMES if not decision.is_label else (1,))
                if outcomes[:, place].any() and np.count_nonzero(outcomes[:, place] & side) < RARE
            ]
            states = States.joined([states, *rare])
            if states.rows == count:
                break
        return states

    @cached_property
    def never(self) -> list[str]:
        """What no state has reached, in words; inputs that are not finite count as states."""
        if not self.is_watched:
            return []
        decisions, unseen = self.law.decisions, []
        both = States.joined([self.states, self.states.of(slice(1)).not_finite()])
        outcomes = self.watched(both).outcomes
        had = list(zip(decisions, np.bitwise_or.reduce(outcomes).tolist(), strict=True))
        entered = {each.function for each, outcome in had if outcome}
        for decision, outcome in had:
            where = f"{decision.place}: {decision.text}"
            if decision.function not in entered and not decision.is_function:
                continue
            if not outcome:
                unseen.append(f"{where} was never reached")
            elif not decision.is_label:
                missing = (word for side, word in OUTCOMES.items() if not outcome & side)
                unseen += [f"{where} was never {word}" for word in missing]
        return unseen

    def where(self, states: States, wrong: Array) -> str:
        """Describe the states at which something is wrong, by the decisions in the code."""
        share = f"at {np.count_nonzero(wrong)} of {len(wrong)} states"
        if not wrong.any() or wrong.mean() > 0.5:
            return ""
        if self.is_watched:
            outcomes = self.watched(states).outcomes
            candidates = [
                (np.count_nonzero(seen & side), f"{decision.text} is {word} ({decision.place})")
                for decision, seen in zip(self.law.decisions, outcomes.T, strict=True)
                for side, word in OUTCOMES.items()
                if (seen[wrong] & side).all()
            ]
            count, words = min(candidates, default=(len(wrong), ""))
            if count <= 2 * np.count_nonzero(wrong):
                return f"{share}, all of them where {words}"
        first = states.of(np.flatnonzero(wrong)[:1])
        row = self.law.reading(self.loop.group, first.inputs, self.law.called.code)[0]
        return f"{share}, for example at {described(self.law.called, row)}"


def code_rows(
    label: str,
    loop: ClosedLoop,
    horizon: float,
    random: np.random.Generator,
    flown: tuple[Array, Array] | None,
) -> list[Row]:
    """Check a law that is code.

    Parameters
    ----------
    flown
        Sample times and flat states ``(runs, samples, n)`` of good runs.
    """
    drawn = drawn_states(loop, horizon, random)
    along = None
    if flown is not None and len(flown[1]):
        times, rows = flown
        run = random.integers(len(rows), size=ALONG_RUNS)
        sample = random.integers(len(times), size=ALONG_RUNS)
        flat = rows[run, sample]
        along = States(loop.law_input(times[sample], flat), dict(loop.memory(flat)))
    judged = Judged(label, loop, drawn, along, random)
    return [*_finite(judged), *_repeatable(judged), *_compared(judged)]


def answers(rows: Iterable[Row], experiment: Any) -> Iterator[dict[str, str]]:
    """Yield of each law in code whether it is the law that it claims to be, in a sentence.

    Its finding is ``is``, ``lacks`` (some terms, and nothing else is wrong), ``differs``, or
    ``undecided``.
    """
    of_code = [row for row in rows if row.kind == "code"]
    for label in dict.fromkeys(row.controller for row in of_code):
        law, said = experiment.loops[label].controller, dict[bool, list[str]]({True: [], False: []})
        for row in of_code:
            if row.controller == label and row.remark and row.verdict is not Verdict.HOLDS:
                said[row.verdict is Verdict.FAILS].append(row.remark)
        words = "; ".join(said[True] or said[False])
        words = re.sub(r": coefficient -?0\.00 of [^,;]+|; the same as in [^;]+", "", words)
        lacks = all(re.match("(push: |torque: )?lacks ", each) for each in words.split("; "))
        finding = "lacks" if lacks else "differs" if said[True] else "undecided" if words else "is"
        says = {"is": "is {}", "lacks": "is {} but {}", "differs": "differs from {}: {}"}
        answer = says.get(finding, "may be {}: {}").format(law.formula and law.formula.name, words)
        named = f"{law.code.function} in {law.file}"
        yield {"label": label, "finding": finding, "answer": f"{named} {answer}"}


# Finite torques that depend only on the inputs ----------------------------------------------------


def _finite(judged: Judged) -> Iterator[Row]:
    """Check that the torque is finite at half turns and without an error."""
    loop, G = judged.loop, judged.loop.group
    m = G.dimension
    turned = np.concatenate([G.exp(np.pi * np.eye(m)), G.exp(np.zeros((1, m)))])
    rest, still = np.broadcast_to(G.identity, turned.shape), np.zeros((m + 1, m))
    flat = (None if part is None else 0 * part[: m + 1] for part in judged.drawn.inputs[6:])
    inputs = LawInput(np.zeros(m + 1), turned, still, rest, still, still, *flat)
    memory = {name: np.zeros((m + 1, n)) for name, n in loop.controller.memory(G).items()}
    torque, _ = loop.answer(inputs, memory, loop.period)
    bad = ~np.isfinite(torque).all(axis=1)
    law = loop.controller.formula
    known: Any = np.ones_like(bad)
    if law is not None:
        formula = Question(replace(loop, controller=law), inputs, memory)
        known = np.isfinite(formula.torque()).all(axis=1)
    places = [*(f"half turn about axis {k + 1}" for k in range(m)), "no error"]
    words = [f"{places[k]}: {torque[k].tolist()}" for k in np.flatnonzero(bad)]
    if bad.any() and not known[bad].all():
        words.append("the law is not finite there either")
    verdict = Verdict.FAILS if np.any(bad & known) else Verdict.HOLDS
    yield _row(judged, "finite torque at half turns and without an error", verdict, words)


def _repeatable(judged: Judged) -> Iterator[Row]:
    """Check that the code keeps no state of its own, and depends on its inputs alone.

    Whatever is static and can be written is named. What is not, such as memory without a value,
    shows in torques that differ when the states are evaluated in another order, with something
    else where the memory has no name.
    """
    period, states, loop = judged.loop.period, judged.drawn, judged.loop
    first, memory = loop.answer(*states, period)
    filling = judged.law.calling(replace(judged.law.called, fills=True), loop.group)
    other = replace(loop, controller=filling)
    second, again = other.answer(*states.of(slice(None, None, -1)), period)
    same = np.array_equal(first, second[::-1], equal_nan=True) and all(
        np.array_equal(memory[name], again[name][::-1], equal_nan=True) for name in memory
    )
    state, words = judged.law.called.static_state, ""
    variables, functions = state or ([], [])
    verdict = Verdict.FAILS if variables or not same else Verdict.HOLDS
    if variables:
        words = (
            f"it keeps {', '.join(variables)} from call to call; put it into memory, or make it "
            "const"
        )
    elif not same:
        words = "it reads what is neither input nor named memory, as a variable without a value"
    elif state is None:
        words = "undecided: eqt cannot read the symbols that this compiler writes; install nm"
        verdict = Verdict.UNDECIDED
    elif functions:
        words = f"undecided: it calls {', '.join(functions)}, which may keep a state"
        verdict = Verdict.UNDECIDED
    yield _row(judged, "equal inputs give equal torques", verdict, [words])


NO_NUMBER = (
    "at none of these states it is a number; give what it divides by as `numbers`, or define "
    "X_defaults in the file"
)

# Against the law ----------------------------------------------------------------------------------


def _compared(judged: Judged) -> Iterator[Row]:
    """Compare the torque and the memory with those of the law that the code claims to be."""
    loop, law = judged.loop, judged.loop.controller.formula
    if law is None:
        words = ["name the law that it claims to be with `as`"]
        yield _row(judged, "torque of the law", Verdict.UNCLAIMED, words)
        return
    formula, code = replace(loop, controller=law), judged.law.code
    known = False
    for place, states in (("at random states", judged.states), ("along runs", judged.along)):
        if states is None:
            continue
        if judged.law.adapter:  # poses of runs are rotations but for the error of the solver
            x, G = states.inputs, loop.group
            x = x._replace(pose=G.exp(G.log(x.pose)), desired_pose=G.exp(G.log(x.desired_pose)))
            states = states._replace(inputs=x)
        torque, memory = loop.answer(*states, loop.period)
        question = Question(formula, *states, bool(judged.law.adapter))
        differences = _differences(question, torque, code.real)
        words, verdict = [], Verdict.HOLDS
        if differences.wrong.any():
            verdict = Verdict.FAILS
            if not known:  # runs show less of a law than random states
                words, known = _description(judged, states, question, torque, differences), True
        elif place == "at random states":
            words = _reach(judged)
            undecided = judged.never or not (judged.is_watched or code.is_python)
            verdict = Verdict.UNDECIDED if undecided else Verdict.HOLDS
        name = f"torque of {law.title}, {code.real}, {place}"
        yield _row(judged, name, verdict, words, differences.measured, differences.bound)
        if states.memory and place == "at random states" and loop.vehicle.control is not None:
            yield from _memory_rows(judged, question, memory, code.real)


def _reach(judged: Judged) -> list[str]:
    """Say how much of the code and of its inputs was looked at."""
    count, drawn = judged.states.rows, judged.drawn.rows
    words = [
        f"{count} states; a fault at more than {300 / drawn:.2g} % of states like these would have "
        "been seen (95 %)"
    ]
    if judged.law.code.is_python:
        words.append("of Python, eqt does not count which lines were run")
    elif not judged.is_watched:
        words.insert(
            0, "undecided: this compiler cannot count which lines were run; use gcc or clang"
        )
    elif judged.never:
        words = [f"undecided: {'; '.join(judged.never)}", *words]
    else:
        decided = sum(not each.is_label for each in judged.law.decisions)
        words.append(f"all {decided} comparisons and conditions were both true and false")
    return words


@dataclass(frozen=True)
class _TorqueDifferences:
    """Differences of torques to those of a law.

    Attributes
    ----------
    wrong : (states,)
        Whether a difference is larger than its bound.
    measured, bound
        The difference that is largest relative to its bound, and this bound.
    by_float
        Whether float would explain all of them.
    """

    wrong: Array
    measured: float
    bound: float
    by_float: bool


def _differences(question: Question, torque: Array, real: str) -> _TorqueDifferences:
    """Compare torques within the bounds of their rounding errors.

    `BOUNDED` states have bounds of their own, and those whose difference is larger, relative to the
    torque, than the least bound of these, which is the bound of all others.
    """
    law, worse = question.torque(), ROUNDOFF[real] / UNIT
    difference = np.abs(torque - law)
    difference = np.where(np.isnan(difference) & np.isfinite(law), np.inf, difference)
    size = np.abs(law).max(axis=-1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):  # a torque that is exactly 0
        relative = np.nan_to_num(np.where(difference == 0, 0.0, difference / size))
    some = np.arange(len(law)) < BOUNDED
    bounds = ARRANGED * _rounding(question, some) * worse
    with np.errstate(divide="ignore", invalid="ignore"):
        least = np.nanmin(bounds / size[some], axis=0, initial=np.inf)  # of each entry
    least = np.where(np.isfinite(least), least, 0.0)
    bound = np.where(np.isfinite(size), least * size, np.nan) + 0.0 * law
    bound[some] = bounds
    others = np.flatnonzero(~some & (relative > least).any(axis=-1))
    order = np.argsort(-relative[others].max(axis=-1), kind="stable")
    others = others[order[:MOST_BOUNDED]]
    bound[others] = ARRANGED * _rounding(question, others) * worse
    usable = np.isfinite(law) & np.isfinite(bound)
    if not usable.any():
        return _TorqueDifferences(np.zeros(len(law), dtype=bool), 0.0, 0.0, False)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(usable & (difference > 0), difference / bound, 0.0)
    place = np.unravel_index(ratio.argmax(), ratio.shape)
    if not ratio.any():
        place = np.unravel_index(usable.argmax(), ratio.shape)
    wrong = np.any(usable & ~(difference <= bound), axis=-1)
    coarse = bound / ARRANGED / worse * (ROUNDOFF["float"] / UNIT)
    by_float = bool((difference <= coarse)[usable].all())
    return _TorqueDifferences(wrong, float(difference[place]), float(bound[place]), by_float)


def _rounding(question: Question, where: Array) -> Array:
    """The bound of the rounding error of the law in doubles, with that of all it is given."""
    loop = question.loop

    def inexact(values: Array, mixed: bool = False) -> Array:
        values = np.asarray(values, dtype=float)
        # Each entry of a rotated vector, or of a quaternion, is a sum of all of them.
        size = np.abs(values).max(tuple(range(1, values.ndim * mixed)), keepdims=True)
        return lifted(values, UNIT * size * np.ones_like(values))

    bounded = with_leaves(loop, {path: inexact(values) for path, values in leaves(loop).items()})
    inputs = question.inputs.each(lambda part: inexact(np.asarray(part)[where], question.adapted))
    memory = {name: inexact(values[where]) for name, values in question.memory.items()}
    with np.errstate(all="ignore"):
        _, errors = value_of(bounded.answer(inputs, memory, loop.period)[0])
    return np.asarray(errors)


def _description(
    judged: Judged, states: States, question: Question, torque: Array, wrong: _TorqueDifferences
) -> list[str]:
    """Describe the difference in words."""
    code = judged.law.code
    if not (np.isfinite(torque) & np.isfinite(question.torque())).all(axis=1).any():
        return [NO_NUMBER]
    if wrong.by_float and code.real == "double":
        return ["within the bound of float: constants or operations are float; make them double"]
    if where := judged.where(states, wrong.wrong):
        return [where]
    if question.loop.controller.commands_attitude:
        return [explained_cascade(question, torque, code.real)]
    other = _other_law(question, torque, code.real)
    words = explained(question, torque, code.real).words
    return [f"it is {other}", words] if other else [words]


def _other_law(question: Question, torque: Array, real: str) -> str:
    """Return the title of the registered law with these torques; "" if there is none."""
    scale = np.abs(torque).max() or 1.0
    limit, G = (1e-10 if real == "double" else 1e-5) * scale, question.loop.group
    for kind in controllers.all():
        if kind.name == question.loop.controller.name or not kind.tasks:
            continue
        law = kind()
        other_memory = set(question.memory) != set(law.memory(G))
        if not law.fits(G) or other_memory or law == question.loop.controller:
            continue
        if np.abs(question.torque(law=law) - torque).max() <= limit:
            return str(law.title)
    return ""


def _memory_rows(
    judged: Judged, question: Question, memory: dict[str, Array], real: str
) -> Iterator[Row]:
    """Check that the memory changes over a period, and begins, as that of the law."""
    loop, period = question.loop, judged.loop.period
    of_loop = loop.group, loop.inertia, loop.gains
    s = question.inputs.tracking(*of_loop, question.memory)
    _, later = loop.controller.answer(s, period)
    still = question.inputs.zeroed("velocity", "desired_velocity", "desired_acceleration")
    at_rest = loop.controller.memory_rate(still.tracking(*of_loop, question.memory))
    first = question.inputs.tracking(*of_loop, question.forgetful)
    begun, law = judged.law.initial_memory(first), loop.controller.initial_memory(first)
    moved, started = {}, {}  # in the code and in the law, and the sizes that are rounded
    for name, z in question.memory.items():
        both, begins = np.concatenate([z, later[name]], axis=-1), law.get(name, 0.0) + 0.0 * z
        moved[name] = memory[name] - z, later[name] - z, both
        started[name] = begun[name], begins, begins
    for when, parts in (("after a period", moved), ("at the start of a run", started)):
        words, worst = [], (0.0, 0.0)
        for name, (value, expected, sizes) in parts.items():
            differences = np.abs(value - expected).max(axis=-1)
            bounds = _memory_bounds(question, sizes, real)
            place = int((differences / bounds).argmax())
            difference, bound = float(differences[place]), float(bounds[place])
            if difference * worst[1] >= worst[0] * bound:
                worst = difference, bound
            if difference <= bound:
                continue
            if parts is started:
                code, law = value[place].tolist(), expected[place].tolist()
                words.append(f"{name} starts at {code}, but at {law} in the law")
            elif np.abs(value).max() <= bound:
                words.append(f"{name} does not advance: it is stale")
            else:
                of_pose = period * (at_rest[name] + 0.0 * question.memory[name])
                columns = {"velocity error": expected - of_pose, "pose error": of_pose}
                words.append(f"{name} advances {sum_of(columns, value, bound)}")
        verdict = Verdict.FAILS if words else Verdict.HOLDS
        yield _row(judged, f"memory of {loop.controller.title} {when}", verdict, words, *worst)


def _memory_bounds(question: Question, z: Array, real: str) -> Array:
    """Return what rounding may change of a memory at each state."""
    parts = (*(part for part in question.inputs[1:] if part is not None), z)
    sizes = [np.abs(part).reshape(len(z), -1).max(axis=-1, initial=1.0) for part in parts]
    return ROUNDOFF[real] * MEMORY_ROUNDINGS * np.maximum.reduce(sizes)


def _row(
    judged: Judged,
    name: str,
    verdict: Verdict,
    words: list[str],
    measured: float | None = None,
    bound: float | None = None,
) -> Row:
    code = judged.law.code
    statement = f"{code.file}: {code.function}"
    return Row(name, statement, "code", judged.label, measured, bound, verdict, "; ".join(words))
