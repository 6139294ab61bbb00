"""Runs in batches of as many as there are SIMD lanes, from one known instant to the next."""

from __future__ import annotations

import copy
import threading
from typing import Any, Self

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.engines.integrator import Failure, Integrator, SpanResult
from eqt_cli.engines.problem import Problem, Span, Status
from eqt_cli.engines.taylor.integrator import BatchIntegrator, own
from eqt_cli.engines.taylor.knots import held_from, pieces
from eqt_cli.engines.taylor.library import heyoka_module
from eqt_cli.engines.traced_loop import parameter_rows


class Batches(Integrator):
    """Integrates a group of runs batch by batch; the last run fills the lanes that are left over.

    heyoka stops all lanes when one fails. The runs of such a batch are integrated alone.

    Parameters
    ----------
    compiled
        The law; every thread takes its own copy.
    most_steps
        That a run may take.
    """

    def __init__(self, problem: Problem, compiled: BatchIntegrator, most_steps: int) -> None:
        super().__init__(problem)
        self._batch, self._most_steps = compiled, most_steps
        self._held, self._parameters = held_from(problem), parameter_rows(problem)

    def for_thread(self) -> Self:
        """With its own copy of the compiled law."""
        other = copy.copy(self)
        other._batch = own(self._batch, threading.get_ident())
        return other

    def begin(self, runs: Array) -> None:
        """With all batches, none of which has failed."""
        lanes, count = self._batch.lanes, len(runs)
        self._filled = np.append(np.arange(count), np.full(-count % lanes, count - 1))
        self._own = self._parameters[runs[self._filled]].T
        self._batches = [slice(k, k + lanes) for k in range(0, len(self._filled), lanes)]
        self._steps = np.zeros(len(self._filled), dtype=int)
        self._failed: set[int] = set()
        pieces.set(self._held)

    def hold(self, span: Span) -> None:
        """As numbers of all lanes, behind the parameters."""
        self._numbers, held = self._own, self._held[span.start]
        if len(held):
            same = np.repeat(held[:, None], len(self._filled), axis=1)
            self._numbers = np.concatenate([self._own, same])

    def at_instant(self, t: float, states: Array, errors: tuple[Array, Array] | None) -> Array:
        """By compiled code, for all batches at once."""
        if errors is not None:
            errors = errors[0][self._filled], errors[1][self._filled]
        lanes = states.T[:, self._filled]
        return self._batch.at_instant(t, lanes, self._numbers, errors)[:, : len(states)].T

    def advance(self, span: Span, states: Array) -> SpanResult:
        """Batch by batch; those that have failed stay where they are."""
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
                    failed[0] = self._failure(span, bad, samples)
        joined = found[0] if len(found) == 1 else np.concatenate(found, axis=2)
        return SpanResult(
            lanes[:, :runs].T,
            joined[:, :, :runs].transpose(2, 0, 1),
            (self._steps - before)[:runs],
            failed,
        )

    def _failure(self, span: Span, end: Any, samples: Array) -> Failure:
        """How the run in all lanes has ended, and when."""
        outcomes, integrator = heyoka_module().taylor_outcome, self._batch.heyoka
        t = float(integrator.time[0])
        if end == outcomes.step_limit:
            reason = f"step limit: {self._most_steps} steps (solver.max_steps)"
            return Failure(Status.STEP_LIMIT, reason, t)
        if end == outcomes.err_nf_state:
            return Failure(t=t)
        if end == outcomes.cb_stop:
            t -= float(integrator.last_h[0])  # the last step went wrong
            samples[span.grid[1 : 1 + span.later] > t] = np.nan
            reason = "a comparison in the law has no finite series here; try engine solve_ivp"
            return Failure(Status.SOLVER_FAILED, reason, t)
        reason = "the law switches back and forth without end; smooth it, as with tanh"
        return Failure(Status.SOLVER_FAILED, reason, t)
