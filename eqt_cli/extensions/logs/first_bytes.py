"""Tells the format of a file by its first bytes, which `tables.yaml` lists, or by its suffix."""

import re
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from eqt_cli.base import yaml_source
from eqt_cli.base.files import open_regular
from eqt_cli.extensions.logs import FORMATS_BY_SUFFIX


@cache
def beginnings() -> dict[str, Any]:
    """Return how logs, tables and foreign files begin, as patterns."""
    path = Path(__file__).with_name("tables.yaml")
    return dict(yaml_source.load(path.read_text(encoding="utf-8"), path.name).data)


def begins(path: Path, pattern: str) -> bool:
    """Whether a file can be read and begins so; a character stands for a byte."""
    with suppress(OSError, ValueError), open_regular(path) as stream:
        return bool(re.match(pattern, stream.read(512).decode("latin-1"), re.DOTALL))
    return False


def format_of(path: Path) -> str:
    """Return the format of a log by its first bytes or its suffix; empty for a table."""
    if path.is_dir():
        parts = (part.name for part in path.iterdir())
        return "bag" if any(re.search(r"\.(db3|mcap)", part) for part in parts) else ""
    by_bytes = (form for form, start in beginnings()["logs"].items() if begins(path, start))
    return next(by_bytes, "") or FORMATS_BY_SUFFIX.get(path.suffix.lower(), "")
