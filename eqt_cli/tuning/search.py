"""What is searched for: the section `tune` of a configuration, read for each of its laws."""

from dataclasses import dataclass, replace
from typing import Any

from eqt_cli.config.schema import TuneSection, WorstRunSection
from eqt_cli.config.source import ConfigSource
from eqt_cli.core.errors import EqtError, InputError
from eqt_cli.core.problems import Problems, parse_key
from eqt_cli.core.validation import shown
from eqt_cli.ensemble.axes import Drawn
from eqt_cli.experiment.build import Experiment, build
from eqt_cli.results.metrics import METRICS
from eqt_cli.tuning.law_search import (
    LawSearch,
    Searches,
    check_ends,
    entries_of,
    laws_of,
    range_of,
    require_metric,
    without_search,
)

MOST_TRAJECTORIES = 50
"""Of each law, that the confirmation keeps unless the configuration says how many; a front has
too many laws, and keeps none."""


@dataclass(frozen=True)
class Constraint:
    """A bound that a metric keeps to.

    Attributes
    ----------
    metric, bound
        Of what, and which.
    above
        Whether the metric may not be more than the bound, rather than not less.
    every_run
        Whether this is asked of the worst run, rather than of the mean.
    """

    metric: str
    bound: float
    above: bool
    every_run: bool

    def __str__(self) -> str:
        who = "in every run" if self.every_run else "in the mean"
        return f"{self.metric} {'≤' if self.above else '≥'} {self.bound:g} {who}"


@dataclass(frozen=True)
class Search(Searches):
    """What is searched for, checked.

    Attributes
    ----------
    base
        The experiment with all laws at the starting gains.
    section
        The section `tune`.
    objectives
        The metrics to be made best.
    constraints
        What must hold besides.
    laws
        One search for each law.
    confirm_seed
        Of the held-out runs.
    """

    base: Experiment
    section: TuneSection
    objectives: tuple[str, ...]
    constraints: tuple[Constraint, ...]
    laws: tuple[LawSearch, ...]
    confirm_seed: int
    continuing = frozenset({"budget", "seeds", "confirm"})

    @property
    def seeks_front(self) -> bool:
        """Whether there are two objectives, and so many winners for each law."""
        return len(self.objectives) > 1

    @property
    def all_runs(self) -> int:
        """Over all laws and generations, and those of the confirmation at the most."""
        section = self.section
        winners = section.population if self.seeks_front else section.seeds
        return self.searched_runs + len(self.laws) * (winners + 1) * section.confirm.runs

    def confirmation(self, chosen: dict[str, dict[str, dict[str, float]]]) -> ConfigSource:
        """Winners and starting gains side by side, from initial states that no search has seen.

        Parameters
        ----------
        chosen
            By law and by the label in the confirmation, values by key.
        """
        tuned = [
            _entry(law.at(values).data, label)
            for law in self.laws
            for label, values in chosen[law.label].items()
        ]
        starts = [_entry(law.source.data, started(law.label)) for law in self.laws]
        data = self.base.source.data
        ensemble = {"runs": self.section.confirm.runs, "seed": self.confirm_seed}
        store = dict(data.get("store") or {})
        few = min(MOST_TRAJECTORIES, ensemble["runs"])
        store.setdefault("trajectories", "none" if self.seeks_front else few)
        own = {"controllers": [*tuned, *starts], "ensemble": ensemble, "store": store}
        return replace(self.base.source, data=without_search(data) | own)


def started(label: str) -> str:
    """The label of a law at its starting gains."""
    return f"{label}, start"


def seeded(label: str, seed: int) -> str:
    """The label of a law as the search with a seed found it, where another one found better."""
    return f"{label}, seed {seed}"


