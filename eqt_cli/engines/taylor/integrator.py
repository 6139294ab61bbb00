"""heyoka's batch integrators, with one run per SIMD lane, for any number of runs."""

from __future__ import annotations

import copy
import threading
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Self

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.engines.integrator import Failure, Integrator, SpanResult
from eqt_cli.engines.problem import Problem, Span, Status
from eqt_cli.engines.taylor import knots, switching
from eqt_cli.engines.taylor.expressions import Expressions
from eqt_cli.engines.taylor.library import heyoka_module
from eqt_cli.engines.taylor.switching import NUMBERS, Crossing, Switchboard, comparisons
from eqt_cli.engines.traced_loop import LoopPrograms, parameter_rows
from eqt_cli.vehicle.sensors.channels import Errors


@dataclass(frozen=True, eq=False)
class BatchIntegrator:
    """An integrator of one run per SIMD lane; every thread needs its own."""

    heyoka: Any
    board: Switchboard | None
    after_instant: Any = None

    @property
    def lanes(self) -> int:
        """The number of runs integrated at once."""
        lanes: int = self.heyoka.batch_size
        return lanes

    def go(
        self, span: Span, states: Array, numbers: Array, most_steps: int
    ) -> tuple[list[Any], Array, Array]:
        """Integrate a batch through a span, with the numbers of the law in every lane.

        Comparisons are checked at the end, and after every step only if a switch was missed: such a
        check takes as long as the step itself.

        Returns
        -------
        ends
            heyoka's outcome of each lane.
        states : (n, lanes)
            States at the end.
        samples : (later, n, lanes)
            Samples after the start.
        """
        outcomes = heyoka_module().taylor_outcome
        if most_steps <= 0:
            lost = np.full((span.later, *states.shape), np.nan)
            return [(outcomes.step_limit, 0.0, 0.0, 0)] * states.shape[1], states, lost
        found = self._propagate(span, states, numbers, most_steps)
        expected = (outcomes.time_limit, outcomes.step_limit)
        if self.board is None or (
            all(end[0] in expected for end in found[0]) and self.board.is_right(self.heyoka)
        ):
            return found
        return self._propagate(span, states, numbers, most_steps, callback=self.board.check)

    def _propagate(
        self, span: Span, states: Array, numbers: Array, most_steps: int, **watch: Any
    ) -> tuple[list[Any], Array, Array]:
        """Integrate as `go`, with an optional callback after every step."""
        integrator, lanes = self.heyoka, states.shape[1]
        integrator.set_time(span.start)
        integrator.state[:] = states
        self._set_parameters(numbers)
        if not span.later:  # without dense output, up to three times as fast
            integrator.propagate_until(span.stop, max_steps=most_steps, **watch)
            return integrator.propagate_res, integrator.state, np.empty((0, *states.shape))
        grid = np.repeat(span.grid[:, None], lanes, axis=1)
        _, found = integrator.propagate_grid(grid, max_steps=most_steps, **watch)
        return integrator.propagate_res, integrator.state, found[1 : 1 + span.later]

    def _set_parameters(self, values: Array) -> None:
        """Set the numbers of the law in every lane, ``(numbers, lanes)``, after the state."""
        used = self.heyoka.pars
        if self.board is None:
            used[:] = values[: len(used)]  # heyoka has no parameters after the last one used
        else:
            used[: len(values)] = values
            self.board.start(self.heyoka)


@lru_cache(maxsize=16)
def compiled(law: LoopPrograms, knotted: bool, tol: float, compact: bool) -> BatchIntegrator:
    """Compile a law; the last ones are kept.

    Its parameters are those of the field, then the time of the next knot if it passes knots, and
    the numbers of its comparisons.
    """
    heyoka, field = heyoka_module(), Expressions.of(law.field)
    compared, knot = comparisons(law.field), field.parameters
    pairs = [(field.values[a], field.values[b]) for a, b in compared]
    board, first, events = None, knot + knotted, []
    if pairs:
        values = heyoka.cfunc([*(a for a, _ in pairs), *(b for _, b in pairs)], field.state)
        board = Switchboard(first, np.array(list(compared.values())), values)
        for index, (a, b) in enumerate(pairs):
            margin = switching.margin(heyoka, a, b, first + NUMBERS * index)
            crossing = Crossing(board, index)
            events.append(heyoka.t_event_batch(margin, callback=crossing, cooldown=0.0))
    if knotted:
        events.append(knots.event(heyoka, knot, board))
    integrator = heyoka.taylor_adaptive_batch(
        list(zip(field.state, field.outputs, strict=True)),
        np.zeros((len(field.state), heyoka.recommended_simd_size())),
        tol=tol,
        compact_mode=compact,
        t_events=events,
    )
    instant = None
    if law.after_instant:
        after = Expressions.of(law.after_instant)
        instant = heyoka.cfunc(after.outputs, after.state)
    return BatchIntegrator(integrator, board, instant)


