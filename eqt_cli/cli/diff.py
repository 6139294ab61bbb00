"""`eqt diff`: differences between two results."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eqt_cli.cli.shared import options
from eqt_cli.cli.shared.output import count_of, print_json, print_text, table

if TYPE_CHECKING:
    from eqt_cli.analysis.differences import Change, Dataset, Differences

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
    command may differ between equal results; they are shown, too.
    """
    from eqt_cli import api

    found = api.diff(first, second)
    if json:
        print_json(_document(first, second, found))
    else:
        _print(found)
    if not found.equal:
        raise typer.Exit(4)


def _print(found: Differences) -> None:
    for heading, changes in (
        ("configuration", found.configuration),
        ("attribute", found.attributes),
        ("provenance", found.provenance),
    ):
        if changes:
            rows = [[each.key, _shown(each.first), _shown(each.second)] for each in changes]
            print_text(table([heading, "first", "second"], rows), "")
    if found.datasets:
        header = ["dataset", "entries", "different", "largest difference", "relative", "at"]
        print_text(table(header, [_row(each) for each in found.datasets]), "")
    print_text(_verdict(found))


def _verdict(found: Differences) -> str:
    """Return the outcome in a sentence."""
    datasets = count_of(found.compared, "dataset")
    if found.equal:
        if found.provenance:
            return f"equal: provenance differs, the {datasets} do not"
        return f"equal: {datasets}, configuration and provenance"
    keys = [
        f"{count_of(len(changes), noun)} of the {whole}"
        for changes, noun, whole in (
            (found.configuration, "key", "configuration"),
            (found.attributes, "attribute", "files"),
        )
        if changes
    ]
    differing = f"{len(found.datasets) or 'none'} of {datasets}"
    only_nan = found.datasets and all(map(_differs_in_nan_only, found.datasets))
    return f"different: {', '.join([*keys, differing])}{' (only the bits of NaN)' * bool(only_nan)}"


def _differs_in_nan_only(each: Dataset) -> bool:
    return 0 < each.different == each.nan_bits


def _row(each: Dataset) -> list[str]:
    first, second = each.shapes
    if first is None or second is None:
        where = "second" if first is None else "first"
        return [each.name, f"only in the {where}", "-", "-", "-", "-"]
    if first != second:
        return [each.name, f"{_size(first)}, {_size(second)}", "-", "-", "-", "-"]
    entries = _size(first)
    if each.types[0] != each.types[1]:
        entries = f"{entries} {each.types[0]}, {each.types[1]}"
    largest, relative = ("-" if x is None else f"{x:.3g}" for x in (each.largest, each.relative))
    if _differs_in_nan_only(each):
        largest, relative = "bits of NaN", "-"
    at = "-" if each.place is None else f"[{', '.join(map(str, each.place))}]"
    return [each.name, entries, str(each.different), largest, relative, at]


def _size(shape: Sequence[int]) -> str:
    return "×".join(map(str, shape)) or "1"


def _shown(value: Any) -> str:
    """Return a value as shown in a table."""
    from eqt_cli.analysis.differences import Absent

    if value is Absent.ABSENT:
        return "-"
    text = str(value)
    if len(text) > LONGEST or "\n" in text:
        return f"a text of {len(text)} characters"
    return text


def _document(first: Path, second: Path, found: Differences) -> dict[str, Any]:
    return {
        "first": str(first),
        "second": str(second),
        "equal": found.equal,
        "configuration": [_change(each) for each in found.configuration],
        "attributes": [_change(each) for each in found.attributes],
        "provenance": [_change(each) for each in found.provenance],
        "compared": found.compared,
        "datasets": [
            {**vars(each), "only_nan_bits": _differs_in_nan_only(each)} for each in found.datasets
        ],
    }


def _change(each: Change) -> dict[str, Any]:
    """Return a change for programs, without a side that lacks the key."""
    from eqt_cli.analysis.differences import Absent

    return {name: value for name, value in vars(each).items() if value is not Absent.ABSENT}
