"""Networks as data: from ONNX and checkpoints of RLtools to steps on vectors."""

import io
import json
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import cache, lru_cache, partial, reduce
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np

from eqt_cli.base import yaml_source
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtWarning, InputError, Remedy
from eqt_cli.base.files import open_regular, refusals
from eqt_cli.base.reporting import reporter

MOST_BYTES = 64_000_000
"""Largest file."""

MOST_NUMBERS = 4_000_000
"""Most numbers of a network."""

MOST_STEPS = 1000
"""Most operations."""

MOST_AXES = 16
"""Most axes of an array."""

MOST_WORK = 10_000_000_000
"""Most operations on numbers by which a file is read: some seconds."""

PER_CALL = 100_000
"""So many of them take as long as the evaluator of onnx takes to begin, 0.1 ms."""

PER_NUMBER = 10
"""So many take as long as to read or write one number of an array."""

Operand = str | list[float]
"""The name of a vector, or numbers."""


def table(name: str) -> Any:
    """Return a table of this folder, written in YAML."""
    return yaml_source.load(Path(__file__).with_name(name).read_text(encoding="utf-8"), name).data


OPERATIONS: dict[str, Any] = table("operations.yaml")
"""Operations that eqt computes, by their names in ONNX."""

ENTRIES: dict[str, str] = OPERATIONS["entries"]

LETTERS = re.compile(r"\b(?:[uvw]|alpha|beta|gamma)\b")

_KINDS = {op: kind for kind in ("entries", "placed", "affine", "folded") for op in OPERATIONS[kind]}
_KINDS |= OPERATIONS["others"]
"""How each operation on computed numbers is read: a method of `_OfGraph`."""


def network_text(path: Path) -> str:
    """Return a network as JSON: all of its inputs and outputs, and the steps between them.

    A step has ``op``, ``out``, ``of``, and numbers. An output has its vector and its shape, or why
    eqt does not compute it. ``start`` are states of recurrent units, and ``examples`` inputs and
    outputs one after the other from there. ``trained`` is what the file says of its training.

    Raises
    ------
    InputError
        If the file cannot be read, or has what eqt cannot compute.
    """
    readers = {".onnx": of_onnx, ".h5": of_rltools, ".pt": _of_torch, ".pth": _of_torch}
    if path.suffix not in readers:
        raise InputError(f"{path.name}: expected a network, .onnx or .h5")
    built = readers[path.suffix](_content(path), path)
    if len(built.inputs) > 1 and not built.memory:
        with suppress(InputError):  # then the configuration has to say it
            pairs = ", ".join(f"{state}: {later}" for state, later in built.paired().items())
            built.remark(
                f"its memory is {{{pairs}}}, by names and shapes, unless `memory` says otherwise"
            )
    return built.text


def _content(path: Path) -> bytes:
    with refusals(path, "read", kind=InputError), open_regular(path) as stream:
        content = stream.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise InputError(f"{path.name}: expected at most {MOST_BYTES:,} bytes")
    return content


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
        built.start = {key: _finite(values, name) for key, values in data["start"].items()}
        built.examples = [_finite(np.array(example), name) for example in data["examples"]]
        built.choose(None if memory is None else dict(memory))
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, RecursionError) as error:
        raise InputError(f"{name}: is not a network as eqt stores it: {error}") from error
    return built


def _of_torch(content: bytes, path: Path) -> "Built":
    raise InputError(
        f"{path.name}: a file of PyTorch can run code when it is loaded; write it as ONNX with "
        "torch.onnx.export(policy, torch.zeros(1, n), 'policy.onnx'), and give that"
    )


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
            return _finite(W @ of + b, self.name)
        return self.add("affine", [of], len(W), W=_finite(W, self.name), b=_finite(b, self.name))

    def entry(self, op: str, *of: Operand, **numbers: float) -> str:
        """Add an operation entry by entry; single numbers count for every entry."""
        lengths, taken = [self.size(x) for x in of], set(LETTERS.findall(ENTRIES[op]))
        if len(of) != len(taken & {*"uvw"}) or len({*lengths} - {1}) > 1 or min(lengths) < 1:
            self.refuse(f"{op} of {' and '.join(map(str, lengths))} numbers")
        if not any(isinstance(x, str) for x in of):
            self.refuse(f"{op} of constants")
        numbers = {key: float(numbers[key]) for key in sorted(taken - {*"uvw"})}
        _finite([*numbers.values()], self.name)
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
        of = [x if isinstance(x, str) else _numbers(x, self.name) for x in step["of"]]
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


