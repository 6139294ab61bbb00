"""Thrusters that together give the torque: their allocation, their limits, their lag."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field

from eqt_cli.base.arrays import (
    Array,
    Arrays,
    absolute,
    apply_matrix,
    clip,
    maximum,
    outside,
    smooth_less,
    sqrt,
    stack,
    where,
)
from eqt_cli.base.errors import InputError, Problems, Remedy
from eqt_cli.base.expressions import formula
from eqt_cli.base.option_types import Real, Scale, Unit
from eqt_cli.base.stored import THRUSTER, Signal, signal
from eqt_cli.components.actuators import (
    THRUSTS,
    Actuator,
    Needed,
    Running,
    Solving,
    check_members,
    of_each,
)
from eqt_cli.components.allocation import SMALLEST, allocation, lost_directions, unreachable
from eqt_cli.components.forces import sines, wave
from eqt_cli.components.groups import MatrixLieGroup, command_axes
from eqt_cli.components.matrix_groups import EuclideanGroup, rigid_motions
from eqt_cli.components.vehicle_parts import (
    Number,
    Numbers,
    check_limits,
    check_numbers,
    check_period,
    drawn,
    is_drawn,
    lowest,
    presence,
)
from eqt_cli.extensions.thrusters.parts import Failure, Jets, Noise, Priority, Thruster, Waves
from eqt_cli.extensions.thrusters.priority import (
    NEAR,
    axes_of,
    by_priority,
    faces_of,
    nearest_thrusts,
    words_of,
)
from eqt_cli.numbers.instants import instants_of
from eqt_cli.numbers.leaves import STRUCTURE, with_fields
from eqt_cli.numbers.rounded import is_exact, product

SPEEDS = ("low_speed", "high_speed")
"""Limits of rotors."""

CHANGING = ("fails", "sag", "efficiency", "efficiency_from", "noise")
"""Options that change thrusters over time."""

LAGS = "time_constant", "time_constant_down"
"""Time constants of the lag."""

POSITIVE = (*LAGS, "weights", "thrust_constant", "moment_constant", "rotor_inertia", "isp")
"""Options that are numbers above 0."""

THRUST = signal("thrust", "N", "f", dims=(THRUSTER,), words="thrust of each thruster")

SAMPLES = 4_001
"""Times over the horizon at which a sag is examined."""

MOST = 12
"""Most thrusters of an allocation by priority: the reachable set has many faces."""


@dataclass(frozen=True)
class Thrusters(Solving, Running):
    """The torque B f of k thrusts f, which follow from the command: limited and lagging one by one.

    Torque and command are in the body frame and in the order of the coordinates of the group, on
    SE2 and SE3 the torque before the force. Without limits and lag, and with B of rank m, the
    torque is the command. With a `thrust_constant`, the thrusters are rotors: the thrust is that
    constant times the square of a speed, which has the limits and the lag.

    Attributes
    ----------
    matrix
        B, m × k: torque or force along each axis per newton of each thruster.
    thrusters
        Instead of `matrix`, on SE2 and SE3: place and direction of each thruster in the body frame,
        `{at: [x, y, z], along: [x, y, z], turns: 0, name: left}`.
    low, high
        Smallest and largest thrust, N. Default: no limit.
    time_constant
        T of a first-order lag, s. Default: no lag.
    time_constant_down
        T while a thrust, or the speed of a rotor, falls; `time_constant` is then that while it
        rises. Margins, gains and filters use the longer of the two. Default: `time_constant`.
    thrust_constant
        k_η of rotors, thrust over speed squared, N s²/rad².
    moment_constant
        k_m of rotors, torque over speed squared, N m s²/rad².
    low_speed, high_speed
        Instead of `low` and `high`: smallest and largest rotor speed, rad/s.
    rotor_inertia
        J_r of lagging rotors about `along`, kg m²; SE3 only. Their momentum h = Σ ∓J_r η a,
        opposite to the torque of `turns`, exerts the torque h × ω − ḣ on the body.
    start
        Speeds of lagging rotors at the start of a run, rad/s, 0 at rest; of other thrusters that
        lag, the thrusts, N. Default: of rotors what the first command asks for, else 0.
    noise
        `{std: 20, time_constant: 20 ms}`: what motors add to the speed of each rotor, rad/s, or to
        the thrust of each other thruster, N; behind the lag.
    fails
        `{rotor: 2, at: 3 s, to: 0}`: from then on, a thruster gives this share of its commanded
        thrust, after its lag if it has one.
    sag
        The share of the commanded thrust that all thrusters give as the battery empties, an
        expression in t.
    efficiency
        The share of its commanded thrust that each thruster gives, within its limits; above 1, too.
    efficiency_from
        When that begins, s. Default: from the start on.
    told
        Whether the allocation knows `fails`, `sag` and `efficiency`, and uses B⁺ of what remains;
        and whether it knows the numbers that are drawn for a run, such as places and directions of
        thrusters, in place of their means.
    jets
        `{minimum: 20 ms, every: 0.1 s}`: on-off thrusters, driven by pulses.
    isp
        Specific impulse, s. Results then contain the propellant burnt, ∫Σ|f|/(g₀ isp) dt with g₀ =
        9.80665 m/s².
    weights
        The allocation minimises the sum of weight · thrust².
    allocation
        Of a law that commands torques and a push along one axis, B has these rows alone.
        `pseudo_inverse`: thrusts B⁺ · command, each cut off at its limits, which changes the torque
        in every direction. `bounded`: thrusts within the limits whose torque is nearest to the
        command in least squares, N m and N weighted equally: a light body loses torque. `{kind:
        priority, order: [[torque x, torque y], force, torque z]}`: meets each group of directions
        as far as the groups before it allow, and scales a group of several by a factor up to 1.
        The last two act at control instants.
    least
        Smallest singular value of B, with each row divided by its norm, relative to the largest.
        Weaker directions are not commanded, because small torques there need large thrusts.
    """

    name: ClassVar[str] = "thrusters"
    departs: ClassVar[str] = "thrusters"
    positive: ClassVar[tuple[str, ...]] = POSITIVE
    one_way: ClassVar[bool] = True

    matrix: list[list[Real]] | None = None
    thrusters: list[Thruster] | None = None
    low: Annotated[Numbers | None, Unit("N")] = None
    high: Annotated[Numbers | None, Unit("N")] = None
    time_constant: Annotated[Numbers | None, Scale("time constant of the thrusters", "s")] = None
    time_constant_down: Annotated[
        Numbers | None, Scale("time constant of falling thrusts", "s")
    ] = None
    thrust_constant: Annotated[
        Numbers | None, Scale("thrust constant of the rotors", "N s^2/rad^2")
    ] = None
    moment_constant: Annotated[
        Numbers | None, Scale("moment constant of the rotors", "N m s^2/rad^2")
    ] = None
    low_speed: Annotated[Numbers | None, Unit("rad/s")] = None
    high_speed: Annotated[Numbers | None, Unit("rad/s")] = None
    rotor_inertia: Annotated[Numbers | None, Scale("inertia of the rotors", "kg m^2")] = None
    start: Annotated[Numbers | None, Unit("rad/s")] = None
    noise: Noise | None = None
    fails: Failure | None = field(default=None, metadata=STRUCTURE)
    sag: str | float | None = field(default=None, metadata=STRUCTURE)
    efficiency: Annotated[Numbers | None, Scale("thrust left to each rotor", "1")] = None
    efficiency_from: Annotated[Number | None, Scale("start of the efficiency", "s")] = field(
        default=None, metadata=STRUCTURE
    )
    told: bool = False
    jets: Jets | None = None
    isp: Annotated[Numbers | None, Scale("specific impulse of the thrusters", "s")] = None
    weights: Numbers | None = None
    allocation: Literal["pseudo_inverse", "bounded"] | Priority = "pseudo_inverse"
    least: Annotated[float, Field(ge=0, lt=1)] = 0.05
    inverse: Any = field(default=None, init=False, repr=False)
    spin: Any = field(default=None, init=False, repr=False)
    over_time: Any = field(default=(), init=False, repr=False, metadata=STRUCTURE)
    lost: Any = field(default=None, init=False, repr=False)
    turned: Any = field(default=None, init=False, repr=False)
    presence: Any = field(default=None, init=False, repr=False)
    """When a failure, or the efficiency, begins."""
    waves: Any = field(default=None, init=False, repr=False)
    added: Any = field(default=None, init=False, repr=False)
    """The noise of each thruster at a time."""
    share: Any = field(default=None, init=False, repr=False)
    groups: Any = field(default=(), init=False, repr=False, metadata=STRUCTURE)
    faces: Any = field(default=(), init=False, repr=False)
    scale: Any = field(default=None, init=False, repr=False)
    passed: Any = field(default=None, init=False, repr=False)
    wanted: Any = field(default=None, init=False, repr=False, metadata=STRUCTURE)
    """The directions in which a law commands a torque, as rows; None for all."""
    direct: bool = field(default=False, init=False, repr=False, metadata=STRUCTURE)
    """Whether the law commands thrusts."""
    believed: Any = field(default=None, init=False, repr=False)
    """The thrusters as the allocation knows them; None where it knows all of their numbers."""

    @property
    def takes(self) -> str:  # type: ignore[override]  # a constant of other actuators
        """What the command is: a torque, or thrusts behind one."""
        return THRUSTS if self.direct else "torque"

    def for_law(self, G: MatrixLieGroup, directions: Array, direct: bool) -> Self:
        """Return the thrusters of a law that commands torques in some directions, or thrusts.

        These are the same for a law in whose directions alone they push.
        """
        B = self.columns(G)
        beside = B - directions.T @ (directions @ B)
        is_all = not len(directions) or np.abs(beside).max() <= SMALLEST * np.abs(B).max()
        if isinstance(self.allocation, Priority) and len(directions):  # whose directions have names
            is_all = is_all and ((directions != 0.0).sum(axis=1) == 1).all()
        if is_all and not direct:
            return self
        rows = None if is_all else tuple(map(tuple, directions.tolist()))
        return with_fields(self, direct=direct, wanted=rows)

    @property
    def model(self) -> Any:
        """The thrusters as the allocation knows them."""
        return self if self.believed is None else self.believed

    @property
    def limits(self) -> bool:
        """Whether thrusts have limits."""
        return self.low is not None or self.low_speed is not None

    @property
    def moves(self) -> bool:
        """Whether thrusts lag."""
        return self.time_constant is not None

    @property
    def runs(self) -> bool:
        """Whether thrusters lag, and are rotors or have a start."""
        return self.moves and (self.thrust_constant is not None or self.start is not None)

    @property
    def sampled(self) -> bool:
        """Whether thrusts are found at control instants."""
        return self.allocation != "pseudo_inverse"

    @property
    def solves(self) -> int:
        """The number of thrusts that code outside the engines finds."""
        return self.count * (self.allocation == "bounded" and not self.direct)

    @property
    def varies(self) -> bool:
        """Whether numbers differ from run to run: the phases of noise always do."""
        return self.noise is not None or super().varies

    @property
    def by_processor(self) -> bool:
        """Whether LAPACK takes part in the allocation, or NumPy draws sines."""
        chosen = self.model.passed is not None or self.allocation != "pseudo_inverse"
        chosen = chosen or self.waves is not None
        return chosen or not is_exact(np.asarray(self.matrix))

    @property
    def acting_at_instants(self) -> str:
        """The option, by which messages name the allocation."""
        return f"allocation: {'bounded' if self.solves else 'priority'}"

    @property
    def linear_part(self) -> Actuator:
        """The thrusters without limits: B of full rank then gives the command, up to the lag."""
        up: Any = self.time_constant
        down = self.time_constant_down
        lag = {} if down is None else {"time_constant": np.maximum(up, down), LAGS[1]: None}
        if not self.limits:
            return with_fields(self, **lag) if lag else self
        none = dict.fromkeys(("low", "high", *SPEEDS, "scale", "jets", "believed"))
        free = {"allocation": "pseudo_inverse", "groups": (), "faces": ()}
        return with_fields(self, **none, **free, **lag)

    @cached_property
    def count(self) -> int:
        """Number k of thrusters."""
        return len(self.thrusters or (self.matrix or [[]])[0])

    @property
    def thruster_names(self) -> tuple[str, ...]:
        """Names of the thrusters: as given, or numbered from 1."""
        names = [thruster.name for thruster in self.thrusters or ()] or [""] * self.count
        return tuple(name or f"thruster {index}" for index, name in enumerate(names, 1))

    @property
    def members(self) -> Mapping[str, tuple[str, ...]]:
        """The names of the thrusters."""
        return {THRUSTER: self.thruster_names}

    @property
    def shows(self) -> tuple[Signal, ...]:
        """The thrusts."""
        return (THRUST,)

    @property
    def ranges(self) -> Mapping[str, tuple[Any, Any]]:
        """The least and largest thrusts, but not of jets."""
        if not self.limits or self.jets is not None:
            return {}
        return {"thrust": (self.received(self.low), self.received(self.high))}

    def signals(self, G: MatrixLieGroup, V: Array, command: Array, x: Array) -> Arrays:
        """Return the thrust of each thruster."""
        return {"thrust": self.thrust(G, command, x)}

    @property
    def allocation_matrix(self) -> tuple[Array, Array | None, Array | None] | None:
        """B⁺, ``(k, m)``, and the limits of the thrusts; None where they are solved for."""
        return None if self.sampled else (self.inverse, self.low, self.high)

    def columns(self, G: MatrixLieGroup) -> Array:
        """Return B, ``(m, k)``."""
        if self.matrix is not None:
            return np.array(self.matrix, dtype=float)
        assert isinstance(G, EuclideanGroup)
        ratios = np.ones(self.count)
        if self.moment_constant is not None:
            k_m, k = drawn(self.moment_constant, None), drawn(self.thrust_constant, None)
            ratios = ratios * np.array(k_m) / np.array(k)
        thrusters = drawn(self.thrusters or [], None)
        places = zip(thrusters, ratios.tolist(), strict=True)
        return np.stack([place.wrench(G, ratio) for place, ratio in places], axis=-1)

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return the thrusters of a run, with the allocation of those of the means.

        Limits are those of commanded thrusts: a rotor that gives less than is believed reaches its
        largest speed at a larger command.
        """
        drawn = self.drawn(random)
        acts = presence(drawn.begins, None, are_drawn=is_drawn(self.begins))
        part = with_fields(drawn.with_allocation(G), presence=acts)
        if drawn.noise is not None:
            size = np.full(self.count, 0.0 if random is None else drawn.noise.std)
            waves = Waves(**sines(size, drawn.noise.time_constant, random))
            part = with_fields(part, waves=waves)
        if is_drawn(self.thrusters):  # B has the drawn places; what else is read of them is common
            part = with_fields(part, thrusters=self.drawn(None).thrusters)
        if self.told or not super().varies:
            return part
        model = with_fields(self.drawn(None), weights=drawn.weights).with_allocation(G)
        ends = {name: x for name in ("low", "high") if (x := getattr(part, name)) is not None}
        if self.thrust_constant is not None:
            ends = {name: model.pushed(part.followed(end)) for name, end in ends.items()}
        unused = {"faces": (), **dict.fromkeys(("passed", "turned", "scale"))}
        return with_fields(part, **unused, **ends, inverse=model.inverse, believed=model)

    def with_allocation(self, G: MatrixLieGroup) -> Self:
        """Return thrusters with B, its weighted pseudo-inverse, and an entry for each thruster."""
        B = self.columns(G)
        names = "low", "high", *LAGS, "thrust_constant", "isp", "start", *SPEEDS
        values = of_each(self, names, self.count)
        for name, speed in zip(("low", "high"), SPEEDS, strict=True):
            if speed in values:
                values[name] = values["thrust_constant"] * values.pop(speed) ** 2
        scale = 1 / np.sqrt(np.ones(self.count) * np.array(self.weights or 1.0, dtype=float))
        rows, directions = self.asked_rows(G, B)
        inverse, limited = self._allocated(rows, scale)
        values |= {"matrix": B, "inverse": inverse, "passed": limited}
        values |= self._changing(rows, scale, inverse)
        if self.rotor_inertia is not None:
            axes = B[3:] / np.linalg.norm(B[3:], axis=0)
            sides = -np.sign([thruster.turns for thruster in self.thrusters or ()])
            spin = axes * sides * np.array(self.rotor_inertia)
            values["spin"] = np.concatenate([spin, 0.0 * axes])
        if self.solves:
            values["scale"] = scale
        problems = Problems()
        self.check_order(G, problems)
        if isinstance(self.allocation, Priority) and not problems:  # it may fit other directions
            groups = [
                tuple(axis for word in words_of(group) for axis in axes_of(word, directions, rows))
                for group in self.allocation.order
            ]
            rows = rows[[*chain(*groups)]]
            null: Array = unreachable(rows.T) / scale**2  # times the least thrusts: 0
            values |= {"groups": (*groups, *((),) * len(null)), "passed": None}
            values["faces"] = faces_of(np.concatenate([rows, null]), values["low"], values["high"])
        used = dict.fromkeys(("weights", "moment_constant", *SPEEDS, *CHANGING, "rotor_inertia"))
        named = [Thruster([], [], name=name) for name in self.thruster_names]
        return with_fields(self, thrusters=named, **used, **values)

    def asked_rows(self, G: MatrixLieGroup, B: Array) -> tuple[Array, tuple[str, ...]]:
        """Return the rows W B in the directions of the law, and their names.

        A row of W along an axis has the name of this axis, any other one is a `force`.
        """
        if self.wanted is None:
            return B, command_axes(G)
        axes = [np.flatnonzero(row) for row in np.array(self.wanted)]
        names = [command_axes(G)[axis[0]] if len(axis) == 1 else "force" for axis in axes]
        return product(np.array(self.wanted), B), tuple(names)

    def _allocated(self, rows: Array, scale: Array) -> tuple[Array, Array | None]:
        """Return the inverse from a torque, ``(k, m)``, and what passes of the rows."""
        inverse, passed = allocation(rows, self.least, scale)
        return inverse if self.wanted is None else product(inverse, np.array(self.wanted)), passed

    @property
    def changes(self) -> bool:  # type: ignore[override]  # a constant of other actuators
        """Whether a thruster fails or weakens at a time, the battery sags, or motors are noisy."""
        options = self.fails, self.sag, self.efficiency_from, self.noise, self.waves
        return bool(self.over_time) or any(x is not None for x in options)

    @property
    def nominal(self) -> Self:
        """The thrusters that give what is commanded: none fails or is noisy, no battery sags."""
        return with_fields(self, **dict.fromkeys((*CHANGING, "presence", "waves")), over_time=())

    @property
    def begins(self) -> Any:
        """When a failure, or the efficiency, begins, s; None if at no time."""
        return self.efficiency_from if self.fails is None else self.fails.at

    def _changing(self, rows: Array, scale: Array, inverse: Array) -> dict[str, Any]:
        """Return the share of all and the failure over time, and what it takes from each."""
        fails = self.fails or Failure(1, 0.0, 1.0)
        lost = np.zeros(self.count)
        lost[self._number(fails.rotor)] = fails.to - 1.0
        if self.efficiency is not None:
            lost += np.array(self.efficiency) - 1.0
        if self.sag is None and self.begins is None:
            if self.efficiency is None:
                return {}
            left = 1.0 + lost
            told = {"inverse": self._allocated(rows * left, scale)[0]} if self.told else {}
            return {"share": left, **told}
        after = self._allocated(rows * (1.0 + lost), scale)[0] if self.told else inverse
        of_sag = (formula(1.0 if self.sag is None else self.sag),)
        return {"over_time": of_sag, "lost": lost, "turned": after - inverse}

    def _number(self, rotor: int | str) -> int:
        """Return the index of a thruster; −1 if there is none."""
        names = [*self.thruster_names, *range(1, self.count + 1)]
        return names.index(rotor) % self.count if rotor in names else -1

    def instants(self, G: MatrixLieGroup, until: float) -> Array:
        """Return the times at which the expression of the sag changes its piece."""
        return instants_of(self.over_time, until)

    @property
    def expressions(self) -> Any:
        """The share of all thrusts over time."""
        return self.over_time

    def at(self, s: Any, stored: Any = None) -> Self:
        """Return the thrusters with the shares, and the allocation, at a time."""
        noisy = {} if self.waves is None else {"added": wave(self.waves, s.t)}
        if not self.over_time:
            return with_fields(self, **noisy) if noisy else self
        sag = stack([self.over_time[0].evaluate({"t": s.t})])
        failed = 1.0 + 0.0 * sag if self.presence is None else self.presence.at(s.t)
        share, inverse = sag * (1.0 + failed * self.lost), self.inverse
        if self.told:
            inverse = (inverse + failed[..., None] * self.turned) / sag[..., None]
        return with_fields(self, share=share, inverse=inverse, **noisy)

    def _left(self, thrusts: Array) -> Array:
        """Return the thrusts after failure and sag."""
        return thrusts if self.share is None else self.share * thrusts

    def states(self, G: MatrixLieGroup) -> int:
        """Return the number of states: thrusts that are solved for, `Jets`, thrusts that lag."""
        return (self.sampled + 3 * (self.jets is not None) + self.moves) * self.count

    def output(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return B f, without the torque by which rotors are made faster."""
        B: Any = self.matrix
        torque: Array = apply_matrix(B, self.thrust(G, command, x))
        if self.spin is None:
            return torque
        return torque - apply_matrix(self.spin, self.state_rate(G, command, x)[..., -self.count :])

    def reaction(self, G: MatrixLieGroup, V: Array, x: Array) -> tuple[Array, Array] | None:
        """Return h × ω with the momentum h of the rotors."""
        if self.spin is None:
            return None
        return G.ad_star(V, apply_matrix(self.spin, x[..., -self.count :])), 0.0 * x

    def within(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return B times the solved thrusts, or the command and what limits take from B⁺ of it."""
        B, thrusts = self.model.matrix, self._commanded(command, x)
        if self.sampled:
            return apply_matrix(B, thrusts)
        return self.requested(command) + apply_matrix(B, thrusts - self._unlimited(command))

    def requested(self, command: Array) -> Array:
        """Return the torque that is asked for; of a law that commands thrusts, what they give."""
        if not self.direct:
            return command
        thrusts = command[..., -self.count :]
        return command[..., : -self.count] + apply_matrix(self.model.matrix, thrusts)

    def _unlimited(self, command: Array) -> Array:
        """Return the thrusts that are asked for: those of the law, and B⁺ of the torque."""
        if not self.direct:
            return apply_matrix(self.inverse, command)
        allocated = apply_matrix(self.inverse, command[..., : -self.count])
        return command[..., -self.count :] + allocated

    def allowed(self, G: MatrixLieGroup, command: Array) -> Array | None:
        """Return what the limits leave of a command; None if code outside finds the thrusts."""
        x = self.solution(G, command) if self.groups else command
        return self.within(G, command, x) if self.limits and not self.solves else None

    def thrust(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return the thrusts: of the state of the lag, or the commanded thrusts."""
        if not self.moves:
            thrusts = self._left(self.received(self._opened(command, x)))
            if self.added is None or self.thrust_constant is None:
                return thrusts if self.added is None else thrusts + self.added
            x = self.followed(thrusts)
        x = x[..., -self.count :]
        x = x if self.added is None else x + self.added
        return x if self.thrust_constant is None else self.pushed(x)

    def pushed(self, speed: Any) -> Array:
        """Return the thrusts of rotors at some speeds."""
        thrusts: Array = self.thrust_constant * speed * speed
        return thrusts

    def running(self, G: MatrixLieGroup, command: Array) -> Array:
        """Return the states of rotors that have long had a command."""
        solved = self._limited(self.solution(G, command)) if self.sampled else None
        thrusts = self._commanded(command, command) if solved is None else solved
        lagging = self.model.followed(self._left(thrusts))
        lagging = lagging if self.start is None else self.start + 0.0 * lagging
        return lagging if solved is None else np.concatenate([solved, lagging], axis=-1)

    def followed(self, thrusts: Array) -> Array:
        """Return what the lag follows: the thrusts asked for, or their speeds."""
        if self.thrust_constant is None:
            return thrusts
        thrusts = maximum(thrusts, 0.0)
        # Native takes a step past the limit at 0 before it ends it there: no root of less than 0.
        return sqrt(sqrt(thrusts * thrusts) / self.thrust_constant)

    def received(self, thrusts: Any) -> Any:
        """Return the thrusts of rotors that are told the speeds of the believed ones."""
        if self.believed is None or self.thrust_constant is None:
            return thrusts
        return self.pushed(self.believed.followed(thrusts))

    def _limited(self, solution: Array) -> Array:
        """Return solved thrusts within the limits, which may be others than the believed ones."""
        return solution if self.believed is None else clip(solution, self.low, self.high)

    def _commanded(self, command: Array, x: Array) -> Array:
        """Return the commanded thrusts, within the limits."""
        if self.sampled:
            return x[..., : self.count]
        thrusts = self._unlimited(command)
        return clip(thrusts, self.low, self.high) if self.limits else thrusts

    def _opened(self, command: Array, x: Array) -> Array:
        """Return the commanded thrusts; of jets `high` or 0."""
        opened = x[..., self.count : 2 * self.count]
        return self._commanded(command, x) if self.jets is None else self.high * opened

    def state_rate(self, G: MatrixLieGroup, command: Array, x: Array) -> Array:
        """Return (commanded − x) / T, and 0 for what changes at the next instant."""
        thrusts, lagging = self._left(self._opened(command, x)), x[..., -self.count :]
        rates = []
        if self.moves:
            followed, T = self.model.followed(thrusts), self.time_constant
            if self.time_constant_down is not None:  # both forms are 0 where they meet
                T = where(smooth_less(followed, lagging), self.time_constant_down, T)
            rates = [(followed - lagging) / T]
        return np.concatenate([0.0 * x, *rates], axis=-1)[..., -self.states(G) :]

    def step(self, G: MatrixLieGroup, command: Array, x: Array, period: float) -> Array:
        """Return the states with the thrusts that were solved for; thrusts that lag stay."""
        if not self.sampled:
            return x
        thrusts = self._limited(command if self.solves else self.solution(G, command))
        k, lagging = self.count, x[..., self.states(G) - self.count * self.moves :]
        jets = x[..., :0]
        if self.jets is not None:
            jets = self.jets.after(thrusts / self.model.high, x[..., k : 4 * k], period)
        return np.concatenate([thrusts, jets, lagging], axis=-1)

    def solution(self, G: MatrixLieGroup, command: Array) -> Array:
        """Return thrusts within limits: by priority, or with the torque nearest to the command."""
        if self.direct:
            return clip(self._unlimited(command), self.low, self.high)
        if self.believed is not None:
            thrusts: Array = self.believed.solution(G, command)
            return thrusts
        B: Any = self.matrix
        free = apply_matrix(self.inverse, command)
        if self.wanted is not None:
            W = np.array(self.wanted)
            command, B = apply_matrix(W, command), W @ B
        if self.groups:
            inverse, *faces = self.faces
            met = by_priority(command, self.groups, faces)
            return clip(apply_matrix(inverse, met), self.low, self.high)
        command = command if self.passed is None else apply_matrix(self.passed, command)
        solve = np.vectorize(nearest_thrusts, [float], signature="(m),(m,k),(k),(k),(k),(k)->(k)")
        thrusts = solve(command, B, free, self.scale, self.low, self.high)
        return thrusts

    def at_limit(self, G: MatrixLieGroup, command: Array, x: Array) -> Array | None:
        """Return 1 where a commanded thrust is beyond its limit, or at it if it is solved for."""
        if not self.limits:
            return None
        if self.sampled:
            low, high, believed = self.low, self.high, self.believed
            if believed is not None:
                low, high = maximum(low, believed.low), -maximum(-high, -believed.high)  # type: ignore[operator]
            below, above = (NEAR * (1 + absolute(end)) for end in (low, high))
            low = low + (below if self.jets is None else -below)
            return outside(x[..., : self.count], low, high - above)
        return outside(self._unlimited(command), self.low, self.high)

    def needed(self, G: MatrixLieGroup, times: Array, torque: Array) -> Needed | None:
        """Return thrusts and their limits; None if bounded, where other thrusts may do."""
        if self.sampled:
            return None
        return apply_matrix(self.inverse, torque), self.low, self.high, ""

    def remarks(self, G: MatrixLieGroup, wanted: Array) -> Iterator[str]:
        """Yield remarks on the directions in which thrusts push not at all, hardly, or in part."""
        B, is_told = wanted @ self.columns(G), self.believed is None
        yield from lost_directions(G, wanted, B, self.least, self.name, is_told)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note an invalid matrix or invalid places, and numbers that do not fit them."""
        if (self.matrix is None) == (self.thrusters is None):
            got = "neither" if self.matrix is None else "both"
            problems.add(f"expected either matrix or thrusters, got {got}")
        elif self.matrix is not None:
            self._check_matrix(G, problems.at("matrix"))
        else:
            self._check_places(G, problems.at("thrusters"))
        if problems:
            return
        for name in ("time_constant_down", "start"):
            if getattr(self, name) is not None and not self.moves:
                problems.at(name).add("needs time_constant, the one of rising thrusts")
        self._check_rotors(problems)
        self._check_jets(self.jets, problems.at("jets"))
        self._check_changes(problems)
        ends = ("low", "high", *SPEEDS)
        free = (*ends, "efficiency", "start")
        names = (*free, *self.positive)
        check_members(self, self.count, "thruster", names, " ".join(free), problems)
        if not problems:
            fast = any(getattr(self, name) is not None for name in SPEEDS)
            low, high = names = SPEEDS if fast else ("low", "high")
            check_limits(getattr(self, low), getattr(self, high), problems, names)
        self._check_start(problems)
        if self.sampled and not self.limits and not problems:
            problems.add(f"{self.acting_at_instants} needs limits; give low and high")

    def check_order(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note directions that are unknown, twice there, left out, or that nothing pushes along.

        They are those in which the law commands a torque.
        """
        if not isinstance(self.allocation, Priority):
            return
        if self.count > MOST:
            problems.add(f"expected at most {MOST} thrusters, got {self.count}; use bounded")
        (B, names), named = self.asked_rows(G, self.columns(G)), list[int]()

        def pushes(axis: int) -> bool:
            return not len(unreachable(B[[*named, axis]], self.least))

        order = enumerate(map(words_of, self.allocation.order))
        for k, word in ((k, word) for k, group in order for word in group):
            here, axes = problems.at(k), axes_of(word, names, B)
            if not axes:
                here.add(f"expected a direction, {', '.join(names)}, got '{word}'")
            for axis in axes:
                if axis in named:
                    here.add(f"{names[axis]} is named twice; name each direction once")
                elif not pushes(axis):
                    here.add(f"nothing pushes along {names[axis]} alone; remove it")
                named.append(axis)
        if left := [name for axis, name in enumerate(names) if not problems and pushes(axis)]:
            problems.add(f"lacks {', '.join(left)}; name each direction in which thrusters push")

    def _check_changes(self, problems: Problems) -> None:
        """Note unknown spins, thrusters and shares, and a `told` that no allocation uses."""
        spins = self.runs and self.thrusters and all(thruster.turns for thruster in self.thrusters)
        if self.rotor_inertia is not None and not spins:
            problems.at("rotor_inertia").add(
                "needs thrusters with places and turns, thrust_constant and time_constant"
            )
        if self.fails is not None:
            here, to = problems.at("fails"), self.fails.to
            if self._number(self.fails.rotor) < 0:
                names = ", ".join(self.thruster_names)
                expected = f"expected a number from 1 to {self.count}, or one of {names}"
                here.at("rotor").add(f"{expected}, got {self.fails.rotor}")
            if not 0 <= to <= 1:
                here.at("to").add(f"expected the share that is left, from 0 to 1, got {to:g}")
        self._check_efficiency(problems)
        self.check_until(0.0, problems)
        if self.told and self.sampled and (self.changes or self.efficiency is not None):
            problems.at("told").add(
                "needs allocation: pseudo_inverse; no other adapts to a failure"
            )

    def _check_start(self, problems: Problems) -> None:
        """Note a start beyond the limits, and a noise that is none."""
        if self.noise is not None:
            here, std = problems.at("noise"), self.noise.std
            check_numbers(self.noise.time_constant, here.at("time_constant"), positive=True)
            if lowest(std) < 0:
                here.at("std").add(f"expected at least 0, got {lowest(std):g}")
        ends = SPEEDS if self.thrust_constant is not None else ("low", "high")
        low, high = (drawn(getattr(self, name), None) for name in ends)
        if self.start is not None and low is not None and not problems:
            starts = np.ravel(drawn(self.start, None))
            for start in starts[(starts < low) | (starts > high)][:1]:
                limits = f"{np.min(low):g} to {np.max(high):g}"
                problems.at("start").add(
                    f"expected a number within the limits, {limits}, got {start:g}"
                )

    def _check_efficiency(self, problems: Problems) -> None:
        """Note an efficiency below 0, beside a failure, or whose start has none."""
        if self.begins is not None and lowest(self.begins) < 0:
            here = problems.at(*("fails", "at") if self.fails else ("efficiency_from",))
            here.add(f"expected at least 0 s, got {lowest(self.begins):g} s")
        values, here = self.efficiency, problems.at("efficiency")
        if values is None:
            if self.efficiency_from is not None:
                problems.at("efficiency_from").add("needs efficiency, the share of each thruster")
            return
        if self.fails is not None:
            here.add("expected no fails beside it; write the share of that rotor in this list")
        for index, entry in enumerate(values if isinstance(values, list) else [values]):
            if (least := lowest(entry)) < 0:
                said = f"expected a share of the commanded thrust, at least 0, got {least:g}"
                (here.at(index) if isinstance(values, list) else here).add(said)

    def check_until(self, end: float, problems: Problems) -> None:
        """Note a sag that leaves no thrust, turns it round or adds to it before the end, s."""
        times = np.linspace(0.0, end, SAMPLES)
        with problems.catching("sag"):
            shares = formula(1.0 if self.sag is None else self.sag).evaluate({"t": times})
            shares = shares + 0.0 * times
            wrong = int(np.argmin((shares > 0) & (shares <= 1)))
            if not 0 < (share := shares[wrong]) <= 1:
                got = f"above 0 and up to 1, got {share:g} at {times[wrong]:g} s"
                remedy = Remedy("for example 1 - 0.02*t, or max(0.2, 1 - 0.02*t)")
                raise InputError(f"expected a share of the thrust, {got}", remedy)

    def _check_jets(self, jets: Jets | None, here: Problems) -> None:
        """Note jets that lack what they need, and times at which no valve switches."""
        if jets is None:
            return
        lacking = not (self.period and self.sampled) or np.any(self.low)
        if lacking or self.thrust_constant is not None:
            here.add("need period: 10 ms or so, low: 0, and allocation: bounded or by priority")
            return
        if jets.minimum < (step := self.period or 0.0):
            here.at("minimum").add(f"expected at least period, {step:g} s, got {jets.minimum:g} s")
        if jets.every is not None:
            check_period(jets.every, step, here.at("every"), "periods of the thrusters")
        if jets.every is not None and jets != Jets(jets.minimum, jets.every):
            here.add("expected every, or levels and the filter of a trigger, got both; remove one")
        elif not jets.off < jets.on < jets.gain:
            between = f"expected a number between off, {jets.off:g}, and gain, {jets.gain:g}"
            here.at("on").add(f"{between}, got {jets.on:g}")

    def _check_rotors(self, problems: Problems) -> None:
        """Note keys of rotors without a thrust constant, and rotors that could push backwards."""
        if self.thrust_constant is None:
            for name in ("moment_constant", *SPEEDS):
                if getattr(self, name) is not None:
                    problems.at(name).add("applies to rotors only; add thrust_constant")
            return
        if self.moment_constant is not None and self.matrix is not None:
            problems.at("moment_constant").add(
                "belongs to thrusters with places; a matrix has its torques in its rows"
            )
        if not self.limits and self.high is None and self.high_speed is None:
            problems.add("rotors need limits; give low_speed and high_speed, or low and high")
        for name in ("low", "low_speed", "high", "high_speed"):
            value = getattr(self, name)
            if value is not None and name.endswith("_speed") and self.low is not None:
                problems.at(name).add("give limits of the speed or of the thrust, not of both")
            for entry in value if isinstance(value, list) else [value]:
                low = self.one_way and name.startswith("low")
                if low and entry is not None and lowest(entry) < 0:
                    problems.at(name).add(
                        f"a rotor pushes one way; expected at least 0, got {lowest(entry):g}"
                    )

    def _check_matrix(self, G: MatrixLieGroup, problems: Problems) -> None:
        rows, order = self.matrix or [], ", ".join(G.axis_names)
        if len(rows) != G.dimension:
            problems.add(
                f"expected {G.dimension} rows for {G.name}, in the order {order}, got {len(rows)}"
            )
        for index, row in enumerate(rows):
            if not row:
                problems.at(index).add("expected a number or more, got none")
            elif len(row) != len(rows[0] or row):
                problems.at(index).add(
                    f"expected {len(rows[0])} numbers, as in row 1, got {len(row)}"
                )

    def _check_places(self, G: MatrixLieGroup, problems: Problems) -> None:
        if not rigid_motions(G):
            problems.add(f"places of thrusters need group SE2 or SE3, got {G.name}; give matrix")
            return
        if not self.thrusters:
            problems.add("expected one thruster or more, got none")
        for index, thruster in enumerate(self.thrusters or ()):
            here = problems.at(index)
            for option, value in (("at", thruster.at), ("along", thruster.along)):
                if len(value) != G.space:
                    here.at(option).add(
                        f"expected {G.space} numbers for {G.name}, got {len(value)}"
                    )
            if not any(thruster.along):
                here.at("along").add("expected a direction, got a vector of zeros")
            if thruster.turns and G.space != G.rotations:
                here.at("turns").add(
                    f"a torque about along has no part in the plane of {G.name}; remove this key"
                )
        names = self.thruster_names
        for index, name in enumerate(names):
            if name in names[:index]:
                first = names.index(name)
                problems.at(index).at("name").add(
                    f"expected a unique name, got '{name}', which thrusters[{first}] has"
                )
