"""Predictions of a plant under a recorded wrench, and how their error grows."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, Literal, NamedTuple, Self, TypeAlias

import numpy as np

from eqt_cli.base.arrays import Array, apply_matrix, as_array, norm
from eqt_cli.base.errors import EqtError, KeyPath, Problems
from eqt_cli.base.reporting import Block, TextTable, reporter, significant, step
from eqt_cli.components.actuators import THRUSTS, Actuator
from eqt_cli.components.blocks import COMMAND, Now, blocks_of, body
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.laws import Controller
from eqt_cli.components.mechanics import Tracking
from eqt_cli.components.motions import PlantModel, piece_at
from eqt_cli.components.references import ConstantReference
from eqt_cli.components.vehicle import ACTUATORS, Vehicle
from eqt_cli.config.experiment import Experiment
from eqt_cli.engines.engine import Engine, Problem
from eqt_cli.extensions.logs.recording_check import Recording, RecordingInFile
from eqt_cli.loop.closed_loop import VEHICLE, ClosedLoop
from eqt_cli.numbers.leaves import STRUCTURE, with_fields
from eqt_cli.runs.batches import differing

# The law that replays a recorded wrench -----------------------------------------------------------


Hold: TypeAlias = Literal["zero", "linear"]


@dataclass(frozen=True)
class Replay(RecordingInFile, Controller):
    """The wrench of a recording, replayed in open loop; nothing is claimed.

    With the reference `log` of the same file, the errors of a run are those of the prediction. The
    wrench passes through the actuators of the configuration, if there are any. Recorded speeds of
    rotors, in place of a wrench, are commands of their thrusts. A run over a gap of the recording
    is refused, because the wrench is not known there.

    Attributes
    ----------
    hold
        Between two rows: ``zero`` holds the wrench, as an autopilot holds its command; ``linear``
        interpolates a measured wrench.
    """

    name: ClassVar[str] = "replay"
    tasks: ClassVar[tuple[str, ...]] = ()
    theorem: ClassVar[str] = ""
    departs: ClassVar[str] = "no feedback, but a recorded wrench"

    hold: Hold = "zero"
    now: Any = field(default=None, init=False, repr=False)  # HeldWrench | None
    thrusts: Any = field(default=None, init=False, repr=False, metadata=STRUCTURE)  # (rows, k)

    @property
    def commands(self) -> str:  # type: ignore[override]  # a constant of most laws
        """Thrusts, where speeds of rotors were recorded; else a torque."""
        return "torque" if self.thrusts is None else THRUSTS

    def directions(self, G: MatrixLieGroup) -> Array:
        """Return all, or none of thrusts."""
        return super().directions(G)[: None if self.thrusts is None else 0]

    def for_plant(self, G: MatrixLieGroup, plant: PlantModel, problems: Problems) -> Self:
        """Return the law with the thrusts of recorded speeds."""
        recording = self.recording(G)
        if not recording.speeds.size or np.isfinite(recording.wrenches).any():
            return self
        try:
            rotors = rotors_of(recording, plant.actuators)
        except EqtError as error:
            problems.at("file").add(str(error))
            return self
        return with_fields(self, thrusts=rotors.pushed(recording.speeds))

    @property
    def structure(self) -> Hashable:
        """The options and the content of the file."""
        return type(self), repr(self)

    @property
    def formula(self) -> None:
        """None, because it is no law."""
        return None

    def torque(self, s: Tracking) -> Array:
        """Return the recorded wrench at the time of a state."""
        return (self.now or self.held(s.G, s.t)).torque(s)

    def instants(self, G: MatrixLieGroup, until: float) -> Array:
        """Return the times of the rows."""
        return self.recording(G).times

    def held(self, G: MatrixLieGroup, t: Any) -> HeldWrench:
        """Return the wrench from a time to the next row."""
        times, wrenches = self.recording(G).times, self.recording(G).wrenches
        if self.thrusts is not None:
            wrenches = np.pad(self.thrusts, ((0, 0), (G.dimension, 0)))
        row = piece_at(times, t)
        if self.hold == "zero":
            return HeldWrench(wrenches[row])
        row = np.minimum(row, len(times) - 2)
        slope = (wrenches[row + 1] - wrenches[row]) / (times[row + 1] - times[row])[..., None]
        return HeldWrench(wrenches[row], slope, np.asarray(times[row]))

    def with_held(self, held: HeldWrench | None) -> Self:
        """Return the law with this wrench."""
        return self if held is None else with_fields(self, now=held)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note an invalid file or mapping, and a file without a wrench."""
        self.check_file(problems, lambda: self._driving(G))

    def _driving(self, G: MatrixLieGroup) -> Array:
        """Return the speeds of rotors, or the wrenches; raises an `InputError` without both."""
        recording = self.recording(G)
        return recording.speeds if recording.speeds.size else recording.require_wrenches()


