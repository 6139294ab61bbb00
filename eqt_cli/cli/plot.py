"""`eqt plot`: draw a result."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def plot(
    result: Annotated[Path, typer.Argument(help="Result folder, or its results.h5.")],
) -> None:
    """Draw a result."""
