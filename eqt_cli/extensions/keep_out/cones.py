"""Cones that an axis of the body must stay out of, and the metrics of their violation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import reduce
from typing import Any, ClassVar

import numpy as np

from eqt_cli.base.arrays import Array, apply, dot, less, maximum, minimum, norm, sqrt, stack, where
from eqt_cli.base.errors import Problems
from eqt_cli.base.expressions import formula
from eqt_cli.base.option_types import Angle, Real, shown
from eqt_cli.base.registry import Keys
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.matrix_groups import check_turns_in_space
from eqt_cli.components.tasks import Direction
from eqt_cli.extend import Metric, SampledRuns

ROUNDING = 1e-9
"""Margin below which a reference on the edge of a cone is not inside, deg."""

OPPOSITE = 1e-6
"""Angle, rad, below which two directions count as opposite; decimals of a table may leave it."""


@dataclass(frozen=True)
class Cone(Keys):
    """A cone about a direction in space, such as that of the Sun, for an axis of the body.

    Attributes
    ----------
    axis
        The axis in the body, such as the line of sight of a star tracker.
    angle
        Half the opening of the cone, rad: the least angle that is allowed.
    at
        The direction in space, of any length: three numbers, or expressions in t.
    table
        Instead: rows [t, x, y, z] of the direction over time, linear between them, and constant
        before and after.
    """

    axis: Direction
    angle: Angle
    at: list[str | float] | None = None
    table: list[list[Real]] | None = None

    def vector(self, t: Any, of_times: Any) -> Array:
        """Return a vector along the direction, of any length, ``(..., 3)``.

        Parameters
        ----------
        t
            The time, s, a number or a symbol of each sample.
        of_times
            Makes of a function of the times what belongs to each sample.
        """
        if self.table is None:
            values = [formula(expression).evaluate({"t": t}) for expression in self.at or ()]
        else:
            times, *columns = np.array(self.table, dtype=float).T
            values = [of_times(lambda at, x=x: np.interp(at, times, x)) for x in columns]
        return stack(values)

    def chord(self, R: Array, t: Any, of_times: Any) -> Array:
        """Return from the direction to the axis, both of length 1, ``(..., 3)``."""
        d = self.vector(t, of_times)
        a = (R * np.array(self.axis)).sum(axis=-1)
        # A pose leaves its group by the error of the solver.
        return a / sqrt(dot(a, a))[..., None] - d / sqrt(dot(d, d))[..., None]

    def margin(self, chord: Array) -> Array:
        """Return the angle between axis and direction beyond that of the cone, deg.

        A chord c of an angle φ is 2 sin(φ/2) long, which is exact to rounding up to a right angle;
        that to the opposite direction is √(4 − c²) long.
        """
        square = dot(chord, chord)
        turn = 2 * apply("asin", minimum(sqrt(square) / 2, 1.0))
        return (turn - self.angle) * (180 / np.pi)

    def nearest(self, before: Array, chord: Array) -> Array:
        """Return the shortest chord on the line from one to the next.

        Beyond a right angle it is at an end, as on the arc, which is longer than the line.
        """
        step = chord - before
        length, ahead = dot(step, step), less(dot(chord, chord), 2.0)
        share = -dot(before, step) / where(less(0.0, length), length, 1.0)
        share = where(ahead, share, where(less(share, 0.5), 0.0, 1.0))
        return before + minimum(maximum(share, 0.0), 1.0)[..., None] * step

    def share_inside(self, before: Array, chord: Array) -> Array:
        """Return which share of the line from one chord to the next is in the cone."""
        step, edge = chord - before, 2 * np.sin(self.angle / 2)
        a, b, c = dot(step, step), dot(before, step), dot(before, before) - edge**2
        moves = less(0.0, a)
        root = sqrt(maximum(b * b - a * c, 0.0))
        ends = [minimum(maximum((-b + x) / where(moves, a, 1.0), 0.0), 1.0) for x in (-root, root)]
        return where(moves, ends[1] - ends[0], where(less(c, 0.0), 1.0, 0.0))

    def check(self, problems: Problems) -> None:
        """Note what is no cone, and what is no direction over time."""
        if not 0 < self.angle < np.pi:
            degrees = np.degrees(self.angle)
            problems.at("angle").add(
                f"expected more than 0 and less than 180 deg, got {degrees:g} deg; a number "
                "without a unit is in rad"
            )
        if (self.at is None) == (self.table is None):
            problems.add("expected either at, such as [1, 0, 0], or table")
        elif self.at is not None:
            here = problems.at("at")
            for k, expression in enumerate(self.at):
                with here.catching(k):
                    formula(expression)
            if len(self.at) != 3 or not any(component != 0 for component in self.at):
                here.add(f"expected a direction [x, y, z], not all 0, got {shown(self.at)}")
        else:
            _check_table(self.table or [], problems.at("table"))


def _check_table(rows: Sequence[Sequence[float]], problems: Problems) -> None:
    if not rows:
        problems.add("expected rows [t, x, y, z], got none")
    for k, row in enumerate(rows):
        if len(row) != 4 or not any(row[1:]):
            problems.at(k).add(f"expected [t, x, y, z] with a direction, got {list(row)}")
        elif k and len(rows[k - 1]) == 4 and row[0] <= rows[k - 1][0]:
            before = rows[k - 1][0]
            problems.at(k).add(f"expected a time after {before:g} s, got {row[0]:g} s")
        elif k and len(rows[k - 1]) == 4:
            _check_no_zero(np.array(rows[k - 1][1:]), np.array(row[1:]), problems.at(k))


def _check_no_zero(first: Array, last: Array, problems: Problems) -> None:
    """Note two rows between which a straight line passes through 0, where there is no direction."""
    opposite = norm(first) * last + norm(last) * first
    if norm(opposite) <= OPPOSITE * norm(first) * norm(last):
        problems.add(
            f"{last.tolist()} is opposite to the row before, and a straight line between both "
            "passes through 0, which is no direction; add a row between them"
        )


@dataclass(frozen=True)
class OfCones(Metric):
    """A number of the angles between axes of the body and directions that they must stay off.

    Attributes
    ----------
    cones
        The cones, of which the nearest counts: each {axis: [0, 0, 1], at: [1, 0, 0], angle: 30 deg}
        or with a `table` of rows [t, x, y, z].
    """

    signals: ClassVar[tuple[str, ...]] = ("pose",)
    constraint: ClassVar[bool] = True

    cones: list[Cone] = field(kw_only=True)

    def pairs(self, over: SampledRuns, pose: Array) -> Iterator[tuple[Cone, Array, Array]]:
        """Yield each cone once with its chords before and at each time, ``(..., samples, 3)``."""
        for cone in {repr(cone): cone for cone in self.cones}.values():
            chord = cone.chord(pose[..., :3, :3], over.time, over.of_times)
            yield cone, stack([over.before(chord[..., k]) for k in range(3)]), chord

    def lines(self, over: SampledRuns, pose: Array) -> Array:
        """Return the chords, along which the angles are taken."""
        return np.concatenate([chord for _, _, chord in self.pairs(over, pose)], axis=-1)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note groups without one attitude in space, and cones that are none."""
        check_turns_in_space(self.name, G, problems)
        if not self.cones:
            problems.at("cones").add("expected at least one cone")
        for k, cone in enumerate(self.cones):
            cone.check(problems.at("cones", k))