@dataclass(frozen=True)
class HeldWrench:
    """The wrench from a row of a recording to the next, or an array of these for some times.

    Attributes
    ----------
    wrench : (..., m)
        The wrench at the row.
    slope : (..., m)
        Its rate, per s; None where it is held.
    since
        The time of the row, s.
    """

    wrench: Array
    slope: Array | None = None
    since: Array | None = None

    def torque(self, s: Tracking) -> Array:
        """Return the wrench at the time of a state."""
        wrench = self.wrench
        if self.slope is not None:
            wrench = wrench + as_array(s.t - self.since)[..., None] * self.slope
        return wrench + 0.0 * s.P[..., :1]  # broadcast to all runs


# Predicts windows of a recording: the motion of a plant under the recorded wrench -----------------
#
# Each window is an ordinary problem for an engine, which starts from the recorded state in its
# first row. The wrench changes at the instants of the loop. Plants with other numbers, and other
# first states, are runs of the same problem.


WINDOWS = "windows"
"""The progress of a prediction is counted in windows."""

STEP = 1e-4
"""Step of a coordinate of the first state in difference quotients, rad, m, rad/s or m/s: far above
the error of an engine, and far below where the motion becomes nonlinear."""

FEWEST_ROWS = 5
"""Smallest number of rows in a window."""

THIRD = 20.0
"""Variance of third differences of white noise, relative to the variance of the noise."""

LEAST_NOISE = 1e-9
"""Smallest noise relative to the size of the measurements; less could be an engine's error."""

FIRST_ROWS = 10
"""Number of rows from which a first velocity is estimated where none was recorded."""


def driven(experiment: Experiment, law: Replay) -> ClosedLoop:
    """Return the plant of an experiment under a recorded wrench, without a clock and sensors.

    Raises
    ------
    EqtError
        If a part has a state that the recording does not hold, or numbers drawn for each run.
    """
    loop, shared = experiment.loop, experiment.vehicle
    configured = shared.configured or shared
    vehicle = replace(
        configured, control=None, pose_sensors=(), velocity_sensors=(), estimator=None
    )
    for place, part in vehicle.parts.items():
        if part.varies:
            raise EqtError(f"{place}: is drawn for each run; give a number to replay a recording")
    rotors = [_has_rotors(actuator) for actuator in vehicle.actuators]
    # Measured speeds already contain the rotors and the actuators before them.
    first = rotors.index(True) + 1 if law.recording(loop.group).speeds.size else 0
    flying = replace(vehicle, actuators=vehicle.actuators[first:]).of_run(loop.group)
    for index, actuator in enumerate(flying.actuators, start=first):
        if actuator.sampled or not _follows_linearly(actuator, loop.group):
            raise EqtError(
                f"{ACTUATORS}[{index}]: has a state that the recording does not hold; remove the "
                "actuator, and record the wrench that it applies"
            )
    alone = replace(loop, known_forces=(), reference=ConstantReference())  # no law adds to it
    return replace(alone, controller=law, vehicle=flying)


def _follows_linearly(actuator: Actuator, G: MatrixLieGroup) -> bool:
    """Whether the states of an actuator, if any, follow its commands alone, and linearly."""
    n, m = actuator.states(G), G.dimension
    if not n:
        return True
    x, command = np.random.default_rng(0).normal(size=(4, n)), np.ones((4, m))
    x[2:] = x[0] + x[1], 0.0 * x[0]
    if actuator.changes or actuator.reaction(G, command, x) is not None:
        return False
    return np.allclose(np.array([1, 1, -1, -1]) @ actuator.state_rate(G, command, x), 0.0)


FORGOTTEN = 10.0
"""Time constants after which an unknown state of an actuator counts no more: e⁻¹⁰ is 5e-5."""


