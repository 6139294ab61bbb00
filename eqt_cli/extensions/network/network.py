"""A law that is a neural network: what it observes and commands, and the network as C."""

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self, get_args

import numpy as np
from pydantic import BeforeValidator, Field

from eqt_cli.base.arrays import (
    Array,
    Arrays,
    absolute,
    apply,
    apply_matrix,
    clip,
    less,
    maximum,
    sqrt,
    stack,
    transpose,
    where,
)
from eqt_cli.base.errors import InputError, Problems, TraceError, suggestion
from eqt_cli.base.option_types import Positive, Real
from eqt_cli.base.registry import Keys
from eqt_cli.base.stored import THRUSTER
from eqt_cli.components.actuators import THRUSTS
from eqt_cli.components.groups import MatrixLieGroup, Part, command_axes, moving_parts
from eqt_cli.components.laws import (
    MOST_AHEAD,
    CodeCall,
    CodeFile,
    Preview,
    Previews,
    RunsCode,
    check_foreseen,
)
from eqt_cli.components.mechanics import LawInput, Tracking
from eqt_cli.components.motions import PlantModel
from eqt_cli.engines import compiler
from eqt_cli.extensions.network.steps import ENTRIES, LETTERS, MISSING, Built, network_of, table
from eqt_cli.numbers.c_headers import PRELUDE, headers, needed
from eqt_cli.numbers.leaves import STRUCTURE, with_fields

# What a network observes --------------------------------------------------------------------------

LAST = "last_command"
"""The outputs of the network a period before; 0 at the start."""

Motion = Literal["position", "position_error", "velocity", "velocity_error"]
Rotation = Literal["rotation", "rotation_error", "rates", "rates_error"]
Attitude = Literal["gravity", "quaternion", "euler"]
Observable = Literal[Motion, Rotation, Attitude, "last_command"]
OBSERVABLE = get_args(Observable)


def observable_on(G: MatrixLieGroup) -> list[str]:
    """Return the signals that a network can observe of a group."""
    turning, moving = moving_parts(G)
    names = list[str]([] if moving is None else get_args(Motion))
    if turning is not None:
        names += [*get_args(Rotation), *(get_args(Attitude) if len(G.identity) > 2 else [])]
    return [*names, LAST]