def _finite(values: Any, name: str) -> Any:
    values = np.asarray(values, dtype=float)
    if not np.isfinite(values).all():
        raise InputError(f"{name}: has weights that are not finite")
    return values.tolist()


# ONNX ---------------------------------------------------------------------------------------------
#
# Arrays become vectors, row by row, since every shape is known. What only places numbers, and what
# is affine, is evaluated by onnx itself when a file is read: on the numbers of places, or at zero
# and at unit vectors. So are constants.


def of_onnx(content: bytes, path: Path) -> Built:
    """Return the network of an ONNX file, whose weights may be in files next to it."""
    try:
        import onnx
        import onnx.inliner
        import onnx.reference
    except ImportError:
        raise InputError(
            f"{path.name}: reading ONNX needs the package onnx",
            Remedy("run pip install '.[network]' in the checkout of eqt"),
        ) from None
    try:
        model = onnx.load_model_from_string(content)
    except Exception as error:
        raise InputError(f"{path.name}: is not an ONNX file: {error}") from error
    try:
        if _nodes_of(model, onnx) > MOST_NODES:
            raise ValueError(f"more than {MOST_NODES:,} with those of its functions")
        model = onnx.inliner.inline_local_functions(model)
        for _ in range(3):  # functions of functions
            others = {node.op_type for node in model.graph.node if not node.domain}
            names = [("", op) for op in sorted(others - _KINDS.keys() - {*OPERATIONS["fixed"]})]
            model.graph.value_info.extend(  # of which the types are asked
                onnx.helper.make_tensor_value_info(array.name, array.data_type, array.dims)
                for array in model.graph.initializer
            )
            model = onnx.shape_inference.infer_shapes(model)
            model = onnx.inliner.inline_selected_functions(model, names, False, True)
    except Exception as error:
        raise InputError(f"{path.name}: has operations that do not fit: {error}") from error
    try:
        built = _OfGraph(model, path, onnx).built
        built.trained = _trained(model)
        return built
    except InputError:
        raise
    except Exception as error:  # a damaged file may make onnx raise anything
        words = f"{type(error).__name__}: {error}"
        raise InputError(f"{path.name}: has what onnx cannot read: {words}") from error


TRAINED = "eqt_trained"
"""Key of the metadata of an ONNX file under which `eqt_cli.gym` describes the training."""

_MOST_LETTERS = 20_000


def _trained(model: Any) -> dict[str, Any]:
    """Return what the metadata of a file says of the training; {} if it does not say it so."""
    texts = [entry.value for entry in model.metadata_props if entry.key == TRAINED]
    with suppress(ValueError, RecursionError):
        about = json.loads(texts[0][:_MOST_LETTERS]) if texts else None
        if isinstance(about, dict):
            return {str(key): x for key, x in about.items() if isinstance(x, int | float | str)}
    return {}


MOST_NODES = 10 * MOST_STEPS
"""Most operations in a file, of which some may lead to no output."""


def _nodes_of(model: Any, onnx: Any) -> int:
    """Return how many nodes a model has once its functions stand where they are called."""
    functions = {(function.domain, function.name): function.node for function in model.functions}

    @cache
    def size_of(key: tuple[str, str]) -> int:
        return count(functions[key])  # of one that calls itself, Python gives up

    def count(nodes: Any) -> int:
        total = 0
        for node in nodes:
            key = node.domain, node.op_type
            total += size_of(key) if key in functions else 1
            for option in node.attribute:
                graphs = [option.g] if option.HasField("g") else option.graphs
                total += sum(count(graph.node) for graph in graphs)
        return total

    return count(model.graph.node)


