"""Times and errors of one contender on one case."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from benchmarks.cases import Case, Motion, errors
from benchmarks.contenders.base import Contender

T = TypeVar("T")

AT_MOST = 3.0
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
    contender: Contender, case: Case, tolerance: float, reference: Motion, repeats: int
) -> Measurement:
    """Compile, then time the fastest of several solutions, then judge the last."""
    began = time.perf_counter()
    solve = contender.prepare(case, tolerance)
    compilation = time.perf_counter() - began
    solution, wall, cpu, done = fastest(solve, repeats)
    found = contender.motion(case, solution)
    each = errors(found, reference)
    scale = case.size / each.size
    return Measurement(
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


def fastest(function: Callable[[], Any], repeats: int) -> tuple[Any, float, float, int]:
    """What a function returns, its least wall and CPU time, and how often it was called."""
    wall, cpu, done = np.inf, np.inf, 0
    while done < repeats and (done == 0 or wall < AT_MOST):
        result, took, worked = timed(function)
        wall, cpu, done = min(wall, took), min(cpu, worked), done + 1
    return result, wall, cpu, done


def timed(function: Callable[[], T]) -> tuple[T, float, float]:
    """What a function returns, and the wall and CPU time of this process and its threads."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = function()
    return result, time.perf_counter() - wall, time.process_time() - cpu


def load() -> float:
    """How many processes want a core just now; the measurements want to be alone."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
