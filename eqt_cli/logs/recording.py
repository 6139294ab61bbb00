"""A recording as a motion on a group, and components that name the file of one."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from hashlib import sha256
from typing import Any, Self

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import InputError, Problems
from eqt_cli.core.leaves import STRUCTURE, with_fields
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.logs.check import gaps_of, notes
from eqt_cli.logs.mapping import MAPPING, LogMapping, MappingError, TrajectoryFormat
from eqt_cli.logs.reading import VELOCITY, WRENCH, Log, read_log, recorded_columns, recorded_names


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

    def require_wrenches(self) -> Array:
        """Return the wrenches, or raise an `InputError` if one was not measured."""
        G = self.group
        if not np.isnan(self.wrenches).any():
            return self.wrenches
        names = recorded_names(G, WRENCH)
        if len(names) < G.dimension:
            raise InputError(f"{self.place}: no columns of a wrench on {G.name} are known")
        missing = [
            name
            for columns in recorded_columns(G)
            if columns.kind in WRENCH and np.isnan(self.wrenches[:, columns.axes]).any()
            for name in columns.names
        ]
        raise InputError(
            f"{self.place}: missing column {', '.join(missing)}; a wrench on {G.name} has "
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


@dataclass(frozen=True, kw_only=True)
class InFile:
    """A component whose poses may stand in a file.

    Attributes
    ----------
    file
        The recording, relative to the configuration.
    format
        Its format: ``csv`` with a header that names the columns, ``tum`` or ``euroc``.
    mapping
        Columns, units, order of quaternions, frames and times, where the file does not give them.
    """

    file: str | None = None
    format: TrajectoryFormat = "csv"
    mapping: LogMapping | None = None
    text: str | None = field(default=None, init=False, repr=False)
    digest: str = field(default="", init=False)
    # What was read of the text for each group; copies of the component share it.
    cache: Any = field(
        default_factory=dict, init=False, repr=False, compare=False, metadata=STRUCTURE
    )

    @property
    def files(self) -> dict[str, str]:
        """The file, if there is one, by the option that names it."""
        return {} if self.file is None else {"file": self.file}

    def with_files(self, texts: Mapping[str, str]) -> Self:
        """Return the component with the content of its file."""
        if self.file is None or self.file not in texts:
            return self
        text = texts[self.file]
        return with_fields(self, text=text, digest=sha256(text.encode()).hexdigest(), cache={})

    def log(self, G: MatrixLieGroup) -> Log:
        """Return the log in the file, or raise an `InputError` if it is no motion."""
        if (G.name, "log") not in self.cache:
            assert self.text is not None and self.file is not None
            log = read_log(self.text, self.file, self.format, G, self.mapping or LogMapping())
            log.require_usable()
            self.cache[G.name, "log"] = log
        return self.cache[G.name, "log"]

    def check_file(self, problems: Problems, use: Callable[[], Any]) -> None:
        """Note errors of the mapping, and of the file where `use` raises them."""
        if self.mapping is not None:
            self.mapping.check(problems.at(MAPPING))
        if self.text is None or problems:
            return  # a file that could not be read was noted before
        with problems.catching("file"):
            try:
                use()
            except MappingError as error:
                problems.at(MAPPING, *error.path).add(str(error))


@dataclass(frozen=True, kw_only=True)
class RecordingInFile(InFile):
    """A component that follows the recording in its file from the first row to the last."""

    file: str = field()  # required, unlike in the base class

    def recording(self, G: MatrixLieGroup) -> Recording:
        """Return the motion in the file, body frame."""
        if (G.name, "recording") not in self.cache:
            self.cache[G.name, "recording"] = recording_of(self.log(G))
        return self.cache[G.name, "recording"]

    def with_recording(self, recording: Recording) -> Self:
        """Return the component with a recording that was read before."""
        return with_fields(self, cache={(recording.group.name, "recording"): recording})

    def ends(self, G: MatrixLieGroup) -> tuple[float, float]:
        """Return the times of the first and the last row."""
        times = self.recording(G).times
        return float(times[0]), float(times[-1])

    def gaps(self, G: MatrixLieGroup) -> list[tuple[float, float]]:
        """Return the begin and the length of each gap, s."""
        recording = self.recording(G)
        return gaps_of(recording.times, recording.gaps)
