"""The folder of a search: the generations, what was found, and whose they are.

The folder itself is that of an ordinary result: the runs by which the outcome is judged.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eqt_cli.core.errors import OTHER_FOLDER, EqtError, Remedy
from eqt_cli.core.files import read_record, refusals, write_record
from eqt_cli.core.own_files import (
    FOUND_BY,
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
from eqt_cli.tuning.law_search import LawSearch
from eqt_cli.tuning.record_shape import fits_tuning, fits_worst

if TYPE_CHECKING:
    from eqt_cli.tuning.searches import Searches

GENERATIONS = "generations"


@dataclass(frozen=True)
class Kind:
    """What is searched for.

    Attributes
    ----------
    command
        That searches: ``tune``.
    what
        Such a search in words.
    record, found
        The names of the file that says what was found, and of the folder of configurations.
    fits
        Whether a record is of such a search whose outcome was judged by a result.
    runs
        Whether there are results of these beside them, rather than several for a law.
    """

    command: str
    what: str
    record: str
    found: str
    fits: Callable[[dict[str, Any], Result], bool]
    runs: bool = False

    def beside(self, result: Result) -> dict[str, Any] | None:
        """What a search found whose outcome a result judges; None of any other result."""
        record = SearchFolder(result.path.parent, self).record
        return record if record is not None and self.fits(record, result) else None  # or under way


TUNE = Kind("tune", "tuning", "tuning.json", "tuned", fits_tuning)
WORST = Kind("worst", "search for the worst run", "worst.json", "worst", fits_worst, runs=True)

_NUMBERED = OwnFile(r"\d+\.yaml", marked=True)


def _own(kind: Kind, slug: str, *, marked: bool) -> dict[str, Own]:
    """What eqt writes in the folder of a search, beside the result: of laws by their slugs.

    Parameters
    ----------
    slug
        The slugs, as a regular expression.
    marked
        Whether a configuration is known by its mark, since others may have such a name.
    """
    generation = OwnFolder(r"\d{3,}(-case-\d+)?", OWN_RESULT, MANIFEST)
    one_search = OwnFolder(r"seed-\d+", (generation,))
    winners = OwnFolder(slug, (*OWN_COPIES, OwnFile(_NUMBERED.name, marked)))
    run = OwnFolder(slug, OWN_RESULT, MANIFEST)
    single = OwnFile(rf"({slug})\.yaml", marked)
    found: tuple[Own, ...] = (*OWN_COPIES, single, run if kind.runs else winners)
    return {
        kind.record: OwnFile(re.escape(kind.record)),
        GENERATIONS: OwnFolder(GENERATIONS, (OwnFolder(slug, (one_search,)),)),
        kind.found: OwnFolder(kind.found, found),
    }


def _of_any_law(kind: Kind) -> dict[str, Own]:
    return _own(kind, r"[A-Za-z0-9._-]+", marked=True)


@dataclass(frozen=True)
class SearchFolder:
    """Where a search keeps what it finds."""

    path: Path
    kind: Kind

    @property
    def record(self) -> dict[str, Any] | None:
        """What the folder says of its search; None where it holds none."""
        with refusals(self.path, "used", OTHER_FOLDER):
            return read_record(self.path / self.kind.record, "digest")

    def write_record(self, record: dict[str, Any]) -> None:
        """Write it, whole or not at all."""
        with refusals(self.path, "used", OTHER_FOLDER):
            write_record(self.path / self.kind.record, record)

    def generation(self, law: LawSearch, seed: int, number: int, cases: int = 1) -> list[Path]:
        """The folders of one generation of a search, of each case an ordinary sweep."""
        of_search = self.path / GENERATIONS / law.slug / f"seed-{seed}"
        ends = [f"-case-{k + 1}" for k in range(cases)] if cases > 1 else [""]
        return [of_search / f"{number:03d}{end}" for end in ends]

    def run_of(self, law: LawSearch) -> Path:
        """The folder of the result of what was found for a law."""
        return self.path / self.kind.found / law.slug

    def write_found(
        self, law: LawSearch, studies: Sequence[Study], numbered: bool = False, said: str = ""
    ) -> None:
        """Keep the complete configurations of what was found for a law, and no earlier ones.

        Parameters
        ----------
        numbered
            Whether there may be several.
        said
            What stands above them, in lines that begin with ``#``.
        """
        names = found_files(self.kind, law, len(studies), numbered)
        mark = FOUND_BY.format(self.kind.command) + said
        with refusals(self.path, "used", OTHER_FOLDER):
            for name, study in zip(names, studies, strict=True):
                path = self.path / name
                path.parent.mkdir(parents=True, exist_ok=True)
                ResultFolder(path.parent).write_config(study, path.name, mark.encode())
            for path in (self.path / self.kind.found / law.slug).glob("*.yaml") if numbered else ():
                if path.relative_to(self.path).as_posix() not in names:
                    remove_own(path, _NUMBERED)

    def check(self, search: Searches[Any]) -> None:
        """Refuse the folder, before anything in it changes, where it leads elsewhere.

        Raises
        ------
        EqtError
            If an entry that eqt writes or removes is a link, or anything but what eqt wrote.
        """
        slugs = "|".join(re.escape(law.slug) for law in search.laws)
        with refusals(self.path, "used", OTHER_FOLDER):
            check_entries(self.path, (*OWN_RESULT, *_own(self.kind, slugs, marked=False).values()))

    def claim(self, search: Searches[Any], force: bool) -> None:
        """Make the folder this search's own.

        Raises
        ------
        EqtError
            If it holds another search, or another result, and `force` is not given.
        """
        record, own = self.record, _of_any_law(self.kind)
        there = [name for name in own if kind_of(self.path / name)]
        if there and record is None:
            raise EqtError(f"{self.path}: holds {there[0]} that eqt did not write", OTHER_FOLDER)
        other = record is not None and record["digest"] != search.digest
        result = record is None and ResultFolder(self.path).manifest is not None
        if (other or result) and not force:
            unlike = f"a result that eqt {self.kind.command} did not write"
            what = f"another {self.kind.what}" if other else unlike
            raise EqtError(
                f"{self.path}: holds {what}", OTHER_FOLDER, Remedy("replace it with {}", "force")
            )
        with refusals(self.path, "used", OTHER_FOLDER):
            for name in (GENERATIONS, self.kind.found) if force else ():
                remove_own(self.path / name, own[name])
            remove_left_over(self.path, list(own.values()))
        if force or record is None:
            self.write_record({"name": search.name, "digest": search.digest})


def found_files(kind: Kind, law: LawSearch, count: int, numbered: bool = False) -> list[str]:
    """The files of what was found for a law; those of a front are numbered."""
    if not numbered:
        return [f"{kind.found}/{law.slug}.yaml"] * count
    return [f"{kind.found}/{law.slug}/{k + 1}.yaml" for k in range(count)]
