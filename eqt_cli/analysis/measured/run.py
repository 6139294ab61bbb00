"""Interpolates a run of a result, and computes the errors of a recording aligned with it."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from eqt_cli.analysis.measured.alignment import Alignment, aligned
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import InputError
from eqt_cli.groups import MatrixLieGroup, Part
from eqt_cli.logs.columns import WRENCH, recorded_names
from eqt_cli.logs.recording import Recording
from eqt_cli.mechanics.motions import Pieces, through
from eqt_cli.results.result import Result

NEEDED = ("pose", "velocity", "torque", "desired_pose", "desired_velocity", "desired_torque")


MOST_ROWS = 20_000
"""Largest number of compared rows; a longer recording is thinned."""

VARIES = 0.3
"""Relative variation below which a difference of poses counts as constant."""

SAME_TIME = 1e-9
"""Tolerance for rows at the ends of a run, as a share of its length."""


@dataclass(frozen=True)
class State:
    """Pose ``(n, d, d)``, body velocity and wrench ``(n, m)`` at some times."""

    pose: Array
    velocity: Array
    wrench: Array


@dataclass(frozen=True)
class Course:
    """A motion that is cubic on the group between samples, with a linearly interpolated wrench."""

    group: MatrixLieGroup
    times: Array
    states: State

    @cached_property
    def pieces(self) -> Pieces:
        """The motion without the wrench."""
        return through(self.group, self.times, self.states.pose, self.states.velocity)

    def at(self, t: Array) -> State:
        """Return the state at times ``(n,)`` within the samples."""
        pose, velocity, _ = self.pieces.motion(self.group, t)
        axes = [np.interp(t, self.times, along) for along in self.states.wrench.T]
        return State(pose, velocity, np.stack(axes, axis=-1))


@dataclass(frozen=True)
class Error:
    """Errors of pose, velocity or wrench in the body frame.

    Attributes
    ----------
    quantity
        ``pose``, ``velocity`` or ``wrench``.
    measured, simulated : (n, m)
        Errors of the recording and of the run relative to the reference: log Q_d⁻¹Q, V − V_d,
        τ − τ_d; NaN in coordinates that were not measured.
    difference : (n, m)
        Error of the recording relative to the run.
    """

    quantity: str
    measured: Array
    simulated: Array
    difference: Array

    def unit(self, part: Part) -> str:
        """Return the unit of a part of the coordinates."""
        if self.quantity == "pose":
            return "rad" if part.turns else part.pose_unit
        return part.velocity_unit if self.quantity == "velocity" else part.force_unit


@dataclass(frozen=True)
class MeasuredRun:
    """A recording aligned with a run of a controller.

    Attributes
    ----------
    label, title, run
        Label and display name of the controller, and number of the run.
    recording
        The rows within the run, at most `MOST_ROWS`, in the time of the run.
    rows
        Number of all rows within the run.
    alignment
        Alignment of the clock.
    simulated, reference
        The run, and its reference.
    """

    label: str
    title: str
    run: int
    recording: Recording
    rows: int
    alignment: Alignment
    simulated: Course
    reference: Course

    @cached_property
    def errors(self) -> list[Error]:
        """Errors of the measured quantities at the times of the recording."""
        G, seen = self.recording.group, self.recording
        run, wanted = self.simulated.at(seen.times), self.reference.at(seen.times)

        def between(Q: Array, P: Array) -> Array:
            return G.log(G.inverse(Q) @ P)

        found = [
            Error(
                "pose",
                between(wanted.pose, seen.poses),
                between(wanted.pose, run.pose),
                between(run.pose, seen.poses),
            )
        ]
        for quantity, measured, here, desired in (
            ("velocity", seen.velocities, run.velocity, wanted.velocity),
            ("wrench", seen.wrenches, run.wrench, wanted.wrench),
        ):
            if not np.isnan(measured).all():
                differences = measured - desired, here - desired, measured - here
                found.append(Error(quantity, *differences))
        return found

    @property
    def notes(self) -> list[str]:
        """Notes on the rows, the clock, the gaps, and missing measurements."""
        seen, gaps = self.recording, len(self.recording.gaps)
        missing = f", {gaps} gap{'s' * (gaps > 1)}" if gaps else ""
        first, last = (round(t, 6) + 0.0 for t in seen.times[[0, -1]].tolist())
        count = f"{len(seen.times)} of " * (self.rows > len(seen.times)) + f"{self.rows} rows"
        found = [
            f"{seen.name}: {count} from {first:.4g} to {last:.4g} s of run "
            f"{self.run}{missing}; {self.alignment.in_words}",
        ]
        found += self._world_differences()
        names = recorded_names(seen.group, WRENCH)
        if names and np.isnan(seen.wrenches).all():
            found.append(f"No wrench was measured; record it in columns {', '.join(names)}")
        return found

    def _world_differences(self) -> Iterator[str]:
        """Note the parts whose difference from the run is nearly constant and exceeds its error."""
        G, seen, pose = self.recording.group, self.recording, self.errors[0]
        apart = G.log(seen.poses @ G.inverse(self.simulated.at(seen.times).pose))
        for part in G.parts:
            own, mean = apart[:, part.axes], apart[:, part.axes].mean(axis=0)
            varies = np.sum((own - mean) ** 2) > VARIES**2 * np.sum(own**2)
            if varies or _size(pose.difference, part) <= _size(pose.simulated, part):
                continue
            size = float(np.linalg.norm(mean))
            amount = f"{np.degrees(size):.3g} deg" if part.turns else f"{size:.3g} {part.pose_unit}"
            yield (
                f"The {part.name.replace('_', ' ')} of the recording differs from that of the run "
                f"by {amount} throughout; check `world` and `attitude` of the mapping, or move its "
                "poses to the world of the reference"
            )


def _size(values: Array, part: Part) -> float:
    return float(np.sum(values[:, part.axes] ** 2))


def measured_runs(
    result: Result,
    recording: Recording,
    controllers: Sequence[int],
    run: int,
    who: str = "a comparison with a recording",
) -> list[MeasuredRun]:
    """Align a recording with a run of several controllers.

    The clock of the recording is aligned once, with the controller whose run fits it best.

    Parameters
    ----------
    controllers
        Indices of the controllers; if empty, all whose run did not fail.
    who
        Name of the caller for messages.

    Raises
    ------
    EqtError
        If the result does not hold the run, or the recording cannot be aligned with it.
    """
    result.single(f"{who} needs a single experiment")
    result.check_stored(*NEEDED, who=f"{who} needs")
    G, times = recording.group, result.times
    states = [result.trajectory(name, run) for name in NEEDED[:3]]
    reference = Course(G, times, State(*(result[name] for name in NEEDED[3:])))
    simulated = {
        int(k): Course(G, times, State(*(each[k] for each in states)))
        for k in np.flatnonzero(result.good[:, run])
    }
    for k in controllers or [k for k in range(len(result.labels)) if not simulated]:
        if k not in simulated:
            raise result.error(f"run {run} of {result.labels[k]} failed; choose another")
    courses = {result.titles[k]: course for k, course in simulated.items()}
    found = Alignment(0.0) if recording.timed else _best_aligned(recording, courses)
    late = recording.times + found.offset
    slack = SAME_TIME * (times[-1] - times[0])
    inside = np.flatnonzero((times[0] - slack <= late) & (late <= times[-1] + slack))
    if len(inside) < 2:
        raise InputError(
            f"{recording.name}: expected two rows or more within the run, from {times[0]:.6g} to "
            f"{times[-1]:.6g} s, got {len(inside)}: its times are from {late[0]:.6g} to "
            f"{late[-1]:.6g} s; change time.offset of the mapping, or leave it out"
        )
    first, last = int(inside[0]), int(inside[-1]) + 1
    kept = recording.part(first, last, -(-(last - first) // MOST_ROWS)).shifted(found.offset)
    return [
        MeasuredRun(
            result.labels[k],
            result.titles[k],
            run,
            kept,
            last - first,
            found,
            course,
            reference,
        )
        for k, course in simulated.items()
        if not controllers or k in controllers
    ]


def _best_aligned(recording: Recording, courses: Mapping[str, Course]) -> Alignment:
    """Return the alignment with the run that correlates best; runs by titles of controllers."""
    found, errors = [], []
    for title, course in courses.items():
        try:
            one = aligned(recording, course.times, course.pieces)
        except InputError as error:
            errors.append(error)
        else:
            found.append(replace(one, by=f"{one.by} of {title}"))
    if not found:
        raise errors[0]
    return max(found, key=lambda each: each.correlation)
