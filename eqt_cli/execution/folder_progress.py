"""How far an unfinished result has come, told from a listing of its folder; it opens no part."""

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
"""The rate is that of the latest so many parts."""


@dataclass(frozen=True)
class Unfinished:
    """A result folder that holds parts, but no result yet.

    Attributes
    ----------
    name
        Of the experiment.
    runs, done, failed
        Runs over all controllers and points; those finished; those among them that failed.
    begun
        When the first session began, ISO 8601.
    writer
        Who computes now, as `eqt_cli.execution.lock.holder` says; None if nobody does.
    rate
        Runs per second lately; None before two parts are finished.
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
        """Expected time to the end, s; None where it is not known."""
        return (
            (self.runs - self.done) / self.rate if self.rate and self.writer is not None else None
        )


def unfinished(path: Path) -> Unfinished | None:
    """How far a folder has come that holds no result yet; None for any other path."""
    if not path.is_dir() or (path / FILE_NAME).exists():
        return None
    manifest: dict[str, Any] = {}
    with suppress(OSError):  # what cannot be read is no result that was begun
        manifest = read_record(path / MANIFEST, "plan", "name", "begun") or {}
    # Whoever wrote it may have meant anything by it.
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
    """Runs per second over the latest parts, of this session if one is under way."""
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
