"""Explains the wrench of code that claims to be a cascade: its push, then its torque.

The push is a sum of parts of F·b, each the difference of two evaluations of the law. The torque is
explained as that of the attitude law, whose V_d and V̇_d are Ω_c and Ω̇_c.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from eqt_cli.analysis.evidence.code_terms import (
    ASSUMED,
    CHANGED,
    ENOUGH,
    VANISHES,
    Explanation,
    Parts,
    Question,
    explained,
    in_parts,
)
from eqt_cli.controllers.cascade import Cascade
from eqt_cli.core.arrays import Array
from eqt_cli.core.leaves import with_fields
from eqt_cli.mechanics.inertia import Inertia
from eqt_cli.mechanics.law_input import LawInput

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
    """Describe how the wrench of code differs from that of a cascade."""
    finite = np.isfinite(wrench).all(axis=1) & np.isfinite(question.torque()).all(axis=1)
    usable = np.flatnonzero(finite)[:ENOUGH]
    few, wrench = question.of(usable), wrench[usable]
    push = _of_push(few, wrench, real)
    shares = {name: found for name, (found, _) in push.coefficients.items()}
    said, near = push.words, CHANGED[real]
    others = [share for name, share in shares.items() if name != KNOWN]
    if said and push.is_complete and np.ptp(others) < near < abs(others[0] - 1.0):
        said = f"mass: coefficient {others[0]:.2f} of 1"
        if KNOWN in shares and abs(shares[KNOWN] - others[0]) > near:
            said += f", and of {KNOWN}: {shares[KNOWN]:.2f}"
    words = [f"push: {said}"] if said else []
    changed = _with_force(few, shares, near) if push.is_complete else None
    if changed is None:
        return "; ".join([*words, "the torque was not compared"])
    found = []
    for assumed, each in _with_rates(changed):
        one = explained(*_of_attitude(each, wrench), real)
        cost = one.cost + (ASSUMED if assumed else 0.0) if one.is_complete else np.inf
        found.append((cost, [assumed, one.words]))
    of_torque = "; ".join(filter(None, min(found, key=lambda each: each[0])[1]))
    for name, symbol in NAMES.items():
        of_torque = of_torque.replace(name, symbol)
    return "; ".join([*words, *([f"torque: {of_torque}"] if of_torque else [])])


def _cascade(question: Question) -> Cascade:
    law = question.loop.controller
    assert isinstance(law, Cascade)
    return law


def _of_push(question: Question, wrench: Array, real: str) -> Explanation:
    """Return the push as a sum of the parts of F·b."""
    law, moves = _cascade(question), question.loop.group.parts[1].axes
    without = {KNOWN: with_fields(law, known=())}
    own, gains = law.position, {"position error": "kx", "velocity error": "kv", "integral": "ki"}
    if own.limit is None:
        for name, key in gains.items():
            if getattr(own, key) is not None:
                without[name] = with_fields(law, position=with_fields(own, **{key: 0.0}))
    else:
        still = with_fields(own, kx=0.0, kv=0.0, ki=None)
        without["position feedback"] = with_fields(law, position=still)
    whole = question.torque()[:, moves]
    columns = {name: whole - question.torque(law=each)[:, moves] for name, each in without.items()}
    columns["desired acceleration"] = whole - sum(columns.values())
    least = VANISHES * np.abs(whole).max()
    columns = {name: column for name, column in columns.items() if np.abs(column).max() > least}
    return in_parts(Parts(columns, dict.fromkeys(columns, 1.0)), wrench[:, moves], real)


def _with_force(question: Question, shares: dict[str, float], near: float) -> Question | None:
    """Return the law with the F of code: another mass, or no known forces; None for any other."""
    known, others = shares.get(KNOWN), [x for name, x in shares.items() if name != KNOWN]
    if np.ptp(others) > near:
        return None
    mass, loop = others[0], question.loop
    if known is None or abs(known - mass) < near:  # F has the same direction
        return question
    if abs(known) < near:
        return replace(
            question, loop=replace(loop, controller=with_fields(loop.controller, known=()))
        )
    if abs(known - 1.0) > near or not isinstance(loop.inertia, Inertia):
        return None
    scale = np.ones(loop.group.dimension)
    scale[loop.group.parts[1].axes] = mass
    inertia = Inertia(loop.inertia.matrix * scale, loop.inertia.inverse / scale)
    return replace(question, loop=replace(loop, inertia=inertia))


def _with_rates(question: Question) -> Iterator[tuple[str, Question]]:
    """Yield the law, and laws with other rates of the commanded attitude, in words."""
    law = _cascade(question)
    yield "", question
    for rates, words in RATES.items():
        if rates != law.rates and (rates != "heading" or question.inputs.heading is not None):
            other = with_fields(law, rates=rates)
            yield words, replace(question, loop=replace(question.loop, controller=other))


def _of_attitude(question: Question, wrench: Array) -> tuple[Question, Array]:
    """Return the attitude law with what it reads, and the torque that is to be its own."""
    loop, law = question.loop, _cascade(question)
    s = question.inputs.tracking(loop.group, loop.inertia, loop.gains, question.memory)
    read, turns = law.commanded(s).tracking, loop.group.parts[0].axes
    known = law.torque(s)[:, turns] - law.inner.torque(read)
    return Question(loop.inside, LawInput.of(read), read.memory), wrench[:, turns] - known
