"""A recording as a motion on a group: poses, body velocities and wrenches over time."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import InputError
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.logs.check import notes
from eqt_cli.logs.columns import VELOCITY, WRENCH, columns_beside, names_beside
from eqt_cli.logs.mapping import LogMapping, TrajectoryFormat
from eqt_cli.logs.reading import Log, read_log


@dataclass(frozen=True)
class Recording:
    """What was measured of a motion on a group.

    Attributes
    ----------
    name, place
        The file, and the line of its header, for messages.
    group
        G.
    times : (n,)
        s, rising.
    poses : (n, d, d)
        Q.
    velocities : (n, m)
        V in the Lie algebra, body frame; NaN in the coordinates that were not measured.
    wrenches : (n, m)
        The wrench in the dual, body frame; NaN in the coordinates that were not measured.
    gaps : (k,)
        The rows behind which others are missing.
    timed
        Whether the mapping says what its clock is off by.
    notes
        What is odd in the file.
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
        """Raise an `InputError` if a coordinate was not measured; the velocities."""
        return self._whole(self.velocities, VELOCITY, "a velocity")

    def require_wrenches(self) -> Array:
        """Raise an `InputError` if a coordinate was not measured; the wrenches."""
        return self._whole(self.wrenches, WRENCH, "a wrench")

    def _whole(self, found: Array, kinds: dict[str, str], what: str) -> Array:
        G = self.group
        if not np.isnan(found).any():
            return found
        names = names_beside(G, kinds)
        if len(names) < G.dimension:
            raise InputError(f"{self.place}: no columns of {what} on {G.name} are known")
        missing = [
            name
            for each in columns_beside(G)
            if each.kind in kinds and np.isnan(found[:, each.axes]).any()
            for name in each.names
        ]
        raise InputError(
            f"{self.place}: missing column {', '.join(missing)}; {what} on {G.name} has "
            f"{', '.join(names)}"
        )

    def part(self, first: int, last: int, step: int = 1) -> Self:
        """The same with every so many of its rows, from the first to before the last."""
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
        """The same with s added to its times."""
        return replace(self, times=self.times + offset)


def recording_of(log: Log) -> Recording:
    """The motion of a file.

    Raises
    ------
    InputError
        For what makes it none: its times, its poses, their axes.
    """
    log.require_usable()
    G = log.group
    velocities, wrenches = np.full((2, len(log.times), G.dimension), np.nan)
    for beside in log.recorded:
        found = velocities if beside.kind in VELOCITY else wrenches
        found[:, beside.axes] = log.in_body(beside)
    return Recording(
        log.table.name,
        log.sheet.header_place,
        G,
        log.times,
        log.poses,
        velocities,
        wrenches,
        log.gaps,
        log.said.time.offset is not None,
        tuple(notes(log)),
    )


def read_recording(
    text: str, name: str, kind: TrajectoryFormat, G: MatrixLieGroup, said: LogMapping
) -> Recording:
    """The motion in the text of a file; errors as of `read_log` and `recording_of`."""
    return recording_of(read_log(text, name, kind, G, said))
