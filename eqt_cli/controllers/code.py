"""A law that runs a C function of the user."""

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
"""Suffix of the function's name."""


@dataclass(frozen=True)
class Code(Controller):
    """A C function of your own, called at control instants, or by solve_ivp at any time.

    The file defines the types ``X_input``, ``X_numbers`` and ``X_memory`` and the function
    ``X_torque`` as `eqt export` writes them. If it defines ``X_start``, eqt calls that at the start
    of a run; otherwise the memory starts at 0. Numbers that are not given are those of
    ``X_defaults`` if the file defines it, otherwise 0. A field ``period`` is set to the period of
    control.

    It claims nothing unless `as` names a law. Then it claims what that law claims, and `eqt verify`
    compares the two.

    Attributes
    ----------
    file
        The C file, relative to the configuration; files that it includes in quotes belong to it.
    function
        Its function, ``X_torque``. Default: the name of the file gives X.
    as_
        The law that it claims to implement: a kind, or a mapping with `kind` and options.
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
        """Note invalid C names, and errors of the law that it claims to be."""
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
            from eqt_cli.controllers import controllers  # the registry imports this file

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
        """The function, and its numbers and memory."""
        counts = ((n, len(v) if isinstance(v, list) else 1) for n, v in self.numbers.items())
        return RunsCode(self.file, self.prefix, tuple(counts), tuple(self.memory_), self.real)

    def running(self, function: Any, G: MatrixLieGroup) -> Self:
        """Return the law with the compiled function.

        Raises
        ------
        InputError
            If its memory has another size than that of the law that it claims to be.
        """
        # The function's name must not depend on the file's name, which a result changes.
        copy = dataclasses.replace(self, function=self.prefix + TORQUE)
        object.__setattr__(copy, "claimed", self.claimed)
        object.__setattr__(copy, "called", function)
        length, claimed = sum(function.lengths.values()), self.claimed
        expected = sum(claimed.memory(G).values()) if claimed else length
        if length != expected:
            raise InputError(
                f"{self.prefix}_memory in {self.file} has {length} numbers that are named in "
                f"`memory`, and {claimed.name} keeps {expected}: "
                f"{', '.join(f'{name} ({n})' for name, n in claimed.memory(G).items()) or 'none'}"
            )
        return copy

    @property
    def formula(self) -> Controller | None:
        """The law that it claims to be."""
        claimed: Controller | None = self.claimed
        return claimed

    def torque(self, s: Tracking) -> Array:
        """Return the torque of one call of the function."""
        return self.answer(s, 0.0)[0]

    def answer(self, s: Tracking, period: Any) -> tuple[Array, Mapping[str, Array]]:
        """Call the function once per run; the function updates the memory."""
        inputs, numbers, memory = self._rows(s)
        torque, updated = self.called.torque(numbers, float(period), memory, inputs)
        return torque.reshape(s.P.shape), self._named(updated, s)

    def initial_memory(self, s: Tracking) -> Mapping[str, Array]:
        """Return the memory that ``X_start`` sets, if there is one, otherwise 0."""
        inputs, numbers, _ = self._rows(s)
        return self._named(self.called.started(numbers, 0.0, inputs), s)

    def memory(self, G: MatrixLieGroup) -> Mapping[str, int]:
        """Return the memory of the law that it claims to be, or the fields by their names."""
        lengths: Mapping[str, int] = self.claimed.memory(G) if self.claimed else {}
        return lengths or dict(self.called.lengths)

    def _rows(self, s: Tracking) -> tuple[Array, Array, Array]:
        """Return inputs, numbers and memory, with a row for each run and sample."""
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
        # There is no memory before a run begins.
        memory = [s.memory.get(name, np.zeros(n)) for name, n in self.memory(s.G).items()]
        inputs, numbers, values = (
            np.concatenate([np.broadcast_to(p, (*batch, p.shape[-1])) for p in group], axis=-1)
            for group in (parts, [np.asarray(self.values)], [np.empty(0), *memory])
        )
        rows = int(np.prod(batch, dtype=int))
        return inputs.reshape(rows, -1), numbers.reshape(rows, -1), values.reshape(rows, -1)

    def _named(self, memory: Array, s: Tracking) -> dict[str, Array]:
        """Return the memory of all runs by the names of its parts."""
        lengths = self.memory(s.G)
        parts = np.split(memory, np.cumsum(list(lengths.values()))[:-1], axis=-1) if lengths else []
        batch = s.P.shape[:-1]
        return {name: part.reshape(*batch, -1) for name, part in zip(lengths, parts, strict=True)}

    # The claims.

    @property
    def energy(self) -> str:  # type: ignore[override]  # a constant of all other laws
        """L of the law that it claims to be."""
        return self.claimed.energy if self.claimed else Controller.energy

    @property
    def theorem(self) -> str:  # type: ignore[override]  # a constant of all other laws
        """As for the law that it claims to be."""
        return self.claimed.theorem if self.claimed else ""

    @property
    def matched(self) -> bool | None:  # type: ignore[override]  # a constant of all other laws
        """As for the law that it claims to be."""
        return self.claimed.matched if self.claimed else None

    @property
    def claims_decrease(self) -> bool | None:  # type: ignore[override]  # a constant of others
        """As for the law that it claims to be."""
        return self.claimed.claims_decrease if self.claimed else None

    def claims(self, G: MatrixLieGroup, gains: Gains) -> bool | None:
        """As for the law that it claims to be."""
        return self.claimed.claims(G, gains) if self.claimed else None

    def feedforward_torque(self, s: Tracking) -> Array | None:
        """As for the law that it claims to be."""
        return self.claimed.feedforward_torque(s) if self.claimed else None

    def lyapunov(self, s: Tracking) -> Array:
        """L of the law that it claims to be."""
        return self.claimed.lyapunov(s) if self.claimed else s.lyapunov

    def velocity_error(self, s: Tracking) -> Array:
        """As for the law that it claims to be."""
        return self.claimed.velocity_error(s) if self.claimed else s.V_tilde

    def dissipation(self, s: Tracking) -> Array | None:
        """As for the law that it claims to be."""
        return self.claimed.dissipation(s) if self.claimed else None

    def memory_rate(self, s: Tracking) -> Mapping[str, Array]:
        """As for the law that it claims to be."""
        return self.claimed.memory_rate(s) if self.claimed else {}

    def memory_gradient(self, s: Tracking) -> Mapping[str, Array] | None:
        """As for the law that it claims to be."""
        return self.claimed.memory_gradient(s) if self.claimed else None


def _check_name(name: str, problems: Problems) -> None:
    if not is_name(name):
        problems.add(f"expected a name in C, got {shown(name)}")


def is_name(text: str) -> bool:
    """Whether a text can be a name in C."""
    return re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", text) is not None


def _flat(G: MatrixLieGroup, pose: Array) -> Array:
    """Return the entries of poses, row by row."""
    return pose.reshape(*pose.shape[:-2], G.size**2)
