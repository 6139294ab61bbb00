"""Laws that reject what their model does not know: INDI and the momentum observer.

Around a cascade, the estimate acts in both loops: the force changes the attitude that is commanded.
"""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np

from eqt_cli.base.arrays import (
    Array,
    Arrays,
    apply_matrix,
    cos,
    dot,
    exp,
    less,
    sin,
    transpose,
    where,
)
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import Kind, Positive, Real, Scale
from eqt_cli.components import laws
from eqt_cli.components.actuators import any_runs, excess
from eqt_cli.components.forces import ConstantForce
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.inertia import Inertia
from eqt_cli.components.matrix_groups import rigid, rigid_motions
from eqt_cli.components.mechanics import Gains, Tracking, hessian_at_identity
from eqt_cli.components.motions import PlantModel, RigidMotion, check_rigid_body
from eqt_cli.components.references import ConstantReference
from eqt_cli.components.vehicle import place_of
from eqt_cli.numbers.jets import Jet
from eqt_cli.numbers.leaves import with_fields

INNER = "law_"
"""Prefix of the states of the inner law, before its own names."""

STARTED, ACTUATED, DISTURBANCE = "started", "actuated", "disturbance"
"""States: 0 before the first measurement, then 1; û, the torque of the actuators as it is believed;
δ̂, the torque that the model does not know."""

Estimate = tuple[Array, dict[str, Array]]
"""δ̂, and the states that follow."""


class ConstantDisturbance(NamedTuple):
    """A disturbance at rest.

    Attributes
    ----------
    reference
        At rest.
    wrench : (m,)
        Its coordinates, those of δ̂.
    forces
        The forces on the vehicle without it.
    pushes
        It as forces on the vehicle.
    share
        What part of it δ̂ tends to.
    """

    reference: Any
    wrench: Array
    forces: tuple[Any, ...]
    pushes: tuple[ConstantForce, ...]
    share: float


