"""Flights along Lissajous curves, the laws that fly them, and their scores.

The task is that of "Leveling the Playing Field" (Kunapuli, Welde, Jayaraman and Kumar, RSS 2025,
arXiv 2506.17832); where each number comes from is said in docs/experiments/learned.md.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from eqt_cli.base.arrays import apply
from eqt_cli.components.laws import EachAxis
from eqt_cli.components.motions import FlatOutput
from eqt_cli.extend import (
    SE3,
    Array,
    Cascade,
    ClosedReference,
    Controller,
    MatrixLieGroup,
    Metric,
    PoseDistribution,
    Positive,
    Problems,
    Real,
    SampledRuns,
    Tracking,
    VelocityDistribution,
    absolute,
    apply_matrix,
    cos,
    cross,
    less,
    norm,
    sin,
    sqrt,
    stack,
    transpose,
    where,
)
from eqt_cli.extensions.network.network import Network

E3 = np.array([0.0, 0.0, 1.0])

# The flights --------------------------------------------------------------------------------------

RANGES = (2.0, 2.0, 2.0, 2.0), (3.0, 3.0, 3.0, 2.0), (np.pi,) * 4, (0.5, 0.5, 0.5, np.pi)
"""Of a, ω, φ and c of x, y, z and ψ: m or rad, rad/s, rad, m or rad."""

STARTS = (np.pi, *(0.5,) * 3, *(0.1,) * 6)
"""Of the yaw, the position, the velocity in space and the rates in the body, from the curve."""


@dataclass(frozen=True)
class Lissajous(ClosedReference):
    """x, y, z and ψ, each an a sin(ω t + φ) + c; Q_d is level, and turned by ψ.

    A cascade reads the position with four derivatives and ψ with two.

    Attributes
    ----------
    curve
        Number of the curve, which is drawn from it, uniform in `RANGES`.
    differences
        h: a cascade is given forward differences over steps of h, s, for these derivatives.
    """

    name: ClassVar[str] = "lissajous"

    curve: Real
    differences: Positive | None = None
    amplitude: Any = field(default=None, init=False, repr=False)
    frequency: Any = field(default=None, init=False, repr=False)
    phase: Any = field(default=None, init=False, repr=False)
    centre: Any = field(default=None, init=False, repr=False)

    def __post_init__(self) -> None:
        """Draw the curve."""
        drawn = np.random.default_rng([0, round(self.curve)]).uniform(-1, 1, (4, 4)) * RANGES
        for name, values in zip(("amplitude", "frequency", "phase", "centre"), drawn, strict=True):
            object.__setattr__(self, name, values)

    def _at(self, t: Any, order: int) -> Array:
        """Return a derivative of x, y, z and ψ, ``(..., 4)``."""
        values = []
        for k in range(4):
            a, w, f, c = (
                each[..., k] for each in (self.amplitude, self.frequency, self.phase, self.centre)
            )
            wave = (sin if order % 2 == 0 else cos)(w * t + f)
            size = a * w**order * (-1.0) ** (order // 2) if order else a
            values.append(size * wave + (c if order == 0 else 0.0))
        return stack(values)

    def motion(self, G: MatrixLieGroup, t: Any) -> tuple[Array, Array, Array]:
        """Return Q_d, V_d and V̇_d."""
        now, rate, second = (self._at(t, order) for order in range(3))
        R = _about_vertical(now[..., 3])
        back, spin = transpose(R), rate[..., 3:] * E3
        v = apply_matrix(back, rate[..., :3])
        a = apply_matrix(back, second[..., :3]) - cross(spin, v)
        Q = SE3().assemble(R, now[..., :3, None])
        turn = second[..., 3:] * E3
        return Q, np.concatenate([spin, v], -1), np.concatenate([turn, a], -1)

    def flat_output(self, G: MatrixLieGroup, t: Any) -> FlatOutput:
        """Return position and heading with their derivatives, or what stands for them."""
        if self.differences is None:
            found = [self._at(t, order) for order in range(5)]
        else:
            h: Any = self.differences
            rows = [self._at(t + k * h, 0) for k in range(5)]
            found = [rows[0]]
            for _ in range(4):
                pairs = zip(rows[1:], rows[:-1], strict=True)
                rows = [(after - before) / h for after, before in pairs]
                found.append(rows[0])
        position = stack([stack([row[..., k] for row in found]) for k in range(3)])
        return FlatOutput(position, stack([row[..., 3] for row in found[:3]]))

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note another group."""
        if G.name != "SE3":
            problems.add(f"lissajous needs group SE3, got {G.name}")


