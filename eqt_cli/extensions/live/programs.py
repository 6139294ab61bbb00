"""Loops as C for a page, and all the numbers that the C takes, of any setting of their keys."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array, Arrays, less, norm, where
from eqt_cli.base.errors import EqtError
from eqt_cli.components.laws import Controller, RunsCode
from eqt_cli.config.study import Study
from eqt_cli.engines import library
from eqt_cli.engines.engine import GROWN, MOST_TURNS, Problem
from eqt_cli.engines.native import held_rows, parameter_rows, programs
from eqt_cli.loop.closed_loop import ClosedLoop, parts_of
from eqt_cli.loop.law_program import RunningPrograms, inputs_of, running, symbolic_loop
from eqt_cli.numbers.program import Program, traced
from eqt_cli.runs.batches import Batch, kind_of, problem_of, starts_of
from eqt_cli.runs.compute_part import functions_of

LANES = 2
"""Runs side by side in a vector of WebAssembly."""

RUNS = 8
"""Runs that a call of the page integrates."""

DIVERGED = "turns too fast"
"""Number of a run: 1 if it turns too fast for its sampled law, as in `engines.engine`."""


class LiveLoop:
    """A law of a study: what the page computes of it, by which programs.

    Parameters
    ----------
    signals, metrics
        Names of the signals that the page draws, and of the numbers of a run that it shows.

    Raises
    ------
    EqtError
        If the law cannot run in a page; it says why.
    """

    def __init__(
        self, study: Study, label: str, signals: Sequence[str], metrics: Sequence[str]
    ) -> None:
        self.label, self.study, self.wanted = label, study, (signals, metrics)
        experiment = study.base
        loop = self.loop = experiment.loops[label]
        self.problem = problem = _problem(study, label, 1)
        refuse_foreign(loop, label)
        law = programs(loop)
        if law.around_code is not None:
            raise _refused(label, "a solver of its vehicle works outside the compiled program")
        engine, kind = experiment.engine, kind_of(experiment, label)
        batch = Batch(np.arange(1), np.zeros(1, int), experiment, problem, kind, {})
        starts, row = starts_of(study, np.zeros(1, int), np.arange(1))
        self.reference = loop.group.size**2 + loop.group.dimension
        lengths = (loop.state_length, self.reference)
        names = ["pose", "desired_pose", *signals]
        begin = _beginning(starts, loop, row.shape[-1])
        state = starts(loop, problem.times[0], row)["state"]
        batch = replace(batch, problem=replace(problem, states=state))
        function, reduction = functions_of(batch, [*metrics, "pose", *signals])
        looked = running(
            _Kept(function, loop.vehicle.control is not None),
            _Reduced(
                # Neither a balance of energies nor distances to critical points are shown.
                replace(reduction, balanced=True, K=np.empty((0, 0))),
                tuple(metrics),
                loop.period if loop.vehicle.control else 0.0,
            ),
            loop,
            lengths,
            tuple(names),
            tuple(problem.times.tolist()),
        )
        if looked is None:
            raise _refused(label, "one of its metrics cannot be computed from sample to sample")
        self.looked: RunningPrograms = looked
        self.spans = np.array([_numbers_of(span) for span in problem.spans])
        self.begins, self.law, self.engine = begin, law, engine
        texts = [self.source(), *(x.tobytes() for x in (looked.columns, looked.starts, self.spans))]
        self.identity: tuple[Any, ...] = tuple(texts)  # laws with the same one are one program

    @property
    def metrics(self) -> list[str]:
        """Names of the numbers of a run, in the order of the page."""
        return [output.name for output in self.looked.ended.outputs]

    @property
    def sizes(self) -> dict[str, int]:
        """Lengths of the arrays of `live.c`, by the names of its macros."""
        inputs, loop = inputs_of(self.loop, 0), self.loop
        instant = self.law.after_instant
        errors = dict(instant.inputs).get("errors", 0) if instant else 0
        return {
            "RUNS": RUNS,
            "SPANS": len(self.spans),
            "SAMPLES": len(self.problem.times),
            "TICKS": self.problem.control_instants if errors else 0,
            "ERRORS": errors,
            "STATE": loop.state_length,
            "PARAMETERS": inputs["parameters"],
            "START": dict(self.begins.inputs)["state"],
            "HELD": dict(self.law.field.inputs)["held"],
            "HELD_AT_START": dict(self.begins.inputs)["held"],
            "HELD_AT_SAMPLES": dict(self.looked.at_sample.inputs)["held"],
            "COLUMNS": self.looked.columns.shape[1],
            "MEMORY": len(self.looked.starts),
            "KEPT": sum(int(np.prod(shape)) for _, shape in self.looked.stored),
            "NUMBERS": len(self.metrics),
            "REFERENCE": self.reference,
            "POSE": loop.group.size**2,
            "VELOCITY": loop.group.dimension,
            "LOST": -1 if loop.lost_at is None else loop.lost_at,
        }

    @property
    def sampled(self) -> bool:
        """Whether the law acts at control instants only."""
        return self.law.after_instant is not None

    def source(self) -> str:
        """Return the C of the page, one file."""
        sizes = self.sizes
        begin = [sizes["START"], 1, sizes["PARAMETERS"], sizes["HELD_AT_START"]]
        looks = [sizes["STATE"], sizes["REFERENCE"], 1, sizes["PARAMETERS"]]
        looks += [sizes["HELD_AT_SAMPLES"], sizes["COLUMNS"], sizes["MEMORY"]]
        units = [
            _unit("begin", self.begins, begin),
            _unit("look", self.looked.at_sample, looks),
            _unit("end", self.looked.ended, [sizes["MEMORY"]]),
        ]
        if self.law.after_instant is not None:
            length = [sizes["STATE"], 1, sizes["PARAMETERS"], sizes["HELD"]]
            length += [sizes["ERRORS"]] if sizes["ERRORS"] else []
            units.append(_unit("instant", self.law.after_instant, length))
        macros = "".join(f"#define L_{name} {size}\n" for name, size in sizes.items())
        macros += "#define L_SAMPLED\n" if self.sampled else ""
        text = (Path(__file__).with_name("templates") / "live.c").read_text(encoding="utf-8")
        return "\n".join([library.integration_source(self.law.field, LANES), *units, macros + text])

    def places(self) -> dict[str, tuple[int, tuple[int, ...]]]:
        """Return where each signal begins among those of a sample, and its shape."""
        places, begin = {}, 0
        for name, shape in self.looked.stored:
            places[name] = begin, tuple(shape)
            begin += int(np.prod(shape))
        return places


def numbers_of(study: Study, loops: Mapping[str, LiveLoop], runs: int) -> dict[str, Array]:
    """Return all that the page's programs take of a setting: ``LABEL/NAME``, and ``starts``.

    Raises
    ------
    EqtError
        If the setting is another program.
    """
    arrays: dict[str, Array] = {}
    arrays["starts"] = starts_of(study, np.zeros(runs, int), np.arange(runs))[1][:, 0]
    for label, live in loops.items():
        problem = _problem(study, label, runs)
        begin, law, looked = live.begins, live.law, live.looked
        if kind_of(study.base, label) != kind_of(live.study.base, label):
            other = LiveLoop(study, label, *live.wanted)
            if other.identity != live.identity:
                raise EqtError("it changes the program, not only its numbers")
            begin, law, looked = other.begins, other.law, other.looked
        times = problem.times
        at = np.array([span.start for span in problem.spans])
        parameters = parameter_rows(problem)
        one = parameters if (parameters != parameters[0]).any() else parameters[:1]
        arrays |= {
            f"{label}/parameters": one,
            f"{label}/held": held_rows(problem.loop, at, law.field),
            f"{label}/held_at_samples": held_rows(problem.loop, times, looked.at_sample),
            f"{label}/held_at_start": held_rows(problem.loop, times[:1], begin),
        }
        if live.sizes["ERRORS"]:
            drawn = problem.drawn()
            assert drawn is not None
            parts = [part.reshape(*part.shape[:2], -1) for part in drawn.of_runs]
            arrays[f"{label}/errors"] = np.concatenate(parts, axis=-1)
    return arrays


def _problem(study: Study, label: str, runs: int) -> Problem:
    kind = kind_of(study.base, label)
    return problem_of(study, label, np.zeros(runs, int), np.arange(runs), kind)


def _refused(label: str, why: str) -> EqtError:
    return EqtError(f"{label} cannot run in a page: {why}")


def refuse_foreign(loop: ClosedLoop, label: str) -> None:
    """Raise an `EqtError` if code of a plugin would run; laws that are formulas are traced."""
    parts = parts_of(loop)
    foreign = [p.name for p in parts if p.is_foreign and not isinstance(p.part, Controller)]
    laws = loop.controller, getattr(loop.controller, "inner", None)
    if foreign or any(isinstance(law, RunsCode) for law in laws):
        raise _refused(label, f"{foreign[0] if foreign else 'its law'} is code, no formula")


def _numbers_of(span: Any) -> list[float]:
    times = [span.start, span.stop, *span.within, span.longest, span.first, span.later]
    return [float(x) for x in (*times, span.sampled_start, -1 if span.tick is None else span.tick)]


def _beginning(start: Any, loop: ClosedLoop, length: int) -> Program:
    """Return the program of pose, velocity and state at the start, from a row of numbers."""

    def begin(inputs: Arrays) -> Arrays:
        state = inputs["state"][None]
        values = start(symbolic_loop(loop, inputs), inputs["time"][0], state)
        return {name: np.asarray(value)[0] for name, value in values.items()}

    return traced(begin, inputs_of(loop, length), {})


def _unit(name: str, program: Program, stretches: Sequence[int]) -> str:
    """Return the C of a program whose names end with `name`, for a file with others."""
    shared = ["eqt_evaluate", "eqt_program", "eqt_lengths", "eqt_found_lengths"]
    defined = ["EQT_SOURCES", "EQT_INPUTS", "EQT_ARRAYS", "EQT_OUTPUTS", "EQT_CALL"]
    before = [f"#define {macro} {macro}_{name}" for macro in shared]
    after = [f"#undef {macro}" for macro in (*shared, *defined, "EQT_EVALUATE_H", "EQT_LANES")]
    text = library.evaluation_source(program, stretches, LANES)
    return "\n".join([*before, text, *after, f"#define EQT_LANES {LANES}"])


@dataclass(frozen=True)
class _Kept:
    """The signals of a sample, with the desired pose and what tells whether a body diverges."""

    signals: Any
    sampled: bool

    def __call__(self, loop: ClosedLoop, t: Any, states: Array, desired: Array) -> Arrays:
        s = loop.tracking(t, states)
        computed = self.signals(loop, t, states, desired)
        pose = np.broadcast_to(np.asarray(s.Qd), np.shape(computed["pose"]))
        computed = {**computed, "desired_pose": pose + 0.0 * states[..., :1, None]}
        if self.sampled:
            turning = np.zeros(loop.group.dimension)
            for part in loop.group.parts:
                turning[part.axes] = part.turns
            computed |= {"rate": norm(turning * s.V), "rate_desired": norm(turning * s.Vd)}
        return computed


@dataclass(frozen=True)
class _Reduced:
    """The numbers of a run that a page shows, with whether it diverges."""

    numbers: Any
    names: tuple[str, ...]
    period: float

    def __call__(self, over: Any, sampled: Mapping[str, Any]) -> dict[str, Any]:
        computed = self.numbers(over, sampled)
        numbers = {name: computed[name] for name in self.names}
        if self.period:
            rate, desired = sampled["rate"], sampled["rate_desired"]
            grown = where(less(GROWN * desired, rate), 1.0, 0.0)
            grown = where(less(GROWN * over.initial(rate), rate), grown, 0.0)
            fast = where(less(MOST_TURNS * 2 * np.pi, self.period * rate), grown, 0.0)
            numbers[DIVERGED] = over.largest(fast)
        return numbers