@dataclass(frozen=True)
class Rejecting(laws.CountsInstants, laws.ReadsLimits):
    """u = τ − δ̂ around a law with the torque τ, on every group.

    δ̂ is an estimate of all that acts besides the torque û of the actuators. After every command,

        û ← û + (1 − e^{−T/T_a})(sat(u) − û),

    with the control period T, a lag T_a of the actuators, and what the limits that the law knows
    leave of u. At the start û is 0 or, of rotors, what they run at.

    Around a `cascade`, δ̂ acts in both loops, as known forces do: its torque, body frame, in that of
    the attitude law, and its force, in space, in F, so that it tilts the body. There δ̂ is 0 at the
    start, and the forces of the model are none of it. Rates of R_c take it as constant. Where the
    attitude law commands rates, the force alone is estimated: nothing is added to the rates.

    Attributes
    ----------
    law
        The inner law: a kind of the group, or a mapping with `kind` and options.
    lag
        T_a as it is believed, s: a number, or one along each axis. Default: that of the actuator
        `lag` or the `time_constant` of thrusters, of two the longer one, else 0.
    lateral
        Of a cascade, whether all of the estimated force acts, or only what the push can give.
    estimate
        Of a cascade, δ̂ at the start: the torque, N m, and the force in space, N. Default: 0.
    believed
        The lag T_a along each axis, s; None for 0.
    """

    # Those of the inner law, where it is known.
    tasks: Any = field(default=(), init=False, repr=False)  # type: ignore[misc]
    matched: Any = field(default=None, init=False, repr=False)  # type: ignore[misc]
    weight: Any = field(default="", init=False, repr=False)  # type: ignore[misc]
    energy: Any = field(default=laws.Controller.energy, init=False, repr=False)  # type: ignore[misc]

    theorem: ClassVar[str] = ""
    departs: ClassVar[str] = "disturbance observer in the law"
    output_units: ClassVar[Mapping[str, str]] = {DISTURBANCE: "N m"}
    bounded: ClassVar[tuple[str, float, str]]
    """The option that has a bound, this bound times the control period, and the unit."""

    law: str | dict[str, Any] = field(compare=False)  # `inner` is what counts
    lag: Annotated[Real | list[Real] | None, Scale("believed lag", "s")] = field(
        default=None, kw_only=True
    )
    lateral: bool = field(default=True, kw_only=True)
    estimate: list[Real] | None = field(default=None, kw_only=True)
    around: Any = field(default=None, init=False, repr=False)  # the law that it is around
    acting: Any = field(default=(), init=False, repr=False)
    known_forces: Any = field(default=(), init=False, repr=False)  # tuple of forces
    believed: Any = field(default=None, init=False, repr=False)  # the lag by axis; None for 0
    runs: Any = field(default=False, init=False, repr=False)

    # What it is made of.

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note an inner law without a torque of its own, and a lag that is none."""
        inner = {**self.law} if isinstance(self.law, dict) else self.law
        for key in ("gains", "label", "known_forces"):
            if isinstance(inner, dict) and inner.pop(key, None) is not None:
                problems.at("law", key).add(f"is of {self.name}; write it beside `law`, not in it")
        law = Kind(laws.controllers).checked(inner, problems.at("law"), G)
        without = (laws.Designed, laws.Previews, laws.RunsCode, Rejecting)
        if law is not None and (isinstance(law, without) or law.commands != "torque"):
            said = f"expected a law of {G.name} that computes a torque, such as lee2010"
            problems.at("law").add(f"{said}, got {law.name}")
        elif law is not None and not (self.lateral or isinstance(law, laws.OuterLoop)):
            problems.at("lateral").add(f"applies to a cascade only, got law: {law.name}")
        elif law is not None and self.estimate is not None:
            if not isinstance(law, laws.OuterLoop):
                problems.at("estimate").add(f"applies to a cascade only, got law: {law.name}")
            elif len(self.estimate) != G.dimension:
                said = f"expected {G.dimension} numbers, of torque and force"
                problems.at("estimate").add(f"{said}, got {len(self.estimate)}")
        if isinstance(self.lag, list) and len(self.lag) != G.dimension:
            said = f"expected a number, or {G.dimension} of them"
            problems.at("lag").add(f"{said}, got {len(self.lag)}")
        elif self.lag is not None and (least := np.min(self.lag)) < 0:
            problems.at("lag").add(f"expected at least 0 s, got {least:g}")

    def loaded(
        self, home: Any, G: MatrixLieGroup, problems: Problems
    ) -> tuple[Self, dict[str, str]]:
        """Return the law with its inner law; around an outer loop, it is one itself."""
        law: Any = Kind(laws.controllers).checked(self.law, Problems(), G)
        if law is None:
            return self, {}
        law, files = law.loaded(home, G, Problems())
        ready = self
        if isinstance(law, laws.OuterLoop):
            if law.commands not in ("torque", "rates"):
                said = "expected an attitude law that commands a torque or rates, such as lee2010"
                problems.at("law", "attitude").add(f"{said}, got {law.inner.name}")
            elif law.commands == "rates" and np.any((self.estimate or [])[: G.parts[0].axes.stop]):
                said = "expected 0 as the torques, as the attitude law commands rates"
                problems.at("estimate").add(f"{said}, got {self.estimate}")
            options = {
                field.name: getattr(self, field.name) for field in fields(self) if field.init
            }
            ready = self.around_outer_loop(**options)
        names = ("tasks", "matched", "weight", "energy")
        return with_fields(ready, around=law, **{name: getattr(law, name) for name in names}), files

    @property
    def around_outer_loop(self) -> Any:
        """The class of this law around an outer loop."""
        return next(kind for kind in Outer.__subclasses__() if issubclass(kind, type(self)))

    @property
    def inner(self) -> Any:
        """The law that the gains are of."""
        return self.around

    def gains_group(self, G: MatrixLieGroup) -> MatrixLieGroup:
        """Return the group that the gains of the inner law are of."""
        law = self.around or Kind(laws.controllers).checked(self.law, Problems(), G)
        return G if law is None else laws.gains_group(law, G)

    def defaults(self, G: MatrixLieGroup, gains: Gains) -> Mapping[str, Any]:
        """Return the inner law with the options that follow its gains."""
        return {"around": laws.with_defaults(self.around, G, gains, self.law)}

    def for_plant(self, G: MatrixLieGroup, plant: PlantModel, problems: Problems) -> Self:
        """Return the law with lag, limits and forces that it knows; note what does not fit."""
        if plant.period is None:
            problems.add("answers at control instants; set control.period, at which it is called")
            return self
        name, most, unit = self.bounded
        if (value := float(np.max(getattr(self, name)))) * plant.period >= most:
            said = f"{most / plant.period:g} {unit}, as the law answers every {plant.period:g} s"
            problems.at(name).add(f"expected less than {said}, got {value:g}")
        if not isinstance(plant.inertia, Inertia):
            problems.add("needs a constant inertia; write `inertia` as numbers")
        for index, part in enumerate(plant.actuators):
            unlike = part.limits and part.allowed(G, np.zeros(G.dimension)) is None
            if unlike or getattr(part, "rubbing", None) is not None:
                problems.add(
                    f"cannot know what {place_of(plant.vehicle, index)}, {part.name}, leaves of "
                    "its command; use a limit, or thrusters without allocation: bounded, and "
                    "no friction"
                )
        return with_fields(
            self,
            around=self.around.for_plant(
                G, plant.inside("around", self.around, G, self.law), problems.at("law")
            ),
            acting=tuple(part for part in plant.actuators if part.limits),
            known_forces=plant.forces,
            believed=self._lag(G, plant, problems.at("lag")),
            runs=any_runs(plant.actuators),
        )

    def _lag(self, G: MatrixLieGroup, plant: PlantModel, problems: Problems) -> Array | None:
        """Return the believed lag along each axis; None for 0."""
        lags = [getattr(part.linear_part, "time_constant", None) for part in plant.actuators]
        true = [np.unique(x) if np.ptp(x) == 0 else x for x in lags if x is not None]
        lag: Any = self.lag
        if lag is None and len(true) == 1 and np.size(true[0]) in (1, G.dimension):
            lag = true[0]
        elif sum(map(np.size, true)) > 1 and not isinstance(lag, list):
            listed = ", ".join(f"{x:g}" for x in np.concatenate(true))
            got = f"the actuators lag by {listed} s" + ("" if lag is None else f", got {lag:g}")
            problems.add(f"expected a list of {G.dimension} lags, one along each axis, as {got}")
        if not np.any(lag):
            return None
        return np.maximum(np.broadcast_to(lag, G.dimension), np.finfo(float).tiny)

    def cycle(self, period: float) -> Sequence[Mapping[str, float]]:
        """Return that the first measurement has been, and what the inner law counts."""
        counts = self.around.cycle(period) if isinstance(self.around, laws.CountsInstants) else [{}]
        return [
            {STARTED: 1.0, **{INNER + name: z for name, z in count.items()}} for count in counts
        ]

    def lyapunov(self, s: Tracking) -> Array:
        """Return that of the inner law."""
        value: Array = self.law_at(s).lyapunov(self._inside(s))
        return value

    def torque(self, s: Tracking) -> Array:
        """τ − δ̂ with the last estimate, body frame."""
        torque: Array = self.around.torque(self._inside(s)) - s.memory[DISTURBANCE]
        return torque

    def law_at(self, s: Tracking) -> Any:
        """Return the inner law, with the last estimate where it is told that."""
        return self.around

    # Its memory.

    def memory(self, G: MatrixLieGroup) -> Mapping[str, int]:
        """Return the lengths of its states, and of those of the inner law."""
        lengths = {STARTED: 1, ACTUATED: G.dimension, DISTURBANCE: G.dimension}
        return lengths | {INNER + name: n for name, n in self.around.memory(G).items()}

    def outputs(self, G: MatrixLieGroup) -> Mapping[str, int]:
        """Return the length of δ̂, and of the states of the inner law."""
        shown = (DISTURBANCE, *(INNER + name for name in self.around.memory(G)))
        return {name: n for name, n in self.memory(G).items() if name in shown}

    def memory_rate(self, s: Tracking) -> Arrays:
        """Return the rates of the inner law, and 0 for the states that change at instants."""
        inner = self.law_at(s).memory_rate(self._inside(s))
        waiting = {name: 0.0 * z for name, z in s.memory.items()}
        return waiting | {INNER + name: rate for name, rate in inner.items()}

    def initial_memory(self, s: Tracking) -> Arrays:
        """Return the beginning of the inner law."""
        inner = self.law_at(s).initial_memory(self._inside(s))
        return {INNER + name: z for name, z in inner.items()}

    def _inside(self, s: Tracking) -> Tracking:
        """Return what the inner law reads, with its own memory."""
        n = len(INNER)
        memory = {name[n:]: z for name, z in s.memory.items() if name.startswith(INNER)}
        rates = {"Vd": s.Vd, "Vd_dot": s.Vd_dot, "Pd_dot": s.Pd_dot}
        return with_fields(s, memory=memory, V=s.V, **rates)

    def answer(self, s: Tracking, period: Any) -> tuple[Array, Arrays]:
        """Return u, and all states a period later."""
        is_first, before = less(s.memory[STARTED], 0.5), s.memory[ACTUATED]
        if self.runs:
            first, _ = self.rejecting(s, s.memory[DISTURBANCE], period)
            before = where(is_first, self.wrench_of(s.command(first)), before)
        estimate, states = self.estimated(s, before, is_first, period)
        u, inner = self.rejecting(s, estimate, period)
        reached = self.wrench_of(s.command(u))
        if self.acting:
            reached = reached - excess(s.G, self.acting, reached)
        if self.believed is not None:
            reached = reached + exp(-period / self.believed) * (before - reached)
        states |= {INNER + name: z for name, z in inner.items()}
        started = 1.0 + 0.0 * s.memory[STARTED]
        return u, {STARTED: started, ACTUATED: reached, DISTURBANCE: estimate, **states}

    def wrench_of(self, command: Array) -> Array:
        """Return what a command asks of the actuators, as far as it is a force."""
        return command

    def rejecting(self, s: Tracking, estimate: Array, period: Any) -> tuple[Array, Arrays]:
        """Return u with an estimate, and the states of the inner law a period later."""
        tau, inner = self.around.answer(self._inside(s), period)
        return tau - estimate, inner

    def constant_disturbance(self, loop: Any, error: float) -> "ConstantDisturbance":
        """Return one at rest that a law of its gains alone would give an error, rad or m."""
        wrench = error * np.diagonal(hessian_at_identity(loop.group, loop.gains.K))
        pushes = (ConstantForce(wrench.tolist()).of_run(loop.group, None),)
        still, share = ConstantReference("identity"), self.share_found(loop.period)
        return ConstantDisturbance(still, wrench, loop.vehicle.forces, pushes, share)

    def share_found(self, period: float) -> float:
        """Return the share of a constant disturbance that the estimate tends to."""
        return 1.0

    # What estimators compare with 𝕀V̇, in the coordinates of δ̂.

    def framed(self, s: Tracking, wrench: Array) -> Array:
        """Return a wrench or momentum of the body frame in the coordinates of δ̂."""
        return wrench

    def unforced(self, s: Tracking) -> Array:
        """Return the rate of the momentum without actuators and what is unknown."""
        return -s.command(-s.G.ad_star(s.V, s.P))  # the loop commands τ − f

    @abstractmethod
    def estimated(self, s: Tracking, actuated: Array, is_first: Array, period: Any) -> Estimate:
        """Return δ̂ at an instant where the actuators give û, and the states that follow."""


class Compared(NamedTuple):
    """What INDI compares at an instant, in the coordinates of δ̂ = `rest` − H[`residual`].

    Attributes
    ----------
    residual, rest
        What it filters, and what it does not, ``(..., m)``.
    measured
        What the next difference is taken from.
    """

    residual: Array
    rest: Any
    measured: Array


@dataclass(frozen=True)
class Indi(Rejecting, laws.KnowsForces):
    """Incremental nonlinear dynamic inversion around a law with the torque τ, on every group.

    u = 𝕀ν + H[û − 𝕀(V_k − V_{k−1})/T],  𝕀ν = τ + ad*_V 𝕀V,

    at control instants a period T apart, with the measured V and the torque û of the actuators as
    it is believed. H is a Butterworth filter of second order, K = tan(π f T). With an exact model
    this is u = τ − H[δ]: the inner law and an estimate δ̂ = τ − u of all that acts besides the
    actuators, known forces and gravity included, which are not taken from u again. The first
    instant has no difference: it is 0, and H has settled on û.

    With `linear: accelerometer`, on SE(2) and SE(3) and for the inertia diag(J, m I),

    u = τ − w + ad*_Ω JΩ + H[û − (J ΔΩ/T, m a)],

    where a is the measured specific force and w the weight that the model knows.

    After Smeur, Chu and de Croon (2016), of which only the abstract was read, and the firmware of
    the Crazyflie (controller_indi.c); the form on groups is that of the design of eqt.

    Attributes
    ----------
    cutoff
        f, the cutoff of H, Hz; less than half the control rate.
    gyro
        `differences` of the measured velocity; `estimate`: also of an estimator's velocity, which
        is a second filter that û does not pass.
    linear
        Where the acceleration of the origin comes from: `differences`, or `accelerometer`.
    """

    name: ClassVar[str] = "indi"
    title: ClassVar[str] = "INDI"
    bounded: ClassVar[tuple[str, float, str]] = "cutoff", 0.5, "Hz"
    bibtex: ClassVar[str] = laws.published("smeur2016adaptive")

    cutoff: Annotated[Positive, Scale("cutoff", "Hz")]
    gyro: Literal["differences", "estimate"] = field(default="differences", kw_only=True)
    linear: Literal["differences", "accelerometer"] = field(default="differences", kw_only=True)

    @property
    def reads_specific_force(self) -> bool:
        """Whether it reads an accelerometer."""
        return self.linear == "accelerometer"

    def for_plant(self, G: MatrixLieGroup, plant: PlantModel, problems: Problems) -> Self:
        """Return the law with what it knows; note sensors and inertias that do not fit."""
        law = super().for_plant(G, plant, problems)
        if problems:
            return law
        vehicle = plant.vehicle
        most = max((x.every for x in vehicle.channels(G) if x.signal == "velocity"), default=0)
        if most > vehicle.control.clock.every:  # with an estimator, too
            slow, period = f"{most * vehicle.tick:g} s", f"{vehicle.control.period:g} s"
            said = f"the velocity is measured every {slow}, so that differences in between are 0"
            remedy = f"measure it every {period}, or set control.period to {slow}"
            problems.at("gyro").add(f"{said}; {remedy}")
        elif vehicle.estimator is not None and self.gyro != "estimate":
            said = f"û does not pass the filter of the estimator, {vehicle.estimator.name}"
            problems.at("gyro").add(f"{said}; write gyro: estimate, or remove the estimator")
        if self.reads_specific_force and not rigid_motions(G):
            here = problems.at("linear")
            here.add(f"accelerometer needs group SE2 or SE3, got {G.name}; use differences")
        elif self.reads_specific_force:
            check_rigid_body(G, plant.inertia, problems.at("linear"))
            weighs = [hasattr(x, "weight_alone") for x in (*law.known_forces, *vehicle.forces)]
            if any(weighs) and not any(weighs[: len(law.known_forces)]):
                said = "no accelerometer feels the weight, and the law does not know it"
                problems.at("linear").add(f"{said}; write restoring under model.forces, too")
        return law

    def memory(self, G: MatrixLieGroup) -> Mapping[str, int]:
        """Return the lengths of all states: the last V, and two of the filter for each axis."""
        names = ("measured", "filter", "filter_next")
        return {**super().memory(G), **dict.fromkeys(names, G.dimension)}

    def initial_memory(self, s: Tracking) -> Arrays:
        """Return the δ̂ of running rotors, against the forces that the law knows."""
        rejected = (
            {DISTURBANCE: self._of_known_forces(s) - s.G.ad_star(s.V, s.P)} if self.runs else {}
        )
        return {**super().initial_memory(s), **rejected}

    def _of_known_forces(self, s: Tracking, of_weight: bool = False) -> Any:
        """Return the forces that the model knows, or their weight alone, body frame."""
        forces: Any = self.known_forces
        if of_weight:
            forces = [force.weight_alone for force in forces if hasattr(force, "weight_alone")]
        return 0.0 * s.V + sum(force.in_body(s.G, s.t, s.Q, s.V) for force in forces)

    def compared(self, s: Tracking, actuated: Array, is_first: Array, period: Any) -> Compared:
        """Return what H reads, and δ̂ without it."""
        V, weight = s.V, 0.0 * s.V
        change = where(is_first, 0.0 * V, (V - s.memory["measured"]) / period)
        if self.reads_specific_force:
            turns = s.G.parts[0].axes
            change = np.concatenate([change[..., turns], s.specific_force], axis=-1)
            V = np.concatenate([V[..., turns], 0.0 * s.specific_force], axis=-1)
            weight = self._of_known_forces(s, of_weight=True)
        free = s.G.ad_star(V, s.inertia.momentum(V))
        r = actuated - s.inertia.momentum(change)
        if self.runs:
            r = where(is_first, weight - self._of_known_forces(s), r)
        return Compared(r, weight - free, s.V)

    def estimated(self, s: Tracking, actuated: Array, is_first: Array, period: Any) -> Estimate:
        """Return −(ad*_V 𝕀V + H[û − 𝕀ΔV/T]), and the states of the filter."""
        r, rest, measured = self.compared(s, actuated, is_first, period)
        K = sin(np.pi * self.cutoff * period) / cos(np.pi * self.cutoff * period)
        scale = 1.0 / (1.0 + np.sqrt(2.0) * K + K * K)
        b, a1 = K * K * scale, 2.0 * (K * K - 1.0) * scale
        a2 = (1.0 - np.sqrt(2.0) * K + K * K) * scale
        z1 = where(is_first, (1.0 - b) * r, s.memory["filter"])
        z2 = where(is_first, (b - a2) * r, s.memory["filter_next"])
        y = b * r + z1
        states = {"measured": measured + 0.0 * r, "filter": 2.0 * b * r - a1 * y + z2}
        return rest - y, {**states, "filter_next": b * r - a2 * y}


@dataclass(frozen=True)
class MomentumObserver(Rejecting):
    """A law with an observer of the momentum, u = τ − δ̂, on every group.

    P̂̇ = ad*_V 𝕀V + û + f + δ̂,  δ̂ = k(𝕀V − P̂),

    by a step of Euler with the û that the command leads to, so that δ̂ is INDI's with a first-order
    filter, without a difference. f are the forces that the model knows. P̂ begins at the first 𝕀V.
    After the external wrench observers of aerial robots; the form is that of the design of eqt.

    Attributes
    ----------
    rate
        k, how fast δ̂ follows, rad/s: a number, or one along each axis; less than 1/T. A
        Butterworth filter with the cutoff ω has the delay of k = ω/√2.
    """

    name: ClassVar[str] = "observer"
    bounded: ClassVar[tuple[str, float, str]] = "rate", 1.0, "rad/s"

    rate: Annotated[laws.EachAxis, Scale("rate of the observer", "rad/s")]

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note what no law that rejects may have, and rates that are not for each axis."""
        super().check(G, problems)
        laws.check_each_axis(self.rate, G.dimension, problems.at("rate"))

    def memory(self, G: MatrixLieGroup) -> Mapping[str, int]:
        """Return the lengths of all states, with P̂ of the next instant without û and δ̂."""
        return {**super().memory(G), "momentum": G.dimension}

    def estimated(self, s: Tracking, actuated: Array, is_first: Array, period: Any) -> Estimate:
        """Return k(𝕀V − P̂), and P̂."""
        acting, measured = self.framed(s, actuated), self.framed(s, s.P)
        new = s.memory["momentum"] + period * (acting + s.memory[DISTURBANCE])
        P = where(is_first, measured - s.memory[DISTURBANCE] / self.rate, new)
        states = {"momentum": P + period * self.unforced(s)}
        return self.rate * (measured - P), states


