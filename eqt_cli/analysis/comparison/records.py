"""Converts a comparison to plain data with full precision, for JSON and CSV."""

from typing import Any

from eqt_cli.analysis.comparison.compare import Comparison
from eqt_cli.analysis.comparison.pairs import Level, Pair
from eqt_cli.analysis.comparison.verdicts import Judgement
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
