"""Compares the laws of a result, and judges the claims of papers."""

from __future__ import annotations

import math
from abc import ABC
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from eqt_cli.analysis import verdict
from eqt_cli.analysis.comparison import ClaimVerdict, Comparison, Judgement
from eqt_cli.analysis.intervals import (
    NEGLIGIBLE,
    SHARE,
    Pair,
    Resampling,
    runs_without_exception,
    statistics,
)
from eqt_cli.base.errors import EqtError
from eqt_cli.base.registry import Registry
from eqt_cli.base.stored import SmallErrors
from eqt_cli.results.conclusion import conclusion_of
from eqt_cli.results.metrics import EARLY, METRICS
from eqt_cli.results.quantity import WHOLE, Measure, Window
from eqt_cli.results.result import PerRun, Result

# Base classes of claims. Does not know how claims are tested --------------------------------------


@dataclass(frozen=True)
class Less:
    """One law has less of something than another, on average over initial states.

    Attributes
    ----------
    lesser, greater
        Kinds of controllers, as in a configuration: ``eqt``.
    measure
        Name of a measure. If its parts have different units, each part is tested.
    window
        Window over which it is taken.
    rotation_only
        Whether the claim concerns only the orientation; then other parts of the pose are not
        tested.
    """

    lesser: str
    greater: str
    measure: str
    window: Window = WHOLE
    rotation_only: bool = False

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of the controllers of the claim."""
        return (self.lesser, self.greater)


@dataclass(frozen=True)
class AtMost:
    """In every run, a measure stays at or below a bound.

    Attributes
    ----------
    kind
        Kind of the controller.
    measure
        Name of a measure.
    bound
        Bound in the unit of the measure.
    statement
        The claim in words.
    """

    kind: str
    measure: str
    bound: float
    statement: str

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kind of the controller of the claim."""
        return (self.kind,)


@dataclass(frozen=True)
class Claim:
    """A sentence, and the rows by which it is measured.

    Attributes
    ----------
    says
        The claim in the words of its source.
    rows
        Statements that are tested separately; the claim is supported as far as they are.
    """

    says: str
    rows: tuple[Less | AtMost, ...]


class ClaimSet(ABC):
    """The claims of one source.

    Attributes
    ----------
    name
        Short name for tables and messages.
    source
        Reference of the source.
    claims
        Claims in the order of the source.
    experiment
        Sections of the configuration of the source. `compare` judges the claims unasked where a
        result has these, and all laws of the claims.
    """

    name: ClassVar[str]
    source: ClassVar[str]
    claims: ClassVar[tuple[Claim, ...]]
    experiment: ClassVar[Mapping[str, Any]] = {}


claim_sets = Registry("claim set", "claims", ClaimSet, ("analysis.compare",))


NEVER_RISES = 1e-6
"""Bound relative to L(0): far above solver errors, and far below any visible rise."""


class Hampsey2025(ClaimSet):
    """Hampsey, van Goor, Banavar, Mahony (2025), section 7."""

    name: ClassVar[str] = "hampsey2025"
    source: ClassVar[str] = "Hampsey et al. (2025), section 7"
    experiment: ClassVar[Mapping[str, Any]] = {
        "group": "SO3",
        "reference": {
            "kind": "torque",
            "torque": ["cos(t)", "sin(t)", "cos(t)*sin(t)"],
            "pose": "identity",
            "velocity": [0.0, 0.0, 0.0],
        },
    }
    claims: ClassVar[tuple[Claim, ...]] = (
        Claim(
            "All four of these controls are stabilising",
            tuple(
                AtMost(kind, "lyapunov_rise", NEVER_RISES, "L does not rise between samples")
                for kind in ("eqt", "gt", "nog", "asym")
            ),
        ),
        Claim(
            "the EqT control requires less control action for large error (the first 5 seconds of "
            "the response)",
            (Less("eqt", "gt", "mean_torque", EARLY),),
        ),
        Claim(
            "[EqT] leads to slightly slower attitude tracking than the GT control",
            (Less("gt", "eqt", "mean_pose_error", rotation_only=True),),
        ),
        Claim(
            "The EqT and GT controls appear to be superior to the two approximations",
            tuple(
                Less(lesser, greater, measure, rotation_only=measure == "mean_pose_error")
                for measure in ("mean_pose_error", "mean_torque")
                for lesser in ("eqt", "gt")
                for greater in ("nog", "asym")
            ),
        ),
    )


