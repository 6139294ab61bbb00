"""The search for gains: the generations of each law, and then the held-out runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, reduce
from typing import Any

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import ConfigError, InputError, Problems, parse_key
from eqt_cli.base.extensions import functions_for
from eqt_cli.base.option_types import shown
from eqt_cli.base.reporting import brief, count_of
from eqt_cli.config.designs import Cases
from eqt_cli.config.document import Document, changed_at, entries_of
from eqt_cli.config.experiment import Experiment
from eqt_cli.config.preflight import build
from eqt_cli.config.schema import without_search
from eqt_cli.config.study import require_sweepable, section_of, study
from eqt_cli.extensions.search import law_search
from eqt_cli.extensions.search.exchanges import (
    FEWEST_EXCHANGING,
    enough,
    is_small,
    more_of,
    rounds_of,
)
from eqt_cli.extensions.search.fronts import Constraint, Population, Scores, scores, selected
from eqt_cli.extensions.search.keys import TuneSection, WorstRunSection
from eqt_cli.extensions.search.law_search import LawSearch, SearchFolder, TunedRange
from eqt_cli.extensions.search.model_search import Best, ModelSearch, Tried
from eqt_cli.extensions.search.record import AS_IT_IS, TUNE, values_text
from eqt_cli.extensions.search.run_numbers import Numbers
from eqt_cli.extensions.search.search import Outcome, Searches, compute, evolve
from eqt_cli.extensions.search.training import Fixed, Training, trained
from eqt_cli.results.metrics import quantity_of
from eqt_cli.results.result import Result
from eqt_cli.runs.executors import Executor

MOST_TRAJECTORIES = 50
"""Trajectories of each law that the confirmation stores unless the configuration sets the number.
The confirmation of a front stores none, because it has too many laws."""


class Search(Searches[TuneSection]):
    """A search for gains, checked: the section `tune`."""

    kind = TUNE
    example = "{over: {gains.kp: {log: [0.1, 10]}}, objective: mean_pose_error}"
    continuing = frozenset({"budget", "samples", "seeds", "confirm"})

    @cached_property
    def objectives(self) -> tuple[str, ...]:
        """The metrics to optimise; of gains that are proved, the one to measure."""
        return ("mean_pose_error",) if prover_of(self.section) else _objective_names(self.section)

    @cached_property
    def bounds(self) -> tuple[Constraint, ...]:
        """The bounds of metrics, those that have to be met first, by their names."""
        bounds = []
        section = self.section
        if prover_of(section):
            return ()
        for name, value in sorted(section.equal.items()):
            bounds.append(Constraint(name, float(value), _is_upper(name), False, equal=True))
        for name, bound in sorted(section.subject_to.items()):
            if name == FAILED:
                continue
            if not isinstance(bound, WorstRunSection):
                bounds.append(Constraint(name, float(bound), _is_upper(name), every_run=False))
                continue
            for limit, is_upper in ((bound.max, True), (bound.min, False)):
                if limit is not None:
                    bounds.append(Constraint(name, limit, is_upper, every_run=True))
        return tuple(bounds)

    @property
    def allowed(self) -> float:
        """Largest share of failed runs."""
        bound: Any = self.section.subject_to.get(FAILED, 0.0)
        return float(bound)

    @property
    def samples(self) -> range:
        """Numbers of the training samples."""
        return range(1, 1 + (0 if prover_of(self.section) else self.section.samples))

    @property
    def budget(self) -> int:
        """Largest number of points for each law, and each sample or seed."""
        return self.section.budget or (1280 if self.seeks_front else 100)

    @property
    def evolution(self) -> tuple[int, int, range]:
        """Number of generations, points of each, and seeds of the searches for each law."""
        first, section = self.section.seed or 0, self.section
        if prover_of(section):
            return 0, 1, range(1)
        population = section.population or 32
        seeds = range(first, first + (section.seeds or 3))
        return max(1, self.budget // population), population, seeds

    @property
    def points(self) -> int:
        """Largest number of points of all searches for all laws."""
        if self.seeks_front:
            return super().points
        searched = self.budget + self.exchanges * more_of(self.budget)
        points = sum(searched * law.contained if law.axes else 1 for law in self.laws)
        return points * len(self.samples)

    @property
    def exchanges(self) -> int:
        """How often the samples of a law exchange their best points at most."""
        return rounds_of(self.budget) if len(self.samples) >= FEWEST_EXCHANGING else 0

    @property
    def size(self) -> list[str]:
        """The factors of `points`, in words."""
        if self.seeks_front:
            return super().size
        fixed = sum(not law.axes for law in self.laws)
        return [
            count_of(len(self.laws) - fixed, "law"),
            count_of(len(self.samples), "training sample"),
            f"at most {self.most_points}"
            + (f", and {count_of(fixed, 'law')} {AS_IT_IS}" if fixed else ""),
        ]

    def remarks(self) -> list[str]:
        """Say of which laws the budget is too small for their numbers."""
        if self.seeks_front or prover_of(self.section):
            return []
        return [
            f"tune.budget {self.budget} is small for {count_of(len(law.axes), 'number')} of "
            f"{law.label}: searches were measured with {enough(len(law.axes))}"
            for law in self.laws
            if law.axes and is_small(self.budget, len(law.axes))
        ]

    @property
    def most_points(self) -> str:
        """The largest number of points of a search, and of what exchanges add to it."""
        if not self.exchanges:
            return count_of(self.budget, "point")
        added = f"{self.exchanges} × {more_of(self.budget)} after exchanges between the samples"
        return f"({self.budget} points + {added})"

    @property
    def settings(self) -> dict[str, Any]:
        """The size of the search, for its record."""
        if self.seeks_front or prover_of(self.section):
            return super().settings
        return self.identity | {"budget": self.budget, "samples": len(self.samples)}

    def by_models(
        self,
        law: LawSearch,
        sample: int,
        free: Sequence[int] | None = None,
        tried: Tried | None = None,
    ) -> ModelSearch | Fixed:
        """Return the search for a law on a training sample.

        Parameters
        ----------
        free
            The coordinates that are searched; at the others, the law is one without these numbers.
        tried
            What was tried of laws that it contains.
        """
        if not law.axes:
            return Fixed()
        free = range(len(law.axes)) if free is None else free
        within = Training(law, sample, tuple(free))
        start = None if law.start is None else [law.start[k] for k in free]
        also = [[0.0]] if len(free) == 1 and free[0] in law.optional else []
        about = (self.bounds, self.allowed, sample - 1, start, within.snapped, also, tried)
        return ModelSearch(len(free), self.budget, *about)

    def on_sample(self, document: Document, sample: int) -> Document:
        """Return an experiment with the runs of a training sample."""
        ensemble = dict(document.data.get("ensemble") or {})
        seed = self.base.config.ensemble.seed + sample - 1
        return replace(document, data=document.data | {"ensemble": ensemble | {"seed": seed}})

    def first_points(self, law: LawSearch) -> Array:
        """Return the points that all searches for a law try first, ``(points, dimensions)``."""
        if self.seeks_front:
            return super().first_points(law)
        return next(self.by_models(law, 1).points())

    @property
    def seeks_front(self) -> bool:
        """Whether there are two objectives, so that a law can have several winners."""
        return len(self.objectives) > 1

    def in_cases(self, law: LawSearch) -> dict[str, LawSearch]:
        cases = {
            name: replace(law, document=_in_case(law.document, name, settings))
            for name, settings in (self.section.cases or {}).items()
        }
        return cases or super().in_cases(law)

    def over_cases(self, cases: Sequence[Scores]) -> Scores:
        return Scores.over_cases(cases, worst=self.section.over_cases == "worst")

    @property
    def judging_runs(self) -> int:
        """Largest number of held-out runs of all winners and starting gains."""
        section = self.section
        winners = self.evolution[1] if self.seeks_front else max(1, len(self.samples))
        held_out = section.confirm.runs * len(self.in_cases(self.laws[0]))
        return len(self.laws) * (winners + 1) * held_out

    def confirmation(self, chosen: dict[str, dict[str, dict[str, float]]]) -> Document:
        """Return the experiment of the winners and the starting gains on held-out initial states.

        Parameters
        ----------
        chosen
            Values by key, by the label in the confirmation, by law.
        """
        tuned = [
            _entry(law.at(values).data, label)
            for law in self.laws
            for label, values in chosen[law.label].items()
        ]
        starts = [_entry(law.document.data, started(law)) for law in self.laws if law.axes]
        data = self.base.document.data
        runs = self.section.confirm.runs
        seed = confirming_seed(self.section, self.base.config.ensemble.seed)
        ensemble = {"runs": runs, "seed": seed}
        store = dict(data.get("store") or {})
        few = "none" if self.seeks_front else min(MOST_TRAJECTORIES, runs)
        store.setdefault("trajectories", few)
        changes = {"controllers": [*tuned, *starts], "ensemble": ensemble, "store": store}
        changes |= {"sweep": [{"cases": cases}]} if (cases := self.section.cases) else {}
        return replace(self.base.document, data=without_search(data) | changes)

    def so_far(self, law: LawSearch, population: Population) -> str:
        """Describe the best point of a law so far."""
        best, scored = population.best, population.scores
        if not scored.feasible[best]:
            return f"no feasible point so far, least violation {scored.violation[best]:.3g}"
        values = values_text(law.values(population.shares[best].tolist()))
        cost = quantity_of(self.objectives[0]).cost(scored.objectives[best, 0])
        front = f", {len(population.front)} on the front" if self.seeks_front else ""
        return f"best so far: {self.objectives[0]} {brief(cost)} at {values}{front}"

    @property
    def scored_metrics(self) -> list[str]:
        return [*self.objectives, *(bound.metric for bound in self.bounds)]

    def scores(self, result: Result | Numbers) -> Scores:
        return scores(result, self.objectives, self.bounds, self.allowed)

    def conclude(self, folder: SearchFolder, executor: Executor) -> Outcome:
        """Search for the best gains of each law, and run the winners on held-out initial states."""
        tuned = self._tuned(folder, executor)
        chosen = {of_law.law.label: of_law.confirmed for of_law in tuned}
        confirmed = compute(self.confirmation(chosen), folder.path, executor, folder.remarks)
        prover = prover_of(self.section)
        best = {x.law.label: x.best for x in tuned if isinstance(x, Tuned)}
        proved = {"proved": prover.record(best)} if prover else {}
        return confirmed, proved | {
            "objectives": list(self.objectives),
            "cases": list(self.section.cases or {}),
            "over_cases": self.section.over_cases or "mean",
            "constraints": [asdict(bound) for bound in self.bounds],
            "allowed": self.allowed,
            "laws": [of_law.record() for of_law in tuned],
        }

    def _tuned(self, folder: SearchFolder, executor: Executor) -> list[Tuned | Sampled]:
        if prover := prover_of(self.section):
            return [self._proved(prover, law, folder) for law in self.laws]
        if self.seeks_front:
            return [self._front(law, folder, executor) for law in self.laws]
        best, sampled = trained(self, folder, executor), list[Tuned | Sampled]()
        for law in self.laws:
            of_law = {key.sample: one for key, one in best.items() if key.law is law}
            sampled.append(one := Sampled(self, law, of_law))
            if one.winner is not None:
                values = one.confirmed[law.label]
                folder.write_configs(law, [study(law.at(values))])
        return sampled

    def _front(self, law: LawSearch, folder: SearchFolder, executor: Executor) -> Tuned:
        tuned = Tuned(law, evolve(self, law, folder, executor), True)
        studies = [study(law.at(tuned.values(point))) for point in tuned.winners.values()]
        folder.write_configs(law, studies, numbered=True)
        return tuned

    def _proved(self, prover: Any, law: LawSearch, folder: SearchFolder) -> Tuned:
        best = prover.gains(law, self.section, self.base)
        if best["values"]:
            winner = study(law.at(best["values"]))
            folder.write_configs(law, [winner], comment=f"# {best['sentence']}\n")
        numbers, none = np.array([best.get("objectives", [np.nan])]), np.zeros(1)
        scores = Scores(numbers, none + (not best["values"]), none, none)
        return Tuned(law, {0: Population(np.zeros((1, len(law.axes))), scores)}, False, best)

    @classmethod
    def _axis(cls, key: str, axis: TunedRange | None, base: Experiment) -> TunedRange | None:
        """Return the range of a key that belongs to the laws."""
        path = parse_key(entries_of(key)[0])
        if path[0] == "gains" and len(path) > 1:
            return axis
        if path[0] != "controllers":
            raise InputError(
                "expected a key of gains or controllers; all other keys define the task, which is "
                "the same for all laws"
            )
        count = len(base.loops)
        if len(path) < 3 or not isinstance(path[1], int) or path[1] >= count:
            raise InputError(
                f"expected an option of one of the {count} controllers, as controllers[0].gains.kp"
            )
        return axis

    @classmethod
    def _takes_fixed(cls, section: TuneSection) -> bool:
        return section.objectives is None and not prover_of(section)

    @classmethod
    def _check(cls, section: TuneSection, base: Experiment, problems: Problems) -> None:
        prover = prover_of(section)
        if prover:
            prover.check(section, base, problems)
        _check_size(section, problems, proves=bool(prover))
        for experiment in [base, *_build_cases(section, base, problems)]:
            _check_objectives(section, experiment, problems)
            if not prover:
                _check_metrics(section, experiment, problems)
            if experiment.config.initial.file is not None:
                problems.add(
                    "initial.file sets the states of all runs, so none can be held out; draw them"
                )
        if not prover:
            _check_bounds(section, problems)
        first, seed = base.config.ensemble.seed, section.confirm.seed
        held_out = {"runs": section.confirm.runs, "seed": confirming_seed(section, first)}
        here = problems.at("confirm", "seed")
        law_search.refuse_runs_of_training(base, here, "tune.confirm.seed", held_out)
        last = first if prover or section.objectives else first + section.samples - 1
        if seed is not None and first <= seed <= last:
            trained = (
                f"{first} to {last} of the training samples" if last > first else "ensemble.seed"
            )
            problems.at("confirm", "seed").add(
                f"expected a seed other than {trained}, got {seed}; held-out runs must differ from "
                "the runs of the search"
            )


def confirming_seed(section: TuneSection, first: int) -> int:
    """Return the seed of the held-out runs: by default the first one after the samples."""
    samples = 1 if prover_of(section) else section.samples
    return first + samples if section.confirm.seed is None else section.confirm.seed


FAILED = "failed"
"""Name of the share of failed runs among bounds."""

OF_FRONTS = ("population", "seeds", "seed")
"""Keys that only the search for a front reads."""


def _is_upper(name: str) -> bool:
    return quantity_of(name).better != "higher"


def _check_metrics(section: TuneSection, experiment: Experiment, problems: Problems) -> None:
    """Note bounds of metrics that are not stored."""
    bounded = [("subject_to", name) for name in section.subject_to if name != FAILED]
    for place in (*bounded, *(("equal", name) for name in section.equal)):
        with problems.catching(*place):
            law_search.require_metric(place[1], experiment)


def _check_bounds(section: TuneSection, problems: Problems) -> None:
    """Note bounds without a number, and those that cannot hold."""
    for name, bound in section.subject_to.items():
        at, is_mean = problems.at("subject_to", name), not isinstance(bound, WorstRunSection)
        if name == FAILED:
            if isinstance(bound, WorstRunSection) or not 0 <= bound < 1:
                at.add(f"expected a share of the runs, from 0 to below 1, got {shown(bound)}")
        elif isinstance(bound, WorstRunSection) and bound.max is None and bound.min is None:
            at.add("expected `max` or `min`, got neither")
        elif is_mean and name in section.equal:
            at.add(f"is in `equal`, too; leave {name} out here")


def _check_size(section: TuneSection, problems: Problems, *, proves: bool) -> None:
    """Note keys of another kind of search."""
    is_front = section.objectives is not None
    if section.equal and (is_front or proves):
        why = "a front has laws at every cost" if is_front else "a proof takes no runs"
        problems.at("equal").add(f"{why}; leave it out")
    if is_front and "samples" in section.model_fields_set:
        problems.at("samples").add("a front is searched on one training sample; leave it out")
    for name in OF_FRONTS:
        if not is_front and getattr(section, name) is not None:
            problems.at(name).add(
                "belongs to the search for a front (`objectives`); the search for one objective "
                "has `samples`, and `budget` is its largest number of points"
            )


def started(law: LawSearch) -> str:
    """Return the label of a law at its starting gains; its own if it stays as it is."""
    return f"{law.label}, start" if law.axes else law.label


OF_LAWS = {
    "gains": "belongs to the laws, and is tuned by `over`",
    "controllers": "belongs to the laws, and is tuned by `over`",
    "ensemble": "is set by the search and by `confirm`",
}
"""Sections that cases cannot change, with the reasons."""


def _build_cases(section: TuneSection, base: Experiment, problems: Problems) -> list[Experiment]:
    """Build the experiment with all laws in each case, and note the problems of the cases."""
    if section.cases is None:
        if section.over_cases is not None:
            problems.at("over_cases").add("there are no cases; add `cases`, or leave it out")
        return []
    here = problems.at("cases")
    _check_cases(section.cases, here)
    if here:
        return []
    cases = []
    for name, settings in section.cases.items():
        try:
            cases.append(build(_in_case(base.document, name, settings)))
        except ConfigError as error:
            for problem in error.problems:
                here.at(name).add(f"{problem.path}: {problem.message}")
    return cases


def _check_cases(cases: dict[str, Any], problems: Problems) -> None:
    """Note names of cases that are wrong, and keys that no case can change."""
    Cases.read(cases, problems)
    if problems:
        return
    for name, settings in cases.items():
        for key in settings:
            with problems.catching(name, key):
                require_sweepable(key)
                if reason := OF_LAWS.get(section_of(key)):
                    raise InputError(f"no case can change it: {section_of(key)} {reason}")


def _in_case(document: Document, case: str, settings: dict[str, Any]) -> Document:
    """Return a configuration with the settings of a case."""
    for key, value in settings.items():
        place = document.place(("tune", "cases", case, key))
        document = changed_at(document, parse_key(key), value, place)
    return document


def _objective_names(section: TuneSection) -> tuple[str, ...]:
    return tuple(section.objectives or (str(section.objective),))


def prover_of(section: TuneSection) -> Any:
    """Return what finds gains by proofs, without runs; None if the objective is a metric."""
    provers = functions_for(purposes.proved_objective, key=str(section.objective))
    return next((prover() for prover in provers), None)


def _check_objectives(section: TuneSection, base: Experiment, problems: Problems) -> None:
    several = section.objectives
    if (section.objective is None) == (several is None):
        problems.add("expected either `objective`, a metric, or `objectives`, two of them")
    elif several is not None and (len(several) != 2 or several[0] == several[1]):
        problems.at("objectives").add(f"expected two different metrics, got {shown(several)}")
    else:
        for index, name in enumerate(() if prover_of(section) else _objective_names(section)):
            with problems.catching(*(("objectives", index) if several else ("objective",))):
                law_search.require_metric(name, base)


def _entry(data: dict[str, Any], label: str) -> dict[str, Any]:
    """Return the only law of a configuration with its gains, under another label."""
    law = data["controllers"][0]
    gains = law.get("gains") or data.get("gains")  # none where no law reads them
    return law | ({"gains": dict(gains)} if gains else {}) | {"label": label}


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
    best
        What is recorded of gains that a proof found: their `values`, or `why` there are none.
    """

    law: LawSearch
    searches: dict[int, Population]
    seeks_front: bool
    best: dict[str, Any] = field(default_factory=dict)

    @cached_property
    def population(self) -> Population:
        """The survivors of all searches together."""
        return reduce(selected, self.searches.values())

    @cached_property
    def winners(self) -> dict[str, int]:
        """Index of the best point, or of those on the front, by the label in the confirmation.

        Those of a front are numbered. It is empty if no point is feasible.
        """
        label, is_front = self.law.label, self.seeks_front
        points = enumerate(_winners(self.population, is_front), start=1)
        return {f"{label} {number}" if is_front else label: point for number, point in points}

    @cached_property
    def by_seed(self) -> dict[int, tuple[int, ...]]:
        """Winners of each search, by its seed."""
        return {seed: _winners(left, self.seeks_front) for seed, left in self.searches.items()}

    def values(self, point: int) -> dict[str, float]:
        """Return the values at a point, by key."""
        if self.best:
            return dict(self.best["values"])
        return self.law.values(self.population.shares[point].tolist())

    @cached_property
    def seed_labels(self) -> dict[int, str]:
        """Label in the confirmation of the winner of each search, by its seed.

        Empty for a front: only the front of all searches together is confirmed.
        """
        names: dict[int, str] = {}
        label = self.law.label
        for seed, winners in self.by_seed.items():
            if winners and not self.seeks_front:
                best = self.searches[seed].shares[winners[0]]
                same = np.array_equal(best, self.population.shares[self.winners[label]])
                is_best = same and label not in names.values()
                names[seed] = label if is_best else f"{label}, seed {seed}"
        return names

    @property
    def confirmed(self) -> dict[str, dict[str, float]]:
        """Values of all tuned laws in the confirmation, by label: the winners first."""
        confirmed = {label: self.values(point) for label, point in self.winners.items()}
        for seed, label in self.seed_labels.items():
            shares = self.searches[seed].shares[self.by_seed[seed][0]]
            confirmed.setdefault(label, self.law.values(shares.tolist()))
        return confirmed

    def record(self) -> dict[str, Any]:
        """Return the winners and the searches for the record of the search."""
        law, scored = self.law, self.population.scores
        configs = law_search.config_files(TUNE, law, len(self.winners), self.seeks_front)
        return {
            "label": law.label,
            "over": {key: [axis.low, axis.high] for key, axis in law.axes.items()},
            "start": started(law),
            "least_violation": float(scored.violation.min()),  # 0 if a point is feasible
            "why": self.best.get("why"),
            "winners": [
                self.best
                | {
                    "label": label,
                    "config": name,
                    "values": self.values(point),
                    "objectives": scored.objectives[point].tolist(),
                    "unsettled": int(scored.unsettled[point]),
                }
                for (label, point), name in zip(self.winners.items(), configs, strict=True)
            ],
            "searches": [
                {
                    "seed": seed,
                    "label": self.seed_labels.get(seed),
                    "objectives": left.scores.objectives[list(self.by_seed[seed])].tolist(),
                }
                for seed, left in self.searches.items()
            ],
        }


