"""Searches of one law after the other, generation by generation."""

from __future__ import annotations

import json
import os
from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from functools import cached_property, reduce
from hashlib import sha256
from itertools import product
from pathlib import Path
from typing import Any, ClassVar, Generic, Self, TypeVar

import numpy as np

from eqt_cli.base import files, purposes
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import OTHER_FOLDER, EqtError, Problems
from eqt_cli.base.extensions import functions_for
from eqt_cli.base.reporting import (
    RUNS_DONE,
    InNotebook,
    brief,
    count_of,
    reporter,
    step,
    working_for,
)
from eqt_cli.config.document import Document, changed_at, expanded
from eqt_cli.config.experiment import Experiment
from eqt_cli.config.preflight import build
from eqt_cli.config.remarks import remark_on
from eqt_cli.config.study import study
from eqt_cli.extensions.search import fronts, law_search
from eqt_cli.extensions.search.candidates import computed
from eqt_cli.extensions.search.fronts import Population, Scores, selected
from eqt_cli.extensions.search.keys import SearchSection
from eqt_cli.extensions.search.law_search import LawSearch, SearchFolder, TunedRange
from eqt_cli.extensions.search.record import AS_IT_IS, Kind
from eqt_cli.extensions.search.run_numbers import Numbers
from eqt_cli.results.result import Result
from eqt_cli.runs.executors import Executor
from eqt_cli.runs.folder import ResultFolder
from eqt_cli.runs.lock import LOCK, locked
from eqt_cli.runs.preflight import PROBE_SECONDS, estimate
from eqt_cli.runs.run_study import Execution, execute

# Common base of the searches: reads the section, and counts generations and runs ------------------


S = TypeVar("S", bound=SearchSection)

Outcome = tuple[Execution, dict[str, Any]]
"""The runs that judge the outcome of a search, and its record."""


