"""A position loop around an attitude law, for bodies that are pushed along one body axis only."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import AfterValidator

from eqt_cli.base.arrays import Array, apply_matrix, dot, exp, frobenius, less, sqrt, where
from eqt_cli.base.errors import Problems, Remedy
from eqt_cli.base.option_types import Kind, Positive, Real, Scale
from eqt_cli.base.registry import Keys
from eqt_cli.components import laws
from eqt_cli.components.actuators import (
    EXCESS,
    AntiWindup,
    BackCalculation,
    excess,
    limited_parts,
    unwound,
)
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.inertia import Inertia, InertiaLaw
from eqt_cli.components.laws import (
    Controller,
    Designed,
    EachAxis,
    OuterLoop,
    ReadsLimits,
    check_each_axis,
    check_flat_output,
    controllers,
)
from eqt_cli.components.matrix_groups import rigid, rigid_motions
from eqt_cli.components.mechanics import SETPOINTS, Gains, LawInput, Tracking
from eqt_cli.components.motions import (
    ROUNDING_OF_A_SQUARE,
    PlantModel,
    RigidMotion,
    check_rigid_body,
    only_direction,
    unit_vector,
)
from eqt_cli.components.vehicle_parts import check_period
from eqt_cli.extensions.underactuated.attitude import (
    Attitude,
    attitude,
    check_along,
    sides,
    third_axis,
)
from eqt_cli.numbers.jets import Jet
from eqt_cli.numbers.leaves import STRUCTURE, with_fields

ORDER = 2
"""Derivatives of the force that the rates of the attitude need."""

FILTERED, FILTERED_RATE = "filtered", "filtered_rate"
"""States of the filter: F/m as it gives it, and its rate."""

HELD, LEFT = "held", "left"
"""States of a position loop with a period: F/m with its derivatives, and the time until it is
computed again, s."""

ATTITUDE = "attitude_"
"""Prefix of the states of the attitude law, before its own names."""


NEEDS = {"reference": "full", "heading": "velocity"}
"""The setpoints that rates read."""


def or_none(ki: Any) -> Any:
    """Return gains of an integral as they are used, None where all are 0."""
    return (np.array(ki, dtype=float) if isinstance(ki, list) else ki) if np.any(ki) else None


OF_FORCE = {"kx": "k_x", "kv": "k_v"}
"""Gains of the acceleration, each with the name of that of the force, which is m times as large."""


@dataclass(frozen=True)
class PositionGains(Keys):
    """The feedback of the position, p̈_d − sat(k_x e + k_v ė + k_i ∫e) with e = p − p_d in space.

    Attributes
    ----------
    kx
        k_x, 1/s²: a number, or one for each axis of space.
    kv
        k_v, 1/s, likewise.
    ki
        k_i, 1/s³, likewise; 0 along an axis leaves it out there. Without it, there is no integral.
    c1
        c₁, 1/s, likewise, for an integral of ė + c₁ e, which k_i, now 1/s², turns into an estimate
        of the acceleration by unknown forces. The rates of the attitude read it, too.
    limit
        l of sat(u) = u/√(1 + |u|²/l²), m/s²; none if left out. It keeps the force away from 0.
    period
        Of the position loop, s: a whole number of control periods. Between its instants, F and its
        derivatives are held. If left out, F is computed whenever the law is.
    anti_windup
        Where limits of the actuators, as the law is told them, cut the push: `clamp` stops the
        integral along it if it would go further beyond the limit, and `{back_calculation: 1 s}`
        takes it back, with this time constant. Default: `none`. An attitude law has its own.
    k_x, k_v
        Instead of `kx` and `kv`, the gains of the force of Lee, Leok and McClamroch (2010), which
        are m times as large, N/m and N s/m.
    """

    kx: Annotated[EachAxis | None, Scale("k_x", "1/s^2", is_symbol=True)] = None
    kv: Annotated[EachAxis | None, Scale("k_v", "1/s", is_symbol=True)] = None
    ki: Annotated[
        Real | list[Real] | None, Scale("k_i", "1/s^3", is_symbol=True), AfterValidator(or_none)
    ] = None
    c1: Annotated[EachAxis | None, Scale("c_1", "1/s", is_symbol=True)] = None
    limit: Annotated[Positive | None, Scale("limit of the feedback", "m/s^2")] = None
    period: Annotated[Positive | None, Scale("period of the position loop", "s")] = None
    anti_windup: AntiWindup = "none"
    k_x: Annotated[EachAxis | None, Scale("k_x", "N/m", is_symbol=True)] = None
    k_v: Annotated[EachAxis | None, Scale("k_v", "N s/m", is_symbol=True)] = None

    def check(self, space: int, problems: Problems) -> None:
        """Note gains that are missing, twice there, or not for each axis; c1 without integral."""
        for name, of_force in OF_FORCE.items():
            keys = [key for key in (name, of_force) if getattr(self, key) is not None]
            if len(keys) != 1:
                got = "both" if keys else "neither"
                problems.at(name).add(f"expected {name}, or {of_force} of the force, got {got}")
            for key in keys:
                check_each_axis(getattr(self, key), space, problems.at(key))
        for name in ("ki", "c1"):
            check_each_axis(getattr(self, name), space, problems.at(name))
        least = 1.0 if self.ki is None else np.min(self.ki)
        if least < 0:
            problems.at("ki").add(
                f"expected at least 0, got {least:g}; an integral of the wrong sign makes any "
                "offset grow"
            )
        elif least == 0 and isinstance(self.anti_windup, BackCalculation):
            problems.at("ki").add("expected numbers above 0, which back_calculation needs")
        if self.c1 is not None and self.ki is None:
            problems.at("c1").add("applies to the integral only; add ki")
        if self.anti_windup != "none" and self.ki is None:
            problems.at("anti_windup").add("applies to the integral only; add ki")

    def bounded(self, u: Any) -> Any:
        """Return sat(u), of an array or a series."""
        if self.limit is None:
            return u
        share = u / self.limit
        return u / sqrt(1.0 + dot(share, share))[..., None]


class Inside(NamedTuple):
    """What the position loop asks for.

    Attributes
    ----------
    tracking
        All that the attitude law reads, on the group of rotations: Q_d is R_c, V_d and V̇_d are Ω_c
        and Ω̇_c.
    acceleration : (..., n)
        F/m: the acceleration that the actuators are to give, in space.
    integrand : (..., n)
        The rate of the integral, in space.
    """

    tracking: Tracking
    acceleration: Array
    integrand: Array


@dataclass(frozen=True)
class Cascade(OuterLoop, ReadsLimits):
    """A position loop around an attitude law, for a body pushed along one body axis b; SE2 and SE3.

    The force F = m (p̈_d − sat(k_x e + k_v ė + k_i ∫e)) − known forces, in space, is to be given by
    a push f = F·Rb along b and by the attitude R_c, whose axis b has the direction of F, with b₁ in
    the plane of F and the heading (cos ψ, sin ψ, 0). The attitude law tracks R_c with the inertia J
    and the gains of this entry. Known forces are those of `model.forces`; Lee, Leok and McClamroch
    (2010) is the case `attitude: lee2010`.

    R_c turns at rates that need Ḟ and F̈ along the motion. They follow from the law itself: the
    model's acceleration is substituted, and so on order by order. Known drag that is linear along
    the body's own axes is no part of F: R_c is the attitude in which push and drag give F, of the
    drag at ṗ_d (Faessler, Franchi and Scaramuzza, 2018). Other known forces that turn with the body
    are differentiated as if Ω were constant. L and its dissipation are the attitude law's, and
    their balance holds only if the rates are right.

    Attributes
    ----------
    attitude
        The attitude law: a kind of SO3 (SO2 in the plane), or a mapping with `kind` and options.
    position
        Gains and limit of the position loop.
    rates
        Rates of R_c: `model`, from the law and the model; `filter`, from a second-order filter of
        F; `reference`; `heading`, ψ̇ about the third axis; `none`, 0.
    bandwidth
        Both poles of the filter, rad/s.
    along
        b in the body, such as [0, 0, -1]. Default: the only direction in which actuators push.
    """

    name: ClassVar[str] = "cascade"
    tasks: ClassVar[tuple[str, ...]] = ()
    theorem: ClassVar[str] = ""  # nothing is claimed for the whole
    reads_flat_output: ClassVar[bool] = True
    reads_gains: ClassVar[bool] = False

    attitude: str | dict[str, Any] = field(compare=False)  # `inner` is what counts
    position: PositionGains
    rates: Literal["model", "filter", "reference", "heading", "none"] = "model"
    bandwidth: Annotated[Positive | None, Scale("bandwidth", "rad/s")] = None
    along: list[Real] | None = None
    inner: Any = field(default=None, init=False, repr=False)  # Controller
    acting: Any = field(default=(), init=False, repr=False)
    known_forces: Any = field(default=(), init=False, repr=False)  # tuple of forces
    across: Any = field(default=(), init=False, repr=False)  # tuple of drags
    exact: bool = field(default=True, init=False, repr=False, metadata=STRUCTURE)
    direction: Any = field(default=(), init=False, metadata=STRUCTURE)

    # What it is made of.

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note groups without an attitude and a position, and laws that are none of attitudes."""
        if not rigid_motions(G):
            problems.add(
                f"cascade needs a group of one rotation and one translation, SE2 or SE3, "
                f"got {G.name}"
            )
            return
        law = self._attitude_law(G, problems.at("attitude"))
        tracks = law is None or "track" in law.tasks or law.commands == "rates"
        if not tracks or isinstance(law, Designed):
            hint = ""
            if hasattr(law, "around"):  # of those that reject what is unknown
                hint = f"; put it around the cascade: kind: {law.name}, law: {{kind: cascade, …}}"
            problems.at("attitude").add(
                f"expected a law of {self.gains_group(G).name} that tracks with given gains, such "
                f"as lee2010, got {law.name}{hint}"
            )
        if self.rates == "filter" and self.bandwidth is None:
            problems.at("bandwidth").add("missing; rates: filter needs it, in rad/s")
        if self.rates != "filter" and self.bandwidth is not None:
            problems.at("bandwidth").add(f"applies to rates: filter only, got rates: {self.rates}")
        check_along(self.along, G.space, problems)
        self.position.check(G.space, problems.at("position"))

    def loaded(
        self, home: Any, G: MatrixLieGroup, problems: Problems
    ) -> tuple[Cascade, dict[str, str]]:
        """Return the law with its attitude law."""
        inner = self._attitude_law(G, Problems()) if rigid_motions(G) else None
        return with_fields(self, inner=inner), {}

    def _attitude_law(self, G: MatrixLieGroup, problems: Problems) -> Any:
        return Kind(controllers).checked(self.attitude, problems, self.gains_group(G))

    @property
    def commands(self) -> str:  # type: ignore[override]  # a constant of most laws
        """Whether the attitude law does."""
        return "torque" if self.inner is None else self.inner.commands

    def gains_group(self, G: MatrixLieGroup) -> MatrixLieGroup:
        """Return the group of rotations."""
        return rigid(G).rotation_group if rigid_motions(G) else G

    def inner_inertia(self, G: MatrixLieGroup, inertia: InertiaLaw) -> Inertia:
        """Return the inertia of the rotations."""
        turns, J = slice(0, rigid(G).rotations), inertia.at(0.0)
        return Inertia(J.matrix[..., turns, turns], J.inverse[..., turns, turns])

    def defaults(self, G: MatrixLieGroup, gains: Gains) -> Mapping[str, Any]:
        """Return the attitude law with the options that follow its gains."""
        if self.inner is None:
            return {}
        return {"inner": laws.with_defaults(self.inner, self.gains_group(G), gains, self.attitude)}

    def for_plant(self, G: MatrixLieGroup, plant: PlantModel, problems: Problems) -> Cascade:
        """Return the law with the forces that it knows, and the direction in which it pushes."""
        if problems:
            return self
        check_flat_output(plant, problems)
        if self.rates == "heading" and plant.flat is not None and plant.flat.heading is None:
            problems.at("rates").add("the reference gives no heading; use rates: model")
        if self.rates in NEEDS and SETPOINTS[plant.setpoint] < SETPOINTS[NEEDS[self.rates]]:
            said = f"reads derivatives that setpoint: {plant.setpoint} leaves out"
            problems.at("rates").add(f"{said}; use rates: none, or setpoint: {NEEDS[self.rates]}")
        check_rigid_body(G, plant.inertia, problems)
        if self.position.period is not None:
            check_period(self.position.period, plant.period, problems.at("position", "period"))
        along: Any = self.along
        if along is None and plant.pushes is not None:
            along = only_direction(plant.pushes)
        if along is None:
            problems.at("along").add(*_missing_along(G, plant.pushes))
        if problems:
            return self
        mass = float(plant.inertia.at(0.0).matrix[rigid(G).rotations, rigid(G).rotations])
        kinds: dict[str, AntiWindup] = {"position": self.position.anti_windup}
        inner, turns = self.inner, self.gains_group(G)
        if isinstance(inner, ReadsLimits):
            kinds["attitude"] = inner.anti_windup
            inside = plant.inside("inner", inner, turns, self.attitude)
            inside = inside._replace(inertia=self.inner_inertia(G, plant.inertia), actuators=())
            inner = inner.for_plant(turns, inside, Problems())  # its limits are those of `acting`
        unwinding = [at for at, kind in kinds.items() if kind != "none"]
        acting = [limited_parts(G, plant, problems.at(at)) for at in unwinding]
        b, even = unit_vector(along), plant.flat is not None and plant.flat.heading is None
        parts = [force.apart(rigid(G), b, even) or (force, None) for force in plant.forces]
        forces = {
            "known_forces": tuple(free for free, _ in parts),
            "across": tuple(drag for _, drag in parts if drag),
            "acting": max(acting, key=len, default=()),
        }
        of_force = {name: getattr(self.position, key) for name, key in OF_FORCE.items()}
        per_mass = {name: gain / mass for name, gain in of_force.items() if gain is not None}
        position = with_fields(self.position, k_x=None, k_v=None, **per_mass)
        apart = {"inner": inner, "position": position, "direction": b}
        apart["exact"] = plant.exact and plant.setpoint == "full"
        return with_fields(self, **apart, **forces)

    def cycle(self, period: float) -> Sequence[Mapping[str, float]]:
        """Return no time that is left at the first instant, and some at the others."""
        if self.position.period is None:
            return [{}]
        return [{LEFT: 0.0}] + [{LEFT: period}] * (round(self.position.period / period) - 1)

    def directions(self, G: MatrixLieGroup) -> Array:
        """Return the axes of all torques, and that of the push."""
        turns = rigid(G).rotations
        axes = np.eye(G.dimension)[: turns + 1]
        axes[turns, turns:] = self.direction
        return axes

    @property
    def undefined(self) -> str:  # type: ignore[override]  # a constant of most laws
        """F = 0, which a limit keeps away."""
        why = "a cascade whose force passes 0 has no attitude to command; give position.limit, "
        return "" if self.position.limit else f"{why}below the weight per mass"

    def attitude_error(self, s: Tracking) -> Array:
        """Return ‖R − R_c‖_F."""
        inside = self.commanded(s).tracking
        return frobenius(inside.Q - inside.Qd)

    def loop_errors(self, s: Tracking) -> Array:
        """Return log(R_cᵀR) and e of the attitude, p − p_d and its rate in space, ``(..., 2m)``."""
        G, inside = rigid(s.G), self.commanded(s).tracking
        position = G.translations(s.Q)[..., 0] - _desired(s, 0, 0).value
        velocity = apply_matrix(G.rotation(s.Q), s.V[..., G.rotations :]) - _desired(s, 1, 0).value
        turned = [G.rotation_group.log(inside.relative.Q), inside.relative.V_tilde]
        return np.concatenate([*turned, position, velocity], axis=-1)

    # The position loop.

    def commanded(self, s: Tracking) -> Inside:
        """Return what the position loop asks for, computed once for each state."""
        return s.once("commanded", self._commanded)

    def _commanded(self, s: Tracking) -> Inside:
        acceleration, integrand = self._acceleration(s)
        if HELD in s.memory:
            held, n = s.memory[HELD], rigid(s.G).space
            acceleration = Jet.of([held[..., n * k : n * (k + 1)] for k in range(self._order + 1)])
        return Inside(self._of_attitude(s, acceleration), acceleration.value, integrand)

    @property
    def _order(self) -> int:
        """The derivatives of F that the rates need."""
        return ORDER if self.rates == "model" else 0

    def _acceleration(self, s: Tracking) -> tuple[Jet, Array]:
        """Return F/m as a series, and the rate of the integral.

        The law at order k gives the k-th derivative of F, and so of the acceleration, which the law
        at the next order reads.
        """
        G = rigid(s.G)
        R, turning, moving = G.rotation(s.Q), s.V[..., : G.rotations], s.V[..., G.rotations :]
        axis = np.array(self.direction)
        push = [R @ axis, apply_matrix(R, G.rotation_group.hat(turning) @ axis)]
        place = [G.translations(s.Q)[..., 0], apply_matrix(R, moving)]
        mass = _mass(s)
        acceleration: Any = Jet([0.0])
        integrand = acceleration
        for k in range(self._order + 1):
            motion = RigidMotion(G, R, turning, Jet.of(place[: k + 1]), Jet.of(place[1:]))
            external: Any = 0.0
            for force in self.known_forces:
                external = external + force.in_space(G, Jet.time(s.t, k), motion) / mass
            integrand, feedback, estimate = self._feedback(s, motion)
            acceleration = _desired(s, 2, k) - feedback - external
            if k < self._order:
                b: Any = Jet.of(push[: k + 1])  # a series acts as an array
                moved = external + estimate + self.push(acceleration, b)[..., None] * b
                for drag in self.across:
                    moved = moved + drag.in_space(G, Jet.time(s.t, k), motion) / mass
                place.append(moved.derivative(k))
        return acceleration, integrand.value

    def _renewed(self, s: Tracking) -> Array:
        """Return F/m with its derivatives, as it is held."""
        a, _ = self._acceleration(s)
        return np.concatenate([a.derivative(k) for k in range(a.order + 1)], axis=-1)

    def _feedback(self, s: Tracking, moving: RigidMotion) -> tuple[Jet, Any, Any]:
        """Return the rate of the integral, the feedback, and the estimate of what acts unknown."""
        gains, k = self.position, moving.position.order
        error, rate = moving.position - _desired(s, 0, k), moving.velocity - _desired(s, 1, k)
        integrand: Any = error if gains.c1 is None else rate + gains.c1 * error
        feedback: Any = gains.kx * error + gains.kv * rate
        part: Any = 0.0
        if gains.ki is not None:
            integral = [s.memory["integral"], *(integrand.derivative(j) for j in range(k))]
            part = gains.ki * Jet.of(integral)
        estimate = 0.0 if gains.c1 is None else part
        return integrand, gains.bounded(feedback + part), estimate

    def _of_attitude(self, s: Tracking, acceleration: Jet) -> Tracking:
        """Return all that the attitude law reads."""
        assert s.flat is not None
        G, turns = rigid(s.G), slice(0, rigid(s.G).rotations)
        R, turning = G.rotation(s.Q), s.V[..., turns]
        if self.rates == "filter":
            now, rate = s.memory[FILTERED], s.memory[FILTERED_RATE]
            acceleration = Jet.of([now, rate, self._filter_rate(s, acceleration.value)])
        side: Any = None
        if self.across:
            moving = _desired(s, 1, acceleration.order)
            jets = sides(G, acceleration, moving, self.across, self.direction, _mass(s))
            acceleration, side = jets[0], jets[-1]
        desired = self.oriented(acceleration, s.flat.turn(acceleration.order), R, side)
        if self.rates == "reference":
            desired = desired._replace(velocity=s.Vd[..., turns], acceleration=s.Vd_dot[..., turns])
        elif self.rates == "heading":
            assert s.flat.heading is not None
            axis, psi = third_axis(self.direction), s.flat.heading[..., None]
            Omega, Omega_dot = psi[..., 1, :] * axis, psi[..., 2, :] * axis
            desired = desired._replace(velocity=Omega, acceleration=Omega_dot)
        inputs = LawInput(s.t, R, turning, *desired)
        n = len(ATTITUDE)
        memory = {name[n:]: z for name, z in s.memory.items() if name.startswith(ATTITUDE)}
        inertia = self.inner_inertia(s.G, s.inertia)
        return inputs.tracking(G.rotation_group, inertia, s.gains, memory)

    def oriented(self, force: Jet, heading: Jet | None, R: Array, side: Any) -> Attitude:
        """Return the attitude that a force asks for, as `attitude`; a subclass may turn it."""
        return attitude(force, self.direction, heading, R, side)

    def _filter_rate(self, s: Tracking, acceleration: Array) -> Any:
        w: Any = self.bandwidth
        return w * w * (acceleration - s.memory[FILTERED]) - 2.0 * w * s.memory[FILTERED_RATE]

    # The law.

    def torque(self, s: Tracking) -> Array:
        """Return torque and push, body frame."""
        return self.wrench(s, self.inner.torque(self.commanded(s).tracking))

    def push(self, acceleration: Any, b: Any) -> Any:
        """Return the push per mass along the body axis b for F/m, arrays or series.

        A plugin may push otherwise, and limit the `wrench`.
        """
        return dot(acceleration, b)

    def wrench(self, s: Tracking, torque: Array) -> Array:
        """Return the command for that of the attitude law, torque or rate; with the push, body."""
        G, axis = rigid(s.G), np.array(self.direction)
        for force in self.known_forces:
            if force.turns and self.commands == "torque":
                torque = torque - force.in_body(G, s.t, s.Q, s.V)[..., : G.rotations]
        b = G.rotation(s.Q) @ axis
        push = _mass(s) * self.push(self.commanded(s).acceleration, b)[..., None] * axis
        return np.concatenate([torque, push], axis=-1)

    def lyapunov(self, s: Tracking) -> Array:
        """Return that of the attitude law."""
        return self.inner.lyapunov(self.commanded(s).tracking)

    def velocity_error(self, s: Tracking) -> Array:
        """Return that of the attitude law, and 0 for the translation."""
        inside = self.commanded(s)
        turning = self.inner.velocity_error(inside.tracking)
        return np.concatenate([turning, 0.0 * inside.acceleration], axis=-1)

    def dissipation(self, s: Tracking) -> Array | None:
        """Return that of the attitude law; None where R_c turns otherwise than by the model."""
        position = self.position
        assumes = not self.exact or self.rates != "model" or position.c1 is not None
        if assumes or position.period is not None or self.acting:
            return None
        return self.inner.dissipation(self.commanded(s).tracking)

    @property
    def energy(self) -> str:  # type: ignore[override]  # a constant of most laws
        """L of the attitude law."""
        return self.inner.energy if self.inner else Controller.energy

    # Its memory.

    output_units: ClassVar[Mapping[str, str]] = {
        "integral": "m s",
        FILTERED: "m/s^2",
        FILTERED_RATE: "m/s^3",
    }

    def memory(self, G: MatrixLieGroup) -> Mapping[str, int]:
        """Return the lengths of the integral, of the filter, and of the attitude law's memory."""
        inner, n = self.inner.memory(self.gains_group(G)).items(), rigid(G).space
        names = ["integral"] if self.position.ki is not None else []
        if self.rates == "filter":
            names += [FILTERED, FILTERED_RATE]
        clock = {} if self.position.period is None else {HELD: n * (1 + self._order), LEFT: 1}
        return dict.fromkeys(names, n) | clock | {ATTITUDE + name: length for name, length in inner}

    def initial_memory(self, s: Tracking) -> Mapping[str, Array]:
        """Return a filter that has settled, and the beginning of the attitude law."""
        begun: dict[str, Array] = {}
        if self.position.period is not None:
            begun[HELD] = self._renewed(s)
        if self.rates == "filter":
            begun[FILTERED] = self._acceleration(s)[0].value
        s = replace(s, memory={**s.memory, **begun})
        inner = self.inner.initial_memory(self.commanded(s).tracking).items()
        return begun | {ATTITUDE + name: z for name, z in inner}

    def memory_rate(self, s: Tracking) -> Mapping[str, Array]:
        """ė_I = e, the filter's rates, and those of the attitude law."""
        inside, integrand = self.commanded(s), self._integrand(s)
        inner = self.inner.memory_rate(inside.tracking).items()
        rates = {name: 0.0 * s.memory[name] for name in (HELD, LEFT) if name in s.memory}
        rates |= {ATTITUDE + name: rate for name, rate in inner}
        if self.position.ki is not None:
            rates["integral"] = integrand
        if self.rates == "filter":
            rates[FILTERED] = s.memory[FILTERED_RATE]
            rates[FILTERED_RATE] = self._filter_rate(s, inside.acceleration)
        return rates

    def _integrand(self, s: Tracking) -> Array:
        """Return the rate of the integral after an anti-windup; the attitude law is told, too."""
        inside, turns = self.commanded(s), rigid(s.G).rotations
        if not self.acting:
            return inside.integrand
        x = excess(s.G, self.acting, self.wrench(s, self.inner.torque(inside.tracking)))
        inside.tracking.once(EXCESS, lambda _: x[..., :turns])
        if self.position.anti_windup == "none":
            return inside.integrand
        axis = np.array(self.direction)
        b = rigid(s.G).rotation(s.Q) @ axis
        ki = dot(self.position.ki * b, b)[..., None]
        along, cut = dot(inside.integrand, b)[..., None], dot(x[..., turns:], axis)[..., None]
        new = unwound(self.position.anti_windup, along, cut / _mass(s), ki)
        return inside.integrand + (new - along) * b

    def memory_gradient(self, s: Tracking) -> Mapping[str, Array] | None:
        """Return ∂L/∂z of the attitude law; None where R_c has a memory, too."""
        inner = laws.memory_gradient(self.inner, self.commanded(s).tracking)
        if inner is None or {"integral", HELD, FILTERED} & s.memory.keys():
            return None
        return {ATTITUDE + name: gradient for name, gradient in inner.items()}

    def answer(self, s: Tracking, period: Any) -> tuple[Array, Mapping[str, Array]]:
        """Return the command, and the memory a period later, while F is held."""
        step, later = period, dict[str, Array]()
        if self.position.period is not None:
            left = s.memory[LEFT]
            is_due = less(left, period / 2)
            step = where(is_due, self.position.period + 0 * left, 0 * left)
            later[LEFT] = left + step - period
            later[HELD] = where(is_due, self._renewed(s), s.memory[HELD])
            s = replace(s, memory={**s.memory, **later})
        inside, integrand = self.commanded(s), self._integrand(s)
        torque, inner = self.inner.answer(inside.tracking, period)
        later |= {ATTITUDE + name: z for name, z in inner.items()}
        if self.position.ki is not None:
            later["integral"] = s.memory["integral"] + step * integrand
        if self.rates == "filter":
            w: Any = self.bandwidth
            behind, rate = s.memory[FILTERED] - inside.acceleration, s.memory[FILTERED_RATE]
            decay, slope = exp(-w * period), rate + w * behind
            later[FILTERED] = inside.acceleration + decay * (behind + period * slope)
            later[FILTERED_RATE] = decay * (rate - w * period * slope)
        return self.wrench(s, torque), later


