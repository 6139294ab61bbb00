"""How far a comparison of tuned laws depends on the luck of the searches."""

from collections.abc import Mapping
from itertools import combinations
from typing import Any

from eqt_cli.analysis.comparison.notation import Plain
from eqt_cli.analysis.text_tables import Block, TextTable
from eqt_cli.results.origin import law_title
from eqt_cli.results.result import Result, mean_over_runs

Record = Mapping[str, Any]

Range = tuple[float, float]


def measured(result: Result, name: str, write: Plain) -> str:
    """A metric with its unit, as captions write it."""
    unit = write.unit(result.units(name))
    return f"{write.name(result.quantity(name))}{f' in {unit}' if unit else ''}"


def seed_labels(law: Record) -> list[str]:
    """Under which labels a law of the record has its winners, one for each search that has one."""
    return [found["label"] for found in law["searches"] if found["label"] is not None]


def differences(result: Result, record: Record, metric: str) -> list[tuple[str, str, Range]]:
    """Every two laws, and between what their means differ, any search of one with any of the other.

    Of laws with two searches or more that found something.
    """
    means = dict(zip(result.labels, mean_over_runs(result.counted(metric)).tolist(), strict=True))
    found = {law["label"]: [means[label] for label in seed_labels(law)] for law in record["laws"]}
    several = [label for label, values in found.items() if len(values) > 1]
    return [
        (one, two, (min(found[one]) - max(found[two]), max(found[one]) - min(found[two])))
        for one, two in combinations(several, 2)
    ]


def luck_table(result: Result, record: Record, write: Plain) -> TextTable:
    """The differences between laws over all searches of both."""
    (name,) = record["objectives"]
    what = measured(result, name, write)
    rows = [
        [
            write.text(f"{law_title(one)} − {law_title(two)}"),
            *(write.number(f"{end:.3g}") for end in ends),
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