@lru_cache(maxsize=32)
def own(compiled: BatchIntegrator, thread: int) -> BatchIntegrator:
    """Return the copy of a thread; to make one takes as long as to integrate a run."""
    return copy.deepcopy(compiled)


class Batches(Integrator):
    """Integrates a group of runs batch by batch; the last run fills the remaining lanes.

    heyoka stops all lanes when one fails. The runs of such a batch are integrated alone.

    Parameters
    ----------
    compiled
        The law; every thread takes its own copy.
    most_steps
        Most steps that a run may take.
    """

    def __init__(self, problem: Problem, compiled: BatchIntegrator, most_steps: int) -> None:
        super().__init__(problem)
        self._batch, self._most_steps = compiled, most_steps
        self._held, self._parameters = knots.held_from(problem), parameter_rows(problem)

    def for_thread(self) -> Self:
        """Return an integrator with its own copy of the compiled law."""
        other = copy.copy(self)
        other._batch = own(self._batch, threading.get_ident())
        return other

    def begin(self, runs: Array) -> None:
        """Begin these runs in batches, none of which has failed."""
        if self._batch.after_instant is None:
            super().begin(runs)
        lanes, count = self._batch.lanes, len(runs)
        self._filled = np.append(np.arange(count), np.full(-count % lanes, count - 1))
        self._own = self._parameters[runs[self._filled]].T
        self._batches = [slice(k, k + lanes) for k in range(0, len(self._filled), lanes)]
        self._steps = np.zeros(len(self._filled), dtype=int)
        self._failed: set[int] = set()
        knots.pieces.set(self._held)

    def hold(self, span: Span) -> None:
        """Set the held numbers in all lanes, after the parameters."""
        self._numbers, held = self._own, self._held[span.start]
        if len(held):
            same = np.repeat(held[:, None], len(self._filled), axis=1)
            self._numbers = np.concatenate([self._own, same])

    def at_instant(self, t: float, states: Array, errors: Errors | None) -> Array:
        """Return the states after an instant, by compiled code for all batches at once.

        On arrays, if the law is the user's code.
        """
        numbers, code = self._numbers, self._batch.after_instant
        if code is None:
            return super().at_instant(t, states, errors)
        lanes = np.ascontiguousarray(states.T[:, self._filled])
        for part in errors.of_runs if errors else ():
            numbers = np.concatenate([numbers, part[self._filled].reshape(len(lanes.T), -1).T])
        used = np.ascontiguousarray(numbers[: code.nparams])
        after: Array = code(lanes, pars=used, time=np.full(len(lanes.T), t))
        return after[:, : len(states)].T

    def advance(self, span: Span, states: Array) -> SpanResult:
        """Integrate batch by batch, leaving failed ones as they are."""
        runs, n = states.shape
        lanes, before = states.T[:, self._filled], self._steps.copy()
        success, found = heyoka_module().taylor_outcome.time_limit, []
        failed: dict[int, Failure | None] = {}
        for batch in self._batches:
            if batch.start in self._failed:
                found.append(np.full((span.later, n, self._batch.lanes), np.nan))
                continue
            left = self._most_steps - int(self._steps[batch].max())
            ends, lanes[:, batch], samples = self._batch.go(
                span, lanes[:, batch], self._numbers[:, batch], left
            )
            found.append(samples)
            self._steps[batch] += [end[3] for end in ends]
            bad = next((end[0] for end in ends if end[0] != success), None)
            if bad is not None:
                self._failed.add(batch.start)
                failed |= dict.fromkeys(range(batch.start, min(batch.stop, runs)), None)
                if runs == 1:
                    failed[0] = self._failure(bad)
        joined = found[0] if len(found) == 1 else np.concatenate(found, axis=2)
        return SpanResult(
            lanes[:, :runs].T,
            joined[:, :, :runs].transpose(2, 0, 1),
            (self._steps - before)[:runs],
            failed,
        )

    def _failure(self, end: Any) -> Failure:
        """Return how and when the run in all lanes has ended."""
        outcomes, integrator = heyoka_module().taylor_outcome, self._batch.heyoka
        t = float(integrator.time[0])
        if end == outcomes.step_limit:
            reason = f"step limit: {self._most_steps} steps (solver.max_steps)"
            return Failure(Status.STEP_LIMIT, reason, t)
        if end == outcomes.err_nf_state:
            return Failure(t=t)
        if end == outcomes.cb_stop:
            t -= float(integrator.last_h[0])  # the last step went wrong
            reason = "a comparison in the law has no finite series here; try engine solve_ivp"
            return Failure(Status.SOLVER_FAILED, reason, t)
        reason = "the law switches back and forth without end; smooth it, as with tanh"
        return Failure(Status.SOLVER_FAILED, reason, t)
