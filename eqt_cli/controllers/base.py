"""What a control law is; it knows no engine and no particular group."""

from abc import abstractmethod
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Self

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.component import Component
from eqt_cli.core.problems import Problems
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.over_time import GivenOverTime
from eqt_cli.mechanics.tracking import Gains, Tracking


@dataclass(frozen=True)
class RunsCode:
    """The C function that a law runs, by the names that a configuration gives.

    Attributes
    ----------
    file
        In which it is defined, relative to the configuration.
    prefix
        X of ``X_torque``, ``X_numbers``, ``X_memory`` and ``X_input``.
    numbers
        The fields of ``X_numbers`` that are given, and how many numbers each has.
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


@dataclass(frozen=True)
class Controller(GivenOverTime, Component):
    """A control law: a frozen dataclass whose fields are its options in a configuration.

    Every attribute that is a float is a runtime parameter: an engine may replace it by an array
    ``(runs, 1)`` or by a symbol, so a law uses it with operators only. It goes into a contraction,
    not before one: ``dot(self.k * z, z)``. What `dot` and `norm` return has no such last axis.

    Attributes
    ----------
    name
        As written in a configuration: ``eqt``.
    title
        As written in figures: ``EqT``. Default: the name.
    tasks
        The tasks of a configuration that it is for; none of code, which is for any.
    energy
        Its Lyapunov function, as text: ``½⟨P̃, Ṽ⟩ + Υ(Q_E)``.
    theorem
        Where that function is shown to fall; "" where nothing is claimed.
    matched
        Whether its stiffness and damping for small errors are the Hessian of Υ and K_d, as those
        of the paper's laws are, so that equal gains make a fair comparison. None: not known.
    claims_decrease
        Whether L is claimed to fall along every trajectory; None where the law does not say.
    departs
        In what a loop with it departs from those that theorems are about, in a few words.
    """

    title: ClassVar[str]
    tasks: ClassVar[tuple[str, ...]] = ("track",)
    energy: ClassVar[str] = "½⟨P̃, Ṽ⟩ + Υ(Q_E)"
    theorem: ClassVar[str] = "Theorems 3.2, 6.2"
    matched: ClassVar[bool | None] = None
    claims_decrease: ClassVar[bool | None] = None
    departs: ClassVar[str] = ""

    def __init_subclass__(cls, **options: Any) -> None:
        """A class with a torque of its own claims only what it says itself, not what it extends.

        And one with a name of its own has no title of another.
        """
        super().__init_subclass__(**options)
        if "name" in vars(cls) and "title" not in vars(cls):
            cls.title = cls.name
        if "torque" in vars(cls):
            for claim in {"claims_decrease", "dissipation", "matched", "feedforward_torque"} - set(
                vars(cls)
            ):
                setattr(cls, claim, vars(Controller)[claim])

    @property
    def attributes(self) -> dict[str, Any]:
        """Every attribute of the law by name, also a field that its class has fixed."""
        fixed = {field.name: getattr(self, field.name) for field in fields(self)}
        return fixed | vars(self)

    @property
    def structure(self) -> Hashable:
        """What of the law is not a runtime parameter; equal structures can be solved together."""
        options = {n: value for n, value in self.attributes.items() if not _is_parameter(value)}
        return type(self), tuple((name, repr(value)) for name, value in options.items())

    @property
    def parameters(self) -> dict[str, Array]:
        """The runtime parameters by name, scalars as arrays of shape (1,)."""
        numbers = {n: value for n, value in self.attributes.items() if _is_parameter(value)}
        return {name: np.atleast_1d(value) for name, value in numbers.items()}

    def claims(self, G: MatrixLieGroup, gains: Gains) -> bool | None:
        """As `claims_decrease`, with these gains."""
        return self.claims_decrease

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note what of the law or its options does not fit the group."""

    @abstractmethod
    def torque(self, s: Tracking) -> Array:
        """τ, body frame, ``(..., m)``."""

    def feedforward_torque(self, s: Tracking) -> Array | None:
        """The part of the torque without gains, body frame; None where the law does not say."""
        return None

    def lyapunov(self, s: Tracking) -> Array:
        """L, the function that the law claims to fall, ``(...)``: its own, as `energy` says."""
        return s.lyapunov

    def velocity_error(self, s: Tracking) -> Array:
        """y, the velocity at which a torque δ beside the law's raises L by ⟨δ, y⟩, ``(..., m)``."""
        return s.V_tilde

    def dissipation(self, s: Tracking) -> Array | None:
        """The power −dL/dt that the law takes out of L, ``(...)``; None where it is not known.

        It is integrated along with every run, so that L(t) + ∫dissipation = L(0) can be checked.
        """
        return None

    # A law that is no formula, but code of the user's own.

    @property
    def code(self) -> RunsCode | None:
        """The code that it runs; None where it is a formula."""
        return None

    def running(self, function: Any, G: MatrixLieGroup) -> Self:
        """The same law with its code as a function that can be called."""
        raise NotImplementedError(f"{self.name} runs no code")

    @property
    def formula(self) -> "Controller | None":
        """The law whose formulas hold of it: itself, or what its code claims to be."""
        return self

    def answer(self, s: Tracking, period: Any) -> tuple[Array, Mapping[str, Array]]:
        """The torque that it asks for at a control instant, and its memory a period later.

        A memory z goes on by ż for a period.
        """
        torque, rates = self.torque(s), self.memory_rate(s)
        return torque, {name: z + period * rates[name] for name, z in s.memory.items()}

    # A law with memory, such as an integral of the error, has states that are integrated too.

    def memory(self, G: MatrixLieGroup) -> Mapping[str, int]:
        """The law's own states: how many numbers each has, by name."""
        return {}

    def initial_memory(self, s: Tracking) -> Mapping[str, Array]:
        """The states at the start of a run, ``(..., length)`` each; all 0 unless given here.

        In `s` every one of them is 0.
        """
        return {}

    def memory_rate(self, s: Tracking) -> Mapping[str, Array]:
        """The time derivative of every one of the states, which are in `s.memory`."""
        return {}

    def memory_gradient(self, s: Tracking) -> Mapping[str, Array] | None:
        """∂L/∂z of every one of the states z; None where it is not known.

        With it the energy balance also holds where the states change at instants only.
        """
        return None


def _is_parameter(value: Any) -> bool:
    return isinstance(value, float | np.ndarray)
