"""Laws that are networks: their files, their numbers, and loops with them."""

import itertools
import json

import h5py
import numpy as np
import pytest
from said import error_of, says
from scipy.integrate import solve_ivp
from small_experiment import mapping

import eqt_cli
from eqt_cli.base.errors import InputError
from eqt_cli.engines import native
from eqt_cli.extend import Integrator
from eqt_cli.extensions.network.network import Emitted, bare_source, call, function_of
from eqt_cli.extensions.network.reader import network_text
from eqt_cli.extensions.network.steps import network_of

onnx = pytest.importorskip("onnx", reason="needs the extra network")
FLOAT = onnx.TensorProto.FLOAT
RANDOM = np.random.default_rng(5)


@pytest.fixture(autouse=True)
def _same_numbers(monkeypatch):
    """Whatever other tests have drawn before."""
    monkeypatch.setitem(globals(), "RANDOM", np.random.default_rng(5))


def weights(*shape):
    return (0.5 * RANDOM.standard_normal(shape)).astype(np.float32)


def graph(nodes, arrays, inputs, outputs):
    """The bytes of an ONNX file; inputs and outputs by name, with their shapes."""
    make = onnx.helper
    made = make.make_graph(
        nodes,
        "policy",
        [make.make_tensor_value_info(n, FLOAT, s) for n, s in inputs.items()],
        [make.make_tensor_value_info(n, FLOAT, s) for n, s in outputs.items()],
        [onnx.numpy_helper.from_array(values, name) for name, values in arrays.items()],
    )
    return make.make_model(
        made, opset_imports=[make.make_opsetid("", 17)], ir_version=8
    ).SerializeToString()


def node(op, *of, out="y", **options):
    return onnx.helper.make_node(op, list(of), [out], **options)


def every_operation():
    """A network with each operation on vectors, of 7 inputs and 5 outputs."""
    nodes = [
        node("Constant", out="half", value=onnx.numpy_helper.from_array(np.float32([0.5]))),
        node("Sub", "x", "mean", out="a"),
        node("Div", "a", "std", out="b"),
        node("Clip", "b", "low", "high", out="c"),
        node("Gemm", "c", "W1", "b1", out="d", transB=1),
        node("Tanh", "d", out="e"),
        node("MatMul", "e", "W2", out="f"),
        node("Add", "f", "b2", out="g"),
        node("Elu", "g", out="h", alpha=0.7),
        node("LeakyRelu", "g", out="i", alpha=0.2),
        node("Concat", "h", "i", "c", out="j", axis=-1),
        node("Gemm", "j", "W3", out="k", alpha=0.5),
        node("Relu", "k", out="l"),
        node("Sigmoid", "k", out="m"),
        node("Mul", "l", "m", out="n"),
        node("Mul", "half", "n", out="o"),
        node("Reshape", "o", "shape", out="p"),
        node("Identity", "p", out="q"),
        node("Gemm", "q", "W4", "b4", out="y", transB=1),
    ]
    arrays = {
        "mean": weights(7),
        "std": np.float32(1.5) + np.abs(weights(7)),
        "low": np.float32(-1.2),
        "high": np.float32(1.1),
        "W1": weights(16, 7),
        "b1": weights(16),
        "W2": weights(16, 6),
        "b2": weights(6),
        "W3": weights(19, 12),
        "shape": np.array([1, 12], dtype=np.int64),
        "W4": weights(5, 12),
        "b4": weights(5),
    }
    return graph(nodes, arrays, {"x": [1, 7]}, {"y": [1, 5]})


