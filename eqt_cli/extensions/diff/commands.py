"""`eqt diff`: what differs between two results."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eqt_cli.cli import options, output

if TYPE_CHECKING:
    from eqt_cli.extensions.diff.diff import Dataset, Differences

LONGEST = 120
"""Maximum number of characters of a value in a table."""


def diff(
    first: Annotated[
        Path, typer.Argument(metavar="FIRST", help="Result folder, or the results.h5 in it.")
    ],
    second: Annotated[
        Path, typer.Argument(metavar="SECOND", help="The result to compare it with.")
    ],
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Show what differs between two results; exit 4 if they are not equal.

    This compares the configurations, and all numbers bit by bit. Versions, machine, time and
    command may differ between equal results; they are also shown.
    """
    from eqt_cli import api

    diffs = api.diff(first, second)
    if json:
        files = {"first": str(first), "second": str(second), "equal": diffs.equal}
        output.print_json(files | asdict(diffs))
    else:
        _print_differences(diffs)
    if not diffs.equal:
        raise typer.Exit(4)


def _print_differences(diffs: Differences) -> None:
    changed = (diffs.configuration, diffs.attributes, diffs.provenance)
    for heading, changes in zip(("configuration", "attribute", "provenance"), changed, strict=True):
        if changes:
            rows = [
                [
                    change["key"],
                    *(_value_shown(change.get(side, "-")) for side in ("first", "second")),
                ]
                for change in changes
            ]
            output.print_text(output.table([heading, "first", "second"], rows), "")
    if diffs.datasets:
        header = ["dataset", "entries", "different", "largest difference"]
        output.print_text(
            output.table(header, [_dataset_row(dataset) for dataset in diffs.datasets]), ""
        )
    output.print_text(_outcome(diffs))


def _outcome(diffs: Differences) -> str:
    """Return the outcome in a sentence."""
    datasets = output.count_of(diffs.compared, "dataset")
    if diffs.equal:
        if diffs.provenance:
            return f"equal: provenance differs, the {datasets} do not"
        return f"equal: {datasets}, configuration and provenance"
    keys = []
    if diffs.configuration:
        keys.append(f"{output.count_of(len(diffs.configuration), 'key')} of the configuration")
    if diffs.attributes:
        keys.append(f"{output.count_of(len(diffs.attributes), 'attribute')} of the files")
    differing = f"{len(diffs.datasets) or 'none'} of {datasets}"
    return f"different: {', '.join([*keys, differing])}"


def _dataset_row(dataset: Dataset) -> list[str]:
    first, second = dataset.shapes
    if first is None or second is None:
        where = "second" if first is None else "first"
        return [dataset.name, f"only in the {where}", "-", "-"]
    if first != second:
        return [dataset.name, f"{_size(first)}, {_size(second)}", "-", "-"]
    largest = "-" if dataset.largest is None else f"{dataset.largest:.3g}"
    return [dataset.name, _size(first), str(dataset.different), largest]


def _size(shape: Sequence[int]) -> str:
    return "×".join(map(str, shape)) or "1"


def _value_shown(value: Any) -> str:
    """Return a value as shown in a table."""
    text = str(value)
    if len(text) > LONGEST or "\n" in text:
        return f"a text of {len(text)} characters"
    return text