@dataclass(frozen=True)
class Searches(ABC, Generic[S]):
    """Searches for each law of an experiment, with equal numbers of generations and seeds.

    Attributes
    ----------
    kind
        Kind of the search.
    example
        Example of the section, for messages.
    continuing
        Keys of the section that only change how many generations there are. A search whose other
        keys are equal reuses the stored generations.
    keeps_ends
        Whether values outside a range are clipped to its ends, where the worst run often is; else
        they are drawn again.
    base
        The experiment with all laws.
    section
        The section of the configuration.
    laws
        One search for each law.
    """

    kind: ClassVar[Kind]
    example: ClassVar[str]
    continuing: ClassVar[frozenset[str]]
    keeps_ends: ClassVar[bool] = False

    base: Experiment
    section: S
    laws: tuple[LawSearch, ...]

    @classmethod
    def read(cls, document: Document) -> Self:
        """Read and check the section of a configuration.

        Raises
        ------
        ConfigError
            With every problem, each at its place.
        EqtError
            If it has no such section.
        """
        name = cls.kind.command
        if not document.data.get(name):
            raise EqtError(
                f"{document.source.name}: has no section `{name}`; add one, such as "
                f"{name}: {cls.example}"
            )
        if document.data.get("sweep"):
            place = document.place(("sweep",))
            raise EqtError(f"{place}: eqt {name} searches around one point; leave `sweep` out")
        base = build(document)
        section = getattr(base.config, name)
        problems = Problems(document.place)
        here = problems.at(name)
        ranges: dict[str, TunedRange] = {}
        names: set[str] = set()
        if section.set:
            with here.at("set").catching():
                section = section.model_copy(update={"set": expanded(section.set)})
            problems.raise_if_any()
            swept = list(expanded(dict.fromkeys(section.over)))
            rules = law_search.rules_of(section.set, swept, here)
            problems.raise_if_any()
            names = rules.variables
            for key in rules.formulas.keys() - names:
                with here.catching("set", key):
                    cls._axis(key, None, base)
        for key, listed in section.over.items():
            at_key = here.at("over", key)
            axis = law_search.range_of(listed, at_key, has_absent=cls._takes_fixed(section))
            with at_key.catching():
                varied = axis if key in names else cls._axis(key, axis, base)
                ranges |= {key: varied} if varied else {}
        cls._check(section, base, here)
        problems.raise_if_any()
        laws: tuple[LawSearch, ...] = ()
        with here.at("over").catching():
            laws = law_search.laws_of(base, ranges, section.set)
        problems.raise_if_any()
        takes_fixed = cls._takes_fixed(section) and any(law.axes for law in laws)
        for law in laws:
            if not (law.axes or takes_fixed):
                here.at("over").add(
                    f"has no key of controller '{law.label}'; add one that all laws share, or "
                    "leave the controller out"
                )
        law_search.check_overlaps(laws, here.at("over"))
        problems.raise_if_any()
        search = cls(base, section, laws)
        for law in laws:
            for name, case in search.in_cases(law).items():
                law_search.check_ends(case, here.at("over"), f"in case '{name}', " if name else "")
        problems.raise_if_any()
        return search

    def remark_on_ends(self) -> tuple[str, ...]:
        """Tell and return what is remarked on values at both ends of all ranges."""
        noted: tuple[str, ...] = ()
        for more in functions_for(purposes.remarks_on_other_values):
            noted += more(self.base, (end for law in self.laws for end in law_search.ends(law)))
        return noted

    @classmethod
    @abstractmethod
    def _axis(cls, key: str, axis: TunedRange | None, base: Experiment) -> TunedRange | None:
        """Return the range of a key (None if it was invalid); `InputError` if it cannot vary."""

    @classmethod
    def _takes_fixed(cls, section: S) -> bool:
        """Whether laws without a key of the search take part as they are."""
        return False

    @classmethod
    @abstractmethod
    def _check(cls, section: S, base: Experiment, problems: Problems) -> None:
        """Note the other problems of the section."""

    @property
    def folder(self) -> Path:
        """Default result folder."""
        return Path("results") / f"{self.base.name}-{self.kind.configs}"

    def in_cases(self, law: LawSearch) -> dict[str, LawSearch]:
        """Return the search for a law in each case by name; without cases, one named ''."""
        return {"": law}

    def over_cases(self, cases: Sequence[Scores]) -> Scores:
        """Combine the scores of the same points in all cases."""
        return Scores.over_cases(cases, worst=False)

    def first_points(self, law: LawSearch) -> Array:
        """Return the points that all searches for a law try first, ``(points, dimensions)``."""
        seeds = self.evolution[2]
        return np.concatenate([_tried(self, law, seed, 0, None) for seed in seeds])

    @property
    @abstractmethod
    def scored_metrics(self) -> list[str]:
        """The metrics that `scores` reads."""

    @abstractmethod
    def scores(self, result: Result | Numbers) -> Scores:
        """Return the scores of all points of a sweep with one law."""

    @abstractmethod
    def so_far(self, law: LawSearch, population: Population) -> str:
        """Describe the best point of a law so far."""

    @abstractmethod
    def conclude(self, folder: SearchFolder, executor: Executor) -> Outcome:
        """Search for every law, and judge what was found."""

    def begun_in(self, out: Path) -> Self:
        """Return the search by the engine that began its folder, if eqt chose another one."""
        earlier = None
        with suppress(EqtError):  # what is wrong with the folder is told when it is claimed
            earlier = (self.kind.record_in(out) or {}).get("engine")
        engine = self.base.solver.begun_by(earlier, out)
        if engine is None:
            return self
        return self.read(changed_at(self.base.document, ("solver", "engine"), engine, str(out)))

    @property
    @abstractmethod
    def evolution(self) -> tuple[int, int, range]:
        """Number of generations, points of each, and seeds of the searches for each law."""

    @property
    def points(self) -> int:
        """Largest number of points of all searches for all laws."""
        generations, population, seeds = self.evolution
        return len(self.laws) * len(seeds) * generations * population

    @property
    def size(self) -> list[str]:
        """The factors of `points`, in words."""
        generations, population, seeds = self.evolution
        return [
            count_of(len(self.laws), "law"),
            f"{len(seeds)} search{'es' if len(seeds) > 1 else ''}",
            count_of(generations, "generation"),
            count_of(population, "point"),
        ]

    def remarks(self) -> list[str]:
        """Return what is doubtful about the size of the search."""
        return []

    @property
    def runs_at_a_point(self) -> int:
        """Number of runs that score a point."""
        return self.base.config.ensemble.runs * len(self.in_cases(self.laws[0]))

    @property
    def searched_runs(self) -> int:
        """Largest number of runs of the searches for all laws."""
        return self.points * self.runs_at_a_point

    judging: ClassVar[str] = "to judge the outcome"
    """What further runs are for."""

    @property
    @abstractmethod
    def judging_runs(self) -> int:
        """Largest number of runs that judge the outcome."""

    @property
    def all_runs(self) -> int:
        """Number of runs of the search and of the judgement of its outcome."""
        return self.searched_runs + self.judging_runs

    @property
    def settings(self) -> dict[str, Any]:
        """The size of the search, for its record."""
        generations, population, seeds = self.evolution
        return self.identity | {
            "generations": generations,
            "population": population,
            "seeds": list(seeds),
        }

    @property
    def identity(self) -> dict[str, Any]:
        """What tells this search from others, for its record."""
        return {
            "name": self.base.name,
            "digest": self.digest,
            "engine": self.base.engine.name,
            "runs": self.base.config.ensemble.runs,
        }

    @cached_property
    def digest(self) -> str:
        """Hash of everything that decides the points of a generation, whatever their number."""
        section = self.section.model_dump(exclude=set(self.continuing), warnings="none")
        ordered = json.dumps(section)  # keeps the order of cases and keys
        text = json.dumps([self.base.numeric_config, ordered], sort_keys=True)
        return sha256(text.encode()).hexdigest()


