"""The finished parts of an experiment as files; what is in them is not its concern."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from uuid import uuid4

from eqt_cli.run.listing import PART_NAME, Entry, finished_parts, part_name
from eqt_cli.store.variables import Table
from eqt_cli.store.writer import write

_PROCESS = uuid4().hex[:8]
"""Keeps the unfinished files of processes on several machines apart."""


@dataclass(frozen=True)
class PartFiles:
    """The folder of the parts."""

    folder: Path

    def reference(self, piece: int = 0) -> Path:
        """The file of the reference that all runs of a piece share."""
        return self.folder / (f"reference-{piece}.h5" if piece else "reference.h5")

    def listed(self) -> dict[int, Entry]:
        """The finished parts, by number."""
        return finished_parts(self.folder)

    def save(self, number: int, table: Table, failed: int) -> None:
        """Write a finished part, which appears complete or not at all."""
        write(self.folder / part_name(number, failed), table, tag=f"{_PROCESS}-{os.getpid()}")

    def save_reference(self, piece: int, table: Table) -> None:
        """Write the reference that all runs of a piece share."""
        write(self.reference(piece), table, tag=f"{_PROCESS}-{os.getpid()}")

    def tidy(self) -> None:
        """Remove what killed processes left unfinished, and parts that better ones replace."""
        best = {entry.path.name for entry in self.listed().values()}
        for path in self.folder.iterdir():
            if path.suffix == ".tmp" or (PART_NAME.fullmatch(path.name) and path.name not in best):
                path.unlink(missing_ok=True)
