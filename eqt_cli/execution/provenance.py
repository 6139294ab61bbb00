"""Records the origin of a result: versions, machine, commit. Nothing here affects numbers."""

from __future__ import annotations

import os
import platform
import sys
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eqt_cli.core.version import __version__
from eqt_cli.execution.repository import commit_of

if TYPE_CHECKING:
    from eqt_cli.engines import Engine

PACKAGES = ("numpy", "scipy", "h5py", "heyoka")

NUMERIC = ("eqt", "numpy", "scipy", "heyoka", "machine")
"""Entries on which the last bits of a number can depend."""

OTHERS = "other_sessions"
"""Entry for other sessions that computed some of the runs and differ in `NUMERIC`."""


def provenance(folder: Path, engine: Engine) -> dict[str, Any]:
    """Describe this machine and session; `folder` is the folder of the configuration."""
    return {
        "eqt": __version__,
        "python": platform.python_version(),
        **{name: found for name in PACKAGES if (found := _version(name))},
        "platform": platform.platform(),
        "machine": platform.machine(),
        **engine.provenance(),
        "cpu_count": os.cpu_count(),
        "command": " ".join(["eqt", *sys.argv[1:]]),
        "started": now(),
        "git": commit_of(folder),
    }


def now() -> str:
    """Return the current time, ISO 8601."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def together(origin: dict[str, Any], other: dict[str, Any]) -> dict[str, Any]:
    """Return `origin` with the sessions of both that differ from it in `NUMERIC`."""
    known = {_numeric(origin): origin}
    for entry in [*origin.get(OTHERS, ()), *other.get(OTHERS, ()), other]:
        known.setdefault(_numeric(entry), {k: v for k, v in entry.items() if k != OTHERS})
    _, *differing = known.values()
    plain = {key: value for key, value in origin.items() if key != OTHERS}
    return plain | ({OTHERS: differing} if differing else {})


def differences(other: dict[str, Any], origin: dict[str, Any]) -> str:
    """Describe the differences of a session from this one, as ``numpy 2.0.0 (not 2.4.6)``."""
    return ", ".join(
        f"{name} {other.get(name, 'none')} (not {origin.get(name, 'none')})"
        for name in NUMERIC
        if other.get(name) != origin.get(name)
    )


def _numeric(origin: dict[str, Any]) -> tuple[Any, ...]:
    return tuple(origin.get(name) for name in NUMERIC)


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
