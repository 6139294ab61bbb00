"""Networks as steps on vectors, each of whose operations eqt computes."""

import json
import re
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from eqt_cli.base import yaml_source
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtWarning, InputError
from eqt_cli.base.reporting import reporter

MOST_NUMBERS = 4_000_000
"""Most numbers of a network."""

MOST_STEPS = 1000
"""Most operations."""

Operand = str | list[float]
"""The name of a vector, or numbers."""


def table(name: str) -> Any:
    """Return a table of this folder, written in YAML."""
    return yaml_source.load(Path(__file__).with_name(name).read_text(encoding="utf-8"), name).data


OPERATIONS: dict[str, Any] = table("operations.yaml")
"""Operations that eqt computes, by their names in ONNX."""

ENTRIES: dict[str, str] = OPERATIONS["entries"]

LETTERS = re.compile(r"\b(?:[uvw]|alpha|beta|gamma)\b")

KINDS = {op: kind for kind in ("entries", "placed", "affine", "folded") for op in OPERATIONS[kind]}
KINDS |= OPERATIONS["others"]
"""How each operation on computed numbers is read: a method of `_OfGraph`."""


@lru_cache(maxsize=16)
def network_of(text: str, name: str, memory: tuple[tuple[str, str], ...] | None = None) -> "Built":
    """Return the network of a text, whose every operation, name and number is checked.

    Parameters
    ----------
    memory
        Pairs of an input, and the output that is its value a period later. Default: as the file
        has them, or as names and shapes tell.

    Raises
    ------
    InputError
        If it is not as `network_text` writes it, or the memory is not clear.
    """
    try:
        data = json.loads(text)
        built = Built(name)
        for key, shape in data["inputs"].items():
            built.input(key, [int(length) for length in shape])
        for step in data["steps"]:
            built.again(step)
        for key, (vector, shape) in data["outputs"].items():
            if shape is not None and built.length[vector] != np.prod(shape):
                built.refuse(f"the output {key} of another shape")
            built.outputs[key] = vector, shape
        built.memory = {str(state): str(later) for state, later in data["memory"].items()}
        built.start = {key: finite(values, name) for key, values in data["start"].items()}
        built.examples = [finite(np.array(example), name) for example in data["examples"]]
        built.choose(None if memory is None else dict(memory))
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, RecursionError) as error:
        raise InputError(f"{name}: is not a network as eqt stores it: {error}") from error
    return built


MISSING = "missing"
"""Text in place of a file that is not there, so that all else is checked; it is refused then."""


