"""Ways to integrate the runs of a case: one file each, found by scanning this folder."""

from __future__ import annotations

import importlib
import pkgutil

from benchmarks.contenders.base import Contender


def contenders() -> list[Contender]:
    """Every contender of every file, in the order of the files' names."""
    found: list[Contender] = []
    for info in pkgutil.iter_modules(__path__, f"{__name__}."):
        found += getattr(importlib.import_module(info.name), "CONTENDERS", [])
    return found
