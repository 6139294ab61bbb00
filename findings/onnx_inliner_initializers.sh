#!/usr/bin/env bash
# onnx 1.23.2: inlining an operator that the standard defines as a function fails where one of its
# inputs is an initializer, which PyTorch, Keras and jax2onnx write for every LayerNormalization: an
# assertion of the inliner asks for the type of the value, and looks it up among inputs and value_info
# only. Shape inference before it does not help, as it lists results of nodes. With a value_info for each
# initializer the same model is inlined.
#
# Seen: as written: Type unknown for scale
#       after shape inference: Type unknown for scale
#       with value_info: inlined, no LayerNormalization left
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check onnx==1.23.2 numpy==2.4.6
"$folder/venv/bin/python" - <<'END'
import re

import numpy as np
import onnx
import onnx.inliner
from onnx import TensorProto, helper, numpy_helper


def model():
    info = [helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, 4]) for name in "xy"]
    node = helper.make_node("LayerNormalization", ["x", "scale"], ["y"])
    scale = numpy_helper.from_array(np.ones(4, np.float32), "scale")
    graph = helper.make_graph([node], "policy", info[:1], info[1:], [scale])
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 20)], ir_version=10)
    onnx.checker.check_model(made)
    return made


def inlined(made):
    names = [("", "LayerNormalization")]
    try:
        left = onnx.inliner.inline_selected_functions(made, names, inline_schema_functions=True)
    except RuntimeError as error:
        return re.search(r"Type unknown for \w+", str(error))[0]
    return f"inlined, {sum(n.op_type == names[0][1] for n in left.graph.node) or 'no'} {names[0][1]} left"


described = model()
tensor = described.graph.initializer[0]
described.graph.value_info.append(
    helper.make_tensor_value_info(tensor.name, tensor.data_type, tensor.dims)
)
seen = {
    "as written": inlined(model()),
    "after shape inference": inlined(onnx.shape_inference.infer_shapes(model())),
    "with value_info": inlined(described),
}
for how, what in seen.items():
    print(f"{how}: {what}")
unknown = "Type unknown for scale"
expected = [unknown, unknown, "inlined, no LayerNormalization left"]
raise SystemExit(None if list(seen.values()) == expected else "changed")
END
