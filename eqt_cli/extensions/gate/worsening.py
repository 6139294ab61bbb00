"""The findings of a gate on two results: which runs fail anew, and what each rule says."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial

import numpy as np

from eqt_cli.analysis import intervals
from eqt_cli.analysis.compare import compare
from eqt_cli.analysis.comparison import Comparison, Pair
from eqt_cli.analysis.comparison_tables import name_of
from eqt_cli.analysis.gate import TWO_SIDED, Finding, Rule, rules_of
from eqt_cli.analysis.intervals import FEWEST, Interval, Resampling, Word
from eqt_cli.base import purposes
from eqt_cli.base.errors import EqtError
from eqt_cli.base.reporting import count_of
from eqt_cli.results.quantity import Window
from eqt_cli.results.result import Result


@purposes.compare_fail_on
def gate(
    fail_on: Sequence[str], baseline: Result, candidate: Result, windows: Sequence[Window]
) -> Callable[[Comparison, Mapping[str, str]], list[Finding]]:
    """Return what finds, of a comparison and its pairs of laws, what each rule says.

    Raises
    ------
    EqtError
        In the cases of `checked`, before anything is compared.
    """
    rules = checked(fail_on, baseline, candidate, windows)

    def judge(comparison: Comparison, pairs: Mapping[str, str]) -> list[Finding]:
        return list(findings(comparison, baseline, candidate, rules, windows, pairs))

    return judge


def checked(
    fail_on: Sequence[str], baseline: Result, candidate: Result, windows: Sequence[Window]
) -> list[Rule]:
    """Parse rules, and refuse results of which they say nothing.

    Raises
    ------
    EqtError
        If a text is no rule, the horizons differ, or a number cannot be worse, is not in both
        results, or does not mean the same there.
    """
    if baseline.path.samefile(candidate.path):
        raise candidate.error("is both results; a gate compares two")
    horizon, base_horizon = (x.times[-1] - x.times[0] for x in (candidate, baseline))
    if not math.isclose(horizon, base_horizon):
        lasts = f"its runs last {horizon:g} s, those of {baseline.path} {base_horizon:g} s"
        raise candidate.error(f"{lasts}; a gate compares equal horizons")
    rules = rules_of(fail_on)
    for rule in (rule for rule in rules if rule.margin < math.inf):
        _check(rule, baseline, candidate, windows)
    return rules


def _check(rule: Rule, baseline: Result, candidate: Result, windows: Sequence[Window]) -> None:
    """Refuse a number that cannot be worse, that one result lacks, or that means another thing."""
    name, quantity = rule.metric, baseline.comparable_named(rule.metric)
    if name not in candidate.comparable:
        raise candidate.error(f"holds no number '{name}', and {baseline.path} does")
    if quantity.better == "neither" or "lyapunov" in quantity.signals:
        why = "L of both may differ" if "lyapunov" in quantity.signals else "no value is better"
        raise EqtError(f"'{rule}': cannot be judged, as {why}")
    stored = name if baseline.has(name) and candidate.has(name) else quantity.implied_by
    if stored:
        for key, value in baseline.attributes_of(stored).items():
            if (changed := candidate.attributes_of(stored).get(key)) != value:
                raise candidate.error(f"'{name}' is another number: {key} {value} → {changed}")
    if quantity.windowed:
        for window in windows:
            candidate.per_run(candidate.comparable[name], window)  # or says what it lacks


def findings(
    comparison: Comparison,
    baseline: Result,
    candidate: Result,
    rules: Sequence[Rule],
    windows: Sequence[Window],
    counterparts: Mapping[str, str],
) -> Iterator[Finding]:
    """Yield which runs fail that did not before, and then what each rule says of each law.

    Parameters
    ----------
    comparison
        The comparison of both results, whose words the rule ``worse`` reads.
    rules
        As `checked` returns them.
    windows
        Windows over which the numbers of the rules are taken; the whole run if empty.
    counterparts
        Labels of laws of the candidate, with those of the baseline that they are compared with.
    """
    unchanged = {}
    for law, base in counterparts.items():
        base_row, row = baseline.labels.index(base), candidate.labels.index(law)
        good = baseline.good[base_row]
        failed = [k for k in np.flatnonzero(~candidate.good[row]) if good[k : k + 1].all()]
        if failed:
            runs = ", ".join([*map(str, failed[:5]), *(["…"] if len(failed) > 5 else [])])
            why = f"{count_of(len(failed), 'run')} failed that did not before: {runs}"
            yield Finding(Rule("failed"), candidate.title_of[law], why=why)
        names = {*baseline.metrics} & {*candidate.metrics}
        numbers = ((baseline.metric(name, base_row), candidate.metric(name, row)) for name in names)
        unchanged[law] = all(np.array_equal(*two, equal_nan=True) for two in numbers)
    if Rule("worse") in rules:
        for pair in comparison.rows():
            if pair.word is Word.WORSE:
                number = f"{comparison.titles[pair.first]}: {name_of(pair.measured, comparison)}"
                yield Finding(Rule("worse"), number, why=pair.percent)
    compared = partial(compare, baseline, candidate, windows=windows, counterparts=counterparts)
    sequential = comparison.how.sequential
    # Of Fieller and Newcombe: no resample is read
    how = Resampling(TWO_SIDED, FEWEST, sequential=sequential)
    for rule in (rule for rule in rules if rule.margin < math.inf):
        bounds = compared(metrics=[rule.metric], how=how)
        if not bounds.pairs:
            raise candidate.error(f"has '{rule.metric}' in another unit, or not over the whole run")
        for pair in bounds.pairs:
            law = pair.first.partition("/")[2]
            number = f"{candidate.title_of[law]}: {name_of(pair.measured, bounds)}"
            yield judged(rule, pair, number, bounds, unchanged[law], sequential)


def judged(
    rule: Rule,
    pair: Pair,
    number: str,
    bounds: Comparison,
    unchanged: bool,
    sequential: bool = False,
) -> Finding:
    """Judge a number of two laws, of which the first is the new one."""
    measured, counts, n, why = pair.measured, pair.measured.quantity.counts, pair.pairs, ""
    factor = rule.factor(measured.unit, is_share=measured.is_share)
    differences, before = pair.differences, float(pair.values[1].mean()) if n else math.nan
    spread = float(np.std(differences, ddof=1)) if n > 1 else math.nan
    change, to_show = Interval(pair.relative, pair.relative_low, pair.relative_high), FEWEST
    if counts:  # Newcombe's bounds are too narrow where few runs differ, so these count, too
        ahead = (int(np.count_nonzero(sign * differences > 0)) for sign in (-1, 1))
        lost, gained = (_share(runs, n, sequential) for runs in ahead)
        low, high = gained.value - lost.high, gained.high - lost.value
        change = Interval(change.value, min(change.low, low), max(change.high, high))
        spread = math.sqrt(lost.value + gained.value)
        to_show = math.ceil(math.log(0.05) / math.log1p(-min(rule.margin / factor, 0.9)))
    elif rule.unit == "%":
        spread /= abs(before) or math.nan
    else:  # Fieller's interval relative to a constant is Student's
        size = 10 * float(np.abs(differences).max(initial=0.0)) or 1.0
        ones = np.full(n, size)
        relative = intervals.relative_difference(differences, ones, TWO_SIDED, sequential)
        change = Interval(*(size * end for end in relative))
    if bounds.identical or unchanged or not (counts or differences.any()):
        end = change.value if n >= FEWEST or bounds.identical else math.nan
        change = Interval(change.value, end, end)
    if spread > 0:
        runs = intervals.runs_to_decide(rule.margin / factor / spread, TWO_SIDED)
        to_show = max(to_show, (2 if sequential else 1) * (runs or 0))
    vague = not before or bounds.unresolved(pair)
    if pair.censored:
        why = f"{count_of(pair.censored, 'run')} did not settle; use 'settled worse by 2 points'"
    elif pair.undefined:
        why = f"{count_of(pair.undefined, 'run')} without a value"
    elif rule.unit == "%" and vague and not unchanged:
        why = "the means are 0, or within the error estimate of the runs; give a margin in a unit"
    names = {"controller": pair.first, "against": pair.second, "metric": rule.metric}
    ends = [math.nan if why else factor * end for end in change]
    is_gain = measured.quantity.better == "higher"
    return Finding(rule, number, Interval(*ends), n, to_show, is_gain, why, names=names)


def _share(count: int, runs: int, sequential: bool) -> Interval:
    """Return a share of runs with an exact interval; at every look, that of bets on it.

    With all shares alike before, the likelihood of the true one is below α/(n + 1) times their
    mean with probability α at most, at any look (Ville 1939).
    """
    if not (sequential and runs):
        return intervals.share(count, runs, TWO_SIDED, exact=True)
    from scipy.optimize import brentq  # slow to import
    from scipy.special import betaln, xlog1py, xlogy

    def excess(share: float) -> float:
        likelihood = xlogy(count, share) + xlog1py(runs - count, -share)
        return float(likelihood - betaln(count + 1, runs - count + 1) - math.log(1 - TWO_SIDED))

    of = count / runs
    low = float(brentq(excess, 1e-12, of)) if count else 0.0
    high = float(brentq(excess, of, 1 - 1e-12)) if count < runs else 1.0
    return Interval(of, low, high)
