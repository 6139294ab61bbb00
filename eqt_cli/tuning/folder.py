"""The folder of a tuning: the generations, the winners, and whose they are.

The folder itself is that of the confirmation, an ordinary result.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from eqt_cli.core.errors import OTHER_FOLDER, EqtError, Remedy
from eqt_cli.core.files import read_record, refusals, write_record
from eqt_cli.core.own_files import (
    FOUND_BY_TUNE,
    Own,
    OwnFile,
    OwnFolder,
    check_entries,
    kind_of,
    remove_left_over,
    remove_own,
)
from eqt_cli.execution.folder import OWN_COPIES, OWN_RESULT, ResultFolder
from eqt_cli.execution.part_files import MANIFEST
from eqt_cli.experiment.study import Study
from eqt_cli.results.result import Result
from eqt_cli.tuning.record_shape import fits
from eqt_cli.tuning.search import LawSearch, Search

TUNING, GENERATIONS, TUNED = "tuning.json", "generations", "tuned"


_NUMBERED = OwnFile(r"\d+\.yaml", marked=True)


def _own(slug: str, *, marked: bool) -> dict[str, Own]:
    """What eqt writes in the folder of a tuning, beside the result: of laws by their slugs.

    Parameters
    ----------
    slug
        The slugs, as a regular expression.
    marked
        Whether a configuration is known by its mark, since others may have such a name.
    """
    generation = OwnFolder(r"\d{3,}", OWN_RESULT, MANIFEST)
    one_search = OwnFolder(r"seed-\d+", (generation,))
    winners: tuple[Own, ...] = (*OWN_COPIES, OwnFile(_NUMBERED.name, marked))
    single = OwnFile(rf"({slug})\.yaml", marked)
    tuned: tuple[Own, ...] = (*OWN_COPIES, single, OwnFolder(slug, winners))
    return {
        TUNING: OwnFile(re.escape(TUNING)),
        GENERATIONS: OwnFolder(GENERATIONS, (OwnFolder(slug, (one_search,)),)),
        TUNED: OwnFolder(TUNED, tuned),
    }


_OF_ANY_LAW = _own(r"[A-Za-z0-9._-]+", marked=True)


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

    def generation(self, law: LawSearch, seed: int, number: int) -> Path:
        """The folder of one generation of a search, an ordinary sweep."""
        return self.path / GENERATIONS / law.slug / f"seed-{seed}" / f"{number:03d}"

    def write_winners(self, law: LawSearch, studies: Sequence[Study], numbered: bool) -> None:
        """Keep the complete configurations of a law's winners, and no earlier ones."""
        names = winner_files(law, len(studies), numbered)
        with refusals(self.path, "used", OTHER_FOLDER):
            for name, study in zip(names, studies, strict=True):
                path = self.path / name
                path.parent.mkdir(parents=True, exist_ok=True)
                ResultFolder(path.parent).write_config(study, path.name, FOUND_BY_TUNE)
            for path in (self.path / TUNED / law.slug).glob("*.yaml") if numbered else ():
                if path.relative_to(self.path).as_posix() not in names:
                    remove_own(path, _NUMBERED)

    def check(self, search: Search) -> None:
        """Refuse the folder, before anything in it changes, where it leads elsewhere.

        Raises
        ------
        EqtError
            If an entry that eqt writes or removes is a link, or anything but what eqt wrote.
        """
        slugs = "|".join(re.escape(law.slug) for law in search.laws)
        with refusals(self.path, "used", OTHER_FOLDER):
            check_entries(self.path, (*OWN_RESULT, *_own(slugs, marked=False).values()))

    def claim(self, search: Search, force: bool) -> None:
        """Make the folder this tuning's own.

        Raises
        ------
        EqtError
            If it holds another tuning, or another result, and `force` is not given.
        """
        record = self.record
        there = [name for name in _OF_ANY_LAW if kind_of(self.path / name)]
        if there and record is None:
            raise EqtError(f"{self.path}: holds {there[0]} that eqt did not write", OTHER_FOLDER)
        other = record is not None and record["digest"] != search.digest
        result = record is None and ResultFolder(self.path).manifest is not None
        if (other or result) and not force:
            what = "another tuning" if other else "a result that eqt tune did not write"
            raise EqtError(
                f"{self.path}: holds {what}", OTHER_FOLDER, Remedy("replace it with {}", "force")
            )
        with refusals(self.path, "used", OTHER_FOLDER):
            for name in (GENERATIONS, TUNED) if force else ():
                remove_own(self.path / name, _OF_ANY_LAW[name])
            remove_left_over(self.path, list(_OF_ANY_LAW.values()))
        if force or record is None:
            self.write_record({"name": search.name, "digest": search.digest})


def winner_files(law: LawSearch, count: int, numbered: bool) -> list[str]:
    """The files of a law's winners in the folder; those of a front are numbered."""
    if not numbered:
        return [f"{TUNED}/{law.slug}.yaml"] * count
    return [f"{TUNED}/{law.slug}/{k + 1}.yaml" for k in range(count)]