class _Value(NamedTuple):
    """A vector as an array of the graph."""

    of: Operand
    shape: tuple[int, ...]


class _OfGraph:
    """Reads a graph, in which every value is an array, a `_Value`, or why it is not computed."""

    def __init__(self, model: Any, path: Path, onnx: Any) -> None:
        self.path, self.name, self.onnx, graph = path, path.name, onnx, model.graph
        self.opsets, self.beside, self.work = model.opset_import, dict[str, bytes](), 0
        self.built = built = Built(path.name)
        self.values: dict[str, Any] = {
            array.name: self._array(array) for array in graph.initializer
        }
        for entry in graph.input:
            if entry.name not in self.values:
                shape = self._shape(entry, not built.inputs)
                self.values[entry.name] = _Value(built.input(entry.name, list(shape)), shape)
        for node in self._needed(graph):
            try:
                outputs = self._node(node)
            except InputError as error:
                outputs = [str(error.args[0]).removeprefix(f"{self.name}: ")] * len(node.output)
            self.values |= dict(zip(node.output, outputs, strict=False))
        for name in (output.name for output in graph.output):
            value = self.values.get(name, f"has no {name}, which it promises")
            if isinstance(value, np.ndarray):
                value = f"has the constant output {name}, which depends on nothing"
            built.outputs[name] = value, None
            if isinstance(value, _Value):
                built.outputs[name] = str(value.of), [*value.shape]
        half = {self.onnx.TensorProto.FLOAT16, self.onnx.TensorProto.BFLOAT16}
        if half.intersection(array.data_type for array in graph.initializer):
            built.remark("its weights are of 16 bits; eqt computes with them in double")
        first = next(iter(built.outputs.values()), ("has no output", None))
        if first[1] is None:
            raise InputError(f"{self.name}: {first[0]}")

    def _needed(self, graph: Any) -> list[Any]:
        """Return the nodes that lead to an output."""
        wanted, chosen = {output.name for output in graph.output}, []
        for node in reversed(graph.node):
            if wanted.intersection(node.output):
                wanted.update(node.input)
                chosen.append(node)
        if len(chosen) > MOST_NODES:
            self.built.refuse(f"{len(chosen):,} operations")
        return chosen[::-1]

    def _array(self, tensor: Any) -> Array:
        if int(np.prod(tensor.dims, dtype=object) if tensor.dims else 1) > MOST_NUMBERS:
            raise InputError(f"{self.name}: {tensor.name} has more than {MOST_NUMBERS:,} numbers")
        if tensor.data_location == self.onnx.TensorProto.EXTERNAL or tensor.external_data:
            self._read_beside(tensor)
        try:
            return np.asarray(self.onnx.numpy_helper.to_array(tensor))
        except Exception as error:
            raise InputError(f"{self.name}: {tensor.name} is damaged: {error}") from error

    def _read_beside(self, tensor: Any) -> None:
        """Read the weights of a tensor from a file in the same folder."""
        where = {entry.key: entry.value for entry in tensor.external_data}
        place, span = where.get("location", ""), [where.get(x, "0") for x in ("offset", "length")]
        if not all(re.fullmatch(r"[0-9]{1,15}", number) for number in span):
            self.built.refuse(f"weights {tensor.name} from byte {span[0]}, {span[1]} bytes long")
        inline = f"onnx.save(onnx.load('{self.name}'), 'whole.onnx') writes one file"
        if not place or Path(place).name != place or self.path.with_name(place).is_symlink():
            raise InputError(
                f"{self.name}: the weights {tensor.name} are in {place!r}; expected a file next to "
                f"the network: {inline}"
            )
        try:
            content = self.beside[place] = self.beside.get(place) or _content(
                self.path.with_name(place)
            )
        except InputError as error:
            raise InputError(
                f"{self.name}: the weights {tensor.name} are in {place}, which must be next to "
                f"it ({error.args[0]}); or {inline}"
            ) from error
        end = int(where.get("length", len(content)))
        tensor.raw_data = content[int(span[0]) :][:end]
        tensor.data_location = self.onnx.TensorProto.DEFAULT
        del tensor.external_data[:]

    def _shape(self, value: Any, observed: bool) -> tuple[int, ...]:
        """Return the shape of an input, of one run; axes of an unknown length have length 1."""
        shape = [axis.dim_value for axis in value.type.tensor_type.shape.dim]
        if observed and (not shape or shape[-1] < 1 or max(shape[:-1], default=0) > 1):
            raise InputError(
                f"{self.name}: the input {value.name} has the shape {shape}; expected a vector of "
                "a known length, with axes of length 1 before it"
            )
        return tuple(max(length, 1) for length in shape)

    def _node(self, node: Any) -> list[Any]:
        """Return the outputs of a node."""
        op, get = node.op_type, self.onnx.helper.get_attribute_value
        options = {option.name: get(option) for option in node.attribute}
        if op == "Constant" and "value" in options:
            return [self._array(options["value"])]
        if unknown := [x for x in node.input if x and x not in self.values]:
            raise InputError(f"{op} takes {unknown[0]}, which nothing before it gives (a cycle?)")
        values = [self.values[x] if x else None for x in node.input]
        if refused := [value for value in values if isinstance(value, str)]:
            raise InputError(refused[0])
        moving = any(isinstance(value, _Value) for value in values)
        computed = {*_KINDS} if moving else {*_KINDS, *OPERATIONS["fixed"]}
        if node.domain in ("", "ai.onnx", "ai.onnx.ml") and op in computed:
            if not moving:
                return self._evaluator(node)(values)
            outputs: list[Any] = getattr(self, f"_{_KINDS[op]}")(node, values, options)
            return outputs
        causes = (cause for word, cause in OPERATIONS["remedies"].items() if op.startswith(word))
        cause = next(causes, "write it with other operations, those of the page on learned laws")
        name = f"{node.domain}.{op}" if node.domain else op
        raise InputError(f"has {name}, which eqt does not compute: {cause}")

    def _evaluator(self, node: Any) -> Callable[[list[Any]], list[Any]]:
        """Return the node as a function of arrays, computed by onnx."""
        make, names = self.onnx.helper, [f"i{k}" if x else "" for k, x in enumerate(node.input)]
        outs = [f"o{k}" if x else "" for k, x in enumerate(node.output)]
        alone = self.onnx.NodeProto()
        alone.CopyFrom(node)
        del alone.input[:], alone.output[:]
        alone.input.extend(names)
        alone.output.extend(outs)
        info, kind = make.make_tensor_value_info, self.onnx.TensorProto.FLOAT
        graph = make.make_graph(
            [alone],
            "one",
            [info(x, kind, None) for x in names if x],
            [info(x, kind, None) for x in outs if x],
        )
        model = make.make_model(graph, opset_imports=self.opsets)
        run = self.onnx.reference.ReferenceEvaluator(model).run

        def evaluate(values: list[Any]) -> list[Any]:
            arrays = {x: np.asarray(v) for x, v in zip(names, values, strict=True) if x}
            try:
                sizes = [array.size for array in arrays.values()]
                self._count(PER_CALL + PER_NUMBER * (sum(sizes) + self._numbers_in(model, arrays)))
                self._count(_products(node, [*arrays.values()]))
                outputs = iter(run(None, arrays))
            except Exception as error:
                raise InputError(f"has {node.op_type} that does not fit: {error}") from error
            return [np.asarray(next(outputs)) if x else None for x in outs]

        return evaluate

    def _count(self, work: int) -> None:
        """Raise an `InputError` before a file takes more operations than one may."""
        self.work += work
        if self.work > MOST_WORK:
            raise InputError(f"it takes more than {MOST_WORK:,} operations to read the file")

    def _numbers_in(self, model: Any, arrays: Mapping[str, Array]) -> int:
        """Return how many numbers a node makes; raise an `InputError` if it may make too many."""
        sized, make = self.onnx.ModelProto(), self.onnx.helper
        sized.CopyFrom(model)
        for value in sized.graph.input:
            array = arrays[value.name]
            kind = make.np_dtype_to_tensor_dtype(array.dtype)
            value.CopyFrom(make.make_tensor_value_info(value.name, kind, array.shape))
            if array.size <= MOST_AXES:  # it may be a shape
                tensor = self.onnx.numpy_helper.from_array(array, value.name)
                sized.graph.initializer.append(tensor)
        if model.graph.node[0].op_type in OPERATIONS["sized"] and any(
            array.size > MOST_AXES for array in [*arrays.values()][-1:]
        ):
            raise InputError(f"it makes an array of more than {MOST_AXES} axes")
        shapes, total = self.onnx.shape_inference.infer_shapes(sized), 0
        for value in shapes.graph.output:
            dims = [x.dim_value for x in value.type.tensor_type.shape.dim]
            size = int(np.prod(dims, dtype=object))
            if size > MOST_NUMBERS:
                raise InputError(f"it makes {size:,} numbers, and {MOST_NUMBERS:,} are allowed")
            total += size
        return total

    def _cast(self, node: Any, values: list[Any], options: Mapping[str, Any]) -> list[Any]:
        """Numbers keep their value in another real type; a number other than 0 is true."""
        kinds, to = self.onnx.TensorProto, options.get("to")
        if to == kinds.BOOL:
            return [self._entry("Not", self._entry("Equal", values[0], 0.0))]
        if to not in (kinds.FLOAT, kinds.DOUBLE, kinds.FLOAT16, kinds.BFLOAT16, None):
            self.built.refuse("a Cast of computed numbers to integers")
        return [values[0]]

    def _measured(self, node: Any, values: list[Any], options: Mapping[str, Any]) -> list[Any]:
        return self._evaluator(node)([np.zeros(values[0].shape)])

    def _entries(self, node: Any, values: list[Any], options: Mapping[str, Any]) -> list[Any]:
        usual = OPERATIONS["attributes"].get(node.op_type, {})
        numbers = {key: options.get(key, number) for key, number in usual.items()}
        return [self._entry(node.op_type, *values, **numbers)]

    def _clip(self, node: Any, values: list[Any], options: Mapping[str, Any]) -> list[Any]:
        ends = [options.get("min", -1e300), options.get("max", 1e300)]
        for k, end in enumerate(values[1:]):
            ends[k] = ends[k] if end is None else end
        return [self._entry("Clip", values[0], *ends)]

    def _folded(self, node: Any, values: list[Any], options: Mapping[str, Any]) -> list[Any]:
        columns = self._columns(node, values) if node.op_type.startswith("Reduce") else values
        return [reduce(partial(self._entry, OPERATIONS["folded"][node.op_type]), columns)]

    def _placed(self, node: Any, values: list[Any], options: Mapping[str, Any]) -> list[Any]:
        data = values if node.op_type == "Concat" else values[:1]
        if any(isinstance(value, _Value) for value in values[len(data) :]):
            self.built.refuse(f"{node.op_type} by computed numbers")
        operands = [x.of if isinstance(x, _Value) else _numbers(x, self.name) for x in data]
        shapes = [np.shape(x) if isinstance(x, np.ndarray) else x.shape for x in data]
        ends = np.cumsum([0, *(self.built.size(x) for x in operands)])
        places = [
            np.arange(start, start + np.prod(shape, dtype=int)).reshape(shape)
            for start, shape in zip(ends, shapes, strict=False)
        ]
        outputs = self._evaluator(node)([*places, *values[len(data) :]])
        return [
            None if x is None else _Value(self.built.placed(operands, x.ravel()), x.shape)
            for x in outputs[: 1 if node.op_type == "Dropout" else None]
        ]

    def _affine(self, node: Any, values: list[Any], options: Mapping[str, Any]) -> list[Any]:
        """W and b from the values of the node at unit vectors and at zero, in double."""
        moving = [k for k, value in enumerate(values) if isinstance(value, _Value)]
        if len(moving) > 1:
            self.built.refuse(f"{node.op_type} of two computed arrays, as attention has")
        (k,), evaluate, arrays = moving, self._evaluator(node), list[Any](values)
        x, n = values[k], int(np.prod(values[k].shape))
        for place, value in enumerate(arrays):
            if isinstance(value, np.ndarray) and value.dtype.kind not in "biu":
                arrays[place] = value.astype(float)

        def at(array: Array) -> Array:
            arrays[k] = array
            return np.asarray(evaluate(arrays)[0], dtype=float)

        zero = at(np.zeros(x.shape))
        if n * zero.size > MOST_NUMBERS:
            self.built.refuse(f"{node.op_type} with a matrix of {n * zero.size:,} numbers")
        rows = node.op_type in ("Gemm", "MatMul") and k == 0 and np.ndim(values[1]) == 2
        if rows and x.shape[-1] == n and not options.get("transA"):
            W = at(np.eye(n)) - zero.ravel()  # each row of its input has a row of its output
        else:
            unit, columns = np.zeros(n), list[Array]()
            for k_th in range(n):
                unit[k_th] = 1.0
                columns.append((at(unit.reshape(x.shape)) - zero).ravel())
                unit[k_th] = 0.0
            W = np.array(columns)
        return [_Value(self.built.affine(x.of, W.T, zero.ravel()), zero.shape)]

    def _entry(self, op: str, *values: Any, **numbers: float) -> _Value:
        """Add an operation entry by entry; smaller operands are repeated as NumPy does."""
        shapes = [x.shape if isinstance(x, _Value) else np.shape(x) for x in values]
        try:
            shape = np.broadcast_shapes(*shapes)
        except ValueError as error:
            raise InputError(f"has {op} that does not fit: {error}") from error
        operands = list[Operand]()
        if np.prod(shape, dtype=object) > MOST_NUMBERS:
            self.built.refuse(f"{op} of {np.prod(shape, dtype=object):,} numbers")
        for value, own_shape in zip(values, shapes, strict=True):
            of = value.of if isinstance(value, _Value) else _numbers(value, self.name)
            size = int(np.prod(own_shape, dtype=int))
            if size not in (1, int(np.prod(shape, dtype=int))):
                places = np.broadcast_to(np.arange(size).reshape(own_shape), shape)
                of = self.built.placed([of], places.ravel())
            operands.append(of)
        return _Value(self.built.entry(op, *operands, **numbers), shape)

    def _columns(self, node: Any, values: list[Any]) -> list[_Value]:
        """Return the entries along the axes of a reduction, each in the shape of its result."""
        size, evaluate = int(np.prod(values[0].shape)), self._evaluator(node)
        sign = 1 if node.op_type == "ReduceMax" else -1
        places, columns = np.arange(size, dtype=float).reshape(values[0].shape), []
        left = places.copy()
        one = evaluate([places, *values[1:]])[0].size
        if size // max(one, 1) * size > SORTED:
            self.built.refuse(f"{node.op_type} of {size:,} numbers to {one:,}")
        while np.isfinite(left).any():  # the last place of each, then the one before it, …
            last = evaluate([sign * left, *values[1:]])[0] * sign
            columns.append(last)
            left[np.isin(left, last)] = -np.inf
        of = values[0].of
        return [_Value(self.built.placed([of], x.astype(int).ravel()), x.shape) for x in columns]

    def _recurrent(self, node: Any, values: list[Any], options: Mapping[str, Any]) -> list[Any]:
        """GRU, whose gates are in the order z, r, h; LSTM, in i, o, f, c; or RNN; step by step."""
        built, op, size = self.built, node.op_type, int(options["hidden_size"])
        X, W, R, B, _, h, c, P = (values + [None] * 8)[:8]
        plain = {"GRU": [b"Sigmoid", b"Tanh"], "LSTM": [b"Sigmoid", b"Tanh", b"Tanh"]}
        functions = options.get("activations", plain.get(op, [b"Tanh"]))
        usual = functions == plain.get(op, functions) and "clip" not in options and P is None
        if options.get("direction", b"forward") != b"forward" or not usual:
            built.refuse(f"{op} in another direction, or with other functions than PyTorch's")
        layout = int(options.get("layout", 0))
        shape = X.shape if isinstance(X, _Value) else np.shape(X)
        steps, batch = shape[layout], shape[1 - layout]
        if batch != 1 or not all(isinstance(x, np.ndarray) for x in (W, R)):
            built.refuse(f"{op} of several runs, or with computed weights")
        arrays = [np.asarray(x, dtype=float)[0] for x in (W, R)]
        biases = np.zeros(2 * len(arrays[0])) if B is None else np.asarray(B, dtype=float)[0]
        arrays += np.split(biases, 2)
        of = X.of if isinstance(X, _Value) else _numbers(X, self.name)
        h, c = (
            x.of
            if isinstance(x, _Value)
            else _numbers(np.zeros(size) if x is None else x, self.name)
            for x in (h, c)
        )
        rows, length = list[Operand](), built.size(of) // steps
        for step in range(steps):
            x = built.placed([of], np.arange(step * length, (step + 1) * length))
            if op == "GRU":
                h = built.gru(x, h, arrays, reset_last=bool(options.get("linear_before_reset")))
            elif op == "LSTM":
                (i, o, f), a, u = built.gates("Sigmoid", x, h, arrays, 3)
                new = built.entry("Tanh", built.entry("Add", a[3], u[3]))
                c = built.entry("Add", built.entry("Mul", f, c), built.entry("Mul", i, new))
                h = built.entry("Mul", o, built.entry("Tanh", c))
            else:
                (h,), _, _ = built.gates(functions[0].decode(), x, h, arrays, 1)
            rows.append(h)
        whole = (1, steps, 1, size) if layout else (steps, 1, 1, size)
        last = [_Value(state, (1, 1, size)) for state in (h, c)]
        return [_Value(built.placed(rows, np.arange(size * steps)), whole), *last]


