"""A recorded motion as the reference, with its noise."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import Problems
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.logs.recording import RecordingInFile
from eqt_cli.mechanics.motions import Pieces, spline, through
from eqt_cli.references.base import PiecewiseReference


@dataclass(frozen=True)
class LogReference(RecordingInFile, PiecewiseReference):
    """A recorded motion: at every row the recorded pose and velocity, with their noise.

    Between two rows, a cubic curve joins these poses and velocities. Without recorded velocities,
    the motion is the spline of `waypoints`. It does not include the recorded wrench, which the law
    `replay` applies. To track a recording, use `waypoints` with `smoothing`.
    """

    name: ClassVar[str] = "log"

    def pieces(self, G: MatrixLieGroup) -> Pieces:
        """Return a piece from each row to the next."""
        log = self.recording(G)
        if np.isnan(log.velocities).any():
            return spline(G, log.times, log.poses)
        return through(G, log.times, log.poses, log.velocities)

    def given_at(self, G: MatrixLieGroup) -> Array:
        """Return the times of the rows."""
        return self.recording(G).times

    def remarks(self, G: MatrixLieGroup) -> Iterator[str]:
        """Yield the oddities of the file."""
        yield from (f"{self.file}: {note}" for note in self.recording(G).notes)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note an invalid file or mapping."""
        self.check_file(problems, lambda: self.prepared(G, self.pieces))