@dataclass(frozen=True)
class Commanded:
    """The states of actuators, ẋ = A x + b(command), as a function of time, ``(n,)``.

    They start in equilibrium with the first command. A gap holds the command before it.

    Attributes
    ----------
    count
        How many there are.
    memory
        Time after which they no longer depend on an unknown state, s.
    at
        The function.
    """

    count: int
    memory: float
    at: Callable[[float], Array]

    def are_told(self, recording: Recording, row: int) -> bool:
        """Whether the commands before a row, since the start or a gap, tell them there."""
        begins = max((gap + 1 for gap in recording.gaps.tolist() if gap < row), default=0)
        return not self.count or recording.times[row] - recording.times[begins] >= self.memory


def commanded(loop: ClosedLoop) -> Commanded:
    """Return the states of the actuators of a loop under the recorded wrench."""
    from scipy.linalg import expm  # slow to import

    G, law, vehicle = loop.group, loop.controller, loop.vehicle
    assert isinstance(law, Replay)
    recording, ends = law.recording(G), np.cumsum([*vehicle.states(G).values()])
    if not len(ends):
        return Commanded(0, 0.0, lambda t: np.empty(0))
    n, u, times = int(ends[-1]), recording.wrenches, recording.times

    def rates(command: Array, x: Array) -> Array:
        states = dict(zip(vehicle.states(G), np.split(x, ends[:-1], axis=-1), strict=True))
        still = body(G, G.identity, 0.0 * command, states)
        moved = Now(blocks_of(vehicle, G), still, {COMMAND: command}).rates()
        return np.concatenate([moved[name] for name in states], axis=-1)

    b, eye = rates(u, np.zeros((len(u), n))), np.eye(n)
    A = (rates(np.tile(u[0], (n, 1)), eye) - b[0]).T
    slopes = np.zeros_like(b)
    if law.hold == "linear":
        slopes[:-1] = np.diff(b, axis=0) / np.diff(times)[:, None]
    # With x, b and the slope as one state, a step is one exponential.
    whole = np.kron(np.eye(3, k=1), eye)
    whole[:n, :n] = A
    steps, which = np.unique(np.diff(times).round(9), return_inverse=True)
    E = expm(whole * steps[:, None, None])[:, :n]
    x = np.linalg.solve(-A, b.T).T
    for k in range(len(times) - 1):
        x[k + 1] = E[which[k]] @ np.concatenate([x[k], b[k], slopes[k]])

    def at(t: float) -> Array:
        k = max(int(np.searchsorted(times, t, side="right")) - 1, 0)
        return expm(whole * (t - times[k]))[:n] @ np.concatenate([x[k], b[k], slopes[k]])

    return Commanded(n, FORGOTTEN / np.abs(np.linalg.eigvals(A).real).min(), at)


def by_rotors(vehicle: Vehicle, recording: Recording) -> Recording:
    """Return the recording with the wrench of its rotors, B f with the thrusts f at their speeds.

    Raises
    ------
    EqtError
        If the configuration has no such rotors, or the recording has a wrench, too.
    """
    if not recording.speeds.size:
        return recording
    rotors = rotors_of(recording, vehicle.actuators)
    rotors = rotors.of_run(recording.group, None)
    return replace(recording, wrenches=apply_matrix(rotors.matrix, rotors.pushed(recording.speeds)))


def rotors_of(recording: Recording, actuators: Sequence[Actuator]) -> Any:
    """Return the rotors whose speeds were recorded; raises an `EqtError` where there are none."""
    count = recording.speeds.shape[1]
    place = f"{recording.place}: {count} speeds of rotors"
    if np.isfinite(recording.wrenches).any():
        raise EqtError(f"{place} and a wrench; give other names to the columns of one of them")
    rotors: Any = next(filter(_has_rotors, actuators), None)
    if rotors is None or rotors.count != count:
        needed = f"an actuator `kind: thrusters` with `thrust_constant` and {count} thrusters"
        raise EqtError(f"{place} need {needed}")
    expected = [f"n{k}" for k in range(1, count + 1)]
    if wrong := [name for name in recording.rotors if name not in expected]:
        raise EqtError(
            f"{recording.place}: expected the speeds {expected[0]} to {expected[-1]} of {count} "
            f"rotors, got {wrong[0]}; rotor k has the column nk"
        )
    speeds = recording.speeds
    same = (speeds < 0) & (rotors.pushed(speeds) == rotors.pushed(np.abs(speeds)))
    if (below := np.argwhere(same & (rotors.pushed(speeds) != 0))).size:  # propellers have a sign
        row, rotor = below[0].tolist()
        raise EqtError(
            f"{recording.place}: {expected[rotor]} is {speeds[row, rotor]:g} rad/s at "
            f"t = {recording.times[row]:g} s; expected speeds of at least 0, since a rotor pushes "
            "with k n² along its axis and `turns` says in which sense it turns"
        )
    return rotors


