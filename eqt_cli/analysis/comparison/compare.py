"""The comparison of a result's controllers: what is measured, between whom, and what follows."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from eqt_cli.analysis.comparison.bootstrap import Resampling
from eqt_cli.analysis.comparison.claims import AtMost, Less, claim_sets
from eqt_cli.analysis.comparison.pairs import Level, Pair, statistics
from eqt_cli.analysis.comparison.verdicts import (
    Judgement,
    Settled,
    applicable,
    judge_at_most,
    judge_less,
    measured_by,
)
from eqt_cli.core.errors import EqtError
from eqt_cli.results.metrics import EARLY, METRICS
from eqt_cli.results.quantity import Quantity
from eqt_cli.results.result import PerRun, Result
from eqt_cli.results.time_windows import WHOLE, Window

_Key = tuple[str, Window]


@dataclass(frozen=True)
class Comparison:
    """What `compare` found.

    Attributes
    ----------
    title, group, labels, runs
        Of the result; runs per controller.
    titles
        How each controller is written, by label.
    kinds
        The kind of each controller, by label.
    failed
        Failed runs of each controller, by label.
    horizon
        s.
    levels, pairs
        One row per measure and controller, and per measure and pair of controllers.
    judgements
        One row per claim and measure; empty where no claim applies.
    lyapunov_functions
        Which function L is, by label; empty where it is the same one for all.
    not_matched
        Labels of laws with gains of their own.
    missing
        What could not be computed, and why.
    confidence, resamples, seed
        Of the bootstrap.
    """

    title: str
    group: str
    labels: list[str]
    titles: dict[str, str]
    runs: int
    kinds: dict[str, str]
    failed: dict[str, int]
    horizon: float
    levels: list[Level]
    pairs: list[Pair]
    judgements: list[Judgement]
    lyapunov_functions: dict[str, str]
    not_matched: list[str]
    missing: list[str]
    confidence: float
    resamples: int
    seed: int


def compare(
    result: Result,
    *,
    metrics: Sequence[str] = (),
    windows: Sequence[Window] = (),
    how: Resampling = Resampling(),  # noqa: B008  # it is frozen
) -> Comparison:
    """Compare the controllers of a result, run by run on the same initial states.

    Parameters
    ----------
    result
        Open, of a single experiment or of one point of a sweep.
    metrics
        Names of measures; a choice of all there are if empty. Claims are tested on theirs anyway.
    windows
        Over which measures that have windows are taken; each its own if empty.
    how
        The intervals are found; each holds by itself, and not all at once.

    Raises
    ------
    EqtError
        If a metric or window does not exist, the result holds too little, or it is a sweep.
    """
    if not 0 < how.confidence < 1:
        expected = "expected a number between 0 and 1, as 0.95"
        raise EqtError(f"confidence {how.confidence:g}: {expected}")
    if how.resamples < 1:
        raise EqtError(f"resamples {how.resamples}: expected at least 1")
    result.single("controllers are compared within one experiment")
    chosen = _chosen(result, metrics, windows)
    claimed = _claimed(result)
    wanted: dict[_Key, Quantity] = {}
    for measure, window in [*chosen, *claimed]:
        wanted.setdefault((measure.name, window.within(result.times)), measure)
    samples = {key: result.per_run(measure, key[1]) for key, measure in wanted.items()}
    measured = list(samples.values())
    levels, pairs, resamples = statistics(measured, result.labels, result.good, how)
    shown = {(measure.name, window.within(result.times)) for measure, window in chosen}
    return Comparison(
        title=result.title,
        group=result.group_name,
        labels=result.labels,
        titles=result.titled,
        runs=result.runs,
        kinds=result.kinds,
        failed=result.failed,
        horizon=float(result.times[-1] - result.times[0]),
        levels=[level for level in levels if _key(level.measured) in shown],
        pairs=[p for p in pairs if _key(p.measured) in shown and _same_measure(result, p)],
        judgements=_judgements(result, samples, pairs, how.confidence),
        lyapunov_functions=result.lyapunov_functions,
        not_matched=result.not_matched,
        missing=[*_clipped(result, windows), *_uncut(chosen, windows), *_missing(result)],
        confidence=how.confidence,
        resamples=resamples,
        seed=how.seed,
    )


def _same_measure(result: Result, pair: Pair) -> bool:
    """Whether the two are measured by the same number: laws may have an L of their own."""
    functions = result.lyapunov_functions
    same = functions.get(pair.first) == functions.get(pair.second)
    return same or "lyapunov" not in pair.measured.quantity.signals


def _key(measured: PerRun) -> _Key:
    return measured.quantity.name, measured.window


def _chosen(
    result: Result, metrics: Sequence[str], windows: Sequence[Window]
) -> list[tuple[Quantity, Window]]:
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


def _defaults(result: Result) -> list[tuple[Quantity, Window]]:
    """What is compared unless a user chooses; parts instead of norms with mixed units."""
    early = result.quantity("early_torque").window
    return [
        (quantity, window)
        for base in METRICS
        for quantity in result.by_parts(base.name)
        for window in (early if window == EARLY else window for window in base.compared)
        if result.covers(quantity, window)
    ]


def _by_kind(result: Result) -> dict[str, str]:
    """The first controller of every kind."""
    found: dict[str, str] = {}
    for label in result.labels:
        found.setdefault(result.kinds.get(label, label), label)
    return found


def _claimed(result: Result) -> list[tuple[Quantity, Window]]:
    """What the claims about these controllers are measured by."""
    kinds = _by_kind(result)
    found: list[tuple[Quantity, Window]] = []
    for _, claim in applicable(claim_sets.all(), list(kinds)):
        for row in claim.rows:
            if isinstance(row, Less):
                found += measured_by(result, row)
            elif row.measure in result.comparable:
                found.append((result.comparable[row.measure], WHOLE))
    return found


def _judgements(
    result: Result, samples: dict[_Key, PerRun], pairs: Sequence[Pair], confidence: float
) -> list[Judgement]:
    kinds = _by_kind(result)
    by_names = {(_key(pair.measured), pair.first, pair.second): pair for pair in pairs}

    def pair_of(key: _Key, first: str, second: str) -> Pair:
        found = by_names.get((key, first, second))
        return found or by_names[(key, second, first)].turned()

    settles = result.settles

    def settled(judged: Judgement, *labels: str) -> Judgement:
        if settles is None:
            return judged
        rows = [(label, result.labels.index(label)) for label in labels]
        return judged.with_settled(
            [Settled(label, int(settles[k].sum()), int(result.good[k].sum())) for label, k in rows]
        )

    rows = []
    for origin, claim in applicable(claim_sets.all(), list(kinds)):
        about = dict.fromkeys(kind for row in claim.rows for kind in row.kinds)
        absent = tuple(kind for kind in about if kind not in kinds)
        for row in claim.rows:
            if not set(row.kinds) <= set(kinds):
                continue
            if isinstance(row, AtMost):
                if row.measure not in result.comparable:
                    continue
                label = kinds[row.kind]
                some = samples[row.measure, WHOLE.within(result.times)]
                index = result.labels.index(label)
                judged = judge_at_most(origin, claim.says, row, some, index, label, confidence)
                rows.append(settled(replace(judged, absent=absent), label))
                continue
            for measure, window in measured_by(result, row):
                key = measure.name, window.within(result.times)
                pair = pair_of(key, kinds[row.lesser], kinds[row.greater])
                judged = replace(judge_less(origin, claim.says, pair), absent=absent)
                rows.append(settled(judged, pair.first, pair.second))
    return rows


def _uncut(chosen: Sequence[tuple[Quantity, Window]], windows: Sequence[Window]) -> list[str]:
    """Which measures the chosen windows do not apply to."""
    names = [measure.name for measure, _ in chosen if not measure.windowed] if windows else []
    if not names:
        return []
    verb = "have windows of their own" if len(names) > 1 else "has a window of its own"
    return [f"Windows do not apply to {', '.join(names)}, which {verb}."]


def _clipped(result: Result, windows: Sequence[Window]) -> list[str]:
    """Which of the chosen windows reach beyond the end of the runs."""
    shorter = [(window, window.within(result.times)) for window in windows]
    return [
        f"Window {window} is cut to {cut}, since the runs last {cut.stop:g} s."
        for window, cut in shorter
        if math.isfinite(window.stop) and cut.stop < window.stop
    ]


def _missing(result: Result) -> list[str]:
    """What this result cannot tell, in sentences."""
    stored = len(result.stored_runs)
    if stored == 0:
        return [
            "No trajectories are stored, so only stored metrics are compared: no other windows, no "
            "parts of other norms, no integral that is not among them, and no test that L never "
            "rises. Set store.trajectories to all for these."
        ]
    if stored < result.runs:
        return [
            f"Trajectories are stored of the first {stored} of {result.runs} runs; numbers that "
            "take trajectories are about those."
        ]
    return []
