"""The record of a search beside the result that judges it, its keys, and the costs of runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.base import files
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import OTHER_FOLDER, EqtError
from eqt_cli.extensions.search.run_numbers import Numbers
from eqt_cli.results.result import Result

# Keys that a search varies ------------------------------------------------------------------------


def coordinate_of(key: str) -> str:
    """Return the sweep coordinate that holds the values of a key."""
    return key.partition(":")[0].replace("[", ".").replace("]", "")


AS_IT_IS = "as it is"
"""The only point of a law that has no key of the search."""


def values_text(values: Mapping[str, float]) -> str:
    """Format values with short unambiguous keys: ``kp 2.1, kd[0] 0.5``."""
    short = {key: key.rpartition(".")[2] for key in values}
    if len(set(short.values())) < len(short):
        short = {key: key for key in values}
    return ", ".join(f"{short[key]} {value:.4g}" for key, value in values.items())


# The record, which is validated because it may come from anyone -----------------------------------


_BOUND = {"metric", "bound", "above", "every_run", "equal"}


_FLAGS = ("above", "every_run", "equal")

_SIZES = {
    True: ("budget", "samples", "runs"),  # of one objective
    False: ("generations", "population", "runs"),
}


def fits_tuning(record: dict[str, Any], result: Result) -> bool:
    """Whether a record has the form that `tune` writes, with laws and metrics of the result."""
    with suppress(TypeError, KeyError, AttributeError, ValueError):
        laws, place = record["laws"], result.labels.index
        searches = [search for law in laws for search in law["searches"]]
        winners = [winner for law in laws for winner in law["winners"]]
        searched = [law for law in laws if law["over"]]  # others stay as they are
        labels = [*(law["start"] for law in searched), *(w["label"] for w in winners)]
        wanted = list(record["objectives"])
        metrics = [*wanted, *(bound["metric"] for bound in record["constraints"])]
        numbers = [
            *(value for winner in winners for value in winner["values"].values()),
            *(end for law in laws for low, high in law["over"].values() for end in (low, high)),
            *(bound["bound"] for bound in record["constraints"]),
            *(record[name] for name in _SIZES["budget" in record]),
            *(number for search in searches for row in search["objectives"] for number in row),
            record["allowed"],
        ]
        if "budget" in record:  # tuned on samples
            gains = [search for search in searches if search["label"] is not None]
            numbers += [number for search in gains for number in search["measured"]]
            numbers += [number for search in gains for number in search["values"].values()]
            numbers += [search[name] for search in gains for name in ("failed", "unsettled")]
            numbers += [search[name] for search in searches for name in ("sample", "points")]
            if any(len(one["measured"]) != len(record["constraints"]) for one in gains):
                return False
        proved = record.get("proved") or {"column": "", "answer": []}
        said = [proved["column"], *proved["answer"], *(w.get("proved", "") for w in winners)]
        flags = [bound[name] for bound in record["constraints"] for name in _FLAGS]

        return (
            0 < len(wanted) <= 2
            and len(record["cases"]) == (result.points if result.is_sweep else result.out_of)
            and all(isinstance(case, str) for case in record["cases"])
            and record["over_cases"] in ("mean", "worst")
            and bool(labels)
            and len(set(wanted)) == len(wanted)
            and set(metrics) <= set(result.metrics)
            and len(set(labels)) == len(labels)
            and {*labels, *(search["label"] for search in searches)} - {None} <= set(result.labels)
            and all(len(row) == len(wanted) for search in searches for row in search["objectives"])
            and all(law["searches"] for law in laws)
            and all(set(w["values"]) == set(law["over"]) for law in laws for w in law["winners"])
            and all(isinstance(law["label"], str) for law in laws)
            and all(isinstance(number, int | float) for number in numbers)
            and all(isinstance(flag, bool) for flag in flags)
            and all(isinstance(words, str) for words in said)
            and all(set(bound) == _BOUND for bound in record["constraints"])
            and all(place(w["label"]) < place(x["start"]) for x in searched for w in x["winners"])
            and all(law["start"] in result.labels for law in laws)
        )
    return False


def fits_worst(record: dict[str, Any], result: Result) -> bool:
    """Whether a record has the form that `worst` writes, with laws and a metric of the result."""
    with suppress(TypeError, KeyError, AttributeError, ValueError):
        laws = record["laws"]
        labels = [law["label"] for law in laws]
        lines = [line for law in laws for line in law["lines"]]
        ends = [end for line in lines for end in line["points"]]
        searched = [one for law in laws for one in (law, *law["searches"])]
        numbers = [
            *(value for law in laws for value in law["values"].values()),
            *(one["value"] for one in searched if not one["failed"]),
            *(law["first"][name] for law in laws for name in ("runs", "unsettled")),
            *(record[name] for name in ("generations", "population", "runs")),
        ]
        counts = [law[x] for law in laws for x in "run unsettled runs agreeing in_profile".split()]
        names = {coordinate_of(key) for law in laws for key in law["values"]}
        return (
            bool(labels)
            and result.is_sweep
            and len(set(labels)) == len(labels)
            and set(labels) <= set(result.labels)
            and record["objective"] in result.metrics
            and names <= set(result.coordinates)
            and all(line["key"] in law["values"] for law in laws for line in law["lines"])
            and all(law["lines"] and law["searches"] for law in laws)
            and all(set(law["log"]) <= set(law["values"]) for law in laws)
            and all(len(line["points"]) == 2 for line in lines)
            and all(isinstance(number, int) for number in (*ends, *counts, *record["seeds"]))
            and all(0 <= line["points"][0] < line["points"][1] <= result.points for line in lines)
            and all(isinstance(number, int | float) for number in numbers)
            and all(isinstance(one["failed"], bool) for one in searched)
            and all(isinstance(law["config"], str) for law in laws)
        )
    return False


@dataclass(frozen=True)
class Kind:
    """A kind of search: for gains, or for the worst run.

    Attributes
    ----------
    command
        Command that starts the search: ``tune``.
    title
        Name of the search in messages.
    record, configs
        Names of the file of the outcome, and of the folder of the configurations that were found.
    fits
        Whether a record is complete and belongs to a result.
    runs
        Whether each configuration that was found has its own result folder; else a law may have
        several configurations.
    """

    command: str
    title: str
    record: str
    configs: str
    fits: Callable[[dict[str, Any], Result], bool]
    runs: bool = False

    def record_in(self, folder: Path) -> dict[str, Any] | None:
        """Return the record in a folder; None if it has none."""
        with files.refusals(folder, "used", OTHER_FOLDER):
            return files.read_record(folder / self.record, "digest")

    def beside(self, result: Result) -> dict[str, Any] | None:
        """Return the record of the search that a result judges; None if there is no such search."""
        record = self.record_in(result.path.parent)
        # The record of an unfinished search has no outcome yet, and does not fit.
        return record if record is not None and self.fits(record, result) else None


TUNE = Kind("tune", "tuning", "tuning.json", "tuned", fits_tuning)
WORST = Kind("worst", "search for the worst run", "worst.json", "worst", fits_worst, runs=True)

AGREEING = 0.01
"""Searches agree if their worst values are within this share of the worst value of all."""


def agree(value: float, worst: float) -> bool:
    """Whether the worst value of a search is that of all; both may be infinite."""
    return value == worst or (np.isfinite(worst) and abs(worst - value) <= AGREEING * abs(worst))


def costs_of_runs(result: Result | Numbers, metric: str) -> Array:
    """Return the cost of each run by a metric, in the shape of `Result.metric`.

    The worst run has the largest cost: ∞ for a failed run, −∞ for a run without a value.

    Raises
    ------
    EqtError
        If a metric of the user's own has no value in a good run, so that the worst is not known.
    """
    lost = int(np.isnan(result.counted(metric)[result.good]).sum())
    if lost and result.quantity(metric).is_own:
        raise EqtError(
            f"{metric} is NaN in {lost} runs, so that the worst run is not known; let the metric "
            "return a number there, or set `censored` where NaN means: later than the end"
        )
    costs = result.quantity(metric).cost(result.counted(metric))
    return np.where(result.good, np.where(np.isnan(costs), -np.inf, costs), np.inf)
