"""Control laws: their base class, and the (g, c, n) family with the laws of the paper."""

from abc import abstractmethod
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Literal,
    NamedTuple,
    Protocol,
    Self,
    TypeAlias,
    TypeVar,
    runtime_checkable,
)

import numpy as np
from pydantic import AfterValidator, Field

from eqt_cli.base.arrays import Array, Arrays, dot
from eqt_cli.base.errors import Problems, Remedy
from eqt_cli.base.option_types import Positive, Real, Scale, Unit
from eqt_cli.base.registry import Component, Keys, Registry
from eqt_cli.components.actuators import limited_parts
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.inertia import Inertia, InertiaLaw
from eqt_cli.components.mechanics import LATER, Gains, LawInput, TimeVarying, Tracking
from eqt_cli.components.motions import PlantModel
from eqt_cli.numbers.leaves import structure, with_fields

Law = TypeVar("Law", bound="Controller")

# Base class of control laws, and what they are published in --------------------------------------


if TYPE_CHECKING:
    EachAxis: TypeAlias = Any  # float | Array, which a series does not multiply by its type
    EachAxisOrZero: TypeAlias = Any
else:
    _ARRAY = AfterValidator(lambda k: np.array(k, dtype=float) if isinstance(k, list) else k)
    EachAxis = Annotated[Positive | list[Positive], _ARRAY]
    EachAxisOrZero = Annotated[Real | list[Positive], _ARRAY]


def check_each_axis(gain: EachAxis, axes: int, problems: Problems) -> None:
    """Note a list of gains that has not one for each axis."""
    if np.ndim(gain) and np.size(gain) != axes:
        problems.add(f"expected a number, or {axes} of them, got {np.size(gain)}")


@cache
def _sources() -> list[str]:
    # Once for all laws; a path spares commands without HDF5 11 ms of importlib.resources.
    return Path(__file__).with_name("sources.bib").read_text(encoding="utf-8").strip().split("\n\n")


def published(key: str) -> str:
    """Return the BibTeX entry of a publication in `sources.bib`."""
    return next(entry for entry in _sources() if f"{{{key}," in entry)


