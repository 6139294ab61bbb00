"""An integrator of heyoka for as many runs as there are SIMD lanes."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.engines.problem import Span
from eqt_cli.engines.taylor import knots, switching
from eqt_cli.engines.taylor.expressions import Expressions
from eqt_cli.engines.taylor.library import heyoka_module
from eqt_cli.engines.taylor.switching import NUMBERS, Crossing, Switchboard, comparisons
from eqt_cli.engines.traced_loop import LoopPrograms


@dataclass(frozen=True, eq=False)
class BatchIntegrator:
    """An integrator of as many runs as there are SIMD lanes; every thread needs its own."""

    heyoka: Any
    board: Switchboard | None
    after_instant: Any = None

    @property
    def lanes(self) -> int:
        """How many runs it integrates at once."""
        lanes: int = self.heyoka.batch_size
        return lanes

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
        samples : (later, n, lanes)
            Behind its start.
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
        """As `go`; what is to be called after every step may be given."""
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
        """The numbers of the law in every lane, ``(numbers, lanes)``; the state is set."""
        used = self.heyoka.pars
        if self.board is None:
            used[:] = values[: len(used)]  # heyoka has none behind the last one that occurs
        else:
            used[: len(values)] = values
            self.board.start(self.heyoka)


@lru_cache(maxsize=16)
def compiled(law: LoopPrograms, knotted: bool, tol: float, compact: bool) -> BatchIntegrator:
    """Compile a law, or find it among those compiled before.

    Its parameters are those of the field, then the time of the next knot where it passes knots, and
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
    """The copy of a thread, which takes as long to make as a run to integrate."""
    return copy.deepcopy(compiled)
