"""CPU times of the calls of laws in code, beside a result: no number of it depends on them."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from eqt_cli.base.arrays import Array
from eqt_cli.base.files import read_record, write_record
from eqt_cli.base.option_types import seconds

if TYPE_CHECKING:
    from eqt_cli.results.result import Result

TIMING = "timing.json"
"""Name of the file in a result folder."""

STATISTICS = ("median", "99 %", "largest")
"""What it holds of the calls of a law, by its label, s."""

_LAWS = TypeAdapter(dict[str, dict[str, float]])


def write_timing(folder: Path, times: Mapping[str, Array]) -> None:
    """Write the statistics of the calls of each law, with the machine and its load."""
    laws = {label: statistics(row) for label, row in times.items()}
    write_record(folder / TIMING, machine() | {"laws": laws})


def statistics(times: Sequence[float] | Array) -> dict[str, Any]:
    """Return what is kept of the times of a law, and their number."""
    values = np.quantile(times, [0.5, 0.99, 1.0]).tolist()
    return dict(zip(STATISTICS, values, strict=True)) | {"calls": len(times)}


def machine() -> dict[str, Any]:
    """Return what times depend on: the machine, and its load."""
    load = round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None
    return {"machine": platform.machine(), "cpu_count": os.cpu_count(), "load": load}


def timing(folder: Path) -> dict[str, dict[str, float]]:
    """Return the statistics of each law in a folder; empty where there is no such file."""
    try:
        laws = _LAWS.validate_python((read_record(folder / TIMING, "laws") or {}).get("laws", {}))
    except (OSError, ValidationError):
        return {}
    return {label: row for label, row in laws.items() if {*STATISTICS} <= {*row}}


def late_lines(result: Result, rows: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    """Yield which law would answer too late, by the statistics of their calls."""
    control: Any = result.config.get("control") or {}
    period, delay = control.get("period"), control.get("delay", 0)
    if not isinstance(period, float):
        return
    for label, row in rows.items():
        slow, title = row[STATISTICS[1]], result.title_of[label]
        flown = seconds(delay) if isinstance(delay, str) else delay * period
        if slow > period:
            yield f"{title} cannot keep its period of {period:g} s"
        elif slow > max(flown, LATE * period):
            took = f"only {flown:g} s" if flown else "none"
            yield f"{title} flew as if it took {took}; `control: {{delay: 1}}` gives it a period"


def timing_lines(result: Result) -> Iterator[str]:
    """Yield the times in ms, and which law would answer too late."""
    rows = {n: row for n, row in timing(result.path.parent).items() if n in result.title_of}
    listed = (
        f"{result.title_of[label]} " + ", ".join(f"{1e3 * row[name]:.3g}" for name in STATISTICS)
        for label, row in rows.items()
    )
    if rows:
        yield f"CPU, ms (this machine), median, 99 % and largest of a call: {'; '.join(listed)}"
    yield from late_lines(result, rows)


LATE = 0.1
"""Share of the control period that a call may take unnoticed."""
