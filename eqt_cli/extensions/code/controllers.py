"""A law that runs a C function of the user: read, compiled and tried out before any run."""

import os
import re
from collections.abc import Hashable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path, PurePath
from typing import Any, ClassVar, Literal, Self

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array, Arrays, apply_matrix, dot, transpose
from eqt_cli.base.errors import EqtError, InputError, KeyPath, Problems, Remedy, TraceError
from eqt_cli.base.files import text_of
from eqt_cli.base.option_types import Kind, Real, as_section, shown
from eqt_cli.base.registry import Keys
from eqt_cli.base.stored import THRUSTER
from eqt_cli.base.units import size_of
from eqt_cli.base.yaml_source import load
from eqt_cli.components import matrix_groups
from eqt_cli.components.actuators import THRUSTS
from eqt_cli.components.derived import coordinates_of
from eqt_cli.components.groups import MatrixLieGroup, Part, command_axes
from eqt_cli.components.laws import (
    CodeCall,
    CodeFile,
    Controller,
    Preview,
    Previews,
    RunsCode,
    check_flat_output,
    check_foreseen,
    controllers,
    counteracts,
    with_defaults,
)
from eqt_cli.components.mechanics import LATER, NOT_IN_CODE, Gains, LawInput, Tracking
from eqt_cli.components.motions import ORDER, PlantModel
from eqt_cli.config.document import Document, Place, changed_at, remember_executed, trusted_text
from eqt_cli.extensions.code.user_code import UserCode, called, gathered, is_gathered
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.loop.law_program import Entry
from eqt_cli.loop.signals import Metric
from eqt_cli.numbers.leaves import STRUCTURE, leaves, with_fields
from eqt_cli.numbers.running import SampledRuns

# Inputs and outputs of code, in its names, frames, orders and units -------------------------------


Order = Literal["matrix", "columns", "quaternion wxyz", "quaternion xyzw", "roll-pitch-yaw"]


