"""Components that name a recording file in their options."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from hashlib import sha256
from typing import Any, Self

from eqt_cli.core.leaves import STRUCTURE, with_fields
from eqt_cli.core.problems import Problems
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.logs.check import gaps_of
from eqt_cli.logs.mapping import MAPPING, LogMapping, MappingError, TrajectoryFormat
from eqt_cli.logs.reading import Log, read_log
from eqt_cli.logs.recording import Recording, recording_of


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
        found: Log = self.cache[G.name, "log"]
        return found

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
        found: Recording = self.cache[G.name, "recording"]
        return found

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
