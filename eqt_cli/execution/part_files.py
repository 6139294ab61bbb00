"""The files of finished parts. Does not know their content, and imports no heavy library.

Part 12 is ``000012.h5``, or ``000012.f3.h5`` if three of its runs failed. So the names of the files
show the progress of an experiment without opening any file.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from eqt_cli.core.own_files import OwnFile, remove_own

if TYPE_CHECKING:
    from eqt_cli.store.table import Table

MANIFEST, PARTS = "manifest.json", "parts"
"""Names in a result folder: the record of the experiment, and the folder of finished parts."""

_NAME = re.compile(r"(\d{6,})(?:\.f(\d+))?\.h5")

_PART = OwnFile(_NAME.pattern)
OWN_PARTS = (_PART, OwnFile(r"reference(-\d+)?\.h5"))
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
        return self.folder / (f"reference-{piece}.h5" if piece else "reference.h5")

    def listed(self) -> dict[int, FinishedPart]:
        """Return the finished parts, by number."""
        found: dict[int, FinishedPart] = {}
        try:
            names = sorted(os.listdir(self.folder))  # noqa: PTH208  # thousands, quickly
        except FileNotFoundError:
            return found
        for name in names:
            if match := _NAME.fullmatch(name):
                number, failed = int(match[1]), int(match[2] or 0)
                # During a rerun a part can have two files; the one with fewer failures counts.
                if number not in found or failed < found[number].failed:
                    found[number] = FinishedPart(self.folder / name, failed)
        return found

    def save(self, number: int, table: Table, failed: int) -> None:
        """Write a finished part atomically."""
        name = f"{number:06d}.f{failed}.h5" if failed else f"{number:06d}.h5"
        self.write(self.folder / name, table)

    def write(self, path: Path, table: Table) -> None:
        """Write a file of this folder atomically."""
        from eqt_cli.store.writer import write

        write(path, table)

    def tidy(self) -> None:
        """Remove parts of which another file has fewer failed runs."""
        best = {part.path.name for part in self.listed().values()}
        for path in self.folder.iterdir() if self.folder.exists() else ():
            if _NAME.fullmatch(path.name) and path.name not in best:
                remove_own(path, _PART)