@dataclass(frozen=True)
class Signal(Keys):
    """A signal as code has it: sign times scale times its value, in a frame, order and unit.

    Attributes
    ----------
    signal
        What a law reads, or a part of it: pose, velocity.rotation, position.
    as_
        Order of a rotation: matrix, columns (its transpose), quaternion wxyz, quaternion xyzw, or
        roll-pitch-yaw (R = R_z R_y R_x).
    frame
        Frame of a vector: body, desired (of Q_d) or space. Default: as in eqt.
    unit
        Such as deg/s.
    scale, sign
        A factor, and a sign or one for each axis, or for each angle; a rotation R is S R S.
    torque
        The output in Python, as an expression of `result` and the inputs.
    per
        With `inertia`, the output is an acceleration, and the torque is 𝕀 times it.
    """

    signal: str = ""
    as_: Order = "matrix"
    frame: Literal["body", "desired", "space"] | None = None
    unit: str | None = None
    scale: Real = 1.0
    sign: Real | list[Real] = 1.0
    torque: str = "result"
    per: Literal["inertia"] | None = None

    @property
    def factor(self) -> Array:
        """What the code has of 1, in units of eqt."""
        if (size := size_of(self.unit or "1")) is None:
            raise InputError(f"expected a unit such as deg/s, got {self.unit}")
        return np.asarray(self.sign) * self.scale / size[0]

    def check_read(self, G: MatrixLieGroup, x: LawInput, problems: Problems) -> None:
        """Note an unknown signal, a wrong factor, and keys that mean nothing of this signal."""
        with problems.catching("signal"):
            name, part, where, eqt_frame = self._place(G, x)
            vain = {"as_": "rotations"} if eqt_frame else {"frame": "vectors"}
            if not eqt_frame and self.as_ != "roll-pitch-yaw":
                vain |= dict.fromkeys(("unit", "scale"), "vectors and angles")
            for key, kind in vain.items():
                if getattr(self, key) != getattr(Signal(), key):
                    problems.at(key.rstrip("_")).add(f"is for {kind}; remove this key")
            value: Array = np.asarray(getattr(x, name))[where]
            self.check_factor(value.shape[-1] if value.ndim > 1 else 1, problems)
            if not eqt_frame and self.as_ not in ("matrix", "columns") and part.dimension == 1:
                problems.at("as").add(f"{G.name} turns by one angle; use matrix or columns")

    def check_factor(self, size: int, problems: Problems) -> None:
        """Note an unknown unit, and a scale or signs of another number of axes, or of 0."""
        with problems.catching("unit"):
            _ = self.factor
        if self.scale == 0:
            problems.at("scale").add("expected a number other than 0")
        signs = self.sign if isinstance(self.sign, list) else [self.sign]
        if len(signs) not in (1, size) or 0 in signs:
            several = f", or a list of {size}" if size > 1 else ""
            problems.at("sign").add(f"expected 1 or -1{several}, got {shown(self.sign)}")

    def values(self, G: MatrixLieGroup, x: LawInput) -> Array:
        """Return the signal as code reads it, ``(..., *shape)``."""
        name, part, where, eqt_frame = self._place(G, x)
        value: Any = np.asarray(getattr(x, name), dtype=float)[where]
        if name in LATER:  # its desired frame is that of its own time
            x = x._replace(pose=x.pose[..., None, :, :], desired_pose=x.later_pose)
        if not eqt_frame:
            return self._ordered(part, value)
        return self.factor * turned(G, x, value, eqt_frame, self.frame)

    def read(self, G: MatrixLieGroup, x: LawInput, value: Array) -> LawInput:
        """Return the input with this signal from what code has of it; inverts `values`."""
        name, part, where, eqt_frame = self._place(G, x)
        whole = np.array(getattr(x, name))
        if not eqt_frame:
            value = self.rotation(value)
            where = where if value.shape == whole.shape else (..., *part.entries)
        else:
            value = turned(G, x, value / self.factor, self.frame or eqt_frame, eqt_frame)
        whole[where] = value
        return x._replace(**{name: whole})

    def _place(self, G: MatrixLieGroup, x: LawInput) -> tuple[str, Part, tuple[Any, ...], str]:
        """Return the input, its part, where that is, and its frame in eqt; none of a rotation."""
        name, _, which = self.signal.partition(".")
        part = next((pose_part for pose_part in G.parts if which in ("", pose_part.name)), None)
        flat = ("position", "heading") if np.size(x.position) else ()  # of rigid motions alone
        absent = {*NOT_IN_CODE, "position", "heading"} - {*flat}
        fields = [name for name in x._fields if name not in absent and getattr(x, name) is not None]
        if part is None or name not in fields:
            names = ", ".join(fields)
            raise InputError(f"expected {names}, or a part, got {shown(self.signal)}")
        if name.endswith("pose"):
            rows, columns = part.entries if which else (slice(None), slice(0, None))
            if part.turns:
                return name, part, (..., rows, columns), ""
            return name, part, (..., rows, columns.start), "space"
        of_velocity = "desired" if name.startswith(("desired", "later")) else "body"
        eqt_frame = "space" if name.endswith("position") else of_velocity
        return name, part, (..., part.axes) if which else (...,), eqt_frame

    def words(self, unit: str) -> str:
        """Return what differs from eqt's, whose unit is given."""
        plain = None, 1.0, "matrix", "result", self.signal, self.unit
        said = [
            f"{k.rstrip('_')} {value}" for k, value in asdict(self).items() if value not in plain
        ]
        unit = "rad" if self.as_ == "roll-pitch-yaw" else unit
        return ", ".join([self.unit or unit, *self.signal.split(".")[1:], *said])

    def rotation(self, value: Array) -> Array:
        """Return the rotation that code has as a value."""
        if self.as_ == "roll-pitch-yaw":
            return matrix_groups.rotation_of_euler("xyz", value / self.factor)
        if self.as_.startswith("quaternion"):  # of any length
            q = np.roll(value, -(self.as_[-4] == "w"), -1)
            value = matrix_groups.rotation_of_quaternion(q) / dot(q, q)[..., None, None]
        value = transpose(value) if self.as_ == "columns" else value
        return value * np.outer(*2 * [np.broadcast_to(self.sign, value.shape[-1])])

    def _ordered(self, part: Part, R: Array) -> Array:
        if self.as_ == "roll-pitch-yaw":
            return coordinates_of(part, R, lambda rotation: rotation.as_euler("xyz") * self.factor)
        R = R * np.outer(*2 * [np.broadcast_to(self.sign, R.shape[-1])])
        if self.as_.startswith("quaternion"):
            return coordinates_of(part, R, lambda q: np.roll(q.as_quat(), self.as_[-4] == "w", -1))
        return transpose(R) if self.as_ == "columns" else R

    def torque_of(self, s: Tracking, returned: Array) -> Array:
        """Return the torque in the body frame, ``(..., m)``."""
        back = returned / self.factor
        torque = turned(s.G, LawInput.of(s), back, self.frame or "body", "body")
        return s.inertia.momentum(torque) if self.per else torque

    def returned(self, s: Tracking, torque: Array) -> Array:
        """Return what code returns for a torque; inverts `torque_of`."""
        back = s.inertia.velocity(torque) if self.per else torque
        return self.factor * turned(s.G, LawInput.of(s), back, "body", self.frame)


