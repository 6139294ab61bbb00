"""The files of finished parts, and the progress of an unfinished result.

Does not know the content of parts, and imports no heavy library.
"""

import os
import re
import time
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from eqt_cli.base import files
from eqt_cli.config.parts import Plans
from eqt_cli.runs.lock import holder

MANIFEST, PARTS = "manifest.json", "parts"
"""Names in a result folder: the record of the experiment, and the folder of finished parts."""

_NAME = re.compile(r"(\d{6,})(?:\.([fr])(\d+))?\.npy")

_PART = files.FilePattern(_NAME.pattern)
PART_ENTRIES = (_PART, files.FilePattern(r"reference(-\d+)?\.npy"))
"""Entries that eqt writes in the folder of the parts."""


@dataclass(frozen=True)
class FinishedPart:
    """The file of a finished part, and the number of its failed runs."""

    path: Path
    failed: int


@dataclass(frozen=True)
class PartFiles:
    """The folder of the parts."""

    folder: Path

    def reference(self, piece: int) -> Path:
        """Return the file of the reference that all runs of a piece share."""
        return self.folder / (f"reference-{piece}.npy" if piece else "reference.npy")

    def listed(self) -> dict[int, FinishedPart]:
        """Return the finished parts, by number."""
        parts: dict[int, FinishedPart] = {}
        for number, kind, failed, path in self._files():
            # During a rerun a part can have two files; the one with fewer failures counts.
            if kind == "f" and (number not in parts or failed < parts[number].failed):
                parts[number] = FinishedPart(path, failed)
        return parts

    def stopped(self) -> dict[int, tuple[Path, int]]:
        """Return the files of parts that were stopped, each with the number of finished runs."""
        finished = self.listed()
        return {
            number: (path, runs)
            for number, kind, runs, path in self._files()
            if kind == "r" and number not in finished
        }

    def part(self, number: int, count: int, kind: str = "f") -> Path:
        """Return the file of a finished part with so many failed runs; `r`: finished ones."""
        return self.folder / (f"{number:06d}.{kind}{count}.npy" if count else f"{number:06d}.npy")

    def tidy(self) -> None:
        """Remove parts of which another file has fewer failed runs, or more runs."""
        best = {path for path, _ in self.stopped().values()}
        best |= {part.path for part in self.listed().values()}
        for *_, path in self._files():
            if path not in best:
                files.remove_written(path, _PART)

    def done(self, plans: Plans) -> int:
        """Return the number of finished runs."""
        whole = sum(plans.runs_of(number) for number in self.listed() if number < len(plans))
        return whole + sum(runs for _, runs in self.stopped().values())

    def _files(self) -> list[tuple[int, str, int, Path]]:
        """Return number, kind, count and path of the files of parts; those with most runs last."""
        try:
            names = os.listdir(self.folder)  # noqa: PTH208  # thousands, quickly
        except FileNotFoundError:
            return []
        matches = filter(None, map(_NAME.fullmatch, names))
        return sorted((int(m[1]), m[2] or "f", int(m[3] or 0), self.folder / m[0]) for m in matches)


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
        The process that computes now (`holder`); None if there is none.
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
    if not path.is_dir() or (path / files.FILE_NAME).exists():
        return None
    manifest: dict[str, Any] = {}
    with suppress(OSError):  # an unreadable folder counts as no result
        manifest = files.read_record(path / MANIFEST, "plan", "name", "begun") or {}
    # A manifest of another program may hold anything.
    with suppress(ValueError, TypeError, LookupError, AttributeError, ArithmeticError):
        plan = Plans.of_data(manifest["plan"])
        listed, done = PartFiles(path / PARTS).listed(), PartFiles(path / PARTS).done(plan)
        failed = sum(part.failed for part in listed.values())
        writer = holder(path)
        since = None if writer is None else writer.get("since")
        name, begun, rate = manifest["name"], manifest["begun"], _rate(plan, listed, since)
        return Unfinished(str(name), plan.total, done, failed, str(begun), writer, rate)
    return None


def _rate(plan: Plans, parts: dict[int, FinishedPart], since: str | None) -> float | None:
    """Return the runs per second of the latest parts (of the current session if there is one)."""
    start = datetime.fromisoformat(since).timestamp() if since else 0.0
    times = []
    for number, part in parts.items():
        with suppress(FileNotFoundError):
            finished = os.stat(part.path).st_mtime  # noqa: PTH116  # thousands, quickly
            if finished >= start:
                times.append((finished, number))
    times = sorted(times)[-RECENT:]
    if len(times) < 2:
        return None
    end = time.time() if since else times[-1][0]
    first = times[0][0]
    return sum(plan.runs_of(number) for _, number in times[1:]) / max(end - first, 1e-3)
