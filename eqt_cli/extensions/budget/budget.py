"""The error budget of an experiment: what each imperfection costs, alone and with the others.

For each law, the mean square of an error over a window is computed from the same starts and draws:
with all imperfections, with each one left out, and with each one alone. Of a loop that is linear
near rest, with independent sources of mean 0, the mean squares add up; what is left over is told.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError, InputError, suggestion
from eqt_cli.base.registry import blamed
from eqt_cli.base.reporting import listed, step, working_for
from eqt_cli.base.stored import Status, signal_of
from eqt_cli.config.document import changed_at
from eqt_cli.config.experiment import Experiment
from eqt_cli.config.parts import StudyPart
from eqt_cli.config.remarks import remark_on
from eqt_cli.config.study import Study, study
from eqt_cli.engines.engine import Compiled, Stopped, hurried
from eqt_cli.extensions.budget.quantiles import LEVEL, Interval, mixed, of_runs
from eqt_cli.extensions.budget.sources import Source, sources_of, without, without_all
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.loop.signals import existing
from eqt_cli.numbers.leaves import leaves
from eqt_cli.numbers.running import SampledRuns
from eqt_cli.results.quantity import Window
from eqt_cli.runs.batches import batches, kind_of
from eqt_cli.runs.compute_part import shared_reference, solved
from eqt_cli.runs.executors import Executor, TaskContext
from eqt_cli.runs.folder import window_of

ERRORS = ("attitude_angle", "pointing_error", "position_error", "heading_error")
"""Errors of a budget; the first one that a loop has is the default."""

SHARES = (0.5, 0.95, 0.997)
"""Quantiles that are told by default."""

TORQUE = "torque_norm"
"""The signal by which a run is found to fail between steps."""

LEAST_RUNS = 5
"""Runs of a budget; an interval of fewer says next to nothing."""

RESAMPLES = 2000
"""Resamples of the runs behind an interval of a root mean square."""


class Row(NamedTuple):
    """What one source costs.

    Attributes
    ----------
    source
        The source.
    alone
        The root mean square that it adds to the loop without imperfections; negative where it
        lowers the error.
    beside
        The root mean square that goes if it alone is left out.
    """

    source: Source
    alone: Interval
    beside: Interval | None = None


class Quantile(NamedTuple):
    """A quantile of the whole error, by each interpretation.

    Attributes
    ----------
    share
        Of runs, of time, or of both.
    ensemble
        Over runs, of the largest error of each in the window.
    temporal
        Over the time of each run, of the median run.
    worst
        The same of the worst run.
    mixed
        Over all samples of all runs.
    """

    share: float
    ensemble: Interval
    temporal: Interval
    worst: float
    mixed: Interval


@dataclass(frozen=True)
class LawBudget:
    """The budget of one law.

    Attributes
    ----------
    label, title
        Label and display name.
    runs, failed
        Runs that count, and those left out because they fail in some variant.
    total
        The root mean square with all imperfections.
    peak
        The largest error of all runs.
    rows
        What stays without imperfections, then the sources, the most expensive first; empty where
        the whole loop alone was computed.
    quantiles
        Of the error with all imperfections.
    """

    label: str
    title: str
    runs: int
    failed: int
    total: Interval
    peak: float
    rows: list[Row]
    quantiles: list[Quantile]

    @property
    def root_sum_square(self) -> float:
        """The root of the sum of all squares of sources alone, with their signs."""
        return _root(sum(_square(row.alone.value) for row in self.rows))

    @property
    def left_over(self) -> float:
        """The root mean square of the whole that the sum does not explain, with its sign."""
        return _root(_square(self.total.value) - _square(self.root_sum_square))


@dataclass(frozen=True)
class Budget:
    """The error budget of an experiment.

    Attributes
    ----------
    name
        Name of the experiment.
    error, unit
        The signal of the budget, and the unit of its numbers.
    window
        The window of time.
    laws
        The budget of each law.
    remarks
        What was remarked on the configuration.
    """

    name: str
    error: str
    unit: str
    window: Window
    laws: list[LawBudget]
    remarks: tuple[str, ...] = ()

    def records(self) -> list[dict[str, Any]]:
        """Return a flat row for each source of each law."""
        return [
            {"law": law.label, "key": row.source.key, "source": row.source.words}
            | {f"alone_{end}": x for end, x in row.alone._asdict().items() if end != "needed"}
            | {"with_others": row.beside.value if row.beside else None, "unit": self.unit}
            for law in self.laws
            for row in law.rows
        ]

    def record(self) -> dict[str, Any]:
        """Return the budget as data for JSON."""
        return {
            "name": self.name,
            "error": self.error,
            "unit": self.unit,
            "window": str(self.window),
            "laws": [_record(law) for law in self.laws],
            "remarks": list(self.remarks),
        }


def _record(law: LawBudget) -> dict[str, Any]:
    rows = [
        {"key": row.source.key, "source": row.source.words, "alone": row.alone._asdict()}
        | {"with_others": row.beside and row.beside._asdict()}
        for row in law.rows
    ]
    quantiles = [
        {
            key: x._asdict() if isinstance(x, Interval) else x
            for key, x in quantile._asdict().items()
        }
        for quantile in law.quantiles
    ]
    return {
        **{key: value for key, value in asdict(law).items() if key not in ("rows", "quantiles")},
        "total": law.total._asdict(),
        "root_sum_square": law.root_sum_square,
        "left_over": law.left_over,
        "rows": rows,
        "quantiles": quantiles,
    }


# The runs -----------------------------------------------------------------------------------------

ALL, IDEAL, SAMPLED, SILENT = "all", "ideal", "sampled", "silent"
"""Variants: with all sources; with none, and without a clock; with a clock; and with the estimator
and the instants of the measurements."""


def _loop(loop: ClosedLoop, variant: tuple[str, str]) -> ClosedLoop:
    """Return the loop of a variant: one of the four, or a source ``alone`` or ``beside`` others."""
    kind, key = variant
    if kind == "beside":
        return without(loop, {key})
    if kind == "alone":
        return without(loop, {source.key for source in sources_of(loop)} - {key})
    if kind == ALL:
        return loop
    return without_all(loop, filtered=kind == SILENT, sampled=kind != IDEAL)


def _switched_off(variant: tuple[str, str], keys: frozenset[str]) -> Hashable:
    """Return the sources that are off in a variant; equal ones are computed once."""
    kind, key = variant
    off = {ALL: frozenset[str](), SILENT: keys, "alone": keys - {key}, "beside": frozenset({key})}
    return off.get(kind, kind)


def _identity(experiment: Experiment, label: str) -> Hashable:
    """Return a key of all that the runs of a loop follow from."""
    loop = experiment.loops[label]
    numbers = [(path, values.tobytes()) for path, values in leaves(loop).items()]
    return kind_of(experiment, label), *numbers, repr(loop.vehicle.configured)


@dataclass(frozen=True)
class _Variants:
    """The parts of all variants, as a task of an executor."""

    base: Study
    variants: tuple[tuple[str, str], ...]
    error: str
    _studies: dict[int, Study] = field(default_factory=dict, init=False)
    _references: list[Any] = field(default_factory=list, init=False)

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"_studies": {}, "_references": []}

    @property
    def parts(self) -> int:
        """Number of parts of a variant."""
        return len(self.base.plan)

    def study(self, number: int) -> Study:
        """Return the study of a variant; its runs are solved once if nothing reads their errors."""
        if number not in self._studies:
            base, variant = self.base.base, self.variants[number]
            loops = {label: _loop(loop, variant) for label, loop in base.loops.items()}
            solver, checks = base.solver, base.solver.judgement
            if checks.max_error is None:
                solver = replace(solver, judgement=replace(checks, error_estimate=False))
            self._studies[number] = Study(None, replace(base, loops=loops, solver=solver))
        return self._studies[number]

    def law(self, number: int, law: int) -> int:
        """Return the first law whose loop in a variant is the same, so that its runs are, too."""
        one = self.study(number).base
        return [_identity(one, label) for label in one.loops].index(
            _identity(one, list(one.loops)[law])
        )

    def runs_of(self, item: int) -> int:
        return len(self.base.plan.part(item % self.parts))

    def origin(self) -> dict[str, Any]:
        return {}

    @blamed()
    def __call__(self, item: int, context: TaskContext) -> Any:
        """Compute a part of a variant, and return status and error of its runs."""
        one, part = self.study(item // self.parts), self.base.plan.part(item % self.parts)
        with hurried(), np.errstate(all="ignore"):  # starts may be absurd
            if not self._references:
                self._references.append(shared_reference(self.base))
            return self._solved(one, part, context)

    def _solved(self, one: Study, part: StudyPart, context: TaskContext) -> tuple[Array, Array]:
        label, laws = list(one.base.loops)[part.controller], len(one.base.loops)
        status = np.empty(len(part), dtype=int)
        errors, wanted = np.empty((len(part), len(one.base.times))), [self.error, TORQUE]
        with working_for(f"law {part.controller + 1} of {laws} ({label})"):
            for batch in batches(one, label, np.arange(part.start, part.stop)):
                blocks = [batch]
                if isinstance(engine := batch.engine, Compiled):
                    rows = engine.blocks(batch.problem, context.threads)
                    blocks = [batch.select(some) for some in rows]
                for block in blocks:
                    solution = solved(block, self._references[0], wanted, True, context)
                    if (solution.status == Status.STOPPED).any():
                        raise Stopped
                    status[block.rows] = solution.status
                    errors[block.rows] = solution.arrays[self.error]
        return status, errors


def _computed(task: _Variants, executor: Executor) -> tuple[Array, Array]:
    """Return status ``(variants, laws, runs)`` and errors ``(variants, laws, runs, samples)``."""
    base, count = task.base.base, len(task.variants)
    shape = count, len(base.loops), base.config.ensemble.runs
    status, errors = np.ones(shape, dtype=int), np.full((*shape, len(base.times)), np.nan)
    first = np.array([[task.law(k, law) for law in range(shape[1])] for k in range(count)])
    parts = [task.base.plan.part(number) for number in range(task.parts)]
    places = [(k, part) for k in range(count) for part in parts]
    items = [
        item
        for item, (k, part) in enumerate(places)
        if first[k, part.controller] == part.controller
    ]
    with step("runs", sum(map(task.runs_of, items))):
        for outcome in executor.outcomes(task, items):
            if outcome.value is None:
                raise EqtError("a worker was lost; run the same command again, with fewer workers")
            variant, part = places[outcome.item]
            place = variant, part.controller, part.run_numbers
            status[place], errors[place] = outcome.value
    every = np.arange(count)[:, None], first
    return status[every], errors[every]


# The numbers --------------------------------------------------------------------------------------


def _square(x: float) -> float:
    return x * abs(x)


def _root(x: float) -> float:
    return float(np.sign(x) * np.sqrt(abs(x)))


def rooted_mean(squares: Array, least: float = -np.inf) -> Interval:
    """Return the root of a mean over runs, with its bootstrap-t interval, and their signs.

    The true mean is at least `least`: 0 of squares, and not bounded of differences of squares.

    The squares of a constant error are skew, so that a small mean comes with a small deviation.
    Resamples of the runs show the distribution of (mean - truth) / deviation, which Student's t
    supposes to be symmetric (Efron and Tibshirani, An Introduction to the Bootstrap, 12.5).
    """
    mean, deviation, n = squares.mean(), squares.std(ddof=1), len(squares)
    random, students = np.random.default_rng(n), list[Array]()
    for _ in range(RESAMPLES // 250):  # so many fit into memory, also of 10,000 runs
        drawn = squares[random.integers(0, n, (250, n))]
        spread = drawn.std(axis=1, ddof=1)
        differs = spread > 1e-9 * deviation
        students.append((drawn.mean(axis=1) - mean)[differs] / spread[differs])
    if not deviation:
        return Interval(_root(mean), _root(mean), _root(mean))
    low, high = np.quantile(np.concatenate(students), [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    low, high = max(mean - high * deviation, least), mean - low * deviation
    return Interval(_root(mean), _root(low), _root(high))


def quantiles_of(errors: Array, shares: Sequence[float]) -> list[Quantile]:
    """Return quantiles of errors ``(runs, samples)`` by all interpretations."""
    largest, listed = errors.max(axis=1), []
    for share in shares:
        over_time = np.quantile(errors, share, axis=1)
        listed.append(
            Quantile(
                share,
                of_runs(largest, share),
                of_runs(over_time, 0.5),
                float(over_time.max()),
                mixed(errors, share),
            )
        )
    return listed


def _law_budget(
    label: str,
    title: str,
    sources: Sequence[Source],
    squares: dict[tuple[str, str], Array],
    errors: Array,
    shares: Sequence[float],
    failed: int,
    whole_only: bool,
) -> LawBudget:
    """Return the budget of a law from mean squares of each run, by variant."""
    whole, rows = squares[ALL, ""], list[Row]()
    if not whole_only:
        silent = squares[SILENT, ""]
        rows = [
            Row(
                source,
                rooted_mean(squares["alone", source.key] - silent),
                rooted_mean(whole - squares["beside", source.key]),
            )
            for source in sources
        ]
        rows.sort(key=lambda row: -row.alone.value)
        rows = [*_stays(squares), *rows]
    total, peak = rooted_mean(whole, 0.0), float(errors.max())
    quantiles = quantiles_of(errors, shares)
    return LawBudget(label, title, len(whole), failed, total, peak, rows, quantiles)


def _stays(squares: dict[tuple[str, str], Array]) -> Iterator[Row]:
    """Yield what is left without sources: start and reference, sampling, the estimator."""
    before, least = np.zeros_like(squares[ALL, ""]), 0.0
    sampled = "sampling of the law" if (IDEAL, "") in squares else "start, reference and sampling"
    words = {
        IDEAL: "start and reference",
        SAMPLED: sampled,
        SILENT: "estimator and times of measurements",
    }
    for kind, what in words.items():
        if (kind, "") in squares:
            yield Row(Source("", what), rooted_mean(squares[kind, ""] - before, least))
            before, least = squares[kind, ""], -np.inf


def _error_of(base: Study, wished: str) -> str:
    """Return the wished error, or the first one that the loops have."""
    loop = base.base.loop
    signals = existing(loop)
    present = [name for name in ERRORS if name in signals and signals[name][0].exists_for(loop)]
    if not present:
        raise EqtError(f"{base.name}: has none of the errors {', '.join(ERRORS)}")
    if wished and wished not in present:
        if wished in ERRORS:
            raise EqtError(f"{base.name} has no {wished}; it has {listed(present)}")
        hint = suggestion(wished, present) or f"; there are: {', '.join(present)}"
        raise EqtError(f"unknown error '{wished}'{hint}")
    return wished or present[0]


def variants_of(base: Study, sources: Sequence[Source]) -> Iterator[tuple[str, str]]:
    """Yield the variants to compute; without a clock only where all laws do without one."""
    is_sampled = base.base.loop.vehicle.control is not None
    if not is_sampled or _does_without_clock(base):
        yield IDEAL, ""
    if is_sampled:
        yield SAMPLED, ""
    yield SILENT, ""
    yield ALL, ""
    for source in sources:
        yield "alone", source.key
        yield "beside", source.key


def _does_without_clock(base: Study) -> bool:
    """Whether the laws of an experiment are accepted without a clock, and what lives on it."""
    for idle in ((), ("actuators", "plant")):  # that are sampled, or that the law steers
        document = base.document
        for key in ("control", "sensors", "estimator", *idle):
            document = changed_at(document, (key,), None, "eqt budget")
        with suppress(EqtError):
            study(document)
            return True
    return False


def budget(
    base: Study,
    executor: Executor,
    *,
    error: str = "",
    window: Window | None = None,
    shares: Sequence[float] = SHARES,
    total: bool = False,
) -> Budget:
    """Return the error budget of an experiment.

    Parameters
    ----------
    base
        An experiment without a sweep.
    error
        One of `ERRORS`. Default: the first one that the loops have.
    window
        The window of time. Default: that of `measure`, or the whole horizon.
    shares
        Quantiles of the whole error to tell.
    total
        Whether the whole loop alone is computed, without what each source costs.

    Raises
    ------
    EqtError
        If it is a sweep, has too few runs, no such error, nothing to switch off, or if runs fail.
    """
    window = window or window_of(base.base.config)
    if base.sweep is not None:
        raise EqtError(f"{base.name}: is a sweep; choose one point of it: --point N")
    runs = base.base.config.ensemble.runs
    if runs < LEAST_RUNS:
        raise EqtError(
            f"ensemble.runs: expected at least {LEAST_RUNS} for a budget, got {runs}; "
            "--set ensemble.runs=50"
        )
    noted = remark_on(base.base)
    place = "eqt budget"
    document = changed_at(base.document, ("store", "trajectories"), "all", place)
    document = changed_at(document, ("store", "decimate"), 1, place)
    base = study(document)
    sources = list(sources_of(base.base.loop))
    if not (sources or total):
        raise EqtError(
            f"{base.name}: has no imperfection to switch off: no noise, force, limit, delay or "
            "other inertia"
        )
    error = _error_of(base, error)
    times = np.asarray(base.base.times)
    rounding = 1e-9 * times[-1]
    inside = (times >= window.start - rounding) & (times <= window.stop + rounding)
    if inside.sum() < 2:
        raise InputError(
            f"window {window} holds {inside.sum()} samples, expected at least 2; the runs last "
            f"{times[-1]:g} s, with a sample every {times[1]:g} s"
        )
    variants = [(ALL, "")] if total else list(variants_of(base, sources))
    keys = frozenset(source.key for source in sources)
    distinct = {_switched_off(variant, keys): variant for variant in variants}
    status, errors = _computed(_Variants(base, tuple(distinct.values()), error), executor)
    which = [list(distinct).index(_switched_off(variant, keys)) for variant in variants]
    status, errors = status[which], errors[which][..., inside]
    good = (status == Status.OK).all(axis=0)
    laws = []
    for k, (label, title) in enumerate(base.base.titles.items()):
        if good[k].sum() < LEAST_RUNS:
            raise EqtError(
                f"{title}: {runs - good[k].sum()} of {runs} runs fail in some variant; look at "
                "them by `eqt run`"
            )
        of_law = errors[:, k, good[k]]
        means = SampledRuns(times[inside]).mean(of_law**2)
        squares = dict(zip(variants, means, strict=True))
        whole = of_law[variants.index((ALL, ""))]
        failed = int(runs - good[k].sum())
        laws.append(_law_budget(label, title, sources, squares, whole, shares, failed, total))
    signal = signal_of(error)
    assert signal
    return Budget(base.name, error, signal.unit, window, laws, noted)
