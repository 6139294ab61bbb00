"""Base class of control laws."""

from abc import abstractmethod
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import Problems
from eqt_cli.core.leaves import structure, with_fields
from eqt_cli.core.registry import Component
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.flatness import PlantModel
from eqt_cli.mechanics.inertia import InertiaLaw
from eqt_cli.mechanics.over_time import GivenOverTime
from eqt_cli.mechanics.tracking import Gains, Tracking


@dataclass(frozen=True)
class RunsCode:
    """The C function that a law runs, as a configuration names it.

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


class LinearPlant(NamedTuple):
    """The loop without feedback to first order: ẋ, or x a period later, is A x + B u.

    x = (ε, e, …) with Q = Q_d exp(ε) and e = V − Ad_{Q_L⁻¹}V_d, then the states of actuators and
    delays; u is added to τ_d.

    Attributes
    ----------
    times : (k,)
        One time where the plant is constant; else the middles of pieces of the horizon, s.
    A, B
        ``(k, n, n)`` and ``(k, n, m)``.
    period
        Control period, s; None for a continuous plant.
    piece, periods
        Length of a piece in s, and in control periods.
    is_periodic
        Whether the plant begins again as it ends.
    """

    times: Array
    A: Array
    B: Array
    period: float | None
    piece: float
    periods: int
    is_periodic: bool


@dataclass(frozen=True)
class Controller(GivenOverTime, Component):
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
        of the paper's laws are, so that equal gains make a fair comparison. None: not known.
    claims_decrease
        Whether L is claimed to decrease along every trajectory; None: not known.
    departs
        How a loop with this law departs from the assumptions of the theorems, in a few words.
    reads_flat_output
        Whether it reads the flat output of the reference.
    commands_attitude
        Whether it commands an attitude R_c, to which an attitude law turns the body.
    direction
        The body axis along which it pushes a rigid body, if there is only one.
    undefined
        Where it has no command, and the remedy, in words; "" where it always has one.
    reads_gains
        Whether it reads the section `gains`.
    inside_reads_gains
        Whether the law inside it reads gains.
    """

    title: ClassVar[str]
    tasks: ClassVar[tuple[str, ...]] = ("track",)
    energy: ClassVar[str] = "½⟨P̃, Ṽ⟩ + Υ(Q_E)"
    theorem: ClassVar[str] = "Theorems 3.2, 6.2"
    bibtex: ClassVar[str] = ""
    matched: ClassVar[bool | None] = None
    claims_decrease: ClassVar[bool | None] = None
    departs: ClassVar[str] = ""
    reads_flat_output: ClassVar[bool] = False
    commands_attitude: ClassVar[bool] = False
    direction: ClassVar[Any] = ()
    undefined: ClassVar[str] = ""
    reads_gains: ClassVar[bool] = True
    inside_reads_gains: ClassVar[bool] = False

    def __init_subclass__(cls, **options: Any) -> None:
        """Drop the inherited claims of a class with a torque, and the title of one with a name."""
        super().__init_subclass__(**options)
        if "name" in vars(cls) and "title" not in vars(cls):
            cls.title = cls.name
        if "torque" in vars(cls):
            claims = {"claims_decrease", "dissipation", "matched", "feedforward_torque"}
            for claim in claims - vars(cls).keys():
                setattr(cls, claim, vars(Controller)[claim])

    @property
    def structure(self) -> Hashable:
        """The law without its numbers; laws of equal structure can be solved together."""
        return structure(self)

    def claims(self, G: MatrixLieGroup, gains: Gains) -> bool | None:
        """Return whether L is claimed to decrease with these gains, as `claims_decrease`."""
        return self.claims_decrease

    def defaults(self, G: MatrixLieGroup, gains: Gains) -> Mapping[str, float]:
        """Return options that follow the gains where a configuration leaves them out."""
        return {}

    def gains_group(self, G: MatrixLieGroup) -> MatrixLieGroup:
        """Return the group that its gains are of."""
        return G

    def inside(
        self, G: MatrixLieGroup, inertia: InertiaLaw
    ) -> "tuple[MatrixLieGroup, InertiaLaw, Controller] | None":
        """Return the law that L and the gains are of, if another one, with group and inertia."""
        return None

    def attitude_error(self, s: Tracking) -> Array | None:
        """Return ‖R − R_c‖_F, ``(...)``, if it `commands_attitude`."""
        return None

    @property
    def known_forces(self) -> tuple[Any, ...]:
        """The forces of `model` for which it is `designed`."""
        return ()

    def knowing(self, G: MatrixLieGroup, plant: PlantModel, problems: Problems) -> Self:
        """Return the law with what it knows of the plant, after noting what does not fit."""
        return self

    def with_held(self, held: Any) -> Self:
        """Return the law with the numbers that it `held` from one instant to the next."""
        return self

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note where the law or its options do not fit the group."""

    def fits(self, G: MatrixLieGroup) -> bool:
        """Return whether the law is for a group."""
        problems = Problems()
        self.check(G, problems)
        return not problems

    @property
    def pieces(self) -> int:
        """Number of pieces of the horizon for which it is `designed`; 0 where gains are given."""
        return 0

    def with_defaults(self, G: MatrixLieGroup, gains: Gains, given: Any) -> Self:
        """Return the law with the options that follow its gains, but for those of `given`."""
        own = given if isinstance(given, dict) else {}
        defaults = self.defaults(G, gains).items()
        return with_fields(self, **{name: value for name, value in defaults if name not in own})

    def directions(self, G: MatrixLieGroup) -> Array:
        """Return those in which it asks for a torque, ``(k, m)``; of a design, none."""
        return np.eye(G.dimension)[: 0 if self.pieces else None]

    def designed(self, G: MatrixLieGroup, plant: LinearPlant) -> Self:
        """Return the law with the gains that follow from its linearised plant."""
        raise NotImplementedError(f"{self.name} is not designed for a plant")

    @abstractmethod
    def torque(self, s: Tracking) -> Array:
        """τ, body frame, ``(..., m)``."""

    def feedforward_torque(self, s: Tracking) -> Array | None:
        """Return the part of the torque without gains, body frame; None where it is not known."""
        return None

    def lyapunov(self, s: Tracking) -> Array:
        """Return L, ``(...)``, the function of `energy`, which the law claims to decrease."""
        return s.lyapunov

    def velocity_error(self, s: Tracking) -> Array:
        """Return y, where an additional torque δ raises L at the rate ⟨δ, y⟩, ``(..., m)``."""
        return s.V_tilde

    def dissipation(self, s: Tracking) -> Array | None:
        """Return the power −dL/dt that the law dissipates, ``(...)``; None where it is not known.

        Every run integrates it, so that L(t) + ∫dissipation = L(0) can be checked.
        """
        return None

    # A law that is not a formula but code of the user.

    @property
    def code(self) -> RunsCode | None:
        """The code that the law runs; None for a formula."""
        return None

    def running(self, function: Any, G: MatrixLieGroup) -> Self:
        """Return the law with its code as a function that can be called."""
        raise NotImplementedError(f"{self.name} runs no code")

    @property
    def formula(self) -> "Controller | None":
        """The law whose formulas apply: this one, or the one that its code claims to be."""
        return self

    def answer(self, s: Tracking, period: Any) -> tuple[Array, Mapping[str, Array]]:
        """Return the commanded torque at a control instant, and the memory one period later.

        The memory z is advanced by an Euler step.
        """
        torque, rates = self.torque(s), self.memory_rate(s)
        return torque, {name: z + period * rates[name] for name, z in s.memory.items()}

    # A law with memory, such as an integral of the error, has states that are integrated too.

    def memory(self, G: MatrixLieGroup) -> Mapping[str, int]:
        """Return the lengths of the law's own states by name."""
        return {}

    def initial_memory(self, s: Tracking) -> Mapping[str, Array]:
        """Return the states at the start of a run, ``(..., length)`` each; 0 for those left out.

        In `s`, all states of the law are 0.
        """
        return {}

    def memory_rate(self, s: Tracking) -> Mapping[str, Array]:
        """Return the time derivatives of all states, which are in `s.memory`."""
        return {}

    def cycle(self, period: float) -> Sequence[Mapping[str, float]]:
        """Return the states that count control instants, at each instant of the law's cycle."""
        return [{}]

    def memory_gradient(self, s: Tracking) -> Mapping[str, Array] | None:
        """Return ∂L/∂z of all states z; None where it is not known.

        With it, the energy balance also holds where the states change only at instants.
        """
        return None
