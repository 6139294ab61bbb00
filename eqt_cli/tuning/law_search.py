"""The search for one law: its experiment and the ranges of the varied keys."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, TypeVar

from eqt_cli.config.schema import SEARCHES, LogRange, TunedAxis
from eqt_cli.config.source import ConfigSource, with_value
from eqt_cli.core.errors import (
    ConfigError,
    InputError,
    KeyPath,
    Problems,
    dotted,
    parse_key,
    suggestion,
)
from eqt_cli.core.files import file_name
from eqt_cli.ensemble.axes import DrawnRange
from eqt_cli.ensemble.designs.base import overlap
from eqt_cli.experiment.build import build
from eqt_cli.experiment.experiment import Experiment
from eqt_cli.results.metrics import METRICS
from eqt_cli.results.quantity_table import quantities

MOST_ENTRIES = 100
"""Largest number of list entries that one searched number can set."""

T = TypeVar("T")


@dataclass(frozen=True)
class LawSearch:
    """The search for one law.

    Attributes
    ----------
    label, slug
        Label of the law in the configuration, and name of its files.
    source
        The experiment with this law only, its gains in the section `gains`.
    axes
        Ranges of the varied keys of `source`.
    given
        The same keys, in the same order, as the user's configuration writes them.
    index
        Index of the law among the user's controllers.
    start
        The user's values in the unit cube; None where one is outside its range.
    """

    label: str
    slug: str
    source: ConfigSource
    axes: dict[str, DrawnRange]
    given: tuple[str, ...]
    index: int
    start: tuple[float, ...] | None

    def values(self, shares: Sequence[float]) -> dict[str, float]:
        """Return the values at a point of the unit cube, by key."""
        axes = zip(self.axes.items(), shares, strict=True)
        return {key: axis.at(share) for (key, axis), share in axes}

    def as_written(self, path: str) -> str:
        """Translate a path of `source` into one of the user's configuration."""
        pairs = (
            pair
            for own, given in zip(self.axes, self.given, strict=True)
            for pair in zip(entries_of(own), entries_of(given), strict=True)
        )
        own = path.replace("controllers[0]", f"controllers[{self.index}]", 1)
        return dict(pairs).get(path, own)

    def at(self, values: dict[str, float]) -> ConfigSource:
        """Return the experiment with these values."""
        data = self.source.data
        for key, value in expanded(values).items():
            data = with_value(data, parse_key(key), value)
        return replace(self.source, data=data)


_SLICE = re.compile(r"(.+)\[(\d+):(\d+)\]")


def entries_of(key: str) -> list[str]:
    """Return the keys that a searched key sets: ``kp[0]`` and ``kp[1]`` for ``kp[0:2]``.

    Raises
    ------
    InputError
        If the range is empty.
    """
    matched = _SLICE.fullmatch(key)
    if matched is None:
        return [key]
    first, end = int(matched[2]), int(matched[3])
    if not first < end <= first + MOST_ENTRIES:
        raise InputError(
            f"expected a range of 1 to {MOST_ENTRIES} entries, such as {matched[1]}[0:3] for the "
            f"first three, got '{key}'"
        )
    return [f"{matched[1]}[{index}]" for index in range(first, end)]


def expanded(values: Mapping[str, T]) -> dict[str, T]:
    """Repeat each value for every key of the configuration that it sets."""
    return {entry: value for key, value in values.items() for entry in entries_of(key)}


def coordinate_of(key: str) -> str:
    """Return the sweep coordinate that holds the values of a key."""
    return entries_of(key)[0].replace("[", ".").replace("]", "")


def range_of(given: TunedAxis, problems: Problems) -> DrawnRange | None:
    """Return the range of a key, or None after noting its problems."""
    if isinstance(given, list):
        axis = DrawnRange(low=given[0], high=given[1])
    elif isinstance(given, LogRange):
        axis = DrawnRange(low=given.log[0], high=given.log[1], scale="log")
    else:
        axis = given
    own = Problems()
    axis.check(own)
    for problem in own:
        problems.add(problem.message)
    return None if problems else axis


def require_metric(name: str, base: Experiment) -> None:
    """Raise an `InputError` unless every run stores a metric of this name."""
    stored = [quantity.name for quantity in quantities(base)]
    known = [q.name for q in METRICS if q.name in stored or q.told_by in stored]
    # Those of one part of the group, such as ``effort_rotation``.
    in_parts = tuple(f"{q.name}_" for q in METRICS if q.stored_by_part)
    known += [part for part in stored if part.startswith(in_parts)]
    if name not in known:
        hint = suggestion(name, known) or f"; there are: {', '.join(known)}"
        raise InputError(f"no metric '{name}' is stored of every run{hint}")


