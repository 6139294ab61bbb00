"""Determines the progress of an unfinished result from the names of its parts."""

import os
import time
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from eqt_cli.core.files import read_record
from eqt_cli.execution.lock import holder
from eqt_cli.execution.part_files import MANIFEST, PARTS, FinishedPart, PartFiles
from eqt_cli.experiment.parts import Plans
from eqt_cli.store.reserved_names import FILE_NAME

RECENT = 200
"""Number of latest parts from which the rate is computed."""


@dataclass(frozen=True)
class Unfinished:
    """A result folder that holds parts, but no result yet.

    Attributes
    ----------
    name
        Name of the experiment.
    runs, done, failed
        Numbers of runs over all controllers and points: all, finished, failed.
    begun
        Start of the first session, ISO 8601.
    writer
        The process that computes now (`eqt_cli.execution.lock.holder`); None if there is none.
    rate
        Recent rate in runs per second; None before two parts are finished.
    """

    name: str
    runs: int
    done: int
    failed: int
    begun: str
    writer: dict[str, Any] | None
    rate: float | None

    @property
    def remaining(self) -> float | None:
        """Expected remaining time, s; None if unknown."""
        return (
            (self.runs - self.done) / self.rate if self.rate and self.writer is not None else None
        )


def unfinished(path: Path) -> Unfinished | None:
    """Return the progress of a folder without a result file; None for any other path."""
    if not path.is_dir() or (path / FILE_NAME).exists():
        return None
    manifest: dict[str, Any] = {}
    with suppress(OSError):  # an unreadable folder counts as no result
        manifest = read_record(path / MANIFEST, "plan", "name", "begun") or {}
    # A manifest of another program may hold anything.
    with suppress(ValueError, TypeError, LookupError, AttributeError, ArithmeticError):
        plan = Plans.of_data(manifest["plan"])
        listed = PartFiles(path / PARTS).listed()
        done = sum(plan.runs_of(number) for number in listed if number < len(plan))
        failed = sum(part.failed for part in listed.values())
        writer = holder(path)
        since = None if writer is None else writer.get("since")
        name, begun, rate = manifest["name"], manifest["begun"], _rate(plan, listed, since)
        return Unfinished(str(name), plan.total, done, failed, str(begun), writer, rate)
    return None


def _rate(plan: Plans, parts: dict[int, FinishedPart], since: str | None) -> float | None:
    """Return the runs per second of the latest parts (of the current session if there is one)."""
    start = datetime.fromisoformat(since).timestamp() if since else 0.0
    found = []
    for number, part in parts.items():
        with suppress(FileNotFoundError):
            finished = os.stat(part.path).st_mtime  # noqa: PTH116  # thousands, quickly
            if finished >= start:
                found.append((finished, number))
    found = sorted(found)[-RECENT:]
    if len(found) < 2:
        return None
    end = time.time() if since else found[-1][0]
    first = found[0][0]
    runs = sum(plan.runs_of(number) for _, number in found[1:])
    return runs / max(end - first, 1e-3)