def is_before_speeds(key: KeyPath, experiment: Experiment, recording: Recording) -> bool:
    """Whether measured speeds of rotors hold what an actuator does: the rotors or one before."""
    if key[0] != ACTUATORS or not recording.speeds.size:
        return False
    rotors = [_has_rotors(actuator) for actuator in experiment.vehicle.actuators]
    return int(key[1]) <= rotors.index(True)


def _has_rotors(actuator: Actuator) -> bool:
    return getattr(actuator, "thrust_constant", None) is not None


@dataclass(frozen=True)
class ReplayWindow:
    """Rows of a recording, and the state at which a prediction starts.

    Attributes
    ----------
    rows
        Rows of the recording, without a gap.
    pose : (d, d)
    velocity : (m,)
        The state in the first row.
    actuators : (n,)
        Where earlier commands do not tell the states of the actuators there, what is added to those
        of `Commanded`; else empty.
    """

    rows: slice
    pose: Array
    velocity: Array
    actuators: Array = field(default_factory=lambda: np.empty(0))

    def moved(self, G: MatrixLieGroup, by: Array) -> ReplayWindow:
        """Return the window with its first state moved: pose, velocity, and actuators."""
        pose, velocity, actuators = np.split(by, [G.dimension, 2 * G.dimension])
        return replace(
            self,
            pose=self.pose @ G.exp(pose),
            velocity=self.velocity + velocity,
            actuators=self.actuators + actuators,
        )


@dataclass(frozen=True)
class Windows:
    """A recording with wrenches, cut into windows to predict.

    Attributes
    ----------
    recording
        The recording.
    horizon
        The length of a window, s.
    """

    recording: Recording
    horizon: float

    @cached_property
    def starts(self) -> Array:
        """The rows at which a window without a gap can start.

        Raises
        ------
        EqtError
            If there is none.
        """
        times, name = self.recording.times, self.recording.name
        ends = self._ends
        stops = np.append(self.recording.gaps, len(times) - 1)
        last = stops[np.searchsorted(stops, np.arange(len(times)))]
        rows = np.flatnonzero(ends <= last)
        if not len(rows):
            longest = float((times[last] - times).max())
            raise EqtError(
                f"{name}: its longest stretch without a gap has {longest:.4g} s; give a horizon of "
                f"at most that, got {self.horizon:g} s"
            )
        fewest = int((ends - np.arange(len(times)))[rows].min()) + 1
        if fewest < FEWEST_ROWS:
            raise EqtError(
                f"{name}: a window of {self.horizon:g} s has {fewest} rows; give a longer horizon, "
                f"of at least {FEWEST_ROWS} rows"
            )
        return rows

    @property
    def _ends(self) -> Array:
        """For each row the last row of a window that starts there."""
        times = self.recording.times
        return np.searchsorted(times, times + self.horizon * (1 - 1e-9))

    def spread(self, count: int) -> list[ReplayWindow]:
        """Return at most `count` windows, spread over the recording; they may overlap."""
        chosen = np.linspace(0, len(self.starts) - 1, min(count, len(self.starts)))
        return [self._window(int(row)) for row in self.starts[np.round(chosen).astype(int)]]

    def disjoint(self) -> list[ReplayWindow]:
        """Return as many windows as possible that share no row, from the first row on."""
        chosen, last = [], -1
        for row in self.starts.tolist():
            if row > last:
                chosen.append(self._window(row))
                last = chosen[-1].rows.stop - 1
        return chosen

    def _window(self, row: int) -> ReplayWindow:
        rows = slice(row, int(self._ends[row]) + 1)
        velocity = self.recording.velocities[row]
        if np.isnan(velocity).any():  # the initial velocity of a parabola through the first poses
            G, few = self.recording.group, slice(row, min(row + FIRST_ROWS, rows.stop))
            t, poses = self.recording.times[few], self.recording.poses[few]
            powers = np.stack([np.ones_like(t), t - t[0], (t - t[0]) ** 2], axis=1)
            fitted = np.linalg.lstsq(powers, G.log(G.inverse(poses[0]) @ poses))[0]
            velocity = np.where(np.isnan(velocity), fitted[1], velocity)
        pose = self.recording.poses[row]
        pose = self.recording.group.identity if np.isnan(pose).any() else pose
        return ReplayWindow(rows, pose, velocity)

    @property
    def delay_step(self) -> float:
        """Step of the delay for its derivative: a tenth of that from row to row, s."""
        return 0.1 * float(np.median(np.diff(self.recording.times)))

    @property
    def parts(self) -> list[tuple[str, str, slice]]:
        """Name, unit and axes of each part of the pose and of the velocity that was recorded."""
        G = self.recording.group
        parts, m = [(part.name, part.error_unit, part.axes) for part in G.parts], G.dimension
        for part in G.parts:
            axes = slice(m + part.axes.start, m + part.axes.stop)
            parts.append((f"{part.name} rate", part.velocity_unit, axes))
        return [one for one in parts if np.isfinite(self.noise[one[2]]).all()]

    @cached_property
    def noise(self) -> Array:
        """The standard deviation of the measurements by third differences, ``(2m,)``.

        Coordinates of poses come first, then those of velocities; those not measured are NaN.
        Only noise that is independent from row to row is counted, no slow errors.
        """
        G, poses, V = self.recording.group, self.recording.poses, self.recording.velocities
        steps = G.log(G.inverse(poses[:-1]) @ poses[1:])
        third = np.concatenate([np.diff(steps, 2, axis=0), np.diff(V, 3, axis=0)], axis=1)
        for gap in self.recording.gaps.tolist():
            third[max(gap - 2, 0) : gap + 1] = 0.0
        sizes = np.concatenate([np.abs(steps).sum(axis=0), np.abs(V).max(axis=0)])
        return np.maximum(np.sqrt(np.mean(third**2, axis=0) / THIRD), LEAST_NOISE * (1 + sizes))


