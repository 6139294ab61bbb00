"""Networks in ONNX, as steps on vectors.

Arrays become vectors, row by row, since every shape is known. What only places numbers, and what
is affine, is evaluated by onnx itself when a file is read: on the numbers of places, or at zero
and at unit vectors. So are constants.
"""

import json
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import cache, partial, reduce
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import InputError, Remedy
from eqt_cli.base.files import open_regular, refusals
from eqt_cli.extensions.network.steps import (
    KINDS,
    MOST_NUMBERS,
    MOST_STEPS,
    OPERATIONS,
    Built,
    Operand,
    numbers_of,
)

MOST_BYTES = 64_000_000
"""Largest file."""

MOST_AXES = 16
"""Most axes of an array."""

MOST_WORK = 10_000_000_000
"""Most operations on numbers by which a file is read: some seconds."""

PER_CALL = 100_000
"""So many of them take as long as the evaluator of onnx takes to begin, 0.1 ms."""

PER_NUMBER = 10
"""So many take as long as to read or write one number of an array."""


def content_of(path: Path) -> bytes:
    """Return the bytes of a file of a network."""
    with refusals(path, "read", kind=InputError), open_regular(path) as stream:
        content = stream.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise InputError(f"{path.name}: expected at most {MOST_BYTES:,} bytes")
    return content


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
            names = [("", op) for op in sorted(others - KINDS.keys() - {*OPERATIONS["fixed"]})]
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
            content = self.beside[place] = self.beside.get(place) or content_of(
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
        computed = {*KINDS} if moving else {*KINDS, *OPERATIONS["fixed"]}
        if node.domain in ("", "ai.onnx", "ai.onnx.ml") and op in computed:
            if not moving:
                return self._evaluator(node)(values)
            outputs: list[Any] = getattr(self, f"_{KINDS[op]}")(node, values, options)
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
        operands = [x.of if isinstance(x, _Value) else numbers_of(x, self.name) for x in data]
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
            of = value.of if isinstance(value, _Value) else numbers_of(value, self.name)
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
        of = X.of if isinstance(X, _Value) else numbers_of(X, self.name)
        h, c = (
            x.of
            if isinstance(x, _Value)
            else numbers_of(np.zeros(size) if x is None else x, self.name)
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
