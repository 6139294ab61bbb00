"""Runs of one sampled loop that are stepped from outside, each at its own time.

They are moved by the compiled programs of the engine native, which `eqt run` moves them by: the
input of the law at an instant, the state after its answer, and the motion to the next instant. A
run has the same bits whatever its neighbours and their times.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array, Arrays
from eqt_cli.components.actuators import any_runs
from eqt_cli.components.blocks import COMMAND, Now, at_start
from eqt_cli.components.sensors import Errors
from eqt_cli.engines import library
from eqt_cli.engines.engine import Problem
from eqt_cli.engines.library import Rows
from eqt_cli.engines.native import ROWS as OBSERVED
from eqt_cli.engines.native import STEP_SHARE, Native, held_rows, parameter_rows, programs, sampled
from eqt_cli.extensions.network.network import Network, call
from eqt_cli.loop.closed_loop import MEMORY, VEHICLE, ClosedLoop
from eqt_cli.numbers.program import Program

MOST_BYTES = 2**27
"""Most memory for the sensor errors of episodes."""


MOMENTS = (
    *("states", "parameters", "tick", "waits", "_row", "_measured"),
    *("_counts", "_ends", "_steps", "_times"),
)
"""Arrays of a plant that its steps change."""


@dataclass(frozen=True)
class FirstCommand:
    """States of a vehicle whose actuators have followed its first command before, for an engine."""

    def __call__(self, loop: ClosedLoop, t: Any, state: Array, command: Array) -> Arrays:
        """Return ``state``."""
        started = at_start(Now(loop.blocks, loop.tracking(t, state), {COMMAND: command}))
        stretches = {f"{VEHICLE}{name}": values for name, values in started.items()}
        return {"state": loop.layout.join(loop.layout.split(state) | stretches, state)}


class Episodes:
    """Starts, drawn numbers and sensor errors of the first runs of an experiment.

    Attributes
    ----------
    states : (runs, n)
    parameters : (runs, p)
    errors : (rows, instants, k) each
        Whole histories, from the first instant to the horizon, of as many of the runs as fit
        `MOST_BYTES`; none without sensors.
    arrives
        Which of `errors` says what arrives, and is no error.
    rows
        How many these are; 1 without sensors.
    """

    def __init__(self, problem: Problem) -> None:
        self.states, self.parameters = problem.states, parameter_rows(problem)
        self.errors, self.rows, self.arrives = list[Array](), 1, -1
        if problem.errors is None:
            return
        instants = problem.control_instants + 1  # an observation follows the last step, too
        longer: Any = replace(problem.errors, instants=instants)  # type: ignore[type-var]
        size = sum(part.nbytes for part in longer.of(np.arange(1)).of_runs)
        self.rows = min(problem.runs, max(1, MOST_BYTES // size))
        drawn: Errors = longer.of(np.arange(self.rows))
        self.errors = [part.reshape(*part.shape[:2], -1) for part in drawn.of_runs]
        self.arrives = [part is drawn.arrived for part in drawn.of_runs].index(True)


class Plant:
    """Some runs, each at a tick of its own.

    Parameters
    ----------
    problem
        A problem of the loop, whose horizon ends the episodes.
    count
        Number of runs.

    Attributes
    ----------
    states : (runs, n)
        Flat states, before the instant at `tick`.
    tick : (runs,)
        The next instant of each run; the last one is `ticks`, the horizon.
    first_command
        What gives actuators their states at the start of a run; None where nothing does.
    waits : (runs,)
        Whether a run waits for its first command, before the instant 0. `eqt run` starts actuators
        by the command of the exact state; where sensors have errors, the answer to a measurement is
        another one, and the policy is asked for that first.
    failed : (runs,)
        Whether the motion of a run has ended: it is no longer finite, or the solver gave up.
    """

    def __init__(self, problem: Problem, engine: Native, episodes: Episodes, count: int) -> None:
        loop = self.loop = problem.loop
        law = loop.controller
        assert isinstance(law, Network)
        self._law, whole = law, programs(loop)
        assert whole.around_code is not None
        self._around, self._field = whole.around_code, whole.field
        self._episodes = episodes
        self._advance = library.integration(whole.field)
        spans, end = problem.spans, float(problem.times[-1])
        starts = [place for place, span in enumerate(spans) if span.tick is not None]
        self.ticks = len(starts)
        # At the horizon there is an observation, too.
        self._first = np.array([*starts, len(spans)])
        self.starts = np.array([*(span.start for span in spans), end])
        periods = [(span.start, span.stop, *span.within) for span in spans]
        self._periods = np.array([*periods, (end, end, end, end)])
        self._most_spans = int(np.diff(self._first).max())
        self._held = held_rows(loop, self.starts, whole.field)
        lengths = law.memory(loop.group)
        slices = loop.layout.slices
        self._memory = next((slices[MEMORY + name] for name in lengths), slice(0, 0))
        self._last, at = None, 0
        for signal, size in zip(law.observes, law._sizes(loop.group), strict=True):
            if signal.signal == "last_command":
                self._last, self._last_scale = slice(at, at + size), signal.scale
            at += size
        self.observations, self.actions = at, law.network.commands
        self.period = loop.period
        self.states = episodes.states[np.zeros(count, int)]
        self.parameters = episodes.parameters[np.zeros(count, int)]
        self._row, self.tick = np.zeros((2, count), np.int64)
        self._counts, self._ends = np.zeros((2, count), np.int64)
        self._steps, self._times = np.zeros((2, count))
        self._measured = self.states.copy()
        self.first_command: tuple[Program, Array] | None = None
        if any_runs(loop.vehicle.actuators):
            lengths_of_first = loop.state_length, law.length
            program = sampled(FirstCommand(), loop, lengths_of_first)
            assert program is not None  # for eqt run traces the same
            self.first_command = program, held_rows(loop, self.starts, program)
        self.asks_first = bool(self.first_command and episodes.errors)
        self.waits = np.zeros(count, bool)
        self._span = {
            "rtol": engine.rtol * STEP_SHARE,
            "atol": engine.atol * STEP_SHARE,
            "most_steps": engine.max_steps,
            "longest": np.inf,
            "steps": self._steps,
            "counts": self._counts,
            "ends": self._ends,
            "times": self._times,
            "stopped": np.zeros(1, np.int64),
            "to_next_held": self._held.shape[1],
        }

    @property
    def moments(self) -> dict[str, Array]:
        """Where all runs are."""
        return {name: getattr(self, name) for name in MOMENTS}

    @moments.setter
    def moments(self, arrays: Arrays) -> None:
        """Copy arrays into those that compiled code knows."""
        for name, values in arrays.items():
            getattr(self, name)[...] = values

    @property
    def failed(self) -> Array:
        """Whether each run has ended by itself."""
        gone: Array = (self._ends != 0) | ~np.isfinite(self.states).all(axis=1)
        if (lost := self.loop.lost_at) is not None:
            gone |= self.states[:, lost] != 0
        return gone

    @property
    def places(self) -> Array:
        """The places in `starts` of the next instants."""
        places: Array = self._first[self.tick]
        return places

    @property
    def time(self) -> Array:
        """The times of the next instants, s."""
        t: Array = self.starts[self.places]
        return t

    @property
    def is_over(self) -> Array:
        """Whether each run is at the horizon."""
        return self.tick >= self.ticks

    def begin(self, which: Array, runs: Array, rows: Array) -> None:
        """Begin some runs anew: as these `runs` of the episodes, with errors of these `rows`."""
        self.states[which] = self._episodes.states[runs]
        self.parameters[which] = self._episodes.parameters[runs]
        self._row[which], self.tick[which], self.waits[which] = rows, 0, self.asks_first
        for array in (self._counts, self._ends, self._steps, self._times):
            array[which] = 0

    def _inputs(self, which: Array | slice, states: Array, held: Array | None = None) -> list[Rows]:
        """Return the inputs of a program of the loop, at the next instants of some runs."""
        places = self._first[self.tick[which]]
        numbers = (self._held if held is None else held)[places]
        values = states, self.starts[places, None], self.parameters[which], numbers
        return [Rows(rows, by_run=True) for rows in values]

    def observe(self, which: Array | slice = slice(None)) -> Array:
        """Measure some runs at their next instants; return what the law observes.

        Those that wait for their first command are observed exactly.
        """
        states, ticks, waits = self.states[which], self.tick[which], self.waits[which]
        errors = [part[self._row[which], ticks] for part in self._episodes.errors]
        if waits.any():
            for k, part in enumerate(errors):
                if k != self._episodes.arrives:
                    part[waits] = 0.0
        inputs = [*self._inputs(which, states), *(Rows(part, by_run=True) for part in errors)]
        outputs = at_one_time(self._around.input, inputs)
        self._measured[which] = outputs.get("state", states)
        observed = outputs[OBSERVED]
        if self._last is not None:
            observed[:, self._last] = self._last_scale * self.states[which][:, self._memory]
        return observed

    def act(self, actions: Array) -> None:
        """Let the law answer by these outputs of a network, as measured by `observe`.

        To runs that wait, they are their first commands.
        """
        memory = np.ascontiguousarray(self.states[:, self._memory])
        torque = np.empty((len(actions), self._law.length))
        rows = np.concatenate([actions, np.zeros_like(memory)], axis=1)
        call(self._law.actions_call, memory, rows, torque)
        starts = self.waits if self.asks_first else self.tick == 0
        if self.first_command and (fresh := np.flatnonzero(starts)).size:
            program, held = self.first_command
            state, *others = self._inputs(fresh, self.states[fresh], held)
            more = [state, Rows(torque[fresh], by_run=True), *others]
            self._measured[fresh] = at_one_time(program, more)["state"]
        inputs = self._inputs(slice(None), self._measured)
        answer = [Rows(torque, by_run=True), Rows(memory, by_run=True)]
        after = at_one_time(self._around.after, [*inputs, *answer])["state"]
        after[self.waits] = self._measured[self.waits]
        self.states = after

    def advance(self) -> None:
        """Move all runs from their instants to the next ones, but for those that waited."""
        moves, self.waits = ~self.waits, np.zeros(len(self.waits), bool)
        first, after = self._first[self.tick], self._first[self.tick + 1]
        self._ends[~np.isfinite(self.states).all(axis=1)] = library.NOT_FINITE
        for k in range(self._most_spans):
            place = first + k
            all_move = self._most_spans == 1 and moves.all()
            self._through(place, None if all_move else moves & (place < after))
        self.tick += moves

    def _through(self, place: Array, takes_part: Array | None) -> None:
        """Integrate through the spans at these places, those runs that take part."""
        ended = self._ends.copy()
        if takes_part is not None:
            self._ends[~takes_part] = library.STOPPED
        place = np.minimum(place, len(self._periods) - 1)
        self._advance(
            runs=len(place),
            later=0,
            held=np.ascontiguousarray(self._held[place]),
            periods=np.ascontiguousarray(self._periods[place]),
            parameters=self.parameters,
            states=self.states,
            **self._span,
        )
        if takes_part is not None:
            self._ends[~takes_part] = ended[~takes_part]

    def evaluate(
        self,
        program: Program,
        held: Array,
        rows: Sequence[Array] = (),
        which: Array | slice = slice(None),
    ) -> Arrays:
        """Return the arrays of a program of `native.sampled`, ``(runs, …)``, in some states.

        Parameters
        ----------
        held
            `held_rows` of the program, at `starts`.
        rows
            Its rows behind the state.
        """
        return at_one_time(program, self.inputs(held, rows, which))

    def inputs(
        self, held: Array, rows: Sequence[Array] = (), which: Array | slice = slice(None)
    ) -> list[Rows]:
        """Return the inputs of a program, as `evaluate` takes them."""
        state, *others = self._inputs(which, self.states[which], held)
        return [state, *(Rows(values, by_run=True) for values in rows), *others]

    def of_two(self) -> Plant:
        """Return a plant of two runs at different times, in states where runs start."""
        two = copy(self)
        runs = np.array([0, -1])
        two.states = self._episodes.states[runs]
        two.parameters = self._episodes.parameters[runs]
        two.tick = np.array([self.ticks // 3, self.ticks - 1])
        return two


def at_one_time(program: Program, inputs: Sequence[Rows]) -> Arrays:
    """Return the arrays of a program for some runs, ``(runs, …)`` each."""
    arrays = library.evaluated(program, len(inputs[0].values), 1, inputs)
    return {name: values[:, 0] for name, values in arrays.items()}
