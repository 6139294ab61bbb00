"""A comparison as a sentence per claim or measure, and as plain data for JSON and CSV."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from eqt_cli.analysis.comparison.compare import Comparison
from eqt_cli.analysis.comparison.intervals import SHARE
from eqt_cli.analysis.comparison.notation import Plain, percent
from eqt_cli.analysis.comparison.pairs import Level, Pair
from eqt_cli.analysis.comparison.verdicts import ClaimVerdict, Judgement
from eqt_cli.results.result import PerRun

Record = dict[str, Any]


def records(comparison: Comparison) -> dict[str, list[Record]]:
    """Return all tables by name, with a record per measure and controller, pair or claim.

    Differences are first minus second.
    """
    return {
        "controllers": [_level(level) for level in comparison.levels],
        "pairs": [_pair(pair) for pair in comparison.pairs],
        "claims": [_judgement(judgement) for judgement in comparison.judgements],
    }


def _what(measured: PerRun) -> Record:
    return {
        "metric": measured.quantity.name,
        "window_start": measured.window.start,
        "window_stop": measured.window.stop,
        "units": measured.unit,
    }


def _fields(row: Level | Pair | Judgement, *names: str) -> Record:
    return {name: getattr(row, name) for name in names}


def _level(level: Level) -> Record:
    return {
        **_what(level.measured),
        **_fields(level, "controller", "runs", "failed", "undefined", "censored"),
        **_fields(level, "mean", "low", "high", "standard_deviation", "median"),
    }


def _pair(pair: Pair) -> Record:
    return {
        **_what(pair.measured),
        **_fields(pair, "first", "second", "pairs", "failed", "undefined", "censored"),
        **_fields(pair, "difference", "low", "high", "relative", "cohen_d", "first_better"),
        **({} if pair.p_value is None else {"p_value": pair.p_value}),
        "runs_to_decide": pair.runs_to_decide,
    }


def _judgement(judgement: Judgement) -> Record:
    common = {
        "source": judgement.source,
        "claim": judgement.says,
        "verdict": str(judgement.verdict),
        "runs_to_decide": judgement.runs_to_decide,
    }
    if judgement.pair is not None:
        pair = _pair(judgement.pair)
        pair.pop("runs_to_decide")
        statement = "first is less than second"
        return {**common, "statement": statement, **pair, **_settled(judgement)}
    assert judgement.measured is not None
    return {
        **common,
        "statement": judgement.statement,
        **_what(judgement.measured),
        "first": judgement.controller,
        "pairs": judgement.runs,
        **_fields(judgement, "held", "low"),
        **_settled(judgement),
    }


def _settled(judgement: Judgement) -> Record:
    """Return the number of settled runs of the first and the second law."""
    names = ("first_settled", "second_settled")
    return {name: law.count for name, law in zip(names, judgement.settled, strict=False)}


RANKED = ("mean_torque", "mean_pose_error", "settled")
"""Measures by which laws are ranked if no claim is about them."""

PARTLY = "partly"
"""Prefix of a verdict that only some rows of a claim have."""

_AGREES = (ClaimVerdict.SUPPORTED, ClaimVerdict.SEEN)

_WRITE = Plain()


@dataclass(frozen=True)
class Finding:
    """A sentence about a claim or a measure.

    Attributes
    ----------
    verdict
        Verdict of the claim as in `ClaimVerdict`, after `PARTLY` if its rows differ; empty without
        claims.
    claim
        The claim in the words of its source; empty if all claims have this verdict.
    words
        The measured numbers in words.
    absent
        Laws that the claim mentions and the result does not have.
    """

    verdict: str
    claim: str
    words: str
    absent: str = ""


def findings(comparison: Comparison, titles: Mapping[str, str]) -> list[Finding]:
    """Return one finding for each claim; where none is judged, the best laws by usual measures.

    Parameters
    ----------
    titles
        Display names of the laws, by label.
    """
    if comparison.judgements and comparison.departures:
        words = f"claims of {sources(comparison)}. Beyond their theorems: {comparison.departures}."
        return [*_ranking(comparison, titles), Finding(str(ClaimVerdict.NOT_COVERED), "", words)]
    claimed = groupby(comparison.judgements, key=lambda judgement: judgement.says)
    level = f"{100 * comparison.confidence:g} %"
    found = [_of_claim(says, list(rows), titles, level) for says, rows in claimed]
    return found or list(_ranking(comparison, titles))


def sources(comparison: Comparison) -> str:
    """Return the sources of the claims."""
    return "; ".join(dict.fromkeys(row.source for row in comparison.judgements))


def _of_claim(
    says: str, rows: Sequence[Judgement], titles: Mapping[str, str], level: str
) -> Finding:
    verdict = _together({row.verdict for row in rows})
    in_every_run = [row for row in rows if row.pair is None]
    compared = [row for row in rows if row.pair is not None]
    words = [*_in_every_run(in_every_run, titles, level), *_compared(compared, titles)]
    words += _unsettled(rows, titles)
    absent = [titles.get(kind, kind) for kind in rows[0].absent]
    return Finding(verdict, says, "; ".join(words) + ".", listed(absent) if absent else "")


def _together(verdicts: set[ClaimVerdict]) -> str:
    """Combine the verdicts of the rows of a claim."""
    agrees = [verdict for verdict in _AGREES if verdict in verdicts]
    if verdicts <= set(_AGREES) or len(verdicts) == 1:
        return str([*verdicts - set(agrees), *agrees][-1])
    return f"{PARTLY} {agrees[-1]}" if agrees else str(ClaimVerdict.NOT_SUPPORTED)


def _unsettled(rows: Sequence[Judgement], titles: Mapping[str, str]) -> Iterator[str]:
    """Yield ``settled at the end: 46 of 200 runs under EqT`` if some runs did not settle."""
    if any(row.verdict is ClaimVerdict.SEEN for row in rows):
        laws = dict.fromkeys(law for row in rows for law in row.settled)
        yield "settled at the end: " + listed(
            [f"{law.count} of {law.runs} runs under {titles[law.controller]}" for law in laws]
        )


def _in_every_run(
    rows: Sequence[Judgement], titles: Mapping[str, str], level: str
) -> Iterator[str]:
    """Yield each statement and the number of runs in which it held; equal counts are grouped."""
    for (statement, held, runs, low, open_), alike in groupby(
        rows,
        key=lambda row: (
            *(row.statement, row.held, row.runs, row.low),
            row.verdict is ClaimVerdict.UNDECIDED,
        ),
    ):
        more = f", and {100 * SHARE:g} % is needed" if open_ else ""
        laws = listed([titles[row.controller] for row in alike])
        yield (
            f"{statement}: {held} of {runs} runs under {laws}, so it holds for at least "
            f"{100 * low:.1f} % of all initial states ({level} confidence){more}"
        )


def _compared(rows: Sequence[Judgement], titles: Mapping[str, str]) -> Iterator[str]:
    """Yield the differences; of several, the number that agree and those that do not."""
    if len(rows) < 2:
        yield from (_difference(row.pair, titles) for row in rows if row.pair)
        return
    counts = Counter(row.verdict for row in rows)
    against, open_ = counts[ClaimVerdict.NOT_SUPPORTED], counts[ClaimVerdict.UNDECIDED]
    others = f", {open_} {'is' if open_ == 1 else 'are'} undecided" if open_ else ""
    agree = sum(counts[verdict] for verdict in _AGREES)
    yield f"{agree} of {len(rows)} comparisons agree with it{others}"
    wanted = (ClaimVerdict.NOT_SUPPORTED,) if against or open_ else _AGREES
    yield from (_difference(row.pair, titles) for row in rows if row.pair and row.verdict in wanted)


def _difference(pair: Pair, titles: Mapping[str, str]) -> str:
    """``EqT has 13.5 % less mean ‖τ‖ over 0–5 s than GT (−0.283 [−0.346, −0.219] N m)``."""
    first, second = titles[pair.first], titles[pair.second]
    what = _measure(pair.measured)
    number = _number(pair, pair.difference, pair.measured)
    if not pair.differs:
        return f"no difference seen between {first} and {second} in {what} ({number})"
    share = f"{percent(abs(pair.relative))} " if pair.relative == pair.relative else ""
    more = "more" if pair.difference > 0 else "less"
    return f"{first} has {share}{more} {what} than {second} ({number})"


def _ranking(comparison: Comparison, titles: Mapping[str, str]) -> Iterator[Finding]:
    by_laws = {
        (id(pair.measured), frozenset((pair.first, pair.second))): pair for pair in comparison.pairs
    }
    for _, rows in groupby(comparison.levels, key=lambda level: id(level.measured)):
        levels = [level for level in rows if level.mean == level.mean]
        if not levels or not levels[0].measured.quantity.name.startswith(RANKED):
            continue
        upwards = levels[0].measured.quantity.better == "higher"
        best, *others = sorted(levels, key=lambda level: level.mean, reverse=upwards)
        extreme = "largest" if upwards else "smallest"
        words = _level_in_words(best, extreme, titles, alone=not others)
        named = frozenset(level.controller for level in (best, *others[:1]))
        if pair := by_laws.get((id(best.measured), named)):
            ordered = pair if pair.first == best.controller else pair.swapped()
            seen = _difference(ordered, titles)
            words = f"{words}; {seen}" if ordered.differs or others[1:] else f"N{seen[1:]}"
        yield Finding("", "", f"{words}.")


def _level_in_words(level: Level, extreme: str, titles: Mapping[str, str], *, alone: bool) -> str:
    what, number = _measure(level.measured), _number(level, level.mean, level.measured)
    if alone:
        return f"{titles[level.controller]} has a {what} of {number}"
    return f"{titles[level.controller]} has the {extreme} {what}, {number}"


def _measure(measured: PerRun) -> str:
    of = "share of runs " if measured.quantity.counts else ""
    return f"{of}{_WRITE.name(measured.quantity)} over {_WRITE.window(measured.window)}"


def _number(row: Pair | Level, value: float, measured: PerRun) -> str:
    unit = _WRITE.unit(measured.unit)
    return " ".join(filter(None, [_WRITE.interval(value, row.low, row.high), unit]))


def listed(words: Sequence[str]) -> str:
    """Join words: ``a, b and c``."""
    return " and ".join(filter(None, [", ".join(words[:-1]), words[-1]]))
