"""Compares laws in C with the laws that they claim to be: rows for `eqt verify`."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from eqt_cli import extend  # whose certificates are there where somebody asks for these rows
from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array, Arrays
from eqt_cli.base.errors import Problems
from eqt_cli.components.actuators import THRUSTS
from eqt_cli.components.laws import Designed, OuterLoop, controllers, fits, with_defaults
from eqt_cli.components.mechanics import LawInput
from eqt_cli.extensions.code.code_evidence import (
    COARSE,
    ENOUGH,
    RARE,
    Limit,
    OutcomeSearch,
    Question,
    States,
    Tolerance,
    Watched,
    drawn_states,
    explained,
    explained_cascade,
    explained_finely,
    in_parts,
    limits,
)
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

ROUNDOFF = {"double": 2.0**-53, "float": 2.0**-24}
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

    def row(
        self, name: str, verdict: extend.Verdict, words: list[str], *sizes: float
    ) -> extend.Row:
        """Return a row about the code; of a difference, with its size and its bound."""
        code, (measured, bound) = self.law.code, sizes or (None, None)
        statement = f"{code.file}: {code.function}"
        return extend.Row(
            name, statement, "code", self.label, measured, bound, verdict, "; ".join(words)
        )

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
    def of_pointers(self) -> Array:
        """Whether a decision is a test of a pointer, which no state changes."""
        seen = self.watched(self.drawn)
        return ((seen.outcomes == 0) | np.isnan(seen.apart)).all(axis=0) & seen.outcomes.any(axis=0)

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
                if not self.of_pointers[place]
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
        reached = np.bitwise_or.reduce(self.watched(both).outcomes) | 3 * self.of_pointers
        had = list(zip(decisions, reached.tolist(), strict=True))
        entered = {decision.function for decision, outcome in had if outcome}
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
        return f"{share}, for example at {self.law.called.in_words(row)}"


def code_rows(
    label: str,
    loop: ClosedLoop,
    horizon: float,
    random: np.random.Generator,
    flown: tuple[Array, Array] | None,
) -> list[extend.Row]:
    """Check a law that is code.

    Parameters
    ----------
    flown
        Sample times and flat states ``(runs, samples, n)`` of good runs.
    """
    law: Any = loop.controller
    if law.object_:  # it answers in the order of time
        words = "undecided: `object: per run` cannot be called at random states"
        statement = f"{law.file}: {law.code.function}"
        return [
            extend.Row(
                "torque", statement, "code", label, None, None, extend.Verdict.UNDECIDED, words
            )
        ]
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


@purposes.answers_on_code
def answers(rows: Iterable[extend.Row], experiment: Any) -> Iterator[dict[str, str]]:
    """Yield of each law in code whether it is the law that it claims to be, in a sentence.

    Its finding is ``is``, ``lacks`` (some terms, and nothing else is wrong), ``differs``, or
    ``undecided``.
    """
    of_code = [row for row in rows if row.kind == "code"]
    for label in dict.fromkeys(row.controller for row in of_code):
        law, said = experiment.loops[label].controller, dict[bool, list[str]]({True: [], False: []})
        name = law.formula.name if law.formula else ""
        for row in of_code:
            if row.controller == label and row.verdict is not extend.Verdict.HOLDS:
                said[row.verdict is extend.Verdict.FAILS] += filter(None, [row.remark])
                name = name or row.name.partition(NEAREST)[2]
        words = "; ".join(said[True] + ([] if law.formula and said[True] else said[False]))
        # A coefficient of 0.00 is that of a term that is lacking.
        words = re.sub(r": coefficient 0\.00 of [^,;]+|; the same as in [^;]+", "", words)
        pieces = [clause for clause in words.split("; ") if clause]
        finding, answer = "differs", f"differs from {name}: {words}"
        if not name or "undecided: " in words:
            finding = "undecided"
            answer = f"{f'may be {name}' if name else 'claims no law'}: {words}"
        elif all(re.match(f"{LACKS}|{BESIDES}", piece) for piece in pieces):
            answer = " but ".join(filter(None, [f"is {name}", " and ".join(pieces)]))
            if all(re.match(LACKS, piece) for piece in pieces):
                finding = "lacks" if pieces else "is"
        elif law.formula is None:
            answer = f"claims no law; the nearest is {name}: {words}"
        named = f"{law.code.function} in {law.file}"
        yield {"label": label, "finding": finding, "answer": f"{named} {answer}"}


LACKS, BESIDES = r"(push: |torque: |its \w+ )?lacks ", "is (clipped|limited)|has (a|an) [dim]"
"""What code has less than a law and what it has besides, and is this law otherwise."""

NEAREST = "torque of the nearest law, "


# Finite torques that depend only on the inputs ----------------------------------------------------


def _finite(judged: Judged) -> Iterator[extend.Row]:
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
    finite: Any = np.ones_like(bad)
    if law is not None:
        formula = Question(judged.law.formula_of(loop, law), inputs, memory)
        finite = np.isfinite(formula.torque()).all(axis=1)
    places = [*(f"half turn about axis {k + 1}" for k in range(m)), "no error"]
    words = [f"{places[k]}: {torque[k].tolist()}" for k in np.flatnonzero(bad)]
    if bad.any() and not finite[bad].all():
        words.append("the law is not finite there either")
    verdict = extend.Verdict.FAILS if np.any(bad & finite) else extend.Verdict.HOLDS
    yield judged.row("finite torque at half turns and without an error", verdict, words)


def _repeatable(judged: Judged) -> Iterator[extend.Row]:
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
    verdict = extend.Verdict.FAILS if variables or not same else extend.Verdict.HOLDS
    if variables:
        words = (
            f"it keeps {', '.join(variables)} from call to call; put it into memory, or make it "
            "const"
        )
    elif not same:
        words = "it reads something that is neither input nor memory, as a variable without a value"
    elif state is None:
        words = "undecided: eqt cannot read the symbols that this compiler writes; install nm"
        verdict = extend.Verdict.UNDECIDED
    elif functions:
        words = f"undecided: it calls {', '.join(functions)}, which may keep a state"
        verdict = extend.Verdict.UNDECIDED
    yield judged.row("equal inputs give equal torques", verdict, [words])


NO_NUMBER = (
    "at none of these states it is a number; give what it divides by as `numbers`, or define "
    "X_defaults in the file"
)

# Against the law ----------------------------------------------------------------------------------


def _compared(judged: Judged) -> Iterator[extend.Row]:
    """Compare the torque and the memory with those of the law that the code claims to be."""
    loop, law = judged.loop, judged.loop.controller.formula
    if law is None:
        yield _unclaimed(judged)
        return
    formula, code = judged.law.formula_of(loop, law), judged.law.code
    is_described = False
    for place, states in (("at random states", judged.states), ("along runs", judged.along)):
        if states is None:
            continue
        if judged.law.adapter:  # poses of runs are rotations but for the error of the solver
            x, G = states.inputs, loop.group
            x = x._replace(pose=G.exp(G.log(x.pose)), desired_pose=G.exp(G.log(x.desired_pose)))
            states = states._replace(inputs=x)
        torque, memory = loop.answer(*states, loop.period)
        memories = {name: states.memory[name] for name in law.memory(loop.group)}
        question = Question(formula, states.inputs, memories, bool(judged.law.adapter))
        differences = _differences(question, torque, code.real)
        words, verdict = [], extend.Verdict.HOLDS
        if differences.wrong.any():
            verdict = extend.Verdict.FAILS
            if not is_described:  # runs show less of a law than random states
                words, is_described = (
                    _description(judged, states, question, torque, differences),
                    True,
                )
        elif place == "at random states":
            words = _reach(judged)
            undecided = judged.never or not (judged.is_watched or code.is_python)
            verdict = extend.Verdict.UNDECIDED if undecided else extend.Verdict.HOLDS
        name = f"torque of {law.title}, {code.real}, {place}"
        yield judged.row(name, verdict, words, differences.measured, differences.bound)
        if memories and place == "at random states" and loop.vehicle.control is not None:
            yield from _memory_rows(judged, question, memory, code.real)


def _unclaimed(judged: Judged) -> extend.Row:
    """Compare code that claims nothing with the shipped law that is nearest."""
    loop, states, real = judged.loop, judged.states, judged.law.code.real
    torque, _ = loop.answer(*states, loop.period)
    if loop.controller.commands == THRUSTS:
        words = ["it commands thrusts, as no law of eqt does; compare the torque before its mixer"]
        return judged.row("torque of the law", extend.Verdict.UNCLAIMED, words)
    if loop.controller.reads_flat_output or not np.isfinite(torque).all(axis=1).any():
        words = ["name the law that it claims to be with `as`"]
        return judged.row("torque of the law", extend.Verdict.UNCLAIMED, words)
    still = states._replace(memory={name: 0 * z for name, z in states.memory.items()})
    without, signs = loop.answer(*still, loop.period)[0], limits(loop.group, torque)

    def apart(law: Question) -> tuple[bool, float]:
        one = explained_finely(law, without, real)
        return not one.is_complete, one.cost if one.is_complete else one.left

    shipped = (law for law in _shipped(loop, states) if _is(law, torque, real, signs))
    law = next(shipped, None) or min(_shipped(loop, states), key=apart)
    differences = _differences(law, torque, real)
    words = [f"undecided: {'; '.join(judged.never)}"] if judged.never else []
    if differences.wrong.any():
        words = _description(judged, states, law, torque, differences)
    return judged.row(f"{NEAREST}{law.loop.controller.name}", extend.Verdict.UNCLAIMED, words)


def _shipped(loop: ClosedLoop, states: States) -> Iterator[Question]:
    """Yield the shipped laws that need no options, but for the one that the code claims to be.

    One with memory has that of the code.
    """
    G, memory = loop.group, np.hstack([states.inputs.velocity[:, :0], *states.memory.values()])
    code: Any = loop.controller
    for kind in controllers.all():
        is_another = type(code.formula) is not kind and not issubclass(kind, Designed)
        if is_another and kind.tasks and fits(kind(), G):
            law: Any = with_defaults(kind(), G, loop.gains, None).loaded(None, G, Problems())[0]
            lengths = law.memory(G)
            if [*lengths.values()] in ([], [memory.shape[1]]):
                named = dict.fromkeys(lengths, memory)
                yield Question(code.formula_of(loop, law), states.inputs, named)


def _is(law: Question, torque: Array, real: str, signs: Sequence[Limit]) -> bool:
    """Return whether a torque is that of a law, or of it behind a limit."""
    expected = law.torque()
    size = np.abs(expected).max(axis=1, keepdims=True)
    near = COARSE[real].left / 10 * (size + np.nanmedian(size))
    apart = (np.abs(x.after(expected, torque) - torque) for x in signs)
    return any(((error <= near) | ~np.isfinite(expected + torque)).all() for error in apart)


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
        decided = sum(not decision.is_label for decision in judged.law.decisions)
        constant = np.count_nonzero(judged.of_pointers)
        words.append(
            f"all {decided - constant} comparisons and conditions were both true and false"
        )
        words += [f"{constant} tests of pointers had one outcome"] if constant else []
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


@np.errstate(divide="ignore", invalid="ignore")  # a torque, or its bound, that is exactly 0
def _differences(question: Question, torque: Array, real: str) -> _TorqueDifferences:
    """Compare torques within the bounds of their rounding errors.

    `BOUNDED` states have bounds of their own, and those whose difference is larger, relative to the
    torque, than the least bound of these, which is the bound of all others.
    """
    law, worse = question.torque(), ROUNDOFF[real] / ROUNDOFF["double"]
    difference = np.abs(torque - law)
    difference = np.where(np.isnan(difference) & np.isfinite(law), np.inf, difference)
    size = np.abs(law).max(axis=-1, keepdims=True)
    relative = np.nan_to_num(np.where(difference == 0, 0.0, difference / size))
    some = np.arange(len(law)) < BOUNDED
    bounds = ARRANGED * _rounding(question, some) * worse
    least = np.nanmin(bounds / size[some], axis=0, initial=np.inf)  # of each entry
    least = np.where(np.isfinite(least), least, 0.0)
    bound = np.where(np.isfinite(size), least * size, np.nan) + 0.0 * law
    bound[some] = bounds
    others = np.flatnonzero(~some & (relative > least).any(axis=-1))
    others = others[np.argsort(-relative[others].max(axis=-1), kind="stable")[:MOST_BOUNDED]]
    bound[others] = ARRANGED * _rounding(question, others) * worse
    usable = np.isfinite(law) & np.isfinite(bound)
    if not usable.any():
        return _TorqueDifferences(np.zeros(len(law), dtype=bool), 0.0, 0.0, False)
    ratio = np.where(usable & (difference > 0), difference / bound, 0.0)
    place = np.unravel_index(ratio.argmax(), ratio.shape)
    if not ratio.any():
        place = np.unravel_index(usable.argmax(), ratio.shape)
    wrong = np.any(usable & ~(difference <= bound), axis=-1)
    coarse = bound / ARRANGED / worse * (ROUNDOFF["float"] / ROUNDOFF["double"])
    by_float = bool((difference <= coarse)[usable].all())
    return _TorqueDifferences(wrong, float(difference[place]), float(bound[place]), by_float)


def _rounding(question: Question, where: Array) -> Array:
    """The bound of the rounding error of the law in doubles, with that of all it is given."""
    loop = question.loop

    def inexact(values: Array, mixed: bool = False) -> Array:
        values = np.asarray(values, dtype=float)
        # Each entry of a rotated vector, or of a quaternion, is a sum of all of them.
        size = np.abs(values).max(tuple(range(1, values.ndim * mixed)), keepdims=True)
        return extend.lifted(values, ROUNDOFF["double"] * size * np.ones_like(values))

    bounded = with_leaves(loop, {path: inexact(values) for path, values in leaves(loop).items()})
    inputs = question.inputs.mapped(lambda part: inexact(np.asarray(part)[where], question.adapted))
    memory = {name: inexact(values[where]) for name, values in question.memory.items()}
    with np.errstate(all="ignore"):
        _, errors = extend.value_of(bounded.answer(inputs, memory, loop.period)[0])
    return np.asarray(errors)


def _description(
    judged: Judged, states: States, question: Question, torque: Array, wrong: _TorqueDifferences
) -> list[str]:
    """Describe the difference in words."""
    loop, real, law = judged.loop, judged.law.code.real, question.torque()
    if not (np.isfinite(torque) & np.isfinite(law)).all(axis=1).any():
        return [NO_NUMBER]
    more = {} if question.memory else {n: z for n, z in states.memory.items() if z.any()}
    last = [z for z in more.values() if z.shape == torque.shape]
    signs = limits(loop.group, torque, last, loop.period)
    is_cascade = isinstance(question.loop.controller, OuterLoop)
    is_claimed = is_cascade or _is(question, torque, real, signs)
    others = [] if is_claimed else _shipped(loop, states)
    for other in others:
        if all(z.any() for z in other.memory.values()) and _is(other, torque, real, signs):
            behind, apart = (explained(x, torque, real, signs) for x in (other, question))
            said = behind.words or (apart.words if apart.is_complete else "")
            return [f"it is {other.loop.controller.title}", *filter(None, [said])]
    if more:
        one = explained(question, torque, real, signs)
        if one.is_complete and one.words:
            return [one.words]
        return _of_memory(judged, states, question, real)
    if wrong.by_float and real == "double":
        return [_of_small(judged, states, question, torque, wrong.wrong)]
    where = judged.where(states, wrong.wrong)
    if is_cascade:
        limited = [x.words for x in signs if _is(question, torque, real, [x])]
        return limited[:1] or [where or explained_cascade(question, torque, real)]
    if where and len(signs) == 1:
        return [where]
    explanation = explained(question, torque, real, signs)
    if not explanation.words or (where and not explanation.is_complete):
        return [where or f"at {np.count_nonzero(wrong.wrong)} of {len(law)} states"]
    return [explanation.words]


def _of_small(judged: Judged, states: States, question: Question, torque: Array, wrong: Any) -> str:
    """Describe a difference that float's rounding could make, by evidence of its cause."""
    few, at = states.of(slice(ENOUGH)), question.of(np.arange(ENOUGH))
    law, size = at.torque(), np.linalg.norm
    difference = torque[:ENOUGH] - law
    every = leaves(at.loop)
    for paths in (every, *({path: value} for path, value in every.items())):
        rounded = {path: value.astype(np.float32).astype(float) for path, value in paths.items()}
        left = torque[:ENOUGH] - replace(at, loop=with_leaves(at.loop, rounded)).torque()
        if size(left) < 1e-3 * size(difference):  # which has some 7 digits
            return f"within the bound of float: constants are float ({', '.join(paths)})"
    explanation = explained_finely(question, torque, "double")
    if explanation.is_complete and explanation.words:
        return explanation.words
    if where := judged.where(states, wrong):
        return where
    # By a step of 100 roundings of float, the error of a formula changes little; rounding jumps.
    search = OutcomeSearch(judged.loop, judged.watched, judged.random)
    near = search.moved(few, 1e-5 * judged.random.standard_normal((few.rows, search.axes(few))))
    moved = Question(question.loop, near.inputs, {name: near.memory[name] for name in at.memory})
    change = judged.loop.answer(*near, judged.loop.period)[0] - moved.torque() - difference
    if size(change) > size(difference) / 10:
        return "within the bound of float: operations are float; make them double"
    share = 100 * size(difference) / size(law)
    return f"no sum of the law's parts in any frame: {share:.2g} % of the torque is none of them"