@dataclass(frozen=True)
class KeepOutTime(OfCones):
    """Time for which an axis is inside a keep-out cone, such as that of the Sun."""

    name: ClassVar[str] = "keep_out_time"
    units: ClassVar[str] = "s"
    better: ClassVar[Any] = "lower"

    def of(self, over: SampledRuns, pose: Any) -> Any:
        """The time in the nearest cone; in a step from one cone into another, that in both."""
        share: Any = 0.0
        for cone, before, chord in self.pairs(over, pose):
            share = share + cone.share_inside(before, chord)
        return over.weighted(np.diff(over.times, prepend=over.times[0]), minimum(share, 1.0))


@dataclass(frozen=True)
class KeepOutMargin(OfCones):
    """Least angle beyond the edge of a keep-out cone, such as that of the Sun; negative inside."""

    name: ClassVar[str] = "keep_out_margin"
    units: ClassVar[str] = "deg"
    better: ClassVar[Any] = "higher"

    def of(self, over: SampledRuns, pose: Any) -> Any:
        """The least margin on the lines from time to time."""
        pairs = self.pairs(over, pose)
        margins = [cone.margin(cone.nearest(before, chord)) for cone, before, chord in pairs]
        return over.smallest(reduce(minimum, margins))


def vanishing(times: Array, vectors: Array) -> float | None:
    """Return the time at which vectors ``(samples, 3)`` vanish, or turn round; None if nowhere."""
    vectors = np.broadcast_to(vectors, (len(times), 3))
    after = np.roll(vectors, -1, axis=0)
    turns = dot(vectors, after) <= -(1 - OPPOSITE) * norm(vectors) * norm(after)
    turns[-1] = not vectors[-1].any()
    places = np.flatnonzero(turns)
    return float(times[places[0]]) if len(places) else None


def stretches(times: Array, margin: Array) -> Iterator[tuple[float, float, float]]:
    """Yield start, end and least margin of each stretch inside, for one run ``(samples,)``."""
    inside = np.concatenate([[False], margin < -ROUNDING, [False]])
    edges = np.flatnonzero(np.diff(inside.astype(int)))
    for first, last in zip(edges[::2], edges[1::2] - 1, strict=True):
        yield float(times[first]), float(times[last]), float(margin[first : last + 1].min())
