"""CPU times of calls of laws, repeated at the inputs that a result has recorded."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import thread_time
from timeit import timeit
from typing import Any

import numpy as np

from eqt_cli.api.loading import ResultPath, open_at
from eqt_cli.base.arrays import Array, Arrays
from eqt_cli.base.errors import EqtError, EqtWarning, TraceError
from eqt_cli.base.files import text_of
from eqt_cli.base.reporting import reporter, step
from eqt_cli.components.laws import RunsCode
from eqt_cli.components.mechanics import LawInput
from eqt_cli.config.document import document_of
from eqt_cli.config.preflight import build
from eqt_cli.engines import library
from eqt_cli.engines.native import law_of
from eqt_cli.extensions.code.controllers import Code
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.loop.law_program import INPUT, MEMORY, NUMBER
from eqt_cli.results.result import Result, check_stored
from eqt_cli.results.timing import late_lines, machine, statistics

CALLS = 500
"""Number of inputs at which a law is called, in whole runs."""

SHORTEST = 5e-4
"""CPU time below which calls are repeated in a loop, s; Python takes 1e-5 to begin it."""


def spent_on(function: Callable[[], object]) -> float:
    """Return the CPU time of a function, s."""
    return timeit(function, timer=thread_time, number=1)


SINGLY, IN_LOOPS, BY_NUMPY = "Python, one by one", "C, in loops", "NumPy, in loops"


def call_times(
    path: ResultPath,
    controllers: str | Sequence[str] = (),
    point: int | None = None,
    trust_plugins: bool = False,
) -> dict[str, Any]:
    """Call the laws of a result again, at the inputs that it has recorded, and time the calls.

    A law in Python is called one by one, and timed in its process. A law in C, and one of eqt as
    `native` compiles it, takes less than clocks resolve: each input is repeated until the calls
    take half a millisecond, whose mean counts. The memory of a law goes on from sample to sample.

    Parameters
    ----------
    path
        The result.
    controllers
        Labels of laws. Default: all.
    point
        Point of a sweep.
    trust_plugins
        Whether to execute the code of the laws that is stored in the result.

    Returns
    -------
    dict
        ``machine``, ``cpu_count`` and ``load``; ``laws``, of each label ``title``, the CPU times
        ``median``, ``99 %`` and ``largest`` of a call, s, the number of ``calls``, and ``how`` they
        were made; ``late``, which law would answer too late.

    Raises
    ------
    EqtError
        If there is no such law, its code cannot be executed, or no trajectories are stored.

    Examples
    --------
    >>> sorted(eqt_cli.call_times("results/paper", "eqt")["laws"]["eqt"])
    ['99 %', 'calls', 'how', 'largest', 'median', 'title']
    """
    with open_at(path, point) as opened:
        result = opened.single("the laws of one experiment are timed")
        check_stored(result, "pose", "velocity", who="timing a law at its inputs needs")
        names = [controllers] if isinstance(controllers, str) else controllers
        labels = [result.labels[result.position_of(name)] for name in names or result.labels]
        loops = build(document_of(result, trust_plugins)).loops
        laws = dict[str, dict[str, Any]]()
        with step("laws timed", len(labels)):
            for label in labels:
                law = loops[label].controller
                if isinstance(law, Code) and _has_changed(law):
                    changed = "has changed since the run, whose law is timed; run it again"
                    reporter().remark(EqtWarning(f"{law.file} {changed}"))
                seconds, how = _timed(result, label, loops[label])
                laws[label] = {"title": result.title_of[label], **statistics(seconds), "how": how}
                reporter().advance(1)
        return machine() | {"laws": laws, "late": [*late_lines(result, laws)]}


def _has_changed(law: Code) -> bool:
    """Return whether the file of a law, in this folder, is not the one that has flown."""
    file = Path(law.file)
    return file.is_file() and text_of(file, "it is a law", EqtError) not in law.called.code.text


def _timed(result: Result, label: str, loop: ClosedLoop) -> tuple[list[float], str]:
    """Return the CPU time of a call at each input, s, and how it was called."""
    law, repeats, seconds = loop.controller, 1, list[float]()
    drained = law.drained if isinstance(law, RunsCode) else list
    prepare, how = _caller(loop)
    drained()  # of what was tried before
    for run in _states(result, label, loop):
        memory: Arrays = {name: z[None] for name, z in loop.memory(run[0]).items()}
        for t, state in zip(result.times, run, strict=True):
            here = loop.holding(t)
            inputs = here.law_input(t, state[None])
            _, later = here.answer(inputs, memory, loop.period)
            if singly := drained():
                seconds, how = seconds + singly, SINGLY
            else:
                prepare(inputs, memory, 1)()  # compiles it, and fills caches
                while (spent := prepare(inputs, memory, repeats)()) < SHORTEST:
                    repeats *= 2
                seconds.append(spent / repeats)
            memory = later
    return seconds, how


def _states(result: Result, label: str, loop: ClosedLoop) -> Array:
    """Return the states of good runs at the samples, ``(runs, samples, n)``."""
    law, times, place = loop.controller, result.times, result.position_of(label)
    keeps = isinstance(law, RunsCode) and (law.memory(loop.group) or law.in_order)
    if keeps and 0 < 1.5 * loop.period < np.diff(times).max():
        sparse = "starts from what it kept at the last sample, not a period before"
        reporter().remark(EqtWarning(f"{label} {sparse}; store a sample per control.period"))
    runs = -(-CALLS // len(times))
    Q, V = (result.trajectories(name, place, runs) for name in ("pose", "velocity"))
    states = loop.initial_state(Q, V, result["desired_pose"], result["desired_velocity"], times)
    if not len(states):
        raise result.error(f"stores no run of '{label}' that did not fail")
    return states


Caller = Callable[[LawInput, Arrays, int], Callable[[], float]]
"""Prepares so many calls of a law at one input, which return their CPU time, s."""


def _caller(loop: ClosedLoop) -> tuple[Caller, str]:
    """Return what prepares calls of a law, and how these are made."""
    period, law = loop.period, loop.controller

    def code(inputs: LawInput, memory: Arrays, n: int) -> Callable[[], float]:
        many = partial(np.repeat, repeats=n, axis=0)
        if isinstance(law, Code):
            s = inputs.tracking(loop.group, loop.inertia, loop.gains, memory)
            rows, numbers, before = map(many, law.rows(s))
            return partial(law.called.time_of, numbers, period, before, rows)
        equal = inputs.mapped(lambda part: many(part) if np.ndim(part) else part)  # of a network
        states = {name: many(z) for name, z in memory.items()}
        return partial(spent_on, partial(loop.answer, equal, states, period))

    def formula(inputs: LawInput, memory: Arrays, n: int) -> Callable[[], float]:
        here = loop.holding(inputs.t)
        return partial(spent_on, lambda: [here.answer(inputs, memory, period) for _ in range(n)])

    def compiled(inputs: LawInput, memory: Arrays, n: int) -> Callable[[], float]:
        here = replace(loop, held_law=law.held(loop.group, inputs.t))
        values = {NUMBER + name: x for name, x in program.values(here).items()}
        values |= {INPUT + entry.name: getattr(inputs, entry.source) for entry in program.inputs}
        values |= {MEMORY + entry.name: memory[entry.source] for entry in program.memory}
        groups = [library.Rows(np.ravel(values[name])) for name, _ in program.step.inputs]
        return partial(spent_on, lambda: library.evaluated(program.step, n, 1, groups, lanes=1))

    if isinstance(law, RunsCode):
        return code, IN_LOOPS
    try:
        program = law_of(loop)
    except TraceError:  # it does what programs cannot
        return formula, BY_NUMPY
    return compiled, IN_LOOPS