# Compares the controllers of a result: measures, differences of pairs, and judged claims ----------


def measured_by(result: Result, row: Less | AtMost) -> list[tuple[Measure, Window]]:
    """Return the measures that test a row; empty if the result cannot test it."""
    if isinstance(row, AtMost):
        measures = result.comparable
        return [(measures[row.measure], WHOLE)] if row.measure in measures else []
    return [
        (quantity, row.window)
        for quantity in result.by_parts(row.measure)
        if result.covers(quantity, row.window)
        and not (row.rotation_only and not _is_rotation(result, quantity))
    ]


def _is_rotation(result: Result, quantity: Measure) -> bool:
    """Whether a measure of the pose error concerns only the orientation."""
    if quantity.signals and quantity.signals[0].startswith("pose_error_rotation"):
        return True
    whole = result.units("mean_pose_error") if result.has("mean_pose_error") else ""
    return whole == "1" and not (quantity.parted and result.parts(quantity.signals[0]))


def judge_less(source: str, says: str, pair: Pair) -> Judgement:
    """Judge a claim that the first of a pair has less than the second.

    It is supported if the intervals of the mean and of the median lie below 0, not supported if
    neither holds less, and undecided otherwise.
    """
    _, low, high = pair.medians[0]
    if pair.high < 0 and high < 0:
        verdict = ClaimVerdict.SUPPORTED
    elif pair.low >= 0 and low >= 0 and not pair.low == pair.high == 0:
        verdict = ClaimVerdict.NOT_SUPPORTED
    else:
        verdict = ClaimVerdict.UNDECIDED
    return Judgement(source, says, verdict, pair.runs_to_decide, pair=pair)


def judge_at_most(
    source: str, says: str, row: AtMost, measured: PerRun, index: int, label: str, confidence: float
) -> Judgement:
    """Judge a claim that a bound holds in every run.

    One exception makes it not supported. It is supported if the runs without exception show that at
    least 95 % of all initial states have none (exact binomial interval of Clopper and Pearson).
    """
    from scipy.special import betaincinv  # slow to import

    values = measured.values[index]
    values = values[np.isfinite(values)]
    held, runs = int(np.count_nonzero(values <= row.bound)), len(values)
    low = float(betaincinv(held, runs - held + 1, 1 - confidence)) if held else 0.0
    if held < runs:
        verdict = ClaimVerdict.NOT_SUPPORTED
    else:
        verdict = ClaimVerdict.SUPPORTED if low >= SHARE else ClaimVerdict.UNDECIDED
    needed = runs_without_exception(confidence)
    return Judgement(
        source,
        says,
        verdict,
        needed,
        measured=measured,
        controller=label,
        statement=row.statement,
        held=held,
        runs=runs,
        low=low,
    )


_Key = tuple[str, Window]