def _of_memory(judged: Judged, states: States, question: Question, real: str) -> list[str]:
    """Describe the code without its memory, and this, which the law has not."""
    loop, words = judged.loop, list[str]()
    still = states._replace(memory={name: 0 * z for name, z in states.memory.items()})
    torque, later = loop.answer(*still, loop.period)
    differences = _differences(question, torque, real)
    if differences.wrong.any():
        words = _description(judged, still, question, torque, differences)
    for name, advances in later.items():
        rows = np.flatnonzero(advances.any(axis=1))[:ENOUGH]
        few, advance = question.of(rows), advances[rows]
        errors = few.torque() - few.torque(K=0.0), few.torque() - few.torque(K_d=0.0)
        factors = np.linalg.lstsq(np.hstack(errors), advance, rcond=1e-10)[0]
        sums = [x @ by for x, by in zip(errors, np.split(factors, 2), strict=True)]
        near = COARSE[real].left * np.abs(advance).max(initial=0.0)
        names = zip(("pose error", "velocity error"), sums, strict=True)
        of = " and ".join(entry for entry, x in names if (np.abs(x) > near).any())
        is_sum = of and np.abs(sum(sums) - advance).max() <= near
        words.append(f"has an integral of {of}" if is_sum else f"has its own memory, {name}")
    return words