@dataclass(frozen=True)
class Controller(TimeVarying, Component):
    """A control law: a frozen dataclass whose fields are its options in a configuration.

    Every field that is a float is a leaf: an engine may replace it by an array ``(runs, 1)`` or by
    a symbol, so a law uses it with operators only. Multiply inside a contraction,
    ``dot(self.k * z, z)``, because the results of `dot` and `norm` have no last axis.

    Attributes
    ----------
    name
        The name in a configuration: ``eqt``.
    title
        The name in figures: ``EqT``. Default: the name.
    tasks
        The tasks of a configuration that the law is for; empty for a law that needs more than its
        name, such as code, which may do any task.
    energy
        Its Lyapunov function, as text: ``½⟨P̃, Ṽ⟩ + Υ(Q_E)``.
    theorem
        The source that shows that this function decreases; "" if nothing is claimed.
    bibtex
        The BibTeX entry of the publication that the law is after; "" of the paper's own laws.
    matched
        Whether its stiffness and damping for small errors are the Hessian of Υ and K_d, as those
        of the paper's laws are, so that equal gains make a fair comparison. None: unknown.
    claims_decrease
        Whether L is claimed to decrease along every trajectory; None: not known.
    weight
        The frame of the error of which the law's force is −dΥ, so that a weight K = k c cᵀ turns
        one axis alone, as `task: point` asks for; "" where it is not such a force.
    departs
        How a loop with this law departs from the assumptions of the theorems, in a few words.
    reads_flat_output
        Whether it reads the flat output of the reference.
    commands
        What it commands: a torque, the rates that a `rate_loop` takes, or a dipole, for which it
        reads the measured magnetic field; empty where that is not known.
    reads_gains
        Whether it reads the section `gains`.
    """

    title: ClassVar[str]
    tasks: ClassVar[tuple[str, ...]] = ("track",)
    energy: ClassVar[str] = "½⟨P̃, Ṽ⟩ + Υ(Q_E)"
    theorem: ClassVar[str] = "Theorems 3.2, 6.2"
    bibtex: ClassVar[str] = ""
    matched: ClassVar[bool | None] = None
    claims_decrease: ClassVar[bool | None] = None
    weight: ClassVar[Literal["spatial", "body", ""]] = ""
    departs: ClassVar[str] = ""
    reads_flat_output: ClassVar[bool] = False
    commands: ClassVar[str] = "torque"
    reads_gains: ClassVar[bool] = True

    def __init_subclass__(cls, **options: Any) -> None:
        """Drop the inherited claims of a class with a torque, and the title of one with a name."""
        super().__init_subclass__(**options)
        if "name" in vars(cls) and "title" not in vars(cls):
            cls.title = cls.name
        if "torque" in vars(cls):
            names = {"claims_decrease", "dissipation", "matched", "feedforward_torque", "weight"}
            for claim in names - vars(cls).keys():
                setattr(cls, claim, vars(Controller)[claim])

    # What most laws define; the states of one with memory, such as an integral, are integrated.

    @abstractmethod
    def torque(self, s: Tracking) -> Array:
        """τ, body frame, ``(..., m)``."""

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note where the law or its options do not fit the group."""

    def lyapunov(self, s: Tracking) -> Array:
        """Return L, ``(...)``, the function of `energy`, which the law claims to decrease."""
        return s.lyapunov

    def dissipation(self, s: Tracking) -> Array | None:
        """Return the power −dL/dt that the law dissipates, ``(...)``; None where it is not known.

        Every run integrates it, so that L(t) + ∫dissipation = L(0) can be checked.
        """
        return None

    def memory(self, G: MatrixLieGroup) -> Mapping[str, int]:
        """Return the lengths of the law's own states by name."""
        return {}

    def memory_rate(self, s: Tracking) -> Arrays:
        """Return the time derivatives of all states, which are in `s.memory`."""
        return {}

    # What eqt asks of every law, and few answer otherwise.

    def initial_memory(self, s: Tracking) -> Arrays:
        """Return the states at the start of a run, ``(..., length)`` each; 0 for those left out.

        All states of the law in `s` are 0.
        """
        return {}

    @property
    def structure(self) -> Hashable:
        """The law without its numbers; laws of equal structure can be solved together."""
        return structure(self)

    def defaults(self, G: MatrixLieGroup, gains: Gains) -> Mapping[str, Any]:
        """Return options that follow the gains where a configuration leaves them out."""
        return {}

    def for_plant(self, G: MatrixLieGroup, plant: PlantModel, problems: Problems) -> Self:
        """Return the law with what it knows of the plant, after noting what does not fit."""
        return self

    def directions(self, G: MatrixLieGroup) -> Array:
        """Return those in which it asks for a torque, ``(k, m)``; of a design, none."""
        return np.eye(G.dimension)

    def feedforward_torque(self, s: Tracking) -> Array | None:
        """Return the part of the torque without gains, body frame; None where it is not known."""
        return None

    def velocity_error(self, s: Tracking) -> Array:
        """Return y, where an additional torque δ raises L at the rate ⟨δ, y⟩, ``(..., m)``."""
        return s.V_tilde

    def loaded(
        self, home: Any, G: MatrixLieGroup, problems: Problems
    ) -> tuple[Self | None, dict[str, str]]:
        """Return the law ready to run, and the texts of code that it executes, by their files.

        A law that runs code of the user is compiled here. None after a problem.

        Parameters
        ----------
        home
            The place of the configuration, as `config.document.Place`: its folder has the files.
        """
        return self, {}

    @property
    def formula(self) -> "Controller | None":
        """The law whose formulas apply: this one, or the one that its code claims to be."""
        return self

    def answer(self, s: Tracking, period: Any) -> tuple[Array, Arrays]:
        """Return the commanded torque at a control instant, and the memory one period later.

        The memory z is advanced by an Euler step.
        """
        torque, rates = self.torque(s), self.memory_rate(s)
        return torque, {name: z + period * rates[name] for name, z in s.memory.items()}


