"""Whether a record of a search is one: the file may come from anybody, or from another program."""

from contextlib import suppress
from typing import Any

from eqt_cli.results.metrics import METRICS
from eqt_cli.results.result import Result

_BOUND = {"metric", "bound", "above", "every_run"}
_METRICS = {metric.name for metric in METRICS}


def fits(record: dict[str, Any], result: Result) -> bool:
    """Whether it says what `tune` writes, of laws and metrics that the result has."""
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
