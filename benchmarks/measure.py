"""Times and errors of one contender on one case."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import numpy as np

from benchmarks.cases import Case, Motion, errors
from benchmarks.contenders.base import Contender

T = TypeVar("T")

AT_MOST = 60.0
"""Seconds; what takes longer is not repeated."""


@dataclass(frozen=True)
class Measurement:
    """One contender at one tolerance.

    Attributes
    ----------
    contender, case
        Their names.
    compilation
        Wall time before the first solution, s.
    wall, cpu
        Of the fastest of `repeats`, s, for all runs of the case.
    timed_runs
        How many of them were integrated; times are extrapolated where they are fewer.
    largest_error, median_error
        Over the runs that were integrated.
    """

    contender: str
    case: str
    tolerance: float
    compilation: float
    wall: float
    cpu: float
    repeats: int
    runs: int
    timed_runs: int
    largest_error: float
    median_error: float


def measure(
    contenders: Sequence[tuple[Contender, float]], case: Case, reference: Motion, repeats: int
) -> Iterator[Measurement]:
    """Compile each contender for its tolerance, time the solutions in turn, then judge the last."""
    solves, compilations = [], []
    for contender, tolerance in contenders:
        began = time.perf_counter()
        solves.append(contender.prepare(case, tolerance))
        compilations.append(time.perf_counter() - began)
    found = zip(contenders, compilations, in_turn(solves, repeats), strict=True)
    for (contender, tolerance), compilation, (solution, wall, cpu, done) in found:
        each = errors(contender.motion(case, solution), reference)
        scale = case.size / each.size
        yield Measurement(
            contender=contender.name,
            case=case.name,
            tolerance=tolerance,
            compilation=compilation,
            wall=wall * scale,
            cpu=cpu * scale,
            repeats=done,
            runs=case.size,
            timed_runs=each.size,
            largest_error=float(each.max()),
            median_error=float(np.median(each)),
        )


class Timed(NamedTuple):
    """What a function returned last, its least wall and CPU time, and how often it was called."""

    result: Any
    wall: float
    cpu: float
    repeats: int


def fastest(function: Callable[[], Any], repeats: int) -> Timed:
    """Time a function by itself."""
    return in_turn([function], repeats)[0]


def in_turn(functions: Sequence[Callable[[], Any]], repeats: int) -> list[Timed]:
    """Time functions one after the other, so often that a load of the machine meets all of them."""
    found = [Timed(None, np.inf, np.inf, 0)] * len(functions)
    for _ in range(repeats):
        for place, (function, (_, wall, cpu, done)) in enumerate(
            zip(functions, found, strict=True)
        ):
            if done == 0 or wall < AT_MOST:
                result, took, worked = timed(function)
                found[place] = Timed(result, min(wall, took), min(cpu, worked), done + 1)
    return found


def timed(function: Callable[[], T]) -> tuple[T, float, float]:
    """What a function returns, and the wall and CPU time of this process and its threads."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = function()
    return result, time.perf_counter() - wall, time.process_time() - cpu


def load() -> float:
    """How many processes want a core just now; the measurements want to be alone."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