controllers = Registry(
    "controller", "controllers", Controller, ("components.laws", "components.classic_laws")
)


def fits(law: Controller, G: MatrixLieGroup) -> bool:
    """Return whether a law is for a group."""
    problems = Problems()
    law.check(G, problems)
    return not problems


def with_defaults(law: Law, G: MatrixLieGroup, gains: Gains, configured: Any) -> Law:
    """Return a law with the options that follow its gains, but for those of `configured`."""
    names = configured if isinstance(configured, dict) else {}
    defaults = law.defaults(G, gains).items()
    return with_fields(law, **{name: value for name, value in defaults if name not in names})


# What only some laws can do, by a method of their own --------------------------------------------


@runtime_checkable
class ClaimsByGains(Protocol):
    """A law that claims a decrease of L with some gains only."""

    def claims(self, G: MatrixLieGroup, gains: Gains) -> bool | None:
        """Return whether L is claimed to decrease with these gains, as `claims_decrease`."""


def claims(law: Controller, G: MatrixLieGroup, gains: Gains) -> bool | None:
    """Return whether L of a law is claimed to decrease with these gains."""
    of = law.formula or law
    return of.claims(G, gains) if isinstance(of, ClaimsByGains) else of.claims_decrease


@runtime_checkable
class HoldsNumbers(Protocol):
    """A law with numbers that it `held` from one instant to the next."""

    def with_held(self, held: Any) -> Any:
        """Return the law with these numbers; None: none are held."""


@runtime_checkable
class StoresNumbers(Protocol):
    """A law of which a result stores other numbers than its memory, such as a sliding variable.

    `output` returns them, ``(..., length)`` each; a law without it stores parts of its memory.
    """

    def outputs(self, G: MatrixLieGroup) -> Mapping[str, int]:
        """Return the lengths of these numbers, by name."""


def outputs(law: Controller, G: MatrixLieGroup) -> dict[str, int]:
    """Return the lengths of the numbers of a law that a result stores, by name: its memory.

    Memory whose name begins with a point is not stored.
    """
    lengths = law.outputs(G) if isinstance(law, StoresNumbers) else law.memory(G)
    return {name: length for name, length in lengths.items() if not name.startswith(".")}


def stored_numbers(law: Controller, s: Tracking) -> Arrays:
    """Return the numbers of a law that a result stores, ``(..., length)`` each."""
    numbers: Arrays = law.output(s) if hasattr(law, "output") else s.memory
    return numbers


def output_units(law: Controller) -> Mapping[str, str]:
    """Return the units of these numbers by their name, where a law gives them one."""
    return getattr(law, "output_units", {})


@runtime_checkable
class KnowsMemoryGradient(Protocol):
    """A law whose energy balance also holds where its states change only at instants."""

    def memory_gradient(self, s: Tracking) -> Arrays | None:
        """Return ∂L/∂z of all states z; None where it is not known."""


def memory_gradient(law: Controller, s: Tracking) -> Arrays | None:
    """Return ∂L/∂z of all states of a law; None where it is not known."""
    of = law.formula or law
    return of.memory_gradient(s) if isinstance(of, KnowsMemoryGradient) else None


# What only some laws can do; a law derives from each of these classes that applies ---------------


class KnowsForces(Controller):
    """A law that deals with known forces itself."""


def counteracts(law: Controller) -> bool:
    """Return whether the loop takes known forces from the torque of a law."""
    return bool(law.tasks) and not isinstance(law, KnowsForces)


class ReadsLimits(Controller):
    """A law whose anti-windup reads the limits of actuators.

    Attributes
    ----------
    anti_windup
        What its integral does at the limits, where that is an option of the law itself.
    acting
        The actuators with these limits, in their order; empty where no anti-windup reads them.
    """

    anti_windup: Any = "none"
    acting: Any = ()

    def for_plant(self, G: MatrixLieGroup, plant: PlantModel, problems: Problems) -> Self:
        """Return the law with the actuators whose limits it reads."""
        if self.anti_windup == "none":
            return self
        return with_fields(self, acting=limited_parts(G, plant, problems))


