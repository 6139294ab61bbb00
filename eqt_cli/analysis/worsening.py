"""The findings of a gate on two results: which runs fail anew, and what each rule says."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from eqt_cli.analysis import verdict
from eqt_cli.analysis.compare import beside, measures_of
from eqt_cli.analysis.comparison import Comparison
from eqt_cli.analysis.gate import UNKNOWN, Finding, Rule, change_of_mean, change_of_share
from eqt_cli.analysis.intervals import Word
from eqt_cli.base.errors import EqtError
from eqt_cli.base.reporting import count_of
from eqt_cli.results.quantity import Measure, Window
from eqt_cli.results.result import PerRun, Result


def findings(
    comparison: Comparison,
    first: Result,
    second: Result,
    rules: Sequence[Rule],
    windows: Sequence[Window],
    counterparts: Mapping[str, str],
) -> Iterator[Finding]:
    """Yield which runs fail that did not before, and then what each rule says of each law.

    Parameters
    ----------
    comparison
        The comparison of both results, whose words the rule ``worse`` reads.
    windows
        Windows over which the numbers of the rules are taken; the whole run if empty.
    counterparts
        Labels of laws of the second result, with those of the first.

    Raises
    ------
    EqtError
        If the horizons differ, or a number of a rule is not the same in both results.
    """
    if not math.isclose(horizon := second.times[-1] - second.times[0], comparison.horizon):
        lasts = f"its runs last {horizon:g} s, those of {first.path} {comparison.horizon:g} s"
        raise second.error(f"{lasts}; a gate compares equal horizons")
    for law, base in counterparts.items():
        before, now = first.good[first.labels.index(base)], second.good[second.labels.index(law)]
        failed = [run for run in np.flatnonzero(~now) if run >= len(before) or before[run]]
        if failed:
            some = f"{', '.join(map(str, failed[:5]))}{', …' * (len(failed) > 5)}"
            why = f"{count_of(len(failed), 'run')} failed that did not before: {some}"
            names = {"controller": law, "against": base}
            yield Finding(Rule("failed"), second.title_of[law], why=why, names=names)
    for answer in verdict.answers(comparison) if Rule("worse") in rules else ():
        if answer.decided and answer.word is Word.WORSE:
            [words] = verdict.names_of([answer.pair.measured], comparison)
            of = f"{comparison.titles[answer.pair.first]}: {words}"
            yield Finding(Rule("worse"), of, why=answer.pair.percent)
    for rule in (rule for rule in rules if rule.margin < math.inf):
        for quantity, window in measures_of(first, [rule.metric], windows):
            number = _in_both(first, second, rule, quantity, window)
            [words] = verdict.names_of([number], comparison)
            for law, base in counterparts.items():
                yield _judged(rule, number, first, second, base, law, words)


def _in_both(
    first: Result, second: Result, rule: Rule, quantity: Measure, window: Window
) -> PerRun:
    """Return the number of a rule in both results.

    Raises
    ------
    EqtError
        If it cannot be worse, if one result lacks it, or if it is not the same in both.
    """
    name, other = quantity.name, second.comparable.get(quantity.name)
    if other is None:
        raise second.error(f"holds no number '{name}', and {first.path} does")
    if quantity.better == "neither" or "lyapunov" in quantity.signals:
        why = "two results may differ in L" if quantity.signals else "no direction is better"
        raise EqtError(f"'{rule}': cannot be judged: {why}")
    stored = name if first.has(name) and second.has(name) else quantity.implied_by
    for key, value in first.attributes_of(stored).items() if stored else ():
        if (now := second.attributes_of(stored).get(key)) != value:
            raise second.error(f"'{name}' is not the same number: {key} {value} → {now}")
    numbers = [
        x.per_run(q, window.within(x.times)) for x, q in ((first, quantity), (second, other))
    ]
    return beside(numbers[0], numbers[1], min(first.runs, second.runs))


def _judged(
    rule: Rule, number: PerRun, first: Result, second: Result, base: str, law: str, words: str
) -> Finding:
    old, new, quantity = first.labels.index(base), second.labels.index(law), number.quantity
    rows = [old, len(first.labels) + new]
    before, now = number.values[rows]
    both, factor = (
        np.isfinite(before) & np.isfinite(now),
        rule.factor(number.unit, is_share=number.is_share),
    )
    late = int(number.censored[rows].any(axis=0).sum())
    lost = int((np.isfinite(before) & ~both & second.good[new, : len(now)]).sum())
    same = first.runs == second.runs and all(
        np.array_equal(first.metric(name, old), second.metric(name, new), equal_nan=True)
        for name in {*first.metrics} & {*second.metrics}
    )
    change_of = change_of_share if quantity.counts and not same else change_of_mean
    change, to_show = change_of(rule, before[both], now[both], factor)
    why = ""
    if late:
        why = f"{count_of(late, 'run')} did not settle, so use 'settled worse by 2 points'"
    elif lost:
        why = f"{count_of(lost, 'run')} has no value now, and had one before"
    names = {"controller": law, "against": base, "metric": quantity.name}
    of, is_gain = f"{second.title_of[law]}: {words}", quantity.better == "higher"
    change, to_show = (UNKNOWN, None) if why else (change, to_show)
    return Finding(rule, of, change, int(both.sum()), to_show, is_gain, why, names=names)
