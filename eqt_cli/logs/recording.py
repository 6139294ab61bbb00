"""A recording as a motion on a group: poses, body velocities and wrenches over time."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import InputError
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.logs.check import notes
from eqt_cli.logs.columns import VELOCITY, WRENCH, recorded_columns, recorded_names
from eqt_cli.logs.mapping import LogMapping, TrajectoryFormat
from eqt_cli.logs.reading import Log, read_log


@dataclass(frozen=True)
class Recording:
    """A measured motion on a group.

    Attributes
    ----------
    name, place
        The file and the line of its header, for messages.
    group
        G.
    times : (n,)
        Rising times, s.
    poses : (n, d, d)
        Q.
    velocities : (n, m)
        V in the Lie algebra, body frame; NaN in the coordinates that were not measured.
    wrenches : (n, m)
        The wrench in the dual, body frame; NaN in the coordinates that were not measured.
    gaps : (k,)
        The rows after which rows are missing.
    timed
        Whether the mapping gives the offset of the clock.
    notes
        Remarks on oddities in the file.
    """

    name: str
    place: str
    group: MatrixLieGroup
    times: Array
    poses: Array
    velocities: Array
    wrenches: Array
    gaps: Array
    timed: bool = False
    notes: tuple[str, ...] = ()

    def require_velocities(self) -> Array:
        """Return the velocities, or raise an `InputError` if one was not measured."""
        return self._complete(self.velocities, VELOCITY, "a velocity")

    def require_wrenches(self) -> Array:
        """Return the wrenches, or raise an `InputError` if one was not measured."""
        return self._complete(self.wrenches, WRENCH, "a wrench")

    def _complete(self, measured: Array, kinds: dict[str, str], quantity: str) -> Array:
        G = self.group
        if not np.isnan(measured).any():
            return measured
        names = recorded_names(G, kinds)
        if len(names) < G.dimension:
            raise InputError(f"{self.place}: no columns of {quantity} on {G.name} are known")
        missing = [
            name
            for columns in recorded_columns(G)
            if columns.kind in kinds and np.isnan(measured[:, columns.axes]).any()
            for name in columns.names
        ]
        raise InputError(
            f"{self.place}: missing column {', '.join(missing)}; {quantity} on {G.name} has "
            f"{', '.join(names)}"
        )

    def part(self, first: int, last: int, step: int = 1) -> Self:
        """Return every `step`-th row from `first` to before `last`."""
        rows = slice(first, last, step)
        times = self.times[rows]
        gaps = np.unique((self.gaps - first) // step)
        return replace(
            self,
            times=times,
            poses=self.poses[rows],
            velocities=self.velocities[rows],
            wrenches=self.wrenches[rows],
            gaps=gaps[(gaps >= 0) & (gaps < len(times) - 1)],
        )

    def shifted(self, offset: float) -> Self:
        """Return the recording with `offset`, s, added to its times."""
        return replace(self, times=self.times + offset)


def recording_of(log: Log) -> Recording:
    """Return the motion in a log.

    Raises
    ------
    InputError
        If its times, its poses or their axes make it no motion.
    """
    log.require_usable()
    G = log.group
    velocities, wrenches = np.full((2, len(log.times), G.dimension), np.nan)
    for columns in log.recorded:
        measured = velocities if columns.kind in VELOCITY else wrenches
        measured[:, columns.axes] = log.in_body(columns)
    return Recording(
        log.table.name,
        log.sheet.header_place,
        G,
        log.times,
        log.poses,
        velocities,
        wrenches,
        log.gaps,
        log.mapping.time.offset is not None,
        tuple(notes(log)),
    )


def read_recording(
    text: str, name: str, form: TrajectoryFormat, G: MatrixLieGroup, mapping: LogMapping
) -> Recording:
    """Return the motion in the text of a file; raises as `read_log` and `recording_of` do."""
    return recording_of(read_log(text, name, form, G, mapping))