class CountsInstants(Controller):
    """A law with states that count its instants, or tell the first from the others."""

    def cycle(self, period: float) -> Sequence[Mapping[str, float]]:
        """Return these states, at each instant of the law's cycle."""
        return [{}]


class OuterLoop(CountsInstants):
    """A law that commands an attitude R_c to an inner law, of which L and the gains are.

    Attributes
    ----------
    inner
        The law of attitudes; None until the law is `loaded`.
    direction
        The body axis along which it pushes a rigid body; empty until it knows the plant.
    undefined
        States without a command, and the remedy, in words; "" if there are none.
    """

    inner: Any = None
    direction: Any = ()
    undefined: ClassVar[str] = ""

    @abstractmethod
    def gains_group(self, G: MatrixLieGroup) -> MatrixLieGroup:
        """Return the group that its gains are of."""

    @abstractmethod
    def inner_inertia(self, G: MatrixLieGroup, inertia: InertiaLaw) -> Inertia:
        """Return the inertia of the inner law, on its `gains_group`."""

    @abstractmethod
    def attitude_error(self, s: Tracking) -> Array:
        """Return ‖R − R_c‖_F, ``(...)``."""

    @abstractmethod
    def loop_errors(self, s: Tracking) -> Array:
        """Return errors that may not change along a reference, inner loop first, ``(..., 2m)``."""


def gains_group(law: Controller, G: MatrixLieGroup) -> MatrixLieGroup:
    """Return the group that the gains of a law are of."""
    of = law.formula or law
    return of.gains_group(G) if hasattr(of, "gains_group") else G


MOST_AHEAD = 1000
"""Most steps of a preview."""


@dataclass(frozen=True)
class Preview(Keys):
    """Later times of the reference.

    Attributes
    ----------
    steps
        Number of times.
    every
        Time from one to the next, and from now to the first, s.
    """

    steps: Annotated[int, Field(ge=1, le=MOST_AHEAD)]
    every: Annotated[Positive, Unit("s")]

    @property
    def times(self) -> tuple[float, ...]:
        """The times from now, s."""
        return tuple(self.every * k for k in range(1, self.steps + 1))


class Previews(Controller):
    """A law that knows the reference in advance.

    Attributes
    ----------
    preview : (k,)
        The times from now at which it knows the reference, s.
    previewed
        What it reads of the reference at these times, among `LATER`.
    """

    preview: ClassVar[Any] = ()
    previewed: ClassVar[Any] = LATER[:2]


def check_foreseen(plant: PlantModel, problems: Problems) -> None:
    """Note a reference whose later motion a preview cannot know."""
    if not plant.foreseen:
        problems.add(
            "the reference is integrated, so its later values are unknown; use one that is a "
            "function of time: path, flat, waypoints, log, slew or constant"
        )


def check_flat_output(plant: PlantModel, problems: Problems) -> None:
    """Note a reference without a flat output."""
    if plant.flat is None:
        problems.add(
            "needs a reference that gives jerk and snap",
            Remedy("use reference: {kind: flat, position: […]}, or {kind: flat, of: …}"),
        )


class LinearPlant(NamedTuple):
    """The loop without feedback to first order: ẋ, or x a period later, is A x + B u.

    x = (ε, e, …) with Q = Q_d exp(ε) and e = V − Ad_{Q_L⁻¹}V_d, then the states of actuators and
    delays; u is added to τ_d.

    Attributes
    ----------
    times : (k,)
        One time where the plant is constant; else knots: begin and end of the horizon or, of a
        sampled plant, its last instant, and those in between, s.
    A, B
        At the knots, of a sampled plant at the middles of the periods that begin there,
        ``(k, n, n)`` and ``(k, n, m)``.
    period
        Control period, s; None for a continuous plant.
    differs
        A quantity that does not repeat at the end of the horizon, in words; "" if all do.
    """

    times: Array
    A: Array
    B: Array
    period: float | None
    differs: str = ""


