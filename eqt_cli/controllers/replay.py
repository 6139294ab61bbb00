"""Applies a recorded wrench in open loop, to test the model of a plant."""

from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, Self, TypeAlias

import numpy as np

from eqt_cli.controllers.base import Controller
from eqt_cli.core.arrays import Array, as_array
from eqt_cli.core.errors import Problems
from eqt_cli.core.leaves import with_fields
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.logs.recording import RecordingInFile
from eqt_cli.mechanics.motions import piece_at
from eqt_cli.mechanics.tracking import Tracking

Hold: TypeAlias = Literal["zero", "linear"]


@dataclass(frozen=True)
class Replay(RecordingInFile, Controller):
    """The wrench of a recording, applied again in open loop, without any claim.

    With the reference `log` of the same file, the errors of a run are those of the prediction. The
    wrench passes through the actuators of the configuration, if there are any. A run over a gap of
    the recording is refused, because the wrench is not known there.

    Attributes
    ----------
    hold
        The wrench between two rows: ``zero`` holds it until the next row, as an autopilot holds its
        command; ``linear`` interpolates, for a wrench that was measured.
    """

    name: ClassVar[str] = "replay"
    tasks: ClassVar[tuple[str, ...]] = ()
    theorem: ClassVar[str] = ""
    departs: ClassVar[str] = "no feedback, but a recorded wrench"

    hold: Hold = "zero"
    now: Any = field(default=None, init=False, repr=False)  # HeldWrench | None

    @property
    def structure(self) -> Hashable:
        """The options and the content of the file."""
        return type(self), repr(self)

    @property
    def formula(self) -> None:
        """None, because it is no law."""
        return None

    def torque(self, s: Tracking) -> Array:
        """Return the recorded wrench at the time of a state."""
        return (self.now or self.held(s.G, s.t)).torque(s)

    def instants(self, G: MatrixLieGroup, until: float) -> Array:
        """Return the times of the rows."""
        return self.recording(G).times

    def held(self, G: MatrixLieGroup, t: Any) -> "HeldWrench":
        """Return the wrench from a time to the next row."""
        times, wrenches = self.recording(G).times, self.recording(G).wrenches
        row = piece_at(times, t)
        if self.hold == "zero":
            return HeldWrench(wrenches[row])
        row = np.minimum(row, len(times) - 2)
        step = (times[row + 1] - times[row])[..., None]
        slope = (wrenches[row + 1] - wrenches[row]) / step
        return HeldWrench(wrenches[row], slope, np.asarray(times[row]))

    def with_held(self, held: "HeldWrench | None") -> Self:
        """Return the law with this wrench."""
        return self if held is None else with_fields(self, now=held)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note an invalid file or mapping, and a file without a wrench."""
        self.check_file(problems, lambda: self.recording(G).require_wrenches())


@dataclass(frozen=True)
class HeldWrench:
    """The wrench from a row of a recording to the next, or an array of these for some times.

    Attributes
    ----------
    wrench : (..., m)
        The wrench at the row.
    slope : (..., m)
        Its rate, per s; None where it is held.
    since
        The time of the row, s.
    """

    wrench: Array
    slope: Array | None = None
    since: Array | None = None

    def torque(self, s: Tracking) -> Array:
        """Return the wrench at the time of a state."""
        wrench = self.wrench
        if self.slope is not None:
            wrench = wrench + as_array(s.t - self.since)[..., None] * self.slope
        return wrench + 0.0 * s.P  # broadcast to all runs