def _memory_rows(
    judged: Judged, question: Question, memory: Arrays, real: str
) -> Iterator[extend.Row]:
    """Check that the memory changes over a period, and begins, as that of the law."""
    loop, period = question.loop, judged.loop.period
    of_loop = loop.group, loop.inertia, loop.gains
    _, later = loop.controller.answer(question.inputs.tracking(*of_loop, question.memory), period)
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
            # What rounding may change of a memory at each state
            read = (*(part for part in question.inputs[1:] if part is not None), sizes)
            largest = [np.abs(x).reshape(len(x), -1).max(axis=-1, initial=1.0) for x in read]
            bounds = ROUNDOFF[real] * MEMORY_ROUNDINGS * np.maximum.reduce(largest)
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
                columns = {"pose error": of_pose, "velocity error": expected - of_pose}
                few = {part: column[:ENOUGH] for part, column in columns.items()}
                near = bounds.max() / np.abs(value[:ENOUGH]).max()
                advance = (few, dict.fromkeys(few, 1.0)), value[:ENOUGH]
                said = in_parts(*advance, Tolerance(near, 10 * near)).words
                words += [f"its {name} {x}" for x in said.split("; ") if not x.startswith("the")]
        verdict = extend.Verdict.FAILS if words else extend.Verdict.HOLDS
        yield judged.row(f"memory of {loop.controller.title} {when}", verdict, words, *worst)