@dataclass(frozen=True)
class PredictionErrors:
    """Errors of the prediction of a window and their derivatives, in body coordinates.

    Attributes
    ----------
    values : (rows, 2m)
        Errors of the pose, log(Q⁻¹Q̂) with the measured Q, and of the velocity.
    by_state : (rows, 2m, 2m + n)
        Derivatives by the coordinates of the first state, and by states of actuators that no
        commands tell.
    by_number : (rows, 2m, p)
        Derivatives by the numbers of the plant.
    """

    values: Array
    by_state: Array
    by_number: Array


def prediction_errors(
    loops: Sequence[ClosedLoop],
    before: Sequence[Commanded],
    steps: Array,
    engine: Engine,
    recording: Recording,
    window: ReplayWindow,
    delay: float = 0.0,
    delay_step: float = 0.0,
) -> PredictionErrors | None:
    """Return the errors of a window; None where a run fails.

    Parameters
    ----------
    loops
        First a plant of the same structure, then the plant, then the plant with each of its
        numbers increased by a step. Pass the same first plant to every call, because an engine
        compiles it.
    before
        The states of the actuators of these plants as functions of time, by `commanded`.
    steps
        The increases of the numbers.
    delay
        Time by which the wrench was recorded late, s. The plant is moved in time instead, with
        whatever else of it depends on time.
    delay_step
        Step of the delay, s. If it is not 0, the last derivative by a number is that by the delay.
    """
    G, m, p = recording.group, recording.group.dimension, len(loops) - 2
    n = 2 * m + len(window.actuators)
    by = np.full(n, STEP)
    by[2 * m :] *= np.nanmax(np.abs(recording.wrenches), initial=0.0) or 1.0
    # Of each run: how far its start is moved from that of the window, and which loop it has.
    moves = np.concatenate([np.zeros((1, n)), np.diag(by), np.zeros((p, n))])
    loop_of_run = np.append(np.ones(1 + n, dtype=int), np.arange(2, p + 2))

    def ends_of(moves: Array, loop_of_run: Array, delay: float) -> Array | None:
        Q0, V0 = window.pose @ G.exp(moves[:, :m]), window.velocity + moves[:, m : 2 * m]
        times = recording.times[window.rows] + delay
        problem = Problem(loops[0], Q0, times, differing(list(loops), loop_of_run))
        loop = problem.batched_loop()
        states = loop.initial_state(Q0, V0, G.identity[None], np.zeros((1, m)), float(times[0]))
        stretches = [loop.layout.slices[VEHICLE + name] for name in loop.vehicle.states(G)]
        places = np.r_[*stretches, :0]
        starts = np.array([states_of.at(float(times[0])) for states_of in before])
        states[:, places] = starts[loop_of_run]
        if len(window.actuators):
            states[:, places] += window.actuators + moves[:, 2 * m :]
        problem = replace(problem, states=states)
        solution = engine.solve(problem)
        if solution.status.any():
            return None
        s = problem.batched_loop(1).tracking(times, solution.states)
        measured = recording.poses[window.rows], recording.velocities[window.rows]
        return np.concatenate([G.log(G.inverse(measured[0]) @ s.Q), s.V - measured[1]], axis=-1)

    delayed: Array | None = np.empty((0, 1, 2 * m))
    ends = ends_of(moves, loop_of_run, delay)
    if delay_step:
        delayed = ends_of(moves[:1], loop_of_run[:1], delay + delay_step)
    reporter().advance(1)
    if ends is None or delayed is None:
        return None
    change = ends[1:] - ends[0]
    by_state, by_number = change[:n] / by[:, None, None], change[n:] / steps[:, None, None]
    by_number = np.concatenate([by_number, (delayed - ends[:1]) / (delay_step or 1.0)])
    return PredictionErrors(ends[0], np.moveaxis(by_state, 0, -1), np.moveaxis(by_number, 0, -1))


