"""Compares the laws of a result, or of two results: which numbers, of which laws and runs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from eqt_cli.analysis.claims import judged, tests_of
from eqt_cli.analysis.comparison import Comparison, Numbers
from eqt_cli.analysis.comparison_tables import answer_lines
from eqt_cli.analysis.intervals import NEGLIGIBLE, Resampling
from eqt_cli.base import purposes
from eqt_cli.base.errors import EqtError
from eqt_cli.base.extensions import functions_for
from eqt_cli.base.reporting import listed
from eqt_cli.results.conclusion import conclusion_of
from eqt_cli.results.metrics import EARLY, METRICS
from eqt_cli.results.quantity import Measure, Window
from eqt_cli.results.result import PerRun, Result, by_parts, covers, window_of
from eqt_cli.results.summary import not_shared, own_metrics, repeats

_Laws = Mapping[str, tuple[Result, str]]
"""Results of the compared laws, by label, with the label of the law there."""

_Chosen = Sequence[tuple[Measure, Window]]


def compare(
    result: Result,
    second: Result | None = None,
    *,
    metrics: Sequence[str] = (),
    windows: Sequence[Window] = (),
    labels: Sequence[str] = (),
    counterparts: Mapping[str, str] | None = None,
    between: Sequence[str] = (),
    how: Resampling = Resampling(),  # noqa: B008  # it is frozen
    negligible: float = NEGLIGIBLE,
) -> Comparison:
    """Compare the laws of a result, or those of a second one with them, run by run.

    Of two results, runs with equal numbers are pairs. Where their starts differ, the runs of a pair
    are independent, and intervals and tests hold, too. Numbers of L are left out, since L may
    differ.

    Parameters
    ----------
    result, second
        Open results of a single experiment or of one point of a sweep.
    metrics
        Names of measures; a default selection if empty. Claims are always tested on their own
        measures.
    windows
        Windows over which measures are taken; the default windows of each measure if empty.
    labels
        Labels of the controllers to compare; all if empty.
    counterparts
        Of two results, labels of laws of the second, with those of the first that they are compared
        with.
    between
        Sentences on the two results.
    how
        Settings of the intervals. They are not corrected for multiple comparisons.
    negligible
        Relative difference within which there is none.

    Raises
    ------
    EqtError
        If a metric or window does not exist, data is missing, a result is a sweep, or the results
        are of different groups.
    """
    both = [result] if second is None else [result, second]
    _check(both, how)
    concluded, names = conclusion_of(result), [one.path.parent.name for one in both]
    if second is None:
        of_result = labels or concluded.compared(result)
        laws: _Laws = {label: (result, label) for label in result.labels if label in of_result}
        titles = {label: result.title_of[label] for label in laws}
    else:
        names = names if names[0] != names[1] else ["first", "second"]
        named = zip(names, both, strict=True)
        laws = {f"{name}/{law}": (one, law) for name, one in named for law in one.labels}
        of = dict(zip(map(id, both), names, strict=True))
        titles = {x: f"{one.title_of[law]} ({of[id(one)]})" for x, (one, law) in laws.items()}
    pairs = (counterparts or {}).items()
    bases = {f"{names[-1]}/{law}": f"{names[0]}/{base}" for law, base in pairs}
    kinds = {label: one.kinds[law] for label, (one, law) in laws.items()}
    of_kind = {kind: label for label, kind in reversed(kinds.items())}  # the first of each
    tests = list(tests_of(result, of_kind)) if second is None else []
    chosen = _chosen(result, metrics, windows)
    of_tests = [(test.measure, test.window) for test in tests]
    numbers = dict[tuple[str, Window], PerRun]()
    for measure, window in [*chosen, *of_tests]:
        key = measure.name, window.within(result.times)
        if key not in numbers and (number := _number(laws, measure, window, bool(metrics))):
            numbers[key] = number
    if second is not None and not windows and window_of(second) != window_of(result):
        lost = [
            measure.name
            for measure, over in chosen
            if not covers(second, second.quantity(measure.name), over)
        ]
        between = [*between, _other_window(names, both, lost)]
    shown = {(measure.name, window.within(result.times)) for measure, window in chosen}
    runs = min(one.runs for one in both)
    good = np.stack([one.good[one.labels.index(law), :runs] for one, law in laws.values()])
    table, at = Numbers([*laws], good, [*numbers.values()], how), [*numbers].index
    judgements = []
    for test in tests:
        k = at((test.measure.name, test.window.within(result.times)))
        judgements.append(judged(result, test, of_kind, table, k))
    functions = {label: one.lyapunov_functions.get(law, "") for label, (one, law) in laws.items()}
    # The gains of a tuning differ, since each law has those that suit it.
    tuned = second is None and concluded.starts
    gains = {} if tuned else _gains(laws, titles, bases, names[0])
    declared = result.described.not_matched if second is None and not tuned else []
    without = [titles[x] for x, (one, law) in laws.items() if law in one.described.without_forces]
    if second is None and concluded.premise:
        between = [*between, concluded.premise]
    remarks = functions_for(purposes.remarks_on_a_result)
    between = [*between, *(line for lines in remarks for one in both for line in lines(one))]
    if 0 < len(without) < len(laws):
        forces = f"without the forces of `model` (`known_forces: false`): {', '.join(without)}"
        between = [*between, forces]
    setpoints = {
        titles[x]: one.described.setpoints.get(law, "full") for x, (one, law) in laws.items()
    }
    if len({*setpoints.values()}) > 1:
        words = ", ".join(f"{title}: {kind}" for title, kind in setpoints.items())
        between = [*between, f"laws know different parts of the reference (`setpoint`): {words}"]
    inner = {titles[x]: one.described.inner.get(law, "") for x, (one, law) in laws.items()}
    return Comparison(
        title=result.title if second is None else " and ".join(names),
        group=result.group_name,
        labels=list(laws),
        titles=titles,
        runs=runs,
        kinds=kinds,
        failed=dict(zip(laws, np.count_nonzero(~good, axis=1).tolist(), strict=True)),
        horizon=float(result.times[-1] - result.times[0]),
        numbers=table,
        shown=len(shown & numbers.keys()),
        missing=[*_cut(result, chosen, windows), *(x for one in both for x in _missing(one))],
        sentences=answer_lines,
        negligible=negligible,
        judgements=judgements,
        departures=result.described.departures,
        lyapunov_functions=functions if len(set(functions.values())) > 1 else {},
        not_matched=[label for label in laws if label in declared or label in gains],
        gains=gains,
        resolution=max(map(_resolution, both)),
        points=max(1, *(one.out_of for one in both)),
        identical=all(repeats(one) for one in both),
        bases=bases,
        between=[*between, *not_shared(inner)],
    )


def _check(both: Sequence[Result], how: Resampling) -> None:
    """Refuse settings of the bootstrap that are none, whole sweeps, and different groups."""
    if not 0 < how.confidence < 1:
        expected = "expected a number between 0 and 1, as 0.95"
        raise EqtError(f"confidence {how.confidence:g}: {expected}")
    if how.resamples < 1:
        raise EqtError(f"resamples {how.resamples}: expected at least 1")
    for result in both:
        result.single("controllers are compared within one experiment")
        conclusion_of(result).compared(result)  # which may refuse
    group, other = both[0].group_name, both[-1].group_name
    if group != other:
        raise both[-1].error(f"is of {other}, and the other result of {group}")


def _number(laws: _Laws, measure: Measure, window: Window, by_name: bool) -> PerRun | None:
    """Return a number of all laws, of the runs that all results have.

    None where the second result has no such number; where it was chosen `by_name`, that is an
    error.
    """
    both = list({id(result): result for result, _ in laws.values()}.values())
    numbers = {id(both[0]): both[0].per_run(measure, window)}
    for result in both[1:]:
        name = measure.name
        other = result.comparable_named(name) if by_name else result.comparable.get(name)
        if other is None or not covers(result, other, window) or "lyapunov" in measure.signals:
            return None
        numbers[id(result)] = result.per_run(other, window)
    first, *others = numbers.values()
    if any(other.unit != first.unit for other in others):
        return None
    rows = [(numbers[id(result)], result.labels.index(law)) for result, law in laws.values()]
    runs = min(result.runs for result in both)
    values = np.stack([number.values[row, :runs] for number, row in rows])
    censored = np.stack([number.censored[row, :runs] for number, row in rows])
    shared = min(runs, *(number.runs for number in numbers.values()))
    values[:, shared:] = np.nan
    if all(repeats(result) for result in both):  # all other runs are the same
        values, censored, shared = values[:, :1], censored[:, :1], 1
    return replace(first, values=values, censored=censored, runs=shared)


def _other_window(names: Sequence[str], both: Sequence[Result], lost: Sequence[str]) -> str:
    """Say that two results measure over other windows, and which numbers cannot be compared."""
    first, second = (window_of(one).words.strip() or "the whole runs" for one in both)
    words = f"metrics are of {names[0]} {first}, of {names[1]} {second}: compared as of {names[0]}"
    if not lost:
        return words
    return f"{words}; without {listed(lost)}, which {names[1]} does not hold over that time"


def _gains(
    laws: _Laws, titles: Mapping[str, str], bases: Mapping[str, str], name: str
) -> dict[str, str]:
    """Return how laws fly with other gains than at Q_d = I, or than their base has."""
    words, small = {}, {}
    for label, (result, law) in laws.items():
        if law in result.described.small_errors:
            small[label] = result.described.small_errors[law]
    for label in small:
        base = bases.get(label, label) if bases else next(iter(laws))
        if small[label].departs:
            words[label] = small[label].departs
        elif base in small and (differs := small[label].differs_from(small[base])):
            words[label] = f"{differs} of {f'the law in {name}' if bases else titles[base]}"
    return words


def _resolution(result: Result) -> float:
    """Return the largest error estimate of the good runs; 0 where none is known."""
    if not result.has("error_estimate"):
        return 0.0
    estimates = result["error_estimate"][result.good]
    return float(np.nanmax(estimates, initial=0.0))


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
            wished = windows or (measure.window,)
            over = [w for w in wished if metrics or covers(result, measure, w)]
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
        for base in (*METRICS, *map(result.quantity, own_metrics(result)))
        for quantity in by_parts(result, base.name)
        for window in (early if window == EARLY else quantity.window for window in base.compared)
        if covers(result, quantity, window) and _tells(result, quantity, window)
    ]


def _tells(result: Result, quantity: Measure, window: Window) -> bool:
    """Whether its mean says more than that of the number it follows from, or that follows."""
    if quantity.censored:
        return not result.per_run(quantity, window).censored.any()
    if quantity.implied_by and not result.has(quantity.name):
        return bool(result.censored(quantity.implied_by).any())
    return True


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
