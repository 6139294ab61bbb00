"""A recording that a component names by its options; what it is for is not known here."""

from collections.abc import Callable, Mapping
from copy import copy
from hashlib import sha256
from typing import Any, Self

from eqt_cli.core.problems import Problems
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.logs.mapping import MAPPING, LogMapping, MappingError, TrajectoryFormat
from eqt_cli.logs.reading import Log, read_log
from eqt_cli.logs.recording import Recording, recording_of


class InFile:
    """The options `file`, `format` and `mapping` of a component, and what the file holds."""

    file: str | None
    format: TrajectoryFormat
    mapping: LogMapping | None
    text: str | None
    digest: str

    @property
    def files(self) -> dict[str, str]:
        """The file, if there is one, by the option that names it."""
        return {} if self.file is None else {"file": self.file}

    def with_files(self, texts: Mapping[str, str]) -> Self:
        """The same with the content of its file."""
        if self.file is None or self.file not in texts:
            return self
        text, found = texts[self.file], copy(self)
        vars(found).pop("_prepared", None)
        vars(found).update(text=text, digest=sha256(text.encode()).hexdigest())
        return found

    def log(self, G: MatrixLieGroup) -> Log:
        """The file, which is read once for a group; raises an `InputError` if it is no motion."""
        kept = vars(self).setdefault("_prepared", {})
        if (G.name, "log") not in kept:
            assert self.text is not None and self.file is not None
            log = read_log(self.text, self.file, self.format, G, self.mapping or LogMapping())
            log.require_usable()
            kept[G.name, "log"] = log
        found: Log = kept[G.name, "log"]
        return found

    def recording(self, G: MatrixLieGroup) -> Recording:
        """The motion in it, body frame."""
        kept = vars(self).setdefault("_prepared", {})
        if (G.name, "recording") not in kept:
            kept[G.name, "recording"] = recording_of(self.log(G))
        found: Recording = kept[G.name, "recording"]
        return found

    def holds(self, recording: Recording) -> Self:
        """The same with a recording that was read before."""
        found = copy(self)
        vars(found)["_prepared"] = {(recording.group.name, "recording"): recording}
        return found

    def recorded_between(self, G: MatrixLieGroup) -> tuple[float, float]:
        """The times of the first and the last row."""
        times = self.recording(G).times
        return float(times[0]), float(times[-1])

    def recorded_gaps(self, G: MatrixLieGroup) -> list[tuple[float, float]]:
        """When a gap begins, and how long it is, s."""
        times, gaps = self.recording(G).times, self.recording(G).gaps
        lengths = times[gaps + 1] - times[gaps]
        return list(zip(times[gaps].tolist(), lengths.tolist(), strict=True))

    def check_file(self, problems: Problems, use: Callable[[], Any]) -> None:
        """Note what of the file or its mapping will not do, where `use` looks at all of it."""
        if self.mapping is not None:
            self.mapping.check(problems.at(MAPPING))
        if self.text is None or problems:
            return  # it could not be read, which is noted
        with problems.catching("file"):
            try:
                use()
            except MappingError as error:
                problems.at(MAPPING, *error.path).add(str(error))