# Carries out a search in its folder; each generation is an ordinary sweep in its own folder -------


SWEEP, GROUP = 0.2, 0.07
"""Measured overhead of a sweep, and of each of its points where points differ in shape, s."""


def compute(
    document: Document, out: Path, executor: Executor, remarks: tuple[str, ...]
) -> Execution:
    """Compute an experiment, or the missing parts of it, whose result holds these remarks."""
    sweep = replace(study(document), remarks=remarks)
    # A search with fewer generations may have left another result here, with some of these runs.
    force = ResultFolder(out).manifest.get("digest", sweep.digest) != sweep.digest
    done = execute(sweep, out, executor=executor, force=force, grow=force)
    if done.was_complete:
        reporter().skip(done.runs)
    return done


def evolve(
    search: Searches[Any], law: LawSearch, folder: SearchFolder, executor: Executor
) -> dict[int, Population]:
    """Run all generations of all searches for one law; return the last population by seed."""
    generations, _, all_seeds = search.evolution
    searches: dict[int, Population] = {}
    for seeds, number in product(folder.groups(law, all_seeds), range(generations)):
        shares = [_tried(search, law, seed, number, searches.get(seed)) for seed in seeds]
        points, path = np.concatenate(shares), folder.generation(law, seeds, number)
        scores = stored_scores(path, points)
        if scores is None:
            scores = _scored(search, law, points, executor, tried=number > 0)
            arrays = {field.name: getattr(scores, field.name).tolist() for field in fields(scores)}
            with files.refusals(folder.path, "used", OTHER_FOLDER):
                path.parent.mkdir(parents=True, exist_ok=True)
                files.write_record(path, {"shares": points.tolist(), **arrays})
        else:
            reporter().skip(len(points) * search.runs_at_a_point)
        rows = np.arange(len(scores)).reshape(len(seeds), -1)
        for seed, of_seed, at in zip(seeds, shares, rows, strict=True):
            tried = Population(of_seed, scores.at(at))
            searches[seed] = selected(searches[seed], tried) if number else tried
        done = f"{count_of(len(seeds), 'seed')}, generation {number + 1}/{generations}"
        so_far = search.so_far(law, reduce(selected, searches.values()))
        reporter().note(law.label, f"{done}, {so_far}")
    return searches


def _scored(
    search: Searches[Any], law: LawSearch, shares: Array, executor: Executor, *, tried: bool
) -> Scores:
    """Run the points of a generation in all cases, and return their scores."""
    cases = search.in_cases(law).values()
    studies = [study(swept(case, columns(case, shares))) for case in cases]
    numbers = computed(studies, search.scored_metrics, executor, tried=tried)
    return search.over_cases([search.scores(number) for number in numbers])


def stored_scores(path: Path, shares: Array | None = None) -> Scores | None:
    """Return the scores in the file of a generation; None if it holds none of these points."""
    with files.refusals(path.parent, "used", OTHER_FOLDER):
        record = files.read_record(path, "shares")
    if record is None or (shares is not None and not np.array_equal(record["shares"], shares)):
        return None
    return Scores(*(np.array(record[field.name], dtype=float) for field in fields(Scores)))


def _tried(
    search: Searches[Any], law: LawSearch, seed: int, number: int, before: Population | None
) -> Array:
    """Return the points that a search tries in a generation, ``(points, dimensions)``."""
    if before is None:
        return fronts.first_points(search.evolution[1], len(law.axes), law.start, seed)
    return fronts.trials(before, fronts.generator(seed, number), search.keeps_ends)


MOST_CHECKED = 8
"""Largest number of points of a law that an estimate checks; a search checks all."""


