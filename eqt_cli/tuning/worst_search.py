"""The search for the worst run: reads and checks the section `worst` of a configuration."""

from dataclasses import dataclass, replace
from typing import Any

from eqt_cli.config.schema import WorstSection
from eqt_cli.config.source import ConfigSource
from eqt_cli.core.errors import InputError
from eqt_cli.core.problems import Problems, parse_key
from eqt_cli.core.validation import shown
from eqt_cli.ensemble.axes import DrawnRange
from eqt_cli.experiment.experiment import Experiment
from eqt_cli.experiment.read_study import require_sweepable
from eqt_cli.results.quantity_table import QUANTITIES
from eqt_cli.tuning.evolution import Population
from eqt_cli.tuning.folder import WORST
from eqt_cli.tuning.law_search import (
    LawSearch,
    entries_of,
    expanded,
    require_metric,
    value_at,
    values_text,
    without_search,
)
from eqt_cli.tuning.searches import Searches

MOST_ON_A_LINE = 21
"""Largest number of values along a key, besides the found point, at which every law is run."""

MOST_LINE_POINTS = 900
"""Largest number of points of all lines. Points that differ in shape need one HDF5 group each."""


@dataclass(frozen=True)
class Line:
    """Points along one key through the point that was found for a law.

    Attributes
    ----------
    law
        Label of the law.
    key
        Key of the user's configuration that varies along the line.
    points
        Values of all keys at each point.
    """

    law: str
    key: str
    points: list[dict[str, float]]


class WorstSearch(Searches[WorstSection]):
    """A checked search for the worst run: the section `worst`."""

    kind = WORST
    example = "{over: {gains.kp: [0.8, 1.2]}, objective: final_pose_error}"
    continuing = frozenset({"budget", "seeds"})
    keeps_ends = True

    @property
    def objective(self) -> str:
        """The metric whose worst value is searched."""
        return self.section.objective

    @property
    def judging_runs(self) -> int:
        """Number of runs at the points that were found, and of all laws along each key."""
        each = len(self.laws) * self.runs_at_a_point
        return each + self._per_line * self._lines * each

    @property
    def _lines(self) -> int:
        return sum(len(law.axes) for law in self.laws)

    @property
    def _per_line(self) -> int:
        return max(2, min(MOST_ON_A_LINE, MOST_LINE_POINTS // self._lines)) + 1

    def lines(self, found: dict[str, tuple[float, ...]]) -> list[Line]:
        """Return the lines through the points that were found (in the unit cube, by law)."""
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
        """Return a sweep of all laws over all lines, by default without trajectories."""
        points = [point for line in lines for point in line.points]
        columns = expanded({key: [point[key] for point in points] for key in points[0]})
        data = self.base.source.data
        own: dict[str, Any] = {
            "sweep": [{"zip": columns}],
            "store": {"trajectories": "none"} | dict(data.get("store") or {}),
        }
        return replace(self.base.source, data=without_search(data) | own)

    def so_far(self, law: LawSearch, population: Population) -> str:
        """Describe the worst run of a law so far."""
        values = values_text(law.values(population.shares[population.best].tolist()))
        cost = QUANTITIES[self.objective].cost(-population.scores.objectives[population.best, 0])
        return f"worst so far: {self.objective} {cost:.4g} at {values}"

    @classmethod
    def _axis(cls, key: str, axis: DrawnRange | None, base: Experiment) -> DrawnRange | None:
        """Return the range of a key that holds a number and can be swept."""
        whole = _is_whole(key, base)
        return _as_whole(axis, key) if whole and axis is not None else axis

    @classmethod
    def _check(cls, section: WorstSection, base: Experiment, problems: Problems) -> None:
        with problems.catching("objective"):
            require_metric(section.objective, base)
            if QUANTITIES[section.objective].better == "neither":
                raise InputError(
                    f"'{section.objective}' has no better direction, so no run is the worst by "
                    "it; choose another metric, such as final_pose_error"
                )


def _along(axis: DrawnRange, count: int) -> list[float]:
    return [axis.at(k / (count - 1)) for k in range(count)]


def _is_whole(key: str, base: Experiment) -> bool:
    """Whether a key takes whole numbers; raises an `InputError` if it cannot vary."""
    first = entries_of(key)[0]
    require_sweepable(first)
    held = value_at(base.resolved, parse_key(first))
    if isinstance(held, bool | str | list):
        raise InputError(f"expected a key that holds a number, and this one holds {shown(held)}")
    return isinstance(held, int)


def _as_whole(axis: DrawnRange, key: str) -> DrawnRange:
    """Return the range restricted to whole numbers."""
    if not (float(axis.low).is_integer() and float(axis.high).is_integer()):
        raise InputError(
            f"expected whole numbers at both ends, since {key} takes whole numbers, "
            f"got [{axis.low:g}, {axis.high:g}]"
        )
    return replace(axis, integer=True)
