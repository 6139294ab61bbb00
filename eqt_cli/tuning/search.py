"""What is searched for: the section `tune` of a configuration, read for each of its laws."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import sha256
from typing import Any

from eqt_cli.config.schema import LogRange, TuneSection, WorstRunSection
from eqt_cli.config.source import ConfigSource, with_value
from eqt_cli.core.errors import ConfigError, EqtError, InputError, suggestion
from eqt_cli.core.file_names import file_name
from eqt_cli.core.problems import KeyPath, Problems, dotted, parse_key
from eqt_cli.core.validation import shown
from eqt_cli.ensemble.axes import Drawn
from eqt_cli.experiment.build import Experiment, build
from eqt_cli.results.metrics import METRICS
from eqt_cli.results.quantity_table import quantities

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
class LawSearch:
    """The search for one law.

    Attributes
    ----------
    label, slug
        Its label in the configuration, and the name of its files.
    source
        The experiment with this law only, its gains in the section `gains`.
    axes
        What is tuned, by key of that configuration.
    index
        Of its entry among the controllers that the user wrote.
    start
        Where the search starts, in the unit cube; None where that is not in it.
    """

    label: str
    slug: str
    source: ConfigSource
    axes: dict[str, Drawn]
    index: int
    start: tuple[float, ...] | None

    def as_written(self, path: str, ranges: Iterable[str]) -> str:
        """A path of its configuration as the user wrote it, who gave these ranges."""
        keys = (key for key in ranges if _own_key(parse_key(key), self.index) == path)
        own = path.replace("controllers[0]", f"controllers[{self.index}]", 1)
        return max(keys, key=len, default=own)  # its own gains go before those of all

    def values(self, shares: Sequence[float]) -> dict[str, float]:
        """The values at a point of the unit cube, by key."""
        return {
            key: axis.at(share)
            for (key, axis), share in zip(self.axes.items(), shares, strict=True)
        }

    def at(self, values: dict[str, float]) -> ConfigSource:
        """The experiment with these values."""
        data = self.source.data
        for key, value in values.items():
            data = with_value(data, parse_key(key), value)
        return replace(self.source, data=data)


@dataclass(frozen=True)
class Search:
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

    @property
    def name(self) -> str:
        """Of the experiment."""
        return self.base.name

    @property
    def seeks_front(self) -> bool:
        """Whether there are two objectives, and so many winners for each law."""
        return len(self.objectives) > 1

    @property
    def seeds(self) -> range:
        """Of the searches for each law."""
        return range(self.section.seed, self.section.seed + self.section.seeds)

    @property
    def all_generations(self) -> int:
        """Of all searches for one law."""
        return len(self.seeds) * self.section.budget

    @property
    def all_runs(self) -> int:
        """Over all laws and generations, and those of the confirmation at the most."""
        section = self.section
        each = self.all_generations * section.population * self.base.config.ensemble.runs
        winners = section.population if self.seeks_front else section.seeds
        return len(self.laws) * (each + (winners + 1) * section.confirm.runs)

    @cached_property
    def digest(self) -> str:
        """Hash of all that decides where a generation looks, but for how many there are."""
        others = {"budget", "seeds", "confirm"}
        section = self.section.model_dump(exclude=others, warnings="none")
        text = json.dumps([self.base.numeric_config, section], sort_keys=True)
        return sha256(text.encode()).hexdigest()

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
        return replace(self.base.source, data=_without_search(data) | own)


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
    ranges = {
        key: axis for key in section.over if (axis := _axis(key, section, base, here.at("over")))
    }
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
    laws = _laws(base, ranges)
    _check_ends(laws, source, problems)
    problems.raise_if_any()
    return Search(base, section, objectives, constraints, laws, seed)


def _axis(key: str, section: TuneSection, base: Experiment, problems: Problems) -> Drawn | None:
    """The range of one key."""
    at_key = problems.at(key)
    with at_key.catching():
        _require_tunable(key, base)
    given = section.over[key]
    if isinstance(given, list):
        axis = Drawn(low=given[0], high=given[1])
    elif isinstance(given, LogRange):
        axis = Drawn(low=given.log[0], high=given.log[1], scale="log")
    else:
        axis = given
    found = Problems()
    axis.check(found)
    for problem in found:
        at_key.add(problem.message)
    return None if at_key else axis


def _require_tunable(key: str, base: Experiment) -> None:
    """Raise an `InputError` if a key is not a law's to choose."""
    path = parse_key(key)
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
            _require_metric(name, base)
    return found