class Designed(KnowsForces):
    """A law whose gains follow from its plant, linearised about the reference.

    Attributes
    ----------
    pieces
        Number of pieces of the horizon; the plant is linearised at their ends.
    known_forces
        The forces of `model`, which it takes from its torque at the reference.
    """

    pieces: int
    known_forces: Any

    @abstractmethod
    def designed(self, G: MatrixLieGroup, plant: LinearPlant) -> Self:
        """Return the law with the gains that follow from its linearised plant."""

    def directions(self, G: MatrixLieGroup) -> Array:
        """Return none: the weights decide."""
        return np.empty((0, G.dimension))


@dataclass(frozen=True)
class CodeFile:
    """The function that a law runs, as a configuration names it.

    Attributes
    ----------
    file
        The file that defines it, relative to the configuration.
    prefix
        X of ``X_torque``, ``X_numbers``, ``X_memory`` and ``X_input``.
    numbers
        The fields of ``X_numbers`` that are given, with their lengths.
    memory
        The fields of ``X_memory``.
    real
        ``double`` or ``float``.
    """

    file: str
    prefix: str
    numbers: tuple[tuple[str, int], ...]
    memory: tuple[str, ...]
    real: str

    @property
    def is_python(self) -> bool:
        """Whether the file is Python; then the prefix is the expression of its function."""
        return self.file.endswith(".py")

    @property
    def function(self) -> str:
        """The name of the function."""
        return self.prefix if self.is_python else f"{self.prefix}_torque"


class CodeCall(NamedTuple):
    """The code of a law as C calls it; the function takes the arguments of ``eqt_code``.

    Attributes
    ----------
    begins
        Its second argument.
    reads
        The parts of `LawInput` that it is given, in their order.
    options : (…, numbers)
        Its numbers, of every run.
    """

    function: Any
    begins: int
    reads: tuple[str, ...]
    options: Array


class RunsCode(Controller):
    """A law that is not a formula but runs code: a function of the user, or a network.

    Attributes
    ----------
    in_order
        Where it answers in the order of time only, from the start of a run on: the most runs that
        an engine calls it for side by side, which may take a process each.
    metrics
        The metrics that results hold of it by default, by name.
    """

    in_order: ClassVar[Any] = 0
    metrics: ClassVar[Any] = ()

    def drained(self) -> list[float]:
        """Return the CPU times of its calls since it was last asked, s; none if it has none."""
        return []

    def lost_calls(self) -> Mapping[int, str]:
        """Return of each run whose call was lost since it was last asked in this thread why.

        "" of one that another call has ended.
        """
        return {}

    @property
    def unfailing(self) -> Self:
        """The law without the memory that it keeps for failed calls."""
        return self

    by_processor: ClassVar[bool] = True  # it is compiled on this machine
    tasks: ClassVar[tuple[str, ...]] = ()
    theorem: ClassVar[str] = ""
    reads_gains: ClassVar[bool] = False

    @property
    def formula(self) -> Controller | None:
        """The law that the code claims to be; None if it claims nothing."""
        return None

    def torque(self, s: Tracking) -> Array:
        """Return the torque of one call of the code."""
        return self.answer(s, 0.0)[0]

    @property
    @abstractmethod
    def code(self) -> CodeFile:
        """The code that the law runs."""

    @property
    @abstractmethod
    def code_call(self) -> CodeCall | None:
        """How C calls that code without Python; None where it needs Python."""

    def code_rows(self, G: MatrixLieGroup, x: LawInput) -> Array:
        """Return what that code is given of an input, ``(states, …)``."""
        assert self.code_call is not None
        return x.rows(self.code_call.reads)

    def answer_rows(
        self, G: MatrixLieGroup, rows: Array, memory: Arrays
    ) -> tuple[Array, Arrays] | None:
        """Return what the code answers to its rows; None where they are parts of the input.

        A law that computes its rows answers to those of the engine, so that it has their bits.
        """
        return None

    def judged(
        self, label: str, loop: Any, horizon: float, random: Any, flown: Any
    ) -> Iterable[Any]:
        """Return rows of `eqt verify` that only this law has.

        Parameters
        ----------
        loop
            The closed loop with this law.
        random
            A generator of random numbers.
        flown
            Times and flat states of good runs; None if there are none.
        """
        return ()


