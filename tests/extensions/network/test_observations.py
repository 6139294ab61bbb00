"""What networks observe: attitudes as SciPy has them, terms of libraries, and last commands."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from small_experiment import mapping

import eqt_cli
from eqt_cli.components.groups import groups, moving_parts
from eqt_cli.components.mechanics import LawInput
from eqt_cli.extensions.network.network import Observed, _with_terms

onnx = pytest.importorskip("onnx", reason="needs the extra network")


def written(path, inputs):
    """Write the network y = x W of some inputs and three outputs; return W."""
    W = np.random.default_rng(inputs).standard_normal((inputs, 3)).astype(np.float32)
    make = onnx.helper
    first, last = (
        make.make_tensor_value_info(name, onnx.TensorProto.FLOAT, [1, n])
        for name, n in (("x", inputs), ("y", 3))
    )
    nodes, arrays = (
        [make.make_node("MatMul", ["x", "W"], ["y"])],
        [onnx.numpy_helper.from_array(W, "W")],
    )
    graph = make.make_graph(nodes, "policy", [first], [last], arrays)
    opsets = [make.make_opsetid("", 20)]
    onnx.save(make.make_model(graph, opset_imports=opsets, ir_version=10), path)
    return W.astype(float)


def experiment(path, engine, **law):
    data = mapping(
        controllers=[{"kind": "network", "file": str(path), **law}],
        control={"period": 0.1},
        ensemble={"runs": 8, "seed": 1},
        time={"duration": 2.0, "samples": 21},
        solver={"rtol": 1e-10, "cross_check": 0, "engine": engine},
    )
    return {key: value for key, value in data.items() if key != "gains"}


@pytest.mark.parametrize("engine", ["native", "solve_ivp"])
def test_attitudes_are_those_of_scipy(tmp_path, engine):
    W = written(tmp_path / "policy.onnx", 13)
    signals = [{"signal": "gravity"}, {"signal": "euler"}, {"signal": "rates", "frame": "space"}]
    commands = {"as": "wrench", "clip": 100, "scale": -0.2}
    observes = ["isaaclab3.root_quat_w", *signals]
    data = experiment(tmp_path / "policy.onnx", engine, observes=observes, commands=commands)
    result = eqt_cli.run(data, tmp_path / "out")
    R, w, torque = (result.read(name)[0, :, :20] for name in ("pose", "velocity", "torque"))
    turned = Rotation.from_matrix(R.reshape(-1, 3, 3))
    q = turned.as_quat(canonical=True)
    angles = turned.as_euler("ZYX")[:, ::-1]
    rates = (R @ w[..., None])[..., 0].reshape(-1, 3)
    seen = np.concatenate([q, turned.inv().apply([0, 0, -1]), angles, rates], axis=1)
    np.testing.assert_allclose(torque.reshape(-1, 3), -0.2 * seen @ W, atol=1e-12)


def test_terms_of_libraries_are_their_published_definitions():
    """Of a body at p that moves with ṗ in space and turns with ω in itself."""
    G, random = groups.get("SE3")(), np.random.default_rng(3)
    pose, p, v, w = np.eye(4), *random.standard_normal((3, 3))
    turned = Rotation.random(rng=random)
    R, q = turned.as_matrix(), turned.as_quat(canonical=True)
    pose[:3, :3], pose[:3, 3] = R, p
    turning, moving = moving_parts(G)
    V = np.zeros(6)
    V[turning.axes], V[moving.axes] = w, R.T @ v
    x = LawInput(0.0, pose, V, np.eye(4), np.zeros(6), np.zeros(6))
    roll_pitch_yaw = turned.as_euler("ZYX")[::-1]
    interleaved = np.stack([p, v], axis=1).ravel()
    terms = {
        "isaaclab2.base_pos_z": p[2:],
        "isaaclab2.base_lin_vel": R.T @ v,
        "isaaclab2.base_ang_vel": w,
        "isaaclab2.projected_gravity": R.T @ [0, 0, -1],
        "isaaclab2.root_pos_w": p,
        "isaaclab2.root_quat_w": np.roll(q, 1),
        "isaaclab3.root_quat_w": q,
        "isaaclab3.root_lin_vel_w": v,
        "isaaclab3.root_ang_vel_w": R @ w,
        "gym_pybullet_drones.kin": np.concatenate([p, roll_pitch_yaw, v, R @ w]),
        "safe_control_gym.quadrotor": np.concatenate([interleaved, roll_pitch_yaw, w]),
        "crazyflow.quat": q,
        "crazyflow.ang_vel": w,
        "crazyflow_in_space.ang_vel": R @ w,
    }
    for term, wanted in terms.items():
        signals = [Observed(**signal) for signal in _with_terms([term])]
        observed = np.concatenate([signal.values(G, x) for signal in signals])
        np.testing.assert_allclose(observed, wanted, atol=1e-14, err_msg=term)


@pytest.mark.parametrize("half_turn", [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.6, 0.8, 0], [0, 0, 0]])
def test_a_quaternion_is_finite_at_half_turns(half_turn):
    G, pose = groups.get("SO3")(), Rotation.from_rotvec(np.pi * np.array(half_turn)).as_matrix()
    x = LawInput(0.0, pose, np.zeros(3), np.eye(3), np.zeros(3), np.zeros(3))
    q = Observed("quaternion", order="xyzw").values(G, x)
    np.testing.assert_allclose(Rotation.from_quat(q).as_matrix(), pose, atol=1e-12)
    assert np.isfinite(Observed("euler").values(G, x)).all()


def test_a_signal_is_clipped_normalised_and_scaled_in_this_order():
    G = groups.get("SO3")()
    x = LawInput(0.0, np.eye(3), np.array([3.0, -1.0, 0.5]), np.eye(3), np.zeros(3), np.zeros(3))
    signal = Observed("rates", clip=2.0, mean=[1.0, 0.0, 0.5], deviation=[2.0, 1.0, 4.0], scale=3.0)
    np.testing.assert_allclose(signal.values(G, x), [1.5, -3.0, 0.0])
    np.testing.assert_allclose(Observed("rates", entries=[2, 0]).values(G, x), [0.5, 3.0])


@pytest.mark.parametrize("engine", ["native", "solve_ivp"])
def test_the_last_three_commands_are_remembered_the_oldest_first(tmp_path, engine):
    W = written(tmp_path / "policy.onnx", 12)
    observes = [{"signal": "rates"}, {"signal": "last_command", "steps": 3, "scale": 0.5}]
    commands = {"as": "wrench", "clip": 0.4}
    data = experiment(tmp_path / "policy.onnx", engine, observes=observes, commands=commands)
    result = eqt_cli.run(data, tmp_path / "out")
    w, torque = (result.read(name, run=0)[0] for name in ("velocity", "torque"))
    last = np.zeros((3, 3))
    for k in range(20):
        y = np.clip(np.concatenate([w[k], 0.5 * last.ravel()]) @ W, -0.4, 0.4)
        np.testing.assert_allclose(torque[k], y, atol=1e-12)
        last = np.concatenate([last[1:], y[None]])