SORTED = 100_000_000
"""Most numbers among which those of columns are looked for, in all."""


def _products(node: Any, arrays: Sequence[Array]) -> int:
    """Return how many products a node sums up; 0 of one that sums up none."""
    shapes, op = [array.shape for array in arrays], node.op_type
    if op == "Einsum":
        texts = [option.s.decode() for option in node.attribute if option.name == "equation"]
        operands = re.sub(r"\s|->.*", "", texts[0]).split(",")
        lengths = dict[str, int]()
        for letters, shape in zip(operands, shapes, strict=False):
            if "." in letters:  # of any axes
                return int(np.prod([array.size for array in arrays], dtype=object))
            lengths |= zip(letters, shape, strict=True)
        return int(np.prod([*lengths.values()], dtype=object))
    if op in ("MatMul", "Gemm"):  # at most as many as the rows of one with all of the other
        return min(
            arrays[0].size * max(shapes[1], default=1), arrays[1].size * max(shapes[0], default=1)
        )
    if op == "Conv":
        return arrays[0].size * arrays[1].size
    return 0


def _numbers(array: Any, name: str) -> list[float]:
    return list(_finite(np.ravel(np.asarray(array)), name))


# Checkpoints of RLtools ---------------------------------------------------------------------------


EXAMPLES = 20
"""Number of steps of the examples in a checkpoint that are kept, and checked."""

