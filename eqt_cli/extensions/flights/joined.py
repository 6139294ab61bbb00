"""Several recordings as one: flights of a list, one after the other, with gaps between them."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import InputError
from eqt_cli.base.reporting import listed
from eqt_cli.extensions.logs.flight_list import ListedFlight, read_list
from eqt_cli.extensions.logs.many import placed
from eqt_cli.extensions.logs.recording_check import Recording

PAUSE = 10.0
"""Time between two recordings, in longest steps; it is a gap in any case."""

NUMBERS = ("times", "poses", "velocities", "wrenches", "speeds")


def recordings_of_a_list(path: Path, read: Callable[[ListedFlight], Recording]) -> Recording:
    """Return the flights of a list as one recording.

    Raises
    ------
    InputError
        If one cannot be read, or has other rotors than the first.
    """
    parts = list[Recording]()
    for flight in read_list(path):
        with placed(flight):
            parts.append(_part(read(flight), flight))
            if parts[-1].rotors != parts[0].rotors:
                names = [", ".join(x.rotors) or "no rotor speeds" for x in (parts[0], parts[-1])]
                raise InputError(f"expected {names[0]}, as in the first flight, got {names[1]}")
    return joined(parts, f"{path}")


def _part(recording: Recording, flight: ListedFlight) -> Recording:
    """Return the rows of a recording between the times that its row of a list gives."""
    times, ends = recording.times, [-np.inf, np.inf]
    for k, text in enumerate((flight.begin, flight.end)):
        if text:
            ends[k] = float(text) + (times[0] if text.startswith("+") else 0.0)
    rows = np.flatnonzero((times >= ends[0]) & (times <= ends[1]))
    if len(rows) < 2:
        span = f"{times[0]:.13g} to {times[-1]:.13g} s"
        raise InputError(f"begin: no rows are left; the recording is from {span}")
    gaps = recording.gaps - rows[0]
    numbers: dict[str, Any] = {
        n: getattr(recording, n)[rows] for n in NUMBERS if len(getattr(recording, n))
    }
    inside = (gaps >= 0) & (gaps < len(rows) - 1)
    return replace(recording, **numbers, gaps=gaps[inside])


def joined(parts: Sequence[Recording], name: str) -> Recording:
    """Return recordings one after the other, with a gap behind every one but the last."""
    first, gaps, times, end = parts[0], list[int](), list[Array](), 0.0
    rows = 0
    for part in parts:
        since = part.times - part.times[0]
        times.append(end + since)
        gaps += [*(rows + part.gaps), rows + len(since) - 1]
        rows += len(since)
        end = float(times[-1][-1] + PAUSE * np.diff(since).max())
    whole: dict[str, Any] = {n: np.concatenate([getattr(x, n) for x in parts]) for n in NUMBERS[1:]}
    notes = [f"{Path(x.name).name}: {note}" for x in parts for note in x.notes]
    names = [Path(x.name).name for x in parts]
    notes.insert(0, f"{len(parts)} flights, one after the other: {listed(names)}")
    moved = [float(t[0] - part.times[0]) for t, part in zip(times, parts, strict=True)]
    if said := [f"{n} by {s:+.4g} s" for n, s in zip(names, moved, strict=True) if s]:
        notes.insert(1, f"times were moved, also for forces that depend on t: {listed(said)}")
    place: dict[str, Any] = {"name": name, "place": name, "times": np.concatenate(times)}
    return replace(first, **place, **whole, gaps=np.array(gaps[:-1], int), notes=tuple(notes))