def _about_vertical(psi: Any) -> Array:
    c, s, o = cos(psi), sin(psi), 0.0 * psi
    return stack([stack([c, s, o]), stack([-s, c, o]), stack([o, o, o + 1.0])])  # its columns


def start(curve: float, generator: Any) -> tuple[Array, Array]:
    """Return how a run starts: Q_d(0)⁻¹Q(0) and V(0) − V_d(0), uniform in `STARTS`.

    The velocity must know the pose, so each is drawn anew from the seeds of the run.
    """
    seeds = generator.bit_generator.seed_seq.generate_state(4)
    yaw, *rest = np.random.default_rng([1, round(curve), *seeds]).uniform(-1, 1, 10) * STARTS
    position, velocity, rates = np.reshape(rest, (3, 3))
    G, reference = SE3(), Lissajous(curve)
    Qd, Vd, _ = reference.motion(G, 0.0)
    R = _about_vertical(np.array(yaw)) @ Qd[:3, :3]
    Q = G.assemble(R, (Qd[:3, 3] + position)[:, None])
    V = np.concatenate([rates, R.T @ (Qd[:3, :3] @ Vd[3:] + velocity)])
    return G.inverse(Qd) @ Q, V - Vd


@dataclass(frozen=True)
class NearCurve(PoseDistribution):
    """A pose near the start of a curve, level.

    Attributes
    ----------
    curve
        Number of the curve.
    """

    name: ClassVar[str] = "near_curve"

    curve: Real

    def draw(self, G: MatrixLieGroup, generator: np.random.Generator) -> Array:
        """Return its coordinates."""
        return G.log(start(self.curve, generator)[0])

    def place(self, G: MatrixLieGroup, numbers: Array) -> Array:
        """Return the poses."""
        return G.exp(numbers)


@dataclass(frozen=True)
class SpeedNearCurve(VelocityDistribution):
    """Nearly the velocity of a curve at its start, in space.

    Attributes
    ----------
    curve
        Number of the curve.
    """

    name: ClassVar[str] = "near_curve"

    curve: Real

    def draw(self, G: MatrixLieGroup, generator: np.random.Generator) -> Array:
        """Return V(0) − V_d(0)."""
        return start(self.curve, generator)[1]


# The laws -----------------------------------------------------------------------------------------


class Scored:
    """A law with the errors that the reward reads as numbers of its own."""

    output_units: ClassVar[Mapping[str, str]] = {
        "speed_error": "m/s",
        "rate_error": "rad/s",
        "yaw_error": "rad",
    }

    def outputs(self, G: MatrixLieGroup) -> Mapping[str, int]:
        """The memory, and the errors."""
        return {**self.memory(G), **dict.fromkeys(Scored.output_units, 1)}

    def output(self, s: Tracking) -> Mapping[str, Array]:
        """‖ṗ − ṗ_d‖, ‖ω − ω_d‖, and the angle of the second body axes, seen from above."""
        R, Rd = s.Q[..., :3, :3], s.Qd[..., :3, :3]
        v = apply_matrix(R, s.V[..., 3:]) - apply_matrix(Rd, s.Vd[..., 3:])
        w = apply_matrix(R, s.V[..., :3]) - apply_matrix(Rd, s.Vd[..., :3])
        (a, b), (c, d) = ((of[..., 0, 1], of[..., 1, 1]) for of in (R, Rd))
        sine, cosine = absolute(a * d - b * c), a * c + b * d
        length = sqrt(sine * sine + cosine * cosine)
        return {
            **s.memory,
            "speed_error": norm(v)[..., None],
            "rate_error": norm(w)[..., None],
            "yaw_error": _angle(cosine, sine, length)[..., None],
        }


def _angle(cosine: Array, sine: Array, length: Array) -> Array:
    """Return the angle from 0 to π."""
    return 2.0 * apply("atan", sine / (length + cosine + 1e-12))


@dataclass(frozen=True)
class ScoredCascade(Scored, Cascade):
    """`cascade` with the errors of the reward."""

    name: ClassVar[str] = "scored_cascade"
    title: ClassVar[str] = "geometric"