DELAY = "delay"
"""The key of the time by which the wrench is recorded late, s."""

DISTINCT = 1e-3
"""Smallest singular value of the derivatives, scaled to length 1 for each number, at which the
recording distinguishes the numbers."""

CORRELATED = 3.0
"""Correlation from row to row from which a note appears, in standard deviations for white noise."""

APART = 2.0
"""Distance of a delay from 0 from which a note appears, in half-widths of its 95 % interval."""

MOST_OF = 0.5
"""Share of the squared errors above the noise that a delay explains where a model is not fitted."""


class Linear(NamedTuple):
    """The errors of a window, linearised about some numbers, in units of the noise.

    Attributes
    ----------
    residuals : (n,)
        Its errors that remain for the best first state.
    derivatives : (n, p)
        Their derivatives by the numbers.
    state : (2m + n,)
        The correction of the first state, with that of actuators that no commands tell.
    """

    residuals: Array
    derivatives: Array
    state: Array


def linear(errors: PredictionErrors, noise: Array) -> Linear:
    """Return the errors of the measured coordinates, in units of the noise, without first state."""
    measured = np.isfinite(noise)

    def weighted(values: Array) -> Array:
        return (values[:, measured] / noise[measured, None]).reshape(-1, values.shape[-1])

    parts = errors.values[..., None], errors.by_state, errors.by_number
    r, by_state, by_number = map(weighted, parts)
    state = np.zeros(by_state.shape[1])
    free = np.arange(len(state)) >= len(noise) // 2  # a pose that was not measured stays
    free[: len(noise)] |= measured
    basis, R = np.linalg.qr(by_state[:, free])
    state[free] = -np.linalg.lstsq(R, basis.T @ r)[0][:, 0]
    return Linear(
        (r - basis @ (basis.T @ r))[:, 0], by_number - basis @ (basis.T @ by_number), state
    )


def intervals(fits: Sequence[Linear]) -> Array:
    """Return the ends of 95 % intervals relative to the fitted numbers, ``(2, p)``.

    Errors may be correlated within a window. The variance is the sandwich of all windows with the
    adjustment CR2, and Student's t has the degrees of freedom that Bell and McCaffrey (2002) give
    for few windows, or for some that say more than others. With A_w = J_wᵀJ_w, A = Σ A_w and
    B_w = A_w^½ A⁻¹ A_w^½, the variance is A⁻¹ Σ u_w u_wᵀ A⁻¹,
    u_w = A_w^½ (1 − B_w)^−½ A_w^−½ J_wᵀr_w.
    """
    from scipy.special import stdtrit  # slow to import

    pulls, lengths, inverse, C, A = _sandwich(fits)
    sizes = norm(pulls.T)
    # Covariances of the terms, (p, windows, windows), if all errors are white.
    diagonal = np.einsum("wki,wij,wkj->kw", C, A, C)
    shared = np.einsum("wki,kvi->kwv", C @ A @ inverse, (C @ A).swapaxes(0, 1))
    covariance = diagonal[..., None] * np.eye(len(fits)) - shared
    freedom = np.trace(covariance, axis1=1, axis2=2) ** 2 / np.sum(covariance**2, axis=(1, 2))
    half = stdtrit(freedom, 0.975) * sizes / lengths
    return np.stack([-half, half])


def covariance(fits: Sequence[Linear]) -> Array:
    """Return the covariance of the fitted numbers, ``(p, p)``, the sandwich of `intervals`."""
    pulls, lengths, *_ = _sandwich(fits)
    return np.asarray(pulls.T @ pulls / np.outer(lengths, lengths))