def recurrent(size=6, inputs=4, outputs=3):
    """Recurrent units between two products; their state goes in and out."""
    nodes = [
        node("Unsqueeze", "x", "first", out="s"),
        onnx.helper.make_node(
            "GRU",
            ["s", "W", "R", "B", "", "h_in"],
            ["all", "h_out"],
            hidden_size=size,
            linear_before_reset=1,
        ),
        node("Squeeze", "h_out", "first", out="t"),
        node("Gemm", "t", "V", "c", out="y", transB=1),
    ]
    arrays = {
        "first": np.array([0], dtype=np.int64),
        "W": weights(1, 3 * size, inputs),
        "R": weights(1, 3 * size, size),
        "B": weights(1, 6 * size),
        "V": weights(outputs, size),
        "c": weights(outputs),
    }
    given = {"x": [1, inputs], "h_in": [1, 1, size]}
    return graph(nodes, arrays, given, {"y": [1, outputs], "h_out": [1, 1, size]})


@pytest.fixture
def read(tmp_path):
    def of(made, name="policy.onnx"):
        path = tmp_path / name
        path.write_bytes(made)
        return network_text(path)

    return of


def outputs_of(network, rows):
    """What the network in C gives of rows one after the other."""
    states = np.array([[*network.initial, 0.0]])
    found = np.empty((len(rows), network.commands))
    function = function_of(bare_source(Emitted(network)))
    for k, row in enumerate(np.ascontiguousarray(rows, dtype=float)):
        call(function, states, row[None], found[k : k + 1])
    return found


def test_every_operation_is_that_of_onnxruntime(read):
    runtime = pytest.importorskip("onnxruntime")
    made = every_operation()
    session = runtime.InferenceSession(made)
    rows = 2 * RANDOM.standard_normal((10_000, 7)).astype(np.float32)
    expected = [session.run(["y"], {"x": row[None]})[0][0] for row in rows]
    found = outputs_of(network_of(read(made), "policy.onnx"), rows)
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_no_activation_makes_a_number_of_nan(read):
    for op in ("Relu", "Tanh", "Sigmoid", "Elu", "LeakyRelu"):
        made = graph([node(op, "x")], {}, {"x": [1, 1]}, {"y": [1, 1]})
        assert np.isnan(outputs_of(network_of(read(made), "policy.onnx"), [[np.nan]])).all()
    for op, of in itertools.product(("Max", "Min"), (("x", "b"), ("b", "x"))):
        made = graph([node(op, *of)], {"b": np.float32([[0.0]])}, {"x": [1, 1]}, {"y": [1, 1]})
        assert np.isnan(outputs_of(network_of(read(made), "policy.onnx"), [[np.nan]])).all()


@pytest.mark.filterwarnings("ignore:policy.onnx. its memory is")
def test_recurrent_units_are_those_of_onnxruntime(read):
    runtime = pytest.importorskip("onnxruntime")
    made = recurrent()
    session, h = runtime.InferenceSession(made), np.zeros((1, 1, 6), dtype=np.float32)
    rows, expected = RANDOM.standard_normal((500, 4)).astype(np.float32), []
    for row in rows:
        y, h = session.run(["y", "h_out"], {"x": row[None], "h_in": h})
        expected.append(y[0])
    network = network_of(read(made), "policy.onnx")
    assert network.initial == [0.0] * 6
    np.testing.assert_allclose(outputs_of(network, rows), expected, atol=1e-6)


# Checkpoints of RLtools ---------------------------------------------------------------------------


