"""A reference through given poses at given times, or near them."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import InputError
from eqt_cli.core.option_types import Positive, PositiveAngle, Real
from eqt_cli.core.problems import Problems
from eqt_cli.core.validation import unknown_key, validated
from eqt_cli.groups import MatrixLieGroup, Part
from eqt_cli.logs.check import notes
from eqt_cli.logs.in_file import InFile
from eqt_cli.logs.mapping import MAPPING
from eqt_cli.mechanics.motions import Pieces, spline
from eqt_cli.mechanics.smoothing import Smoothed, smoothed
from eqt_cli.notation.poses import pose_from
from eqt_cli.references.base import PiecewiseReference

LATEST, CLOSEST = 1e9, 1e-9
"""Bounds of the times and of the time between two of them, s; beyond, a rate overflows."""

SHORTFALL = 0.01
"""Relative amount by which a residual may be below the requested deviation without a remark."""


@dataclass(frozen=True)
class Waypoint:
    """A pose at a time.

    Attributes
    ----------
    t
        Time, s.
    pose
        The pose.
    """

    t: Real
    pose: Any


@dataclass(frozen=True)
class WaypointsReference(InFile, PiecewiseReference):
    """A cubic spline on the group through every waypoint, or near all of them.

    Its acceleration has no jumps, and is 0 at both ends.

    Attributes
    ----------
    points
        Two or more waypoints in the order of time, `{t: …, pose: …}` each.
    file
        A file that holds the waypoints instead of `points`, relative to the configuration.
    smoothing
        The distance of the motion from the waypoints, as the root mean square for each part of the
        group: ``{rotation: 2 deg, translation: 0.02}``; ``auto`` finds it by cross-validation.
        Without it, the motion goes through all waypoints.
    """

    name: ClassVar[str] = "waypoints"

    points: list[Waypoint] | None = None
    smoothing: Literal["auto"] | dict[str, str | float] | None = None

    def pieces(self, G: MatrixLieGroup) -> Pieces:
        """Return a piece from each waypoint to the next; times must be within bounds."""
        times, poses = self._waypoints(G)
        if not np.all(abs(times) <= LATEST):
            wrong = times[abs(times) > LATEST][0]
            hint = "" if self.file is None else "; add `time: {offset: first}` to `mapping`"
            expected = f"expected times from {-LATEST:g} to {LATEST:g} s"
            raise InputError(f"{expected}, got {wrong:g} s{hint}")
        steps = np.diff(times)
        if not np.all(steps >= CLOSEST):
            row = int(np.argmin(steps))
            raise InputError(
                f"expected at least {CLOSEST:g} s between two waypoints, got {steps[row]:.3g} s "
                f"after {times[row]:g} s"
            )
        if self.smoothing is not None:
            poses = self.prepared(G, self._smoothed, "smoothed").poses
        return spline(G, times, poses)

    def ends(self, G: MatrixLieGroup) -> tuple[float, float]:
        """Return the times of the first and the last waypoint."""
        times, _ = self._waypoints(G)
        return float(times[0]), float(times[-1])

    def remarks(self, G: MatrixLieGroup) -> Iterator[str]:
        """Yield the oddities of the file, and the residuals of smoothing."""
        if self.file is not None:
            log = self.log(G)
            yield from (f"{self.file}: {note}" for note in notes(log))
        if self.smoothing is None:
            return
        residuals = self.prepared(G, self._smoothed, "smoothed").residuals
        requested = self._deviations(G, Problems())
        for part, residual, deviation in zip(G.parts, residuals, requested, strict=True):
            size = _in_words(part, residual)
            if deviation is not None and residual < (1 - SHORTFALL) * deviation:
                size += f" instead of {_in_words(part, deviation)}, and cannot be larger"
            yield f"smoothed: the root mean square residual of {part.name} is {size}"

    def _smoothed(self, G: MatrixLieGroup) -> Smoothed:
        return smoothed(G, *self._waypoints(G), self._deviations(G, Problems()))

    def _deviations(self, G: MatrixLieGroup, problems: Problems) -> list[float | None]:
        """Return the deviation of each part; None for cross-validation, or if it is invalid."""
        parts = {part.name: part for part in G.parts}
        deviations = dict.fromkeys(parts) if self.smoothing == "auto" else self.smoothing
        assert isinstance(deviations, dict)
        for name in (name for name in deviations if name not in parts):
            problems.at(name).add(unknown_key(name, parts))
        if missing := [name for name in parts if name not in deviations]:
            expected = f"expected a deviation for each of {', '.join(parts)}"
            problems.add(f"{expected}; missing {', '.join(missing)}")
        kinds = {name: PositiveAngle if part.turns else Positive for name, part in parts.items()}
        return [
            None
            if deviations.get(name) is None
            else validated(kind, deviations[name], problems.at(name))
            for name, kind in kinds.items()
        ]

    def _waypoints(self, G: MatrixLieGroup) -> tuple[Array, Array]:
        return self.prepared(G, self._read, "waypoints")

    def _read(self, G: MatrixLieGroup) -> tuple[Array, Array]:
        if self.points is not None:
            poses = [pose_from(point.pose, G, Problems()) for point in self.points]
            return np.array([point.t for point in self.points]), np.array(poses)
        log = self.log(G)
        return log.times, log.poses

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note invalid waypoints, in the configuration or in the file."""
        if (self.points is None) == (self.file is None):
            given = "neither" if self.file is None else "both"
            problems.add(f"expected the waypoints as `points` or in a `file`, got {given}")
            return
        if self.mapping is not None and self.file is None:
            problems.at(MAPPING).add("describes a `file`, which is not given; remove this key")
            self.mapping.check(problems.at(MAPPING))
        if self.smoothing is not None:
            self._deviations(G, problems.at("smoothing"))
        if self.points is None:
            self.check_file(problems, lambda: self.prepared(G, self.pieces))
            return
        self._check_points(self.points, G, problems.at("points"))
        if not problems:
            with problems.catching("points"):
                self.prepared(G, self.pieces)

    def _check_points(self, points: list[Waypoint], G: MatrixLieGroup, problems: Problems) -> None:
        if len(points) < 2:
            problems.add(f"expected at least two waypoints, got {len(points)}")
        for index, point in enumerate(points):
            pose_from(point.pose, G, problems.at(index, "pose"))
            if index and not point.t > points[index - 1].t:
                wanted = f"expected a time after {points[index - 1].t:g} s"
                problems.at(index, "t").add(f"{wanted}, got {point.t:g} s")


def _in_words(part: Part, residual: float) -> str:
    """Format a residual of a part of the group with its unit."""
    if part.turns:
        return f"{math.degrees(residual):.3g} deg"
    return f"{residual:.3g} {part.pose_unit}"