def _require_metric(name: str, base: Experiment) -> None:
    """Raise an `InputError` if generations do not store a metric of this name."""
    stored = {quantity.name for quantity in quantities(base)}
    known = [q.name for q in METRICS if q.name in stored or q.told_by in stored]
    if name not in known:
        hint = suggestion(name, known) or f"; there are: {', '.join(known)}"
        raise InputError(f"no metric '{name}' is stored of every run{hint}")


def _constraints(
    section: TuneSection, base: Experiment, problems: Problems
) -> tuple[Constraint, ...]:
    found = []
    for name, bound in section.subject_to.items():
        with problems.catching(name):
            _require_metric(name, base)
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


def _laws(base: Experiment, ranges: dict[str, Drawn]) -> tuple[LawSearch, ...]:
    """One search for each law, over the keys that are its own and those of all."""
    found: list[LawSearch] = []
    shared = base.resolved["gains"]
    ranges = dict(sorted(ranges.items(), key=lambda item: parse_key(item[0])[0] == "controllers"))
    for index, entry in enumerate(base.resolved["controllers"]):
        own = entry.get("gains", {})
        law = {key: value for key, value in entry.items() if key != "gains"}
        data = _without_search(base.source.data) | {"controllers": [law], "gains": shared | own}
        keys = {_own_key(parse_key(key), index): axis for key, axis in ranges.items()}
        axes = {key: axis for key, axis in keys.items() if key}
        label = str(entry["label"])
        slug = _slug(label, [other.slug for other in found])
        data["name"] = f"{base.name}-{slug}"
        source = replace(base.source, data=data)
        found.append(LawSearch(label, slug, source, axes, index, _start(data, axes)))
    return tuple(found)


def _own_key(path: KeyPath, index: int) -> str:
    """A key in the configuration of one law; empty where it is another law's."""
    if path[0] == "gains":
        return dotted(path)
    if path[1] != index:
        return ""
    return dotted(path[2:] if path[2] == "gains" else ("controllers", 0, *path[2:]))


def _slug(label: str, taken: Sequence[str]) -> str:
    """A label as the name of a file, unlike those of others."""
    slug = file_name(label, "law")
    same = sum(other == slug or other.startswith(f"{slug}-") for other in taken)
    return f"{slug}-{same + 1}" if slug in taken else slug


def _start(data: dict[str, Any], axes: dict[str, Drawn]) -> tuple[float, ...] | None:
    """Where the starting values are in the unit cube; None where one is not in its range."""
    shares = []
    for key, axis in axes.items():
        held: Any = data
        for step in parse_key(key):
            inside = isinstance(held, dict) and step in held
            inside |= isinstance(held, list) and isinstance(step, int) and step < len(held)
            held = held[step] if inside else None
        is_number = isinstance(held, int | float) and not isinstance(held, bool)
        if not is_number or not axis.low <= held <= axis.high:
            return None
        shares.append(axis.share(float(held)))
    return tuple(shares)


def _check_ends(laws: Sequence[LawSearch], source: ConfigSource, problems: Problems) -> None:
    """Build each law at both ends of all ranges; what is wrong there is said at the range."""
    for law in laws:
        if not law.axes:
            problems.at("tune", "over").add(f"has nothing to tune of controller '{law.label}'")
        for share in (0.0, 1.0):
            try:
                build(law.at(law.values([share] * len(law.axes))), trust_plugins=True)
            except ConfigError as error:
                for problem in error.problems:
                    at = f"at the {'upper' if share else 'lower'} ends, controller '{law.label}'"
                    path = law.as_written(problem.path, source.data["tune"]["over"])
                    message = f"{at}: {path}: {problem.message}"
                    problems.at("tune", "over").add(message)


def _without_search(data: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in data.items() if key not in ("tune", "sweep")}


def _entry(data: dict[str, Any], label: str) -> dict[str, Any]:
    """The law of a configuration of one law, with its gains, under another label."""
    return data["controllers"][0] | {"gains": dict(data["gains"]), "label": label}
