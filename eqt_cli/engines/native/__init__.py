"""DOP853 in C, compiled on this machine from the same laws that run on arrays.

The closed loop is traced once; its program is emitted as C, and templates in this folder integrate
and evaluate it. Each run has its own steps. All operations are fixed by IEEE 754, so that a run has
the same bits whatever its neighbours, its thread and the compiler.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import EqtError, Problems
from eqt_cli.core.option_types import Count, Positive, Scale
from eqt_cli.engines import stability
from eqt_cli.engines.base import Engine, Measured, Reduction, SampledFunction
from eqt_cli.engines.native import compiler, devices, library
from eqt_cli.engines.native.integrator import Lanes, MeasuringLanes
from eqt_cli.engines.native.library import Rows
from eqt_cli.engines.native.source import SampleProgram
from eqt_cli.engines.problem import Problem, Progress
from eqt_cli.engines.solve_ivp import SolveIvp
from eqt_cli.engines.traced_loop import (
    LoopKey,
    held_rows,
    parameter_rows,
    programs,
    running,
    sampled,
    trace,
)
from eqt_cli.engines.walk import walked
from eqt_cli.program import Program

STEP_SHARE = 1 / 30
"""The tolerance of a step, as a fraction of the accuracy that the results are judged by."""

SMALLEST_RTOL = 1000 * float(np.finfo(float).eps)
"""Smallest `rtol`: of a hundredth of it, the fraction for a step is still above rounding."""

WORTH_COMPILING = 200
"""Number of samples or spans from which a few runs as Python take longer than to compile a law."""

BLOCK_BYTES = 16 * 2**20

GROUP_RUNS = 256
"""Number of runs that a thread integrates at a time: their states and samples fit its cache."""


@dataclass(frozen=True)
class Native(Engine):
    """DOP853 in C, compiled on this machine, in operations that IEEE 754 fixes to the bit.

    Attributes
    ----------
    rtol, atol
        Relative and absolute accuracy that the results are judged by; a step keeps its error below
        a thirtieth of it.
    max_steps
        Most steps that a run may take.
    device
        Where runs are integrated: ``cpu``, ``opencl`` or ``opencl:NUMBER``. It changes no bit.
    """

    name: ClassVar[str] = "native"
    estimates_errors: ClassVar[bool] = True
    threads: ClassVar[bool] = True
    as_fast_in_threads: ClassVar[int] = 2  # measured on two cores
    calls_laws: ClassVar[bool] = False
    part_runs: ClassVar[int] = 2500

    rtol: Annotated[Positive, Scale("relative tolerance")] = 1e-9
    atol: Annotated[Positive, Scale("absolute tolerance")] = 1e-9
    max_steps: Count = 1_000_000
    device: str = devices.CPU

    @classmethod
    def unavailable(cls) -> str | None:
        """Return how to get a compiler; None if there is one."""
        return compiler.missing()

    def check(self, problems: Problems) -> None:
        """Note a tolerance that doubles cannot meet, or that is not below 1."""
        if not SMALLEST_RTOL <= self.rtol < 1:
            limits = f"expected a number from {SMALLEST_RTOL:.3g} to 1"
            problems.at("rtol").add(f"{limits}, got {self.rtol:g}")
        with problems.catching("device"):
            devices.chosen(self.device)

    def tightened(self, factor: float) -> Native:
        """Return the engine with both tolerances times `factor`."""
        return replace(self, rtol=self.rtol * factor, atol=self.atol * factor)

    def work_for_stability(self, rates: Array, duration: float) -> float:
        """Return steps of DOP853."""
        return stability.steps(stability.FUNCTIONS["DOP853"], rates, duration)

    def provenance(self) -> dict[str, str]:
        """Return the compiler, if there is one: shards are packed without."""
        with suppress(EqtError):
            found = compiler.compiler()
            tools = {"compiler": found.described, "lanes": str(found.lanes)}
            if device := devices.chosen(self.device):
                tools["device"] = f"{device.described}, tested with {devices.TEST_RUNS} runs"
            return tools
        return {}

    def integrator(self, problem: Problem) -> Lanes:
        """Return the integrator of lanes, whose steps depend on their own run only."""
        law = programs(LoopKey(problem.loop))
        return Lanes(problem, law, self._settings, self._integration(law.field))

    def _integration(
        self, field: Program, at_samples: SampleProgram | None = None
    ) -> library.Advance:
        """Return what integrates a field, on the CPU or the device."""
        device = devices.chosen(self.device)
        if device is None:
            return library.integration(field, at_samples)
        return devices.integration(field, device, at_samples)

    @property
    def _settings(self) -> dict[str, float]:
        """The tolerances of a step, and the most steps."""
        rtol, atol = self.rtol * STEP_SHARE, self.atol * STEP_SHARE
        return {"rtol": rtol, "atol": atol, "most_steps": self.max_steps}

    def groups(self, problem: Problem, threads: int) -> list[Array]:
        """Return groups of a few runs, equally many per thread; one each with several spans."""
        if self.device != devices.CPU:
            return super().groups(problem, threads)
        of_thread = -(-problem.runs // threads)
        turns = max(1, -(-of_thread // GROUP_RUNS)) if len(problem.spans) == 1 else 1
        size = max(1, -(-problem.runs // (turns * threads)))
        runs = np.arange(problem.runs)
        return [runs[start : start + size] for start in range(0, problem.runs, size)]

    def rehearse(self, problem: Problem) -> None:
        """Trace the law, which may fail, without compiling it."""
        trace(problem.loop)

    def blocks(self, problem: Problem, threads: int = 1) -> list[Array]:
        """Return blocks of as many runs per thread as fit a cache with their results.

        All runs are one block if the horizon has several spans.
        """
        runs = np.arange(problem.runs)
        if len(problem.spans) > 1 or self.device != devices.CPU:
            return [runs]
        fitting = BLOCK_BYTES // (8 * len(problem.times) * problem.loop.state_length)
        size = max(1, fitting) * threads
        return [runs[start : start + size] for start in range(0, problem.runs, size)]

    def evaluate(
        self, function: SampledFunction, problem: Problem, *rows: Array
    ) -> dict[str, Array]:
        """Evaluate by compiled code, if the function can be compiled; else on arrays."""
        loop, times = problem.loop, problem.times
        program = sampled(function, LoopKey(loop), tuple(row.shape[-1] for row in rows))
        if program is None:
            return super().evaluate(function, problem, *rows)
        given = [
            *(Rows(row, by_run=row.ndim == 3, by_sample=True) for row in rows),
            Rows(times[:, None], by_sample=True),
            Rows(parameter_rows(problem), by_run=True),
            Rows(held_rows(loop, times), by_sample=True),
        ]
        evaluated = library.evaluation(program, tuple(each.length for each in given))
        return evaluated(problem.runs, len(times), given)

    def measured(
        self,
        function: SampledFunction,
        reduction: Reduction,
        problem: Problem,
        rows: Sequence[Array],
        kept: Sequence[str] | None,
        workers: int = 1,
        progress: Progress = lambda runs: None,
    ) -> Measured:
        """Solve and measure sample by sample on the way, if not all arrays are asked for.

        Runs with several spans or a sampled law, and functions that cannot be compiled, are
        measured from stored states.
        """
        times, one = problem.times, LoopKey(problem.loop)
        lengths = (problem.loop.state_length, *(row.shape[-1] for row in rows))
        found = None
        if kept is not None and len(problem.spans) == 1 and problem.loop.vehicle.control is None:
            grid = tuple(times.tolist())
            found = running(function, reduction, one, lengths, tuple(kept), grid)
        if found is None:
            return super().measured(function, reduction, problem, rows, kept, workers, progress)
        given = [
            *(Rows(np.ascontiguousarray(row), row.ndim == 3, by_sample=True) for row in rows),
            Rows(times[:, None].copy(), by_sample=True),
            Rows(held_rows(problem.loop, times), by_sample=True),
            Rows(found.columns, by_sample=True),
        ]
        ends, law = replace(problem, times=times[[0, -1]]), programs(one)
        at_samples = SampleProgram(found.at_sample, tuple(row.length for row in given))
        advance = self._integration(law.field, at_samples)
        lanes = MeasuringLanes(ends, law, self._settings, advance, found, times, given)
        solution = walked(lanes, self.groups(ends, workers), progress, workers)
        last = library.evaluation(found.ended, (len(found.starts),))
        numbers = last(problem.runs, 1, [Rows(lanes.memory, by_run=True)])
        ends_at = np.cumsum([math.prod(shape) for _, shape in found.kept])
        stretches = np.split(lanes.kept, ends_at, axis=-1)
        arrays = {
            name: stretch.reshape(*stretch.shape[:2], *shape)
            for (name, shape), stretch in zip(found.kept, stretches, strict=False)
        }
        return Measured(solution, {name: each[:, 0] for name, each in numbers.items()}, arrays)


def compiled_if_faster(engine: Engine, problem: Problem) -> Engine:
    """Return native, as accurate as an explicit method of solve_ivp, if it takes less time.

    Other engines, short problems and laws that cannot be compiled keep their engine.
    """
    if not isinstance(engine, SolveIvp) or engine.method not in stability.FUNCTIONS:
        return engine
    long = max(len(problem.times), len(problem.spans)) >= WORTH_COMPILING
    if not long or Native.unavailable():
        return engine
    try:
        programs(LoopKey(problem.loop))
    except EqtError:
        return engine
    return Native(rtol=max(engine.rtol, SMALLEST_RTOL), atol=engine.atol)
