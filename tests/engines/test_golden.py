"""No change of code changes what a shipped loop computes: its programs, and numbers by NumPy.

`golden.tsv` has a row for each loop. Programs are compared by a digest of the graph of their
operations, after fusing where native fuses: no processor takes part in it. Numbers are sums, within
a tolerance, as BLAS and NumPy's functions differ between processors. After a change that is meant:

    python tests/engines/test_golden.py
"""

import hashlib
from functools import cache
from itertools import chain
from pathlib import Path

import numpy as np
import pytest

from eqt_cli.base.errors import TraceError
from eqt_cli.config import shipped
from eqt_cli.config.document import read_config
from eqt_cli.config.study import study
from eqt_cli.engines.library import with_comparison_sides
from eqt_cli.engines.native import programs
from eqt_cli.numbers.leaves import leaves
from eqt_cli.numbers.program import Constant, Input, fused
from eqt_cli.runs.batches import batches

ROWS = Path(__file__).with_name("golden.tsv")

STATES, RUNS, TICKS = 1000, 40, 40

# Kernels of BLAS differ by some 1e-15 of the largest terms of a sum, which random states and ticks
# amplify.
FIELD, TICKED = 1e-10, 1e-7

QUICK = {
    ("paper", "eqt"),
    ("paper_rates", "quaternion"),
    ("pointing", "lee2010"),
    ("planar_vtol", "model"),
    ("satellite_panels", "feedforward"),
    ("satellite_wheels", "eqt"),
    ("se2_vehicle", "gt"),
    ("se3_bluerov2", "nog"),
    ("tune_so2", "stabilising"),
}
"""Nine loops of different parts: a sample for every run of the tests."""


@cache
def loops_of(name):
    """The problems of the loops of a shipped configuration, by the labels of their laws."""
    shipped_study = study(read_config(shipped.folder() / f"{name}.yaml"))
    entry = np.arange(1)
    return {
        label: next(iter(batches(shipped_study, label, entry))).problem
        for label in shipped_study.base.loops
    }


# Programs -----------------------------------------------------------------------------------------


def numbered(numbers):
    """The names of the entries of numbers by their paths, in the order of programs."""
    return [f"{path}[{k}]" for path, values in numbers.items() for k in range(values.size)]


def digest(program, names):
    """What a program computes, whatever the order of its operations, numbers, and what commutes.

    Values are equal to the bit where their forms are, but for the sign of 0: x − y and −(y − x)
    count as the same.
    """
    forms = []
    for value in program.values:
        if isinstance(value, Input):
            named = names.get(value.group)
            name = named[value.number] if named else f"{value.group}[{value.number}]"
            forms.append(number(name) if isinstance(name, float) else (name, 1))
        elif isinstance(value, Constant):
            forms.append(number(value.number))
        else:
            of = value.of if value.name != "loop" else (digest(value.of.program, {}), value.of.rows)
            name = value.name if of is None else f"{value.name} {of}"
            forms.append(form(name, [forms[operand] for operand in value.operands]))
    lines = []
    for output in program.outputs:
        entries = [f"{sign} {name}" for name, sign in (forms[entry] for entry in output.entries)]
        lines.append(f"{output.name} {output.shape} {' '.join(entries)}")
    return hashed(*sorted(lines))[:16]


def number(value):
    """The form of a number; one of an expression is an input, but counts as the constant it is."""
    return abs(value).hex(), -1 if value < 0 else 1


def form(name, operands):
    """A digest of an operation and its operands, and its sign."""
    if name == "negative":
        [(same, sign)] = operands
        return same, -sign
    if name in ("multiply", "divide"):
        names, signs = zip(*operands, strict=True)
        return hashed(name, *(sorted(names) if name == "multiply" else names)), signs[0] * signs[1]
    if name == "fma":
        operands = [form("multiply", operands[:2]), operands[2]]
    if name == "subtract":
        (second, sign) = operands[1]
        name, operands = "add", [operands[0], (second, -sign)]
    sign = 1
    if name == "add":
        operands = sorted(operands)
    if name in ("add", "fma"):
        sign = operands[0][1]
    return hashed(name, *(f"{operand} {sign * own}" for operand, own in operands)), sign