def checkpoint(path, change=lambda file: None):
    """A checkpoint of 5 inputs, 4 recurrent units and 2 outputs, with examples."""
    W, b, V, c = weights(6, 5), weights(6), weights(2, 4), weights(2)
    Wi, Wh, bi, bh, h = weights(12, 6), weights(12, 4), weights(12), weights(12), weights(4)
    given, wanted, state = RANDOM.standard_normal((9, 2, 5)), np.zeros((9, 2, 2)), h.astype(float)

    def sigmoid(x):
        return 1 / (1 + np.exp(-x))

    for k, x in enumerate(given[:, 0]):
        a, u = Wi @ np.maximum(W @ x + b, 0) + bi, Wh @ state + bh
        r, z = sigmoid(a[:4] + u[:4]), sigmoid(a[4:8] + u[4:8])
        state = (1 - z) * np.tanh(a[8:] + r * u[8:]) + z * state
        wanted[k, 0] = V @ state + c
    with h5py.File(path, "w") as file:
        layers = {
            "0": ({"type": "dense", "activation_function": "RELU"}, {"weights": W, "biases": b}),
            "1": (
                {"type": "gru"},
                {
                    "weights_input": Wi,
                    "weights_hidden": Wh,
                    "biases_input": bi,
                    "biases_hidden": bh,
                    "initial_hidden_state": h,
                },
            ),
            "2": (
                {"type": "dense", "activation_function": "IDENTITY"},
                {"weights": V, "biases": c},
            ),
        }
        file.create_group("actor").attrs["type"] = "sequential"
        for name, (attributes, arrays) in layers.items():
            group = file.create_group(f"actor/layers/{name}")
            group.attrs.update(attributes)
            for key, values in arrays.items():
                file[f"actor/layers/{name}/{key}/parameters"] = values
        file["example/input"], file["example/output"] = given, wanted
        change(file)
    return given[:, 0], wanted[:, 0]


def test_a_checkpoint_gives_its_examples(tmp_path):
    given, wanted = checkpoint(tmp_path / "policy.h5")
    network = network_of(network_text(tmp_path / "policy.h5"), "policy.h5")
    np.testing.assert_allclose(outputs_of(network, given), wanted, atol=1e-12)


# Loops --------------------------------------------------------------------------------------------

W1, B1, W2 = weights(8, 12), weights(8), weights(3, 8)


def experiment(file, **changes):
    law = {
        "kind": "network",
        "file": str(file),
        "observes": [
            {"signal": "rotation_error"},
            {"signal": "rates_error", "scale": 0.5, "clip": 1.5},
        ],
        "commands": {"as": "wrench", "scale": [-1, -2, -0.5], "offset": 0.1, "clip": 0.8},
    }
    more = {
        "controllers": [law | changes.pop("law", {})],
        "control": {"period": 0.1},
        "gains": None,
        "time": {"duration": 2.0, "samples": 21},
        "solver": {"rtol": 1e-10, "cross_check": 0},
    }
    data = mapping(**(more | changes))
    return {key: value for key, value in data.items() if value is not None}


@pytest.fixture
def policy(tmp_path):
    nodes = [
        node("Gemm", "x", "W1", "b1", out="h", transB=1),
        node("Tanh", "h", out="g"),
        node("Gemm", "g", "W2", out="y", transB=1),
    ]
    arrays = {"W1": W1, "b1": B1, "W2": W2}
    path = tmp_path / "policy.onnx"
    path.write_bytes(graph(nodes, arrays, {"x": [1, 12]}, {"y": [1, 3]}))
    return path


def plain(run, times):
    """The same loop by SciPy: J = diag(2, 1, 3), the reference under (cos t, sin t, 0)."""
    J = np.diag([2.0, 1.0, 3.0])

    def rates(t, x, tau):
        R, w = x[:9].reshape(3, 3), x[9:]
        hat = -np.cross(np.eye(3), w).T
        return np.concatenate([(R @ hat).ravel(), np.linalg.solve(J, np.cross(J @ w, w) + tau)])

    def torque_d(t):
        return np.array([np.cos(t), np.sin(t), 0.0])

    R, w = run
    x, xd, found = (
        np.concatenate([R.ravel(), w]),
        np.concatenate([np.eye(3).ravel(), np.zeros(3)]),
        [],
    )
    for k in range(20):
        t = 0.1 * k
        R, w, Rd, wd = x[:9].reshape(3, 3), x[9:], xd[:9].reshape(3, 3), xd[9:]
        error = Rd.T @ R
        seen = np.concatenate([error.ravel(), 0.5 * np.clip(w - error.T @ wd, -1.5, 1.5)])
        y = np.clip(W2.astype(float) @ np.tanh(W1.astype(float) @ seen + B1), -0.8, 0.8)
        tau = 0.1 + np.array([-1, -2, -0.5]) * y
        found.append(np.concatenate([x, tau]))
        how = {"rtol": 1e-12, "atol": 1e-13, "method": "DOP853"}
        x = solve_ivp(rates, (t, t + 0.1), x, args=(tau,), **how).y[:, -1]
        xd = solve_ivp(lambda t, x: rates(t, x, torque_d(t)), (t, t + 0.1), xd, **how).y[:, -1]
    return np.array(found)