def _sandwich(fits: Sequence[Linear]) -> tuple[Array, Array, Array, Array, Array]:
    """Return the terms C_w J_wᵀr_w ``(windows, p)`` of numbers scaled by lengths, and the rest."""
    lengths = norm(np.concatenate([one.derivatives for one in fits]).T)
    J = [one.derivatives / lengths for one in fits]
    A = np.array([jacobian.T @ jacobian for jacobian in J])
    inverse, root = np.linalg.inv(A.sum(axis=0)), _power(A, 0.5)
    free = np.eye(len(inverse)) - root @ inverse @ root
    C = inverse @ root @ _power(free, -0.5) @ _power(A, -0.5)  # A⁻¹u_w = C_w J_wᵀr_w
    pulls = np.array([jacobian.T @ one.residuals for jacobian, one in zip(J, fits, strict=True)])
    return (C @ pulls[..., None])[..., 0], lengths, inverse, C, A


def _power(A: Array, exponent: float) -> Array:
    """Return powers of symmetric matrices, ``(..., p, p)``, of singular ones on their range."""
    values, vectors = np.linalg.eigh(A)
    least = A.shape[-1] * np.finfo(float).eps * values[..., -1:]
    powers = np.where(values > least, np.maximum(values, least) ** exponent, 0.0)
    return (vectors * powers[..., None, :]) @ vectors.swapaxes(-1, -2)


def correlated(fits: Sequence[Linear], windows: Windows) -> Iterator[str]:
    """Say of which parts the errors are correlated from row to row, which white noise is not.

    The correlation of n white errors at a lag of one row has the standard deviation 1/√n; the
    correction of the first state makes it smaller.
    """
    measured = np.flatnonzero(np.isfinite(windows.noise))
    rows = [one.residuals.reshape(-1, len(measured)) for one in fits]
    said = []
    for name, _, axes in windows.parts:
        columns = (axes.start <= measured) & (measured < axes.stop)
        some = [row[:, columns] for row in rows]
        pairs = sum(float((series[1:] * series[:-1]).sum()) for series in some)
        lag = pairs / (sum(float((series**2).sum()) for series in some) or 1.0)
        count = min(sum(map(len, some)), len(windows.recording.times)) * int(columns.sum())
        if lag > CORRELATED / np.sqrt(count):
            said.append(f"{name} ({lag:.2f})")
    if said:
        yield (
            f"The errors are correlated from row to row: {', '.join(said)}. Such errors come from "
            "the model, from slow errors of the sensors or from a wrench at another time; `noise` "
            "counts only errors that are independent from row to row."
        )


def delayed(fits: Sequence[Linear], fitted: bool) -> Iterator[str]:
    """Say by which delay of the wrench the errors would be smaller.

    Parameters
    ----------
    found
        The last derivative of each window is that by the delay.
    fitted
        Whether the other numbers are the best ones. If not, a wrong number may look like a delay,
        so that the delay must explain most of the errors.
    """
    if len(fits) < 2:  # an interval needs windows to compare
        return
    derivatives = np.concatenate([one.derivatives for one in fits])
    residuals = np.concatenate([one.residuals for one in fits])
    lengths = np.linalg.norm(derivatives, axis=0)
    if not lengths.all() or np.linalg.svd(derivatives / lengths, compute_uv=False)[-1] < DISTINCT:
        return
    delay = -np.linalg.lstsq(derivatives, residuals)[0]
    left = residuals + derivatives @ delay
    best = [one._replace(residuals=one.residuals + one.derivatives @ delay) for one in fits]
    low, high = delay[-1] + intervals(best)[:, -1]
    by_noise = len(residuals) - sum(len(one.state) for one in fits)
    explains = residuals @ residuals - left @ left > MOST_OF * (residuals @ residuals - by_noise)
    apart = APART * max(high - delay[-1], delay[-1] - low) < abs(delay[-1])
    if apart and (fitted or explains):
        side = "later" if delay[-1] > 0 else "earlier"
        low, high = sorted(np.abs([low, high]))
        yield (
            f"The errors are smaller with the wrench of {abs(delay[-1]):.2g} s {side} (95 % "
            f"interval [{low:.2g}, {high:.2g}]): it was recorded with another delay than the "
            f"motion, or acts with one. Fit it: --over …,{DELAY}."
        )


# Measures how the error of a prediction grows with its horizon, over windows of a recording -------


