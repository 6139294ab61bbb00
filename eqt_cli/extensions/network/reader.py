"""Networks as data: from ONNX and checkpoints of RLtools to steps on vectors."""

import io
import json
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NoReturn, Self

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import InputError, Remedy
from eqt_cli.base.files import open_regular, refusals

MOST_BYTES = 64_000_000
"""Largest file."""

MOST_NUMBERS = 4_000_000
"""Most numbers of a network."""

MOST_STEPS = 1000
"""Most operations."""


def network_text(path: Path) -> str:
    """Return a network as JSON: ``inputs``, ``outputs``, ``start`` and ``steps``.

    A step has ``op``, ``out``, ``of``, and numbers. ``start`` is the state of recurrent units, and
    ``examples`` are inputs and outputs one after the other from there.

    Raises
    ------
    InputError
        If the file cannot be read, or has what eqt cannot compute.
    """
    readers = {".onnx": of_onnx, ".h5": of_rltools, ".pt": _of_torch, ".pth": _of_torch}
    if path.suffix not in readers:
        raise InputError(f"{path.name}: expected a network, .onnx or .h5")
    with refusals(path, "read", kind=InputError), open_regular(path) as stream:
        made = stream.read(MOST_BYTES + 1)
    if len(made) > MOST_BYTES:
        raise InputError(f"{path.name}: expected at most {MOST_BYTES:,} bytes")
    built = readers[path.suffix](made, path.name).complete()
    keys = ("inputs", "outputs", "start", "examples", "steps")
    return json.dumps({key: getattr(built, key) for key in keys})


@lru_cache(maxsize=16)
def network_of(text: str, name: str) -> "Built":
    """Return the network of a text, whose every operation, name and number is checked.

    Raises
    ------
    InputError
        If it is not as `network_text` writes it.
    """
    try:
        data = json.loads(text)
        built = Built(name, int(data["inputs"]))
        for step in data["steps"]:
            built.again(step, np.array(data["start"], dtype=float))
        built.examples = [_finite(np.array(each), name) for each in data["examples"]]
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, RecursionError) as error:
        raise InputError(f"{name}: is not a network as eqt stores it: {error}") from error
    return built.complete()


def _of_torch(made: bytes, name: str) -> "Built":
    raise InputError(
        f"{name}: a file of PyTorch can run code when it is loaded; write it as ONNX with "
        "torch.onnx.export(policy, torch.zeros(1, n), 'policy.onnx'), and give that"
    )