@dataclass(frozen=True)
class Observed(Keys):
    """A signal that a network observes.

    Attributes
    ----------
    signal
        position p, position_error p − p_d, velocity ṗ, velocity_error ṗ − ṗ_d; rotation R and
        rotation_error R_dᵀR, row by row; rates ω and rates_error ω − RᵀR_d ω_d; gravity −Rᵀe_z, of
        length 1; quaternion of R, with w ≥ 0; euler: roll, pitch and yaw of R, rad; last_command.
    frame
        Of a position or velocity: space (default) or body. Of rates: body (default) or space.
    order
        Of a quaternion only: wxyz or xyzw.
    entries
        Which numbers of the signal, from 0. Default: all.
    clip
        The signal is clipped to ± so much, in m, m/s or rad/s. Not for last_command, which `clip`
        of the commands limits.
    mean, deviation
        Then it is normalised: less the mean, over the deviation; a number, or one for each entry.
    scale
        The network is given so many times what results.
    steps
        Of last_command only: so many last commands, the oldest first; at most 1,000.
    preview
        Of an error only: it is given to the reference at so many later `steps`, `every` so long, in
        the order of time, in place of the reference now.
    """

    signal: Observable
    frame: Literal["space", "body"] | None = None
    order: Literal["wxyz", "xyzw"] | None = None
    entries: list[Annotated[int, Field(ge=0)]] | None = None
    scale: Real = 1.0
    clip: Positive | None = None
    mean: Real | list[Real] = 0.0
    deviation: Positive | list[Positive] = 1.0
    steps: Annotated[int, Field(ge=1, le=MOST_AHEAD)] = 1
    preview: Preview | None = None

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note a signal that the group has not, and options that the signal does not take."""
        if self.signal == LAST:
            for key in ("clip", "entries", "mean", "deviation"):
                if getattr(self, key) != getattr(Observed(LAST), key):
                    problems.at(key).add("last_command is limited by commands.clip; leave this out")
        elif self.signal not in (names := observable_on(G)):
            problems.at("signal").add(f"{G.name} has no {self.signal}; it has {', '.join(names)}")
        if self.frame and self.signal not in (*get_args(Motion), "rates"):
            problems.at("frame").add(
                f"applies to positions, velocities and rates, not to {self.signal}; leave it out"
            )
        if (self.order is None) == (self.signal == "quaternion"):
            problems.at("order").add(
                f"applies to quaternion, not to {self.signal}; leave it out"
                if self.order
                else "missing; write wxyz or xyzw, the order of the quaternion"
            )
        if self.steps > 1 and self.signal != LAST:
            problems.at("steps").add(f"applies to {LAST}, not to {self.signal}; leave it out")
        if not self.scale:
            problems.at("scale").add("0 hides the signal from the network; leave the signal out")
        if self.preview and not self.signal.endswith("error"):
            problems.at("preview").add(
                f"applies to errors, such as position_error, not to {self.signal}; leave it out"
            )

    def values(self, G: MatrixLieGroup, x: LawInput, first: int = 0) -> Array:
        """Return what the network is given of an input, ``(..., n)``.

        A preview reads the later times of the input from the place `first` on.
        """
        if self.preview is None:
            value = self._signal(G, x)
        else:
            later = range(first, first + self.preview.steps)
            value = np.concatenate([self._signal(G, x.at_later(k)) for k in later], axis=-1)
        if self.entries is not None:
            value = value[..., self.entries]
        if self.clip is not None:
            value = clip(value, -self.clip, self.clip)
        return self.scale * ((value - np.array(self.mean)) / np.array(self.deviation))

    def _signal(self, G: MatrixLieGroup, x: LawInput) -> Array:
        turning, moving = moving_parts(G)
        if self.signal not in get_args(Motion):
            assert turning is not None
            R, Rd = (pose[(..., *turning.entries)] for pose in (x.pose, x.desired_pose))
            w, wd = (V[..., turning.axes] for V in (x.velocity, x.desired_velocity))
            if self.signal == "gravity":
                return -R[..., 2, :]
            if self.signal == "euler":
                return _roll_pitch_yaw(R)
            if self.signal == "quaternion":
                return _quaternion(R)[..., [0, 1, 2, 3] if self.order == "wxyz" else [1, 2, 3, 0]]
            if self.signal == "rates" and self.frame == "space" and w.shape[-1] > 1:
                return apply_matrix(R, w)
            relative = transpose(Rd) @ R
            if self.signal.startswith("rotation"):
                R = relative if self.signal.endswith("error") else R
                return R.reshape(*R.shape[:-2], -1)
            plane = w.shape[-1] == 1  # where the rate is the same in all frames
            of_error = wd if plane else apply_matrix(transpose(relative), wd)
            return w - of_error if self.signal.endswith("error") else w
        assert moving is not None
        value = self._motion(x.pose, x.velocity, turning, moving)
        if self.signal.endswith("error"):
            value = value - self._motion(x.desired_pose, x.desired_velocity, turning, moving)
        if self.frame == "body" and turning is not None:
            value = apply_matrix(transpose(x.pose[(..., *turning.entries)]), value)
        return value

    def _motion(self, pose: Array, V: Array, turning: Part | None, moving: Part) -> Array:
        """Return position or velocity in space."""
        if self.signal.startswith("position"):
            return pose[(..., *moving.entries)][..., 0]
        v = V[..., moving.axes]
        return v if turning is None else apply_matrix(pose[(..., *turning.entries)], v)


def _angle(y: Array, x: Array) -> Array:
    """Return the angle of (x, y) by atan of half of it, which is far from a jump; 0 of (0, 0)."""
    r, least = sqrt(x * x + y * y), np.finfo(float).tiny
    ahead = 2.0 * apply("atan", y / maximum(r + x, least))
    behind = np.pi - 2.0 * apply("atan", absolute(y) / maximum(r - x, least))
    return where(less(x, 0.0), where(less(y, 0.0), -behind, behind), ahead)


def _roll_pitch_yaw(R: Array) -> Array:
    """Return the angles of R = R_z(yaw) R_y(pitch) R_x(roll)."""
    roll, yaw = _angle(R[..., 2, 1], R[..., 2, 2]), _angle(R[..., 1, 0], R[..., 0, 0])
    across = sqrt(R[..., 0, 0] ** 2 + R[..., 1, 0] ** 2)
    return stack([roll, _angle(-R[..., 2, 0], across), yaw])


def _quaternion(R: Array) -> Array:
    """Return w, x, y, z of rotations, w ≥ 0, from the largest of four squares (Shepperd 1978)."""
    (a, b, c), (d, e, f), (g, h, i) = ([R[..., k, j] for j in range(3)] for k in range(3))
    rows = [
        [1.0 + a + e + i, h - f, c - g, d - b],
        [h - f, 1.0 + a - e - i, b + d, c + g],
        [c - g, b + d, 1.0 - a + e - i, f + h],
        [d - b, c + g, f + h, 1.0 - a - e + i],
    ]
    q, square = stack(rows[0]), rows[0][0]
    for k in (1, 2, 3):
        larger = less(square, rows[k][k])
        q = where(larger[..., None], stack(rows[k]), q)
        square = where(larger, rows[k][k], square)
    q = q / (2.0 * sqrt(square))[..., None]
    return where(less(q[..., :1], 0.0), -q, q)


_LIBRARIES: dict[str, dict[str, list[Any]]] = table("observations.yaml")


def _with_terms(listed: Any) -> Any:
    """Replace names, ``rates`` or ``isaaclab3.root_quat_w`` of a library, by their signals."""
    if not isinstance(listed, list):
        return listed
    signals = []
    for entry in listed:
        if not isinstance(entry, str) or entry in OBSERVABLE:
            signals.append({"signal": entry} if isinstance(entry, str) else entry)
            continue
        library, _, term = entry.partition(".")
        terms = _LIBRARIES.get(library, {})
        if term not in terms:
            meant = suggestion(entry, OBSERVABLE)
            names = f"a signal, of {', '.join(OBSERVABLE)}, or " if not terms else ""
            names += f"LIBRARY.TERM, of {', '.join(terms or _LIBRARIES)}"
            raise ValueError(f"{entry}: expected {names}{meant}")
        signals += terms[term]
    return signals


@dataclass(frozen=True)
class Commanded(Keys):
    """What the outputs y of a network command, each clipped to ±`clip`.

    Attributes
    ----------
    as_
        rotors: thrusts f = c₀ + c₁ y + c₂ y²; wrench: entries of the torque and the force; rates:
        rates in place of the torque, and entries of the force, each offset + scale y.
    order
        Of rotors, their names in the order of the outputs, as in `actuators`. Of the others, axes
        as `torque x`. Default: all, in their order.
    thrust
        Of rotors, [c₀, c₁, c₂], N.
    scale, offset
        A number, or one for each output.
    clip
        Default: 1.
    """

    as_: Literal["rotors", "wrench", "rates"] = "wrench"
    order: list[str] | None = None
    thrust: list[Real] | None = None
    scale: Real | list[Real] = 1.0
    offset: Real | list[Real] = 0.0
    clip: Positive | None = 1.0


# The network in C ---------------------------------------------------------------------------------
#
# Each step is a loop over its outputs; a product with a matrix takes its columns one after the
# other, so that a compiler may take several rows at once without another order of any sum.


class Emitted:
    """The steps of a network as C."""

    def __init__(self, network: Built) -> None:
        self.network = network
        self.constants: list[str] = []
        self.lines: list[str] = []
        at = 0
        for vector, _ in network.states:  # a state a period later may be another one now
            self.lines.append(f"double {vector}[{network.length[vector]}];")
            self._copy(vector, network.length[vector], f"h[{at} + i]")
            at += network.length[vector]
        for step in network.needed:
            size = network.length[step["out"]]
            self.lines.append(f"double {step['out']}[{size}];")
            getattr(self, f"_{step['op']}", self._entry)(step, step["out"], size)
        at = 0
        for before, after in network.states:
            self._copy(f"(h + {at})", network.length[before], f"{after}[i]")
            at += network.length[before]

    def _constant(self, values: Sequence[float], kind: str = "double") -> str:
        name, listed = f"c{len(self.constants)}", ", ".join(map(repr, values))
        self.constants.append(f"static const {kind} {name}[] = {{{listed}}};")
        return name

    def _copy(self, vector: str, size: int, formula: str) -> None:
        self.lines.append(f"for (i = 0; i < {size}; i++) {vector}[i] = {formula};")

    def _affine(self, step: Mapping[str, Any], name: str, size: int) -> None:
        (vector,), (m, n) = step["of"], np.shape(step["W"])
        weights, bias = self._constant(np.transpose(step["W"]).ravel().tolist()), step["b"]
        self._copy(name, m, f"{self._constant(bias)}[i]")
        self.lines.append(f"for (j = 0; j < {n}; j++)")
        self._copy(name, m, f"{name}[i] + {weights}[{m} * j + i] * {vector}[j]")

    def _entry(self, step: Mapping[str, Any], name: str, size: int) -> None:
        terms = {key: repr(number) for key, number in step["numbers"].items()}
        for letter, operand in zip("uvw", step["of"], strict=False):
            single = self.network.size(operand) == 1
            vector = operand if isinstance(operand, str) else self._constant(operand)
            terms[letter] = f"{vector}[{0 if single else 'i'}]"
        self._copy(name, size, LETTERS.sub(lambda x: terms[x[0]], ENTRIES[step["op"]]))

    def _concat(self, step: Mapping[str, Any], name: str, size: int) -> None:
        start = 0
        for operand in step["of"]:
            vector = operand if isinstance(operand, str) else self._constant(operand)
            self._copy(f"({name} + {start})", self.network.size(operand), f"{vector}[i]")
            start += self.network.size(operand)

    def _take(self, step: Mapping[str, Any], name: str, size: int) -> None:
        places, first = step["places"], step["places"][0]
        neighbours = places == [*range(first, first + size)]
        place = f"{first} + i" if neighbours else f"{self._constant(places, 'int')}[i]"
        self._copy(name, size, f"{step['of'][0]}[{place}]")


CALL = Path(__file__).with_name("call.h")
"""How native calls a network for many runs."""

ENTRY = Path(__file__).with_name("entries.h")
"""Functions that operations entry by entry call."""


Memory = tuple[tuple[str, str], ...] | None


@lru_cache(maxsize=16)
def emitted(text: str, name: str, memory: Memory = None) -> Emitted:
    """Return the steps of the network of a text, which many points of a sweep share."""
    return Emitted(network_of(text, name, memory))


def source_of(
    emitted: Emitted,
    matrix: Array,
    curve: Array,
    most: float | None = None,
    last: tuple[int, float, int] | None = None,
) -> str:
    """Return the C of a law: `eqt_code`, as native calls it, around the steps of a network.

    Parameters
    ----------
    matrix : (m, k)
        From the commands of the k outputs to the torque and, of rotors, the thrusts behind it.
    curve : (3, k)
        c₀, c₁ and c₂ of each command in its output.
    most
        The size to which outputs are clipped.
    last
        Where the last outputs stand among the inputs, their scale, and of how many periods; None if
        they are not observed.
    """
    network, hidden = emitted.network, len(emitted.network.initial)
    outputs = network.commands
    last_at, last_scale, remembers = last or (0, 1.0, 0)
    numbers = {"offset": curve[0], "linear": curve[1], "square": curve[2], "matrix": matrix.ravel()}
    defined = {
        "inputs": network.length[network.observed],
        "outputs": outputs,
        "axes": len(matrix),
        "hidden": hidden,
        "memory": hidden + outputs * remembers,
        "remembers": remembers,
        "last_at": last_at,
        "last_scale": repr(float(last_scale)),
        "limited": f"y[i] < -{most} ? -{most} : y[i] > {most} ? {most} : y[i]" if most else "y[i]",
        **{name: ", ".join(map(repr, x.tolist())) or "0" for name, x in numbers.items()},
    }
    text = "\n".join(
        [
            *(f"#define EQT_{name.upper()} {value}" for name, value in defined.items()),
            f"static void network(const double *{network.observed}, double *h, double *y)\n{{",
            "    long i, j;\n    (void)h, (void)j;",
            *(f"    {line}" for line in emitted.lines),
            f"    for (i = 0; i < EQT_OUTPUTS; i++) y[i] = {network.result}[i];\n}}",
            CALL.read_text(encoding="utf-8"),
        ]
    )
    functions = headers("double") + "\n" + ENTRY.read_text(encoding="utf-8")
    return "\n".join([PRELUDE, needed(PRELUDE + text, functions), *emitted.constants, text])


@lru_cache(maxsize=64)
def function_of(source: str) -> Any:
    """Return the compiled function; raises an `InputError` without a compiler."""
    if compiler.missing():
        raise InputError(
            "a network is compiled, and this machine has no C compiler; install gcc or clang, or "
            "'pip install ziglang' (extra native), a clang in a wheel"
        )
    return compiler.library(source).eqt_code


AGREES = 1e-6
"""Largest mean difference between a network in C and the examples in its file, as RLtools asks."""


@lru_cache(maxsize=16)
def check_examples(text: str, name: str) -> None:
    """Raise an `InputError` where the network in C does not give the outputs of its examples."""
    network = network_of(text, name)
    if not network.examples:
        return
    inputs, expected = map(np.array, network.examples)
    outputs, states = np.empty_like(expected), np.array([[*network.initial]])
    function = function_of(bare_source(emitted(text, name)))
    for k, row in enumerate(np.ascontiguousarray(inputs)):
        call(function, states, row[None], outputs[k : k + 1])
    apart = float(np.abs(outputs - expected).mean())
    if not apart < AGREES:
        raise InputError(
            f"{name}: computed by eqt, its outputs are {apart:.2g} away from its examples, and "
            f"{AGREES:g} is allowed: the file is damaged, or of another version of RLtools"
        )


def bare_source(emitted: Emitted) -> str:
    """Return the C of a network by itself, whose outputs are what it returns."""
    unit = np.eye(emitted.network.commands)
    return source_of(emitted, unit, np.outer([0.0, 1.0, 0.0], np.ones(len(unit))))


def call(function: Any, states: Array, rows: Array, outputs: Array) -> None:
    """Call a function of `source_of` for some runs, which changes the states."""
    addresses = [ctypes.c_void_p(array.ctypes.data) for array in (states, rows, outputs)]
    end = ctypes.c_long(len(rows)), 0, ctypes.c_double(0.0), None
    function(*end, *addresses, None, None)


UNTRAINED = "untrained"
"""Text in place of a file that training has yet to write; no file gives it."""


def _zero(inputs: int, outputs: int) -> Built:
    """Return a network that commands 0."""
    built = Built("policy")
    zero = built.affine(built.input("x", [inputs]), np.zeros((outputs, inputs)), np.zeros(outputs))
    built.outputs = {"y": (str(zero), [outputs])}
    return built


def _of_actions(
    outputs: int, M: Array, curve: Array, said: "Commanded", last: tuple[int, float, int] | None
) -> str:
    """Return the C of a law that takes the outputs of its network, before any last ones."""
    steps = last[2] if last else 0
    built = Built("policy")
    actions = built.placed([built.input("x", [outputs * (1 + steps)])], np.arange(outputs))
    built.outputs = {"y": (str(actions), [outputs])}
    emitted = Emitted(network_of(built.text, "policy"))
    return source_of(emitted, M, curve, said.clip, (outputs, *last[1:]) if last else None)


# The law ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Network(RunsCode, Previews):
    """A trained neural network with its weights; it reads no gains.

    The file is ONNX (`pip install onnx`, extra network) or a checkpoint of RLtools (`.h5`). It is
    data: nothing in it runs. A layer of gated recurrent units is the memory of the law.

    Attributes
    ----------
    file
        The file, relative to the configuration.
    observes
        Inputs of the network in their order: signals, by their names or each with a frame, a scale
        and a clip; or terms of a library, as `isaaclab3.root_quat_w`.
    commands_
        Meaning of its outputs: rotors, wrench or rates.
    memory_
        Inputs of the network that hold what an output was a period before, and 0 at the start, as
        `{h_in: h_out}`. Default: by names and shapes, where these tell.
    """

    name: ClassVar[str] = "network"
    reader: ClassVar[str] = "eqt_cli.extensions.network.reader.network_text"

    file: str
    observes: Annotated[list[Observed], BeforeValidator(_with_terms)] = field(metadata=STRUCTURE)
    commands_: Commanded = field(default=Commanded(), metadata=STRUCTURE)
    memory_: dict[str, str] | None = field(default=None, metadata=STRUCTURE)
    text: str = field(init=False, default="", repr=False, metadata=STRUCTURE)
    source: str = field(init=False, default="", repr=False, metadata=STRUCTURE)
    length: int = field(init=False, default=0, repr=False, metadata=STRUCTURE)
    # Without a file, as in training: the C that takes what a policy gives.
    acting: str = field(init=False, default="", repr=False, metadata=STRUCTURE)

    @property
    def files(self) -> dict[str, str]:
        """The file."""
        return {"file": self.file}

    def with_files(self, texts: Mapping[str, str]) -> Self:
        """Return the law with its network."""
        return with_fields(self, text=texts.get(self.file, ""))

    @property
    def network(self) -> Built:
        """The network, checked."""
        return network_of(self.text, self.file, self._pairs)

    @property
    def _pairs(self) -> Memory:
        return None if self.memory_ is None else tuple(self.memory_.items())

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note signals that the group has not, and another number of them than the network has."""
        if not self.observes:
            problems.at("observes").add("expected at least one signal, such as [rotation_error]")
        if not np.any(self.commands_.scale):
            problems.at("commands", "scale").add("with 0, the network commands nothing")
        for index, observation in enumerate(self.observes):
            observation.check(G, problems.at("observes", index))
            if observation.signal == LAST and LAST in [one.signal for one in self.observes[:index]]:
                problems.at("observes", index).add("last_command occurs twice; name it once")
        if problems or self.text in ("", UNTRAINED, MISSING):
            return
        with problems.catching("file"):
            check_examples(self.text, self.file)
            _ = self.network
        if problems:
            return
        sizes, inputs = self._sizes(G), self.network.length[self.network.observed]
        if sum(sizes) != inputs:
            pairs = zip(self.observes, sizes, strict=True)
            listed = ", ".join(f"{observation.signal} {size}" for observation, size in pairs)
            problems.at("observes").add(
                f"gives {sum(sizes)} numbers ({listed}), and the network in {self.file} takes "
                f"{inputs}"
            )

    @property
    def preview(self) -> tuple[float, ...]:
        """The times from now at which it knows the reference, s."""
        return tuple(
            t
            for observation in self.observes
            if observation.preview
            for t in observation.preview.times
        )

    def for_plant(self, G: MatrixLieGroup, plant: PlantModel, problems: Problems) -> Self:
        """Return the law in C, with the rotors of the plant."""
        if self.preview:
            index = next(i for i, observation in enumerate(self.observes) if observation.preview)
            check_foreseen(plant, problems.at("observes", index, "preview"))
        if problems or not self.text:
            return self
        if self.text in (UNTRAINED, MISSING):
            return self._with_outputs(G, plant).for_plant(G, plant, problems)
        M, curve = self._commanding(G, plant, problems.at("commands"))
        if problems:
            return self
        sizes, last = self._sizes(G), None
        for index, signal in enumerate(self.observes):
            if signal.signal == LAST:
                last = sum(sizes[:index]), signal.scale, signal.steps
        source = source_of(
            emitted(self.text, self.file, self._pairs), M, curve, self.commands_.clip, last
        )
        acting = self.acting and _of_actions(self.network.commands, M, curve, self.commands_, last)
        with problems.catching("file"):
            function_of(source)
        return with_fields(self, source=source, length=len(M), acting=acting)

    def _with_outputs(self, G: MatrixLieGroup, plant: PlantModel) -> Self:
        """Return the law with a network that commands 0 from its signals."""
        rotors = [part for part in plant.actuators if THRUSTER in part.members]
        as_rotors = self.commands_.as_ == "rotors" and rotors
        names = self.commands_.order or (
            rotors[0].members[THRUSTER] if as_rotors else command_axes(G)
        )
        outputs = with_fields(self, text=_zero(1, len(names)).text)
        network = _zero(sum(outputs._sizes(G)), len(names))
        return with_fields(self, text=network.text, acting=UNTRAINED)

    def _commanding(
        self, G: MatrixLieGroup, plant: PlantModel, problems: Problems
    ) -> tuple[Array, Array]:
        """Return the matrix from outputs to the command, ``(m, k)``, and the rows c₀, c₁, c₂."""
        said, k = self.commands_, self.network.commands
        names, M, of_rotors = command_axes(G), np.eye(G.dimension), said.as_ == "rotors"
        if of_rotors:
            rotors = [actuator for actuator in plant.actuators if THRUSTER in actuator.members]
            if not rotors:
                problems.add("as: rotors, and actuators has no thrusters")
                return np.empty((0, 0)), np.empty((0, 0))
            names = rotors[0].members[THRUSTER]
            M = np.eye(G.dimension + len(names), len(names), -G.dimension)
        order = list(names) if said.order is None else said.order
        for index, name in enumerate(order):
            if name not in names:
                problems.at("order", index).add(f"expected one of {', '.join(names)}, got {name}")
        if not problems and len(order) != k:
            problems.at("order").add(f"{len(order)} names, and the network has {k} outputs")
        thrust = said.thrust or [0.0, 1.0, 0.0]
        if len(thrust) != 3:
            problems.at("thrust").add(f"expected [c0, c1, c2], got {len(thrust)} numbers")
        for name in ("scale", "offset"):
            if np.ndim(value := getattr(said, name)) and len(value) != k:
                problems.at(name).add(f"expected {k} numbers, got {len(value)}")
        if problems:
            return np.empty((0, 0)), np.empty((0, 0))
        rows = thrust if of_rotors else (said.offset, said.scale, 0.0)
        curve = np.stack([np.broadcast_to(np.asarray(row, dtype=float), k) for row in rows])
        return M[:, [names.index(name) for name in order]], curve

    def directions(self, G: MatrixLieGroup) -> Array:
        """Return the directions of its outputs; none where they are thrusts."""
        order, axes = self.commands_.order, np.eye(G.dimension)
        if self.commands_.as_ == "rotors":
            return axes[:0]
        names = [name for name in command_axes(G) if order is None or name in order]
        return axes[[command_axes(G).index(name) for name in names]]

    @property
    def commands(self) -> str:  # type: ignore[override]  # a constant of most laws
        """Rates, for which it needs a `rate_loop`, thrusts of rotors, or a torque."""
        return {"rates": "rates", "rotors": THRUSTS}.get(self.commands_.as_, "torque")

    @property
    def code(self) -> CodeFile:
        """The function in C."""
        return CodeFile(self.file, "eqt_code", (), (), "double")

    @property
    def code_call(self) -> CodeCall:
        """The compiled function."""
        return CodeCall(function_of(self.source), 0, (), np.empty(0))

    @property
    def actions_call(self) -> Any:
        """The compiled function that takes outputs in place of observations; see `acting`."""
        return function_of(self.acting)

    def code_rows(self, G: MatrixLieGroup, x: LawInput) -> Array:
        """Return what the network observes, ``(states, n)``; 0 for its last command."""
        batch, rows, later = x.velocity.shape[:-1], [], 0
        for signal in self.observes:
            if signal.signal == LAST:
                count = self.network.commands * signal.steps
                row = np.concatenate([0.0 * x.velocity[..., :1]] * count, axis=-1)
            else:
                row = signal.values(G, x, later)
            later += signal.preview.steps if signal.preview else 0
            rows.append(np.broadcast_to(row, (*batch, row.shape[-1])))
        observation = np.concatenate(rows, axis=-1)
        return observation.reshape(-1, observation.shape[-1])

    def _sizes(self, G: MatrixLieGroup) -> list[int]:
        """Return how many numbers each signal gives, of a body at rest."""
        zero, later = np.zeros(G.dimension), np.zeros((MOST_AHEAD, G.dimension))
        x = LawInput(0.0, G.identity, zero, G.identity, zero, zero)
        x = x._replace(later_pose=G.exp(later), later_velocity=later)
        return [
            self.network.commands * signal.steps
            if signal.signal == LAST
            else signal.values(G, x).shape[-1]
            for signal in self.observes
        ]

    def memory(self, G: MatrixLieGroup) -> Mapping[str, int]:
        """Return the states of recurrent units, and the last command."""
        lengths = {"hidden": len(self.network.initial)}
        for signal in self.observes:
            if signal.signal == LAST:
                lengths[LAST] = self.network.commands * signal.steps
        return {name: length for name, length in lengths.items() if length}

    def initial_memory(self, s: Tracking) -> Arrays:
        """Return the states of recurrent units at the start."""
        start = np.array(self.network.initial)
        return {"hidden": start + 0.0 * s.P[..., :1]} if len(start) else {}

    def answer(self, s: Tracking, period: Any) -> tuple[Array, Arrays]:
        """Return the command, and the memory a period later."""
        if np.asarray(s.P).dtype == object:
            raise TraceError(f"{self.file} is a network, which is called at instants of control")
        lengths, batch = self.memory(s.G), s.P.shape[:-1]
        rows = self.code_rows(s.G, LawInput.of(s))
        memory = {
            name: np.broadcast_to(s.memory[name], (*batch, n)).reshape(len(rows), -1)
            for name, n in lengths.items()
        }
        torques, later = self.answer_rows(s.G, rows, memory)
        named = {name: part.reshape(*batch, -1) for name, part in later.items()}
        return torques.reshape(*batch, -1), named

    def answer_rows(self, G: MatrixLieGroup, rows: Array, memory: Arrays) -> tuple[Array, Arrays]:
        """Return the command for each row of observations, and the memory a period later."""
        lengths, rows = self.memory(G), np.ascontiguousarray(rows, dtype=float)
        parts = [np.empty((len(rows), 0)), *(memory[name] for name in lengths)]
        states = np.ascontiguousarray(np.concatenate(parts, axis=-1))
        torques = np.empty((len(rows), self.length))
        call(function_of(self.source), states, rows, torques)
        later = np.split(states, np.cumsum([*lengths.values()])[:-1], axis=-1)
        return torques, dict(zip(lengths, later, strict=False))