# The family of stabilising tracking laws τ(g, c, n, q), for every group ---------------------------


Frame = Literal["spatial", "body"]

BODY_ENERGY = "½⟨𝕀e, e⟩ + Υ(Q_L)"
"""L of a law in the errors Q_L = Q_d⁻¹Q and e = V − Ad_{Q_L⁻¹}V_d."""


class _FromOptions(Controller):
    """Numbers of a member of the family that follow from its options."""

    damping: Frame | None
    error: Frame
    quadratic: float

    @cached_property
    def spatial(self) -> float:
        """1 with damping in the spatial frame, else 0: one compiled law serves the whole family."""
        return 1.0 if (self.damping or self.error) == "spatial" else 0.0

    @cached_property
    def has_quadratic(self) -> bool:
        """Whether the law has the term with q, which may be a symbol later."""
        return self.quadratic != 0


@dataclass(frozen=True)
class Family(_FromOptions):
    """The (g, c, n, q) family: the paper's four laws and three classics are points of it.

    τ = τ_d − g·ad*_Ṽ 𝕀V_d − c·ad*_{V_d} 𝕀Ṽ + n·𝕀 ad_V V_d − q·ad*_Ṽ 𝕀Ṽ − damping
    − Ad*_{Q_d} L*_{Q_E}dΥ(Q_E)

    and, where the inertia varies, + Ṡ*S⁻* 𝕀Ṽ (Theorem 3.2); with damping
    Ad*_{Q_d} K_d Ad_{Q_d} Ṽ (spatial) or K_d Ṽ (body). All members with c + n = 1 change
    L = ½⟨𝕀Ṽ, Ṽ⟩ + Υ(Q_E) at the same rate, −⟨K_d V_E, V_E⟩ or −⟨K_d Ṽ, Ṽ⟩: the g- and q-terms
    are gyroscopic, and the c- and n-terms have the same power on every group. Generalises Hampsey
    et al. (2025), eq. (22), (23), (24) and the two laws after them.

    With the error in the body frame, the same formula holds with V_d replaced by ξ = Ad_{Q_L⁻¹}V_d,
    Ṽ by e = V − ξ, τ_d by τ_ξ = 𝕀ξ̇ + 𝕀̇ξ − ad*_ξ 𝕀ξ, and the force by −L*_{Q_L}dΥ(Q_L) of
    Q_L = Q_d⁻¹Q; its damping is K_d e.

    Attributes
    ----------
    gyroscopic
        g, the weight of −ad*_Ṽ 𝕀V_d.
    transport
        c, the weight of −ad*_{V_d} 𝕀Ṽ.
    connection
        n, the weight of 𝕀 ad_V V_d.
    damping
        The frame in which the Rayleigh tensor K_d is given. Default: the frame of the error.
    error
        The frame of the errors: Q Q_d⁻¹ (spatial) or Q_d⁻¹Q (body).
    quadratic
        q, the weight of −ad*_Ṽ 𝕀Ṽ.
    """

    name: ClassVar[str] = "family"
    matched: ClassVar[bool | None] = True

    gyroscopic: Annotated[Real, Scale("gyroscopic weight g")] = 1.0
    transport: Annotated[Real, Scale("transport weight c")] = 1.0
    connection: Annotated[Real, Scale("connection weight n")] = 0.0
    damping: Frame | None = None
    spatial: float = field(init=False, repr=False)
    error: Frame = "spatial"
    quadratic: Annotated[Real, Scale("quadratic weight q")] = 0.0
    has_quadratic: bool = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if self.error == "body" and self.damping == "spatial":
            raise ValueError("error: body always has damping: body; leave damping out")

    def loaded(
        self, home: Any, G: MatrixLieGroup, problems: Problems
    ) -> tuple[Self, dict[str, str]]:
        """Return the law with the frame of its damping."""
        return with_fields(self, damping=self.damping or self.error), {}

    @property
    def structure(self) -> Hashable:
        """The same for all members in one frame; a law that overrides a method has another."""
        kind = type(self)
        methods = ("torque", "dissipation", "memory", "initial_memory", "memory_rate")
        inherited = all(getattr(kind, name) is getattr(Family, name) for name in methods)
        return (Family, self.error, self.has_quadratic) if inherited else super().structure

    @property
    def claims_decrease(self) -> bool | None:  # type: ignore[override]  # by its options
        """True on the plane c + n = 1, where both terms compensate the moving reference."""
        return abs(self.transport + self.connection - 1) <= 1e-12  # rounding of 0.1 + 0.9

    @property
    def energy(self) -> str:  # type: ignore[override]  # a constant of all other laws
        """L in the frame of the errors."""
        return Controller.energy if self.error == "spatial" else BODY_ENERGY

    @property
    def weight(self) -> Frame:  # type: ignore[override]  # a constant of all other laws
        """The frame of its error."""
        return self.error

    def torque(self, s: Tracking) -> Array:
        """τ(g, c, n, q), body frame."""
        s = self._in_error_frame(s)
        feedforward = self._feedforward(s)
        if self.error == "body":  # the desired pose is I, and damping has one frame
            return feedforward - s.body_damping - s.gradient
        spatial_force = s.gradient + self.spatial * s.spatial_damping
        return feedforward - (1 - self.spatial) * s.body_damping - s.G.Ad_star(s.Qd, spatial_force)

    def feedforward_torque(self, s: Tracking) -> Array:
        """τ_d and the terms with g, c, n and q."""
        return self._feedforward(self._in_error_frame(s))

    def lyapunov(self, s: Tracking) -> Array:
        """½⟨𝕀Ṽ, Ṽ⟩ + Υ(Q_E)."""
        return self._in_error_frame(s).lyapunov

    def velocity_error(self, s: Tracking) -> Array:
        """Ṽ, or e."""
        return self._in_error_frame(s).V_tilde

    def dissipation(self, s: Tracking) -> Array | None:
        """⟨K_d V_E, V_E⟩ or ⟨K_d Ṽ, Ṽ⟩, and off the plane c + n = 1 the power of these terms."""
        s = self._in_error_frame(s)
        added = dot((1 - self.transport - self.connection) * s.P_tilde, s.G.ad(s.V, s.Vd))
        if self.error == "body":
            return dot(s.body_damping, s.V_tilde) + added
        damping = dot(self.spatial * s.spatial_damping, s.V_E)
        return damping + dot((1 - self.spatial) * s.body_damping, s.V_tilde) + added

    def _feedforward(self, s: Tracking) -> Array:
        quadratic = self.quadratic if self.has_quadratic else None
        return s.feedforward(self.gyroscopic, self.transport, self.connection, quadratic)

    def _in_error_frame(self, s: Tracking) -> Tracking:
        """Return the motion with the errors in their frame."""
        return s.relative if self.error == "body" else s