@pytest.mark.parametrize("engine", ["native", "solve_ivp"])
def test_a_loop_is_that_of_a_plain_program(policy, tmp_path, engine):
    data = experiment(policy)
    data["solver"] |= {"engine": engine}
    result = eqt_cli.run(data, tmp_path / "out")
    pose, velocity, torque = (
        result.read(name, run=0)[0] for name in ("pose", "velocity", "torque")
    )
    found = np.concatenate([pose.reshape(21, 9), velocity, torque], axis=1)[:20]
    expected = plain((pose[0], velocity[0]), result.read("pose"))
    np.testing.assert_allclose(found, expected, atol=1e-8)


PATH = {
    "kind": "path",
    "factors": [
        {"axis": [0, 0, 1], "by": "where(t < 1, 0, (t-1)**3)"},
        {"axis": [1, 0, 0], "by": "sin(t)"},
    ],
}
TURNS = (
    {"t": 0, "pose": {"rotvec": [0, 0, 0]}},
    {"t": 0.7, "pose": {"rotvec": [0.5, 0, 0]}},
    {"t": 1.5, "pose": {"rotvec": [0, 1, 0]}},
)
WAYPOINTS = {"kind": "waypoints", "points": [*TURNS, {"t": 2.5, "pose": {"rotvec": [0, 0.2, 0.3]}}]}


@pytest.mark.parametrize("engine", ["native", "solve_ivp"])
@pytest.mark.parametrize("reference", [PATH, WAYPOINTS], ids=["path", "waypoints"])
def test_a_preview_is_the_reference_that_comes(policy, tmp_path, engine, reference):
    """Its torques follow from the stored poses, and from the desired ones of later samples."""
    signal = {"signal": "rates_error", "scale": 0.5, "clip": 1.5}
    ahead = signal | {"preview": {"steps": 3, "every": "100 ms"}}
    data = experiment(policy, law={"observes": [signal, ahead]}, reference=reference)
    data["solver"] |= {"engine": engine}
    data["initial"].pop("desired", None)
    result = eqt_cli.run(data, tmp_path / "out")
    R, w, torque = (result.read(name, run=0)[0] for name in ("pose", "velocity", "torque"))
    Rd, wd = (result.read(f"desired_{name}") for name in ("pose", "velocity"))
    for k in range(17):
        seen = [w[k] - R[k].T @ Rd[k + j] @ wd[k + j] for j in range(4)]
        x = 0.5 * np.clip(np.concatenate(seen), -1.5, 1.5)
        y = np.clip(W2.astype(float) @ np.tanh(W1.astype(float) @ x + B1), -0.8, 0.8)
        np.testing.assert_allclose(torque[k], 0.1 + np.array([-1, -2, -0.5]) * y, atol=1e-12)


def test_a_run_has_the_same_bits_beside_any_others_and_span_by_span(policy, tmp_path, monkeypatch):
    found = []
    for runs, alone in ((19, False), (3, False), (3, True)):
        data = experiment(policy, ensemble={"runs": runs, "seed": 1})
        data["solver"]["engine"] = "native"
        if alone:  # as where another run ends
            monkeypatch.setattr(native.Lanes, "walk_ahead", Integrator.walk_ahead)
        found.append(eqt_cli.run(data, tmp_path / f"{runs} {alone}").read("pose")[0, :3])
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[1], found[2])