@dataclass(frozen=True)
class Output(Signal):
    """What code returns: a torque, some of its directions, or thrusts of rotors.

    Attributes
    ----------
    as_
        rotors: thrusts, which go to the rotors as they are, within their limits.
    order
        Names of what it returns, in order: directions, as `torque x`, of which the others are 0;
        of rotors, their names in `actuators`, or their numbers from 1. Default: all directions.
    thrust
        Of rotors, [c₀, c₁, c₂]: the thrust is c₀ + c₁ y + c₂ y², N, of a number y.
    """

    as_: Literal["matrix", "rotors"] = "matrix"  # type: ignore[assignment]
    order: list[str | int] | None = None
    thrust: list[Real] | None = None

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note directions that are unknown or twice there, and keys of rotors alone."""
        is_rotors, order = self.as_ == "rotors", self.order or []
        if is_rotors and not order:
            problems.at("order").add("missing; name the rotors in the order of the output")
        for index, name in enumerate(order):
            if not is_rotors and name not in command_axes(G):
                expected = f"expected one of {', '.join(command_axes(G))}"
                problems.at("order", index).add(f"{expected}, got {shown(name)}")
            elif name in order[:index]:
                problems.at("order", index).add(f"{shown(name)} is named twice")
        if self.thrust is not None and (not is_rotors or len(self.thrust) != 3):
            problems.at("thrust").add("expected [c0, c1, c2], with as: rotors")
        if order and (self.frame or self.per):
            problems.add("frame and per apply to a whole torque; remove them, or order")
        if self.signal:
            problems.at("signal").add("is for inputs; remove this key")
        self.check_factor(len(order) or G.dimension, problems)

    def matrix(self, G: MatrixLieGroup, plant: PlantModel, problems: Problems) -> Array | None:
        """Return the matrix from what it returns to the command; None for 1."""
        if self.order is None:
            return None
        if self.as_ != "rotors":
            return np.eye(G.dimension)[:, [command_axes(G).index(str(name)) for name in self.order]]
        parts = (
            actuator.members[THRUSTER]
            for actuator in plant.actuators
            if THRUSTER in actuator.members
        )
        rotors = next(parts, ())
        rotor_of = {**dict(enumerate(rotors, 1)), **dict(zip(rotors, rotors, strict=True))}
        if not rotors:
            problems.add("as: rotors, and actuators has no thrusters")
        for index, name in enumerate(self.order if rotors else ()):
            if name not in rotor_of:
                expected = f"expected one of {', '.join(rotors)}, or their numbers"
                problems.at("order", index).add(f"{expected}, got {shown(name)}")
        if not problems and len({rotor_of[name] for name in self.order}) < len(rotors):
            problems.at("order").add(f"expected each of {', '.join(rotors)} once")
        if problems:
            return None
        places = [G.dimension + rotors.index(rotor_of[name]) for name in self.order]
        return np.eye(G.dimension + len(rotors))[:, places]

    def thrusts(self, values: Array) -> Array:
        """Return the thrusts of rotors, N."""
        y = values / self.factor
        if self.thrust is None:
            return y
        c0, c1, c2 = self.thrust
        return c0 + (c1 + c2 * y) * y


@purposes.signal_of_code
def signal_of_code(**keys: Any) -> Signal:
    """Return a signal by its keys."""
    return Signal(**keys)


def turned(G: MatrixLieGroup, x: LawInput, value: Array, by: str, to: str | None) -> Array:
    """Return vectors of one frame in another one; numbers stay as they are."""
    block: Any = next((part.entries for part in G.parts if part.turns), None)
    if to not in (None, by) and block and value.shape[-1] > 1:
        for frame in (by, to):
            if frame != "space":
                pose = x.pose if frame == "body" else x.desired_pose
                R = pose[(..., *block)] if frame == by else transpose(pose[(..., *block)])
                vectors = value.reshape(*R.shape[:-2], -1, R.shape[-1])
                value = apply_matrix(R[..., None, :, :], vectors).reshape(value.shape)
    return value


@dataclass(frozen=True)
class Adapter(Keys):
    """The names that code has for what it reads, and what it returns.

    Attributes
    ----------
    inputs
        Each name with its `Signal`. Default: those of code without an adapter.
    call
        In Python, the call as an expression, with the inputs, the numbers and `self`.
    """

    inputs: dict[str, Signal] = field(default_factory=dict)
    output: Output = Output()
    call: str | None = None

    def entries(self, G: MatrixLieGroup, units: Mapping[str, str]) -> Iterator[Entry]:
        """Yield what C reads in place of the known input of a law, whose units are given."""
        first = first_inputs(G)
        for name, source in self.inputs.items():
            of, shape = source.signal.partition(".")[0], source.values(G, first).shape[1:]
            yield Entry(name, shape, of, source.words(units.get(of, "")))

    def read(self, G: MatrixLieGroup, x: LawInput, values: Arrays) -> LawInput:
        """Return the input of a law from what code has of it."""
        for name, signal in 2 * list(self.inputs.items()):  # first the pose, by which others turn
            x = signal.read(G, x, values[name])
        return x


BESIDE = ".adapter.yaml"
"""Ending of the adapter next to ours.py, ``ours.adapter.yaml``."""


@purposes.adapter_of_code
def adapter_of(file: Path, G: MatrixLieGroup) -> Adapter | None:
    """Return the adapter in a file, for C; raises an `EqtError` where it is none."""
    adapter = adapter_in(file, G, {"kind": "code", "file": "law"})
    if adapter and adapter.output.order:
        raise InputError(f"{file}: output.order: is for laws that fly; export all of a torque")
    return adapter


def adapter_in(file: Path, G: MatrixLieGroup, options: Mapping[str, Any]) -> Adapter | None:
    """Return the adapter in a file, for a law with these options; errors are at their place."""
    source = load(text_of(file, "it is an adapter", InputError), str(file))
    at = Problems(lambda path: source.key_place(path[1:]))  # below `adapter` of the law
    law: Code = Kind(controllers).checked({**options, "adapter": source.data}, at, G)
    at.raise_if_any()
    return law.adapter


# A law that runs a function of the user -----------------------------------------------------------


TORQUE = "_torque"
"""Suffix of the function's name."""

