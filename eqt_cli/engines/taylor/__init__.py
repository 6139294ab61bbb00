"""heyoka's batch Taylor integrator, compiled from the very laws that run on arrays.

The closed loop's vector field is called once with object arrays of heyoka expressions; what comes
back is compiled. Everything that may differ from run to run is a runtime parameter, so that one
compilation serves all runs of a structure. Compiled code is kept on disk by heyoka itself.
"""

from __future__ import annotations

import copy
import dataclasses
import pickle
import platform
import threading
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, lru_cache
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any, ClassVar, Literal

import numpy as np

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.core.arrays import FUNCTIONS, Array, norm, register_symbols
from eqt_cli.core.errors import EqtError, TraceError
from eqt_cli.core.option_types import Count, Positive
from eqt_cli.core.problems import Problems
from eqt_cli.engines import stability
from eqt_cli.engines.base import (
    Engine,
    Problem,
    Progress,
    SampledFunction,
    Solution,
    Span,
    Status,
)
from eqt_cli.engines.taylor.compiling import once
from eqt_cli.engines.taylor.evaluation import CompiledFunction, compiled_function
from eqt_cli.engines.taylor.switching import AtOnce, Comparisons, Crossing, Switchboard, recording

EPSILON = float(np.finfo(float).eps)
SMALLEST_TOL = 10 * EPSILON
"""A tenth of it, for the error estimate, is still a tolerance that doubles can meet."""

FULL_CODE_RUNS = 500
FULL_CODE_STATES = 30
MUCH_WORK_RUNS = 10_000
"""Full (not compact) code runs twice as fast and takes 1 s to compile for 25 states, 3.5 s for 37,
7 s for 49: worth it for 500 runs of a small system, or for 10,000 of any (benchmarks/)."""

