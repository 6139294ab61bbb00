#!/usr/bin/env bash
# onnx 1.23.2: its reference evaluator cannot run what torch.onnx.export writes of
# nn.RNN(nonlinearity="relu"): an RNN with activations = ["Relu"], which the standard lists and
# onnxruntime 1.32.0 computes. The checker accepts the model; the evaluator knows Tanh and Affine only.
#
# Seen: checker: fine
#       onnxruntime: [0.     0.6875]
#       onnx.reference: RuntimeError: Unknown activation function 'Relu'.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check onnx==1.23.2 onnxruntime==1.32.0 numpy==2.4.6
"$folder/venv/bin/python" - <<'END'
import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto, helper, numpy_helper
from onnx.reference import ReferenceEvaluator

arrays = {
    "W": np.float32([[[0.5, 0.25], [-0.5, 1.0]]]),
    "R": np.zeros((1, 2, 2), np.float32),
}
node = helper.make_node(
    "RNN", ["x", "W", "R"], ["", "h"], hidden_size=2, activations=["Relu"], direction="forward"
)
x = helper.make_tensor_value_info("x", TensorProto.FLOAT, [1, 1, 2])
h = helper.make_tensor_value_info("h", TensorProto.FLOAT, [1, 1, 2])
tensors = [numpy_helper.from_array(values, name) for name, values in arrays.items()]
graph = helper.make_graph([node], "policy", [x], [h], tensors)
model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 20)], ir_version=10)
onnx.checker.check_model(model)
print("checker: fine")
row = {"x": np.float32([[[-0.375, 0.5]]])}
session = onnxruntime.InferenceSession(model.SerializeToString())
computed = session.run(None, row)[0].ravel()
print("onnxruntime:", computed)
try:
    said = f"answers {ReferenceEvaluator(model).run(None, row)[0].ravel()}"
except Exception as error:
    said = f"{type(error).__name__}: {error}"
print("onnx.reference:", said)
same = np.allclose(computed, [0.0, 0.6875]) and "Unknown activation function 'Relu'" in said
raise SystemExit(None if same else "changed")
END
