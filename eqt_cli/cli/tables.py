"""The table of metrics as text for other programs: one row per run, CSV or JSON lines."""

from __future__ import annotations

import csv
import json
import math
import sys
from collections.abc import Iterator
from typing import Any

from eqt_cli.core.errors import EqtError, suggestion
from eqt_cli.store.reader import Results

FORMATS = ("csv", "jsonl")


def print_table(results: Results, form: str) -> None:
    """Every run with its metrics, on stdout; numbers with all their digits."""
    if form not in FORMATS:
        hint = suggestion(form, FORMATS) or f"; known: {', '.join(FORMATS)}"
        raise EqtError(f"--format: unknown format '{form}'{hint}")
    header, rows = _table(results)
    if form == "csv":
        writer = csv.writer(sys.stdout, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)
        return
    for row in rows:
        plain = (None if isinstance(v, float) and not math.isfinite(v) else v for v in row)
        print(json.dumps(dict(zip(header, plain, strict=True)), ensure_ascii=False))


def _table(results: Results) -> tuple[list[str], Iterator[list[Any]]]:
    """The names of the columns, and the rows, read point by point."""
    sweeps = "point" in results.dimensions
    dims = ("point", "controller", "run") if sweeps else ("controller", "run")
    swept = [name for name in results.coordinates if results.dims(name) == ("point",)]
    swept = [name for name in swept if name != "point"]
    metrics = [name for name in results.names if results.dims(name) == dims]
    labels = results.coordinate("controller").tolist()
    values = {name: results.coordinate(name).tolist() for name in swept}

    def rows() -> Iterator[list[Any]]:
        columns = {name: results[name] for name in metrics}
        for point in range(results.dimensions["point"] if sweeps else 1):
            here = [point, *(values[name][point] for name in swept)] if sweeps else []
            found = [(c[point] if sweeps else c).tolist() for c in columns.values()]
            for controller, label in enumerate(labels):
                for run in range(results.dimensions["run"]):
                    yield [*here, label, run, *(column[controller][run] for column in found)]

    first = ["point", *swept] if sweeps else []
    return [*first, "controller", "run", *metrics], rows()
