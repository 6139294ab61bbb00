"""Common base of the searches: reads the section, and counts generations and runs."""

import json
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Any, ClassVar, Generic, Self, TypeVar

from eqt_cli.config.schema import SearchSection
from eqt_cli.config.source import ConfigSource
from eqt_cli.core.errors import EqtError, Problems
from eqt_cli.ensemble.axes import DrawnRange
from eqt_cli.execution.executors import Executor
from eqt_cli.execution.run_study import Execution
from eqt_cli.experiment.build import build
from eqt_cli.experiment.experiment import Experiment
from eqt_cli.results.result import Result
from eqt_cli.tuning.evolution import Population
from eqt_cli.tuning.folder import Kind, SearchFolder
from eqt_cli.tuning.law_search import LawSearch, check_ends, check_overlaps, laws_of, range_of
from eqt_cli.tuning.ranking import Scores

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
    def read(cls, source: ConfigSource, *, trust_plugins: bool = False) -> Self:
        """Read and check the section of a configuration.

        Raises
        ------
        ConfigError
            With every problem, each at its place.
        EqtError
            If it has no such section.
        """
        name = cls.kind.command
        if not source.data.get(name):
            raise EqtError(
                f"{source.source.name}: has no section `{name}`; add one, such as "
                f"{name}: {cls.example}"
            )
        if source.data.get("sweep"):
            place = source.place(("sweep",))
            raise EqtError(f"{place}: eqt {name} searches around one point; leave `sweep` out")
        base = build(source, trust_plugins=trust_plugins)
        section = getattr(base.config, name)
        problems = Problems(source.place)
        here = problems.at(name)
        ranges: dict[str, DrawnRange] = {}
        for key, given in section.over.items():
            at_key = here.at("over", key)
            axis = range_of(given, at_key)
            with at_key.catching():
                varied = cls._axis(key, axis, base)
                ranges |= {key: varied} if varied else {}
        cls._check(section, base, here)
        problems.raise_if_any()
        laws = laws_of(base, ranges)
        for law in laws:
            if not law.axes:
                here.at("over").add(
                    f"has no key of controller '{law.label}'; add one that all laws share, or "
                    "leave the controller out"
                )
        check_overlaps(laws, here.at("over"))
        problems.raise_if_any()
        search = cls(base, section, laws)
        for law in laws:
            for name, case in search.in_cases(law).items():
                check_ends(case, here.at("over"), f"in case '{name}', " if name else "")
        problems.raise_if_any()
        return search

    @classmethod
    @abstractmethod
    def _axis(cls, key: str, axis: DrawnRange | None, base: Experiment) -> DrawnRange | None:
        """Return the range of a key (None if it was invalid); `InputError` if it cannot vary."""

    @classmethod
    @abstractmethod
    def _check(cls, section: S, base: Experiment, problems: Problems) -> None:
        """Note the other problems of the section."""

    @property
    def folder(self) -> Path:
        """Default result folder."""
        return Path("results") / f"{self.base.name}-{self.kind.found}"

    def in_cases(self, law: LawSearch) -> dict[str, LawSearch]:
        """Return the search for a law in each case by name; without cases, one named ''."""
        return {"": law}

    def over_cases(self, cases: Sequence[Scores]) -> Scores:
        """Combine the scores of the same points in all cases."""
        (only,) = cases
        return only

    @abstractmethod
    def scores(self, result: Result) -> Scores:
        """Return the scores of all points of a sweep with one law."""

    @abstractmethod
    def so_far(self, law: LawSearch, population: Population) -> str:
        """Describe the best point of a law so far."""

    def keep(self, law: LawSearch, searches: dict[int, Population], folder: SearchFolder) -> None:
        """Write what the searches for a law, by seed, have found so far; here nothing."""

    @abstractmethod
    def conclude(self, folder: SearchFolder, executor: Executor) -> Outcome:
        """Search for every law, and judge what was found."""

    @property
    def seeds(self) -> range:
        """Seeds of the searches for each law."""
        return range(self.section.seed, self.section.seed + self.section.seeds)

    @property
    def all_generations(self) -> int:
        """Number of generations of all searches for one law."""
        return len(self.seeds) * self.section.budget

    @property
    def runs_at_a_point(self) -> int:
        """Number of runs that score a point."""
        return self.base.config.ensemble.runs

    @property
    def searched_runs(self) -> int:
        """Number of runs of all laws and generations."""
        each = self.all_generations * self.section.population
        return len(self.laws) * each * self.runs_at_a_point

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
        return {
            "name": self.base.name,
            "digest": self.digest,
            "generations": self.section.budget,
            "population": self.section.population,
            "runs": self.base.config.ensemble.runs,
            "seeds": list(self.seeds),
        }

    @cached_property
    def digest(self) -> str:
        """Hash of everything that decides the points of a generation, whatever their number."""
        section = self.section.model_dump(exclude=set(self.continuing), warnings="none")
        ordered = json.dumps(section)  # keeps the order of cases and keys
        text = json.dumps([self.base.numeric_config, ordered], sort_keys=True)
        return sha256(text.encode()).hexdigest()
