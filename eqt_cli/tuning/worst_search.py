"""What the worst run is searched over: the section `worst` of a configuration."""

from dataclasses import dataclass, replace
from typing import Any

from eqt_cli.config.schema import WorstSection
from eqt_cli.config.source import ConfigSource
from eqt_cli.core.errors import EqtError, InputError
from eqt_cli.core.problems import Problems, parse_key
from eqt_cli.core.validation import shown
from eqt_cli.ensemble.axes import Drawn
from eqt_cli.experiment.build import Experiment, build
from eqt_cli.experiment.read_study import require_sweepable
from eqt_cli.results.quantity_table import QUANTITIES
from eqt_cli.tuning.law_search import (
    LawSearch,
    Searches,
    check_ends,
    entries_of,
    expanded,
    laws_of,
    range_of,
    require_metric,
    value_at,
    without_search,
)

MOST_ON_A_LINE = 21
"""Values of a key at which every law is run, with the found point, to show how the worst grows."""

MOST_LINE_POINTS = 900
"""Of all lines together: points that differ in shape have a group of the file each."""


@dataclass(frozen=True)
class Line:
    """Points along one key through the point that was found for a law.

    Attributes
    ----------
    law
        The label of the law.
    key
        As the configuration of all laws has it.
    points
        Values of all keys, at each point.
    """

    law: str
    key: str
    points: list[dict[str, float]]


@dataclass(frozen=True)
class WorstSearch(Searches):
    """What is searched for, checked.

    Attributes
    ----------
    base
        The experiment with all laws.
    section
        The section `worst`.
    laws
        One search for each law.
    """

    base: Experiment
    section: WorstSection
    laws: tuple[LawSearch, ...]
    continuing = frozenset({"budget", "seeds"})
    keeps_ends = True

    @property
    def objective(self) -> str:
        """The metric whose worst value is looked for."""
        return self.section.objective

    @property
    def all_runs(self) -> int:
        """Over all laws and generations, what was found, and the lines at the most."""
        each = len(self.laws) * self.base.config.ensemble.runs
        return self.searched_runs + each + self._per_line * self._lines * each

    @property
    def _lines(self) -> int:
        return sum(len(law.axes) for law in self.laws)

    @property
    def _per_line(self) -> int:
        return max(2, min(MOST_ON_A_LINE, MOST_LINE_POINTS // self._lines)) + 1

    def lines(self, found: dict[str, tuple[float, ...]]) -> list[Line]:
        """The lines through the points that were found, in the unit cube, by the law."""
        at = {law.label: law.values(found[law.label]) for law in self.laws}
        given = {
            key: value
            for law in reversed(self.laws)
            for key, value in zip(law.given, at[law.label].values(), strict=True)
        }
        lines = []
        for law in self.laws:
            own = given | dict(zip(law.given, at[law.label].values(), strict=True))
            for key, axis in zip(law.given, law.axes.values(), strict=True):
                values = sorted({*_along(axis, self._per_line - 1), own[key]})
                points = [own | {key: value} for value in values]
                lines.append(Line(law.label, key, points))
        return lines

    def along(self, lines: list[Line]) -> ConfigSource:
        """All laws at all points of lines, as an ordinary sweep that keeps metrics only."""
        points = [point for line in lines for point in line.points]
        columns = expanded({key: [point[key] for point in points] for key in points[0]})
        data = self.base.source.data
        own: dict[str, Any] = {
            "sweep": [{"zip": columns}],
            "store": {"trajectories": "none"} | dict(data.get("store") or {}),
        }
        return replace(self.base.source, data=without_search(data) | own)


def _along(axis: Drawn, count: int) -> list[float]:
    return [axis.at(k / (count - 1)) for k in range(count)]


def worst_search_from(source: ConfigSource, *, trust_plugins: bool = False) -> WorstSearch:
    """Read and check over what the worst run of a configuration is searched.

    Raises
    ------
    ConfigError
        With every problem, each at its place.
    EqtError
        If it searches for none.
    """
    if not source.data.get("worst"):
        raise EqtError(
            f"{source.source.name}: has no section `worst`; add one, such as "
            "worst: {over: {gains.kp: [0.8, 1.2]}, objective: final_pose_error}"
        )
    if source.data.get("sweep"):
        place = source.place(("sweep",))
        raise EqtError(f"{place}: the worst run is searched around one point; leave `sweep` out")
    base = build(source, trust_plugins=trust_plugins)
    section = base.config.worst
    assert section is not None
    problems = Problems(source.place)
    here = problems.at("worst")
    ranges: dict[str, Drawn] = {}
    for key, given in section.over.items():
        at_key = here.at("over", key)
        axis = range_of(given, at_key)
        with at_key.catching():
            whole = _is_whole(key, base)
            if axis is not None:
                ranges[key] = _as_whole(axis, key) if whole else axis
    with here.catching("objective"):
        require_metric(section.objective, base)
        if QUANTITIES[section.objective].better == "neither":
            raise InputError(
                f"'{section.objective}' has no better direction, so no run is the worst by it; "
                "choose another metric, such as final_pose_error"
            )
    problems.raise_if_any()
    laws = laws_of(base, ranges)
    for law in laws:
        if not law.axes:
            here.at("over").add(
                f"has no key of controller '{law.label}'; add one that all laws share, or leave "
                "the controller out"
            )
    check_ends(laws, here.at("over"))
    problems.raise_if_any()
    return WorstSearch(base, section, laws)


def _is_whole(key: str, base: Experiment) -> bool:
    """Whether a key takes whole numbers; raises an `InputError` if it cannot be varied."""
    first = entries_of(key)[0]
    require_sweepable(first)
    held = value_at(base.resolved, parse_key(first))
    if isinstance(held, bool | str | list):
        raise InputError(f"expected a key that holds a number, and this one holds {shown(held)}")
    return isinstance(held, int)


def _as_whole(axis: Drawn, key: str) -> Drawn:
    """The range with whole numbers only."""
    if not (float(axis.low).is_integer() and float(axis.high).is_integer()):
        raise InputError(
            f"expected whole numbers at both ends, since {key} takes whole numbers, "
            f"got [{axis.low:g}, {axis.high:g}]"
        )
    return replace(axis, integer=True)
