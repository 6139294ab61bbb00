"""Paths as calls take them, and the message for what is none."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from eqt_cli.core.errors import EqtError

ResultPath = str | os.PathLike[str]
"""A result folder, or the file in it; a `StoredResult` is one."""


def path_from(name: str, given: Any, expected: str = "a path") -> Path:
    """What was given for a parameter, as a path."""
    try:
        return Path(given)
    except TypeError:
        raise EqtError(f"{name}: expected {expected}, got {given!r}") from None
