"""CPU times of the calls of laws in code, beside a result: no number of it depends on them."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from eqt_cli.base.arrays import Array
from eqt_cli.base.files import read_record, write_record

if TYPE_CHECKING:
    from eqt_cli.results.result import Result

TIMING = "timing.json"
"""Name of the file in a result folder."""

STATISTICS = ("median", "99 %", "largest")
"""What it holds of the calls of a law, by its label, s."""

_LAWS = TypeAdapter(dict[str, dict[str, float]])


def write_timing(folder: Path, seconds: Mapping[str, Array]) -> None:
    """Write the statistics of the calls of each law, with the machine and its load."""
    laws = {
        label: dict(zip(STATISTICS, np.quantile(times, [0.5, 0.99, 1.0]).tolist(), strict=True))
        | {"calls": len(times)}
        for label, times in seconds.items()
    }
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    machine = {"machine": platform.machine(), "cpu_count": os.cpu_count(), "load": load}
    write_record(folder / TIMING, {**machine, "laws": laws})


def timing(folder: Path) -> dict[str, dict[str, float]]:
    """Return the statistics of each law in a folder; empty where there is no such file."""
    try:
        laws = _LAWS.validate_python((read_record(folder / TIMING, "laws") or {}).get("laws", {}))
    except (OSError, ValidationError):
        return {}
    return {label: row for label, row in laws.items() if {*STATISTICS} <= {*row}}


def timing_lines(result: Result) -> Iterator[str]:
    """Yield the times in ms, and which law would answer too late."""
    control: Any = result.config.get("control") or {}
    period, late = control.get("period"), list[str]()
    rows = {n: row for n, row in timing(result.path.parent).items() if n in result.title_of}
    for label, row in rows.items():
        slow, title = row[STATISTICS[1]], result.title_of[label]
        if isinstance(period, float) and slow > period:
            late.append(f"{title} cannot keep its period of {period:g} s")
        elif isinstance(period, float) and slow > LATE * period and not control.get("delay"):
            late.append(
                f"{title} flew as if it took none; `control: {{delay: 1}}` gives it a period"
            )
    listed = (
        f"{result.title_of[label]} " + ", ".join(f"{1e3 * row[name]:.3g}" for name in STATISTICS)
        for label, row in rows.items()
    )
    if rows:
        yield f"CPU, ms (this machine), median, 99 % and largest of a call: {'; '.join(listed)}"
    yield from late


LATE = 0.1
"""Share of the control period that a call may take unnoticed."""
