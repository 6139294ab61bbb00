"""Paths as arguments of API functions."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from eqt_cli.core.errors import EqtError

ResultPath = str | os.PathLike[str]
"""A result folder, or the file in it. A `StoredResult` is a path, too."""


def path_from(name: str, given: Any, expected: str = "a path") -> Path:
    """Convert an argument to a path."""
    try:
        return Path(given)
    except TypeError:
        raise EqtError(f"{name}: expected {expected}, got {given!r}") from None