def compare(
    result: Result,
    *,
    metrics: Sequence[str] = (),
    windows: Sequence[Window] = (),
    labels: Sequence[str] = (),
    how: Resampling = Resampling(),  # noqa: B008  # it is frozen
    negligible: float = NEGLIGIBLE,
) -> Comparison:
    """Compare the laws of a result, run by run on the same initial states.

    Parameters
    ----------
    result
        An open result of a single experiment or of one point of a sweep.
    metrics
        Names of measures; a default selection if empty. Claims are always tested on their own
        measures.
    windows
        Windows over which measures are taken; the default windows of each measure if empty.
    labels
        Labels of the controllers to compare; all if empty.
    how
        Settings of the intervals. They are not corrected for multiple comparisons.
    negligible
        Relative difference within which there is none.

    Raises
    ------
    EqtError
        If a metric or window does not exist, data is missing, or the result is a sweep.
    """
    _check(result, how)
    chosen = _chosen(result, metrics, windows)
    concluded = conclusion_of(result)
    chosen_laws, tuned = labels or concluded.compared(result), concluded.starts
    labels = [label for label in result.labels if label in chosen_laws]
    kinds: dict[str, str] = {}  # the first law of each kind
    for label in labels:
        kinds.setdefault(result.kinds.get(label, label), label)
    tests = list(_tests(result, kinds))
    samples: dict[_Key, PerRun] = {}
    for measure, window in [*chosen, *((measure, window) for *_, measure, window in tests)]:
        key = measure.name, window.within(result.times)
        if key not in samples:
            samples[key] = result.per_run(measure, window)
    if result.repeats:
        samples = {key: _first_run(numbers) for key, numbers in samples.items()}
    levels, pairs, resamples = statistics([*samples.values()], result.labels, result.good, how)
    judgements = _judgements(result, tests, kinds, samples, pairs, how.confidence)
    shown = {(measure.name, window.within(result.times)) for measure, window in chosen}
    of_all, small = result.lyapunov_functions, result.described.small_errors
    # The gains of a tuning differ, since each law has those that suit it.
    gains = {} if tuned else _gains(small, dict.fromkeys(labels, labels[0]), result.title_of)
    declared = () if tuned else result.described.not_matched
    functions = {label: of_all[label] for label in labels if label in of_all}
    without = [label for label in labels if label in result.described.without_forces]
    between = []
    if 0 < len(without) < len(labels):
        names = ", ".join(result.title_of[label] for label in without)
        between = [f"without the forces of `model` (`known_forces: false`): {names}"]
    return _with_answer(
        result,
        how,
        title=result.title,
        labels=labels,
        titles={label: result.title_of[label] for label in labels},
        runs=result.runs,
        kinds={label: kind for label, kind in result.kinds.items() if label in labels},
        failed={label: count for label, count in result.failed.items() if label in labels},
        levels=[x for x in levels if _key(x.measured) in shown and x.controller in labels],
        pairs=[
            pair
            for pair in pairs
            if _key(pair.measured) in shown
            and _same_measure(result, pair)
            and {pair.first, pair.second} <= set(labels)
        ],
        judgements=judgements,
        departures=result.described.departures,
        lyapunov_functions=functions if len(set(functions.values())) > 1 else {},
        not_matched=[label for label in labels if label in declared or label in gains],
        gains=gains,
        between=between,
        resolution=_resolution(result),
        points=max(result.out_of, 1),
        identical=result.repeats,
        missing=[*_cut(result, chosen, windows), *_missing(result)],
        resamples=resamples,
        negligible=negligible,
    )


def _gains(
    small: Mapping[str, SmallErrors], bases: Mapping[str, str], titles: Mapping[str, str]
) -> dict[str, str]:
    """Return how laws fly with other gains than at Q_d = I, or than their base has."""
    words = {}
    for label, base in bases.items():
        if label in small and small[label].departs:
            words[label] = small[label].departs
        elif differs := _differ(small, label, base):
            words[label] = f"{differs} of {titles[base]}"
    return words


def _resolution(result: Result) -> float:
    """Return the largest error estimate of the good runs; 0 where none is known."""
    if not result.has("error_estimate"):
        return 0.0
    estimates = result["error_estimate"][result.good]
    return float(np.nanmax(estimates, initial=0.0))


def _differ(small: Mapping[str, SmallErrors], one: str, other: str) -> str:
    both = one in small and other in small
    return small[one].differs_from(small[other]) if both else ""


def _with_answer(result: Result, how: Resampling, **fields: Any) -> Comparison:
    """Return a comparison, whose answer in words and as records is not needed by all."""
    return Comparison(
        group=result.group_name,
        horizon=float(result.times[-1] - result.times[0]),
        confidence=how.confidence,
        seed=how.seed,
        in_words=_in_words,
        in_rows=_in_rows,
        **fields,
    )


def _in_words(comparison: Comparison) -> list[str]:
    about = f"{comparison.title} on {comparison.group}: {comparison.runs} runs of each law"
    return [about, *verdict.lines(comparison)]


def _in_rows(comparison: Comparison) -> list[dict[str, Any]]:
    from eqt_cli.analysis.comparison_tables import rows_of

    return rows_of(comparison)


def _check(result: Result, how: Resampling) -> None:
    """Refuse settings of the bootstrap that are none, and a whole sweep."""
    if not 0 < how.confidence < 1:
        expected = "expected a number between 0 and 1, as 0.95"
        raise EqtError(f"confidence {how.confidence:g}: {expected}")
    if how.resamples < 1:
        raise EqtError(f"resamples {how.resamples}: expected at least 1")
    result.single("controllers are compared within one experiment")


