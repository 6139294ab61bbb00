"""Compares laws in C with the laws that they claim to be: rows for `eqt verify`."""

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
from eqt_cli.controllers import controllers
from eqt_cli.core.arrays import Array
from eqt_cli.core.leaves import leaves, with_leaves
from eqt_cli.core.problems import Problems

STATES = 200
"""Number of random states."""

BOUNDED = 24
"""Number of states at which the bound of rounding errors is computed, which takes long."""

ARRANGED = 8.0
"""Factor of the bound of eqt's formula, because the code may arrange the formula differently."""

MEMORY_ROUNDINGS = 1e3
"""Rounding errors of the largest entry of a memory that a period may add."""

ROUNDOFF = {"double": UNIT, "float": 2.0**-24}
"""Relative rounding error of one operation."""


@dataclass(frozen=True)
class Judged:
    """A law in code, and the states at which it is evaluated.

    Attributes
    ----------
    label
        Label of the law.
    loop
        The loop with the code.
    random
        Random states.
    along
        States of runs; None if no run is good.
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
    """Check a law that is code; a law that is a formula has no rows.

    Parameters
    ----------
    flown
        Sample times and flat states ``(runs, samples, n)`` of good runs.
    """
    if loop.controller.code is None:
        return []
    drawn = random_states(loop, horizon, random)
    along = None if flown is None else _states_of_runs(loop, *flown, random)
    found = Judged(label, loop, drawn, along)
    return [*_finite(found), *_repeatable(found), *_compared(found)]


def random_states(
    loop: ClosedLoop, horizon: float, random: np.random.Generator
) -> tuple[LawInput, dict[str, Array]]:
    """Draw random states and memory, with a moving reference."""
    G, m = loop.group, loop.group.dimension
    Q, Qd = G.exp(random.standard_normal((2, STATES, m)))
    V, Vd, Vd_dot = random.standard_normal((3, STATES, m))
    if loop.controller.formula is not None and loop.controller.formula.tasks == ("stabilise",):
        Vd, Vd_dot = 0 * Vd, 0 * Vd_dot
    t = random.uniform(0.0, horizon, STATES)
    lengths = loop.controller.memory(G).items()
    memory = {name: random.standard_normal((STATES, length)) for name, length in lengths}
    return LawInput(t, Q, V, Qd, Vd, Vd_dot), memory


def _states_of_runs(
    loop: ClosedLoop, times: Array, states: Array, random: np.random.Generator
) -> tuple[LawInput, dict[str, Array]] | None:
    """Draw states from runs."""
    runs, samples, _ = states.shape
    if not runs:
        return None
    run, sample = random.integers(runs, size=STATES), random.integers(samples, size=STATES)
    flat = states[run, sample]
    t = times[sample]
    return loop.told(t, flat), loop.memory(flat)


# Finite torques that depend only on the inputs ----------------------------------------------------


def _finite(judged: Judged) -> Iterator[Row]:
    """Check that the torque is finite at half turns and without an error."""
    loop, G = judged.loop, judged.loop.group
    m = G.dimension
    turned = np.concatenate([G.exp(np.pi * np.eye(m)), G.exp(np.zeros((1, m)))])
    rest, still = np.broadcast_to(G.identity, turned.shape), np.zeros((m + 1, m))
    inputs = LawInput(np.zeros(m + 1), turned, still, rest, still, still)
    memory = {name: np.zeros((m + 1, n)) for name, n in loop.controller.memory(G).items()}
    torque, _ = loop.answer(inputs, memory, _period(loop))
    bad = ~np.isfinite(torque).all(axis=1)
    law = loop.controller.formula
    known: Any = np.ones_like(bad)
    if law is not None:
        formula = Question(replace(loop, controller=law), inputs, memory)
        known = np.isfinite(formula.torque()).all(axis=1)
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


def _repeatable(judged: Judged) -> Iterator[Row]:
    """Check that equal inputs give equal torques, whatever was computed before."""
    inputs, memory = judged.random
    period = _period(judged.loop)
    first, kept = judged.loop.answer(inputs, memory, period)
    turned = LawInput(*(np.asarray(part)[::-1] for part in inputs))
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
    """Compare the torque and the memory with those of the law that the code claims to be."""
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
        inputs, memory = states
        torque, kept = loop.answer(inputs, memory, _period(loop))
        question = Question(formula, inputs, memory)
        measured, bound, by_float = _worst(question, torque, code.real)
        words = []
        if not measured <= bound and not known:  # runs show less of a law than random states
            words, known = _description(question, torque, code.real, by_float), True
        name = f"torque of {law.title}, {code.real}, {place}"
        verdict = Verdict.HOLDS if measured <= bound else Verdict.FAILS
        yield _row(judged, name, verdict, words, measured, bound)
        if memory and place == "at random states" and loop.vehicle.control is not None:
            yield _memory_row(judged, question, kept, code.real)


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
    inputs = LawInput(*(given(np.asarray(part)[:BOUNDED]) for part in question.inputs))
    memory = {name: given(values[:BOUNDED]) for name, values in question.memory.items()}
    s = inputs.tracking(loop.group, bounded.inertia, bounded.gains, memory)
    with np.errstate(all="ignore"):
        _, errors = value_of(bounded.controller.torque(s) + 0.0 * inputs.velocity)
    return errors


def _description(question: Question, torque: Array, real: str, by_float: bool) -> list[str]:
    """Describe the difference in words."""
    if not (np.isfinite(torque) & np.isfinite(question.torque())).all(axis=1).any():
        return [NO_NUMBER]
    if by_float and real == "double":
        return ["within the bound of float: constants or operations are float; make them double"]
    other = _other_law(question, torque, real)
    words = explained(question, torque, real).words
    return [f"it is {other}", words] if other else [words]


def _other_law(question: Question, torque: Array, real: str) -> str:
    """Return the title of the registered law with these torques; "" if there is none."""
    scale = np.abs(torque).max() or 1.0
    limit, G = (1e-10 if real == "double" else 1e-5) * scale, question.loop.group
    for kind in controllers.all():
        if kind.name == question.loop.controller.name or not kind.tasks:
            continue
        law, problems = kind(), Problems()
        law.check(G, problems)
        other_memory = set(question.memory) != set(law.memory(G))
        if problems or other_memory or law == question.loop.controller:
            continue
        if np.abs(question.torque(law=law) - torque).max() <= limit:
            return str(law.title)
    return ""


def _memory_row(judged: Judged, question: Question, kept: dict[str, Array], real: str) -> Row:
    """Check that the memory changes over a period as that of the law."""
    loop, period = question.loop, _period(judged.loop)
    s = question.inputs.tracking(loop.group, loop.inertia, loop.gains, question.memory)
    rates = loop.controller.memory_rate(s)
    inputs = question.inputs
    still = inputs._replace(
        velocity=0 * inputs.velocity,
        desired_velocity=0 * inputs.desired_velocity,
        desired_acceleration=0 * inputs.desired_acceleration,
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
