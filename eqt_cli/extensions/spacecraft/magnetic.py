"""Magnetorquers in the field of the Earth along an orbit, and the law that detumbles."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np

from eqt_cli.base.arrays import Array, clip, cos, cross, dot, less, norm, outside, sin, stack, where
from eqt_cli.base.errors import Problems
from eqt_cli.base.expressions import Expression, formula
from eqt_cli.base.option_types import Positive, Real, Scale, shown
from eqt_cli.base.registry import Keys
from eqt_cli.components.actuators import Actuator
from eqt_cli.components.forces import column
from eqt_cli.components.groups import MatrixLieGroup, group_named
from eqt_cli.components.laws import Controller
from eqt_cli.components.matrix_groups import check_turns_in_space
from eqt_cli.components.mechanics import Tracking
from eqt_cli.components.references import check_expressions
from eqt_cli.components.vehicle_parts import Numbers, check_numbers
from eqt_cli.extensions.spacecraft.orbits import check_eccentricity, ellipse, place_on
from eqt_cli.numbers.instants import instants_of
from eqt_cli.numbers.leaves import with_fields
from eqt_cli.numbers.rounded import rounded

RADIUS, GRAVITATION, TURN = 6371.2e3, 3.986004418e14, 7.292115e-5
"""Reference radius of the IGRF, m; GM of the Earth, m³/s²; its rate of rotation, rad/s."""

POLES = 1e-9 * np.array([[0, 0, -29404.8], [-1450.9, 4652.5, 0], [-4652.5, -1450.9, 0]])
"""The dipole of the Earth, T, its mean, and its parts with cosine and sine of the Earth's turn.

