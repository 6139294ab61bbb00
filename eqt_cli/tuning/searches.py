"""What every search has in common: how its section is read, and how long it searches."""

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
from eqt_cli.core.errors import EqtError
from eqt_cli.core.problems import Problems
from eqt_cli.ensemble.axes import DrawnRange
from eqt_cli.experiment.build import build
from eqt_cli.experiment.experiment import Experiment
from eqt_cli.tuning.evolution import Population
from eqt_cli.tuning.folder import Kind
from eqt_cli.tuning.law_search import LawSearch, check_ends, check_overlaps, laws_of, range_of
from eqt_cli.tuning.ranking import Scores

S = TypeVar("S", bound=SearchSection)


@dataclass(frozen=True)
class Searches(ABC, Generic[S]):
    """Searches for each law of an experiment, as many and as long for every law.

    Attributes
    ----------
    kind
        What is searched for.
    example
        Of the section that asks for it.
    continuing
        The keys of the section that change no generation, but which of them there are.
    keeps_ends
        Whether values beyond an end of a range become that end, where the worst often is; else they
        are drawn anew.
    base
        The experiment with all laws.
    section
        The section that asks for it.
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
        """Read and check what a configuration wants to be searched.

        Raises
        ------
        ConfigError
            With every problem, each at its place.
        EqtError
            If it wants no such search.
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
        found = cls(base, section, laws)
        for law in laws:
            for name, case in found.in_cases(law).items():
                check_ends(case, here.at("over"), f"in case '{name}', " if name else "")
        problems.raise_if_any()
        return found

    @classmethod
    @abstractmethod
    def _axis(cls, key: str, axis: DrawnRange | None, base: Experiment) -> DrawnRange | None:
        """The range of a key, if it was understood; raises an `InputError` if it may not vary."""

    @classmethod
    @abstractmethod
    def _check(cls, section: S, base: Experiment, problems: Problems) -> None:
        """Note what else is wrong with the section."""

    @property
    def name(self) -> str:
        """Of the experiment."""
        return self.base.name

    @property
    def folder(self) -> Path:
        """Where it keeps its results unless it is told."""
        return Path("results") / f"{self.name}-{self.kind.found}"

    def in_cases(self, law: LawSearch) -> dict[str, LawSearch]:
        """The search for a law in each case, by its name; one without a name if there are none."""
        return {"": law}

    def over_cases(self, cases: Sequence[Scores]) -> Scores:
        """The scores of points over all cases."""
        (only,) = cases
        return only

    @abstractmethod
    def so_far(self, law: LawSearch, population: Population) -> str:
        """What was found of a law so far, in words."""

    @property
    def seeds(self) -> range:
        """Of the searches for each law."""
        return range(self.section.seed, self.section.seed + self.section.seeds)

    @property
    def all_generations(self) -> int:
        """Of all searches for one law."""
        return len(self.seeds) * self.section.budget

    @property
    def runs_at_a_point(self) -> int:
        """By which it is scored."""
        return self.base.config.ensemble.runs

    @property
    def searched_runs(self) -> int:
        """Over all laws and generations."""
        each = self.all_generations * self.section.population
        return len(self.laws) * each * self.runs_at_a_point

    @property
    @abstractmethod
    def judging_runs(self) -> int:
        """By which the outcome is judged, at the most."""

    @property
    def all_runs(self) -> int:
        """Of the search, and by which its outcome is judged."""
        return self.searched_runs + self.judging_runs

    @property
    def settings(self) -> dict[str, Any]:
        """How long it searches, as plain data."""
        return {
            "name": self.name,
            "digest": self.digest,
            "generations": self.section.budget,
            "population": self.section.population,
            "runs": self.base.config.ensemble.runs,
            "seeds": list(self.seeds),
        }

    @cached_property
    def digest(self) -> str:
        """Hash of all that decides where a generation looks, but for how many there are."""
        section = self.section.model_dump(exclude=set(self.continuing), warnings="none")
        ordered = json.dumps(section)  # of cases and keys, too
        text = json.dumps([self.base.numeric_config, ordered], sort_keys=True)
        return sha256(text.encode()).hexdigest()
