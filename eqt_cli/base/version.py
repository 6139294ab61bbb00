"""The version of eqt, and the versions that a result records of each session."""

from typing import Any

__version__ = "0.1.0"

NUMERIC = ("eqt", "numpy", "scipy", "machine")
"""Entries on which the last bits of a number can depend."""

VERSIONS = ("eqt", "python", "numpy", "scipy")
"""Entries that a summary shows."""

OTHERS = "other_sessions"
"""Entry for other sessions that computed some of the runs and differ in `NUMERIC`."""


def differences(other: dict[str, Any], origin: dict[str, Any]) -> str:
    """Describe the differences of a session from this one, as ``numpy 2.0.0 (not 2.4.6)``."""
    return ", ".join(
        f"{name} {other.get(name, 'none')} (not {origin.get(name, 'none')})"
        for name in NUMERIC
        if other.get(name) != origin.get(name)
    )


def numeric(origin: dict[str, Any]) -> tuple[Any, ...]:
    """Return the entries on which the last bits of a number can depend."""
    return tuple(origin.get(name) for name in NUMERIC)