def _missing_along(G: MatrixLieGroup, pushes: Array | None) -> tuple[str, Remedy]:
    """Return that a push has no direction, and the remedy: that of all rotors together."""
    total: Any = 0.0 if pushes is None else pushes.sum(axis=1)
    if (
        pushes is None
        or np.linalg.norm(total) <= np.sqrt(ROUNDING_OF_A_SQUARE) * np.abs(pushes).max()
    ):
        up = [0] * (rigid(G).space - 1) + [1]
        down = [-x for x in up]
        why = "no thrusters in `actuators` determine the direction of the push"
        return f"missing; {why}", Remedy(
            f"give it in the body frame: along: {up}, or {down} where the last axis points down"
        )
    mean = ", ".join(f"{x:g}" for x in (total / np.linalg.norm(total)).round(4) + 0.0)
    return "missing; the thrusters push in more than one direction", Remedy(
        f"give the one that carries the body; all of them together push along: [{mean}]"
    )


def _mass(s: Tracking) -> Array:
    """m, ``(..., 1)``."""
    first = rigid(s.G).rotations
    return s.inertia.matrix[..., first, first, None]


def _desired(s: Tracking, k: int, order: int) -> Jet:
    """Return the k-th derivative of p_d as a series."""
    assert s.flat is not None
    return Jet.of([s.flat.position[..., k + j, :] for j in range(order + 1)])
