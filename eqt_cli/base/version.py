"""The version of eqt, and the versions that a result records of each session."""

from collections.abc import Mapping
from typing import Any

__version__ = "0.1.0"

NUMERIC = ("eqt", "numpy", "scipy", "machine", "arithmetic")
"""Entries on which the last bits of a number can depend."""

VERSIONS = ("eqt", "python", "numpy", "scipy")
"""Entries that a summary shows."""

OTHERS = "other_sessions"
"""Entry for other sessions that computed some of the runs and differ in `NUMERIC`."""

GROWN_FROM = "grown_from"
"""Entry for numbers of runs that a result had before it grew."""


def differences(other: Mapping[str, Any], origin: Mapping[str, Any]) -> str:
    """Describe the differences of a session from this one, as ``numpy 2.0.0 (not 2.4.6)``."""
    return ", ".join(
        f"{name} {other.get(name, 'none')} (not {origin.get(name, 'none')})"
        for name in NUMERIC
        if other.get(name) != origin.get(name)
    )


def together(origin: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, Any]:
    """Return `origin` with the sessions of both that differ from it in `NUMERIC`."""
    plain = {key: value for key, value in origin.items() if key != OTHERS}
    sessions = [plain]
    for entry in [*origin.get(OTHERS, ()), *other.get(OTHERS, ()), other]:
        session = {key: value for key, value in entry.items() if key != OTHERS}
        if all(differences(session, earlier) for earlier in sessions):
            sessions.append(session)
    return plain | ({OTHERS: sessions[1:]} if sessions[1:] else {})
