"""The folder of a search, and its record, which is validated because it may come from anyone."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from eqt_cli.core.errors import OTHER_FOLDER, EqtError, Remedy
from eqt_cli.core.files import (
    FOUND_BY,
    Own,
    OwnFile,
    OwnFolder,
    check_entries,
    kind_of,
    read_record,
    refusals,
    remove_left_over,
    remove_own,
    write_record,
)
from eqt_cli.execution.folder import OWN_COPIES, OWN_RESULT, ResultFolder
from eqt_cli.execution.part_files import MANIFEST
from eqt_cli.experiment.study import Study
from eqt_cli.results.result import Result
from eqt_cli.tuning.law_search import LawSearch, coordinate_of

_BOUND = {"metric", "bound", "above", "every_run"}


def fits_tuning(record: dict[str, Any], result: Result) -> bool:
    """Whether a record has the form that `tune` writes, with laws and metrics of the result."""
    with suppress(TypeError, KeyError, AttributeError, ValueError):
        laws, place = record["laws"], result.labels.index
        searches = [search for law in laws for search in law["searches"]]
        winners = [winner for law in laws for winner in law["winners"]]
        labels = [*(law["start"] for law in laws), *(w["label"] for w in winners)]
        wanted = list(record["objectives"])
        metrics = [*wanted, *(bound["metric"] for bound in record["constraints"])]
        numbers = [
            *(value for winner in winners for value in winner["values"].values()),
            *(bound["bound"] for bound in record["constraints"]),
            *(record[name] for name in ("generations", "population", "runs")),
            *(number for search in searches for row in search["objectives"] for number in row),
        ]
        flags = [bound[name] for bound in record["constraints"] for name in ("above", "every_run")]

        return (
            0 < len(wanted) <= 2
            and len(record["cases"]) == (result.points if result.is_sweep else 0)
            and all(isinstance(case, str) for case in record["cases"])
            and record["over_cases"] in ("mean", "worst")
            and bool(labels)
            and len(set(wanted)) == len(wanted)
            and set(metrics) <= set(result.metrics)
            and len(set(labels)) == len(labels)
            and {*labels, *(search["label"] for search in searches)} - {None} <= set(result.labels)
            and all(len(row) == len(wanted) for search in searches for row in search["objectives"])
            and all(law["searches"] for law in laws)
            and all(isinstance(law["label"], str) for law in laws)
            and all(isinstance(number, int | float) for number in numbers)
            and all(isinstance(flag, bool) for flag in flags)
            and all(set(bound) == _BOUND for bound in record["constraints"])
            and all(place(w["label"]) < place(law["start"]) for law in laws for w in law["winners"])
        )
    return False


def fits_worst(record: dict[str, Any], result: Result) -> bool:
    """Whether a record has the form that `worst` writes, with laws and a metric of the result."""
    with suppress(TypeError, KeyError, AttributeError, ValueError):
        laws = record["laws"]
        labels = [law["label"] for law in laws]
        lines = [line for law in laws for line in law["lines"]]
        ends = [end for line in lines for end in line["points"]]
        searched = [one for law in laws for one in (law, *law["searches"])]
        numbers = [
            *(value for law in laws for value in law["values"].values()),
            *(one["value"] for one in searched if not one["failed"]),
            *(law["first"][name] for law in laws for name in ("runs", "unsettled")),
            *(record[name] for name in ("generations", "population", "runs")),
        ]
        counts = [law[name] for law in laws for name in ("run", "unsettled", "runs", "agreeing")]
        names = {coordinate_of(key) for law in laws for key in law["values"]}
        return (
            bool(labels)
            and result.is_sweep
            and len(set(labels)) == len(labels)
            and set(labels) <= set(result.labels)
            and record["objective"] in result.metrics
            and names <= set(result.coordinates)
            and all(line["key"] in law["values"] for law in laws for line in law["lines"])
            and all(law["lines"] and law["searches"] for law in laws)
            and all(set(law["log"]) <= set(law["values"]) for law in laws)
            and all(len(line["points"]) == 2 for line in lines)
            and all(isinstance(number, int) for number in (*ends, *counts, *record["seeds"]))
            and all(0 <= line["points"][0] < line["points"][1] <= result.points for line in lines)
            and all(isinstance(number, int | float) for number in numbers)
            and all(isinstance(one["failed"], bool) for one in searched)
            and all(isinstance(law["config"], str) for law in laws)
        )
    return False


GENERATIONS = "generations"


@dataclass(frozen=True)
class Kind:
    """A kind of search: for gains, or for the worst run.

    Attributes
    ----------
    command
        Command that starts the search: ``tune``.
    title
        Name of the search in messages.
    record, found
        Names of the file of the outcome, and of the folder of the configurations that were found.
    fits
        Whether a record is complete and belongs to a result.
    runs
        Whether each configuration that was found has its own result folder; else a law may have
        several configurations.
    """

    command: str
    title: str
    record: str
    found: str
    fits: Callable[[dict[str, Any], Result], bool]
    runs: bool = False

    def beside(self, result: Result) -> dict[str, Any] | None:
        """Return the record of the search that a result judges; None if there is no such search."""
        record = SearchFolder(result.path.parent, self).record
        # The record of an unfinished search has no outcome yet, and does not fit.
        return record if record is not None and self.fits(record, result) else None


TUNE = Kind("tune", "tuning", "tuning.json", "tuned", fits_tuning)
WORST = Kind("worst", "search for the worst run", "worst.json", "worst", fits_worst, runs=True)

_NUMBERED = OwnFile(r"\d+\.yaml", marked=True)


def _own(kind: Kind, slug: str, *, marked: bool) -> dict[str, Own]:
    """Return the entries that eqt writes in the folder of a search, beside those of the result.

    Parameters
    ----------
    slug
        Regular expression for the slugs of the laws.
    marked
        Whether only a configuration with eqt's mark counts, because a user's file may match the
        name.
    """
    generation = OwnFolder(r"\d{3,}(-case-\d+)?", OWN_RESULT, MANIFEST)
    one_search = OwnFolder(r"seed-\d+", (generation,))
    winners = OwnFolder(slug, (*OWN_COPIES, OwnFile(_NUMBERED.name, marked)))
    run = OwnFolder(slug, OWN_RESULT, MANIFEST)
    single = OwnFile(rf"({slug})\.yaml", marked)
    own: tuple[Own, ...] = (*OWN_COPIES, single, run if kind.runs else winners)
    return {
        kind.record: OwnFile(re.escape(kind.record)),
        GENERATIONS: OwnFolder(GENERATIONS, (OwnFolder(slug, (one_search,)),)),
        kind.found: OwnFolder(kind.found, own),
    }


@dataclass(frozen=True)
class SearchFolder:
    """The folder in which a search keeps its generations and its outcome."""

    path: Path
    kind: Kind

    @property
    def record(self) -> dict[str, Any] | None:
        """The record of the search; None if the folder has none."""
        with refusals(self.path, "used", OTHER_FOLDER):
            return read_record(self.path / self.kind.record, "digest")

    def write_record(self, record: dict[str, Any]) -> None:
        """Write the record atomically."""
        with refusals(self.path, "used", OTHER_FOLDER):
            write_record(self.path / self.kind.record, record)

    def generation(self, law: LawSearch, seed: int, number: int, cases: int = 1) -> list[Path]:
        """Return the folders of one generation, one for each case; each holds an ordinary sweep."""
        of_search = self.path / GENERATIONS / law.slug / f"seed-{seed}"
        ends = [f"-case-{k + 1}" for k in range(cases)] if cases > 1 else [""]
        return [of_search / f"{number:03d}{end}" for end in ends]

    def run_of(self, law: LawSearch) -> Path:
        """Return the result folder of the configuration that was found for a law."""
        return self.path / self.kind.found / law.slug

    def write_found(
        self, law: LawSearch, studies: Sequence[Study], numbered: bool = False, comment: str = ""
    ) -> None:
        """Write the complete configurations that were found for a law, and remove earlier ones.

        Parameters
        ----------
        numbered
            Whether there may be several.
        comment
            Lines to write above each configuration; each begins with ``#``.
        """
        names = found_files(self.kind, law, len(studies), numbered)
        mark = FOUND_BY.format(self.kind.command) + comment
        with refusals(self.path, "used", OTHER_FOLDER):
            for name, study in zip(names, studies, strict=True):
                path = self.path / name
                path.parent.mkdir(parents=True, exist_ok=True)
                ResultFolder(path.parent).write_config(study, path.name, mark.encode())
            for path in (self.path / self.kind.found / law.slug).glob("*.yaml") if numbered else ():
                if path.relative_to(self.path).as_posix() not in names:
                    remove_own(path, _NUMBERED)

    def check(self, laws: Sequence[LawSearch]) -> None:
        """Check the folder of a search for these laws before anything in it changes.

        Raises
        ------
        EqtError
            If an entry that eqt would write or remove is a link, or was not written by eqt.
        """
        slugs = "|".join(re.escape(law.slug) for law in laws)
        with refusals(self.path, "used", OTHER_FOLDER):
            check_entries(self.path, (*OWN_RESULT, *_own(self.kind, slugs, marked=False).values()))

    def claim(self, name: str, digest: str, force: bool) -> None:
        """Claim the folder for the search of this name and digest.

        Raises
        ------
        EqtError
            If it holds another search or another result, and `force` is false.
        """
        record = self.record
        own = _own(self.kind, r"[A-Za-z0-9._-]+", marked=True)  # those of any law
        there = [name for name in own if kind_of(self.path / name)]
        if there and record is None:
            raise EqtError(f"{self.path}: holds {there[0]} that eqt did not write", OTHER_FOLDER)
        other = record is not None and record["digest"] != digest
        result = record is None and ResultFolder(self.path).manifest is not None
        if (other or result) and not force:
            foreign = f"a result that eqt {self.kind.command} did not write"
            holds = f"another {self.kind.title}" if other else foreign
            # Generations are not to be computed twice, so nobody is told how to remove them.
            force_too = [] if other else [Remedy("replace it with {}", "force")]
            raise EqtError(f"{self.path}: holds {holds}", OTHER_FOLDER, *force_too)
        with refusals(self.path, "used", OTHER_FOLDER):
            for entry in (GENERATIONS, self.kind.found) if force else ():
                remove_own(self.path / entry, own[entry])
            remove_left_over(self.path, list(own.values()))
        if force or record is None:
            self.write_record({"name": name, "digest": digest})


def found_files(kind: Kind, law: LawSearch, count: int, numbered: bool = False) -> list[str]:
    """Return the names of the configurations that were found for a law."""
    if not numbered:
        return [f"{kind.found}/{law.slug}.yaml"] * count
    return [f"{kind.found}/{law.slug}/{k + 1}.yaml" for k in range(count)]