def laws_of(base: Experiment, ranges: dict[str, DrawnRange]) -> tuple[LawSearch, ...]:
    """Return one search for each law, over its own keys and the shared keys."""
    laws: list[LawSearch] = []
    shared = base.resolved.get("gains", {})
    ranges = dict(sorted(ranges.items(), key=lambda item: item[0].startswith("controllers[")))
    for index, entry in enumerate(base.resolved["controllers"]):
        law = base.loops[str(entry["label"])].controller
        keeps = law.gains_group(base.group) is not base.group or not law.reads_gains
        data = without_search(base.source.data) | {"controllers": [entry]}
        if not keeps:
            of_law = {key: value for key, value in entry.items() if key != "gains"}
            own = shared | entry.get("gains", {})
            data |= {"controllers": [of_law], "gains": own}
        keys = {own: key for key in ranges if (own := _own_key(key, index, keeps))}
        axes = {own: ranges[key] for own, key in keys.items()}
        label = str(entry["label"])
        slug = _slug(label, [other.slug for other in laws])
        data["name"] = f"{base.name}-{slug}"
        source = replace(base.source, data=data)
        given = tuple(keys.values())
        laws.append(LawSearch(label, slug, source, axes, given, index, _start(data, axes)))
    return tuple(laws)


def _own_key(key: str, index: int, keeps: bool) -> str:
    """Return a key in the configuration of one law; empty if it belongs to another law.

    A law that `keeps` its gains does not read the section `gains`.
    """
    path = parse_key(entries_of(key)[0])
    if path[0] != "controllers":
        return "" if keeps and path[0] == "gains" else key
    if path[1] != index:
        return ""
    own = dotted(path[:2])
    moved = path[2] == "gains" and not keeps
    return key.removeprefix(f"{own}.") if moved else f"controllers[0]{key[len(own) :]}"


def _slug(label: str, taken: Sequence[str]) -> str:
    """Return a file name for a label that differs from the names already taken."""
    slug = file_name(label, "law")
    same = sum(other == slug or other.startswith(f"{slug}-") for other in taken)
    return f"{slug}-{same + 1}" if slug in taken else slug


def _start(data: dict[str, Any], axes: dict[str, DrawnRange]) -> tuple[float, ...] | None:
    """Return the starting values in the unit cube; None if one is outside its range."""
    shares = []
    for key, axis in axes.items():
        held, *others = (value_at(data, parse_key(entry)) for entry in entries_of(key))
        is_number = isinstance(held, int | float) and not isinstance(held, bool)
        if not is_number or not axis.low <= held <= axis.high or any(one != held for one in others):
            return None
        shares.append(axis.share(float(held)))
    return tuple(shares)


def check_overlaps(laws: Sequence[LawSearch], problems: Problems) -> None:
    """Note pairs of keys of a law that vary the same entry."""
    for law in laws:
        for (one, own), (other, others) in combinations(zip(law.given, law.axes, strict=True), 2):
            if any(overlap(a, b) for a in entries_of(own) for b in entries_of(others)):
                problems.at(other).add(f"{other} overlaps with {one}; remove one of them")


def check_ends(law: LawSearch, problems: Problems, where: str = "") -> None:
    """Build a law at both ends of all ranges, and note the problems at the ranges."""
    for share in (0.0, 1.0):
        try:
            build(law.at(law.values([share] * len(law.axes))), trust_plugins=True)
        except ConfigError as error:
            for problem in error.problems:
                at = f"at the {'upper' if share else 'lower'} ends, controller '{law.label}'"
                path = law.as_written(problem.path)
                problems.add(f"{where}{at}: {path}: {problem.message}")


def without_search(data: dict[str, Any]) -> dict[str, Any]:
    """Return a configuration without its sections for searches and sweeps."""
    return {key: value for key, value in data.items() if key not in (*SEARCHES, "sweep")}


def value_at(data: Any, path: KeyPath) -> Any:
    """Return the value at a path of a configuration; None if there is none."""
    for step in path:
        inside = isinstance(data, dict) and step in data
        inside |= isinstance(data, list) and isinstance(step, int) and step < len(data)
        data = data[step] if inside else None
    return data


def values_text(values: Mapping[str, float]) -> str:
    """Format values with short unambiguous keys: ``kp 2.1, kd[0] 0.5``."""
    short = {key: key.rpartition(".")[2] for key in values}
    if len(set(short.values())) < len(short):
        short = {key: key for key in values}
    return ", ".join(f"{short[key]} {value:.4g}" for key, value in values.items())
