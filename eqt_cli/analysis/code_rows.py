"""Code in C against the law that it claims to be: rows for `eqt verify`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eqt_cli.analysis.certificates.base import Row, Verdict
from eqt_cli.analysis.evidence.code_question import Question
from eqt_cli.analysis.evidence.code_terms import explained, sum_of
from eqt_cli.analysis.evidence.running_error import UNIT, lifted, value_of
from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.closed_loop.law_input import LawInput
from eqt_cli.controllers import Controller, controllers
from eqt_cli.core.arrays import Array
from eqt_cli.core.leaves import leaves, with_leaves
from eqt_cli.core.problems import Problems

STATES = 200
"""Random states, at which a torque is explained."""

BOUNDED = 24
"""Of them, at which it is compared by the bound of rounding errors, which takes long."""

ARRANGED = 8.0
"""Times the bound of eqt's own formula: another arrangement of it rounds otherwise."""

MEMORY_ROUNDINGS = 1e3
"""Of the largest entry of a memory, that a period may add."""

ROUNDOFF = {"double": UNIT, "float": 2.0**-24}
"""Of one operation, relative."""


@dataclass(frozen=True)
class Judged:
    """A law in code, at states of which some are those of runs.

    Attributes
    ----------
    label
        Of the law.
    loop
        With the code.
    random
        States that are drawn.
    along
        States of runs; None where no run is good.
    """

    label: str
    loop: ClosedLoop
    random: tuple[LawInput, dict[str, Array]]
    along: tuple[LawInput, dict[str, Array]] | None


def code_rows(
    label: str,
    loop: ClosedLoop,
    horizon: float,
    random: np.random.Generator,
    flown: tuple[Array, Array] | None,
) -> list[Row]:
    """What is found of a law that is code; no row of a law that is a formula.

    Parameters
    ----------
    flown
        Sample times and flat states ``(runs, samples, n)`` of good runs.
    """
    if loop.controller.code is None:
        return []
    drawn = random_states(loop, horizon, random)
    along = None if flown is None else _states_of(loop, *flown, random)
    found = Judged(label, loop, drawn, along)
    return [*_finite(found), *_repeats(found), *_compared(found)]


def random_states(
    loop: ClosedLoop, horizon: float, random: np.random.Generator
) -> tuple[LawInput, dict[str, Array]]:
    """Random states and memory, with a reference that moves."""
    G, m = loop.group, loop.group.dimension
    Q, Qd = G.exp(random.standard_normal((2, STATES, m)))
    V, Vd, Vd_dot = random.standard_normal((3, STATES, m))
    if loop.controller.formula is not None and loop.controller.formula.tasks == ("stabilise",):
        Vd, Vd_dot = 0 * Vd, 0 * Vd_dot
    t = random.uniform(0.0, horizon, STATES)
    lengths = loop.controller.memory(G).items()
    memory = {name: random.standard_normal((STATES, length)) for name, length in lengths}
    return LawInput(t, Q, V, Qd, Vd, Vd_dot), memory


def _states_of(
    loop: ClosedLoop, times: Array, states: Array, random: np.random.Generator
) -> tuple[LawInput, dict[str, Array]] | None:
    """Some of the states of runs."""
    runs, samples, _ = states.shape
    if not runs:
        return None
    run, sample = random.integers(runs, size=STATES), random.integers(samples, size=STATES)
    flat = states[run, sample]
    t = times[sample]
    return loop.told(t, flat), loop.memory(flat)


# Finite, and nothing but what it is told ----------------------------------------------------------