_ACTIVATIONS = {"RELU": "Relu", "SIGMOID": "Sigmoid", "TANH": "Tanh", "FAST_TANH": "FastTanh"}


def of_rltools(content: bytes, path: Path) -> Built:
    """Return the actor of a checkpoint of RLtools, with the first of its examples."""
    import h5py

    name = path.name
    try:
        file = h5py.File(io.BytesIO(content), "r")
    except Exception as error:
        raise InputError(f"{name}: is not an HDF5 file: {error}") from error
    with file:
        try:
            return _actor(name, _Checkpoint(name, file))
        except InputError:
            raise
        except Exception as error:  # of h5py many
            raise InputError(f"{name}: is damaged: {error}") from error


def _actor(name: str, actor: "_Checkpoint") -> Built:
    inputs, expected = (actor.numbers(f"example/{key}") for key in ("input", "output"))
    if inputs.ndim != 3 or expected.ndim != 3:
        raise InputError(f"{name}: expected examples of steps, batches and numbers")
    built = Built(name)
    result = actor.layer(built, "actor", built.input("x", [inputs.shape[-1]]))
    built.outputs = {"y": (str(result), [built.size(result)]), **built.outputs}
    sequence = slice(None, EXAMPLES), 0
    built.examples = [inputs[sequence].tolist(), expected[sequence].tolist()]
    return built