class Built:
    """A network that is built step by step.

    Attributes
    ----------
    inputs
        The shapes of all inputs by name.
    outputs
        The vector of each output and its shape; or why it is not computed, and None.
    memory, start, examples, steps, trained
        As in `network_text`.
    length
        The lengths of the vectors: inputs ``x0``, ``x1``, …, and the output of each step.
    states
        After `choose`: the vectors of each state, and of its value a period later.
    observed, result
        After `choose`: the vectors of the observation and of the command.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.inputs: dict[str, list[int]] = {}
        self.outputs: dict[str, tuple[str, list[int] | None]] = {}
        self.memory: dict[str, str] = {}
        self.start: dict[str, list[float]] = {}
        self.examples: list[Any] = []
        self.steps: list[dict[str, Any]] = []
        self.trained: dict[str, Any] = {}
        self.length: dict[str, int] = {}
        self._numbers = 0

    @property
    def text(self) -> str:
        """It as JSON; see `network_text`."""
        keys = ["inputs", "outputs", "memory", "start", "examples", "steps"]
        keys += ["trained"] if self.trained else []
        return json.dumps({key: getattr(self, key) for key in keys})

    def input(self, name: str, shape: list[int]) -> str:
        """Add an input, and return its vector."""
        vector, length = f"x{len(self.inputs)}", int(np.prod(shape, dtype=object))
        if not 0 < length <= MOST_NUMBERS:
            self.refuse(f"an input {name} of {length} numbers")
        self.inputs[name], self.length[vector] = shape, length
        return vector

    def add(self, op: str, of: Sequence[Operand], length: int, **numbers: Any) -> str:
        """Add an operation, and return the name of its output."""
        self._numbers += length + sum(np.size(value) for value in (*numbers.values(), *of))
        if len(self.steps) >= MOST_STEPS or self._numbers > MOST_NUMBERS:
            raise InputError(
                f"{self.name}: expected at most {MOST_STEPS} operations, and {MOST_NUMBERS:,} "
                "numbers that it holds and computes"
            )
        name = f"t{len(self.steps)}"
        self.steps.append({"op": op, "out": name, "of": list(of)} | numbers)
        self.length[name] = length
        return name

    def size(self, operand: Operand) -> int:
        """Return the length of a vector or of numbers."""
        return self.length[operand] if isinstance(operand, str) else len(operand)

    def affine(self, of: Operand, W: Array, b: Array) -> Operand:
        """Add W x + b."""
        W, b = np.asarray(W, dtype=float), np.asarray(b, dtype=float)
        if W.ndim != 2 or W.shape[1] != self.size(of) or b.shape != (len(W),):
            self.refuse(f"a matrix {W.shape} with a bias {b.shape} on {self.size(of)} numbers")
        if not isinstance(of, str):
            return finite(W @ of + b, self.name)
        return self.add("affine", [of], len(W), W=finite(W, self.name), b=finite(b, self.name))

    def entry(self, op: str, *of: Operand, **numbers: float) -> str:
        """Add an operation entry by entry; single numbers count for every entry."""
        lengths, taken = [self.size(x) for x in of], set(LETTERS.findall(ENTRIES[op]))
        if len(of) != len(taken & {*"uvw"}) or len({*lengths} - {1}) > 1 or min(lengths) < 1:
            self.refuse(f"{op} of {' and '.join(map(str, lengths))} numbers")
        if not any(isinstance(x, str) for x in of):
            self.refuse(f"{op} of constants")
        numbers = {key: float(numbers[key]) for key in sorted(taken - {*"uvw"})}
        finite([*numbers.values()], self.name)
        return self.add(op, of, max(lengths), numbers=numbers)

    def placed(self, of: Sequence[Operand], places: Array) -> Operand:
        """Add what takes numbers at places of some operands one after the other."""
        sizes = [self.size(x) for x in of]
        places = np.asarray(places)
        if not len(places) or places.dtype.kind not in "iu":
            self.refuse("an operation without numbers")
        if places.min() < 0 or places.max() >= sum(sizes):
            self.refuse("places outside of a vector")
        if not any(isinstance(x, str) for x in of):
            return np.concatenate([*map(np.asarray, of)])[places].tolist()
        one = of[0] if len(of) == 1 else self.add("concat", of, sum(sizes))
        if np.array_equal(places, np.arange(sum(sizes))):
            return one
        return self.add("take", [one], len(places), places=places.tolist())

    def gru(
        self, x: Operand, h: Operand, arrays: Sequence[Array], *, reset_last: bool = True
    ) -> Operand:
        """Add h ← n + z (h − n), n = tanh(W_n x + b_n + r (U_n h + d_n)); in the order z, r, n.

        Parameters
        ----------
        arrays
            W, U, b and d.
        reset_last
            Whether r multiplies behind U_n, as in PyTorch; else it multiplies h.
        """
        (z, r), a, u = self.gates("Sigmoid", x, h, arrays, 2)
        _, U, _, d = (array[-len(array) // 3 :] for array in arrays)
        last: Operand = self.entry("Mul", r, u[2]) if reset_last else ""
        last = last or self.affine(self.entry("Mul", r, h), U, d)
        n = self.entry("Tanh", self.entry("Add", a[2], last))
        return self.entry("Add", n, self.entry("Mul", z, self.entry("Sub", h, n)))

    def gates(
        self, op: str, x: Operand, h: Operand, arrays: Sequence[Array], count: int
    ) -> tuple[list[str], list[Operand], list[Operand]]:
        """Return the first gates op(W x + b + U h + d), and all rows of both terms."""
        W, U, b, d = arrays
        a, u, rows = self.affine(x, W, b), self.affine(h, U, d), np.arange(len(U))
        ax, uh = ([self.placed([y], k) for k in rows.reshape(-1, U.shape[1])] for y in (a, u))
        gates = [self.entry(op, self.entry("Add", ax[k], uh[k])) for k in range(count)]
        return gates, ax, uh

    def again(self, step: Mapping[str, Any]) -> None:
        """Add an operation of a network that was read before."""
        op, numbers = str(step["op"]), step.get("numbers", {})
        of = [x if isinstance(x, str) else numbers_of(x, self.name) for x in step["of"]]
        if op == "affine":
            self.affine(of[0], *(np.array(step[key], dtype=float) for key in "Wb"))
        elif op == "concat":
            self.add(op, of, sum(self.size(x) for x in of))
        elif op == "take":
            self.placed([of[0]], np.array(step["places"]))
        elif op in ENTRIES:
            self.entry(op, *of, **numbers)
        else:
            self.refuse(f"the operation {op}")

    def remark(self, words: str) -> None:
        """Say something about the file."""
        reporter().remark(EqtWarning(f"{self.name}: {words}"))

    def refuse(self, what: str) -> NoReturn:
        """Raise an `InputError`."""
        raise InputError(f"{self.name}: has {what}, which eqt does not compute")

    def choose(self, memory: Mapping[str, str] | None) -> None:
        """Choose inputs and commands, and pair outputs with the states of the next period."""
        vectors = dict(zip(self.inputs, self.length, strict=False))
        if memory is None:
            memory = self.memory or self.paired()
        for key, ends in (("inputs", memory), ("outputs", memory.values())):
            if unknown := [end for end in ends if end not in getattr(self, key)]:
                raise InputError(
                    f"{self.name}: memory: has no {key[:-1]} {unknown[0]}; its {key} are "
                    f"{', '.join(getattr(self, key))}"
                )
        observed = [name for name in self.inputs if name not in memory]
        commands = [name for name in self.outputs if name not in memory.values()]
        if len(observed) != 1 or not commands:
            raise InputError(
                f"{self.name}: expected one input and an output besides the memory, got "
                f"{', '.join(observed) or 'none'} and {', '.join(commands) or 'none'}; join its "
                "inputs before they enter the network"
            )
        for name in (commands[0], *memory.values()):
            if self.outputs[name][1] is None:
                raise InputError(f"{self.name}: {self.outputs[name][0]}")
        self.states = [(vectors[a], self.outputs[b][0]) for a, b in memory.items()]
        for (before, after), (a, b) in zip(self.states, memory.items(), strict=True):
            if self.length[before] != self.length[after]:
                self.refuse(f"a memory {a} {self.inputs[a]} from {b} {self.outputs[b][1]}")
        starts = [self.start.get(a, [0.0] * self.length[vectors[a]]) for a in memory]
        self.initial = [number for start in starts for number in start]
        if len(self.initial) != sum(self.length[before] for before, _ in self.states):
            self.refuse("a start of another length than its state")
        self.observed, self.result = vectors[observed[0]], self.outputs[commands[0]][0]

    def paired(self) -> dict[str, str]:
        """Pair inputs behind the first with outputs behind the first, by shape or by name."""
        names, pairs = [*self.inputs][1:], dict[str, str]()
        later = [*self.outputs][1:]
        for name in names:
            alike = [x for x in later if self.outputs[x][1] == self.inputs[name]]
            same = [
                x for x in alike if sum(self.inputs[n] == self.inputs[name] for n in names) == 1
            ]
            by_name = [x for x in alike if _stem(x) == _stem(name)]
            chosen = same if len(same) == 1 else by_name
            if len(chosen) != 1 or chosen[0] in pairs.values():
                listed = ", ".join(f"{x} {self.outputs[x][1]}" for x in later) or "none"
                raise InputError(
                    f"{self.name}: has {len(names) + 1} inputs; which output is {name} "
                    f"{self.inputs[name]} a period later? Say so, as in memory: {{{name}: "
                    f"{later[0] if later else 'OUTPUT'}}}; outputs besides the first: {listed}"
                )
            pairs[name] = chosen[0]
        return pairs

    @property
    def commands(self) -> int:
        """Number of commands."""
        return self.length[self.result]

    @property
    def needed(self) -> list[dict[str, Any]]:
        """The steps that lead to the command and to the states a period later."""
        wanted = {self.result, *(after for _, after in self.states)}
        chosen = []
        for step in reversed(self.steps):
            if step["out"] in wanted:
                wanted |= {x for x in step["of"] if isinstance(x, str)}
                chosen.append(step)
        return chosen[::-1]


def _stem(name: str) -> str:
    """Return what names of a state before and after a step share."""
    return re.sub(r"(in|out|input|output|next|new|prev|old|n|t|\d|[_.:/])+$", "", name.lower())


def finite(values: Any, name: str) -> Any:
    """Return numbers as lists; refuse those that are not finite."""
    values = np.asarray(values, dtype=float)
    if not np.isfinite(values).all():
        raise InputError(f"{name}: has weights that are not finite")
    return values.tolist()


def numbers_of(array: Any, name: str) -> list[float]:
    """Return the finite numbers of an array, row by row."""
    return list(finite(np.ravel(np.asarray(array)), name))