# Around an outer loop: a cascade that knows the estimate ------------------------------------------


@dataclass(frozen=True)
class EstimatedForce:
    """An estimate δ̂ as a cascade reads a known force: constant in Ω̇_c and what is above it.

    Attributes
    ----------
    wrench : (..., m)
        The torque, body frame, and the force in space.
    """

    turns: ClassVar[bool] = True

    wrench: Array

    def in_space(self, G: Any, t: Any, moving: RigidMotion) -> Any:
        """Return the force as a series, in space."""
        force = self.wrench[..., G.translation.axes]
        return Jet([force, *[None] * moving.position.order])

    def in_body(self, G: Any, t: Any, Q: Array, V: Array) -> Array:
        """Return torque and force, body frame."""
        force = apply_matrix(transpose(G.rotation(Q)), self.wrench[..., G.translation.axes])
        return np.concatenate([self.wrench[..., : G.rotations], force], axis=-1)


def rigid_rotations(wrench: Array) -> int:
    """Return the number of torques in a wrench of SE2 or SE3."""
    return 3 if wrench.shape[-1] == 6 else 1


class Outer(laws.OuterLoop, Rejecting):
    """A law that rejects, around an outer loop, whose force is that of the estimate, too."""

    reads_flat_output: ClassVar[bool] = True
    reads_gains: ClassVar[bool] = False

    inner = property(lambda self: self.around.inner)
    commands = property(lambda self: self.around.commands if self.around else "torque")
    direction = property(lambda self: self.around.direction)
    undefined = property(lambda self: self.around.undefined)
    position = property(lambda self: self.around.position)

    def inner_inertia(self, G: MatrixLieGroup, inertia: Any) -> Inertia:
        """Return the inertia of the attitude law."""
        of: Inertia = self.around.inner_inertia(G, inertia)
        return of

    def gains_group(self, G: MatrixLieGroup) -> MatrixLieGroup:
        """Return the group of the attitude law."""
        return laws.gains_group(self.around, G)

    def initial_memory(self, s: Tracking) -> Arrays:
        """Return the beginning of the cascade, and δ̂ where it is given."""
        begun = Rejecting.initial_memory(self, s)
        if self.estimate is not None:
            begun = {**begun, DISTURBANCE: np.array(self.estimate) + 0.0 * s.P}
        return begun

    def wrench_of(self, command: Array) -> Array:
        """Return a command without its rates, of which no torque is known."""
        return self._force_of(command)

    def _force_of(self, wrench: Array) -> Array:
        """Return a wrench, of a law that commands rates only its force."""
        if self.commands != "rates":
            return wrench
        turns = rigid_rotations(wrench)
        return np.concatenate([0.0 * wrench[..., :turns], wrench[..., turns:]], axis=-1)

    def directions(self, G: MatrixLieGroup) -> Array:
        """Return those of the cascade."""
        axes: Array = self.around.directions(G)
        return axes

    def commanded(self, s: Tracking) -> Any:
        """Return what the position loop asks for, with the last estimate."""
        return self.law_at(s).commanded(self._inside(s))

    def attitude_error(self, s: Tracking) -> Array:
        """Return that of the cascade, with the last estimate."""
        error: Array = self.law_at(s).attitude_error(self._inside(s))
        return error

    def loop_errors(self, s: Tracking) -> Array:
        """Return those of the cascade, with the last estimate."""
        errors: Array = self.law_at(s).loop_errors(self._inside(s))
        return errors

    def velocity_error(self, s: Tracking) -> Array:
        """Return that of the cascade, with the last estimate."""
        error: Array = self.law_at(s).velocity_error(self._inside(s))
        return error

    def _with_estimate(self, estimate: Array) -> Any:
        """Return the cascade with an estimate, where all of its force acts."""
        if not self.lateral:
            return self.around
        return with_fields(
            self.around, known_forces=(*self.around.known_forces, EstimatedForce(estimate))
        )

    def _matched(self, s: Tracking, estimate: Array) -> Any:
        """Return torque and push of an estimate that does not tilt; else 0."""
        if self.lateral:
            return 0.0
        wrench = EstimatedForce(estimate).in_body(s.G, s.t, s.Q, s.V)
        axis, turns = np.array(self.direction), rigid(s.G).rotations
        push = dot(wrench[..., turns:], axis)[..., None] * axis
        return np.concatenate([wrench[..., :turns], push], axis=-1)

    def law_at(self, s: Tracking) -> Any:
        """Return the cascade with the last estimate."""
        return self._with_estimate(s.memory[DISTURBANCE])

    def torque(self, s: Tracking) -> Array:
        """Return torque and push with the last estimate, body frame."""
        matched = self._matched(s, s.memory[DISTURBANCE])
        torque: Array = self.law_at(s).torque(self._inside(s)) - matched
        return torque

    def rejecting(self, s: Tracking, estimate: Array, period: Any) -> tuple[Array, Arrays]:
        """Return torque and push with an estimate, and the states of the cascade."""
        u, inner = self._with_estimate(estimate).answer(self._inside(s), period)
        return u - self._matched(s, estimate), inner

    def constant_disturbance(self, loop: Any, error: float) -> ConstantDisturbance:
        """Return one at rest, torque in the body and force in space, beside the forces it knows.

        Others could change as it tilts.
        """
        G, position = rigid(loop.group), loop.controller.position
        turns = G.rotations
        wrench = np.empty(G.dimension)
        wrench[:turns] = error * np.diagonal(hessian_at_identity(G.rotation_group, loop.gains.K))
        wrench = self._force_of(wrench)
        wrench[turns:] = error * loop.inertia.at(0.0).matrix[turns, turns] * position.kx
        turning, pushing = wrench.copy(), wrench.copy()
        turning[turns:], pushing[:turns] = 0.0, 0.0
        pushes = (
            ConstantForce(turning.tolist()).of_run(G, None),
            ConstantForce(pushing.tolist(), frame="spatial").of_run(G, None),
        )
        still = {"position": ["0"] * G.space, "minimum_snap": None, "of": None, "inner": None}
        reference, share = with_fields(loop.reference, **still), self.share_found(loop.period)
        return ConstantDisturbance(reference, wrench, self.known_forces, pushes, share)

    def framed(self, s: Tracking, wrench: Array) -> Array:
        """Return a wrench or momentum with its force, or linear part, in space."""
        turns = rigid(s.G).rotations
        linear = apply_matrix(rigid(s.G).rotation(s.Q), wrench[..., turns:])
        return self._force_of(np.concatenate([wrench[..., :turns], linear], axis=-1))

    def unforced(self, s: Tracking) -> Array:
        """Return J ω × ω, 0 in space, and the forces that the model knows."""
        turns = s.G.ad_star(s.V, s.P)[..., : rigid(s.G).rotations]
        spin = np.concatenate([turns, 0.0 * s.V[..., rigid(s.G).rotations :]], axis=-1)
        return self.framed(s, self.known_wrench(s)) + self._force_of(spin)

    def known_wrench(self, s: Tracking, of_weight: bool = False) -> Any:
        """Return the forces that the model knows, or their weight alone, body frame."""
        forces: Any = self.known_forces
        if of_weight:
            forces = [force.weight_alone for force in forces if hasattr(force, "weight_alone")]
        return 0.0 * s.V + sum(force.in_body(s.G, s.t, s.Q, s.V) for force in forces)


class IndiOuter(Outer, Indi):
    """INDI around a cascade: δ̂ = −H[û + f + ad*_V 𝕀V − 𝕀ΔV/T], forces in space."""

    initial_memory = Outer.initial_memory

    def compared(self, s: Tracking, actuated: Array, is_first: Array, period: Any) -> Compared:
        """Return what acts, less the rate of the momentum; 0 at the first instant."""
        P, turns = self.framed(s, s.P), rigid(s.G).rotations
        acting = self.framed(s, actuated) + self.unforced(s)
        rate = (P - s.memory["measured"]) / period
        if self.reads_specific_force:
            a = np.concatenate([0.0 * s.V[..., :turns], s.specific_force], axis=-1)
            felt = s.inertia.momentum(a) + self.known_wrench(s, of_weight=True)
            rate = np.concatenate([rate[..., :turns], self.framed(s, felt)[..., turns:]], axis=-1)
        first = 0.0 * P - s.memory[DISTURBANCE]
        return Compared(where(is_first, first, acting - rate), 0.0, P)


class ObserverOuter(Outer, MomentumObserver):
    """A momentum observer around a cascade, of J ω in the body and m v in space."""