MOST_RUNS = 32
"""Most runs whose objects are called side by side in a thread: an idle process of one takes 2 MB of
its own with NumPy, and what the object takes."""

OF_CASADI = "a function of CasADi needs an adapter that names its inputs, and keeps nothing"

CASADI = "casadi:"
"""Prefix of the name of a function that CasADi generated."""

LAST, FAILED = ".last_command", "failed_calls"
"""Memory of a law that may fail: the command that is held, and how often it has failed."""


class _Numbers(Controller):
    numbers: dict[str, Real | list[Real]]

    @cached_property
    def values(self) -> Array:
        """The numbers one after the other, which may differ from run to run."""
        rows = [value if isinstance(value, list) else [value] for value in self.numbers.values()]
        return np.array([x for row in rows for x in row])


@dataclass(frozen=True)
class Code(_Numbers, RunsCode, Previews):
    """Your own function in C, C++ or Python, called at control instants, or by solve_ivp.

    The file defines the types ``X_input``, ``X_numbers`` and ``X_memory`` and the function
    ``X_torque`` as `eqt export` writes them. If it defines ``X_start``, eqt calls that at the start
    of a run; otherwise the memory starts at 0. Numbers that are not given are those of
    ``X_defaults`` if the file defines it, otherwise 0. A field ``period`` is set to the period of
    control.

    In Python, the function takes the names of an input, or those of an adapter. It is called in a
    process of its own, in which it keeps no files, network or other processes. Memory is what the
    object keeps.

    It claims nothing unless `as` names a law. Then it claims what that law claims, and `eqt verify`
    compares the two.

    Attributes
    ----------
    file
        The file, relative to the configuration, with the files that it includes in quotes.
    function
        Its function, ``X_torque`` (default: X is the name of the file); in Python, ``compute`` or
        ``Law(2.0).compute``; of C that CasADi generated, ``casadi:f``, whose inputs the adapter
        names.
    adapter
        The code's conventions: `inputs` (each with `signal`, `as`, `frame`, `unit`, `scale`,
        `sign`), `output` and, in Python, `call`. An output `{as: rotors, order: [1, 2, 3, 4]}` is
        thrusts, `{order: [force z, torque x]}` these directions.
    as_
        The law that it should implement: a kind, or a mapping with `kind` and options.
    numbers
        Values of fields of ``X_numbers``: a number, or a list.
    memory_
        All fields of ``X_memory``.
    real
        The type of its numbers.
    object_
        In Python, `per run`: each run makes its own object, and calls it in the order of time.
    on_failure
        The command of a failed call (it raises, returns None or, as ``int X_torque``, not 0):
        `hold` the last command (default), `zero`, or `stop` the run. With `as`, it stops.
    preview_
        The law also gets the reference at `steps` later times, `every` apart, as `later_pose`,
        `later_velocity` and `later_torque` (τ_d), and where it names it, `later_position`.
    """

    name: ClassVar[str] = "code"

    file: str
    function: str | None = None
    as_: str | dict[str, Any] | None = None
    numbers: dict[str, Real | list[Real]] = field(default_factory=dict)
    memory_: list[str] = field(default_factory=list)
    real: Literal["double", "float"] = "double"
    adapter: Adapter | None = None
    preview_: Preview | None = field(default=None, metadata=STRUCTURE)
    object_: Literal["per run"] | None = None
    on_failure: Literal["hold", "zero", "stop"] | None = None
    values: Any = field(init=False, repr=False)
    claimed: Any = field(init=False, default=None, repr=False, metadata=STRUCTURE)
    forces: Any = field(init=False, default=(), repr=False, metadata=STRUCTURE)
    called: Any = field(init=False, default=None, repr=False, metadata=STRUCTURE)
    holds: bool = field(init=False, default=False, repr=False, metadata=STRUCTURE)
    flies: bool = field(init=False, default=True, repr=False, metadata=STRUCTURE)
    placed: Any = field(init=False, default=None, repr=False, metadata=STRUCTURE)

    @property
    def commands(self) -> str:  # type: ignore[override]  # a constant of most laws
        """Thrusts of rotors; otherwise the code does not say."""
        return THRUSTS if self._adapted.output.as_ == "rotors" else ""

    @property
    def structure(self) -> Hashable:
        """All but the numbers."""
        options = self.claimed, self.adapter, self.preview, self.object_, self.on_failure
        return type(self), self.code, repr(options), self.called

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note invalid C names, and errors of the law that it claims to be."""
        for name in self.numbers:
            _check_name(name, problems.at("numbers", name))
        for index, name in enumerate(self.memory_):
            _check_name(name, problems.at("memory", index))
        self._check_adapter(G, problems.at("adapter"))
        if len(set(self.memory_)) < len(self.memory_):
            problems.at("memory").add(f"expected different names, got {shown(self.memory_)}")
        self._check_calls(problems)
        if self._casadi:
            _check_name(self.prefix, problems.at("function"))
            if self.memory_:
                problems.at("memory").add(OF_CASADI)
        elif self.function is not None and not self.code.is_python:
            at_function = problems.at("function")
            _check_name(self.function, at_function)
            if not self.function.endswith(TORQUE):
                at_function.add(f"expected a name X{TORQUE}, got {shown(self.function)}")
        elif not is_name(self.prefix) and not self.code.is_python:
            problems.at("file").add(
                f"{self.file} gives no name in C; name the function with the key `function`"
            )
        self.law_of(G, problems)

    def _first_inputs(self, G: MatrixLieGroup) -> LawInput:
        return first_inputs(G, self.preview_.steps if self.preview_ else 0)

    def _check_adapter(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note errors of what the code is given, and of what it returns."""
        first = self._first_inputs(G)
        if self.adapter:
            for name, signal in self.adapter.inputs.items():
                if not self.code.is_python:
                    _check_name(name, problems.at("inputs", name))
                signal.check_read(G, first, problems.at("inputs", name))
        self._adapted.output.check(G, problems.at("output"))

    def _check_calls(self, problems: Problems) -> None:
        """Note options of memory and failures that exclude each other."""
        if self._adapted.output.order and self.as_ is not None:
            problems.at("as").add("needs code that returns a whole torque; leave this or order out")
        if self.object_ and self.memory_:
            problems.at("memory").add("the object of a run keeps all that it has; leave this out")
        if self.object_ and not self.code.is_python:
            problems.at("object").add("is for Python; in C, name what it keeps in `memory`")
        if self.on_failure and self.as_ is not None:
            problems.at("on_failure").add("a law in `as` never fails; leave this or `as` out")

    def law_of(self, G: MatrixLieGroup, problems: Problems) -> Controller | None:
        """Return the law that it claims to be, after noting its errors."""
        if self.as_ is None:
            return None
        law = Kind(controllers).checked(self.as_, problems.at("as"), G)
        if not isinstance(law, RunsCode):
            return law and law.loaded(None, G, problems)[0]
        problems.at("as").add("expected a law of eqt or of a plugin, got code")
        return None

    @property
    def prefix(self) -> str:
        """X of ``X_torque``, or the function in Python."""
        if self.file.endswith(".py") or self._casadi:
            return (self.function or "").removeprefix(CASADI)
        return PurePath(self.file).stem if self.function is None else self.function[: -len(TORQUE)]

    @property
    def _casadi(self) -> bool:
        return (self.function or "").startswith(CASADI)

    @property
    def code(self) -> CodeFile:
        """The function, and its numbers and memory."""
        counts = ((n, len(v) if isinstance(v, list) else 1) for n, v in self.numbers.items())
        return CodeFile(self.file, self.prefix, tuple(counts), tuple(self.memory_), self.real)

    def loaded(
        self, home: Place, G: MatrixLieGroup, problems: Problems
    ) -> tuple[Self | None, dict[str, str]]:
        """Return the law with the compiled function, which was tried out, and the text of its file.

        None after a problem.
        """
        if problems:
            return None, {}
        beside = (home.folder / self.file).with_suffix(BESIDE)
        if self.adapter is None and home.plugins is None and not home.is_result:
            with problems.catching("adapter"):
                if beside.is_file():
                    adapter = adapter_in(beside, G, as_section(self))
                    return with_fields(self, adapter=adapter).loaded(home, G, problems)
        if self._casadi and not self.adapter:
            problems.at("adapter").add(OF_CASADI)
        if problems:
            return None, {}
        with problems.catching("file"):
            is_c = not self.code.is_python
            text = trusted_text(home, self.file, "C file" if is_c else "Python file")
            if is_c and home.plugins is None and not is_gathered(text):
                text = gathered(home.folder / self.file)
                if not home.is_result:
                    remember_executed(text)  # a result stores this text
        if problems:
            return None, {}
        with problems.catching():
            steps = self.preview_.steps if self.preview_ else 0
            space, first = G.space if matrix_groups.rigid_motions(G) else 0, self._first_inputs(G)
            reads = self._adapted.inputs.items()
            shapes = tuple((name, source.values(G, first).shape[1:]) for name, source in reads)
            of_group: Any = {"entries": G.size**2, "axes": G.dimension, "space": space}
            returns = len(self._adapted.output.order or range(G.dimension))
            of_group |= {"steps": steps, "casadi": self._casadi, "returns": returns}
            code = UserCode(text=text, adapted=shapes, **of_group, **asdict(self.code))
            law = with_fields(self, claimed=self.law_of(G, problems))
            numbers, rows = leaves(self).get("values", np.empty(0)), law.reading(G, first, code)
            how: Any = {"per_run": bool(self.in_order), "repeats": not self.in_order}
            how |= {"call": self._adapted.call, "torque": self._adapted.output.torque}
            return law.calling(called(code, numbers, PERIOD, rows, how), G), {self.file: text}
        return None, {self.file: text}

    def calling(self, function: Any, G: MatrixLieGroup) -> Self:
        """Return the law with the compiled function.

        Raises
        ------
        InputError
            If its memory has another size than the memory of the law that it claims to be.
        """
        length, claimed = sum(function.lengths.values()), self.claimed
        expected = sum(claimed.memory(G).values()) if claimed else 0
        if length != expected and expected:  # code with memory may claim to be a law without
            raise InputError(
                f"{self.prefix}_memory in {self.file} has {length} numbers that are named in "
                f"`memory`, and {claimed.name} keeps {expected}: "
                f"{', '.join(f'{name} ({n})' for name, n in claimed.memory(G).items())}"
            )
        # The function's name must not depend on the file's name, which a result changes.
        named = self.function if self._casadi else self.code.function
        return with_fields(self, function=named, called=function)

    @property
    def formula(self) -> Controller | None:
        """The law that it claims to be."""
        return self.claimed

    @property
    def _adapted(self) -> Adapter:
        named = LawInput._fields[:6] + LATER[: 3 * (self.preview_ is not None)]
        inputs = {name: Signal(name) for name in (named if self.code.is_python else ())}
        if self.adapter is None:
            return Adapter(inputs)
        return self.adapter if self.adapter.inputs else replace(self.adapter, inputs=inputs)

    def reading(self, G: MatrixLieGroup, x: LawInput, code: UserCode) -> Array:
        """Return what the code reads, with a row for each run and sample.

        At states without a reference, as random ones, it goes on at its velocity: Q_d exp(s V_d).
        """
        if self.preview_ and x.later_pose is None and x.velocity.dtype != object:
            V, k = x.desired_velocity[..., None, :], len(self.preview)
            ahead = x.desired_pose[..., None, :, :] @ G.exp(np.array(self.preview)[:, None] * V)
            V, p = np.repeat(V, k, axis=-2), x.position
            p = None if p is None else np.repeat(p[..., None, :, :], k, axis=-3)
            x = x._replace(later_pose=ahead, later_velocity=V, later_torque=0 * V, later_position=p)
        if not code.adapted or x.velocity.dtype == object:
            return x.velocity if code.adapted else x.rows(code.inputs)
        x = x._replace(t=np.broadcast_to(x.t, x.velocity.shape[:-1]))
        parts = zip(self._adapted.inputs.values(), code.inputs.values(), strict=True)
        return np.hstack([signal.values(G, x).reshape(-1, size) for signal, size in parts])

    @property
    def code_call(self) -> CodeCall | None:
        """The compiled function, with these numbers; None where it needs Python."""
        if self.called.code.adapted or self.holds or self.placed is not None:
            return None
        return CodeCall(
            self.called.eqt_code, 0, tuple(self.called.code.inputs), np.asarray(self.values)
        )

    def answer(self, s: Tracking, period: Any) -> tuple[Array, Arrays]:
        """Call the function once per run; the function updates the memory."""
        inputs, numbers, memory = self.rows(s)
        call = self.called.call_in_runs if self.flies else self.called.call
        command, updated, *lost = call(0, numbers, float(period), memory, inputs)
        torque, later = self._command(s, command), self._named(updated, s)
        if self.holds:
            failed = ~np.isfinite(torque).all(axis=-1, keepdims=True)
            failed &= ~lost[0].reshape(failed.shape)  # such a run ends
            latest, count = (s.memory.get(name, np.zeros(1)) for name in (LAST, FAILED))
            if failed.any() and self.code.is_python and self.on_failure != "stop":
                self.called.processes.tell()
            if self.on_failure != "stop":
                torque = np.where(failed, 0.0 if self.on_failure == "zero" else latest, torque)
            later |= {LAST: torque, FAILED: count + failed}
        return torque, later

    @property
    def decisions(self) -> tuple[Any, ...] | None:
        """The decisions in the code; None where the compiler cannot watch them."""
        return self.called.code.decisions[1] if self.called.watching else None

    def watched(self, s: Tracking, period: float) -> tuple[Array, Array, Array]:
        """Return the torque, and of each decision its outcome and how far that was away."""
        inputs, numbers, memory = self.rows(s)
        torque, *outcomes = self.called.watching.outcomes(numbers, float(period), memory, inputs)
        return self._command(s, torque), *outcomes

    def _command(self, s: Tracking, returned: Array) -> Array:
        """Return the command for what the code returned."""
        output, values = self._adapted.output, returned.reshape(*s.P.shape[:-1], -1)
        if self.placed is None:
            return output.torque_of(s, values)
        return apply_matrix(np.array(self.placed), output.thrusts(values))

    def directions(self, G: MatrixLieGroup) -> Array:
        """Return those that it returns, or of the law that it claims to be."""
        output = self._adapted.output
        if output.as_ == "rotors":
            return np.empty((0, G.dimension))
        if output.order:
            return np.eye(G.dimension)[[command_axes(G).index(str(name)) for name in output.order]]
        return self.claimed.directions(G) if self.claimed else super().directions(G)

    def initial_memory(self, s: Tracking) -> Arrays:
        """Return the memory that ``X_start`` sets, if there is one, otherwise 0."""
        if self.object_:
            return {}
        inputs, numbers, memory = self.rows(s)
        started = self.called.call_in_runs(1, numbers, 0.0, np.zeros_like(memory), inputs)[1]
        return self._named(started, s)

    def memory(self, G: MatrixLieGroup) -> Mapping[str, int]:
        """Return the memory of the law that it claims to be, or the fields by their names."""
        length = G.dimension if self.placed is None else len(self.placed)
        more = {LAST: length, FAILED: 1} if self.holds else {}
        return self._of_code(G) | more

    def _of_code(self, G: MatrixLieGroup) -> dict[str, int]:
        return dict((self.claimed.memory(G) if self.claimed else {}) or self.called.lengths)

    def rows(self, s: Tracking) -> tuple[Array, Array, Array]:
        """Return inputs, numbers and memory, with a row for each run and sample."""
        batch = s.P.shape[:-1]
        inputs = self.reading(s.G, LawInput.of(s), self.called.code)
        if inputs.dtype == object:
            raise TraceError(
                f"{self.file} is code, which is called and not compiled into the loop",
                Remedy("set control.period, or use engine solve_ivp"),
            )
        # There is no memory before a run begins.
        memory = [s.memory.get(name, np.zeros(n)) for name, n in self._of_code(s.G).items()]
        numbers, values = (
            np.concatenate([np.broadcast_to(p, (*batch, p.shape[-1])) for p in group], axis=-1)
            for group in ([np.asarray(self.values)], [np.empty(0), *memory])
        )
        return inputs, numbers.reshape(len(inputs), -1), values.reshape(len(inputs), -1)

    def _named(self, memory: Array, s: Tracking) -> dict[str, Array]:
        """Return the memory of all runs by the names of its parts."""
        lengths = self._of_code(s.G)
        parts = np.split(memory, np.cumsum(list(lengths.values()))[:-1], axis=-1) if lengths else []
        batch = s.P.shape[:-1]
        return {name: part.reshape(*batch, -1) for name, part in zip(lengths, parts, strict=True)}

    def drained(self) -> list[float]:
        """Return the CPU times of the calls in Python since it was last asked, s."""
        return self.called.processes.drained() if self.code.is_python else []

    def lost_calls(self) -> dict[int, str]:
        """Return what became of lost calls in this thread since it was last asked, by their run."""
        return self.called.processes.taken()

    @property
    def unfailing(self) -> Self:
        """The law that holds no command, and raises an error where a call is lost."""
        return with_fields(self, holds=False, flies=False)

    @property
    def in_order(self) -> int:
        """Where each run has an object, which answers in the order of time: the most processes."""
        return 0 if self.object_ is None else MOST_RUNS

    @property
    def metrics(self) -> tuple[str, ...]:
        """Failures, where they are counted."""
        return (LawFailures.name,) if self.holds else ()

    @property
    def preview(self) -> tuple[float, ...]:
        """The times from now at which it knows the reference, s."""
        return self.preview_.times if self.preview_ else ()

    @property
    def previewed(self) -> tuple[str, ...]:
        """What it reads of the reference at these times; the pose, by which vectors turn, too."""
        return tuple(name for name in LATER if name in self._reads or name == LATER[0])

    @property
    def _reads(self) -> list[str]:
        """The names of `LawInput` that the code is given."""
        signals = [source.signal.partition(".")[0] for source in self._adapted.inputs.values()]
        return signals or [*self.called.code.inputs]

    def defaults(self, G: MatrixLieGroup, gains: Gains) -> Mapping[str, Any]:
        """Return the law that it claims to be with the options that follow its gains."""
        return {"claimed": self.claimed and with_defaults(self.claimed, G, gains, self.as_)}

    @property
    def reads_flat_output(self) -> bool:  # type: ignore[override]  # a constant of all other laws
        """Whether the input of the function has the position and its derivatives."""
        return not {"position", "heading", LATER[3]}.isdisjoint(self._reads)

    def for_plant(self, G: MatrixLieGroup, plant: PlantModel, problems: Problems) -> Self:
        """Return the law with what the law that it claims to be knows of the plant."""
        law, flat = self.claimed, plant.flat
        here = problems.at("file")
        if law is not None and law.reads_flat_output and not self.reads_flat_output:
            here.add(
                f"{self.prefix}_input has no field position, which {law.name} reads; `eqt export` "
                "writes its fields"
            )
        elif self.reads_flat_output and (law is None or not law.reads_flat_output):
            check_flat_output(plant, problems)
        if flat is not None and flat.heading is None and "heading" in self._reads:
            where = "the adapter" if self.adapter else f"{self.prefix}_input"
            at = problems.at("adapter") if self.adapter else here
            at.add(f"{where} has a heading, and the reference gives none; remove it there")
        if self.preview_:
            check_foreseen(plant, problems.at("preview"))
        for key, value in (("object", self.object_), ("on_failure", self.on_failure)):
            if value and plant.period is None:
                problems.at(key).add("applies at control instants; set control.period")
        can_fail = self.called.code.fails
        if self.on_failure and not can_fail:
            problems.at("on_failure").add(
                f"{self.code.function} is void and cannot say that it failed; let it return int, "
                "0 where it succeeds"
            )
        if problems:
            return self
        if law is not None:
            law = law.for_plant(G, plant.inside("claimed", law, G, self.as_), problems)
        holds = can_fail and law is None and plant.period is not None
        M = self._adapted.output.matrix(G, plant, problems.at("adapter", "output"))
        placed = None if M is None else tuple(map(tuple, M.tolist()))
        return with_fields(self, claimed=law, forces=plant.forces, holds=holds, placed=placed)

    def formula_of(self, loop: ClosedLoop, law: Controller) -> ClosedLoop:
        """Return a loop with this code as that of a formula, which counteracts known forces."""
        return replace(loop, controller=law, known_forces=self.forces if counteracts(law) else ())

    def judged(
        self, label: str, loop: Any, horizon: float, random: Any, flown: Any
    ) -> Iterator[Any]:
        """Compare the code with the law that it claims to be."""
        from eqt_cli.extensions.code.code_rows import code_rows  # which only `eqt verify` needs

        bare = replace(loop, controller=self.unfailing)  # a held command would hide a failure
        if flown is not None:
            like = np.empty((*flown[1].shape[:-1], bare.state_length))
            flown = flown[0], bare.layout.join(loop.layout.split(flown[1]), like)
        yield from code_rows(label, bare, horizon, random, flown)