def search_from(source: ConfigSource, *, trust_plugins: bool = False) -> Search:
    """Read and check what a configuration wants to be tuned.

    Raises
    ------
    ConfigError
        With every problem, each at its place.
    EqtError
        If it tunes nothing.
    """
    if not source.data.get("tune"):
        raise EqtError(
            f"{source.source.name}: has no section `tune`; add one, such as "
            "tune: {over: {gains.kp: {log: [0.1, 10]}}, objective: mean_pose_error}"
        )
    if source.data.get("sweep"):
        place = source.place(("sweep",))
        raise EqtError(f"{place}: a configuration is tuned at one point; leave `sweep` out")
    base = build(source, trust_plugins=trust_plugins)
    section = base.config.tune
    assert section is not None
    problems = Problems(source.place)
    here = problems.at("tune")
    ranges: dict[str, Drawn] = {}
    for key, given in section.over.items():
        at_key = here.at("over", key)
        with at_key.catching():
            _require_tunable(key, base)
        axis = range_of(given, at_key)
        ranges |= {key: axis} if axis else {}
    objectives = _objectives(section, base, here)
    constraints = _constraints(section, base, here.at("subject_to"))
    seed = section.confirm.seed
    seed = base.config.ensemble.seed + 1 if seed is None else seed
    if seed == base.config.ensemble.seed:
        here.at("confirm", "seed").add(
            f"expected another seed than ensemble.seed, got {seed}; winners are judged on runs "
            "that did not choose them"
        )
    if base.config.initial.file is not None:
        here.add("initial.file gives all runs their states, so that none are held out; draw them")
    problems.raise_if_any()
    laws = laws_of(base, ranges)
    for law in laws:
        if not law.axes:
            here.at("over").add(f"has nothing to tune of controller '{law.label}'")
    check_ends(laws, here.at("over"))
    problems.raise_if_any()
    return Search(base, section, objectives, constraints, laws, seed)


def _require_tunable(key: str, base: Experiment) -> None:
    """Raise an `InputError` if a key is not a law's to choose."""
    path = parse_key(entries_of(key)[0])
    if path[0] == "gains" and len(path) > 1:
        return
    if path[0] != "controllers":
        raise InputError(
            "expected a key of gains or controllers, which a law may choose; all else is the task"
        )
    count = len(base.loops)
    if len(path) < 3 or not isinstance(path[1], int) or path[1] >= count:
        raise InputError(
            f"expected an option of one of the {count} controllers, as controllers[0].gains.kp"
        )


def _objectives(section: TuneSection, base: Experiment, problems: Problems) -> tuple[str, ...]:
    given = section.objectives
    if (section.objective is None) == (given is None):
        problems.add("expected either `objective`, a metric, or `objectives`, two of them")
        return ()
    if given is not None and (len(given) != 2 or given[0] == given[1]):
        problems.at("objectives").add(f"expected two different metrics, got {shown(given)}")
        return ()
    found = tuple(given or (str(section.objective),))
    for index, name in enumerate(found):
        place = ("objectives", index) if given else ("objective",)
        with problems.catching(*place):
            require_metric(name, base)
    return found


def _constraints(
    section: TuneSection, base: Experiment, problems: Problems
) -> tuple[Constraint, ...]:
    found = []
    for name, bound in section.subject_to.items():
        with problems.catching(name):
            require_metric(name, base)
        if isinstance(bound, WorstRunSection):
            if bound.max is None and bound.min is None:
                problems.at(name).add("expected `max` or `min`, got neither")
            if bound.max is not None:
                found.append(Constraint(name, bound.max, above=True, every_run=True))
            if bound.min is not None:
                found.append(Constraint(name, bound.min, above=False, every_run=True))
        elif not problems.at(name):
            higher = next(q.better == "higher" for q in METRICS if q.name == name)
            found.append(Constraint(name, float(bound), above=not higher, every_run=False))
    return tuple(found)


def _entry(data: dict[str, Any], label: str) -> dict[str, Any]:
    """The law of a configuration of one law, with its gains, under another label."""
    return data["controllers"][0] | {"gains": dict(data["gains"]), "label": label}