class _Checkpoint:
    """The groups of a checkpoint, of which only what the file itself holds is read."""

    def __init__(self, name: str, file: Any) -> None:
        self.name, self.file = name, file

    def _at(self, place: str) -> Any:
        import h5py

        here = self.file
        for part in place.split("/"):
            link = here.get(part, getlink=True) if isinstance(here, h5py.Group) else None
            if type(link) is not h5py.HardLink:
                raise InputError(f"{self.name}: has no {place}, which a checkpoint of RLtools has")
            here = here[part]
        return here

    def numbers(self, place: str) -> Array:
        """Return an array of the file."""
        import h5py

        dataset = self._at(place)
        plain = isinstance(dataset, h5py.Dataset) and not (dataset.external or dataset.is_virtual)
        if not plain or dataset.dtype.kind != "f" or dataset.size > MOST_NUMBERS:
            raise InputError(
                f"{self.name}: {place}: expected at most {MOST_NUMBERS:,} numbers in this file"
            )
        return np.asarray(dataset[()], dtype=float)

    def _of(self, place: str, key: str) -> str:
        value = self._at(place).attrs.get(key, "")
        return value.decode() if isinstance(value, bytes) else str(value)

    def layer(self, built: Built, place: str, of: Operand, deep: int = 0) -> Operand:
        """Add a layer, and return the name of its output."""
        kind = self._of(place, "type")
        if kind == "sequential" and deep < DEEPEST:
            for k in range(len(self._at(f"{place}/layers"))):
                of = self.layer(built, f"{place}/layers/{k}", of, deep + 1)
            return of
        if kind == "mlp":
            hidden = range(int(self._of(place, "num_layers") or 0) - 2)
            for layer_name in [
                "input_layer",
                *(f"hidden_layer_{k}" for k in hidden),
                "output_layer",
            ]:
                of = self._dense(built, f"{place}/{layer_name}", of)
            return of
        if kind == "dense":
            return self._dense(built, place, of)
        if kind == "sample_and_squash":
            return built.entry("Tanh", built.placed([of], np.arange(built.size(of) // 2)))
        if kind != "gru":
            built.refuse(f"the layer {kind or 'without a type'} at {place}")
        W, U, b, d, start = (
            self.numbers(f"{place}/{layer_name}/parameters")
            for layer_name in (
                *("weights_input", "weights_hidden", "biases_input", "biases_hidden"),
                "initial_hidden_state",
            )
        )
        if U.ndim != 2 or len(U) != 3 * U.shape[1] or start.size != U.shape[1]:
            built.refuse(f"recurrent units of other shapes at {place}")
        name = f"h{len(built.memory)}"
        order = np.arange(len(U)).reshape(3, -1)[[1, 0, 2]].ravel()  # r, z, n
        arrays = [np.asarray(x)[order] for x in (W, U, np.ravel(b), np.ravel(d))]
        state = built.gru(of, built.input(name, [U.shape[1]]), arrays)
        built.outputs[f"{name}_next"] = str(state), [U.shape[1]]
        built.memory[name], built.start[name] = f"{name}_next", _numbers(start, self.name)
        return state

    def _dense(self, built: Built, place: str, of: Operand) -> Operand:
        W, b = (self.numbers(f"{place}/{part}/parameters") for part in ("weights", "biases"))
        of, function = built.affine(of, W, np.ravel(b)), self._of(place, "activation_function")
        if function == "IDENTITY":
            return of
        if function not in _ACTIVATIONS:
            built.refuse(f"the activation {function} at {place}")
        return built.entry(_ACTIVATIONS[function], of)


DEEPEST = 8
"""Most layers within each other."""