@dataclass(frozen=True)
class Member(Family):
    """A named point of the family, without options: its weights and frames are class data."""

    gyroscopic: float = field(init=False)
    transport: float = field(init=False)
    connection: float = field(init=False)
    damping: Frame | None = field(init=False)
    error: Frame = field(init=False)
    quadratic: float = field(init=False)


@dataclass(frozen=True)
class EqT(Member):
    """Equivariant tracking, Theorem 6.2 of the paper; eq. (23) on SO(3)."""

    name: ClassVar[str] = "eqt"
    title: ClassVar[str] = "EqT"
    gyroscopic, transport, connection, quadratic = 1.0, 1.0, 0.0, 0.0
    error, damping = "spatial", "spatial"


@dataclass(frozen=True)
class GT(Member):
    """Geometric tracking after Bullo and Lewis, damped in the body frame; eq. (24) on SO(3)."""

    name: ClassVar[str] = "gt"
    title: ClassVar[str] = "GT"
    bibtex: ClassVar[str] = published("bullo2005geometric")
    gyroscopic, transport, connection, quadratic = 0.5, 0.5, 0.5, 0.0
    error, damping = "spatial", "body"


@dataclass(frozen=True)
class NoG(Member):
    """EqT without its gyroscopic term (the paper's §7)."""

    name: ClassVar[str] = "nog"
    gyroscopic, transport, connection, quadratic = 0.0, 1.0, 0.0, 0.0
    error, damping = "spatial", "spatial"