@dataclass(frozen=True)
class Sampled:
    """A law that was tuned on several training samples.

    Attributes
    ----------
    law
        The search for the law.
    best
        What was found on each sample, by its number.
    """

    search: Search
    law: LawSearch
    best: dict[int, Best]

    @cached_property
    def winner(self) -> int | None:
        """The sample with the middle objective of those with gains; None if no sample has any.

        Its gains are those of the law: a sample with hard starts, or with easy ones, has others.
        """
        costs = {
            sample: float(best.tried.costs[best.point])
            for sample, best in self.best.items()
            if best.point is not None
        }
        ordered = sorted(costs, key=costs.__getitem__)
        return ordered[(len(ordered) - 1) // 2] if ordered else None

    def label(self, sample: int) -> str | None:
        """Return the label in the confirmation of the gains of a sample; None if it has none."""
        if self.best[sample].point is None:
            return None
        label = self.law.label
        is_own = sample == self.winner or not self.law.axes
        return label if is_own else f"{label}, sample {sample}"

    def values(self, sample: int) -> dict[str, float]:
        """Return the values that were found on a sample, by key."""
        best = self.best[sample]
        return self.law.values(best.tried.shares[best.point].tolist())

    @property
    def confirmed(self) -> dict[str, dict[str, float]]:
        """Values of all tuned laws in the confirmation, by label: the winner first."""
        there = [sample for sample in self.best if self.label(sample) is not None]
        there.sort(key=lambda sample: sample != self.winner)
        return {str(self.label(sample)): self.values(sample) for sample in there}

    def record(self) -> dict[str, Any]:
        """Return the winner, and what was found on each sample, for the record of the search."""
        law, searches = self.law, [self._searched(sample) for sample in self.best]
        won = [one for one in searches if one["sample"] == self.winner]
        config = law_search.config_files(TUNE, law, 1)[0]
        return {
            "label": law.label,
            "over": {key: [axis.low, axis.high] for key, axis in law.axes.items()},
            "start": started(law),
            "why": None if won else self._why(),
            "winners": [
                one | {"config": config, "objectives": one["objectives"][0]} for one in won
            ],
            "searches": searches,
        }

    def _searched(self, sample: int) -> dict[str, Any]:
        best = self.best[sample]
        tried, at = best.tried, best.point
        gains: dict[str, Any] = {"label": None, "objectives": []}
        if at is not None:
            gains = {
                "label": self.label(sample),
                "values": self.values(sample),
                "units": self.law.units(self.values(sample)),
                "objectives": [[float(tried.costs[at])]],
                "measured": tried.measured[at].tolist(),
                "failed": float(tried.lost[at]),
                "unsettled": int(tried.unsettled[at]),
            }
        seed = self.search.base.config.ensemble.seed + sample - 1
        how = {"points": len(tried), "ended": best.ended, "gained": best.gained}
        return gains | {"sample": sample, "seed": seed} | how

    def _why(self) -> str:
        """Say what no point keeps, of the nearest one of all samples."""
        nearest = []
        for best in self.best.values():
            over = np.maximum(np.nan_to_num(best.tried.excess(self.search.bounds), nan=1.0), 0)
            lost = np.maximum(best.tried.lost - self.search.allowed, 0)
            nearest.append((over.sum(axis=1) + lost, over, best.tried))
        violation, over, tried = min(nearest, key=lambda attempt: float(attempt[0].min()))
        at = int(violation.argmin())
        words = [
            f"{bound.metric} is at best {tried.measured[at, k]:.4g}, and {bound} was asked for"
            for k, bound in enumerate(self.search.bounds)
            if over[at, k] > 0
        ]
        if tried.lost[at] > self.search.allowed:
            share = f"{100 * tried.lost[at]:.3g} % of the runs fail or lack a number"
            words.insert(0, f"at best {share}; tune.subject_to.{FAILED} allows a share of them")
        return "; ".join(words) or "no point has a number"


def _winners(population: Population, seeks_front: bool) -> tuple[int, ...]:
    if seeks_front:
        return tuple(population.front.tolist())
    best = population.best
    return (best,) if population.scores.feasible[best] else ()