def test_a_result_holds_its_network_as_data(policy, tmp_path):
    """It runs again without the file, and without trust, because nothing in it runs."""
    result = eqt_cli.run(experiment(policy), tmp_path / "out")
    first = result.read("pose")
    policy.unlink()
    again = eqt_cli.run(tmp_path / "out" / "results.h5", tmp_path / "again")
    np.testing.assert_array_equal(again.read("pose"), first)


@pytest.mark.filterwarnings("ignore:recurrent.onnx. its memory is")
def test_a_network_remembers_its_last_command_and_its_units(tmp_path):
    """y = tanh(V h + c) with the clipped command of the period before among the inputs."""
    path = tmp_path / "recurrent.onnx"
    path.write_bytes(recurrent(inputs=3 + 3))
    law = {
        "observes": [{"signal": "rates"}, {"signal": "last_command", "scale": 2.0}],
        "commands": {"as": "wrench", "scale": -1, "offset": 0, "clip": 0.3},
        "memory": {"h_in": "h_out"},
    }
    result = eqt_cli.run(experiment(path, law=law), tmp_path / "out")
    velocity, torque, memory = (
        result.read(name, run=0)[0] for name in ("velocity", "torque", "law_output")
    )
    network = network_of(network_text(path), path.name)
    states, last, y = np.array([[*network.initial, 0.0]]), np.zeros(3), np.empty((1, 3))
    for k in range(20):
        row = np.concatenate([velocity[k], 2 * last])[None]
        call(function_of(bare_source(Emitted(network))), states, row, y)
        last = np.clip(y[0], -0.3, 0.3)
        np.testing.assert_allclose(torque[k], -last, atol=1e-12)
        np.testing.assert_allclose(memory[k], [*states[0, :6], *last], atol=1e-12)


# What is refused ----------------------------------------------------------------------------------


def external():
    model = onnx.load_model_from_string(every_operation())
    tensor = next(each for each in model.graph.initializer if each.name == "W1")
    tensor.data_location = onnx.TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value="/etc/passwd")
    return model.SerializeToString()


def huge():
    model = onnx.load_model_from_string(every_operation())
    tensor = next(each for each in model.graph.initializer if each.name == "W1")
    tensor.dims[:] = [2**40, 2**40]
    return model.SerializeToString()


X, Y = {"x": [1, 4]}, {"y": [1, 4]}


