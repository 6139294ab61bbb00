"""The invariant filter on SE₂(3) that predicts by gyro and accelerometer, and corrects by fixes.

Its state is the extended pose χ = (R, v, p), with v and p in space, and the biases of both sensors.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Self

import numpy as np

from eqt_cli.base.arrays import (
    Array,
    Arrays,
    apply,
    apply_matrix,
    less,
    sqrt,
    stack,
    transpose,
    where,
)
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import POSE, Scale, Unit
from eqt_cli.components.blocks import Now
from eqt_cli.components.estimators import (
    Deviations,
    Estimate,
    Estimator,
    Fix,
    Measurement,
    Schedule,
    mirrored,
    symmetric,
)
from eqt_cli.components.forces import GRAVITY
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.matrix_groups import SE3, SE23, SO3, stumpff
from eqt_cli.components.sensors import FIXES
from eqt_cli.components.vehicle_parts import Numbers, check_count, check_numbers, drawn
from eqt_cli.numbers.leaves import with_fields

EXTENDED, POSES, ROTATIONS = SE23(), SE3(), SO3()

TURN, SPEED, PLACE = slice(0, 3), slice(3, 6), slice(6, 9)
"""Coordinates of ε = log(χ̂⁻¹χ): of the attitude, the velocity and the position."""

MOTION, BIASES, ERRORS = slice(0, 9), slice(9, 15), 15
"""Coordinates of (ε, b̃), with the biases b of the gyro and of the accelerometer."""

STORED = [*range(3), *range(6, 9), *range(9, 15), *range(3, 6)]
"""Their order in the states: pose and bias, as of all estimators, and the velocity behind them."""

SPACE = 3

UNIT = (
    ("velocity", "rotation", "gyro", "{kind: noise, std: 0.002, of: rotation}"),
    ("accelerometer", "translation", "accelerometer", "{kind: noise, std: 0.02}"),
)
"""Signal, part and name of the sensors of an inertial unit, with an entry for each."""

TURNS, MOVES = slice(0, 3), slice(3, 6)
"""Coordinates of (ω, f), and of their biases; and of a velocity."""

TILT, HEADING = slice(0, 2), 2
"""Places of the innovations of a measured attitude."""

AXES = [*range(3), *range(6, 9)]
"""Coordinates of ε that are those of a pose."""


@dataclass(frozen=True)
class Navigation(Estimator):
    """Invariant Kalman filter by an inertial unit (IMU) and late fixes, such as GNSS or a compass.

    It needs no sensor of the velocity. The gyro measures ω + b_g + n, the accelerometer f + b_a + n
    with f = Rᵀ(v̇ − g). Over a tick of h seconds, with the means ω and f of both ends less the
    estimated biases,
    R̂ ← R̂ exp(hω), v̂ ← v̂ + hg + h R̂ Γ₁f, p̂ ← p̂ + hv̂ + ½h²g + h² R̂ Γ₂f, where Γ₁ and Γ₂ are
    the once and twice integrated exponential of hω. The error ε of χ̂⁻¹χ = exp(ε) then obeys
    ε ← Ad_Υ⁻¹F ε − L(b̃ + n), which depends on neither R̂, v̂ and p̂ nor g. Fixes of attitude and
    position are Q exp(n), as of the other filters, and a depth is p_z + n. They correct χ̂ by
    χ̂ exp(K_ε r), coordinate by coordinate and in Joseph form, at the time at which they were
    measured; the ticks from there to the present are repeated. The law reads Q̂, ω̂ and R̂ᵀv̂.

    Barrau and Bonnabel, IEEE Trans. Autom. Control 62 (2017) 1797; Brossard, Barrau, Chauchat and
    Bonnabel, IEEE Trans. Robot. 38 (2022) 998.

    Attributes
    ----------
    pose_std
        Standard deviation of a fix of attitude and position, in the coordinates of the algebra.
        Default: that of the noise of `sensors.pose`.
    depth_std
        Standard deviation of a measured depth. Default: that of the noise of `sensors.depth`.
    gyro_std, accelerometer_std
        Standard deviation of one measurement. Default: that of the noise of `sensors.velocity` and
        of `sensors.accelerometer`.
    gyro_walk, accelerometer_walk
        Standard deviation of the drift of the bias after one second. Default: the `walk` of the
        bias of the sensor.
    initial_pose_std
        Standard deviation of log(Q̂⁻¹Q) at the start, with which each run draws Q̂. Default: Q̂
        starts at the first fix, with its deviation.
    initial_velocity_std
        Standard deviation of R̂ᵀ(v − v̂) at the start, with which each run draws v̂.
    initial_velocity_error
        Instead of what each run draws: R̂ᵀ(v − v̂) at the start, or its distribution.
    initial_gyro_bias_std, initial_accelerometer_bias_std
        Standard deviation of the bias at the start. Default: the rms of the `value` of the bias.
    heading_only
        Whether a measured attitude counts by its heading alone, as a compass tells it: the angle
        ψ = atan2(R₂₁, R₁₁) of the first axis of the body about the vertical, z.
    gravity
        g in space. Default: 9.80665 m/s² against z; give [0, 0, 9.80665] where z points down, and 0
        where nothing weighs, as in orbit.
    """

    name: ClassVar[str] = "navigation"
    vectors: ClassVar[tuple[str, ...]] = ("initial_error", "pose_std", "initial_pose_std")
    has_covariance: ClassVar[bool] = True
    reads_specific_force: ClassVar[bool] = True

    pose_std: Annotated[Numbers | None, Scale("assumed deviation of a fix", POSE)] = None
    depth_std: Annotated[Numbers | None, Scale("assumed deviation of a depth", "m")] = None
    gyro_std: Annotated[Numbers | None, Scale("assumed deviation of the gyro", "rad/s")] = None
    accelerometer_std: Annotated[
        Numbers | None, Scale("assumed deviation of the accelerometer", "m/s^2")
    ] = None
    gyro_walk: Annotated[Numbers | None, Scale("assumed drift of the gyro")] = None
    accelerometer_walk: Annotated[Numbers | None, Scale("assumed drift of the accelerometer")] = (
        None
    )
    initial_pose_std: Annotated[Numbers | None, Scale("initial deviation of the pose", POSE)] = None
    initial_velocity_std: Annotated[Numbers, Scale("initial deviation of the velocity", "m/s")] = (
        0.1
    )
    initial_velocity_error: Annotated[Numbers | None, Unit("m/s")] = None
    initial_gyro_bias_std: Annotated[
        Numbers | None, Scale("initial deviation of the gyro's bias", "rad/s")
    ] = None
    initial_accelerometer_bias_std: Annotated[
        Numbers | None, Scale("initial deviation of the accelerometer's bias", "m/s^2")
    ] = None
    heading_only: bool = False
    gravity: Annotated[Numbers, Unit("m/s^2")] = field(default_factory=lambda: [0.0, 0.0, -GRAVITY])

    # The options, and what the sensors say of them.

    @property
    def varies(self) -> bool:
        """Whether numbers differ from run to run: the start of the velocity does."""
        return super().varies or self.initial_velocity_error is None

    def completed(self, G: MatrixLieGroup, deviations: Deviations) -> Self:
        """Return the filter with the deviations of the sensors where none are given."""
        sensed = {"pose_std": deviations.pose, "depth_std": deviations.depth[-1:]}
        for signal, axes in ("gyro", TURNS), ("accelerometer", MOVES):
            sensed |= {
                f"{signal}_std": deviations.velocity[axes],
                f"{signal}_walk": deviations.walk[axes],
            }
            sensed[f"initial_{signal}_bias_std"] = deviations.bias[axes]
        missing = [name for name in sensed if getattr(self, name) is None]
        return with_fields(self, **{name: sensed[name].tolist() for name in missing})

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return the filter of one run, with its start where that is drawn."""
        drawn = super().of_run(G, random)
        normal = np.zeros(9) if random is None else random.standard_normal(9)
        start: Any = drawn
        if self.initial_velocity_error is None:
            error = start.initial_velocity_std * normal[6:]
            drawn = with_fields(drawn, initial_velocity_error=error)
        if self.initial_pose_std is None or self.initial_error is not None:
            return drawn
        return with_fields(drawn, initial_error=start.initial_pose_std * normal[:6])

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note groups other than SE3, negative or too many deviations, and a wrong gravity."""
        if not isinstance(G, SE3):
            problems.add(f"navigation needs group SE3, got {G.name}")
            return
        for name in (name for name in vars(self) if name.endswith(("_std", "_walk"))):
            if (value := getattr(self, name)) is not None:
                count = G.dimension if name in self.vectors else 1 if "depth" in name else SPACE
                check_count(value, count, "its sensor", problems.at(name), deviations=True)
        for name in ("initial_velocity_error", "gravity"):
            if (value := getattr(self, name)) is not None:
                check_count(value, SPACE, "space", problems.at(name), deviations=False)
        if self.gravity is not None and not isinstance(self.gravity, list):
            check_numbers(self.gravity, problems.at("gravity"))
            if drawn(self.gravity, None) != 0:
                problems.at("gravity").add(
                    "expected a vector in space such as [0, 0, -9.81], or 0; a number has no "
                    "direction"
                )
        super().check(G, problems)
        if self.initial_error is not None and self.initial_pose_std is None:
            problems.at("initial_pose_std").add(
                "missing; initial_error needs the deviation that the filter assumes for it"
            )

    def check_sensors(self, schedule: Schedule, deviations: Deviations, problems: Problems) -> None:
        """Note an inertial unit that is missing or slow, deviations of 0, and unknown starts."""
        measured = {(channel.signal, channel.part.name): channel for channel in schedule.channels}
        odd = list(_odd_times(schedule))
        for message in odd:
            problems.add(message)
        for signal, part, title, entry in UNIT:
            channel = measured.get((signal, part))
            if channel is None:
                problems.add(
                    f"predicts by a gyro and an accelerometer, and there is no {title}; add an "
                    f"entry to sensors.{signal}, such as {entry}"
                )
            elif channel.holds and not odd:
                problems.add(
                    f"reads the {title} at every tick, at once; remove `period`, `offset`, `delay` "
                    f"and `dropout` from sensors.{signal}"
                )
        if ("velocity", "translation") in measured:
            problems.add(
                "does not read a measured velocity of the translation; write `of: rotation` in "
                "sensors.velocity, or use kind invariant, which reads one"
            )
        unknown = list(schedule.unmeasured)
        if self.heading_only and "rotation" not in unknown:
            unknown.append("tilt")
        elif self.heading_only:
            problems.at("heading_only").add(
                "no sensor measures the heading; add an entry with `of: rotation` to sensors.pose"
            )
        if self.initial_pose_std is None and unknown:
            problems.at("initial_pose_std").add(
                f"missing; no sensor measures the {' and '.join(unknown)}, so no fix starts its "
                "estimate"
            )
        if not problems:
            self._check_deviations(schedule, deviations, problems)

    def _check_deviations(
        self, schedule: Schedule, deviations: Deviations, problems: Problems
    ) -> None:
        """Note deviations of 0, which the filter would take as exact."""
        done: Any = self.completed(schedule.G, deviations).drawn(None)
        used = {"gyro_std": "velocity", "accelerometer_std": "accelerometer"}
        axes = {"pose_std": schedule.axes, "depth_std": [0]}
        used |= {f"{channel.signal}_std": channel.signal for channel in schedule.fixes}
        if self.initial_pose_std is not None:
            used["initial_pose_std"] = ""
        for name, signal in used.items():
            count = schedule.G.dimension if name in self.vectors else SPACE
            numbers = np.broadcast_to(np.array(getattr(done, name), dtype=float), count)
            if (numbers[axes.get(name, slice(None))] > 0).all():
                continue
            if getattr(self, name) is not None:
                problems.at(name).add("expected deviations greater than 0, got 0")
            else:
                problems.at(name).add(
                    f"sensors.{signal} has no noise of some coordinates, so the filter would take "
                    "these as exact; add noise there, or give deviations greater than 0"
                )

    # The states.

    def states(self, schedule: Schedule) -> dict[str, int]:
        """Return the length of each state that is kept from instant to instant, by name."""
        sizes = super().states(schedule)
        lengths = {"covariance": ERRORS * (ERRORS + 1) // 2, "noise": 0, "speed": SPACE}
        sizes |= lengths | {"error": ERRORS, "last_innovation": self._fixed_axes(schedule)}
        if schedule.depth:
            sizes |= {f"behind_{name}": length for name, length in lengths.items()}
        return {name: length for name, length in sizes.items() if length}

    def _fixed_axes(self, schedule: Schedule) -> int:
        """Return the number of coordinates of fixes: those of the pose, and a depth."""
        return 6 + any(channel.signal == "depth" for channel in schedule.fixes)

    def _loaded(self, G: MatrixLieGroup, states: Arrays, prefix: str = "") -> Estimate:
        pose, bias, speed = (states[f"{prefix}{name}"] for name in ("pose", "bias", "speed"))
        place = np.argsort(STORED)
        covariance = symmetric(states[f"{prefix}covariance"], ERRORS)[..., place, :][..., place]
        return Estimate(G.unpack(pose), bias, covariance, speed=speed)

    def _stored(self, schedule: Schedule, estimate: Estimate) -> dict[str, Array]:
        rows, columns = np.triu_indices(ERRORS)
        S = estimate.covariance[..., STORED, :][..., STORED]
        upper = S[..., rows, columns]
        pose = schedule.G.pack(estimate.pose)
        return {"pose": pose, "bias": estimate.bias, "covariance": upper, "speed": estimate.speed}

    def first(self, G: MatrixLieGroup, pose: Array) -> Estimate:
        """Return the estimate at the start, at a pose, with its covariance; v̂ is not known yet."""
        part: Any = self
        bias = np.zeros_like(pose, shape=(*pose.shape[:-2], 6))
        still = bias[..., :SPACE]
        std = bias + (part.pose_std if part.initial_pose_std is None else part.initial_pose_std)
        stds = [std[..., :SPACE], still + part.initial_velocity_std, std[..., SPACE:]]
        stds += [still + part.initial_gyro_bias_std, still + part.initial_accelerometer_bias_std]
        deviations = np.concatenate(stds, axis=-1)
        return Estimate(pose, bias, _diagonal(deviations * deviations), speed=still)

    # What happens at an instant.

    def after(self, schedule: Schedule, measured: Measurement, states: Arrays) -> dict[str, Array]:
        """Return the states after an instant; the specific force takes the place of a velocity."""
        part: Any = self
        G, now, V = schedule.G, measured.ports, measured.ports.s.V
        # The force just before the instant, by the commands that have moved the body until now.
        force = Now(now.blocks, now.s, errors=now.errors)["noisy.accelerometer"]
        sensed = np.concatenate([measured.velocity[..., TURNS], force[..., MOVES]], axis=-1)
        R = POSES.rotation(measured.true_pose)
        start = apply_matrix(R, V[..., MOVES] - part.initial_velocity_error)
        begins = dict(states)
        for name in {"speed", "behind_speed"} & states.keys():
            begins[name] = where(less(0.5, states["begun"]), states[name], start)
        after = super().after(schedule, measured._replace(velocity=sensed), begins)
        estimated = _extended(G.unpack(after["pose"]), after["speed"])
        true = _extended(measured.true_pose, apply_matrix(R, V[..., MOVES]))
        error = EXTENDED.log(EXTENDED.inverse(estimated) @ true)
        after["error"] = np.concatenate([after["error"], error[..., SPEED]], axis=-1)
        moved = apply_matrix(transpose(EXTENDED.rotation(estimated)), after["speed"])
        after["velocity"] = np.concatenate([after["velocity"][..., TURNS], moved], axis=-1)
        return after

    def predicted(
        self, schedule: Schedule, estimate: Estimate, velocity: Array, duration: Array
    ) -> Estimate:
        """Return the estimate a duration h later, s, ``(..., 1)``, which may be 0.

        Parameters
        ----------
        velocity : (..., 6)
            Mean of the measured (ω, f) at both ends.
        """
        part: Any = self
        h, S = duration, estimate.covariance
        omega, f = ((velocity - estimate.bias)[..., axes] for axes in (TURNS, MOVES))
        # Υ = (exp hω, h Γ₁f, h² Γ₂f)
        turn = POSES.exp(np.concatenate([h * omega, h * f], axis=-1))
        W, square = ROTATIONS.hat(h * omega), ((h * omega) ** 2).sum(axis=-1)[..., None]
        *_, c3, c4, _ = stumpff(square)
        once = apply_matrix(W, f)
        twice = apply_matrix(W, once)
        place = h * h * (f / 2 + c3 * once + c4 * twice)
        moved = turn[..., :SPACE, SPACE]
        step = _extended(turn, moved, place)
        A = EXTENDED.Ad_matrix(EXTENDED.inverse(step)) @ _flow(h)
        L = _input(omega, f, h)
        noise = np.concatenate([0.0 * omega + part.gyro_std, 0.0 * f + part.accelerometer_std], -1)
        walk = np.concatenate([0.0 * omega + part.gyro_walk, 0.0 * f + part.accelerometer_walk], -1)
        drift = h * walk * walk
        # ε ← Aε − L(b̃ + n + w/2), b̃ ← b̃ + w
        across = A @ S[..., MOTION, BIASES] - L @ S[..., BIASES, BIASES]
        top = A @ S[..., MOTION, MOTION] - L @ S[..., BIASES, MOTION]
        white = (L * (noise * noise + drift / 4)[..., None, :]) @ transpose(L)
        covariance = np.zeros_like(S)
        covariance[..., MOTION, MOTION] = top @ transpose(A) - across @ transpose(L) + white
        covariance[..., MOTION, BIASES] = across - L * (drift / 2)[..., None, :]
        covariance[..., BIASES, BIASES] = S[..., BIASES, BIASES] + _diagonal(drift)
        R, p, g = POSES.rotation(estimate.pose), estimate.pose[..., :SPACE, SPACE], part.gravity
        p = p + h * estimate.speed + h * h * g / 2 + apply_matrix(R, place)
        pose = POSES.assemble(R @ POSES.rotation(turn), p[..., None])
        speed = estimate.speed + h * g + apply_matrix(R, moved)
        return estimate._replace(pose=pose, speed=speed, covariance=mirrored(covariance))

    def corrected(self, schedule: Schedule, estimate: Estimate, fix: Fix) -> tuple[Estimate, Array]:
        """Return the estimate corrected coordinate by coordinate, and its whitened innovations.

        K = Σhᵀ/(hΣhᵀ + σ²), and in Joseph form Σ ← (I − Kh)Σ(I − Kh)ᵀ + σ²KKᵀ.
        """
        S = estimate.covariance
        by = np.zeros_like(S[..., 0])
        innovations = 0.0 * fix.arrived
        for axis, h, residual, variance in self._rows(schedule, estimate, fix):
            seen = apply_matrix(S, h)
            total = (h * seen).sum(axis=-1)[..., None] + variance
            K = fix.arrived[..., axis, None] * seen / total
            unexpected = residual - (h * by).sum(axis=-1)[..., None]
            by = by + K * unexpected
            left = S - K[..., :, None] * seen[..., None, :]
            back = variance * K - apply_matrix(left, h)
            S = mirrored(left + back[..., :, None] * K[..., None, :])
            innovations[..., axis] = (unexpected / sqrt(total))[..., 0]
        moved = _extended(estimate.pose, estimate.speed) @ EXTENDED.exp(by[..., MOTION])
        place = moved[..., :SPACE, SPACE + 1 :]
        pose, speed = POSES.assemble(EXTENDED.rotation(moved), place), moved[..., :SPACE, SPACE]
        changed = {"pose": pose, "speed": speed, "bias": estimate.bias + by[..., BIASES]}
        return estimate._replace(**changed, covariance=S), innovations

    def _fixed(self, schedule: Schedule, apart: bool, estimate: Arrays, row: Arrays) -> Arrays:
        """Return the estimate after a step with its fix; a heading counts as one innovation."""
        after = dict(super()._fixed(schedule, apart, estimate, row))
        if self.heading_only:
            arrived = after["arrived"].copy()
            arrived[..., TILT] = 0.0
            after["arrived"] = arrived
        return after

    def _rows(
        self, schedule: Schedule, now: Estimate, fix: Fix
    ) -> Iterator[tuple[int, Array, Array, Array]]:
        """Yield place, row of H, residual and variance of each measured coordinate."""
        part: Any = self
        measured = fix.pose.copy()
        if self.heading_only:  # the position is seen without the measured tilt
            measured[..., :SPACE, :SPACE] = now.pose[..., :SPACE, :SPACE]
        residual = schedule.G.log(schedule.G.inverse(now.pose) @ measured)
        one = 0.0 * now.covariance[..., 0, :]
        for channel in schedule.fixes:
            if channel.signal == "depth":
                # p_z − p̂_z = e_zᵀR̂ ε_p
                row = one.copy()
                row[..., PLACE] = now.pose[..., SPACE - 1, :SPACE]
                below = (fix.depth - now.pose)[..., SPACE - 1, SPACE, None]
                yield 6, row, below, part.depth_std * part.depth_std
                continue
            if self.heading_only and channel.part.turns:
                row = one.copy()
                row[..., TURN], turned = _heading(now.pose, fix.pose)
                std = part.pose_std[..., TURN] * row[..., TURN]
                yield HEADING, row, turned, (std * std).sum(axis=-1)[..., None]
                continue
            for axis in schedule.axes_of(channel):
                row = one.copy()
                row[..., AXES[axis]] = 1.0
                std = part.pose_std[..., axis, None]
                yield axis, row, residual[..., axis, None], std * std


def _odd_times(schedule: Schedule) -> Iterator[str]:
    """Yield which times of fixes make ticks shorter than the period of the inertial unit."""
    every = {channel.every for channel in schedule.channels if channel.signal not in FIXES}
    unit = next(iter(every), 1)
    if len(every) > 1 or unit == 1:
        return
    period, is_odd = unit * schedule.period, False
    apart = f"gyro and accelerometer are read {period:g} s apart, and"
    for channel in schedule.fixes:
        times = {"period": channel.every, "offset": channel.clock.offset, "delay": channel.delay}
        for key, ticks in times.items():
            if ticks % unit:
                is_odd, before = True, ticks // unit * period
                yield (
                    f"{apart} the {key} of sensors.{channel.signal}, of: {channel.part.name}, is "
                    f"{ticks * schedule.period:g} s; write {before:g} s or {before + period:g} s"
                )
    if not is_odd:
        yield (
            f"{apart} the ticks of the loop are {schedule.period:g} s, which the filter follows; "
            "give whole control periods to actuators and to the delay and offset of control, "
            "remove control.tick, and give gyro and accelerometer no period"
        )


def _extended(pose: Array, speed: Array, place: Array | None = None) -> Array:
    """Return χ = (R, v, p), with the position of the pose if none is given, ``(..., 5, 5)``."""
    p = pose[..., :SPACE, SPACE] if place is None else place
    columns = np.concatenate([speed[..., None], p[..., None]], axis=-1)
    return EXTENDED.assemble(pose[..., :SPACE, :SPACE], columns)


def _heading(estimated: Array, measured: Array) -> tuple[Array, Array]:
    """Return the row of ψ = atan2(R̂₂₁, R̂₁₁) for the turn ε, and ψ_m − ψ̂, within ±π, ``(..., 1)``.

    ε moves R̂e₁ = (x, y, ·) by R̂(ε × e₁), and so ψ by (x δy − y δx)/(x² + y²).
    """
    R, x, y = estimated, estimated[..., 0, 0], estimated[..., 1, 0]
    u, v, square = measured[..., 0, 0], measured[..., 1, 0], x * x + y * y
    pitched = (y * R[..., 0, 2] - x * R[..., 1, 2]) / square
    yawed = (x * R[..., 1, 1] - y * R[..., 0, 1]) / square
    across, along = x * v - y * u, x * u + y * v
    half = across / (along + sqrt(across * across + along * along))
    return stack([0.0 * pitched, pitched, yawed]), 2 * apply("atan", half)[..., None]


def _flow(h: Array) -> Array:
    """Return F of ε ← Fε, where only the position moves, by the velocity, ``(..., 9, 9)``."""
    flow = np.zeros_like(h, shape=(*h.shape[:-1], 9, 9))
    flow[...] = np.eye(9)
    flow[..., PLACE, SPEED] = h[..., None] * np.eye(SPACE)
    return flow


def _input(omega: Array, f: Array, h: Array) -> Array:
    """Return L = ∫₀ʰ exp(sX) ds B of ε̇ = Xε − Bu, to the order h³, ``(..., 9, 6)``."""
    W, M, h = ROTATIONS.hat(omega), ROTATIONS.hat(f), h[..., None]
    one, square, cube = np.eye(SPACE), h * h, h * h * h / 6
    L = np.zeros_like(h, shape=(*h.shape[:-2], 9, 6))
    L[..., TURN, TURNS] = h * one - square * W / 2 + cube * (W @ W)
    L[..., SPEED, MOVES] = L[..., TURN, TURNS]
    L[..., SPEED, TURNS] = cube * (M @ W + W @ M) - square * M / 2
    L[..., PLACE, MOVES] = square * one / 2 - cube * 2 * W
    L[..., PLACE, TURNS] = -cube * M
    return L


def _diagonal(entries: Array) -> Array:
    """Return the diagonal matrix with these entries, ``(..., n) -> (..., n, n)``."""
    return entries[..., :, None] * np.eye(entries.shape[-1])
