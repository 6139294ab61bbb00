"""A reference through given poses at given times, or near them."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array, norm
from eqt_cli.base.errors import InputError, Problems
from eqt_cli.base.extensions import function_for, functions_for
from eqt_cli.base.option_types import VELOCITY, Positive, Real, Unit, unknown_key, validated
from eqt_cli.base.registry import Keys
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.motions import Pieces, spline
from eqt_cli.components.pose_notation import check_turn, pose_from
from eqt_cli.components.pose_tables import MAPPING, InFile
from eqt_cli.components.references import PiecewiseReference, check_end, check_rising

LATEST, CLOSEST = 1e9, 1e-9
"""Bounds of the times and of the time between two of them, s; beyond, a rate overflows."""

EQUAL, SWUNG = 1e-9, 1e-3
"""Entries of poses that differ by less are equal; a swing of less, deg or m, is not remarked on."""

LOOKS, NEAR = 201, 0.02
"""Times at which a hold is looked at, and how near its ends points are proposed, as a share."""


@dataclass(frozen=True)
class Waypoint(Keys):
    """A pose at a time.

    Attributes
    ----------
    t
        Time, s.
    pose
        The pose.
    velocity
        V there, in the body frame, of the first and the last alone. Default: one at which the
        acceleration is 0.
    """

    t: Annotated[Real, Unit("s")]
    pose: Any
    velocity: Annotated[list[Real] | None, Unit(VELOCITY)] = None


@dataclass(frozen=True)
class WaypointsReference(InFile, PiecewiseReference):
    """A cubic spline on the group through every waypoint, or near all of them.

    Its acceleration has no jumps, and is 0 at both ends where no velocity is written there.

    Attributes
    ----------
    points
        Two or more waypoints `{t: …, pose: …}` in the order of time.
    file
        Instead of `points`: a file with the waypoints, relative to the configuration.
    smoothing
        The rms distance of the motion from the waypoints for each part of the group, ``{rotation: 2
        deg, translation: 0.02}``, or ``auto`` to find it by cross-validation. Default: the motion
        goes through all waypoints.
    """

    name: ClassVar[str] = "waypoints"
    by_processor: ClassVar[bool] = True  # it is found by Newton's method

    points: list[Waypoint] | None = None
    smoothing: Literal["auto"] | dict[str, str | float] | None = None

    def pieces(self, G: MatrixLieGroup) -> Pieces:
        """Return a piece from each waypoint to the next; times must be within bounds."""
        times, poses = self.waypoints(G)
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
            poses = function_for(purposes.reference_smoothing)(self, G).poses
        points = self.points or (Waypoint(0.0, None),)
        return spline(G, times, poses, (points[0].velocity, points[-1].velocity))

    def knot_times(self, G: MatrixLieGroup) -> Array:
        """Return the times of the waypoints."""
        return self.waypoints(G)[0]

    def ends(self, G: MatrixLieGroup) -> tuple[float, float]:
        """Return the times of the first and the last waypoint."""
        times, _ = self.waypoints(G)
        return float(times[0]), float(times[-1])

    def remarks(self, G: MatrixLieGroup) -> Iterator[str]:
        """Yield what extensions say of the file and of smoothing, and how far a hold swings.

        A function for `remarks on waypoints` takes the reference and the group, and yields texts.
        """
        for remarks in functions_for(purposes.remarks_on_waypoints):
            yield from remarks(self, G)
        times, poses = self.waypoints(G)
        still = np.abs(np.diff(poses, axis=0)).max(axis=(1, 2)) <= EQUAL
        if self.smoothing is None and still.any() and not still.all():
            yield from self._swings(G, times, poses, np.flatnonzero(still))

    def _swings(self, G: MatrixLieGroup, times: Array, poses: Array, rows: Array) -> Iterator[str]:
        """Say where the spline swings most between two equal waypoints, and what would stop it."""
        points = self.points or [Waypoint(0.0, None)]
        ends = points[0].velocity, points[-1].velocity

        def away(pieces: Pieces, since: float, until: float) -> Array:
            Q = pieces.motion(G, np.linspace(since, until, LOOKS))[0]
            errors = G.log(G.inverse(Q[0]) @ Q)
            sizes = [norm(errors[:, part.axes]).max() for part in G.parts]
            return np.array(sizes) * [np.degrees(1.0) if part.turns else 1.0 for part in G.parts]

        pieces = self.prepared(G, self.pieces)
        swings = np.array([away(pieces, *times[row : row + 2]) for row in rows])
        place, kind = np.unravel_index(swings.argmax(), swings.shape)
        row, part = int(rows[place]), G.parts[kind]
        if swings[place, kind] <= SWUNG:
            return
        since, until = times[row : row + 2].tolist()
        more = since + NEAR * (until - since), until - NEAR * (until - since)
        held = np.insert(poses, row + 1, poses[[row, row]], axis=0)
        stopped = spline(G, np.insert(times, row + 1, more), held, ends)
        left = away(stopped, since, until)[kind]
        unit = "deg" if part.turns else part.error_unit
        yield (
            f"the poses at {since:g} and {until:g} s are equal, but the spline swings up to "
            f"{swings[place, kind]:.3g} {unit} away from them in between; with the same pose at "
            f"{more[0]:g} and {more[1]:g} s, too, it is {left:.2g} {unit}"
        )

    def deviations(self, G: MatrixLieGroup, problems: Problems) -> list[float | None]:
        """Return the deviation of each part; None for cross-validation, or if it is invalid."""
        parts = {part.name: part for part in G.parts}
        deviations = dict.fromkeys(parts) if self.smoothing == "auto" else self.smoothing
        assert isinstance(deviations, dict)
        for name in deviations:
            if name not in parts:
                problems.at(name).add(unknown_key(name, parts))
        if missing := [name for name in parts if name not in deviations]:
            expected = f"expected a deviation for each of {', '.join(parts)}"
            problems.add(f"{expected}; missing {', '.join(missing)}")
        checked = []
        for name, part in parts.items():
            kind: Any = Annotated[Positive, Unit(part.error_unit)] | None
            checked.append(validated(kind, deviations.get(name), problems.at(name)))
        return checked

    def waypoints(self, G: MatrixLieGroup) -> tuple[Array, Array]:
        """Return the times and the poses of the waypoints."""
        return self.prepared(G, self._read, "waypoints")

    def _read(self, G: MatrixLieGroup) -> tuple[Array, Array]:
        if self.points is not None:
            poses = [pose_from(point.pose, G, Problems()) for point in self.points]
            return np.array([point.t for point in self.points]), np.array(poses)
        return self.rows(G)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note invalid waypoints, in the configuration or in the file."""
        if (self.points is None) == (self.file is None):
            which = "neither" if self.file is None else "both"
            problems.add(f"expected the waypoints as `points` or in a `file`, got {which}")
            return
        if self.mapping is not None and self.file is None:
            problems.at(MAPPING).add("describes a `file`, which is not given; remove this key")
            self.mapping.check(problems.at(MAPPING))
        if self.smoothing is not None:
            self.deviations(G, problems.at("smoothing"))
        if self.points is None:
            self.check_file(problems, lambda: self.prepared(G, self.pieces))
            return
        for index, point in enumerate(self.points):
            here = problems.at("points", index, "pose")
            pose_from(point.pose, G, here)
            at_velocity = problems.at("points", index, "velocity")
            check_end(point.velocity, G.dimension, index, len(self.points), at_velocity)
            if index:
                check_turn(self.points[index - 1].pose, point.pose, G, here)
        check_rising(self.points, problems.at("points"))
        if not problems:
            with problems.catching("points"):
                self.prepared(G, self.pieces)