BLOCK_BYTES = 4 * 2**20
"""Size of the states of a block: measured, half or twice as much takes a tenth longer. With all
that follows from them they fit a cache of some 10 MiB."""


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
    threads: ClassVar[bool] = True
    cross_check_rank: ClassVar[int | None] = 2
    part_runs: ClassVar[int] = 500

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
            "engine taylor needs heyoka: 'pip install heyoka' on Linux, 'conda install -c "
            "conda-forge heyoka.py' elsewhere "
            f"(this is {platform.system()} on {platform.machine()}); or use engine solve_ivp"
        )

    @property
    def step_tolerance(self) -> float:
        """`tol`, or its default."""
        return self.rtol / 10 if self.tol is None else self.tol

    def check(self, problems: Problems) -> None:
        """A tolerance that doubles cannot meet, or that asks for nothing."""
        if self.tol is None:
            key, value, smallest = "rtol", self.rtol, 10 * SMALLEST_TOL
        else:
            key, value, smallest = "tol", self.tol, SMALLEST_TOL
        if not smallest <= value < 1:
            problems.at(key).add(f"expected a number from {smallest:.3g} to 1, got {value:g}")

    def tightened(self, factor: float) -> Taylor:
        """The step tolerance times `factor`."""
        tol = max(self.step_tolerance * factor, EPSILON)
        return dataclasses.replace(self, tol=tol)

    def work_for_stability(self, rates: Array, duration: float) -> float:
        """Steps: a step is a Taylor polynomial of heyoka's order, −½ ln(tol) + 1."""
        order = max(2, int(np.ceil(1 - np.log(self.step_tolerance) / 2)))
        return stability.steps(stability.taylor(order), rates, duration)

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
        traced = _traced(_One(problem.loop))
        compiled = once(_compiled, traced, self.step_tolerance, self.code != "full")
        parameters = _parameter_rows(problem)
        solution = Solution.unfilled(problem)
        lanes = compiled.integrator.batch_size
        groups = iter(_groups(problem, lanes, workers))
        lock = threading.Lock()

        def report(runs: float) -> None:
            with lock:
                progress(runs)

        def work() -> None:
            own = _own(compiled, threading.get_ident())
            while True:
                with lock:
                    runs = next(groups, None)
                if runs is None:
                    return
                self._solve_group(own, problem, parameters, runs, solution, report)

        if workers == 1:
            work()
        else:
            _in_threads(work, min(workers, -(-problem.runs // lanes)), groups, lock)
        return solution

    def rehearse(self, problem: Problem) -> None:
        """Trace the law, which is what can fail, without compiling it, which takes seconds."""
        trace(problem.loop)

    def blocks(self, problem: Problem) -> list[Array]:
        """Runs of about the same number of steps, and as many as fit a cache with all they give.

        Of a work that is not large, or a law that waits for instants, all runs at once.
        """
        if self.code != "full" or len(problem.spans) > 1:
            return super().blocks(problem)
        lanes = _heyoka().recommended_simd_size()
        fitting = BLOCK_BYTES // (8 * len(problem.times) * problem.loop.state_length)
        size = lanes * max(1, fitting // lanes)
        runs = _by_speed(problem)
        return [np.sort(runs[start : start + size]) for start in range(0, problem.runs, size)]

    def evaluate(
        self, function: SampledFunction, problem: Problem, *rows: Array
    ) -> dict[str, Array]:
        """Compiled as the law is where the work is large, by `sized`; else on arrays."""
        compiled = None
        if self.code == "full":
            lengths = tuple(row.shape[-1] for row in rows)
            compiled = _compiled_samples(
                function, _One(problem.loop), lengths, threading.get_ident()
            )
        if compiled is None:
            return super().evaluate(function, problem, *rows)
        held = _held_rows(problem.loop, problem.times)
        return compiled.at_samples(problem.times, rows, _parameter_rows(problem), held)

    def _solve_group(
        self,
        compiled: _Compiled,
        problem: Problem,
        parameters: Array,
        runs: Array,
        solution: Solution,
        progress: Progress,
    ) -> None:
        """Integrate runs from one known instant to the next, all of them before any goes on.

        So a sampled law is evaluated for all at once. As many runs as there are lanes make a
        batch; the last run fills the lanes that are left over.
        """
        lanes, count = compiled.integrator.batch_size, len(runs)
        padded = np.append(runs, np.full(-count % lanes, runs[-1]))
        states, own = problem.states[padded].T, parameters[padded].T
        steps, first = np.zeros(len(padded), dtype=int), 0
        going = [slice(start, start + lanes) for start in range(0, len(padded), lanes)]
        failed, success = [], _heyoka().taylor_outcome.time_limit
        starts = np.array([span.start for span in problem.spans])
        for span, held in zip(problem.spans, _held_rows(problem.loop, starts), strict=True):
            is_last = span is problem.spans[-1]
            numbers = _with_same(own, held)
            if span.tick is not None:
                errors = problem.errors_at(span.tick, padded)
                states = compiled.at_instant(span.start, states, numbers, errors)
            samples = slice(first, first + span.samples)
            first = samples.stop
            if span.wanted[0] and not span.later:
                solution.states[runs, samples.start] = states[:, :count].T
            for batch in list(going):
                rows, left = runs[batch], self.max_steps - int(steps[batch].max())
                ends, states[:, batch], found = compiled.go(
                    span, states[:, batch], numbers[:, batch], left
                )
                if span.later:
                    solution.states[rows, samples] = found[:, :, : len(rows)].transpose(2, 0, 1)
                steps[batch] += [end[3] for end in ends]
                bad = next((end[0] for end in ends if end[0] != success), None)
                if is_last and not np.isfinite(states[:, batch]).all():
                    bad = bad or success
                if bad is None:
                    continue
                if count == 1:
                    solution.states[runs, first:] = np.nan
                    solution.steps[runs] = steps[:1]
                    self._note_failure(compiled.integrator, problem, solution, int(runs[0]), bad)
                    return
                going.remove(batch)
                failed.append(batch)
            progress(count / len(problem.spans))
        solution.steps[runs] = steps[:count]
        # heyoka stops all lanes when one fails; alone, each run ends in its own way.
        for run in np.concatenate([runs[batch] for batch in failed]) if failed else ():
            alone = np.array([run])
            self._solve_group(compiled, problem, parameters, alone, solution, lambda runs: None)

    def _note_failure(
        self, integrator: Any, problem: Problem, solution: Solution, run: int, end: Any
    ) -> None:
        """Say how the run in all lanes has ended, and when."""
        outcomes, times, states = _heyoka().taylor_outcome, problem.times, solution.states[run]
        t = integrator.time[0]
        states[0] = problem.states[run]  # heyoka has no samples of a first step that failed
        if end == outcomes.cb_stop:
            t -= integrator.last_h[0]  # the last step went wrong
            states[times > t] = np.nan
        at = f"t = {t:.6g} s"
        if np.isnan(t):
            at = f"after t = {times[np.isfinite(states).all(axis=1)][-1]:.6g} s"
        if end == outcomes.step_limit:
            status = Status.STEP_LIMIT
            reason = f"step limit: {self.max_steps} steps (solver.max_steps)"
        elif end == outcomes.cb_stop:
            status = Status.SOLVER_FAILED
            reason = "a comparison in the law has no finite series here; try engine solve_ivp"
        elif end in (outcomes.err_nf_state, outcomes.time_limit):
            status = Status.NON_FINITE
            reason = "the state or its derivative is no longer finite"
        else:
            status = Status.SOLVER_FAILED
            reason = "the law switches back and forth without end; smooth it, as with tanh"
        solution.status[run] = status
        solution.messages[run] = f"{at}: {reason}"


@dataclass(frozen=True, eq=False)
class Traced:
    """A closed loop as heyoka expressions; equal ones compile to the same code.

    Attributes
    ----------
    variables, derivative
        The flat state and its time derivative.
    compared
        The pairs (a, b) that the law compares.
    margins
        Their events (see `switching`).
    steady
        Whether the side of each comparison changes at its events only.
    own_parameters
        The number of parameters of the law itself.
    after_instant
        The state after a control instant; empty where the law is not sampled.
    """

    variables: tuple[Any, ...]
    derivative: tuple[Any, ...]
    compared: tuple[tuple[Any, Any], ...]
    margins: tuple[Any, ...]
    steady: tuple[bool, ...]
    own_parameters: int
    after_instant: tuple[Any, ...] = ()

    @cached_property
    def _bytes(self) -> bytes:
        # heyoka compares expressions as trees, which are long where parts are used many times.
        law = self.variables, self.derivative, self.compared, self.margins, self.after_instant
        return pickle.dumps(law)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Traced) and self._bytes == other._bytes

    def __hash__(self) -> int:
        return hash(self._bytes)


@dataclass(frozen=True, eq=False)
class _One:
    """A loop that is equal to itself only; what is traced of it once is not traced again."""

    loop: ClosedLoop

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _One) and self.loop is other.loop

    def __hash__(self) -> int:
        return id(self.loop)


@lru_cache(maxsize=64)
def _traced(one: _One) -> Traced:
    return trace(one.loop)


def trace(loop: ClosedLoop) -> Traced:
    """The closed loop as expressions.

    Raises
    ------
    TraceError
        If a component does what expressions cannot; it names component, operation and way out.
    """
    heyoka = _heyoka()
    variables = _symbols(loop.state_length)
    parameters = sum(value.size for value in _numbers(loop).values())
    comparisons = Comparisons(heyoka, parameters)
    token = recording.set(comparisons)
    try:
        # A law is promised a leading run axis; here it has one entry.
        symbolic = _symbolic(loop)
        (derivative,) = symbolic.vector_field(heyoka.time, variables[None])
        after: Array = np.empty(0, dtype=object)
        if loop.vehicle.control is not None:
            recording.set(AtOnce(heyoka))
            errors = _error_symbols(loop, parameters)
            (after,) = symbolic.after_instant(heyoka.time, variables[None], errors)
    except Exception as error:
        raise TraceError(_explain(error, loop)) from error
    finally:
        recording.reset(token)
    # Entries that are the same in every run come back as plain numbers.
    symbol = heyoka.expression
    rows, later = (
        [entry if isinstance(entry, symbol) else symbol(float(entry)) for entry in entries]
        for entries in (derivative, after)
    )
    compared, margins = tuple(comparisons.pairs), tuple(comparisons.margins())
    steady = tuple(comparisons.steady())
    return Traced(
        tuple(variables), tuple(rows), compared, margins, steady, parameters, tuple(later)
    )


@lru_cache(maxsize=64)
def _compiled_samples(
    function: SampledFunction, one: _One, lengths: tuple[int, ...], thread: int
) -> CompiledFunction | None:
    """A function of the loop, compiled for a thread; None where it does what expressions cannot.

    Unlike a law, what is measured of one need not be compiled: an actuator may say by NumPy alone
    where it is at its limit, and a law what its Lyapunov function is.
    """
    heyoka = _heyoka()
    variables = _symbols(sum(lengths))
    rows = np.split(variables[None], np.cumsum(lengths)[:-1], axis=1)
    token = recording.set(AtOnce(heyoka))
    try:
        arrays = function(_symbolic(one.loop), heyoka.time, *rows)
    except Exception:
        return None
    finally:
        recording.reset(token)
    return compiled_function(heyoka, list(variables), arrays)


def _symbols(count: int) -> Array:
    """Symbols for the entries of flat states, or of other rows of numbers."""
    names = [f"y{index:04d}" for index in range(count)]
    return np.array(_heyoka().make_vars(*names), dtype=object)


def _symbolic(loop: ClosedLoop) -> ClosedLoop:
    """The loop with `heyoka.par[k]` for every number that may vary, in the order of the rows."""
    heyoka, index, symbols = _heyoka(), 0, {}
    for name, value in _numbers(loop).items():
        entries = [heyoka.par[index + k] for k in range(value.size)]
        symbols[name] = np.array(entries, dtype=object).reshape(1, *value.shape)
        index += value.size
    own = {name: symbols[name] for name in loop.parameters}
    held = {name: symbol for name, symbol in symbols.items() if name not in own}
    return loop.with_parameters(own).holding(held)


def _numbers(loop: ClosedLoop) -> dict[str, Array]:
    """Every number of the loop that is no part of its structure: parameters, and what it holds."""
    held = {name: np.asarray(value) for name, value in loop.held(0.0).items()}
    return loop.parameters | held


def _error_symbols(loop: ClosedLoop, first: int) -> tuple[Array, Array] | None:
    """The errors of measurement at an instant, as the parameters from the first on."""
    if not loop.vehicle.measures:
        return None
    d, m = loop.group.size, loop.group.dimension
    symbols = np.array([_heyoka().par[first + k] for k in range(d * d + m)], dtype=object)
    return symbols[: d * d].reshape(1, d, d), symbols[d * d :].reshape(1, m)


def _held_rows(loop: ClosedLoop, times: Array) -> Array:
    """What the loop holds from each of these times to the next instant, a row each."""
    held = [np.asarray(value) for value in loop.held(times).values()]
    rows = [value.reshape(len(times), -1) for value in held]
    return np.concatenate([np.empty((len(times), 0)), *rows], axis=1)


def _parameter_rows(problem: Problem) -> Array:
    """Every run's parameters in a row, in the order in which they are traced."""
    columns = []
    for name, shared in problem.loop.parameters.items():
        values = problem.varying.get(name)
        if values is None:
            values = np.broadcast_to(shared, (problem.runs, *shared.shape))
        columns.append(values.reshape(problem.runs, -1))
    return np.concatenate(columns, axis=1)


@dataclass(frozen=True, eq=False)
class _Compiled:
    """An integrator of as many runs as there are SIMD lanes; every thread needs its own."""

    integrator: Any
    board: Switchboard | None
    after_instant: Any = None

    def at_instant(
        self, t: float, states: Array, numbers: Array, errors: tuple[Array, Array] | None
    ) -> Array:
        """The states after a control instant, ``(n, runs)``, of any number of full batches."""
        runs = states.shape[1]
        if errors is not None:
            numbers = np.concatenate([numbers, *(part.reshape(runs, -1).T for part in errors)])
        used = np.ascontiguousarray(numbers[: self.after_instant.nparams])
        after: Array = self.after_instant(
            np.ascontiguousarray(states), pars=used, time=np.full(runs, t)
        )
        return after

    def go(
        self, span: Span, states: Array, numbers: Array, most_steps: int
    ) -> tuple[list[Any], Array, Array]:
        """Integrate a batch through a span, by the numbers of the law in every lane.

        Comparisons are looked at after every step only where looking at the end has found that a
        switch was missed: it takes as long as the step itself.

        Returns
        -------
        ends
            How each lane has ended.
        states : (n, lanes)
            At the end.
        samples : (samples, n, lanes)
            All of the span where any is behind its start; else none.
        """
        outcomes = _heyoka().taylor_outcome
        if most_steps <= 0:
            lost = np.full((span.samples, *states.shape), np.nan)
            return [(outcomes.step_limit, 0.0, 0.0, 0)] * states.shape[1], states, lost
        found = self._propagate(span, states, numbers, most_steps)
        expected = (outcomes.time_limit, outcomes.step_limit)
        if self.board is None or (
            all(end[0] in expected for end in found[0]) and self.board.is_right(self.integrator)
        ):
            return found
        return self._propagate(span, states, numbers, most_steps, callback=self.board.check)

    def _propagate(
        self, span: Span, states: Array, numbers: Array, most_steps: int, **watch: Any
    ) -> tuple[list[Any], Array, Array]:
        """As `go`; what is to be called after every step may be given."""
        integrator, lanes = self.integrator, states.shape[1]
        integrator.set_time(span.start)
        integrator.state[:] = states
        self._set_parameters(numbers)
        if not span.later:  # without dense output, up to three times as fast
            integrator.propagate_until(span.stop, max_steps=most_steps, **watch)
            return integrator.propagate_res, integrator.state, integrator.state[:0]
        grid = np.repeat(span.grid[:, None], lanes, axis=1)
        _, found = integrator.propagate_grid(grid, max_steps=most_steps, **watch)
        wanted = found if span.wanted.all() else found[span.wanted]
        return integrator.propagate_res, integrator.state, wanted

    def _set_parameters(self, values: Array) -> None:
        """The numbers of the law in every lane, ``(numbers, lanes)``; the state is set."""
        used = self.integrator.pars
        if self.board is None:
            used[:] = values[: len(used)]  # heyoka has none behind the last one that occurs
        else:
            used[: len(values)] = values
            self.board.start(self.integrator)


@lru_cache(maxsize=16)
def _compiled(traced: Traced, tol: float, compact: bool) -> _Compiled:
    """Compile a law, or find it among those compiled before."""
    heyoka = _heyoka()
    events, board = [], None
    if traced.compared:
        a, b = zip(*traced.compared, strict=True)
        values = heyoka.cfunc([*a, *b], list(traced.variables))
        board = Switchboard(traced.own_parameters, np.array(traced.steady), values)
        events = [
            heyoka.t_event_batch(margin, callback=Crossing(board, index), cooldown=0.0)
            for index, margin in enumerate(traced.margins)
        ]
    integrator = heyoka.taylor_adaptive_batch(
        list(zip(traced.variables, traced.derivative, strict=True)),
        np.zeros((len(traced.variables), heyoka.recommended_simd_size())),
        tol=tol,
        compact_mode=compact,
        t_events=events,
    )
    after = traced.after_instant
    instant = heyoka.cfunc(list(after), list(traced.variables)) if after else None
    return _Compiled(integrator, board, instant)


@lru_cache(maxsize=32)
def _own(compiled: _Compiled, thread: int) -> _Compiled:
    """The copy of a thread, which takes as long to make as a run to integrate."""
    return copy.deepcopy(compiled)


def _by_speed(problem: Problem) -> Array:
    """The runs in an order in which neighbours take about the same number of steps.

    A batch ends with the slowest of its runs; the faster a motion begins, the more steps it takes.
    """
    return np.argsort(norm(problem.states), kind="stable")


def _groups(problem: Problem, lanes: int, threads: int) -> list[Array]:
    """The runs that go together: a batch, or a thread's share where the law waits for instants."""
    runs = _by_speed(problem)
    batches = -(-problem.runs // lanes)
    size = lanes if len(problem.spans) == 1 else lanes * -(-batches // threads)
    return [runs[start : start + size] for start in range(0, problem.runs, size)]


def _with_same(values: Array, same: Array) -> Array:
    """Rows of numbers of every run, and behind them those that are the same in all."""
    if not len(same):
        return values
    return np.concatenate([values, np.repeat(same[:, None], values.shape[1], axis=1)])


def _in_threads(work: Any, threads: int, groups: Iterator[Array], lock: threading.Lock) -> None:
    with ThreadPoolExecutor(threads) as pool:
        futures = [pool.submit(work) for _ in range(threads)]
        try:
            for future in futures:
                future.result()
        except BaseException:
            with lock:
                for _ in groups:  # nothing further is begun; what is under way ends
                    pass
            raise


@lru_cache(maxsize=1)
def _heyoka() -> ModuleType:
    """heyoka, imported when first needed, with its functions made known to the laws."""
    try:
        import heyoka
    except ImportError as error:
        raise EqtError(Taylor.unavailable() or f"heyoka cannot be imported: {error}") from error
    heyoka.set_logger_level_error()  # its warnings are in the outcome of the runs concerned
    functions = {name: getattr(heyoka, name) for name in FUNCTIONS if hasattr(heyoka, name)}
    functions |= {
        "abs": lambda x: heyoka.select(recording.get().less(x, 0.0), -x, x),
        "less": lambda a, b: recording.get().less(a, b),
        "smooth_less": lambda a, b: recording.get().smooth_less(a, b),
        "where": heyoka.select,
    }
    register_symbols(heyoka.expression, functions)
    heyoka.expression.__pow__ = _with_whole_powers(heyoka.expression.__pow__)
    module: ModuleType = heyoka
    return module


def _with_whole_powers(power: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """heyoka's ``**``, but cubes and higher whole powers as products: its own are NaN at 0."""

    def whole_or_other_power(base: Any, exponent: Any) -> Any:
        whole = isinstance(exponent, int | float | np.integer) and exponent % 1 == 0
        if not whole or exponent < 3:
            return power(base, exponent)
        half = whole_or_other_power(base, exponent // 2)
        return half * half * base if exponent % 2 else half * half

    return whole_or_other_power


def _explain(error: Exception, loop: ClosedLoop) -> str:
    """Which component did what, from the frames of the traceback that run in one."""
    places = _places(error.__traceback__, loop) or {"the closed loop": ""}
    (owner, place), *callers = reversed(places.items())
    called = "".join(f", called by {name} at {where}" for name, where in callers)
    return (
        f"{owner} cannot be compiled: {type(error).__name__}: {error}"
        f"{place and ' at ' + place}{called}; write it with operators, @ and the functions of "
        "eqt_cli.core.arrays, or use `engine: solve_ivp`"
    )


def _places(trace: TracebackType | None, loop: ClosedLoop) -> dict[str, str]:
    """The components in the traceback, the innermost last, and how far each has come."""
    components = {
        id(component): f"{kind} '{component.name}'"
        for kind, component in (
            ("controller", loop.controller),
            ("reference", loop.reference),
            ("group", loop.group),
        )
    }
    places: dict[str, str] = {}
    for frame, line in traceback.walk_tb(trace):
        itself = frame.f_locals.get("self")
        # The traced controller is a copy with symbols in place of its numbers.
        is_controller = type(itself) is type(loop.controller)
        name = components.get(id(loop.controller if is_controller else itself))
        if name:
            summary = traceback.FrameSummary(frame.f_code.co_filename, line, frame.f_code.co_name)
            places[name] = f"{Path(frame.f_code.co_filename).name}:{line}: {summary.line}"
    return places
