"""Validates records of searches, because such a file may come from anyone."""

from contextlib import suppress
from typing import Any

from eqt_cli.results.metrics import METRICS
from eqt_cli.results.result import Result
from eqt_cli.tuning.law_search import coordinate_of

_BOUND = {"metric", "bound", "above", "every_run"}
_METRICS = {metric.name for metric in METRICS}


def fits_tuning(record: dict[str, Any], result: Result) -> bool:
    """Whether a record has the form that `tune` writes, with laws and metrics of the result."""
    with suppress(TypeError, KeyError, AttributeError, ValueError):
        searches = [found for law in record["laws"] for found in law["searches"]]
        winners = [winner for law in record["laws"] for winner in law["winners"]]
        labels = [*(law["start"] for law in record["laws"]), *(w["label"] for w in winners)]
        wanted = list(record["objectives"])
        metrics = [*wanted, *(bound["metric"] for bound in record["constraints"])]
        numbers = [
            *(value for winner in winners for value in winner["values"].values()),
            *(bound["bound"] for bound in record["constraints"]),
            *(record[name] for name in ("generations", "population", "runs")),
            *(number for found in searches for row in found["objectives"] for number in row),
        ]
        order = [
            (result.labels.index(winner["label"]), result.labels.index(law["start"]))
            for law in record["laws"]
            for winner in law["winners"]
        ]
        flags = [bound[name] for bound in record["constraints"] for name in ("above", "every_run")]
        return (
            0 < len(wanted) <= 2
            and len(record["cases"]) == (result.points if result.is_sweep else 0)
            and all(isinstance(case, str) for case in record["cases"])
            and record["over_cases"] in ("mean", "worst")
            and bool(labels)
            and len(set(wanted)) == len(wanted)
            and all(name in _METRICS and result.has(name) for name in metrics)
            and len(set(labels)) == len(labels)
            and {*labels, *(found["label"] for found in searches)} - {None} <= set(result.labels)
            and all(len(row) == len(wanted) for found in searches for row in found["objectives"])
            and all(law["searches"] for law in record["laws"])
            and all(isinstance(law["label"], str) for law in record["laws"])
            and all(isinstance(number, int | float) for number in numbers)
            and all(isinstance(flag, bool) for flag in flags)
            and all(set(bound) == _BOUND for bound in record["constraints"])
            and all(winner < start for winner, start in order)
        )
    return False


def fits_worst(record: dict[str, Any], result: Result) -> bool:
    """Whether a record has the form that `worst` writes, with laws and a metric of the result."""
    with suppress(TypeError, KeyError, AttributeError, ValueError):
        laws = record["laws"]
        labels = [law["label"] for law in laws]
        lines = [line for law in laws for line in law["lines"]]
        ends = [end for line in lines for end in line["points"]]
        found = [one for law in laws for one in (law, *law["searches"])]
        numbers = [
            *(value for law in laws for value in law["values"].values()),
            *(one["value"] for one in found if not one["failed"]),
            *(law["first"][name] for law in laws for name in ("runs", "unsettled")),
            *(record[name] for name in ("generations", "population", "runs")),
        ]
        counts = [law[name] for law in laws for name in ("run", "unsettled", "runs", "agreeing")]
        names = {coordinate_of(key) for law in laws for key in law["values"]}
        return (
            bool(labels)
            and result.is_sweep
            and len(set(labels)) == len(labels)
            and set(labels) <= set(result.labels)
            and record["objective"] in _METRICS
            and result.has(record["objective"])
            and names <= set(result.coordinates)
            and all(line["key"] in law["values"] for law in laws for line in law["lines"])
            and all(law["lines"] and law["searches"] for law in laws)
            and all(set(law["log"]) <= set(law["values"]) for law in laws)
            and all(len(line["points"]) == 2 for line in lines)
            and all(isinstance(number, int) for number in (*ends, *counts, *record["seeds"]))
            and all(0 <= line["points"][0] < line["points"][1] <= result.points for line in lines)
            and all(isinstance(number, int | float) for number in numbers)
            and all(isinstance(one["failed"], bool) for one in found)
            and all(isinstance(law["config"], str) for law in laws)
        )
    return False
