"""Group, mechanics, reference, law and vehicle joined into one vector field."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import accumulate
from typing import Any, NamedTuple, Self

import numpy as np

from eqt_cli.base.arrays import Array, Arrays, distinct, dot, stack
from eqt_cli.base.errors import KeyPath, parse_key
from eqt_cli.base.registry import is_foreign
from eqt_cli.components import laws
from eqt_cli.components.accelerometer import felt, reads_specific_force
from eqt_cli.components.actuators import Actuator, any_runs
from eqt_cli.components.blocks import (
    COMMAND,
    SOLVED,
    Block,
    Blocks,
    Now,
    at_start,
    blocks_of,
    solution,
)
from eqt_cli.components.estimators import Estimator
from eqt_cli.components.forces import Force
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.inertia import Inertia, InertiaLaw
from eqt_cli.components.laws import Controller, OuterLoop, Previews, RunsCode
from eqt_cli.components.mechanics import Gains, LawInput, TimeVarying, Tracking, lie_poisson
from eqt_cli.components.motions import FlatOutput
from eqt_cli.components.references import Desired, Reference, ReferenceAhead, TorqueReference
from eqt_cli.components.sensors import Errors, Sensor
from eqt_cli.components.tasks import TRACK, Task
from eqt_cli.components.vehicle import (
    COMMANDS,
    CONTROL,
    INNER,
    LOST,
    SIGNALS,
    Vehicle,
    command_length,
    moving_sensors,
)
from eqt_cli.components.vehicle_parts import presences
from eqt_cli.numbers.leaves import STRUCTURE, leaves

# The layout of a flat state: named stretches of numbers, one after the other ----------------------


@dataclass(frozen=True)
class StateLayout:
    """Names and lengths of the stretches of a flat state, in order.

    A part of the loop that has states adds a stretch.

    Attributes
    ----------
    lengths
        Length of each stretch.
    """

    lengths: Mapping[str, int]

    @property
    def length(self) -> int:
        """The number of entries of a flat state."""
        return sum(self.lengths.values())

    @cached_property
    def slices(self) -> dict[str, slice]:
        """The slice of each stretch in a flat state."""
        pairs = zip(self.lengths.items(), accumulate(self.lengths.values()), strict=True)
        return {name: slice(end - length, end) for (name, length), end in pairs}

    def split(self, state: Array) -> dict[str, Array]:
        """Split flat states ``(..., length)`` into their stretches."""
        return {name: state[..., where] for name, where in self.slices.items()}

    def join(self, stretches: Mapping[str, Any], like: Array) -> Array:
        """Join stretches to flat states, of the shape and type of `like`; undoes `split`.

        Stretches that the layout does not have are left out.
        """
        state = np.empty_like(like)
        for name, where in self.slices.items():
            state[..., where] = stretches[name]
        return state


# The closed loop as a vector field on flat states, and the signals that follow from a state -------
#
# It joins the laws and has no formula of its own. The same code runs on floats with leading batch
# axes and on object arrays of symbols; it knows no engine.


_STRETCH = {"pose": "desired_pose", "velocity": "desired_momentum"}
DESIRED = tuple(_STRETCH.values())
"""The stretches of the integrated parts of Q_d and V_d."""

MEMORY = "controller."
"""Prefix of the stretches of a law's memory, before the law's own names."""

VEHICLE = "vehicle."
"""Prefix of the stretches of the vehicle, between law and plant, before their own names."""


@dataclass(frozen=True, eq=False)  # a key of caches by identity
class ClosedLoop:
    """A mechanical system on G, the reference it tracks and the law that controls it.

    A flat state is (Q, P, Q_d, P_d, W, …): the free entries of both poses, both momenta, the
    work W taken out of L, the memory of the law, and the states of the actuators. P is 𝕀V with
    the law's model of the inertia, even where the plant's differs. The reference is part of every
    state, so that the errors between the two are consistent.

    Its leaves are the numbers that may change from run to run without changing the structure.

    Attributes
    ----------
    task
        What it is to do.
    known_forces
        The forces f of the model that the loop takes from the torque of the law.
    setpoint
        What the law knows of the reference, of `SETPOINTS`.
    held_reference, held_law, held_ahead
        Reference, law and preview with their numbers between two known instants; see `holding`.
    """

    group: MatrixLieGroup = field(metadata=STRUCTURE)
    inertia: InertiaLaw
    gains: Gains
    reference: Reference = field(metadata=STRUCTURE)
    controller: Controller
    vehicle: Vehicle = field(default_factory=Vehicle)
    task: Task = field(default=TRACK, kw_only=True, metadata=STRUCTURE)
    known_forces: tuple[Force, ...] = field(default=(), kw_only=True)
    setpoint: str = field(default="full", kw_only=True, metadata=STRUCTURE)
    held_reference: Reference | None = field(default=None, kw_only=True)
    held_law: Any = field(default=None, kw_only=True)
    held_ahead: ReferenceAhead | None = field(default=None, kw_only=True)

    @classmethod
    def of(cls, loop: "ClosedLoop") -> Self:
        """Return the system of this class for a closed loop."""
        return cls(**{field.name: getattr(loop, field.name) for field in dataclasses.fields(loop)})

    @property
    def law(self) -> Controller:
        """The law, with its numbers between two known instants where these are held."""
        law = self.controller
        return law.with_held(self.held_law) if isinstance(law, laws.HoldsNumbers) else law

    @property
    def inside(self) -> "ClosedLoop":
        """The loop that L and the gains are of: for a cascade that of its attitude, else itself."""
        outer = self.controller.formula
        if not isinstance(outer, OuterLoop):
            return self
        G, inertia = outer.gains_group(self.group), outer.inner_inertia(self.group, self.inertia)
        reference = TorqueReference([0.5] * G.dimension)
        return ClosedLoop(G, inertia, self.gains, reference, outer.inner, task=self.task)

    @property
    def period(self) -> float:
        """The control period, s; 0 without sampled control."""
        return 0.0 if self.vehicle.control is None else self.vehicle.control.period

    # Quantities for certificates, metrics and figures.

    def command(self, s: Tracking) -> Array:
        """Return the commanded torque, a held one if sampled, body frame, ``(..., m)``.

        Behind it are the thrusts of a law that commands these.
        """
        if self.vehicle.control is not None:
            return s.vehicle[COMMANDS][..., -command_length(self.vehicle, self.group) :]
        return s.command(self.law.torque(self.seen(s)))

    def seen(self, s: Tracking) -> Tracking:
        """Return a state as the law knows it, with the derivatives of its setpoint."""
        return s.once(self.setpoint, lambda s: s.at_setpoint(self.setpoint))

    @cached_property
    def blocks(self) -> Blocks:
        """The blocks of the law and the vehicle."""
        return blocks_of(self.vehicle, self.group, Law("law", (), self))

    def now(self, s: Tracking, errors: Errors | None = None, acts: bool = False) -> Now:
        """Return the values of all ports of the vehicle, as `Now` has them."""
        return Now(self.blocks, s, None, acts, errors)

    def torque(self, s: Tracking) -> Array:
        """Return the torque τ of the actuators, body frame, ``(..., m)``."""
        torque: Array = self.now(s)["forces.torque"]
        return torque

    def acting_and_rates(self, s: Tracking) -> tuple[Array, Arrays]:
        """Return the force that moves the law's model as the true plant, and actuator rates.

        The force, ``(..., m)`` in the body frame, is τ if nothing else acts and the law knows the
        inertia. The rates are those of the states of actuators and sensors.
        """
        now = self.now(s)
        return now["forces.acting"], now.rates()

    def dissipation(self, s: Tracking) -> Array | None:
        """Return the power −dL/dt that the law alone takes out of L; None if it is not known."""
        dissipation = None if self.incomplete else self.controller.dissipation(s)
        if dissipation is not None and s.inertia.leaves:
            y = self.controller.velocity_error(s)
            # Mass takes the energy of its error along; L holds 𝕀 in ½⟨𝕀y, y⟩.
            dissipation = dissipation - dot(s.inertia.leaving(y), y) / 2
        if dissipation is None or not self._holds_memory:
            return dissipation
        gradient = laws.memory_gradient(self.controller, s)
        if gradient is None:
            return None
        rates = self.controller.memory_rate(s)
        # The law assumes that its memory moves continuously; here it changes at instants only.
        return dissipation + sum(dot(gradient[name], rates[name]) for name in gradient)

    @property
    def _holds_memory(self) -> bool:
        """Whether the law has a memory that changes at control instants only."""
        return self.vehicle.control is not None and bool(self.controller.memory(self.group))

    def outflow(self, s: Tracking, acting: Array) -> Array | None:
        """Return the power −dL/dt under an acting force, ``(...)``; None if it is not known.

        It is dissipation − ⟨δ, y⟩ with δ = `acting` − τ(s), the force unknown to the law, and the
        law's own velocity error y.
        """
        dissipation = self.dissipation(s)
        if dissipation is None or self.vehicle.is_ideal:
            return dissipation
        law = self.controller.formula
        assert law is not None  # without a formula, the dissipation is None
        return dissipation - dot(acting - law.torque(s), self.controller.velocity_error(s))

    @property
    def departures(self) -> str:
        """The departures from the assumptions of the theorems, in words; empty if none."""
        mass = "mass that leaves" if self.inertia.at(0.0).leaves else ""
        departs = [self.controller.departs, self.incomplete, mass, self.vehicle.departures]
        return ", ".join(filter(None, departs))

    @property
    def incomplete(self) -> str:
        """How the law's setpoint departs from a smooth motion, in words; empty if it does not."""
        if self.reference.jumps:
            return "reference that jumps"
        return "" if self.setpoint == "full" else f"setpoint: {self.setpoint}"

    @property
    def claims_decrease(self) -> bool | None:
        """Whether L is claimed to fall along every trajectory; None if nothing is claimed."""
        covered = self.vehicle.is_ideal and not self.inertia.at(0.0).leaves
        covered = covered and not self.incomplete
        return laws.claims(self.controller, self.group, self.gains) if covered else None

    def lyapunov(self, s: Tracking) -> Array:
        """Return the Lyapunov function L of the law, ``(...)``; laws may have different ones."""
        return self.law.lyapunov(self.seen(s))

    def work(self, state: Array) -> Array:
        """Return the work W taken out of L up to a flat state."""
        return state[..., self.layout.slices["work"].start]

    # Instants, known in advance, at which the vector field changes.

    def instants(self, until: float) -> Array:
        """Return the sorted times at which the vector field changes, and its short pulses, s."""
        parts: list[Any] = [self.inertia, *self.over_time.values(), *self.known_forces]
        parts += [*self.vehicle.forces, *self.vehicle.actuators]
        parts += [self.vehicle.inertia] if self.vehicle.inertia else []
        parts += presences(parts)
        return distinct(np.concatenate([part.instants(self.group, until) for part in parts]))

    @property
    def over_time(self) -> dict[str, TimeVarying]:
        """The parts that may hold numbers, by the field of their held version."""
        parts: dict[str, TimeVarying] = {"held_reference": self.reference}
        parts["held_law"] = self.controller
        return parts if self._ahead is None else parts | {"held_ahead": self._ahead}

    @property
    def _ahead(self) -> ReferenceAhead | None:
        """The reference as the law knows it in advance; None without a preview."""
        law = self.controller
        if not isinstance(law, Previews) or not law.preview:
            return None
        reference: Any = self.reference  # a ClosedReference, as the configuration was checked for
        return ReferenceAhead(reference, tuple(law.preview), law.previewed)

    @cached_property
    def holds(self) -> bool:
        """Whether the vector field holds numbers from one instant to the next."""
        return any(part.held(self.group, 0.0) is not None for part in self.over_time.values())

    def holding(self, t: Any) -> Self:
        """Return the loop from time t to the next instant, with the held numbers as leaves."""
        if not self.holds:
            return self
        held = {name: part.held(self.group, t) for name, part in self.over_time.items()}
        return dataclasses.replace(self, **held)

    @property
    def held_leaves(self) -> dict[str, Array]:
        """The leaves that are held, by path."""
        return leaves(self, self.over_time)

    # Flat states.

    @cached_property
    def layout(self) -> StateLayout:
        """The layout of a flat state."""
        q, m = self.group.pose_length, self.group.dimension
        desired, memory = self.reference.starts_from, self.controller.memory(self.group)
        return StateLayout(
            {
                "pose": q,
                "momentum": m,
                **{_STRETCH[part]: q if part == "pose" else m for part in desired},
                "work": 1,
                **{MEMORY + name: length for name, length in memory.items()},
                **{VEHICLE + name: n for name, n in self.vehicle.states(self.group).items()},
            }
        )

    @property
    def state_length(self) -> int:
        """The number of entries of a flat state."""
        return self.layout.length

    @cached_property
    def moving_length(self) -> int:
        """The number of leading entries that an engine integrates and the vector field reads.

        The rest are the states of an estimator.
        """
        return self.state_length - sum(self.vehicle.estimator_lengths(self.group).values())

    def initial_state(self, Q: Array, V: Array, Qd: Array, Vd: Array, t: Any = 0.0) -> Array:
        """Return the flat state at time t with W = 0, from poses and velocities.

        Poses are ``(..., d, d)``, velocities ``(..., m)``.
        """
        inertia = self.inertia.at(t)
        batch = np.broadcast_shapes(Q.shape[:-2], V.shape[:-1], Qd.shape[:-2], Vd.shape[:-1])
        stretches = dict.fromkeys(self.layout.lengths, 0.0) | {
            "pose": self.group.pack(Q),
            "momentum": inertia.momentum(V),
            "desired_pose": self.group.pack(Qd),
            "desired_momentum": inertia.momentum(Vd),
            **_named(VEHICLE, self.vehicle.started(self.group, V)),
        }
        dtype = np.result_type(Q, V, Qd, Vd)
        state = self.layout.join(stretches, np.empty((*batch, self.state_length), dtype=dtype))
        if any(name.startswith(MEMORY) for name in stretches):
            s = self.seen(self.tracking(t, state))
            stretches |= _named(MEMORY, self.controller.initial_memory(s))
            state = self.layout.join(stretches, state)
        if any_runs(self.vehicle.actuators):
            s = self.tracking(t, state)
            command = s.command(self.controller.torque(self.seen(s)))
            stretches |= _named(VEHICLE, at_start(Now(self.blocks, s, {COMMAND: command})))
            state = self.layout.join(stretches, state)
        if any(moving_sensors(self.vehicle, "accelerometer")):
            s = self.tracking(t, state)
            settled = felt(self.vehicle, s, self.acting_and_rates(s)[0], is_start=True)[1]
            state = self.layout.join(stretches | _named(VEHICLE, settled), state)
        return state

    def tracking(self, t: Any, state: Array) -> Tracking:
        """Return everything a law may read, at t and a flat state ``(..., state_length)``."""
        parts, batch = self.layout.split(state), state.shape[:-1]
        desired, inertia = self._desired(t, state)
        flat = None
        if self.controller.reads_flat_output:
            flat = (self.held_reference or self.reference).flat_output(self.group, t)
            assert flat is not None  # as the configuration was checked for
            heading = None if flat.heading is None else _spread(flat.heading, batch, 1)
            flat = FlatOutput(_spread(flat.position, batch, 2), heading)
        Q = self.group.unpack(parts["pose"])
        s = Tracking(
            G=self.group,
            inertia=inertia,
            gains=self.gains,
            t=t,
            Q=Q,
            P=parts["momentum"],
            Qd=desired.Q,
            Pd=desired.P,
            tau_d=desired.tau,
            memory=_of(MEMORY, parts),
            vehicle=_of(VEHICLE, parts),
            flat=flat,
            known_force=known_force(self, t, Q),
        )
        if self.vehicle.magnet:
            s = dataclasses.replace(s, flux=self.vehicle.magnet.in_body(s))
        if ahead := self.held_ahead or self._ahead:
            parts_ahead = partial(ahead.parts, self.group, self.inertia, t, batch)
            s = dataclasses.replace(s, ahead=parts_ahead)
        if desired.V is None or desired.V_dot is None:  # they follow from P_d and τ_d
            return s
        return s.following(_spread(desired.V, batch, 1), _spread(desired.V_dot, batch, 1))

    def _desired(self, t: Any, state: Array) -> tuple[Desired, Inertia]:
        """Return the desired state at t and a flat state, and the law's model of the inertia."""
        parts, inertia = self.layout.split(state), self.inertia.at(t)
        Qd, Pd = map(parts.get, DESIRED)
        if Qd is not None:
            Qd = self.group.unpack(Qd)
        desired = (self.held_reference or self.reference).desired(self.group, inertia, t, Qd, Pd)
        batch = state.shape[:-1]
        Q, P = _spread(desired.Q, batch, 2), _spread(desired.P, batch, 1)
        return desired._replace(Q=Q, P=P), inertia

    # The differential equation.

    def vector_field(self, t: Any, state: Array) -> Array:
        """Return the time derivative of a flat state, ``(..., state_length)``."""
        s = self.tracking(t, state)
        acting, moving = self.acting_and_rates(s)
        Q_dot, P_dot = lie_poisson(self.group, s.Q, s.P, s.V, acting)
        outflow = self.outflow(s, acting)
        seen, holds = self.seen(s), self._holds_memory
        memory = dict.fromkeys(s.memory, 0.0) if holds else self.law.memory_rate(seen)
        rates = {
            "pose": self.group.pack(Q_dot),
            "momentum": P_dot + s.inertia.leaving(s.V),
            **self._desired_rates(s),
            "work": 0.0 if outflow is None else stack([outflow]),
            **_named(MEMORY, memory),
            **_named(VEHICLE, moving),
        }
        return self.layout.join(rates, state)

    def _desired_rates(self, s: Tracking) -> Arrays:
        Qd_dot, Pd_dot = lie_poisson(self.group, s.Qd, s.Pd, s.Vd, s.tau_d)
        Pd_dot = Pd_dot + s.inertia.leaving(s.Vd)
        return dict(zip(DESIRED, (self.group.pack(Qd_dot), Pd_dot), strict=True))

    # The instants at which a sampled law is evaluated.

    def measured(self, t: Any, state: Array, errors: Errors | None = None) -> Array:
        """Return a flat state after the measurements at time t, which sensors may hold."""
        if errors is None or not self.changes_by_measuring:
            return state
        now = self.now(self.tracking(t, state), errors, acts=True)
        states = {**now.after("arrived"), **now.after(self.blocks.read)}
        return self.layout.join(self.layout.split(state) | _named(VEHICLE, states), state)

    @property
    def changes_by_measuring(self) -> bool:
        """Whether a measurement changes a flat state: with sensors that hold, or an estimator."""
        return bool(self.vehicle.holding(self.group)) or self.vehicle.estimator is not None

    def law_input(self, t: Any, state: Array, errors: Errors | None = None) -> LawInput:
        """Return the input of the law at time t and a flat state, which is `measured`.

        Parameters
        ----------
        errors
            E and b of the measurement Q E, V + b: ``(..., d, d)`` and ``(..., m)``.
        """
        now = self.now(self.tracking(t, state), errors)
        pose, velocity, flux = (now[f"{self.blocks.read}.{name}"] for name in SIGNALS[:3])
        inputs = LawInput.of(now.s)._replace(pose=pose, velocity=velocity, flux=flux)
        if self.group.translation is None or not reads_specific_force(self.controller):
            return inputs
        force = now["arrived.accelerometer"][..., self.group.translation.axes]
        return inputs._replace(specific_force=force)

    def answer(self, inputs: LawInput, memory: Arrays, period: Any) -> tuple[Array, Arrays]:
        """Return the commanded torque, and the memory z of the law, advanced by ż for a period."""
        force = known_force(self, inputs.t, inputs.pose)
        s = inputs.tracking(self.group, self.inertia, self.gains, memory, force)
        torque, later = self.law.answer(self.seen(s), period)
        return s.command(torque) + 0.0 * inputs.velocity[..., :1], dict(later)

    def after_answer(
        self, t: Any, state: Array, torque: Array, memory: Arrays, solved: Array | None = None
    ) -> Array:
        """Return a flat state after a tick; a law that acts has commanded a torque.

        Parameters
        ----------
        solved
            `solution` of the vehicle, if it is known already.
        """
        s, parts = self.tracking(t, state), self.layout.split(state)
        ports = {COMMAND: torque} if solved is None else {COMMAND: torque, SOLVED: solved}
        now = Now(self.blocks, s, ports, acts=True)
        memory = {name: now.if_due(CONTROL, z, s.memory[name]) for name, z in memory.items()}
        changed = _named(MEMORY, memory) | _named(VEHICLE, now.stepped())
        if memory:  # L jumps with the memory, and W by the opposite amount
            jump = self.lyapunov(dataclasses.replace(s, memory=memory)) - self.lyapunov(s)
            changed["work"] = parts["work"] - jump[..., None]
        return self.layout.join(parts | changed, state)

    def solution(self, state: Array, torque: Array) -> Array:
        """Return the vehicle's solution, such as thrusts, for a commanded torque."""
        zeros = np.zeros((len(torque), self.vehicle.solves))
        ports = {COMMAND: torque, SOLVED: zeros}
        return solution(Now(self.blocks, self.tracking(0.0, state), ports, acts=True))

    def after_instant(self, t: Any, state: Array, errors: Errors | None = None) -> Array:
        """Return a flat state after a tick; t and state are those before it.

        The law is evaluated at its input, `law_input`, with these measurement errors.
        """
        state = self.measured(t, state, errors)
        answer = self.answer_if_due(self.law_input(t, state, errors), state)
        return self.after_answer(t, state, *answer)

    def answer_if_due(
        self, inputs: LawInput, state: Array, rows: Array | None = None
    ) -> tuple[Array, Arrays]:
        """Return the `answer` at a tick; a law that does not act is not called.

        `rows` is the law's `code_rows` where an engine has computed it.
        """
        held = _of(VEHICLE, self.layout.split(state))
        acts, memory = self.blocks.due(held, CONTROL), self.memory(state)
        if acts is not None and not acts.any():  # all runs have the same clocks
            return 0.0 * held[COMMANDS][..., -command_length(self.vehicle, self.group) :], memory
        law, answer = self.law, None
        if rows is not None and isinstance(law, RunsCode):
            answer = law.answer_rows(self.group, rows, memory)
        return answer or self.answer(inputs, memory, self.period)

    @property
    def lost_at(self) -> int | None:
        """The place in a flat state that is not 0 where the estimate's covariance is indefinite."""
        where = self.layout.slices.get(f"{VEHICLE}{LOST}")
        return None if where is None else where.start

    def memory(self, state: Array) -> dict[str, Array]:
        """Return the memory of the law in a flat state, by name."""
        return _of(MEMORY, self.layout.split(state))


