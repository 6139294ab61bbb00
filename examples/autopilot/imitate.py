"""Make the network of autopilot.yaml, which imitates a law with a position and an attitude loop.

Weights of the first layer are random, those of the second one are fitted by least squares. It needs
ONNX: `pip install onnx`, then `python imitate.py --out policy.onnx`.
"""

import argparse
from pathlib import Path

import numpy as np
import onnx
from scipy.spatial.transform import Rotation

MASS, GRAVITY, HIDDEN, SAMPLES = 2.0, 9.81, 96, 60_000
SCALE = np.array([20.0, 2.0, 2.0, 0.5])  # thrust, N, and torques, N m, for an output of 1
UP = np.array([0.0, 0.0, 1.0])


def teacher(e, v, R, omega):
    """Return thrust and torques of the law: errors in space, R from body to space."""
    force = MASS * (GRAVITY * UP - 2.5 * e - 2.8 * v)
    wanted = force / np.linalg.norm(force, axis=1, keepdims=True)
    b = R.transpose(0, 2, 1)
    tilt = np.cross(np.broadcast_to(UP, wanted.shape), np.einsum("kij,kj->ki", b, wanted))
    heading = np.arctan2(R[:, 1, 0], R[:, 0, 0])
    angle = tilt - 0.4 * heading[:, None] * b[:, :, 2]
    torque = [2.6, 2.6, 1.6] * angle - [0.42, 0.42, 0.4] * omega
    return np.column_stack([np.einsum("ki,ki->k", force, R[:, :, 2]), torque])


def main():
    """Draw states, fit the network, and write it."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", type=Path, default=Path("policy.onnx"))
    out, random = parser.parse_args().out, np.random.default_rng(0)
    e, v = random.normal(size=(2, SAMPLES, 3)) * np.array([[[0.5]], [[0.7]]])
    R = Rotation.from_rotvec(0.35 * random.normal(size=(SAMPLES, 3))).as_matrix()
    omega = 0.8 * random.normal(size=(SAMPLES, 3))
    inputs = np.column_stack([e, v, R.reshape(SAMPLES, 9), omega])
    targets = (teacher(e, v, R, omega) - [MASS * GRAVITY, 0, 0, 0]) / SCALE
    W = 0.35 * random.normal(size=(HIDDEN, inputs.shape[1]))
    c = 0.3 * random.normal(size=HIDDEN)
    features = np.column_stack([np.tanh(inputs @ W.T + c), np.ones(SAMPLES)])
    A = np.linalg.solve(features.T @ features + 1e-3 * np.eye(HIDDEN + 1), features.T @ targets)
    at_rest = np.concatenate([np.zeros(6), np.eye(3).ravel(), np.zeros(3)])
    A[-1] = -np.tanh(W @ at_rest + c) @ A[:-1]  # so that it hovers without an offset
    rest = np.sqrt(np.mean((features @ A - targets) ** 2, axis=0)) * SCALE
    print("rms of what is left: thrust, N, and torques, N m:", rest.round(3))
    arrays = {"W1": W, "c1": c, "W2": A[:-1].T, "c2": A[-1]}
    graph = onnx.helper.make_graph(
        [
            onnx.helper.make_node("Gemm", ["x", "W1", "c1"], ["h"], transB=1),
            onnx.helper.make_node("Tanh", ["h"], ["y"]),
            onnx.helper.make_node("Gemm", ["y", "W2", "c2"], ["u"], transB=1),
        ],
        "policy",
        [onnx.helper.make_tensor_value_info("x", onnx.TensorProto.FLOAT, [1, 18])],
        [onnx.helper.make_tensor_value_info("u", onnx.TensorProto.FLOAT, [1, 4])],
        [onnx.numpy_helper.from_array(x.astype(np.float32), name) for name, x in arrays.items()],
    )
    opset = [onnx.helper.make_opsetid("", 17)]
    onnx.save(onnx.helper.make_model(graph, opset_imports=opset, ir_version=8), out)


if __name__ == "__main__":
    main()
