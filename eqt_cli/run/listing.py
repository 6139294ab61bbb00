"""What a listing of a result folder tells, without opening a file; nothing heavy is imported.

Part 12 is ``000012.h5``, or ``000012.f3.h5`` if three of its runs failed.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path

from eqt_cli.store.layout import FILE_NAME

RESULTS, MANIFEST, PARTS = FILE_NAME, "manifest.json", "parts"

PART_NAME = re.compile(r"(\d{6,})(?:\.f(\d+))?\.h5")


@dataclass(frozen=True)
class Entry:
    """A finished part: its file, and how many of its runs failed."""

    path: Path
    failed: int


def finished_parts(folder: Path) -> dict[int, Entry]:
    """The finished parts in a folder of parts, by number."""
    found: dict[int, Entry] = {}
    try:
        names = sorted(os.listdir(folder))  # noqa: PTH208  # thousands, quickly
    except FileNotFoundError:
        return found
    for name in names:
        if match := PART_NAME.fullmatch(name):
            number, failed = int(match[1]), int(match[2] or 0)
            # After a second try there are two for a moment: the one with fewer failures counts.
            if number not in found or failed < found[number].failed:
                found[number] = Entry(folder / name, failed)
    return found


def part_name(number: int, failed: int) -> str:
    """The name of a finished part's file."""
    return f"{number:06d}.f{failed}.h5" if failed else f"{number:06d}.h5"