@dataclass(frozen=True)
class Law(Block):
    """The law of a loop."""

    loop: ClosedLoop

    def command(self, now: Now) -> Array:
        """Return what it asks for."""
        return self.loop.command(now.s)


def known_force(loop: ClosedLoop, t: Any, Q: Array) -> Array | None:
    """Return Σ f, the known forces on a body at rest at Q, ``(..., m)``; None without any."""
    still, total = np.zeros(loop.group.dimension), None
    for force in loop.known_forces:
        f = force.in_body(loop.group, t, Q, still)
        total = f if total is None else total + f
    return total


def _spread(values: Array, batch: tuple[int, ...], axes: int) -> Array:
    """Broadcast values that are shared by all runs, or samples."""
    whole = (*batch, *values.shape[values.ndim - axes :])
    return values if values.shape == whole else np.broadcast_to(values, whole)


def _named(prefix: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values by the names of their stretches, which begin with a prefix."""
    return {prefix + name: value for name, value in values.items()}


def _of(prefix: str, stretches: Arrays) -> dict[str, Array]:
    """Return the stretches whose names begin with a prefix, without it; undoes `_named`."""
    return {
        name.removeprefix(prefix): values
        for name, values in stretches.items()
        if name.startswith(prefix)
    }


# The reference by itself: the differential equation of X_d, without a law or a plant --------------
#
# Any engine integrates it like a closed loop; the desired motion that is stored is its solution.


class ReferenceSystem(ClosedLoop):
    """The Lie-Poisson system of X_d = (Q_d, P_d) under τ_d.

    A flat state holds the integrated parts of X_d, and nothing else.
    """

    @classmethod
    def of(cls, loop: ClosedLoop) -> Self:
        """Return the reference system of a closed loop."""
        return super().of(dataclasses.replace(loop, vehicle=Vehicle()))

    @property
    def over_time(self) -> dict[str, TimeVarying]:
        """The reference alone: no law acts."""
        return {"held_reference": self.reference}

    @cached_property
    def layout(self) -> StateLayout:
        """The layout of Q_d and P_d in a flat state."""
        lengths = super().layout.lengths
        return StateLayout({name: lengths[name] for name in DESIRED if name in lengths})

    def tracking(self, t: Any, state: Array) -> Tracking:
        """Return the tracking state with the true state equal to the desired one."""
        desired, inertia = self._desired(t, state)
        Q, P, tau = desired.Q, desired.P, desired.tau
        return Tracking(self.group, inertia, self.gains, t, Q, P, Q, P, tau)

    def vector_field(self, t: Any, state: Array) -> Array:
        """Return the rates Q̇_d = Q_d V_d^, Ṗ_d = ad*_{V_d} P_d + τ_d."""
        return self.layout.join(self._desired_rates(self.tracking(t, state)), state)


# The parts of a closed loop: their places in a configuration and their names in messages ----------


class LoopPart(NamedTuple):
    """A part of a closed loop.

    Attributes
    ----------
    path
        Its place in the configuration.
    name
        Its name in messages, ``controller 'eqt'``; its place if it has no name.
    """

    part: Any
    path: KeyPath
    name: str

    @property
    def is_foreign(self) -> bool:
        """Whether the part is the user's own code."""
        return is_foreign(type(self.part).__module__)


def parts_of(loop: ClosedLoop, index: int = 0) -> list[LoopPart]:
    """Return the parts of a loop; the first is its law, number `index` of the controllers."""
    law, reference, group = loop.controller, loop.reference, loop.group
    parts = [
        LoopPart(law, ("controllers", index), f"controller '{law.name}'"),
        LoopPart(reference, ("reference",), f"reference '{reference.name}'"),
        LoopPart(group, ("group",), f"group '{group.name}'"),
    ]
    for place, part in loop.vehicle.parts.items():
        name, path = f"'{place}'", parse_key(place)
        path = ("controllers", index, *path) if path[0] == INNER else path
        for kind in (Force, Actuator, Sensor, Estimator):
            if isinstance(part, kind):
                name = f"{kind.__name__.lower()} '{part.name}'"
        parts.append(LoopPart(part, path, name))
    return parts