def _finite(judged: Judged) -> Iterator[Row]:
    """Whether the torque is finite without an error and at half turns."""
    loop, G = judged.loop, judged.loop.group
    m = G.dimension
    turned = np.concatenate([G.exp(np.pi * np.eye(m)), G.exp(np.zeros((1, m)))])
    rest, still = np.broadcast_to(G.identity, turned.shape), np.zeros((m + 1, m))
    told = LawInput(np.zeros(m + 1), turned, still, rest, still, still)
    memory = {name: np.zeros((m + 1, n)) for name, n in loop.controller.memory(G).items()}
    torque, _ = loop.answer(told, memory, _period(loop))
    bad = ~np.isfinite(torque).all(axis=1)
    law = loop.controller.formula
    own = torque
    if law is not None:
        own = Question(replace(loop, controller=law), told, memory).torque()
    known: Any = np.isfinite(own).all(axis=1)
    if law is None:
        known = np.ones_like(known)
    where = ["half turn", "no error"]
    words = [
        f"{where[int(k == m)]}{f' about axis {k + 1}' if k < m else ''}: {torque[k].tolist()}"
        for k in np.flatnonzero(bad)
    ]
    if bad.any() and not known[bad].all():
        words.append("the law is not finite there either")
    fails = bool(np.any(bad & known))
    verdict = Verdict.FAILS if fails else Verdict.HOLDS
    yield _row(judged, "finite torque at half turns and without an error", verdict, words)


def _repeats(judged: Judged) -> Iterator[Row]:
    """Whether the same inputs give the same torque, whatever was asked before."""
    told, memory = judged.random
    period = _period(judged.loop)
    first, kept = judged.loop.answer(told, memory, period)
    turned = LawInput(*(np.asarray(part)[::-1] for part in told))
    backwards = {name: values[::-1] for name, values in memory.items()}
    second, again = judged.loop.answer(turned, backwards, period)
    same = np.array_equal(first, second[::-1], equal_nan=True) and all(
        np.array_equal(kept[name], again[name][::-1], equal_nan=True) for name in kept
    )
    words = [] if same else ["it keeps a state of its own, as static variables; put it into memory"]
    verdict = Verdict.HOLDS if same else Verdict.FAILS
    yield _row(judged, "equal inputs give equal torques", verdict, words)


NO_NUMBER = (
    "at none of these states it is a number; give what it divides by as `numbers`, or define "
    "X_defaults in the file"
)

# Against the law ----------------------------------------------------------------------------------


def _compared(judged: Judged) -> Iterator[Row]:
    """The torque, and what becomes of memory, against the law that the code claims to be."""
    loop, law = judged.loop, judged.loop.controller.formula
    if law is None:
        words = ["name the law that it claims to be with `as`"]
        yield _row(judged, "torque of the law", Verdict.UNCLAIMED, words)
        return
    formula = replace(loop, controller=law)
    code = loop.controller.code
    assert code is not None
    known = False
    for place, states in (("at random states", judged.random), ("along runs", judged.along)):
        if states is None:
            continue
        told, memory = states
        torque, kept = loop.answer(told, memory, _period(loop))
        question = Question(formula, told, memory)
        measured, bound, by_float = _worst(question, torque, code.real)
        words = []
        if not measured <= bound and not known:  # runs show less of a law than random states
            words, known = _said(question, torque, code.real, by_float), True
        name = f"torque of {law.title}, {code.real}, {place}"
        verdict = Verdict.HOLDS if measured <= bound else Verdict.FAILS
        yield _row(judged, name, verdict, words, measured, bound)
        if memory and place == "at random states" and loop.vehicle.control is not None:
            yield _remembers(judged, question, kept, code.real)


def _worst(question: Question, torque: Array, real: str) -> tuple[float, float, bool]:
    """The largest difference over its bound, that bound, and whether float would explain all."""
    bound = ARRANGED * _rounding(question)
    law = question.torque()[:BOUNDED]
    difference = np.abs(torque[:BOUNDED] - law)
    usable = np.isfinite(law) & np.isfinite(bound)
    difference = np.where(np.isnan(difference), np.inf, difference)[usable]
    limits = bound[usable] * (ROUNDOFF[real] / UNIT)
    if not difference.size:
        return 0.0, 0.0, False
    with np.errstate(divide="ignore", invalid="ignore"):  # a torque that is exactly 0
        place = int(np.where(difference == 0, 0.0, difference / limits).argmax())
    coarse = bound[usable] / ARRANGED * (ROUNDOFF["float"] / UNIT)
    return float(difference[place]), float(limits[place]), bool((difference <= coarse).all())


