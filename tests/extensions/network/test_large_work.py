"""Small files that would take much memory or time, and damaged ones, end in a line."""

import numpy as np
import pytest

from eqt_cli.base.errors import InputError
from eqt_cli.extensions.network.reader import network_text

onnx = pytest.importorskip("onnx")
CHAIN = 60
TWICE = [("x" if k == 0 else f"a{k - 1}", f"a{k}") for k in range(CHAIN)]
WORDS = {
    "Concat": "4,000,000 numbers that it holds and computes",
    "Tile": "4,000,000 numbers that it holds and computes",
    "Gather": "4,000,000 numbers that it holds and computes",
    "Expand": "more than 16 axes",
    "ConstantOfShape": "more than 16 axes",
    "Einsum": "operations to read the file",
    "ReduceSum": "operations to read the file",
    "Mul": "10,000,000,000 numbers",
    "functions": "more than 10,000 with those of its functions",
    "damaged": "has what onnx cannot read",
}
"""Of networks that double a vector so often, make arrays of many axes or sum up many products."""


def of(op):
    """A network that computes much by some operation."""
    node, opset = onnx.helper.make_node, onnx.helper.make_opsetid("", 18)
    size, last, constants, more = 3, f"a{CHAIN - 1}", {}, {}
    if op in ("Concat", "Tile", "Gather"):
        constants = {"Tile": {"r": [2]}, "Gather": {"r": [[0, 1], [1, 0]]}}.get(op, {})
        options = {} if op == "Tile" else {"axis": 0}
        nodes = [node(op, [a, "r" if constants else a], [b], **options) for a, b in TWICE]
    elif op == "functions":
        last, call, imports = "y", onnx.helper.make_function, [opset]
        imports.append(onnx.helper.make_opsetid("own", 1))
        functions = [call("own", "f0", ["x"], ["y"], [node("Relu", ["x"], ["y"])], imports)]
        for k in range(1, CHAIN):
            twice = [node(f"f{k - 1}", [a], [b], domain="own") for a, b in ("xz", "zy")]
            functions.append(call("own", f"f{k}", ["x"], ["y"], twice, imports))
        nodes = [node(f"f{CHAIN - 1}", ["x"], ["y"], domain="own")]
        more = {"functions": functions, "opset_imports": imports}
    else:
        last, many, nodes = "y", np.full(17, 4), []
        if op == "Einsum":
            size, constants = 10**6, {"r": np.ones(10**6, np.float32)}
            nodes = [node(op, ["x", "r"], ["y"], equation="i,j->")]
        elif op == "Mul":
            size, constants = 10**5, {"r": np.ones((10**5, 1), np.float32)}
            nodes = [node(op, ["x", "r"], ["y"])]
        elif op == "ReduceSum":
            size, nodes = 3 * 10**6, [node(op, ["x"], ["y"], keepdims=0)]
        elif op == "Expand":
            size, constants, nodes = 1, {"r": many}, [node(op, ["x", "r"], ["y"])]
        elif op == "ConstantOfShape":
            constants = {"r": many}
            nodes = [node(op, ["r"], ["c"]), node("ReduceSum", ["c"], ["d"], keepdims=0)]
            nodes.append(node("Add", ["x", "d"], ["y"]))
        else:
            constants = {"r": np.ones((3, 3), np.float32)}
            nodes = [node("Gemm", ["x", "r"], ["y"], transB=1)]
            nodes[0].attribute[0].type = 0
    arrays = [onnx.numpy_helper.from_array(np.asarray(x), name) for name, x in constants.items()]
    real, info = onnx.TensorProto.FLOAT, onnx.helper.make_tensor_value_info
    graph = onnx.helper.make_graph(nodes, "g", [info("x", real, [size])], [info(last, real, None)])
    graph.initializer.extend(arrays)
    return onnx.helper.make_model(graph, **{"opset_imports": [opset]} | more)


@pytest.mark.ci("reads arrays of a million numbers")
@pytest.mark.parametrize("op", WORDS)
def test_what_a_small_file_would_compute_is_limited(op, tmp_path):
    path = tmp_path / "small.onnx"
    path.write_bytes(of(op).SerializeToString())
    with pytest.raises(InputError, match=WORDS[op]):
        network_text(path)