@dataclass(frozen=True)
class ScoredNetwork(Scored, Network):
    """`network` with the errors of the reward."""

    name: ClassVar[str] = "scored_network"
    title: ClassVar[str] = "network"


@dataclass(frozen=True)
class PerInertia(Controller):
    """Lee's attitude law with gains per unit of inertia, one for each axis (eq. 8, 9 and 11).

    τ = J (−k_R e_R − k_ω (Ω − EΩ_c) − Ω × EΩ_c + EΩ̇_c) + Ω × JΩ, E = RᵀR_c.

    Attributes
    ----------
    kR, kW
        k_R, 1/s², and k_ω, 1/s.
    """

    name: ClassVar[str] = "per_inertia"
    title: ClassVar[str] = "Lee, gains per inertia"
    theorem: ClassVar[str] = ""
    reads_gains: ClassVar[bool] = False

    kR: EachAxis
    kW: EachAxis

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note other groups."""
        if G.name != "SO3":
            problems.add(f"per_inertia is a law of SO3, got {G.name}")

    def torque(self, s: Tracking) -> Array:
        """Return τ."""
        E, J = transpose(s.Q) @ s.Qd, s.inertia.matrix
        odd = transpose(E) - E
        error = 0.5 * stack([odd[..., 2, 1], odd[..., 0, 2], odd[..., 1, 0]])
        desired = apply_matrix(E, s.Vd)
        asked = -(self.kR * error) - self.kW * (s.V - desired)
        asked = asked - cross(s.V, desired) + apply_matrix(E, s.Vd_dot)
        return apply_matrix(J, asked) + cross(s.V, apply_matrix(J, s.V))


# The scores ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Reward(Metric):
    """Mean reward over time; 15 is the most.

    Attributes
    ----------
    delta
        δ of 15 exp(−e²/δ), m².
    square
        Whether e is squared there, as in the code of the paper and not in its text.
    yaw
        Factor of the yaw error.
    """

    name: ClassVar[str] = "reward"
    signals: ClassVar[tuple[str, ...]] = (
        "position_error",
        "yaw_error",
        "speed_error",
        "rate_error",
    )
    units: ClassVar[str] = "1"
    better: ClassVar[str] = "higher"

    delta: Positive = 0.1
    square: bool = True
    yaw: Positive = 4.0

    def of(self, over: SampledRuns, error: Any, yaw: Any, speed: Any, rate: Any) -> Array:
        """Return the mean of the reward."""
        near = np.exp(-(error * error if self.square else error) / self.delta)
        return over.mean(15.0 * near - self.yaw * yaw - 0.05 * speed - 0.01 * rate)


@dataclass(frozen=True)
class SteadyError(Metric):
    """Mean position error of the last fifth."""

    name: ClassVar[str] = "steady_error"
    signals: ClassVar[tuple[str, ...]] = ("position_error",)
    units: ClassVar[str] = "m"
    better: ClassVar[str] = "lower"

    def of(self, over: SampledRuns, error: Any) -> Array:
        """Return the mean."""
        return over.closing_mean(error, 0.2)


@dataclass(frozen=True)
class Lost(SteadyError):
    """Whether the mean position error of the last fifth is above half a metre."""

    name: ClassVar[str] = "lost"
    units: ClassVar[str] = "1"

    def of(self, over: SampledRuns, error: Any) -> Array:
        """Return 1 or 0."""
        return where(less(0.5, over.closing_mean(error, 0.2)), 1.0, 0.0)


@dataclass(frozen=True)
class FirstSecond(SteadyError):
    """Mean position error of the first second."""

    name: ClassVar[str] = "first_second"

    def of(self, over: SampledRuns, error: Any) -> Array:
        """Return the mean."""
        early = less(over.time, 1.0 + 1e-9)
        return over.integral(where(early, error, 0.0 * error))


@dataclass(frozen=True)
class YawRms(Metric):
    """Root mean square of the yaw error."""

    name: ClassVar[str] = "yaw_rms"
    signals: ClassVar[tuple[str, ...]] = ("yaw_error",)
    units: ClassVar[str] = "rad"
    better: ClassVar[str] = "lower"

    def of(self, over: SampledRuns, error: Any) -> Array:
        """Return the root."""
        return sqrt(over.mean(error * error))