REFUSED = {
    "external": (
        external,
        "the weights W1 are in '/etc/passwd'; expected a file next to the network",
    ),
    "huge": (huge, "W1 has more than 4,000,000 numbers"),
    "damaged": (lambda: b"\xff" * 99, "is not an ONNX file: "),
    "empty": (lambda: graph([], {}, X, {"z": [1, 4]}), "has no z, which it promises"),
    "unknown": (
        lambda: graph([node("Multinomial", "x")], {}, X, Y),
        "has Multinomial, which eqt does not compute: a policy that draws its commands; export",
    ),
    "cycle": (
        lambda: graph(
            [node("Add", "x", "b", out="a"), node("Tanh", "a", out="b")], {}, X, {"b": [1, 4]}
        ),
        "Add takes b, which nothing before it gives (a cycle?)",
    ),
    "length": (
        lambda: graph([node("Tanh", "x")], {}, {"x": [1, "n"]}, Y),
        "the input x has the shape [1, 0]; expected a vector of a known length",
    ),
    "not finite": (
        lambda: graph([node("Add", "x", "b")], {"b": np.float32([np.nan] * 4)}, X, Y),
        "has weights that are not finite",
    ),
    "shapes": (
        lambda: graph([node("Gemm", "x", "W", transB=1)], {"W": weights(4, 5)}, X, Y),
        "has Gemm that does not fit: shapes (1,4) and (5,4) not aligned",
    ),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_what_is_wrong_with_a_file_is_said(read, kind):
    make, said = REFUSED[kind]
    assert f"policy.onnx: {said}" in error_of(read, make(), kind=InputError)


def test_a_file_of_pytorch_is_refused_with_the_command_that_exports_it(read):
    assert "torch.onnx.export(policy, " in error_of(read, b"PK", "policy.pt", kind=InputError)


def linked(file):
    del file["actor/layers/0/weights/parameters"]
    file["actor/layers/0/weights/parameters"] = h5py.ExternalLink("/etc/other.h5", "/weights")


def outside(file):
    del file["actor/layers/0/weights/parameters"]
    file.create_dataset(
        "actor/layers/0/weights/parameters", (6, 5), "f4", external=[("/etc/passwd", 0, 120)]
    )


def wrong(file):
    file["actor/layers/2/biases/parameters"][0] += 1e-3


def unknown(file):
    file["actor/layers/1"].attrs["type"] = "lstm"


def counted(file):
    file["actor/layers/1"].attrs.update(type="mlp", num_layers="two")


CHECKPOINTS = {
    counted: "is damaged: invalid literal for int() with base 10: 'two'",
    linked: "has no actor/layers/0/weights/parameters, which a checkpoint of RLtools has",
    outside: "actor/layers/0/weights/parameters: expected at most 4,000,000 numbers in this file",
    unknown: "has the layer lstm at actor/layers/1, which eqt does not compute",
}


@pytest.mark.parametrize("change", CHECKPOINTS)
def test_what_is_wrong_with_a_checkpoint_is_said(tmp_path, change):
    checkpoint(tmp_path / "policy.h5", change)
    said = error_of(network_text, tmp_path / "policy.h5", kind=InputError)
    assert said == f"policy.h5: {CHECKPOINTS[change]}"


def test_a_checkpoint_that_gives_other_outputs_than_its_examples_is_refused(tmp_path):
    checkpoint(tmp_path / "policy.h5", wrong)
    law = {"observes": [{"signal": "rates"}], "commands": {}}
    said = error_of(eqt_cli.load_experiment, experiment(tmp_path / "policy.h5", law=law))
    assert "its outputs are 0.0005 away from its examples, and 1e-06 is allowed" in said


HOSTILE = {
    "name": ("steps", 0, "out", "t0[1]; system(0); double t9"),
    "operation": ("steps", 0, "op", "by_entry"),
    "of": ("steps", 0, "of", ["h"]),
    "numbers": ("steps", 0, "W", [["1); system(0); ("]]),
    "inputs": ("inputs", 10**9),
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_changed_network_in_a_result_is_refused_or_computed_as_data(policy, kind):
    """What a stranger wrote into a result becomes no C but numbers."""
    data = json.loads(network_text(policy))
    *path, last, value = HOSTILE[kind]
    here = data
    for key in path:
        here = here[key]
    here[last] = value
    if kind == "name":  # names are eqt's own
        assert network_of(json.dumps(data), "policy.onnx").steps[0]["out"] == "t0"
        return
    said = error_of(network_of, json.dumps(data), "policy.onnx", kind=InputError)
    assert said.startswith("policy.onnx: ")


LAWS = {
    "observes[1].signal: expected 'position'": {"observes": [{"signal": "rates"}, {"signal": "v"}]},
    "observes[0].signal: SO3 has no position_error; it has rotation, rotation_error": {
        "observes": ["position_error"]
    },
    "observes: expected at least one signal": {"observes": []},
    "observes: ratse: expected a signal, of position, ": {"observes": ["ratse"]},
    "observes[0].scale: 0 hides the signal": {"observes": [{"signal": "rates", "scale": 0}]},
    "observes[0].steps: expected a number of at most 1,000, got 100000": {
        "observes": [{"signal": "last_command", "steps": 100_000}]
    },
    "commands.scale: with 0, the network commands nothing": {"commands": {"scale": 0}},
    "observes[0].clip: last_command is limited by commands.clip; leave this out": {
        "observes": [{"signal": "last_command", "clip": 0.5}]
    },
    "observes[1]: last_command occurs twice; name it once": {
        "observes": [{"signal": "last_command"}, {"signal": "last_command", "scale": 2}]
    },
    "observes[0].frame: applies to positions, velocities and rates, not to rotation; leave it": {
        "observes": [{"signal": "rotation", "frame": "body"}]
    },
    "observes[0].order: missing; write wxyz or xyzw, the order of the quaternion": {
        "observes": [{"signal": "quaternion"}]
    },
    "observes[0].steps: applies to last_command, not to rates; leave it out": {
        "observes": [{"signal": "rates", "steps": 2}]
    },
    "observes: isaaclab3.pose: expected LIBRARY.TERM, of base_pos_z, base_lin_vel": {
        "observes": ["isaaclab3.pose"]
    },
    "observes[0].preview: applies to errors, such as position_error, not to rates; leave it out": {
        "observes": [{"signal": "rates", "preview": {"steps": 2, "every": 0.1}}]
    },
    "observes[0].preview: the reference is integrated, so its later values are unknown": {
        "observes": [{"signal": "rates_error", "preview": {"steps": 4, "every": 0.1}}]
    },
    "observes[0].preview.steps: expected": {
        "observes": [{"signal": "rates_error", "preview": {"steps": 0, "every": 0.1}}]
    },
    "observes: gives 3 numbers (rates 3), and the network in policy.onnx takes 12": {
        "observes": [{"signal": "rates"}]
    },
    "commands: as: rotors, and actuators has no thrusters": {"commands": {"as": "rotors"}},
    "commands.order[1]: expected one of torque x, torque y, torque z, got yaw": {
        "commands": {"order": ["torque x", "yaw", "torque z"]}
    },
    "commands.order: 1 names, and the network has 3 outputs": {"commands": {"order": ["torque x"]}},
    "commands.scale: expected 3 numbers, got 2": {"commands": {"scale": [1, 2]}},
    "controllers[0].file: expected a network, .onnx or .h5": {"file": "policy.txt"},
}


@pytest.mark.parametrize("said", LAWS)
def test_what_is_wrong_with_a_law_is_said_at_its_place(policy, said):
    law = {
        key: str(policy.parent / value) if key == "file" else value
        for key, value in LAWS[said].items()
    }
    if "file" in law:
        (policy.parent / "policy.txt").write_text("nothing")
    found = error_of(eqt_cli.load_experiment, experiment(policy, law=law))
    assert said.replace("in policy.onnx", f"in {policy}") in found.replace("policy.txt: ", "")


@pytest.mark.parametrize("engine", ["native", "solve_ivp"])
def test_thrusts_that_a_network_commands_are_flown(tmp_path, engine):
    """Also the part of six thrusts that gives no torque, after the delay, and within the limits."""
    outputs = np.float32([0.5, -0.5, 0.8, -0.2, 0.1, -1.5])
    arrays = {"W": np.zeros((6, 3), np.float32), "b": outputs}
    made = graph([node("Gemm", "x", "W", "b", transB=1)], arrays, {"x": [1, 3]}, {"y": [1, 6]})
    (tmp_path / "six.onnx").write_bytes(made)
    places = [
        {"at": [0.2 * np.cos(a), 0.2 * np.sin(a), 0.0], "along": [0, 0, 1], "turns": turns}
        for a, turns in zip((np.pi / 3 * np.arange(6)).tolist(), 3 * [0.02, -0.02], strict=True)
    ]
    law = {"kind": "network", "file": str(tmp_path / "six.onnx"), "observes": [{"signal": "rates"}]}
    law["commands"] = {"as": "rotors", "thrust": [3.0, 3.0, 0.0]}
    config = {
        "group": "SE3",
        "inertia": [0.03, 0.03, 0.05, 2.0, 2.0, 2.0],
        "reference": {"kind": "constant"},
        "controllers": [law],
        "actuators": [{"kind": "thrusters", "thrusters": places, "low": 0.0, "high": 5.0}],
        "control": {"period": 0.1, "delay": 1},
        "initial": {"pose": {"kind": "exp_normal", "std": 0.1}},
        "ensemble": {"runs": 2},
        "time": {"duration": 0.3, "samples": 4},
        "solver": {"engine": engine, "cross_check": 0},
    }
    result = eqt_cli.run(config, tmp_path / "six")
    commanded = 3.0 + 3.0 * np.maximum(outputs.astype(float), -1.0)
    with h5py.File(result.path / "results.h5") as file:
        flown, asked = file["thrust"][0, :, 1:], file["command"][0, :, :, 5]
    expected = np.broadcast_to(np.minimum(commanded, 5.0), flown.shape)
    np.testing.assert_allclose(flown, expected, rtol=1e-15)
    np.testing.assert_allclose(asked, commanded.sum(), rtol=1e-14)


def test_a_network_of_rotors_needs_them_in_front(policy):
    law = {"commands": {"as": "rotors"}}
    parts = [{"kind": "lag", "time_constant": 0.1}, {"kind": "thrusters", "matrix": ROWS}]
    said = error_of(eqt_cli.load_experiment, experiment(policy, law=law, actuators=parts))
    assert "actuators[1]: a law commands their thrusts" in said


ROWS = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
"""B of three thrusters that give a torque about one axis each."""


def test_a_network_of_rates_needs_a_rate_loop(policy):
    law = {"commands": {"as": "rates"}}
    said = error_of(eqt_cli.load_experiment, experiment(policy, law=law))
    assert "commands rates, and actuators take torque" in said
    loop = [{"kind": "rate_loop", "bandwidth": 40}]
    assert "commands torque, and actuators take rates" in error_of(
        eqt_cli.load_experiment, experiment(policy, actuators=loop)
    )
    eqt_cli.load_experiment(experiment(policy, law=law, actuators=loop))


@pytest.mark.filterwarnings("ignore:recurrent.onnx. its memory is")
def test_a_network_with_a_memory_has_no_margins_beside_a_motion(tmp_path):
    """Its memory on the reference is not known; margins about 0 would be those of another loop."""
    path = tmp_path / "recurrent.onnx"
    law = {"observes": [{"signal": "rates"}, {"signal": "rates"}], "commands": {"as": "wrench"}}
    path.write_bytes(recurrent(inputs=6))
    loaded = eqt_cli.load_experiment(experiment(path, law=law))
    said = error_of(eqt_cli.margins, loaded, kind=InputError)
    assert "memory of 'network' is not known where all errors are 0" in said


def test_a_network_needs_a_clock(policy):
    said = error_of(eqt_cli.load_experiment, experiment(policy, control=None))
    assert "answers at control instants only; set control.period" in said


def test_without_onnx_the_extra_is_named(read, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "onnx", None)
    assert "pip install '.[network]'" in error_of(read, every_operation(), kind=InputError)


def test_of_a_network_that_is_not_trained_yet_all_else_is_checked():
    law = {"kind": "network", "file": "untrained.onnx", "observes": ["rotation_error"]}
    for scale, sentence in (
        ([1, 2], "controllers[0].commands.scale: expected 3 numbers, got 2"),
        (1, "controllers[0].file: untrained.onnx: not found, and all else…eqt_cli.gym.make…"),
    ):
        config = mapping(
            controllers=[law | {"commands": {"scale": scale}}], control={"period": 0.1}
        )
        said = error_of(eqt_cli.load_experiment, config)
        assert says(said, sentence), said