@dataclass(frozen=True)
class Asym(Member):
    """EqT with the symmetric choice of S (the paper's §7 and eq. (10))."""

    name: ClassVar[str] = "asym"
    gyroscopic, transport, connection, quadratic = 1.0, 0.5, 0.5, 0.0
    error, damping = "spatial", "spatial"


@dataclass(frozen=True)
class Lee2010(Member):
    """Lee, Leok and McClamroch (2010), the attitude part, on every group.

    On SO(3), τ = −k_R e_R − k_Ω e_Ω + Ω × JΩ − J(Ω̂RᵀR_dΩ_d − RᵀR_dΩ̇_d) with K = (k_R/2) I and
    K_d = k_Ω I: arXiv 1003.2005v4, eq. (8), (9) and (11), where Υ is k_R times the error function
    of eq. (6). On other groups, the form is that of the design of eqt.
    """

    name: ClassVar[str] = "lee2010"
    title: ClassVar[str] = "Lee 2010"
    theorem: ClassVar[str] = "Lee, Leok, McClamroch (2010), attitude part"
    bibtex: ClassVar[str] = published("lee2010geometric")
    gyroscopic, transport, connection, quadratic = 1.0, 1.0, 0.0, 1.0
    error, damping = "body", "body"


@dataclass(frozen=True)
class Lee2012(Member):
    """After Lee, Leok and McClamroch (2012): attitude part, no robust term, on every group.

    On SO(3), τ = −k_R e_R − k_Ω e_Ω + (RᵀR_dΩ_d) × J(RᵀR_dΩ_d) + JRᵀR_dΩ̇_d with K = (k_R/2) I and
    K_d = k_Ω I: Nonlinear robust tracking control of a quadrotor UAV on SE(3), arXiv 1109.4457, of
    which only the opening was read. Goodarzi, Lee and Lee (2013)
    without their integral is the same law.
    """

    name: ClassVar[str] = "lee2012"
    title: ClassVar[str] = "Lee 2012"
    theorem: ClassVar[str] = "after Lee, Leok, McClamroch (2012), attitude part"
    bibtex: ClassVar[str] = published("lee2012nonlinear")
    gyroscopic, transport, connection, quadratic = 0.0, 0.0, 1.0, 0.0
    error, damping = "body", "body"


@dataclass(frozen=True)
class BulloMurray(Member):
    """After Bullo and Murray (1999), with the transport map of the body error, on every group.

    τ = 𝕀(ξ̇ + ∇_V ξ) − K_d e − L*dΥ(Q_L), where ξ = Ad_{Q_L⁻¹}V_d is the desired velocity carried
    to the body and ∇ the Levi-Civita connection of 𝕀. Automatica 35, 17-34, of which only the
    abstract was read.
    """

    name: ClassVar[str] = "bullo_murray"
    title: ClassVar[str] = "Bullo–Murray"
    theorem: ClassVar[str] = "after Bullo, Murray (1999)"
    bibtex: ClassVar[str] = published("bullo1999tracking")
    gyroscopic, transport, connection, quadratic = 0.5, 0.5, 0.5, 0.0
    error, damping = "body", "body"