def compare_two(
    first: Result,
    second: Result,
    *,
    metrics: Sequence[str] = (),
    windows: Sequence[Window] = (),
    between: Sequence[str] = (),
    counterparts: Mapping[str, str],
    how: Resampling = Resampling(),  # noqa: B008  # it is frozen
    negligible: float = NEGLIGIBLE,
) -> Comparison:
    """Compare laws of the second result with laws of the first.

    Runs with equal numbers are pairs. Where their starts differ, the runs of a pair are
    independent, and intervals and tests hold, too. Numbers of L are left out, since L may differ.

    Parameters
    ----------
    between
        Sentences on the two results.
    counterparts
        Labels of laws of the second result, with those of the first that they are compared with.

    Raises
    ------
    EqtError
        As `compare`, or if the results are of different groups.
    """
    both = first, second
    for result in both:
        _check(result, how)
    if first.group_name != second.group_name:
        raise second.error(f"is of {second.group_name}, and the other result of {first.group_name}")
    names = [result.path.parent.name for result in both]
    names = names if names[0] != names[1] else ["first", "second"]
    laws = {
        f"{name}/{law}": (name, result, law)
        for name, result in zip(names, both, strict=True)
        for law in result.labels
    }
    runs = min(result.runs for result in both)
    good = np.vstack([result.good[:, :runs] for result in both])
    chosen, measured = _chosen(first, metrics, windows), []
    for quantity, window in chosen:
        wanted = second.comparable_named if metrics else second.comparable.get  # raises, or None
        other = wanted(quantity.name)
        if other is None or not second.covers(other, window) or "lyapunov" in quantity.signals:
            continue
        of_first = first.per_run(quantity, window.within(first.times))
        of_second = second.per_run(other, window.within(second.times))
        if of_first.unit == of_second.unit:
            measured.append(_beside(of_first, of_second, runs))
    if identical := first.repeats and second.repeats:
        measured = [_first_run(numbers) for numbers in measured]
    levels, pairs, resamples = statistics(measured, list(laws), good, how)
    bases = {f"{names[1]}/{law}": f"{names[0]}/{base}" for law, base in counterparts.items()}
    titles = {k: f"{result.title_of[law]} ({name})" for k, (name, result, law) in laws.items()}
    errors_of = {k: (result.described.small_errors, law) for k, (_, result, law) in laws.items()}
    small = {label: errors[law] for label, (errors, law) in errors_of.items() if law in errors}
    of_base = dict.fromkeys(bases.values(), f"the law in {names[0]}")
    gains = _gains(small, {label: bases.get(label, label) for label in laws}, titles | of_base)
    return _with_answer(
        first,
        how,
        title=" and ".join(names),
        labels=list(laws),
        titles=titles,
        runs=runs,
        kinds={label: result.kinds[law] for label, (_, result, law) in laws.items()},
        failed=dict(zip(laws, np.count_nonzero(~good, axis=1).tolist(), strict=True)),
        levels=levels,
        pairs=[pair for pair in pairs if bases.get(pair.second) == pair.first],
        missing=[*_cut(first, chosen, windows), *_missing(first), *_missing(second)],
        resamples=resamples,
        negligible=negligible,
        not_matched=list(gains),
        resolution=max(map(_resolution, both)),
        points=max(second.out_of, 1),
        identical=identical,
        gains=gains,
        bases=bases,
        between=between,
    )


def _beside(first: PerRun, second: PerRun, runs: int) -> PerRun:
    """Return the numbers of two results, those of the first above those of the second."""
    values = np.vstack([first.values[:, :runs], second.values[:, :runs]])
    censored = np.vstack([first.censored[:, :runs], second.censored[:, :runs]])
    shared = min(runs, first.runs, second.runs)
    values[:, shared:] = np.nan
    return replace(first, values=values, censored=censored, runs=shared)


def _first_run(numbers: PerRun) -> PerRun:
    """Return the numbers of the first run, where all others are the same."""
    values, censored = numbers.values[:, :1], numbers.censored[:, :1]
    return replace(numbers, values=values, censored=censored, runs=1)


def _same_measure(result: Result, pair: Pair) -> bool:
    """Whether the number means the same for both laws: each may have its own L."""
    functions = result.lyapunov_functions
    same = functions.get(pair.first) == functions.get(pair.second)
    return same or "lyapunov" not in pair.measured.quantity.signals


def _key(measured: PerRun) -> _Key:
    return measured.quantity.name, measured.window


def _chosen(
    result: Result, metrics: Sequence[str], windows: Sequence[Window]
) -> list[tuple[Measure, Window]]:
    if not metrics and not windows:
        return _defaults(result)
    names = metrics or list(dict.fromkeys(measure.name for measure, _ in _defaults(result)))
    chosen = []
    for name in names:
        measure = result.comparable_named(name)
        if measure.windowed:
            over = [w for w in windows or (WHOLE,) if metrics or result.covers(measure, w)]
        else:
            over = [measure.window]
        chosen += [(measure, window) for window in over]
    return chosen


