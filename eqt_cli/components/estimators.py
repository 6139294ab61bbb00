"""Estimators of pose and velocity: base class, schedule, complementary and Kalman filters."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property, partial
from typing import Annotated, Any, ClassVar, NamedTuple, Self

import numpy as np

from eqt_cli.base.arrays import Array, Arrays, apply_matrix, less, repeated, sqrt, transpose, where
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import POSE, VELOCITY, Scale, Unit
from eqt_cli.base.registry import Registry
from eqt_cli.components import mechanics
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.pose_notation import vector
from eqt_cli.components.sensors import FIXES, Channel
from eqt_cli.components.vehicle_parts import Numbers, VehiclePart, check_count, drawn
from eqt_cli.numbers.leaves import with_fields

# The measurements that an estimator may have of each instant; it knows no estimator ---------------


@dataclass(frozen=True, eq=False)
class Schedule:
    """Times at which parts of pose and velocity are measured, and at which that is known.

    Attributes
    ----------
    channels
        Parts that have sensors.
    period
        Tick of the loop, s.
    """

    G: MatrixLieGroup
    channels: Sequence[Channel]
    period: float

    @cached_property
    def fixes(self) -> list[Channel]:
        """Measured parts of the pose."""
        return [channel for channel in self.channels if channel.signal in FIXES]

    @cached_property
    def rare(self) -> list[Channel]:
        """Measured parts of the velocity without a new measurement at every tick."""
        return [
            channel for channel in self.channels if channel.signal == "velocity" and channel.holds
        ]

    @cached_property
    def timed(self) -> list[Channel]:
        """Parts of which an estimator reads when they are measured, those of the pose first."""
        return [*self.fixes, *self.rare]

    @cached_property
    def depth(self) -> int:
        """Largest delay of a measurement, in ticks."""
        return max((channel.delay for channel in self.channels), default=0)

    @cached_property
    def axes(self) -> list[int]:
        """Measured coordinates of the pose."""
        return [axis for channel in self.fixes for axis in self.axes_of(channel)]

    @property
    def unmeasured(self) -> list[str]:
        """Names of the parts of the pose that no sensor measures."""
        measured = [channel.part.name for channel in self.fixes]
        return [part.name for part in self.G.parts if part.name not in measured]

    def axes_of(self, channel: Channel) -> range:
        """Return the coordinates of a part."""
        return range(self.G.dimension)[channel.part.axes]

    def of_axes(self, signal: str, option: str, default: int) -> Array:
        """Return ``every`` or ``delay`` of each coordinate of a signal, ``(m,)``."""
        values = np.full(self.G.dimension, default)
        for channel in self.channels:
            if channel.signal == signal:
                values[channel.part.axes] = getattr(channel, option)
        return values

    def waits(self, channel: Channel) -> int:
        """Return the number of earlier measurements of a part to keep."""
        return self.depth - channel.delay

    @property
    def fixed_steps(self) -> int:
        """Number of steps from the oldest instant on at whose end a fix can be known."""
        return 1 + max(map(self.waits, self.fixes), default=0)


# The base class of estimators, which give the law pose and velocity from measurements -------------
#
# It knows no law or engine. All kinds share which measurement belongs to which instant, and where
# an estimate starts.


INNOVATIONS = 3
"""Length of the sums over all innovations: count, squares, products of successive ones."""


class Deviations(NamedTuple):
    """Deviations of errors that the sensors specify, for each coordinate, ``(m,)`` each.

    Attributes
    ----------
    pose, velocity
        Standard deviations of the white noise of one measurement.
    bias, walk
        The root mean square of the bias of the velocity at t = 0, and the deviation of its drift
        after one second.
    depth
        That of the white noise of a measured depth, in the last coordinate.
    """

    pose: Array
    velocity: Array
    bias: Array
    walk: Array
    depth: Array = np.empty(0)


class Estimate(NamedTuple):
    """An estimate at an instant.

    Attributes
    ----------
    pose : (..., d, d)
        Q̂.
    bias : (..., m)
        b̂.
    covariance : (..., n, n)
        Σ of (log(Q̂⁻¹Q), b − b̂, n − n̂), with n = 3m; n = 0 for kinds without one.
    noise : (..., m)
        n̂, the noise of the last measured velocity, which the next prediction uses once more.
    age : (..., m)
        Ticks since that measurement.
    drift, share : (..., m)
        For the next prediction: ticks through which the bias drifts, 0 without a measurement at
        its end, and the weight of that measurement, 0 where it is not known yet.
    speed : (..., 3)
        v̂ in space, m/s, of kinds that have it.
    """

    pose: Array
    bias: Array
    covariance: Array
    noise: Any = 0.0
    age: Any = 0.0
    drift: Any = 1.0
    share: Any = 0.5
    speed: Any = 0.0


FIX = "fix_"
"""Prefix of the names of the fixes of a step."""


class Fix(NamedTuple):
    """A fix: the measured parts of a pose.

    Attributes
    ----------
    pose : (..., d, d)
        Q̂ with the measured parts in their place.
    arrived : (..., m)
        1 for each measured coordinate, else 0; one more with a depth.
    depth : (..., d, d)
        Q̂ with the measured depth.
    """

    pose: Array
    arrived: Array
    depth: Any = 0.0


class Measurement(NamedTuple):
    """Measurements, and the truth, at a control instant.

    Attributes
    ----------
    pose, velocity
        Measurements as they have arrived, ``(..., d, d)`` and ``(..., m)``.
    fresh : (..., parts)
        1 for each `timed` part with a measurement now that will arrive, else 0.
    true_pose, true_bias
        Q and b, for the error and the start of the estimate.
    ports
        All ports of the vehicle, `blocks.Now`, for kinds that read more.
    """

    pose: Array
    velocity: Array
    fresh: Array
    true_pose: Array
    true_bias: Array
    ports: Any = None

    def of(self, channel: Channel) -> Array:
        """Return the entries of a fix."""
        pose = self.pose if channel.signal == "pose" else self.ports[f"arrived.{channel.signal}"]
        entries: Array = pose[channel.entries]
        return entries


@dataclass(frozen=True)
class Estimator(VehiclePart):
    """A filter on G with a bias of the velocity in g; the law reads Q̂ and V̂ = V_m − b̂.

    At each tick it predicts with the mean of the last two measured velocities, corrects
    with the parts of the pose that are measured at that instant, and tells the law. Where a
    velocity is not measured at every tick, the last one stands in; the next one makes up for that,
    so that the mean of the two counts for the time between them. Where measurements arrive late,
    it keeps the estimate at the oldest instant of which one may still come, and at each instant
    repeats the steps from there to the present with all that is known by then. Between instants
    the estimate is held.

    b̂ starts at 0, and Q̂ at the first fix.

    Attributes
    ----------
    initial_error
        log(Q̂⁻¹Q) at the start, or its distribution. Q̂ then starts with this error, and the first
        fix corrects it.
    """

    departs: ClassVar[str] = "estimated state"
    vectors: ClassVar[tuple[str, ...]] = ("initial_error",)

    has_covariance: ClassVar[bool] = False
    """Whether the estimate has a covariance."""

    initial_error: Annotated[Numbers | None, Unit(POSE)] = field(default=None, kw_only=True)

    # For kinds to define.

    def completed(self, G: MatrixLieGroup, deviations: Deviations) -> "Estimator":
        """Return the estimator with the deviations of the sensors where none are given."""
        return self

    def check_sensors(self, schedule: Schedule, deviations: Deviations, problems: Problems) -> None:
        """Note what does not fit the sensors."""

    def first(self, G: MatrixLieGroup, pose: Array) -> Estimate:
        """Return the estimate at the start, at a pose."""
        bias = np.zeros_like(pose, shape=(*pose.shape[:-2], G.dimension))
        return Estimate(pose, bias, bias[..., None, :0][..., :0, :])

    @abstractmethod
    def predicted(
        self, schedule: Schedule, estimate: Estimate, velocity: Array, duration: Array
    ) -> Estimate:
        """Return the estimate a duration later, s, ``(..., 1)``, which may be 0.

        Parameters
        ----------
        velocity : (..., m)
            Mean of the velocities measured over the duration.
        """

    @abstractmethod
    def corrected(
        self, schedule: Schedule, estimate: Estimate, fix: Fix
    ) -> tuple[Estimate, Array | None]:
        """Return the estimate after a fix, and the whitened innovations ``(..., m)``, if any."""

    def states(self, schedule: Schedule) -> dict[str, int]:
        """Return the length of each state that is kept from instant to instant, by name."""
        G, depth = schedule.G, schedule.depth
        m, n = G.dimension, 3 * G.dimension * self.has_covariance
        sizes = {"pose": G.pose_length, "bias": m, "covariance": n * (n + 1) // 2}
        sizes |= {"noise": n // 3, "age": m if schedule.rare else 0}
        behind = {f"behind_{name}": length for name, length in sizes.items()}
        sizes |= {"velocity": m, "error": 2 * m, "begun": 1, "past_velocity": (depth + 1) * m}
        if self.has_covariance:
            sizes |= {"innovations": INNOVATIONS, "last_innovation": m, "lost": 1}
        if depth:
            sizes |= behind | {"past_live": depth, "past_fresh": depth * len(schedule.timed)}
            sizes |= {
                f"past_fix_{channel.part.name}": schedule.waits(channel) * channel.size
                for channel in schedule.fixes
            }
        return {name: length for name, length in sizes.items() if length}

    def after(self, schedule: Schedule, measured: Measurement, states: Arrays) -> dict[str, Array]:
        """Return the states after an instant."""
        G, depth, begun = schedule.G, schedule.depth, states["begun"]
        has_start = self.initial_error is not None  # else it starts at the first fix
        past = _Past(schedule, measured, states)
        here = self._loaded(G, states, "behind_" if depth else "")
        pose = measured.true_pose.copy()
        if self.initial_error is not None:  # symbols, or many runs, with leading axes as the pose
            pose = measured.true_pose @ G.exp(-1.0 * self.initial_error)
        else:
            for channel in schedule.fixes:
                pose[channel.entries] = measured.pose[channel.entries]
        start = self.first(G, pose)
        is_begun = less(0.5, begun)
        here = here._replace(
            pose=where(is_begun[..., None], here.pose, start.pose),
            bias=where(is_begun, here.bias, start.bias),
            covariance=where(is_begun[..., None], here.covariance, start.covariance),
        )
        rows = [past.row(step, has_start) for step in range(depth + 1)]
        fixed, unfixed = rows[: schedule.fixed_steps], rows[schedule.fixed_steps :]
        step = partial(self._fixed, schedule, bool(unfixed))
        estimate = self._stored(schedule, here)
        first, last = repeated(step, estimate, fixed)
        changed = {f"behind_{name}": first[name] for name in estimate if depth}
        if unfixed:
            last = {name: last[name] for name in estimate}
            _, last = repeated(partial(self._ahead, schedule), last, unfixed, apart=True)
        here = self._loaded(G, last)
        changed |= self._stored(schedule, here) | past.later
        error = G.log(G.inverse(here.pose) @ measured.true_pose)
        changed["velocity"] = measured.velocity - here.bias
        changed["error"] = np.concatenate([error, measured.true_bias - here.bias], axis=-1)
        changed["begun"] = 1.0 + 0.0 * begun
        if "innovations" in first:
            # Count, squares and products of the innovations, and the last ones
            innovations, arrived = first["innovations"], first["arrived"]
            previous, counted = states["last_innovation"], innovations * arrived
            sums = arrived, counted * counted, counted * previous
            new = [np.asarray(total.sum(axis=-1))[..., None] for total in sums]
            changed["innovations"] = states["innovations"] + np.concatenate(new, axis=-1)
            changed["last_innovation"] = where(less(0.5, arrived), innovations, previous)
            judged = slice(0, 2 * G.dimension)
            changed["lost"] = indefinite(here.covariance[..., judged, judged])[..., None]
        return changed

    def _fixed(self, schedule: Schedule, apart: bool, estimate: Arrays, row: Arrays) -> Arrays:
        """Return the estimate after a step with its fix, and the innovations, if any."""
        motion = {name: array for name, array in row.items() if not name.startswith(FIX)}
        ahead, _ = repeated(partial(self._ahead, schedule), estimate, [motion], apart)
        here = self._loaded(schedule.G, ahead)
        fix = _fix(schedule, row, here.pose)
        here, innovations = self.corrected(schedule, here, fix)
        more = {} if innovations is None else {"innovations": innovations, "arrived": fix.arrived}
        return self._stored(schedule, here) | more

    def _ahead(self, schedule: Schedule, estimate: Arrays, row: Arrays) -> Arrays:
        """Return the estimate after a step without its fix."""
        here = _weighed(schedule, row, self._loaded(schedule.G, estimate))
        # The noise of the first velocity, where it is estimated, is taken off.
        first, last = row["first"] - here.noise, row["last"]
        velocity = (1.0 - here.share) * first + here.share * last
        here = self.predicted(schedule, here, velocity, schedule.period * row["live"])
        return self._stored(schedule, here)

    def _loaded(self, G: MatrixLieGroup, states: Arrays, prefix: str = "") -> Estimate:
        pose, bias = G.unpack(states[f"{prefix}pose"]), states[f"{prefix}bias"]
        age = states.get(f"{prefix}age", 0.0)
        if not self.has_covariance:
            return Estimate(pose, bias, self.first(G, pose).covariance, age=age)
        covariance = symmetric(states[f"{prefix}covariance"], 3 * G.dimension)
        return Estimate(pose, bias, covariance, states[f"{prefix}noise"], age)

    def _stored(self, schedule: Schedule, estimate: Estimate) -> dict[str, Array]:
        stored = {"pose": schedule.G.pack(estimate.pose), "bias": estimate.bias}
        if self.has_covariance:
            rows, columns, _ = _triangle(3 * schedule.G.dimension)
            stored |= {
                "covariance": estimate.covariance[..., rows, columns],
                "noise": estimate.noise,
            }
        if schedule.rare:
            stored["age"] = estimate.age
        return stored


class _Past:
    """The measurements known at an instant, of the steps from the oldest instant kept to now."""

    def __init__(self, schedule: Schedule, measured: Measurement, states: Arrays) -> None:
        self._schedule, self._measured, self._begun = schedule, measured, states["begun"]
        m, depth, parts = schedule.G.dimension, schedule.depth, len(schedule.timed)
        self._velocities = [*_cut(states["past_velocity"], m, depth + 1), measured.velocity]
        self._live = [*_cut(states.get("past_live"), 1, depth), self._begun]
        self._fresh = [*_cut(states.get("past_fresh"), parts, depth), measured.fresh]
        self._values = []
        for channel in schedule.fixes:
            value = measured.of(channel)
            value = value.reshape(*value.shape[: value.ndim - len(channel.shape)], channel.size)
            ring = states.get(f"past_fix_{channel.part.name}")
            self._values.append([*_cut(ring, channel.size, schedule.waits(channel)), value])
        self._delays = schedule.of_axes("velocity", "delay", 0)

    @property
    def later(self) -> dict[str, Array]:
        """The measurements to keep for the next instant, as states."""
        rings = {"velocity": self._velocities, "live": self._live, "fresh": self._fresh}
        for channel, values in zip(self._schedule.fixes, self._values, strict=True):
            rings[f"fix_{channel.part.name}"] = values
        past = {f"past_{name}": ring[1:] for name, ring in rings.items() if ring[1:]}
        return {name: np.concatenate(ring, axis=-1) for name, ring in past.items()}

    def row(self, step: int, at_start: bool) -> dict[str, Array]:
        """Return the measurements of a step.

        They are the velocities ``first`` and ``last`` at its ends, and whether it is ``live``: 0
        before the start. Where velocities are not measured at every tick, ``fresh`` is 1 for each
        of these parts that is measured at its end, and ``known`` for each axis that is not late.
        For each fix they are its values, and whether it is fresh. The first one counts `at_start`.
        """
        schedule, live = self._schedule, self._live[step]
        row = {"live": live, "first": self._measured_at(step - 1), "last": self._measured_at(step)}
        if schedule.rare:
            row["fresh"] = self._fresh[step][..., len(schedule.fixes) :]
            row["known"] = np.where(step <= schedule.depth - self._delays, 1.0, 0.0)
        if step >= schedule.fixed_steps:
            return row
        for number, (channel, values) in enumerate(zip(schedule.fixes, self._values, strict=True)):
            value, fresh = values[-1], np.zeros_like(live)
            if step <= schedule.waits(channel):
                value, fresh = values[step], self._fresh[step][..., number, None]
            if at_start and step == 0:
                value = where(less(0.5, self._begun), value, values[-1])
            row |= {f"{FIX}{number}": value, f"{FIX}{number}_fresh": fresh}
        if at_start:
            row[f"{FIX}starts"] = 1.0 - self._begun if step == 0 else np.zeros_like(live)
        return row

    def _measured_at(self, step: int) -> Array:
        """Return the velocity at the end of a step, of each axis the last that is known there."""
        depth = self._schedule.depth
        places = [min(depth + 1, step + 1 + delay) for delay in self._delays.tolist()]
        if len(set(places)) == 1:
            return self._velocities[places[0]]
        columns = [self._velocities[k][..., axis, None] for axis, k in enumerate(places)]
        return np.concatenate(columns, axis=-1)


def _weighed(schedule: Schedule, row: Arrays, here: Estimate) -> Estimate:
    """Return the estimate before a step, with the weight of the velocity at its end."""
    new = np.ones(schedule.G.dimension)
    if not schedule.rare:
        return here._replace(drift=new, share=new / 2)
    new = new + 0.0 * row["last"]
    for number, channel in enumerate(schedule.rare):
        new[channel.entries] = row["fresh"][..., number, None]
    drift = new * (1.0 + here.age)  # its half makes up for the ticks of the last one
    age = (1.0 - new) * (here.age + row["live"])
    return here._replace(age=age, drift=drift, share=row["known"] * drift / 2)


def _fix(schedule: Schedule, row: Arrays, pose: Array) -> Fix:
    """Return the fix at the end of a step, at which the pose is that without it."""
    fixed, arrived, depth = pose.copy(), 0.0 * row["last"], pose
    for number, channel in enumerate(schedule.fixes):
        value, count = row[f"{FIX}{number}"], row["live"] * row[f"{FIX}{number}_fresh"]
        count = count + row.get(f"{FIX}starts", 0.0)
        was = pose[channel.entries]
        counts = less(0.5, count.reshape(*count.shape[:-1], *(1,) * len(channel.shape)))
        if channel.signal == "depth":  # behind the pose, as in `channels`
            depth, arrived = pose.copy(), np.concatenate([arrived, count], axis=-1)
            depth[channel.entries] = where(counts, value.reshape(was.shape), was)
            continue
        fixed[channel.entries] = where(counts, value.reshape(was.shape), was)
        arrived[..., channel.part.axes] = count
    return Fix(fixed, arrived, depth)


def _cut(ring: Array | None, length: int, count: int) -> list[Array]:
    """Return the entries of a ring, the oldest first."""
    if ring is None:
        return []
    return [ring[..., k * length : (k + 1) * length] for k in range(count)]


def symmetric(upper: Array, n: int) -> Array:
    """Return the symmetric matrix with these entries on and above its diagonal, row by row."""
    return upper[..., _triangle(n)[2]]


@cache
def _triangle(n: int) -> tuple[Array, Array, Array]:
    """Return rows and columns on and above a diagonal, and the number of each entry there."""
    rows, columns = np.triu_indices(n)
    place = np.zeros((n, n), dtype=int)
    place[rows, columns] = place[columns, rows] = np.arange(len(rows))
    return rows, columns, place


def pivots(matrix: Array, vector: Array) -> tuple[list[Array], list[Array]]:
    """Return the n entries of d in a symmetric matrix LDLᵀ, and of L⁻¹v, ``(...)`` each.

    A row that is 0 has the pivot 0, and eliminates nothing.
    """
    n = matrix.shape[-1]
    rows = [matrix[..., k, :] for k in range(n)]
    y, d = [vector[..., k] for k in range(n)], []
    for k in range(n):
        pivot = rows[k][..., k]
        d.append(pivot)
        none = where(less(0.0, pivot), 0.0, where(less(pivot, 0.0), 0.0, 1.0))
        over = 1.0 / (pivot + none)
        for j in range(k + 1, n):
            factor = rows[k][..., j] * over
            rows[j] = rows[j] - factor[..., None] * rows[k]
            y[j] = y[j] - factor * y[k]
    return d, y


def indefinite(covariance: Array) -> Array:
    """Return 1 where a symmetric matrix has a negative pivot, else 0, ``(...)``."""
    d, _ = pivots(covariance, covariance[..., 0, :])
    lost = 0.0 * d[0]
    for pivot in d:
        lost = where(less(pivot, 0.0), 1.0, lost)
    return lost


estimators = Registry("estimator", "estimators", Estimator, ("components.estimators",))


# The complementary filter, with constant gains ----------------------------------------------------


@dataclass(frozen=True)
class Complementary(Estimator):
    """Complementary filter: Q̂̇ = Q̂ (V̂ + k_P σ)^, b̂̇ = −k_I σ, in its gradient form on every group.

    σ is the gradient of ½‖Q̂⁻¹Q_m − I‖²_F, each coordinate over the ‖E_i‖²_F of its generator. On
    SO(3) that is half of the antisymmetric part of Q̂⁻¹Q_m, and the filter is the passive one of
    Mahony, Hamel and Pflimlin, IEEE Trans. Autom. Control 53 (2008) 1203. A fix acts once for the
    time since the one before: Q̂ ← Q̂ exp(T k_P σ), b̂ ← b̂ − T k_I σ.

    Attributes
    ----------
    kp
        k_P, 1/s.
    ki
        k_I, 1/s².
    """

    name: ClassVar[str] = "complementary"
    vectors: ClassVar[tuple[str, ...]] = ("kp", "ki", "initial_error")

    kp: Annotated[Numbers, Scale("filter gain k_P", "1/s")] = 1.0
    ki: Annotated[Numbers, Scale("filter gain k_I", "1/s²")] = 0.3

    def check_sensors(self, schedule: Schedule, deviations: Deviations, problems: Problems) -> None:
        """Note gains with which the estimate cannot settle, for the time between two fixes."""
        G = schedule.G
        kp, ki = (vector(drawn(gain, None), G.dimension, G) for gain in (self.kp, self.ki))
        for channel in schedule.fixes:
            T = channel.every * schedule.period
            for axis in schedule.axes_of(channel):
                a, b = T * kp[axis], T * T * ki[axis]
                # (ε, Tb̃) from fix to fix: the prediction ε − Tb̃ is corrected by the gains a and b.
                step = np.array([[1 - a, a - 1], [b, 1 - b]])
                largest = float(np.abs(np.linalg.eigvals(step)).max())
                if largest > 1:
                    problems.add(
                        f"the estimate of the {channel.part.name} does not settle with fixes "
                        f"every {T:g} s: an error grows by {largest:.3g} from one to the next; "
                        f"choose kp between 0 and {2 / T:g} and a smaller ki"
                    )
                    break

    def predicted(
        self, schedule: Schedule, estimate: Estimate, velocity: Array, duration: Array
    ) -> Estimate:
        """Return the estimate with Q̂ exp(hV̂)."""
        return estimate._replace(
            pose=estimate.pose @ schedule.G.exp(duration * (velocity - estimate.bias))
        )

    def corrected(self, schedule: Schedule, estimate: Estimate, fix: Fix) -> tuple[Estimate, None]:
        """Return the estimate corrected by σ in the measured coordinates."""
        G: MatrixLieGroup = schedule.G
        options: Any = self  # in a run, options are arrays
        intervals = schedule.of_axes("pose", "every", 1) * schedule.period
        squares = (G.basis * G.basis).sum(axis=(-2, -1))
        slope = mechanics.gradient(G, G.identity, G.inverse(estimate.pose) @ fix.pose)
        sigma = intervals * fix.arrived * (slope / squares)
        pose, bias = estimate.pose @ G.exp(options.kp * sigma), estimate.bias - options.ki * sigma
        return estimate._replace(pose=pose, bias=bias), None


# Filters with a covariance: the error-state, the equivariant and the invariant one ----------------


# Kalman filter for the errors log(Q̂⁻¹Q) of the pose and b − b̂ of the bias, on any group ---------
#
# The V of Q̇ = Q V^ is measured as V_m = V + b + n, with a bias b that walks; a fix is Q exp(n), or
# parts of it. With V̂ = V_m − b̂, ε̇ = −ad_V̂ ε − b̃ − n to first order. This module must not know
# how a kind applies a correction.


DEVIATIONS = ("pose_std", "velocity_std", "bias_walk", "initial_pose_std", "initial_bias_std")
"""Options that are standard deviations."""


@dataclass(frozen=True)
class ErrorStateFilter(Estimator):
    """The base class of filters with a covariance, which differ in how they apply a correction.

    A step of h seconds is Q̂ ← Q̂ exp(x) with x = ½h(V_k − n̂ + V_k+1) − hb̂ of two measured
    velocities. The noise n of one enters the steps before and after it, so Σ has its rows:
    ε ← Ad_exp(x)⁻¹ ε − J(−x) h(b̃ + ½(n − n̂) + ½(n' + w)), b̃ ← b̃ + w, n ← n', with n' of deviation
    σ_v, and w of √h σ_b. A fix is taken coordinate by coordinate, in Joseph form.

    Attributes
    ----------
    pose_std
        Standard deviation of a fix, in the coordinates of the algebra. Default: that of the noise
        of `sensors.pose`.
    velocity_std
        Standard deviation of a velocity measurement. Default: that of the noise of
        `sensors.velocity`.
    bias_walk
        Standard deviation of the drift of the bias after one second. Default: the `walk` of the
        bias of `sensors.velocity`.
    initial_pose_std
        Standard deviation of log(Q̂⁻¹Q) at the start, with which each run draws Q̂. Default: Q̂
        starts at the first fix, with its deviation.
    initial_bias_std
        Standard deviation of the bias at the start. Default: the rms of the `value` of the bias.
    """

    vectors: ClassVar[tuple[str, ...]] = (*DEVIATIONS, "initial_error")
    has_covariance: ClassVar[bool] = True

    pose_std: Annotated[Numbers | None, Scale("assumed deviation of a fix", POSE)] = None
    velocity_std: Annotated[Numbers | None, Scale("assumed deviation of a velocity", VELOCITY)] = (
        None
    )
    bias_walk: Annotated[Numbers | None, Scale("assumed drift of the bias")] = None
    initial_pose_std: Annotated[Numbers | None, Scale("initial deviation of the pose", POSE)] = None
    initial_bias_std: Annotated[
        Numbers | None, Scale("initial deviation of the bias", VELOCITY)
    ] = None

    # For kinds to define.

    @abstractmethod
    def output(self, G: MatrixLieGroup, residual: Array) -> Array:
        """Return H of log(Q̂⁻¹Q_m) = H ε + n_p, ``(..., m, m)``; the left side is measured."""

    @abstractmethod
    def moved(self, G: MatrixLieGroup, estimate: Estimate, by: Array) -> Estimate:
        """Return the estimate moved by a correction of (ε, b̃, n), ``(..., 3m)``."""

    @property
    def varies(self) -> bool:
        """Whether numbers, or the start of the estimate, differ from run to run."""
        return super().varies or (self.initial_pose_std is not None and self.initial_error is None)

    def completed(self, G: MatrixLieGroup, deviations: Deviations) -> Self:
        """Return the filter with the deviations of the sensors where none are given."""
        sensed = {"pose_std": deviations.pose, "velocity_std": deviations.velocity}
        sensed |= {"bias_walk": deviations.walk, "initial_bias_std": deviations.bias}
        missing = [name for name in sensed if getattr(self, name) is None]
        return with_fields(self, **{name: sensed[name].tolist() for name in missing})

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return the filter of one run, with its start where that is drawn."""
        drawn = super().of_run(G, random)
        if self.initial_pose_std is None or self.initial_error is not None:
            return drawn
        normal = np.zeros(G.dimension) if random is None else random.standard_normal(G.dimension)
        std: Any = drawn.initial_pose_std
        return with_fields(drawn, initial_error=std * normal)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note negative or too many deviations, and a start without a deviation."""
        for name in DEVIATIONS:
            if (value := getattr(self, name)) is not None:
                check_count(value, G.dimension, G.name, problems.at(name), deviations=True)
        super().check(G, problems)
        if self.initial_error is not None and self.initial_pose_std is None:
            problems.at("initial_pose_std").add(
                "missing; initial_error needs the deviation that the filter assumes for it"
            )

    def check_sensors(self, schedule: Schedule, deviations: Deviations, problems: Problems) -> None:
        """Note deviations of 0, parts without a known start, and a bias that no fix can tell."""
        G, done = schedule.G, self.completed(schedule.G, deviations)
        values = {
            name: np.broadcast_to(np.array(drawn(value, None), dtype=float), G.dimension)
            for name in DEVIATIONS
            if (value := getattr(done, name)) is not None
        }
        for part in G.parts:
            axes = list(range(G.dimension)[part.axes])
            fixed = set(axes) <= set(schedule.axes)
            stds = ["velocity_std", "pose_std", "initial_pose_std"]
            if not fixed:
                stds.remove("pose_std")
            for name in stds:
                if name in values and (values[name][axes] <= 0).any():
                    problems.at(name).add(self._no_deviation(name, part.name))
            if fixed:
                continue
            biased = (values["initial_bias_std"][axes] > 0) | (values["bias_walk"][axes] > 0)
            if biased.any():
                problems.add(
                    f"the bias of the {part.name} cannot be estimated: no sensor measures the "
                    f"{part.name}; add an entry for it to sensors.pose, or set "
                    "initial_bias_std and bias_walk to 0 there"
                )
            elif "initial_pose_std" not in values:
                problems.at("initial_pose_std").add(
                    f"missing; no sensor measures the {part.name}, so no fix starts its estimate"
                )

    def _no_deviation(self, name: str, part: str) -> str:
        """Return the message for a deviation of 0."""
        if getattr(self, name) is not None:
            return f"expected deviations greater than 0 for the {part}, got 0"
        signal = name.partition("_")[0]
        way = (
            "; or let an accelerometer predict it, kind navigation" if part == "translation" else ""
        )
        return (
            f"sensors.{signal} has no noise of the {part}, so the filter would take it as exact; "
            "add noise there, or give deviations greater than 0"
            f"{way if signal == 'velocity' else ''}"
        )

    def first(self, G: MatrixLieGroup, pose: Array) -> Estimate:
        """Return the estimate at the start, at a pose, with its covariance."""
        bias = np.zeros_like(pose, shape=(*pose.shape[:-2], G.dimension))
        options: Any = self
        std = options.pose_std if options.initial_pose_std is None else options.initial_pose_std
        stds = std + bias, options.initial_bias_std + bias, options.velocity_std + bias
        deviations = np.concatenate(stds, axis=-1)
        return Estimate(pose, bias, _diagonal(deviations * deviations), bias)

    def predicted(
        self, schedule: Schedule, estimate: Estimate, velocity: Array, duration: Array
    ) -> Estimate:
        """Return the estimate with Q̂ exp(hV̂), and Σ after the step that the class describes.

        Without a velocity at the end, the last one is used alone, and n stays, less the drift
        of a bias that is not known yet.
        """
        G, m, S = schedule.G, schedule.G.dimension, estimate.covariance
        options: Any = self  # in a run, options are arrays
        bias, last = slice(m, 2 * m), slice(2 * m, 3 * m)
        x = duration * (velocity - estimate.bias)
        step = G.exp(x)
        A, B = G.Ad_matrix(G.inverse(step)), -G.jacobian(-x)
        end, held = duration * estimate.share, where(less(0.0, estimate.share), 0.0, 1.0)
        start = duration - end
        noise = options.velocity_std * options.velocity_std
        walk = estimate.drift * duration * options.bias_walk * options.bias_walk
        through = duration[..., None] * S[..., bias, :] + start[..., None] * S[..., last, :]
        top = A @ S[..., :m, :] + B @ through
        across = duration[..., None] * top[..., bias] + start[..., None, :] * top[..., last]
        across = across + B * (end * end * (noise + walk))[..., None, :]
        covariance = np.zeros_like(S)
        covariance[..., :m, :m] = top[..., :m] @ transpose(A) + across @ transpose(B)
        covariance[..., :m, bias] = top[..., bias] + B * (end * walk)[..., None, :]
        covariance[..., bias, bias] = S[..., bias, bias] + _diagonal(walk)
        coupling = S[..., last] * held[..., None, :]
        covariance[..., :m, last] = (
            held[..., None, :] * top[..., last] + B * (end * noise)[..., None, :]
        )
        covariance[..., bias, last] = coupling[..., bias, :] - _diagonal(held * walk)
        new = (1.0 - held) * noise + held * walk
        covariance[..., last, last] = held[..., None] * coupling[..., last, :] + _diagonal(new)
        changed = {"noise": held * estimate.noise, "covariance": mirrored(covariance)}
        return estimate._replace(pose=estimate.pose @ step, **changed)

    def corrected(self, schedule: Schedule, estimate: Estimate, fix: Fix) -> tuple[Estimate, Array]:
        """Return the estimate corrected coordinate by coordinate, and its whitened innovations.

        K = Σhᵀ/(hΣhᵀ + σ²), and in Joseph form Σ ← (I − Kh)Σ(I − Kh)ᵀ + σ²KKᵀ.
        """
        G, m = schedule.G, schedule.G.dimension
        options: Any = self
        residual = G.log(G.inverse(estimate.pose) @ fix.pose)
        H, S = self.output(G, residual), estimate.covariance
        by = 0.0 * np.concatenate([estimate.bias] * 3, axis=-1)
        innovations = 0.0 * estimate.bias
        for axis in schedule.axes:
            h = H[..., axis, :]
            seen = (S[..., :m] @ h[..., None])[..., 0]
            variance = (options.pose_std * options.pose_std)[..., axis, None]
            total = (h * seen[..., :m]).sum(axis=-1)[..., None] + variance
            K = fix.arrived[..., axis, None] * seen / total
            unexpected = residual[..., axis, None] - (h * by[..., :m]).sum(axis=-1)[..., None]
            by = by + K * unexpected
            left = S - K[..., :, None] * seen[..., None, :]
            back = variance * K - (left[..., :m] @ h[..., None])[..., 0]
            S = mirrored(left + back[..., :, None] * K[..., None, :])
            innovations[..., axis] = (unexpected / sqrt(total))[..., 0]
        return self.moved(G, estimate._replace(covariance=S), by), innovations


def _diagonal(entries: Array) -> Array:
    """Return the diagonal matrix with these entries, ``(..., n) -> (..., n, n)``."""
    return entries[..., :, None] * np.eye(entries.shape[-1])


def mirrored(matrix: Array) -> Array:
    """Return the symmetric matrix with the entries of this one on and above the diagonal."""
    n = matrix.shape[-1]
    rows, columns, _ = _triangle(n)
    return symmetric(matrix[..., rows, columns], n)


@dataclass(frozen=True)
class Eqf(ErrorStateFilter):
    """Equivariant filter whose symmetry is the tangent group G ⋉ g.

    Its error is (QQ̂⁻¹, Ad_Q̂ b̃) = exp(ε_r, ε_b) in that group, so that ε_r = Ad_Q̂ ε and
    ε_b = Ad_Q̂ b̃ to first order: ε̇_r = −ε_b, ε̇_b = ad_{Ad_Q̂ V̂} ε_b. A correction is the exponential
    of the tangent group, from the left, and Σ stays as it is in these coordinates. A fix is read to
    third order, r = (I − ½ad_r) ε + n. Here Σ is kept in the body frame, by Ad_Q̂⁻¹, where the same
    Φ moves it.

    Fornasier, Ng, Brommer, Böhm, Mahony, Weiss, IEEE Robot. Autom. Lett. 7 (2022) 12118 (Overcoming
    Bias); Fornasier, Ge, van Goor, Mahony, Weiss, Automatica 182 (2025) 112495 (Equivariant
    Symmetries for Inertial Navigation Systems).
    """

    name: ClassVar[str] = "eqf"

    def output(self, G: MatrixLieGroup, residual: Array) -> Array:
        """Return I − ½ad_r."""
        return np.eye(G.dimension) - G.ad_matrix(residual) / 2

    def moved(self, G: MatrixLieGroup, estimate: Estimate, by: Array) -> Estimate:
        """Return Q̂ exp(δ_ε), b̂ + J(−δ_ε) δ_b, n̂ + δ_n, and Σ transported by Ad_{exp(−δ_ε)}.

        The noise n belongs to the sensor, and is not transported.
        """
        m, covariance = G.dimension, estimate.covariance
        step = G.exp(by[..., :m])
        carry = G.Ad_matrix(G.inverse(step))
        for _ in ("rows", "columns"):
            S = covariance.copy()
            S[..., :m, :] = carry @ covariance[..., :m, :]
            S[..., m : 2 * m, :] = carry @ covariance[..., m : 2 * m, :]
            covariance = transpose(S)
        return Estimate(
            estimate.pose @ step,
            estimate.bias + apply_matrix(G.jacobian(-by[..., :m]), by[..., m : 2 * m]),
            mirrored(covariance),
            estimate.noise + by[..., 2 * m :],
            estimate.age,
        )


@dataclass(frozen=True)
class Invariant(ErrorStateFilter):
    """Left-invariant extended Kalman filter with a bias of the velocity.

    Barrau and Bonnabel, IEEE Trans. Autom. Control 62 (2017) 1797, with the bias next to the pose:
    the residual of a fix is ε + n, and a correction δ gives Q̂ exp(δ_ε) and b̂ + δ_b.
    """

    name: ClassVar[str] = "invariant"

    def output(self, G: MatrixLieGroup, residual: Array) -> Array:
        """Return I."""
        return np.eye(G.dimension) + 0.0 * residual[..., None]

    def moved(self, G: MatrixLieGroup, estimate: Estimate, by: Array) -> Estimate:
        """Return Q̂ exp(δ_ε), b̂ + δ_b, n̂ + δ_n."""
        m, pose = G.dimension, estimate.pose @ G.exp(by[..., : G.dimension])
        bias, noise = estimate.bias + by[..., m : 2 * m], estimate.noise + by[..., 2 * m :]
        return estimate._replace(pose=pose, bias=bias, noise=noise)
