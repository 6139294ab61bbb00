"""The search for gains: the generations of each law, and then the held-out runs."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import cached_property, partial, reduce
from typing import Any

import numpy as np

from eqt_cli.execution.run_study import Execution
from eqt_cli.experiment.read_study import study
from eqt_cli.results.result import Result
from eqt_cli.tuning.evolution import Population, selected
from eqt_cli.tuning.folder import TUNE, SearchFolder, found_files
from eqt_cli.tuning.generations import Computing, evolve
from eqt_cli.tuning.law_search import LawSearch
from eqt_cli.tuning.ranking import Scores
from eqt_cli.tuning.scores import scores
from eqt_cli.tuning.search import Search, seeded, started


@dataclass(frozen=True)
class Tuned:
    """The outcome of the searches for a law.

    Attributes
    ----------
    law
        The search for the law.
    searches
        The last population of each search, by its seed.
    seeks_front
        Whether the winners are a front.
    """

    law: LawSearch
    searches: dict[int, Population]
    seeks_front: bool

    @cached_property
    def population(self) -> Population:
        """The survivors of all searches together."""
        return reduce(selected, self.searches.values())

    @cached_property
    def winners(self) -> tuple[int, ...]:
        """Indices of the best point or of the front; empty if no point is feasible."""
        return _winners(self.population, self.seeks_front)

    @cached_property
    def by_seed(self) -> dict[int, tuple[int, ...]]:
        """Winners of each search, by its seed."""
        return {seed: _winners(left, self.seeks_front) for seed, left in self.searches.items()}

    def values(self, point: int) -> dict[str, float]:
        """Return the values at a point, by key."""
        return self.law.values(self.population.shares[point].tolist())

    @property
    def chosen(self) -> list[dict[str, float]]:
        """Values of the winners."""
        return [self.values(point) for point in self.winners]

    @cached_property
    def labels(self) -> list[str]:
        """Labels of the winners in the confirmation; those of a front are numbered."""
        label = self.law.label
        return [f"{label} {k + 1}" if self.seeks_front else label for k in range(len(self.winners))]

    @cached_property
    def seed_labels(self) -> dict[int, str]:
        """Label in the confirmation of the winner of each search, by its seed.

        Empty for a front: only the front of all searches together is confirmed.
        """
        found: dict[int, str] = {}
        for seed, winners in self.by_seed.items():
            if winners and not self.seeks_front:
                best = self.searches[seed].shares[winners[0]]
                same = np.array_equal(best, self.population.shares[self.winners[0]])
                taken = self.law.label in found.values()
                found[seed] = self.law.label if same and not taken else seeded(self.law.label, seed)
        return found

    @property
    def confirmed(self) -> dict[str, dict[str, float]]:
        """Values of all tuned laws in the confirmation, by label: the winners first."""
        found = dict(zip(self.labels, self.chosen, strict=True))
        for seed, label in self.seed_labels.items():
            shares = self.searches[seed].shares[self.by_seed[seed][0]]
            found.setdefault(label, self.law.values(shares.tolist()))
        return found

    @property
    def least_violation(self) -> float:
        """Smallest violation of any surviving point; 0 if one is feasible."""
        return float(self.population.scores.violation.min())


def tune(search: Search, folder: SearchFolder, do: Computing) -> tuple[Execution, dict[str, Any]]:
    """Search for the best gains of each law, and run the winners on held-out initial states."""
    found = []
    for law in search.laws:

        def after(searches: dict[int, Population], law: LawSearch = law) -> None:
            so_far = Tuned(law, searches, search.seeks_front)
            studies = [study(law.at(values), trust_plugins=True) for values in so_far.chosen]
            folder.write_found(law, studies, search.seeks_front)

        searches = evolve(search, law, folder, do, partial(_scored, search), after)
        found.append(Tuned(law, searches, search.seeks_front))
    chosen = {each.law.label: each.confirmed for each in found}
    confirmed = do.execute(search.confirmation(chosen), folder.path)
    return confirmed, {
        "objectives": list(search.objectives),
        "cases": list(search.cases),
        "over_cases": search.section.over_cases or "mean",
        "constraints": [asdict(bound) for bound in search.constraints],
        "laws": [_law_record(search, each) for each in found],
    }


def _scored(search: Search, result: Result) -> Scores:
    return scores(result, search.objectives, search.constraints)


def _winners(population: Population, seeks_front: bool) -> tuple[int, ...]:
    if seeks_front:
        return tuple(population.front.tolist())
    best = population.best
    return (best,) if population.scores.feasible[best] else ()


def _law_record(search: Search, found: Tuned) -> dict[str, Any]:
    scored = found.population.scores
    return {
        "label": found.law.label,
        "over": {key: [axis.low, axis.high] for key, axis in found.law.axes.items()},
        "start": started(found.law.label),
        "least_violation": found.least_violation,
        "winners": [
            {
                "label": label,
                "config": name,
                "values": found.values(point),
                "objectives": scored.objectives[point].tolist(),
                "unsettled": int(scored.unsettled[point]),
            }
            for point, label, name in zip(
                found.winners,
                found.labels,
                found_files(TUNE, found.law, len(found.winners), search.seeks_front),
                strict=True,
            )
        ],
        "searches": [
            {
                "seed": seed,
                "label": found.seed_labels.get(seed),
                "objectives": left.scores.objectives[list(found.by_seed[seed])].tolist(),
            }
            for seed, left in found.searches.items()
        ],
    }