class LawFailures(Metric):
    """Number of calls in which code fails: it raises, returns None, or its int is not 0."""

    name: ClassVar[str] = "law_failures"
    signals: ClassVar[tuple[str, ...]] = (FAILED,)
    units: ClassVar[str] = "1"
    better: ClassVar[Any] = "lower"

    def of(self, over: SampledRuns, *signals: Any) -> Any:
        """Return the count at the end."""
        return over.final(signals[0])


def _of_claimed(name: str) -> property:
    def get(law: Any) -> Any:
        return getattr(law.claimed or super(Code, law), name)

    return property(get, doc="As for the law that it claims to be.")


for _name in (
    "energy matched claims_decrease feedforward_torque lyapunov velocity_error dissipation "
    "memory_rate weight theorem reads_gains"
).split():
    setattr(Code, _name, _of_claimed(_name))


def _check_name(name: str, problems: Problems) -> None:
    if not is_name(name):
        problems.add(f"expected a name in C, got {shown(name)}")


def is_name(text: str) -> bool:
    """Whether a text can be a name in C."""
    return re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", text) is not None


# Reads, compiles and tries out laws in user code before any run -----------------------------------


TRIED = 8
"""Number of random states at which a function is tried out, besides rest and half turns."""

PERIOD = 0.01
"""Control period for trying out a function, s."""