def _defaults(result: Result) -> list[tuple[Measure, Window]]:
    """Return the default measures; parts replace norms with mixed units.

    If some settling times lie beyond the horizon, the shares of settled runs replace their means.
    """
    early = result.quantity("early_torque").window
    return [
        (quantity, window)
        for base in (*METRICS, *map(result.quantity, result.own_metrics))
        for quantity in result.by_parts(base.name)
        for window in (early if window == EARLY else window for window in base.compared)
        if result.covers(quantity, window) and _tells(result, quantity, window)
    ]


def _tells(result: Result, quantity: Measure, window: Window) -> bool:
    """Whether its mean says more than that of the number it follows from, or that follows."""
    if quantity.censored:
        return not result.per_run(quantity, window).censored.any()
    if quantity.implied_by and not result.has(quantity.name):
        return bool(result.censored(quantity.implied_by).any())
    return True


_Test = tuple[type[ClaimSet], Claim, Less | AtMost, Measure, Window]
"""A source, a claim of it, a row of this, and a measure over a window that tests the row."""


def _tests(result: Result, kinds: Mapping[str, str]) -> Iterator[_Test]:
    """Yield the tests of the rows of claims about controllers of these kinds."""
    for claim_set in claim_sets.all():
        for claim in claim_set.claims:
            covered = [row for row in claim.rows if set(row.kinds) <= set(kinds)]
            for row in covered:
                for measure, window in measured_by(result, row):
                    yield claim_set, claim, row, measure, window


def _judgements(
    result: Result,
    tests: Sequence[_Test],
    kinds: Mapping[str, str],
    samples: dict[_Key, PerRun],
    pairs: Sequence[Pair],
    confidence: float,
) -> list[Judgement]:
    by_names = {(_key(pair.measured), pair.first, pair.second): pair for pair in pairs}
    rows = []
    for claim_set, claim, row, measure, window in tests:
        source, sections = claim_set.source, claim_set.experiment.items()
        laws = {kind for x in claim_set.claims for row in x.rows for kind in row.kinds}
        is_at_home = laws <= set(kinds) and all(result.config.get(k) == x for k, x in sections)
        key = measure.name, window.within(result.times)
        if isinstance(row, AtMost):
            label = kinds[row.kind]
            index = result.labels.index(label)
            judged = judge_at_most(source, claim.says, row, samples[key], index, label, confidence)
        else:
            first, second = kinds[row.lesser], kinds[row.greater]
            pair = by_names.get((key, first, second)) or by_names[key, second, first].swapped()
            judged = judge_less(source, claim.says, pair)
            if words := _differ(result.described.small_errors, first, second):
                incomparable = ClaimVerdict.NOT_COMPARABLE
                judged = replace(judged, verdict=incomparable, runs_to_decide=None, statement=words)
        if result.described.departures:
            uncovered = ClaimVerdict.NOT_COVERED
            judged = replace(judged, verdict=uncovered, runs_to_decide=None)
        mentioned = dict.fromkeys(kind for other in claim.rows for kind in other.kinds)
        absent = tuple(kind for kind in mentioned if kind not in kinds)
        rows.append(replace(judged, absent=absent, is_at_home=is_at_home))
    return rows


def _cut(
    result: Result, chosen: Sequence[tuple[Measure, Window]], windows: Sequence[Window]
) -> Iterator[str]:
    """Note the windows that reach beyond the end of the runs, and the measures without a choice."""
    for window in windows:
        cut = window.within(result.times)
        if math.isfinite(window.stop) and cut.stop < window.stop:
            yield f"Window {window} is cut to {cut}, since the runs last {cut.stop:g} s."
    names = [measure.name for measure, _ in chosen if not measure.windowed]
    if windows and names:
        verb = "have their own windows" if len(names) > 1 else "has its own window"
        yield f"Windows do not apply to {', '.join(names)}, which {verb}."


def _missing(result: Result) -> Iterator[str]:
    """Note the numbers that need trajectories which are not stored."""
    stored = len(result.stored_runs)
    if stored == 0:
        yield (
            "No trajectories are stored, so only stored metrics are compared: no other windows, no "
            "parts of other norms, no integral that is not among them, and no test that L never "
            "rises. Set store.trajectories to all for these."
        )
    elif stored < result.runs:
        yield (
            f"Trajectories are stored of the first {stored} of {result.runs} runs; numbers that "
            "take trajectories are about those."
        )
