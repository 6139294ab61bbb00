"""A law that is a C function of the user's own; it knows no compiler."""

import dataclasses
import re
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import Any, ClassVar, Literal, Self

import numpy as np

from eqt_cli.controllers.base import Controller, RunsCode
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import InputError, Remedy, TraceError
from eqt_cli.core.leaves import STRUCTURE
from eqt_cli.core.option_types import Real
from eqt_cli.core.problems import Problems
from eqt_cli.core.validation import component, shown
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.tracking import Gains, Tracking

TORQUE = "_torque"
"""How the names of functions end."""


@dataclass(frozen=True)
class Code(Controller):
    """A C function of your own, called at control instants, or by solve_ivp at any time.

    The file defines the types ``X_input``, ``X_numbers`` and ``X_memory`` and the function
    ``X_torque`` as `eqt export` writes them. If it defines ``X_start``, eqt calls that at the start
    of a run; else the memory starts at 0. Numbers that are not given are those of ``X_defaults`` if
    the file defines it, else 0; a field ``period`` is set to the period of control.

    Nothing is claimed of it unless `as` names a law: then it claims what that law claims, and
    `eqt verify` compares the two.

    Attributes
    ----------
    file
        The C file, relative to the configuration; files in quotes that it includes belong to it.
    function
        Its function, ``X_torque``. Default: the name of the file gives X.
    as_
        The law that it claims to be: a kind, or a mapping with `kind` and options.
    numbers
        Values of fields of ``X_numbers``: a number, or a list.
    memory_
        The fields of ``X_memory``, all of them.
    real
        The type of its numbers.
    """

    name: ClassVar[str] = "code"
    title: ClassVar[str] = "code"
    tasks: ClassVar[tuple[str, ...]] = ()

    file: str
    function: str | None = None
    as_: str | dict[str, Any] | None = None
    numbers: dict[str, Real | list[Real]] = field(default_factory=dict)
    memory_: list[str] = field(default_factory=list)
    real: Literal["double", "float"] = "double"
    values: Any = field(init=False, repr=False)
    claimed: Any = field(init=False, default=None, repr=False, metadata=STRUCTURE)
    called: Any = field(init=False, default=None, repr=False, metadata=STRUCTURE)

    def __post_init__(self) -> None:
        numbers = [value if isinstance(value, list) else [value] for value in self.numbers.values()]
        object.__setattr__(self, "values", np.array([x for row in numbers for x in row]))

    @property
    def structure(self) -> Hashable:
        """All but the numbers."""
        return type(self), self.code, repr(self.claimed), self.called

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note names that C does not know, and what is wrong with the law that is claimed."""
        for name in self.numbers:
            _check_name(name, problems.at("numbers", name))
        for index, name in enumerate(self.memory_):
            _check_name(name, problems.at("memory", index))
        if len(set(self.memory_)) < len(self.memory_):
            problems.at("memory").add(f"expected different names, got {shown(self.memory_)}")
        if self.function is not None:
            at_function = problems.at("function")
            _check_name(self.function, at_function)
            if not self.function.endswith(TORQUE):
                at_function.add(f"expected a name X{TORQUE}, got {shown(self.function)}")
        elif not is_name(self.prefix):
            problems.at("file").add(
                f"{self.file} gives no name in C; name the function with the key `function`"
            )
        if self.as_ is not None:
            from eqt_cli.controllers import controllers  # which finds this file

            claimed = component(controllers, self.as_, problems.at("as"), group=G)
            if claimed is not None and claimed.code is not None:
                problems.at("as").add("expected a law of eqt or of a plugin, got code")
            object.__setattr__(self, "claimed", claimed)

    # The code.

    @property
    def prefix(self) -> str:
        """X of ``X_torque``."""
        return PurePath(self.file).stem if self.function is None else self.function[: -len(TORQUE)]

    @property
    def code(self) -> RunsCode:
        """What it needs of the file."""
        counts = ((n, len(v) if isinstance(v, list) else 1) for n, v in self.numbers.items())
        return RunsCode(self.file, self.prefix, tuple(counts), tuple(self.memory_), self.real)

    def running(self, function: Any, G: MatrixLieGroup) -> Self:
        """With the compiled function.

        Raises
        ------
        InputError
            If it does not keep as much memory as the law that it claims to be.
        """
        # By its name, so that it is found under whatever name the file is kept.
        copy = dataclasses.replace(self, function=self.prefix + TORQUE)
        object.__setattr__(copy, "claimed", self.claimed)
        object.__setattr__(copy, "called", function)
        kept, claimed = sum(function.lengths.values()), self.claimed
        expected = sum(claimed.memory(G).values()) if claimed else kept
        if kept != expected:
            raise InputError(
                f"{self.prefix}_memory in {self.file} has {kept} numbers that are named in "
                f"`memory`, and {claimed.name} keeps {expected}: "
                f"{', '.join(f'{name} ({n})' for name, n in claimed.memory(G).items()) or 'none'}"
            )
        return copy

    @property
    def formula(self) -> Controller | None:
        """The law that it claims to be."""
        found: Controller | None = self.claimed
        return found

    def torque(self, s: Tracking) -> Array:
        """What the function returns."""
        return self.answer(s, 0.0)[0]

    def answer(self, s: Tracking, period: Any) -> tuple[Array, Mapping[str, Array]]:
        """One call of the function a run, which moves the memory on by itself."""
        inputs, numbers, memory = self._rows(s)
        torque, kept = self.called.torque(numbers, float(period), memory, inputs)
        return torque.reshape(s.P.shape), self._named(kept, s)

    def initial_memory(self, s: Tracking) -> Mapping[str, Array]:
        """What ``X_start`` sets, where there is one; else 0."""
        inputs, numbers, _ = self._rows(s)
        return self._named(self.called.started(numbers, 0.0, inputs), s)

    def memory(self, G: MatrixLieGroup) -> Mapping[str, int]:
        """That of the law which it claims to be, or the fields by their own names."""
        lengths: Mapping[str, int] = self.claimed.memory(G) if self.claimed else {}
        return lengths or dict(self.called.lengths)

    def _rows(self, s: Tracking) -> tuple[Array, Array, Array]:
        """Inputs, numbers and memory of all runs and samples, a row each."""
        batch = s.P.shape[:-1]
        parts = [
            np.asarray(s.t)[..., None],
            _flat(s.G, s.Q),
            s.V,
            _flat(s.G, s.Qd),
            s.Vd,
            s.Vd_dot,
        ]
        if any(part.dtype == object for part in parts):
            raise TraceError(
                f"{self.file} is code, which is called and not compiled into the loop",
                Remedy("set control.period, or use engine solve_ivp"),
            )
        # Before a run has begun, there is none.
        memory = [s.memory.get(name, np.zeros(n)) for name, n in self.memory(s.G).items()]
        inputs, numbers, kept = (
            np.concatenate([np.broadcast_to(p, (*batch, p.shape[-1])) for p in group], axis=-1)
            for group in (parts, [np.asarray(self.values)], [np.empty(0), *memory])
        )
        rows = int(np.prod(batch, dtype=int))
        return inputs.reshape(rows, -1), numbers.reshape(rows, -1), kept.reshape(rows, -1)

    def _named(self, kept: Array, s: Tracking) -> dict[str, Array]:
        """The memory of all runs by the names of its parts."""
        lengths = self.memory(s.G)
        parts = np.split(kept, np.cumsum(list(lengths.values()))[:-1], axis=-1) if lengths else []
        batch = s.P.shape[:-1]
        return {name: part.reshape(*batch, -1) for name, part in zip(lengths, parts, strict=True)}

    # What it claims.

    @property
    def energy(self) -> str:  # type: ignore[override]  # a constant of all other laws
        """L of the law that it claims to be."""
        return self.claimed.energy if self.claimed else Controller.energy

    @property
    def theorem(self) -> str:  # type: ignore[override]  # a constant of all other laws
        """Of the law that it claims to be."""
        return self.claimed.theorem if self.claimed else ""

    @property
    def matched(self) -> bool | None:  # type: ignore[override]  # a constant of all other laws
        """As the law that it claims to be."""
        return self.claimed.matched if self.claimed else None

    @property
    def claims_decrease(self) -> bool | None:  # type: ignore[override]  # a constant of others
        """As the law that it claims to be."""
        return self.claimed.claims_decrease if self.claimed else None

    def claims(self, G: MatrixLieGroup, gains: Gains) -> bool | None:
        """As the law that it claims to be."""
        return self.claimed.claims(G, gains) if self.claimed else None

    def feedforward_torque(self, s: Tracking) -> Array | None:
        """That of the law that it claims to be."""
        return self.claimed.feedforward_torque(s) if self.claimed else None

    def lyapunov(self, s: Tracking) -> Array:
        """L of the law that it claims to be."""
        return self.claimed.lyapunov(s) if self.claimed else s.lyapunov

    def velocity_error(self, s: Tracking) -> Array:
        """Of the law that it claims to be."""
        return self.claimed.velocity_error(s) if self.claimed else s.V_tilde

    def dissipation(self, s: Tracking) -> Array | None:
        """Of the law that it claims to be."""
        return self.claimed.dissipation(s) if self.claimed else None

    def memory_rate(self, s: Tracking) -> Mapping[str, Array]:
        """Of the law that it claims to be."""
        return self.claimed.memory_rate(s) if self.claimed else {}

    def memory_gradient(self, s: Tracking) -> Mapping[str, Array] | None:
        """Of the law that it claims to be."""
        return self.claimed.memory_gradient(s) if self.claimed else None


def _check_name(name: str, problems: Problems) -> None:
    if not is_name(name):
        problems.add(f"expected a name in C, got {shown(name)}")


def is_name(text: str) -> bool:
    """Whether a text can be a name in C."""
    return re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", text) is not None


def _flat(G: MatrixLieGroup, pose: Array) -> Array:
    """The entries of poses, row by row."""
    return pose.reshape(*pose.shape[:-2], G.size**2)
