"""No law, but a recorded wrench: what a model makes of it is the honest test of the model."""

from collections.abc import Hashable, Mapping
from copy import copy
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, Self, TypeAlias, get_args

import numpy as np

from eqt_cli.controllers.base import Controller
from eqt_cli.core.arrays import Array, as_array
from eqt_cli.core.errors import InputError, Remedy, TraceError
from eqt_cli.core.problems import Problems
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.logs.in_file import InFile
from eqt_cli.logs.mapping import LogMapping, TrajectoryFormat
from eqt_cli.mechanics.motions import SAME_TIME
from eqt_cli.mechanics.tracking import Tracking

Hold: TypeAlias = Literal["zero", "linear"]


def hold_named(text: str) -> Hold:
    """The way of this name; raises an `InputError` if there is none."""
    known: tuple[Hold, ...] = get_args(Hold)
    for name in known:
        if text == name:
            return name
    raise InputError(f"hold: expected one of {', '.join(known)}, got {text!r}")


@dataclass(frozen=True)
class Replay(InFile, Controller):
    """The wrench of a recording, applied again in open loop: no law, and nothing is claimed of it.

    With the reference `log` of the same file, the errors of a run are those of the prediction. The
    wrench goes through the actuators of the configuration, if there are any. A run over a gap of
    the recording is refused, because nobody knows the wrench there.

    Attributes
    ----------
    file
        The recording, relative to the configuration.
    format
        Its format: ``csv`` with a header that names the columns, ``tum`` or ``euroc``.
    mapping
        What the file does not say of itself: columns, units, order of quaternions, frames, times.
    hold
        How the wrench goes on behind a row: ``zero`` holds it until the next row, as an autopilot
        holds its command; ``linear`` interpolates, for a wrench that was measured.
    """

    name: ClassVar[str] = "replay"
    title: ClassVar[str] = "replay"
    tasks: ClassVar[tuple[str, ...]] = ()
    theorem: ClassVar[str] = ""
    departs: ClassVar[str] = "no feedback, but a recorded wrench"

    file: str
    format: TrajectoryFormat = "csv"
    mapping: LogMapping | None = None
    hold: Hold = "zero"
    text: str | None = field(default=None, init=False, repr=False)
    digest: str = field(default="", init=False)

    @property
    def structure(self) -> Hashable:
        """The options and the content of the file."""
        return type(self), repr(self)

    @property
    def formula(self) -> None:
        """None: it is no law."""
        return None

    def torque(self, s: Tracking) -> Array:
        """The recorded wrench at the time of a state."""
        held = vars(self).get("_held") or self.held(s.G, s.t)
        wrench = held["wrench"]
        if self.hold == "linear":
            wrench = wrench + as_array(s.t - held["since"])[..., None] * held["slope"]
        return wrench + 0.0 * s.P  # for every run

    def instants(self, G: MatrixLieGroup) -> Array:
        """The times of the rows."""
        return self.recording(G).times

    def held(self, G: MatrixLieGroup, t: Any) -> dict[str, Array]:
        """The wrench of the row before a time, and how it goes on."""
        if np.asarray(t).dtype == object:
            raise TraceError(
                "replay is no law that is compiled by itself: it applies a recorded wrench between "
                "its rows",
                Remedy("remove `control`, use engine solve_ivp, or export another law"),
            )
        times, wrenches = self.recording(G).times, self.recording(G).wrenches
        late = t + SAME_TIME * np.maximum(1.0, np.abs(t))
        row = np.searchsorted(times, late, side="right") - 1
        if self.hold == "zero":
            return {"wrench": wrenches[np.maximum(row, 0)]}
        row = np.clip(row, 0, len(times) - 2)
        step = (times[row + 1] - times[row])[..., None]
        slope = (wrenches[row + 1] - wrenches[row]) / step
        return {"wrench": wrenches[row], "since": times[row], "slope": slope}

    def holding(self, held: Mapping[str, Array]) -> Self:
        """The same between two rows, or for each run between two of its own."""
        found = copy(self)
        vars(found)["_held"] = held
        return found

    def ends(self, G: MatrixLieGroup) -> tuple[float, float]:
        """The times of the first and the last row."""
        return self.recorded_between(G)

    def gaps(self, G: MatrixLieGroup) -> list[tuple[float, float]]:
        """Those of the recording."""
        return self.recorded_gaps(G)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """A file or a mapping that will not do, or a file without a wrench."""
        self.check_file(problems, lambda: self.recording(G).require_wrenches())
