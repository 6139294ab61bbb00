"""The folder of a tuning: the generations, the winners, and whose they are.

The folder itself is that of the confirmation, an ordinary result.
"""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from eqt_cli.core.errors import OTHER_FOLDER, EqtError, Remedy
from eqt_cli.core.files import read_record, refusals, write_record
from eqt_cli.execution.folder import ResultFolder
from eqt_cli.experiment.study import Study
from eqt_cli.results.result import Result
from eqt_cli.tuning.record_shape import fits
from eqt_cli.tuning.search import LawSearch, Search

TUNING, GENERATIONS, TUNED = "tuning.json", "generations", "tuned"


def record_beside(result: Result) -> dict[str, Any] | None:
    """What a search found whose held-out runs a result is; None of any other result."""
    record = TuningFolder(result.path.parent).record
    return record if record is not None and fits(record, result) else None  # or under way


@dataclass(frozen=True)
class TuningFolder:
    """Where a tuning keeps what it finds."""

    path: Path

    @property
    def record(self) -> dict[str, Any] | None:
        """What the folder says of its tuning; None where it holds none."""
        with refusals(self.path, "used", OTHER_FOLDER):
            return read_record(self.path / TUNING, "digest")

    def write_record(self, record: dict[str, Any]) -> None:
        """Write it, whole or not at all."""
        with refusals(self.path, "used", OTHER_FOLDER):
            write_record(self.path / TUNING, record)

    def generation(self, law: LawSearch, number: int) -> Path:
        """The folder of one generation, an ordinary sweep."""
        return self.path / GENERATIONS / law.slug / f"{number:03d}"

    def write_winners(self, law: LawSearch, studies: Sequence[Study], numbered: bool) -> None:
        """Keep the complete configurations of a law's winners, and no earlier ones."""
        names = winner_files(law, len(studies), numbered)
        with refusals(self.path, "used", OTHER_FOLDER):
            for name, study in zip(names, studies, strict=True):
                path = self.path / name
                path.parent.mkdir(parents=True, exist_ok=True)
                ResultFolder(path.parent).write_config(study, path.name)
            for path in (self.path / TUNED / law.slug).glob("*.yaml") if numbered else ():
                if str(path.relative_to(self.path)) not in names:
                    path.unlink()

    def claim(self, search: Search, force: bool) -> None:
        """Make the folder this tuning's own.

        Raises
        ------
        EqtError
            If it holds another tuning, or another result, and `force` is not given.
        """
        record = self.record
        other = record is not None and record["digest"] != search.digest
        result = record is None and ResultFolder(self.path).manifest is not None
        if (other or result) and not force:
            what = "another tuning" if other else "a result that eqt tune did not write"
            raise EqtError(
                f"{self.path}: holds {what}", OTHER_FOLDER, Remedy("replace it with {}", "force")
            )
        with refusals(self.path, "used", OTHER_FOLDER):
            if force:
                for name in (GENERATIONS, TUNED):
                    shutil.rmtree(self.path / name, ignore_errors=True)
            self.path.mkdir(parents=True, exist_ok=True)
        if force or record is None:
            self.write_record({"name": search.name, "digest": search.digest})


def winner_files(law: LawSearch, count: int, numbered: bool) -> list[str]:
    """The files of a law's winners in the folder; those of a front are numbered."""
    if not numbered:
        return [f"{TUNED}/{law.slug}.yaml"] * count
    return [f"{TUNED}/{law.slug}/{k + 1}.yaml" for k in range(count)]