@purposes.verify_code
def with_code(document: Document, code: str, claimed: str | None, adapter: Path | None) -> Document:
    """Return the configuration with a law in code as its only controller.

    An existing entry of `controllers` for this file keeps its numbers.

    Parameters
    ----------
    code
        The file, and behind a colon its function.
    adapter
        A file with its adapter. Default: ``lee.adapter.yaml`` next to ``lee.c``, if it exists.
    claimed
        The law that the code claims to be: a kind, or the label of an entry, with its options and
        gains; None to keep the statement of the entry, if any.

    Raises
    ------
    EqtError
        If there is no such file.
    """
    named = re.fullmatch(r"(.+?\.\w+):(.+)", code)  # as in lee.py:compute
    file, function = (Path(named[1]), named[2]) if named else (Path(code), None)
    if not file.is_file():
        raise EqtError(f"{code}: not found; give a file in C, C++ or Python with --code")
    name, beside = os.path.relpath(file, document.home.folder), file.with_suffix(BESIDE)
    adapter = adapter or (beside if beside.is_file() else None)
    listed = document.data.get("controllers")
    entries = [e for e in listed if isinstance(e, dict)] if isinstance(listed, list) else []
    of_file = [e for e in entries if os.path.normpath(str(e.get("file"))) == name]
    entry = {**(of_file[0] if of_file else {"kind": Code.name, "file": name, "label": file.stem})}
    entry |= {"function": function} if function else {}
    places: dict[KeyPath, str] = {}
    if adapter:
        source = load(text_of(adapter, "it is an adapter", InputError), str(adapter))
        entry["adapter"], at = source.data, ("controllers", 0, "adapter")
        places = {(*at, *path): source.key_place(path) for path in source.paths}
    if claimed is not None:
        meant = next((e for e in entries if claimed in (e.get("label"), e.get("kind"))), {})
        shared = {key: meant[key] for key in ("gains", "known_forces") if key in meant}
        options = {key: meant[key] for key in meant if key not in {"label", *shared}}
        entry |= {"as": options or claimed} | shared
    document = changed_at(document, ("controllers",), [entry], "--code")
    return replace(document, changes=document.changes | places)


def first_inputs(G: MatrixLieGroup, steps: int = 0) -> LawInput:
    """Return inputs at random states, at rest without error, and at half turns about every axis.

    With so many steps of a preview.
    """
    random, m = np.random.default_rng(0), G.dimension
    n = G.space if matrix_groups.rigid_motions(G) else 0

    def drawn(*shape: int) -> Array:
        rows = np.zeros((TRIED + 1 + m, *shape))
        rows[:TRIED] = random.standard_normal((TRIED, *shape))
        return rows

    x, xd, V, Vd, Vd_dot, psi = map(drawn, (m, m, m, m, m, 3))
    x[TRIED + 1 :] = np.pi * np.eye(m)
    t = np.repeat([0.5, 0.0], [TRIED, 1 + m])
    first = LawInput(t, G.exp(x), V, G.exp(xd), Vd, Vd_dot, drawn(ORDER + 1, n), psi)
    if not steps:
        return first
    later = G.exp(drawn(steps, m)), drawn(steps, m), drawn(steps, m), drawn(steps, ORDER + 1, n)
    return first._replace(**dict(zip(LATER, later, strict=True)))