HORIZONS = 10
"""Largest number of horizons: rows of the first window, spread up to its last."""

LOW, HIGH = 0.1, 0.9
"""Quantiles of the errors over the windows."""


@dataclass(frozen=True)
class Growth:
    """Errors of predictions from recorded states, by part of the pose and of the velocity.

    Attributes
    ----------
    name
        The recording.
    windows
        The number of windows.
    failed
        The number of windows without a prediction, because the run failed.
    horizons : (h,)
        Times since the start of a window, s.
    parts, units
        The rows of the errors: parts of the pose, then of the velocity where it was recorded.
    median, low, high, rms : (parts, h)
        Median, 10 % and 90 % quantile, and root mean square of the error over the windows.
    noise : (parts, h)
        The root mean square error of a perfect model, which the noise of the recording causes: in
        the first state, from which it grows, and in the row at the horizon. A first velocity
        that was not recorded counts as exact.
    notes
        Remarks on the recording and the model.
    """

    name: str
    windows: int
    failed: int
    horizons: Array
    parts: tuple[str, ...]
    units: tuple[str, ...]
    median: Array
    low: Array
    high: Array
    rms: Array
    noise: Array
    notes: tuple[str, ...] = ()


def growth(loop: ClosedLoop, engine: Engine, windows: Windows, count: int, delay: float) -> Growth:
    """Measure the growth of the error over at most `count` windows, spread over the recording.

    The wrench is recorded a `delay` late, s.

    Raises
    ------
    EqtError
        If no window can be predicted.
    """
    recording, variances = windows.recording, windows.noise**2
    measured = np.isfinite(windows.noise)
    parts, chosen = windows.parts, windows.spread(count)
    norms, by_noise, left = [], [], []
    first = recording.times[chosen[0].rows]
    sampled = np.unique(np.linspace(0, len(first) - 1, HORIZONS + 1).round().astype(int)[1:])
    horizons = first[sampled] - first[0]
    pair, before = [loop, loop], [commanded(loop)] * 2
    with step(WINDOWS, len(chosen)):
        for window in chosen:
            prediction = prediction_errors(
                pair, before, np.empty(0), engine, recording, window, delay, windows.delay_step
            )
            if prediction is None:
                continue
            left.append(linear(prediction, windows.noise))
            times = recording.times[window.rows]
            rows = np.abs(times[:, None] - times[0] - horizons).argmin(axis=0)
            spread = prediction.by_state[rows] ** 2 @ np.where(measured, variances, 0.0) + variances
            norms.append([norm(prediction.values[rows][:, axes]) for _, _, axes in parts])
            by_noise.append([spread[:, axes].sum(axis=1) for _, _, axes in parts])
    if not norms:
        raise EqtError(
            f"{recording.name}: the runs of all {len(chosen)} windows failed; check the inertia "
            "and the units of the wrench"
        )
    sizes = np.array(norms)
    low, median, high = np.quantile(sizes, [LOW, 0.5, HIGH], axis=0)
    return Growth(
        recording.name,
        len(chosen),
        len(chosen) - len(norms),
        horizons,
        tuple(name for name, _, _ in parts),
        tuple(unit for _, unit, _ in parts),
        median,
        low,
        high,
        np.sqrt(np.mean(sizes**2, axis=0)),
        np.sqrt(np.mean(by_noise, axis=0)),
        (*correlated(left, windows), *delayed(left, fitted=False)),
    )


def growth_table(result: Growth) -> TextTable:
    """Return the error of each part at each horizon: median, quantiles, rms, and that by noise."""
    header = ["horizon, s", "median", "10 %", "90 %", "rms", "noise"]
    sizes = np.stack([result.median, result.low, result.high, result.rms, result.noise], axis=-1)
    blocks = []
    for part, unit, of_part in zip(result.parts, result.units, sizes, strict=True):
        pairs = zip(result.horizons, of_part, strict=True)
        rows = [[f"{horizon:.4g}", *(significant(x, 3) for x in row)] for horizon, row in pairs]
        blocks.append(Block(f"{part}, {unit}", rows))
    failed = f"; the runs of {result.failed} more failed" if result.failed else ""
    title = f"Error of the prediction of {result.name} over {result.windows} windows{failed}"
    notes = [
        "Each window starts in a recorded state. noise: the rms that the noise of the recording "
        "alone gives a perfect model.",
        *result.notes,
    ]
    return TextTable("growth", title, header, blocks, notes)
