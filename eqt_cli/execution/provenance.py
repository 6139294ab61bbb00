"""Where a result comes from: versions, machine, state of the code; nothing that affects numbers."""

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
"""What may change the last bits of a number."""

OTHERS = "other_sessions"
"""Sessions that have computed a share of the runs and differ from the one described in these."""


def provenance(folder: Path, engine: Engine) -> dict[str, Any]:
    """What is worth knowing of this machine and moment; `folder` is where the config lies."""
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
    """The time, ISO 8601."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def together(origin: dict[str, Any], other: dict[str, Any]) -> dict[str, Any]:
    """`origin`, with those sessions of both that may have computed other bits than it."""
    known = {_numeric(origin): origin}
    for entry in [*origin.get(OTHERS, ()), *other.get(OTHERS, ()), other]:
        known.setdefault(_numeric(entry), {k: v for k, v in entry.items() if k != OTHERS})
    _, *differing = known.values()
    plain = {key: value for key, value in origin.items() if key != OTHERS}
    return plain | ({OTHERS: differing} if differing else {})


def differences(other: dict[str, Any], origin: dict[str, Any]) -> str:
    """What a session has that this one has not, as ``numpy 2.0.0 (not 2.4.6)``."""
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
