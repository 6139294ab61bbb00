"""A recorded motion as the reference, as it was measured."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from eqt_cli.core.problems import Problems
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.logs.in_file import InFile
from eqt_cli.logs.mapping import LogMapping, TrajectoryFormat
from eqt_cli.mechanics.motions import Pieces, spline, through
from eqt_cli.references.base import PiecewiseReference


@dataclass(frozen=True)
class LogReference(InFile, PiecewiseReference):
    """A recorded motion: at every row its pose and its velocity, with their noise.

    Between two rows it is the cubic curve that has these at both. Without recorded velocities it is
    the spline of `waypoints`. The wrench of the recording is no part of it: the law `replay`
    applies that. To track a recording, take `waypoints` with `smoothing`.

    Attributes
    ----------
    file
        The recording, relative to the configuration.
    format
        Its format: ``csv`` with a header that names the columns, ``tum`` or ``euroc``.
    mapping
        What the file does not say of itself: columns, units, order of quaternions, frames, times.
    """

    name: ClassVar[str] = "log"

    file: str
    format: TrajectoryFormat = "csv"
    mapping: LogMapping | None = None
    text: str | None = field(default=None, init=False, repr=False)
    digest: str = field(default="", init=False)

    def pieces(self, G: MatrixLieGroup) -> Pieces:
        """A piece from each row to the next."""
        log = self.recording(G)
        if np.isnan(log.velocities).any():
            return spline(G, log.times, log.poses)
        return through(G, log.times, log.poses, log.velocities)

    def ends(self, G: MatrixLieGroup) -> tuple[float, float]:
        """The times of the first and the last row."""
        return self.recorded_between(G)

    def gaps(self, G: MatrixLieGroup) -> list[tuple[float, float]]:
        """Those of the recording."""
        return self.recorded_gaps(G)

    def remarks(self, G: MatrixLieGroup) -> Iterator[str]:
        """What is odd in the file."""
        yield from (f"{self.file}: {note}" for note in self.recording(G).notes)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """A file or a mapping that will not do."""
        self.check_file(problems, lambda: self.prepared(G, self.pieces))
