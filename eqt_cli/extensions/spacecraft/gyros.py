"""Single-gimbal control-moment gyros."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import Field

from eqt_cli.base.arrays import (
    Array,
    Arrays,
    apply_matrix,
    clip,
    cos,
    cross,
    inverse_spd,
    outside,
    sin,
    transpose,
)
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import Scale, Unit
from eqt_cli.base.stored import Signal, signal
from eqt_cli.components.actuators import Actuator, check_members, of_each
from eqt_cli.components.allocation import lost_directions
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.matrix_groups import check_turns_in_space
from eqt_cli.components.vehicle_parts import Numbers, drawn, is_drawn
from eqt_cli.numbers.leaves import STRUCTURE, with_fields

COUNT, GYRO = 4, "gyro"
"""Number of gyros, and the name of the dimension of their signals."""

ANGLE = signal("gimbal_angle", "rad", r"\delta", "δ", dims=(GYRO,), words="angle of each gimbal")
RATE = signal("gimbal_rate", "rad/s", r"\dot\delta", "δ̇", dims=(GYRO,), words="rate of each gimbal")

OF_EACH = ("momentum", "inertia", "gain", "limit", "start")
"""Options with a number for each gyro."""


def _axes(pyramid: Any) -> Array:
    """Return g, s at δ = 0, and g × s of all gyros as columns, ``(3, 3, n)``."""
    at, tilt = np.pi / 4 + np.pi / 2 * np.arange(COUNT), np.asarray(pyramid, float)
    out, s = np.array([[np.cos(at), np.sin(at), 0 * at], [-np.sin(at), np.cos(at), 0 * at]])
    g = np.sin(tilt) * out + np.cos(tilt) * np.eye(3)[:, 2:]
    return np.array([g, s, np.cross(g, s, axis=0)])


@dataclass(frozen=True)
class Gyros(Actuator):
    """Four control-moment gyros: gimbal i turns a rotor with momentum h_i by δ_i about g_i.

    On SO3 and SE3. The spin axis is s_i(δ_i), and t_i = g_i × s_i. The total momentum is R(𝕁ω + H)
    with H = Σ h_i s_i + p_i g_i: p_i = J_g (δ̇_i + g_i·ω) is the absolute momentum of a
    gimbal about its axis, and 𝕁 the inertia without J_g about it. The turning body pushes a gimbal,
    and its drive holds against it,

        ṗ_i = k (δ̇_c,i − δ̇_i) + h_i ω·t_i,

    so that the body feels H × ω − Σ h_i t_i δ̇_i + g_i ṗ_i. The steering law is

        δ̇_c = −Aᵀ (A Aᵀ + λ h² 1)⁻¹ τ  with  A = [h_i t_i],  h² = Σ h_i²/n,

    which no singularity makes infinite; near one it loses torque (Nakamura and Hanafusa, J. Dynamic
    Systems, Measurement, and Control 108, 1986).

    Attributes
    ----------
    momentum
        h of the rotors, N m s.
    inertia
        J_g, moment of inertia of a gimbal with its rotor about the gimbal's axis, kg m².
    gain
        k of the drives, N m s (per rad): a rate is tracked with a lag of J_g/k.
    pyramid
        The angle of the gimbal axes from z; seen from above, at 45°, 135°, 225° and 315° from x.
        At δ = 0, the rotors spin about horizontal axes, counter-clockwise around z. Runs may draw
        it, one for all gyros or one for each.
    limit
        Largest commanded rate of a gimbal, rad/s. Default: no limit.
    start
        δ at t = 0, rad. Default: 0.
    damping
        λ of the steering law.
    told
        Whether the steering law knows an h and a pyramid that are drawn for a run, in place of
        their means.
    """

    name: ClassVar[str] = "gyros"
    departs: ClassVar[str] = "control-moment gyros"
    moves: ClassVar[bool] = True
    by_processor: ClassVar[bool] = True

    momentum: Annotated[Numbers, Scale("momentum of the rotors", "N m s")]
    inertia: Annotated[Numbers, Scale("inertia of the gimbals", "kg m^2")]
    gain: Annotated[Numbers, Scale("gain of the drives", "N m s")]
    pyramid: Annotated[Numbers, Unit("rad")]
    limit: Annotated[Numbers | None, Scale("limit of the gimbal rates", "rad/s")] = None
    start: Annotated[Numbers | None, Unit("rad")] = None
    damping: Annotated[float, Field(ge=0, lt=1)] = 0.01
    told: bool = False
    axes: Any = field(default=None, init=False, repr=False)
    believed: Any = field(default=None, init=False, repr=False)
    mean_axes: Any = field(default=None, init=False, repr=False)
    fixed: bool = field(default=False, init=False, repr=False, metadata=STRUCTURE)

    @property
    def limits(self) -> bool:
        """Whether gimbal rates have a limit."""
        return self.limit is not None

    @property
    def linear_part(self) -> Actuator:
        """The gyros without the limit of their rates; at rest, angles count to second order only.

        They stay at those of the start, so that they are no states.
        """
        return self if self.fixed else with_fields(self, limit=None, fixed=True)

    @property
    def members(self) -> Mapping[str, tuple[str, ...]]:
        """The gyros, numbered from 1."""
        return {GYRO: tuple(f"gyro {k + 1}" for k in range(COUNT))}

    @property
    def shows(self) -> tuple[Signal, ...]:
        """The angles and rates of the gimbals."""
        return ANGLE, RATE

    def signals(self, G: MatrixLieGroup, V: Array, command: Array, x: Array) -> Arrays:
        """Return δ and δ̇."""
        g, n = self.axes[..., 0, :, :], COUNT
        rates = x[..., -n:] / self.inertia - apply_matrix(transpose(g), V[..., :3])
        return {"gimbal_angle": x[..., :n], "gimbal_rate": rates}

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return gyros with g, s at δ = 0, and g × s as columns, and a number for each."""
        part, values = self.drawn(random), {"start": np.zeros(COUNT)}
        values |= of_each(part, OF_EACH, COUNT)
        if is_drawn(self.momentum) and not self.told:
            values["believed"] = np.full(COUNT, drawn(self.momentum, None))
        if is_drawn(self.pyramid) and not self.told:
            values["mean_axes"] = _axes(drawn(self.pyramid, None))
        values["pyramid"] = np.broadcast_to(np.asarray(part.pyramid, float), COUNT)
        return with_fields(part, axes=_axes(part.pyramid), **values)

    def states(self, G: MatrixLieGroup) -> int:
        """Return the number of states: δ and p of each gyro."""
        return (2 - self.fixed) * COUNT

    def started(self, G: MatrixLieGroup, V: Array) -> Array:
        """Return the states of gimbals that rest in the body."""
        start: Any = self.start
        along = apply_matrix(transpose(self.axes[..., 0, :, :]), V[..., :3])
        return self._joined(start + 0.0 * along, self.inertia * along)

    def _joined(self, of_angles: Array, of_momenta: Array) -> Array:
        return np.concatenate(([of_angles] if not self.fixed else []) + [of_momenta], axis=-1)

    def _turned(self, x: Array, axes: Any = None) -> tuple[Array, Array, Array]:
        """Return g, s(δ) and A, ``(..., 3, n)``, of their axes or of others."""
        axes = self.axes if axes is None else axes
        g, s, t = (axes[..., k, :, :] for k in range(3))
        start: Any = self.start
        angle = start[..., None, :] if self.fixed else x[..., None, :COUNT]
        c, sine = cos(angle), sin(angle)
        return g, c * s + sine * t, self.momentum[..., None, :] * (c * t - sine * s)

    def _steered(self, command: Array, x: Array) -> tuple[Array, Array]:
        """Return the commanded rates of the gimbals, without and with their limit."""
        h, A = self.momentum, self._turned(x, self.mean_axes)[2]
        if self.believed is not None:
            h, A = self.believed, (self.believed / h)[..., None, :] * A
        h2 = (h * h).sum(axis=-1)[..., None] / COUNT
        gram = A @ transpose(A) + (self.damping * h2)[..., None] * np.eye(3)
        wanted = -apply_matrix(transpose(A), apply_matrix(inverse_spd(gram), command[..., :3]))
        return wanted, wanted if self.limit is None else clip(wanted, -self.limit, self.limit)

    def _driven(self, command: Array, x: Array) -> tuple[Array, Array, Array, Array]:
        """Return g, A, and δ̇ and ṗ of a body at rest."""
        g, _, A = self._turned(x)
        rates = x[..., -COUNT:] / self.inertia
        return g, A, rates, self.gain * (self._steered(command, x)[1] - rates)

    def output(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return the torque −Ḣ on a body at rest, and the force of the command."""
        g, A, rates, torques = self._driven(command, x)
        torque = -(apply_matrix(A, rates) + apply_matrix(g, torques))
        return np.concatenate([torque, command[..., 3:]], axis=-1)

    def state_rate(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return δ̇ and ṗ of a body at rest."""
        return self._joined(*self._driven(command, x)[2:])

    def reaction(self, G: MatrixLieGroup, V: Array, x: Array) -> tuple[Array, Array]:
        """Return what a body that turns feels besides, and the rates that it causes."""
        (g, s, A), omega = self._turned(x), V[..., :3]
        along = apply_matrix(transpose(g), omega)
        pushed = self.gain * along + apply_matrix(transpose(A), omega)
        H = apply_matrix(s, self.momentum + 0.0 * along) + apply_matrix(g, x[..., -COUNT:])
        torque = cross(H, omega) + apply_matrix(A, along) - apply_matrix(g, pushed)
        force = np.concatenate([torque, 0.0 * V[..., 3:]], axis=-1)
        return force, self._joined(-along, pushed)

    def within(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return the command without the torque that the limit takes, before any drive."""
        A = self._turned(x)[2]
        wanted, rates = self._steered(command, x)
        lost = apply_matrix(A, wanted - rates)
        return np.concatenate([command[..., :3] + lost, command[..., 3:]], axis=-1)

    def at_limit(self, G: MatrixLieGroup, command: Array, x: Array) -> Array | None:
        """Return 1 where a commanded rate is beyond the limit, else 0."""
        if self.limit is None:
            return None
        return outside(self._steered(command, x)[0], -self.limit, self.limit)

    def remarks(self, G: MatrixLieGroup, wanted: Array) -> Iterator[str]:
        """Yield remarks on the turns about which no gyro has a torque, ever or at the start."""
        part: Any = self if self.axes is not None else self.of_run(G, None)
        turns, start = wanted[np.abs(wanted[:, :3]).any(axis=1)], np.append(part.start, [0.0] * 4)
        A, later = (turns[:, :3] @ part._turned(start + x)[2] for x in (0.0, np.pi / 2))
        # The torques of a gyro at two angles span those at all angles.
        yield from (ever := [*lost_directions(G, turns, np.hstack([A, later]), 0.0, self.name)])
        if not ever:
            for text in lost_directions(G, turns, A, 0.0, self.name):
                yield f"{text}, until their gimbals turn"

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note groups without one attitude in space, and numbers that are wrong."""
        check_turns_in_space(self.name, G, problems)
        check_members(self, COUNT, "gyro", (*OF_EACH, "pyramid"), "start pyramid", problems)
