"""heyoka's batch Taylor integrator, compiled from the very laws that run on arrays.

The closed loop's vector field is called once with object arrays of heyoka expressions; what comes
back is compiled. Everything that may differ from run to run is a runtime parameter, so that one
compilation serves all runs of a structure. Compiled code is kept on disk by heyoka itself.
"""

from __future__ import annotations

import copy
import dataclasses
import platform
import threading
import traceback
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any, ClassVar, Literal

import numpy as np

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.core.arrays import FUNCTIONS, Array, register_symbols
from eqt_cli.core.errors import EqtError, TraceError
from eqt_cli.core.numbers import Count, Positive
from eqt_cli.engines.base import Engine, Problem, Progress, Solution, Status
from eqt_cli.engines.switching import Comparisons, Crossing, Switchboard, recording

FULL_CODE_RUNS = 500
FULL_CODE_STATES = 30
MUCH_WORK_RUNS = 10_000
"""Full (not compact) code runs twice as fast and takes 1 s to compile for 25 states, 3.5 s for 37,
7 s for 49: worth it for 500 runs of a small system, or for 10,000 of any (benchmarks/)."""


@dataclass(frozen=True)
class Taylor(Engine):
    """heyoka's adaptive Taylor method, compiled: thousands of times a plain solve_ivp loop.

    Attributes
    ----------
    tol
        Tolerance of a step. Default: rtol / 10.
    rtol
        The accuracy that the results are judged by.
    max_steps
        Most steps that a run may take.
    code
        Generated code: ``full`` runs twice as fast as ``compact`` and takes longer to compile.
    """

    name: ClassVar[str] = "taylor"
    estimates_errors: ClassVar[bool] = True

    tol: Positive | None = None
    rtol: Positive = 1e-9
    max_steps: Count = 100_000
    code: Literal["auto", "full", "compact"] = "auto"

    @classmethod
    def unavailable(cls) -> str | None:
        """Where heyoka is not installed: how to get it."""
        if find_spec("heyoka"):
            return None
        return (
            "engine taylor needs heyoka: pip install 'eqt-cli[taylor]', which exists for Linux on "
            f"x86-64 and arm64 (this is {platform.system()} on {platform.machine()}); "
            "or use engine solve_ivp"
        )

    @property
    def step_tolerance(self) -> float:
        """`tol`, or its default."""
        return self.rtol / 10 if self.tol is None else self.tol

    def problems(self) -> list[tuple[str, str]]:
        """A tolerance that doubles cannot meet, or that asks for nothing."""
        smallest = np.finfo(float).eps
        if smallest <= self.step_tolerance < 1:
            return []
        key = "rtol" if self.tol is None else "tol"
        limits = f"a number from {smallest if self.tol else 10 * smallest:.3g} to 1"
        return [(key, f"expected {limits}, got {getattr(self, key):g}")]

    def tightened(self, factor: float) -> Taylor:
        """The step tolerance times `factor`."""
        tol = max(self.step_tolerance * factor, float(np.finfo(float).eps))
        return dataclasses.replace(self, tol=tol)

    def sized(self, runs: int, state_length: int) -> Taylor:
        """With `code` decided by the size of the whole work, so that no part decides otherwise."""
        if self.code != "auto":
            return self
        small = state_length <= FULL_CODE_STATES and runs >= FULL_CODE_RUNS
        full = small or runs >= MUCH_WORK_RUNS
        return dataclasses.replace(self, code="full" if full else "compact")

    def solve(self, problem: Problem, progress: Progress, workers: int = 1) -> Solution:
        """Integrate in batches of SIMD lanes; each worker thread owns an integrator.

        A lane's steps depend on its own run only, so the results do not depend on the neighbours,
        the order or the number of threads.
        """
        compiled = self._compile(problem.loop)
        parameters = _parameter_rows(problem)[:, : compiled.pars.shape[0]]
        solution = Solution.empty(problem)
        lanes = compiled.batch_size
        batches = iter(range(0, problem.runs, lanes))
        lock = threading.Lock()

        def work() -> None:
            integrator = copy.deepcopy(compiled)
            while True:
                with lock:
                    start = next(batches, None)
                if start is None:
                    return
                runs = np.arange(start, min(start + lanes, problem.runs))
                self._solve_batch(integrator, problem, parameters, runs, solution)
                with lock:
                    progress(len(runs))

        if workers == 1:
            work()
        else:
            _in_threads(work, min(workers, -(-problem.runs // lanes)), batches, lock)
        return solution

    def _compile(self, loop: ClosedLoop) -> Any:
        """An integrator for the structure of a loop, whatever its parameters."""
        variables, derivative = trace(loop)
        return _integrator(variables, derivative, self.step_tolerance, self.code != "full")

    def _solve_batch(
        self,
        integrator: Any,
        problem: Problem,
        parameters: Array,
        runs: Array,
        solution: Solution,
    ) -> None:
        """Integrate up to as many runs as there are lanes, the last one in all lanes left over."""
        lanes = integrator.batch_size
        padded = np.append(runs, np.full(lanes - len(runs), runs[-1]))
        integrator.set_time(float(problem.times[0]))
        integrator.state[:] = problem.states[padded].T
        integrator.pars[:] = parameters[padded].T
        grid = np.repeat(problem.times[:, None], lanes, axis=1)
        _, states = integrator.propagate_grid(grid, max_steps=self.max_steps)
        ends = integrator.propagate_res
        good = np.isfinite(states[-1]).all() and all(_is_success(end[0]) for end in ends)
        if not good and len(set(padded)) > 1:
            # heyoka stops all lanes when one fails; alone, each run ends in its own way.
            for run in runs:
                self._solve_batch(integrator, problem, parameters, np.array([run]), solution)
            return
        count = len(runs)
        solution.states[runs] = states[:, :, :count].transpose(2, 0, 1)
        solution.steps[runs] = [end[3] for end in ends[:count]]
        if not good:
            status, message = self._failure(ends[0][0], float(integrator.time[0]))
            solution.status[runs] = status
            solution.messages[runs[0]] = message

    def _failure(self, end: Any, t: float) -> tuple[Status, str]:
        if end == _heyoka().taylor_outcome.step_limit:
            reason = f"step limit: {self.max_steps} steps (solver.max_steps)"
            return Status.STEP_LIMIT, f"t = {t:.6g} s: {reason}"
        reason = "the state or its derivative is no longer finite"
        return Status.NON_FINITE, f"t = {t:.6g} s: {reason}"


def trace(loop: ClosedLoop) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """The state variables and their derivatives as heyoka expressions.

    Raises
    ------
    TraceError
        If a component does what expressions cannot; it names component, operation and way out.
    """
    heyoka = _heyoka()
    names = [f"y{index:04d}" for index in range(loop.state_length)]
    variables = np.array(heyoka.make_vars(*names), dtype=object)
    try:
        derivative = _symbolic(loop).vector_field(heyoka.time, variables)
    except Exception as error:
        raise TraceError(_explain(error, loop)) from error
    # Entries that are the same in every run come back as plain numbers.
    symbol = heyoka.expression
    rows = [entry if isinstance(entry, symbol) else symbol(float(entry)) for entry in derivative]
    return tuple(variables), tuple(rows)


def _symbolic(loop: ClosedLoop) -> ClosedLoop:
    """The loop with `heyoka.par[k]` for every number that may vary, in the order of the rows."""
    heyoka, index, symbols = _heyoka(), 0, {}
    for name, value in loop.parameters.items():
        entries = [heyoka.par[index + k] for k in range(value.size)]
        symbols[name] = np.array(entries, dtype=object).reshape(value.shape)
        index += value.size
    return loop.with_parameters(symbols)


def _parameter_rows(problem: Problem) -> Array:
    """Every run's parameters in a row, in the order in which they are traced."""
    columns = []
    for name, shared in problem.loop.parameters.items():
        values = problem.varying.get(name)
        if values is None:
            values = np.broadcast_to(shared, (problem.runs, *shared.shape))
        columns.append(values.reshape(problem.runs, -1))
    return np.concatenate(columns, axis=1)


@lru_cache(maxsize=16)
def _integrator(
    variables: tuple[Any, ...], derivative: tuple[Any, ...], tol: float, compact: bool
) -> Any:
    """A compiled integrator; equal expressions give the same one, whichever law they came from."""
    heyoka = _heyoka()
    return heyoka.taylor_adaptive_batch(
        list(zip(variables, derivative, strict=True)),
        np.zeros((len(variables), heyoka.recommended_simd_size())),
        tol=tol,
        compact_mode=compact,
    )


def _in_threads(work: Any, threads: int, batches: Iterator[int], lock: threading.Lock) -> None:
    with ThreadPoolExecutor(threads) as pool:
        futures = [pool.submit(work) for _ in range(threads)]
        try:
            for future in futures:
                future.result()
        except BaseException:
            with lock:
                for _ in batches:  # nothing further is begun; what is under way ends
                    pass
            raise


def _is_success(end: Any) -> bool:
    return bool(end == _heyoka().taylor_outcome.time_limit)


@lru_cache(maxsize=1)
def _heyoka() -> ModuleType:
    """heyoka, imported when first needed, with its functions made known to the laws."""
    try:
        import heyoka
    except ImportError as error:
        raise EqtError(Taylor.unavailable() or f"heyoka cannot be imported: {error}") from error
    functions = {name: getattr(heyoka, name) for name in FUNCTIONS if hasattr(heyoka, name)}
    functions |= {
        "abs": lambda x: heyoka.select(heyoka.lt(x, 0.0), -x, x),
        "less": heyoka.lt,
        "where": heyoka.select,
    }
    register_symbols(heyoka.expression, functions)
    module: ModuleType = heyoka
    return module


def _explain(error: Exception, loop: ClosedLoop) -> str:
    """Which component did what, from the innermost frame that runs in one of them."""
    owner, place = _culprit(error.__traceback__, loop)
    return (
        f"{owner} cannot be compiled: {type(error).__name__}: {error}{place}; write it with "
        "operators, @ and the functions of eqt_cli.core.arrays, or use `engine: solve_ivp`"
    )


def _culprit(trace: TracebackType | None, loop: ClosedLoop) -> tuple[str, str]:
    components = {
        id(component): f"{kind} '{component.name}'"
        for kind, component in (
            ("controller", loop.controller),
            ("reference", loop.reference),
            ("group", loop.group),
        )
    }
    owner, place = "the closed loop", ""
    for frame, line in traceback.walk_tb(trace):
        itself = frame.f_locals.get("self")
        # The traced controller is a copy with symbols in place of its numbers.
        is_controller = type(itself) is type(loop.controller)
        name = components.get(id(loop.controller if is_controller else itself))
        if name:
            summary = traceback.FrameSummary(frame.f_code.co_filename, line, frame.f_code.co_name)
            file = Path(frame.f_code.co_filename).name
            owner, place = name, f" at {file}:{line}: {summary.line}"
    return owner, place