@dataclass(frozen=True)
class Expected:
    """The expected size and duration of a search.

    Attributes
    ----------
    points
        Points of all generations of all searches.
    runs
        Largest number of runs, including those that judge the outcome.
    seconds
        Wall time, s; None if a moment of the horizon takes longer than an estimate may.
    workers
        Number of workers.
    """

    points: int
    runs: int
    seconds: float | None
    workers: int


def expected(search: Searches[Any], executor: Executor) -> Expected:
    """Estimate the cost of a search from part of the first points of each law."""
    workers, seconds, tried = 1, 0.0, 0
    share = PROBE_SECONDS / sum(len(search.in_cases(law)) for law in search.laws)
    for law in search.laws:
        first = search.first_points(law)
        tried += len(first)
        for case in search.in_cases(law).values():
            with working_for(law.label), reporter().busy(f"timing {law.label}"):
                points = study(swept(case, columns(law, first)), most_checked=MOST_CHECKED)
                estimated = estimate(points, executor, share)
            workers = max(workers, estimated.workers)
            if estimated.seconds is None:
                return Expected(search.points, search.all_runs, None, workers)
            groups = len(points) if points.is_ragged else 0
            seconds += estimated.seconds + SWEEP + groups * GROUP
    seconds *= search.points / tried * search.all_runs / search.searched_runs
    return Expected(search.points, search.all_runs, seconds, workers)


def columns(law: LawSearch, shares: Array) -> dict[str, list[float]]:
    """Return the values of each key at the points of a generation."""
    points = [law.values(row) for row in shares.tolist()]
    return expanded({key: [point[key] for point in points] for key in law.axes})


def swept(law: LawSearch, columns: dict[str, list[float]]) -> Document:
    """Return a sweep over listed points that stores only metrics and skips cross-checks."""
    data = law.document.data
    solver = dict(data.get("solver") or {})
    if "max_error" not in solver:
        solver.setdefault("error_estimate", False)
    changes: dict[str, Any] = {
        "sweep": [{"zip": columns} if columns else {"cases": {AS_IT_IS: {}}}, *law.rules],
        "store": {"trajectories": "none"},
        "solver": solver | {"cross_check": 0},
    }
    return replace(law.document, data=data | changes)


@dataclass(frozen=True, repr=False)
class Searched(InNotebook, os.PathLike[str]):
    """The outcome of a finished search. It is the path of its result, too.

    Attributes
    ----------
    search
        The search.
    judged
        Result of the runs that judge the outcome.
    record
        The record of the search, as its folder holds it.
    """

    search: Searches[Any]
    judged: Execution
    record: dict[str, Any]

    def __fspath__(self) -> str:
        return str(self.judged.folder.path)

    def answer(self) -> list[str]:
        """Return what was sought, and a line per law with the values that were found."""
        lines = [f"{self.search.kind.command} {self.record['name']}"]
        for record in self.records():
            numbers = ((key, value) for key, value in record.items() if isinstance(value, float))
            lines.append(f"{record['law']}: {', '.join(f'{k} {brief(x)}' for k, x in numbers)}")
        return lines

    def records(self) -> list[dict[str, Any]]:
        """Return a record per winner, or per worst run: law, values by key, objectives.

        Objectives of a tuning by runs are those of the runs that chose the values, which flatter
        them; its folder holds others.
        """
        names = self.record.get("objectives") or [self.record["objective"]]
        if proved := self.record.get("proved"):
            names = [proved["objective"]]
        elif self.search.kind.command == "tune":
            names = [f"{name}_in_search" for name in names]
        outcomes = [one for law in self.record["laws"] for one in law.get("winners", [law])]
        return [
            {"law": outcome["label"], **outcome["values"]}
            | dict(zip(names, outcome.get("objectives") or [outcome["value"]], strict=True))
            for outcome in outcomes
        ]


def carry_out(
    search: Searches[Any], out: Path, executor: Executor, *, force: bool = False
) -> Searched:
    """Carry out a search in a folder, reusing the generations that it already holds.

    Parameters
    ----------
    force
        Whether to start over.

    Raises
    ------
    EqtError
        If the folder holds something else, is in use, or cannot be written.
    """
    noted = remark_on(search.base) + search.remark_on_ends()
    folder = SearchFolder(out, search.kind, noted)
    folder.check(search.laws)
    with locked(out, name=f"{LOCK}-{search.kind.command}"):
        folder.claim(search.settings, force)
        with executor.opened(out) as opened, step(RUNS_DONE, search.all_runs):
            judged, outcome = search.conclude(folder, opened)
        record = search.settings | outcome
        folder.write_record(record)
    return Searched(search, judged, record)