class Built:
    """A network that is built step by step.

    Parameters
    ----------
    name
        Name of the file, for messages.
    inputs
        Number of inputs.

    Attributes
    ----------
    start, examples, steps
        As in `network_text`.
    length
        The lengths of the vector of inputs, ``x``, and of the output of each step.
    """

    def __init__(self, name: str, inputs: int) -> None:
        self.name, self.inputs = name, inputs
        self.start: list[float] = []
        self.examples: list[Any] = []
        self.steps: list[dict[str, Any]] = []
        self.length = {"x": inputs}
        self._numbers = 0

    def add(self, op: str, of: Sequence[Any], length: int, **numbers: Any) -> str:
        """Add an operation, and return the name of its output."""
        self._numbers += sum(np.size(value) for value in numbers.values())
        if len(self.steps) >= MOST_STEPS or self._numbers > MOST_NUMBERS:
            raise InputError(
                f"{self.name}: expected at most {MOST_STEPS} operations and {MOST_NUMBERS:,} "
                "numbers"
            )
        name = f"t{len(self.steps)}"
        self.steps.append({"op": op, "out": name, "of": list(of)} | numbers)
        self.length[name] = length
        return name

    def affine(self, of: str, W: Array, b: Array) -> str:
        """Add W x + b."""
        if W.ndim != 2 or W.shape[1] != self.length[of] or b.shape != (len(W),):
            self.refuse(f"a matrix {W.shape} with a bias {b.shape} on {self.length[of]} numbers")
        return self.add("affine", [of], len(W), W=_finite(W, self.name), b=_finite(b, self.name))

    def gru(self, of: str, W: Array, U: Array, b: Array, d: Array, start: Array) -> str:
        """Add recurrent units in the order r, z, n."""
        size = U.shape[-1]
        shapes = (3 * size, self.length[of]), (3 * size, size), (3 * size,), (3 * size,), (size,)
        if tuple(each.shape for each in (W, U, b, d, start)) != shapes:
            self.refuse("recurrent units of other shapes")
        at, numbers = len(self.start), {"W": W, "U": U, "b": b, "d": d}
        self.start += _finite(start, self.name)
        listed = {key: _finite(value, self.name) for key, value in numbers.items()}
        return self.add("gru", [of], size, at=at, **listed)

    def again(self, step: Mapping[str, Any], start: Array) -> str:
        """Add an operation of a network that was read before."""
        op, first, numbers = str(step["op"]), step["of"][0], step.get("numbers", {})
        of = [x if isinstance(x, str) else _finite(np.array(x), self.name) for x in step["of"]]
        if op in _PAIRS.values():
            return self.pair(op, of)
        if op == "concat":
            return self.add(op, of, sum(self.length[x] for x in of))
        size = self.length[first]
        arrays = {key: np.array(step[key], dtype=float) for key in "WUbd" if key in step}
        if op == "affine":
            return self.affine(first, **arrays)
        if op == "gru":
            at = len(self.start)
            return self.gru(first, **arrays, start=start[at : at + arrays["U"].shape[1]])
        if op == "head":
            return self.add(op, [first], size // 2)
        if op not in {"clip", *_ACTIVATIONS.values(), *(name for name, _ in _FUNCTIONS.values())}:
            self.refuse(f"the operation {op}")
        listed = {key: float(numbers[key]) for key in ("a", "low", "high") if key in numbers}
        return self.add(op, [first], size, numbers=listed)

    def pair(self, op: str, sides: Sequence[Any]) -> str:
        """Add an operation on two vectors, one of which may be numbers, or a single one."""
        lengths = [self.length[x] if isinstance(x, str) else len(x) for x in sides]
        if len(sides) != 2 or len({*lengths} - {1}) > 1 or all(isinstance(x, list) for x in sides):
            self.refuse(f"{op} of {' and '.join(map(str, lengths))} numbers")
        return self.add(op, sides, max(lengths))

    def refuse(self, what: str) -> NoReturn:
        """Raise an `InputError`."""
        raise InputError(f"{self.name}: has {what}, which eqt does not compute")

    def complete(self) -> Self:
        """Return the network, which has an operation."""
        if not self.steps:
            self.refuse("no operation")
        return self

    @property
    def outputs(self) -> int:
        """Number of outputs."""
        return self.length[self.steps[-1]["out"]]


def _finite(values: Array, name: str) -> Any:
    values = np.asarray(values, dtype=float)
    if not np.isfinite(values).all():
        raise InputError(f"{name}: has weights that are not finite")
    return values.tolist()


# ONNX ---------------------------------------------------------------------------------------------

_SAME = {"Identity", "Reshape", "Flatten", "Squeeze", "Unsqueeze"}
"""Operations that leave a vector as it is, but for axes of length 1."""

_FUNCTIONS = {
    "Relu": ("relu", None),
    "Tanh": ("tanh", None),
    "Sigmoid": ("sigmoid", None),
    "Elu": ("elu", 1.0),
    "LeakyRelu": ("leaky_relu", 0.01),
}
_PAIRS = {"Add": "add", "Sub": "sub", "Mul": "mul", "Div": "div"}


def of_onnx(made: bytes, name: str) -> Built:
    """Return the network of an ONNX file."""
    try:
        import onnx
    except ImportError:
        raise InputError(
            f"{name}: reading ONNX needs the package onnx", Remedy("pip install 'eqt-cli[network]'")
        ) from None
    try:
        model = onnx.load_model_from_string(made)
    except Exception as error:
        raise InputError(f"{name}: is not an ONNX file: {error}") from error
    read = _OfGraph(model.graph, name, onnx)
    try:
        known = onnx.shape_inference.infer_shapes(model).graph
    except Exception as error:
        raise InputError(f"{name}: has shapes that do not fit: {error}") from error
    read.check_shapes([*known.value_info, *known.output])
    return read.built


class _OfGraph:
    def __init__(self, graph: Any, name: str, onnx: Any) -> None:
        self.name, self.onnx = name, onnx
        self.constants = {each.name: self._array(each) for each in graph.initializer}
        inputs = [each for each in graph.input if each.name not in self.constants]
        states = {
            node.input[5] for node in graph.node if node.op_type == "GRU" and len(node.input) > 5
        }
        observations = [each for each in inputs if each.name not in states]
        if len(observations) != 1:
            raise InputError(
                f"{name}: expected one input besides the states of recurrent units, got "
                f"{', '.join(each.name for each in observations) or 'none'}"
            )
        self.built = Built(name, self._length(observations[0]))
        self.vectors = {observations[0].name: "x"}
        self.states = {each.name: self._length(each) for each in inputs if each.name in states}
        for node in graph.node:
            self._node(node)
        first = graph.output[0].name if graph.output else ""
        if self.vectors.get(first) != (self.built.steps or [{"out": None}])[-1]["out"]:
            self.built.refuse(f"the output {first or 'none'}, which is not its last operation")

    def check_shapes(self, values: Sequence[Any]) -> None:
        """Raise an `InputError` where a value is no vector with axes of length 1 before it.

        Only then a change of its shape, and a concatenation, are those of vectors.
        """
        for each in values:
            shape = [axis.dim_value for axis in each.type.tensor_type.shape.dim]  # 0: not known
            of = self.vectors.get(each.name)
            if (
                of
                and shape
                and (shape[-1] not in (0, self.built.length[of]) or max(shape[:-1], default=0) > 1)
            ):
                self.built.refuse(f"{each.name} of the shape {shape}")

    def _array(self, tensor: Any) -> Array:
        if tensor.data_location == self.onnx.TensorProto.EXTERNAL or tensor.external_data:
            raise InputError(
                f"{self.name}: the weights {tensor.name} are in another file; write all into one"
            )
        if int(np.prod(tensor.dims, dtype=object) if tensor.dims else 1) > MOST_NUMBERS:
            raise InputError(f"{self.name}: {tensor.name} has more than {MOST_NUMBERS:,} numbers")
        try:
            return np.asarray(self.onnx.numpy_helper.to_array(tensor))
        except Exception as error:
            raise InputError(f"{self.name}: {tensor.name} is damaged: {error}") from error

    def _length(self, value: Any) -> int:
        shape = [each.dim_value for each in value.type.tensor_type.shape.dim]
        if not shape or shape[-1] < 1 or any(each > 1 for each in shape[:-1]):
            raise InputError(
                f"{self.name}: the input {value.name} has the shape {shape}; expected a vector of "
                "a known length, with axes of length 1 before it"
            )
        return int(shape[-1])

    def _node(self, node: Any) -> None:
        get = self.onnx.helper.get_attribute_value
        options, op = {each.name: get(each) for each in node.attribute}, node.op_type
        if node.domain not in ("", "ai.onnx"):
            self.built.refuse(f"{node.domain}.{op}")
        if op == "Constant":
            if "value" in options:
                self.constants[node.output[0]] = self._array(options["value"])
            else:
                self.constants[node.output[0]] = np.asarray(next(iter(options.values())))
            return
        values = [self.vectors.get(each, self.constants.get(each)) for each in node.input]
        lost = [n for n, v in zip(node.input, values, strict=True) if n and v is None]
        if missing := [each for each in lost if each not in self.states]:
            raise InputError(
                f"{self.name}: {op} takes {missing[0]}, which nothing before it gives (a cycle?)"
            )
        if not isinstance(values[0] if values else None, str) and op not in _PAIRS:
            self.built.refuse(f"{op} whose first input is constant")
        self.vectors[node.output[0]] = self._made(op, values, options, node)

    def _made(self, op: str, values: list[Any], options: Mapping[str, Any], node: Any) -> str:
        built, of = self.built, values[0]
        if op in _SAME:
            return str(of)
        if op in _FUNCTIONS:
            function, usual = _FUNCTIONS[op]
            numbers = {} if usual is None else {"a": float(options.get("alpha", usual))}
            return built.add(function, [of], built.length[of], numbers=numbers)
        if op in _PAIRS:
            sides = [x if isinstance(x, str) else _finite(np.ravel(x), self.name) for x in values]
            return built.pair(_PAIRS[op], sides)
        if op == "Concat":
            if not all(isinstance(each, str) for each in values):
                built.refuse("Concat with constants")
            return built.add("concat", values, sum(built.length[each] for each in values))
        if op == "Clip":
            ends = [None if v is None else float(np.ravel(v)[0]) for v in (*values[1:], None, None)]
            low, high = options.get("min", ends[0]), options.get("max", ends[1])
            numbers = {
                "low": -1e300 if low is None else low,
                "high": 1e300 if high is None else high,
            }
            return built.add("clip", [of], built.length[of], numbers=numbers)
        if op in ("Gemm", "MatMul"):
            return self._product(op, values, options)
        if op == "GRU":
            return self._recurrent(values, options, node)
        built.refuse(op)

    def _product(self, op: str, values: list[Any], options: Mapping[str, Any]) -> str:
        if isinstance(values[1], str) or np.ndim(values[1]) != 2:
            self.built.refuse(f"{op} of two vectors")
        W = np.asarray(values[1], dtype=float)
        W = W if options.get("transB") else W.T
        W = W * options.get("alpha", 1.0)
        b = np.zeros(len(W)) if len(values) < 3 or values[2] is None else np.asarray(values[2])
        if isinstance(values[-1], str) and len(values) > 2:
            self.built.refuse(f"{op} with a bias that is computed")
        if options.get("transA"):
            self.built.refuse(f"{op} with transA")
        b = np.broadcast_to(np.ravel(b) * options.get("beta", 1.0), len(W))
        return self.built.affine(values[0], W, b)

    def _recurrent(self, values: list[Any], options: Mapping[str, Any], node: Any) -> str:
        """GRU, whose gates are in the order z, r, h; PyTorch's has the reset behind the product."""
        plain = options.get("direction", b"forward") in (b"forward", "forward")
        more = options.keys() - {"hidden_size", "linear_before_reset", "direction"}
        if not options.get("linear_before_reset") or not plain or more:
            self.built.refuse("GRU other than PyTorch's (linear_before_reset = 1, forward)")
        size = int(options["hidden_size"])

        def ordered(array: Any) -> Array:
            z, r, n = np.split(np.asarray(array, dtype=float), 3)
            return np.concatenate([r, z, n])

        W, U = ordered(np.asarray(values[1])[0]), ordered(np.asarray(values[2])[0])
        biases = np.zeros(6 * size) if values[3] is None else np.asarray(values[3])[0]
        b, d = map(ordered, np.split(biases, 2))
        begin = values[5] if len(values) > 5 else None
        start = np.zeros(size) if begin is None else np.ravel(begin)
        vector = self.built.gru(values[0], W, U, b, d, start)
        self.vectors |= {name: vector for name in node.output if name}
        return vector


# Checkpoints of RLtools ---------------------------------------------------------------------------


EXAMPLES = 20
"""Number of steps of the examples in a checkpoint that are kept, and checked."""

_ACTIVATIONS = {"RELU": "relu", "SIGMOID": "sigmoid", "TANH": "tanh", "FAST_TANH": "fast_tanh"}


def of_rltools(made: bytes, name: str) -> Built:
    """Return the actor of a checkpoint of RLtools, with the first of its examples."""
    import h5py

    try:
        file = h5py.File(io.BytesIO(made), "r")
    except Exception as error:
        raise InputError(f"{name}: is not an HDF5 file: {error}") from error
    with file:
        actor = _Checkpoint(name, file)
        inputs, expected = (actor.numbers(f"example/{key}") for key in ("input", "output"))
        if inputs.ndim != 3 or expected.ndim != 3:
            raise InputError(f"{name}: expected examples of steps, batches and numbers")
        built = Built(name, inputs.shape[-1])
        actor.layer(built, "actor", "x")
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

    def layer(self, built: Built, place: str, of: str, deep: int = 0) -> str:
        """Add a layer, and return the name of its output."""
        kind = self._of(place, "type")
        if kind == "sequential" and deep < DEEPEST:
            for k in range(len(self._at(f"{place}/layers"))):
                of = self.layer(built, f"{place}/layers/{k}", of, deep + 1)
            return of
        if kind == "mlp":
            hidden = range(int(self._of(place, "num_layers") or 0) - 2)
            for each in ["input_layer", *(f"hidden_layer_{k}" for k in hidden), "output_layer"]:
                of = self._dense(built, f"{place}/{each}", of)
            return of
        if kind == "dense":
            return self._dense(built, place, of)
        if kind == "sample_and_squash":
            mean = built.add("head", [of], built.length[of] // 2)
            return built.add("tanh", [mean], built.length[mean])
        if kind != "gru":
            built.refuse(f"the layer {kind or 'without a type'} at {place}")
        W, U, b, d, start = (
            self.numbers(f"{place}/{each}/parameters")
            for each in (
                *("weights_input", "weights_hidden", "biases_input", "biases_hidden"),
                "initial_hidden_state",
            )
        )
        return built.gru(of, W, U, np.ravel(b), np.ravel(d), np.ravel(start))

    def _dense(self, built: Built, place: str, of: str) -> str:
        W, b = (self.numbers(f"{place}/{each}/parameters") for each in ("weights", "biases"))
        of, function = built.affine(of, W, np.ravel(b)), self._of(place, "activation_function")
        if function == "IDENTITY":
            return of
        if function not in _ACTIVATIONS:
            built.refuse(f"the activation {function} at {place}")
        return built.add(_ACTIVATIONS[function], [of], built.length[of])


DEEPEST = 8
"""Most layers within each other."""
