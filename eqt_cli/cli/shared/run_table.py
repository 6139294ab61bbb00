"""The metrics of every run as text for other programs: CSV or JSON lines."""

import csv
import sys
from collections.abc import Iterator
from typing import Any

from eqt_cli.cli.shared.output import json_text, print_verbatim
from eqt_cli.cli.shared.table_formats import csv_cell
from eqt_cli.core.errors import EqtError, suggestion
from eqt_cli.core.printable import printable
from eqt_cli.results.result import Result

FORMATS = ("csv", "jsonl")


def print_run_table(result: Result, form: str) -> None:
    """Print the metrics of every run on stdout, with all digits."""
    if form not in FORMATS:
        hint = suggestion(form, FORMATS) or f"; known: {', '.join(FORMATS)}"
        raise EqtError(f"--format: unknown format '{form}'{hint}")
    swept = [
        name for name in result.coordinates if name != "point" and result.dims(name) == ("point",)
    ]
    numbers = [name for name in result.names if result.dims(name) == result.dims("status")]
    first = ["point", *swept] if result.is_sweep else []
    header, rows = [*first, "controller", "run", *numbers], _rows(result, swept, numbers)
    if form == "csv":
        writer = csv.writer(sys.stdout, lineterminator="\n")
        writer.writerow(map(csv_cell, header))
        writer.writerows(map(csv_cell, row) for row in rows)
        return
    for row in rows:
        print_verbatim(json_text(dict(zip(header, row, strict=True))))


def _rows(result: Result, swept: list[str], numbers: list[str]) -> Iterator[list[Any]]:
    """Yield a row per run, by point and controller."""
    values = [result.coordinate(name).tolist() for name in swept]
    shape = (result.points, len(result.labels), result.runs)
    columns = [result[name].reshape(shape) for name in numbers]
    for point in range(result.points):
        here = [point, *(_shown(value[point]) for value in values)] if result.is_sweep else []
        for controller, label in enumerate(result.labels):
            found = [column[point, controller].tolist() for column in columns]
            for run, row in enumerate(zip(*found, strict=True)):
                yield [*here, label, run, *map(_shown, row)]


def _shown(value: Any) -> Any:
    return printable(value) if isinstance(value, str) else value