def hashed(*parts):
    return hashlib.sha256(" ".join(parts).encode()).hexdigest()


def compiled(loop):
    """The digests of the programs that native compiles; none where it cannot."""
    try:
        of_loop = programs(loop)
    except TraceError:
        return ["-"]
    names = {"parameters": numbered(leaves(loop))}
    names["held"] = [*numbered(loop.holding(0.0).held_leaves), *of_loop.field.numbers]
    digests = [digest(fused(with_comparison_sides(of_loop.field)[0]), names)]
    parts = [of_loop.after_instant, of_loop.command]
    if of_loop.around_code is not None:
        around = of_loop.around_code
        parts += [around.input, around.law and around.law.step, around.after]
    return digests + [digest(part, names) for part in parts if part is not None]


# Numbers by NumPy ---------------------------------------------------------------------------------


def summed(values):
    """A sum of finite values with weights, and the sum of their sizes."""
    values = np.where(np.isfinite(values), values, 0.0)
    weights = np.cos(np.arange(values.size)).reshape(values.shape)
    return float((weights * values).sum()), float(np.abs(values).sum())


def computed(problem):
    """The sums of the field at states near the start, and of the states after ticks."""
    loop, random = problem.loop, np.random.default_rng(7)
    t, start = float(problem.times[len(problem.times) // 3]), problem.states
    batched = problem.select(np.zeros(RUNS, dtype=int))
    held, moving = batched.batched_loop().holding(t), loop.moving_length
    fields = []
    with np.errstate(all="ignore"):
        for _ in range(STATES // RUNS):
            noise = random.standard_normal((RUNS, start.shape[1]))
            near = start + 0.3 * noise * (1.0 + np.abs(start))
            fields.append(held.vector_field(t, near[:, :moving]))
        sums = [summed(np.array(fields))]
        if loop.vehicle.control is None:
            return sums
        one, tick, states = problem.batched_loop(), loop.vehicle.tick, start.copy()
        drawn = problem.drawn()
        for k in range(min(problem.control_instants, TICKS)):
            now, errors = (
                one.holding(k * tick),
                drawn and drawn.measured(loop.group, slice(None), k),
            )
            states = np.array(now.after_instant(k * tick, states, errors))
            states[:, :moving] += tick * now.vector_field(k * tick, states[:, :moving])
    return [*sums, summed(states)]


def row_of(name, label, problem):
    sums = chain.from_iterable(computed(problem))
    return [name, label, " ".join(compiled(problem.loop)), *(f"{x:.15g}" for x in sums)]


# The tests ----------------------------------------------------------------------------------------


def rows():
    lines = ROWS.read_text(encoding="utf-8").splitlines() if ROWS.exists() else []
    return {tuple(line.split("\t")[:2]): line.split("\t")[2:] for line in lines}


EVERY = pytest.mark.ci("traces every shipped loop")


@pytest.mark.parametrize(
    ("name", "label"),
    [pytest.param(*key, marks=[EVERY] * (key not in QUICK), id="-".join(key)) for key in rows()],
)
def test_a_shipped_loop_computes_what_it_computed(name, label):
    digests, *sums = rows()[name, label]
    problem = loops_of(name)[label]
    assert compiled(problem.loop) == digests.split(" ")
    expected = np.reshape([*map(float, sums)], (-1, 2))
    for (value, size), (was, was_size), allowed in zip(
        computed(problem), expected, (FIELD, TICKED)[: len(expected)], strict=True
    ):
        assert value == pytest.approx(was, rel=0, abs=allowed * (1 + was_size))
        assert size == pytest.approx(was_size, rel=allowed)


@pytest.mark.ci("reads every shipped configuration")
def test_every_shipped_loop_has_a_row():
    assert QUICK < {*rows()}
    assert [*rows()] == [(name, label) for name in shipped.names() for label in loops_of(name)]


if __name__ == "__main__":
    lines = []
    for name in shipped.names():
        lines += ["\t".join(row_of(name, *each)) for each in loops_of(name).items()]
    ROWS.write_text("\n".join(lines) + "\n", encoding="utf-8")