By g₁⁰, g₁¹ and h₁¹ of IGRF-13 at 2020.0 (Alken et al., Earth, Planets and Space 73:49, 2021).
"""


@dataclass(frozen=True)
class Orbit(Keys):
    """An orbit in the field of a dipole at the centre of the Earth, which turns with it.

    Attributes
    ----------
    altitude
        Height above 6371.2 km, m; of an ellipse, that of the perigee.
    inclination
        Angle between the orbit and the equator, rad.
    node
        Longitude of the ascending node at t = 0, rad.
    phase
        Angle from this node to the satellite at t = 0, rad.
    eccentricity
        e of the orbit; 0 of a circle.
    anomaly
        Angle from the perigee to the satellite at t = 0, rad.
    """

    altitude: Annotated[Positive, Scale("altitude", "m")]
    inclination: Annotated[Real, Scale("inclination", "rad")]
    node: Annotated[Real, Scale("longitude of the node", "rad")] = 0.0
    phase: Annotated[Real, Scale("phase of the orbit", "rad")] = 0.0
    eccentricity: Real = 0.0
    anomaly: Annotated[Real, Scale("true anomaly", "rad")] = 0.0

    @cached_property
    def numbers(self) -> dict[str, Array | None]:
        """The rates of orbit and Earth, and the dipole's mean, cosine and sine, a row each.

        The dipole is that at the distance a, half the longest diameter; `shape` tells an ellipse.
        They are in the frame whose x axis points to the satellite at t = 0, z along the normal.
        """

        def poles(turns: Array) -> Array:
            node, inclination, phase = np.moveaxis(group_named("SO3").exp(turns), -3, 0)
            return share * share * share * POLES @ node @ inclination @ phase

        a, (x, _, z) = (RADIUS + self.altitude) / (1 - self.eccentricity), np.eye(3)
        turns, share = np.stack([self.node * z, self.inclination * x, self.phase * z]), RADIUS / a
        rates = np.array([np.sqrt(GRAVITATION / (a * a * a)), TURN])
        shape = ellipse(self.eccentricity, self.anomaly) if self.eccentricity else None
        return {"rates": rates, "poles": rounded(poles, turns), "shape": shape}


@dataclass(frozen=True)
class Magnetorquers(Actuator):
    """The torque m × B of dipoles m along the body axes, in the field B = RᵀB_s(t); SO3 and SE3.

    A torque τ is asked for by m = B × τ/|B|², which gives its part across B; nothing gives the part
    along B. Each dipole is cut at its limit. The allocation knows the true field at all times. With
    `dump`, behind `wheels`, the command passes, and m = k h × B/|B|² takes the sum h of their
    momenta in the body frame: the torque is −k times its part across B.

    Attributes
    ----------
    orbit
        `{altitude: 500 km, inclination: 97.4 deg, node: 0, phase: 0}`: B_s is the dipole of IGRF-13
        in the frame of `gravity_gradient`, x to the satellite at t = 0, z along the orbit's normal.
    flux
        Instead: B_s as three expressions in t, T.
    limit
        Largest dipole along each body axis, A m².
    takes
        The command: `torque`, or `dipole` as from the law `b_dot`.
    dump
        k of dumping the momentum of `wheels`, 1/s.
    dump_to
        The momentum that dumping leaves, [x, y, z] in the body frame, N m s; default: none. Then
        m = k (h − h_d) × B/|B|².
    """

    name: ClassVar[str] = "magnetorquers"
    departs: ClassVar[str] = "magnetorquers"
    changes: ClassVar[bool] = True
    limits: ClassVar[bool] = True

    limit: Annotated[Numbers, Scale("limit of the dipole", "A m^2")] = field(kw_only=True)
    orbit: Orbit | None = None
    flux: list[str | float] | None = None
    takes: Literal["torque", "dipole"] = "torque"  # type: ignore[misc]  # a constant of others
    dump: Annotated[Positive | None, Scale("gain of dumping", "1/s")] = None
    dump_to: Annotated[Numbers | None, Scale("momentum left by dumping", "N m s")] = None
    rates: Any = field(default=None, init=False, repr=False)
    poles: Any = field(default=None, init=False, repr=False)
    shape: Any = field(default=None, init=False, repr=False)

    @property
    def linear_part(self) -> Actuator:
        """The torquers without limits."""
        return self if np.isinf(self.limit).all() else with_fields(self, limit=np.array([np.inf]))

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return the torquers with the numbers of the orbit."""
        numbers: dict[str, Any] = dict(self.orbit.numbers) if self.orbit else {}
        return with_fields(super().of_run(G, random), orbit=None, flux=self.flux, **numbers)

    def in_space(self, t: Any) -> Array:
        """Return B_s, T, ``(..., 3)``."""
        if self.flux:
            return stack([expression.evaluate({"t": t}) for expression in self.expressions])
        angles = self.rates * column(t)
        c, s = cos(angles), sin(angles)
        along, across, near = c[..., 0], s[..., 0], None
        if self.shape is not None:
            along, across, near = place_on(self.shape, angles[..., 0])
        r = stack([along, across, 0.0 * along])
        mean, by_cos, by_sin = (self.poles[..., k, :] for k in range(3))
        m = mean + c[..., 1:] * by_cos + s[..., 1:] * by_sin
        B = 3 * dot(m, r)[..., None] * r - m
        return B if near is None else (near * near * near)[..., None] * B

    def in_body(self, s: Tracking) -> Array:
        """Return B, T, ``(..., 3)``."""
        R: Array = s.G.rotation(s.Q)  # type: ignore[attr-defined]
        return (R * self.in_space(s.t)[..., :, None]).sum(axis=-2)

    def at(self, s: Tracking, stored: Any = None) -> Self:
        """Return the torquers in the field at a time and pose, with the momentum of the wheels."""
        return with_fields(self, moving=(self.in_body(s), stored))

    def instants(self, G: MatrixLieGroup, until: float) -> Array:
        """Return the times at which an expression changes its piece."""
        return instants_of(self.expressions, until)

    @property
    def expressions(self) -> list[Expression]:
        """The field over time, parsed; empty in an orbit."""
        return [formula(expression) for expression in self.flux or ()]

    def dipoles(self, command: Array) -> tuple[Array, Array, Array]:
        """Return B, the dipole that is asked for, and what the limit leaves of it, ``(..., 3)``."""
        torque = dipole = command[..., :3]
        B, h = self.moving or (self.in_space(0.0), 0.0 * command)
        if self.takes == "torque":
            if self.dump is not None:
                excess = h[..., :3] if self.dump_to is None else h[..., :3] - self.dump_to
                torque = 0.0 * torque - self.dump * excess
            dipole = cross(B, torque) / dot(B, B)[..., None]
        return B, dipole, clip(dipole, -self.limit, self.limit)

    def output(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return m × B, to which `dump` adds the command, and the force of the command."""
        B, _, m = self.dipoles(command)
        torque = cross(m, B) + (0.0 if self.dump is None else command[..., :3])
        return np.concatenate([torque, command[..., 3:]], axis=-1)

    def within(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return the command without what limits take of its dipoles; with `dump`, the command."""
        B, dipole, m = self.dipoles(command)
        lost = cross(dipole - m, B) if self.takes == "torque" else dipole - m
        lost = np.concatenate([lost, 0.0 * command[..., 3:]], axis=-1)
        return command - lost if self.dump is None else command

    def at_limit(self, G: MatrixLieGroup, command: Array, x: Array) -> Array | None:
        """Return 1 where a dipole is beyond its limit, else 0."""
        return outside(self.dipoles(command)[1], -self.limit, self.limit)

    def remarks(self, G: MatrixLieGroup, wanted: Array) -> Iterator[str]:
        """Yield the direction without a torque, and what there is about others in the mean.

        With `dump`, the wheels give what the law asks for, in every direction.
        """
        if self.dump is not None:
            return
        span = 5400.0 if self.flux else 2 * np.pi / self.rates[0]
        b = np.array([x / norm(x) for x in map(self.in_space, np.linspace(0.0, span, 2001)[:-1])])
        share, across = (array.round(2) for array in np.linalg.eigh(np.eye(3) - b.T @ b / len(b)))
        yield (
            f"give no torque along the field, {b[0].round(2)} in space at t = 0; in the mean over "
            f"{span:.0f} s, {share[0]} of a torque about {across[:, 0]} remains, {share[1]} and "
            f"{share[2]} across it"
        )

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note groups without one attitude in space, and numbers that are wrong or too many."""
        check_turns_in_space(self.name, G, problems)
        if (self.orbit is None) == (self.flux is None):
            problems.add("expected either orbit or flux; add orbit, with altitude and inclination")
        check_expressions(self.flux or ["1"] * 3, 3, G, problems.at("flux"))
        check_numbers(self.limit, problems.at("limit"), positive=True)
        if isinstance(self.limit, list) and len(self.limit) != 3:
            problems.at("limit").add(f"expected a number, or 3 of them, got {len(self.limit)}")
        if self.dump and self.takes == "dipole":
            problems.at("dump").add("needs takes: torque; remove one of the two")
        if self.orbit is not None:
            check_eccentricity(self.orbit.eccentricity, problems.at("orbit", "eccentricity"))
        if self.dump_to is not None:
            here = problems.at("dump_to")
            check_numbers(self.dump_to, here)
            if not isinstance(self.dump_to, list) or len(self.dump_to) != 3:
                here.add(f"expected [x, y, z] in N m s, got {shown(self.dump_to)}")
            if self.dump is None:
                here.add("needs dump, the gain in 1/s, such as dump: 1.0e-3")


@dataclass(frozen=True)
class BDot(Controller):
    """B-dot: the dipole m = −k ΔB/T against the change of the measured field; it has no target.

    ΔB is the difference from the measurement a control period T before, in the body frame; the
    first dipole is 0. With a fast clock, that is −k B × ω. After
    Stickler and Alfriend, Elementary magnetic attitude control system, J. Spacecraft and Rockets 13
    (5), 1976, 282-287, of which only the abstract was read.

    Attributes
    ----------
    k
        A m² s/T.
    """

    name: ClassVar[str] = "b_dot"
    title: ClassVar[str] = "B-dot"
    tasks: ClassVar[tuple[str, ...]] = ()
    energy: ClassVar[str] = "½⟨𝕀V, V⟩"
    reads_gains: ClassVar[bool] = False
    commands: ClassVar[str] = "dipole"
    output_units: ClassVar[Mapping[str, str]] = {"measured": "T"}

    k: Annotated[Positive, Scale("gain of B-dot", "A m^2 s/T")]

    def memory(self, G: MatrixLieGroup) -> Mapping[str, int]:
        """Return the length of the last measurement, which is 0 before the first."""
        return {"measured": 3}

    def torque(self, s: Tracking) -> Array:
        """The dipole of a period of 1 s, A m²."""
        return self.answer(s, 1.0)[0]

    def answer(self, s: Tracking, period: Any) -> tuple[Array, Mapping[str, Array]]:
        """Return −k ΔB/T, and the measurement."""
        B, last = s.flux + 0.0 * s.V[..., :3], s.memory["measured"]
        rate = where(less(0.0, dot(last, last)[..., None]), (B - last) / period, 0.0 * B)
        return np.concatenate([-self.k * rate, 0.0 * s.V[..., 3:]], axis=-1), {"measured": B}

    def lyapunov(self, s: Tracking) -> Array:
        """½⟨𝕀V, V⟩."""
        return dot(s.P, s.V) / 2

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note groups without one attitude in space."""
        check_turns_in_space(self.name, G, problems)
