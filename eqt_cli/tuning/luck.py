"""How far a comparison of tuned laws depends on the random searches."""

from collections.abc import Mapping
from itertools import combinations
from typing import Any

from eqt_cli.analysis.comparison.notation import Plain, significant
from eqt_cli.analysis.text_tables import Block, TextTable
from eqt_cli.results.origin import law_title
from eqt_cli.results.result import Result, mean_over_runs

Record = Mapping[str, Any]

Range = tuple[float, float]


def measured(result: Result, name: str, write: Plain) -> str:
    """Return the name of a metric with its unit, for captions."""
    unit = write.unit(result.units(name))
    return f"{write.name(result.quantity(name))}{f' in {unit}' if unit else ''}"


def seed_labels(law: Record) -> list[str]:
    """Return the labels of the winners of a law's searches."""
    return [found["label"] for found in law["searches"] if found["label"] is not None]


def differences(result: Result, record: Record, metric: str) -> list[tuple[str, str, Range]]:
    """Return the range of the difference of means over all searches, for each pair of laws.

    Only laws with at least two successful searches are compared.
    """
    means = dict(zip(result.labels, mean_over_runs(result.counted(metric)).tolist(), strict=True))
    found = {law["label"]: [means[label] for label in seed_labels(law)] for law in record["laws"]}
    several = [label for label, values in found.items() if len(values) > 1]
    return [
        (one, two, (min(found[one]) - max(found[two]), max(found[one]) - min(found[two])))
        for one, two in combinations(several, 2)
    ]


def luck_table(result: Result, record: Record, write: Plain) -> TextTable:
    """Return the table of the differences between laws over all searches of both."""
    (name,) = record["objectives"]
    what = measured(result, name, write)
    rows = [
        [
            write.text(f"{law_title(one)} − {law_title(two)}"),
            *(write.number(significant(end, 3)) for end in ends),
            "yes" if ends[0] > 0 or ends[1] < 0 else "no",
        ]
        for one, two, ends in differences(result, record, name)
    ]
    return TextTable(
        "searches",
        f"Differences of {what} between any search for one law and any search for the other, means "
        "over held-out runs",
        ["laws", "smallest", "largest", "the same sign in all"],
        [Block("", rows)] if rows else [],
        [
            write.text(
                "Where the sign is not the same in all, the search decides which law is ahead."
            )
        ],
    )