def _rounding(question: Question) -> Array:
    """The bound of the rounding error of the law in doubles, with that of all it is given."""
    loop = question.loop

    def given(values: Array) -> Array:
        values = np.asarray(values, dtype=float)
        return lifted(values, UNIT * np.abs(values))

    bounded = with_leaves(loop, {path: given(values) for path, values in leaves(loop).items()})
    told = LawInput(*(given(np.asarray(part)[:BOUNDED]) for part in question.told))
    memory = {name: given(values[:BOUNDED]) for name, values in question.memory.items()}
    s = told.tracking(loop.group, bounded.inertia, bounded.gains, memory)
    with np.errstate(all="ignore"):
        _, errors = value_of(bounded.controller.torque(s) + 0.0 * told.velocity)
    return errors


def _said(question: Question, torque: Array, real: str, by_float: bool) -> list[str]:
    """What the difference is, in words."""
    if not (np.isfinite(torque) & np.isfinite(question.torque())).all(axis=1).any():
        return [NO_NUMBER]
    if by_float and real == "double":
        return ["within the bound of float: constants or operations are float; make them double"]
    other = _other_law(question, torque, real)
    words = explained(question, torque, real).words
    return [f"it is {other}", words] if other else [words]


def _other_law(question: Question, torque: Array, real: str) -> str:
    """The registered law that asks for these torques; "" where none does."""
    scale = np.abs(torque).max() or 1.0
    limit = (1e-10 if real == "double" else 1e-5) * scale
    for kind in controllers.all():
        if kind.name == question.loop.controller.name:
            continue
        if not kind.tasks or set(question.memory) != set(_memory_of(kind, question)):
            continue
        law = kind()
        problems = Problems()
        law.check(question.loop.group, problems)
        if problems or law == question.loop.controller:
            continue
        if np.abs(question.torque(law=law) - torque).max() <= limit:
            return str(law.title)
    return ""


def _memory_of(kind: type[Controller], question: Question) -> dict[str, int]:
    return dict(kind().memory(question.loop.group))


def _remembers(judged: Judged, question: Question, kept: dict[str, Array], real: str) -> Row:
    """Whether memory goes on as that of the law does."""
    loop, period = question.loop, _period(judged.loop)
    s = question.told.tracking(loop.group, loop.inertia, loop.gains, question.memory)
    rates = loop.controller.memory_rate(s)
    told = question.told
    still = told._replace(
        velocity=0 * told.velocity,
        desired_velocity=0 * told.desired_velocity,
        desired_acceleration=0 * told.desired_acceleration,
    )
    at_rest = loop.controller.memory_rate(
        still.tracking(loop.group, loop.inertia, loop.gains, question.memory)
    )
    words, worst, limit = [], 0.0, 0.0
    for name, z in question.memory.items():
        went, expected = kept[name] - z, period * (rates[name] + 0.0 * z)
        bound = ROUNDOFF[real] * MEMORY_ROUNDINGS * max(1.0, float(np.abs(z).max()))
        found = float(np.abs(went - expected).max())
        worst, limit = max(worst, found), max(limit, bound)
        if found <= bound:
            continue
        if np.abs(went).max() <= bound:
            words.append(f"{name} does not go on: it is stale")
            continue
        of_pose = period * (at_rest[name] + 0.0 * z)
        columns = {"velocity error": expected - of_pose, "pose error": of_pose}
        words.append(f"{name} goes on {sum_of(columns, went, bound)}")
    verdict = Verdict.HOLDS if not words else Verdict.FAILS
    law = loop.controller.title
    return _row(judged, f"memory of {law} after a period", verdict, words, worst, limit)


def _period(loop: ClosedLoop) -> float:
    control = loop.vehicle.control
    return 0.0 if control is None else control.period


def _row(
    judged: Judged,
    name: str,
    verdict: Verdict,
    words: list[str],
    measured: float | None = None,
    bound: float | None = None,
) -> Row:
    code = judged.loop.controller.code
    assert code is not None
    statement = f"{code.file}: {code.prefix}_torque"
    return Row(name, statement, "code", judged.label, measured, bound, verdict, "; ".join(words))
