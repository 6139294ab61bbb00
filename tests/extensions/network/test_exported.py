"""Networks as exporters write them, each against onnx's own evaluator, called once a period."""

import numpy as np
import pytest
from case_tables import in_ci
from said import error_of

from eqt_cli.base.errors import EqtWarning, InputError
from eqt_cli.extensions.network.network import Emitted, bare_source, call, function_of
from eqt_cli.extensions.network.reader import network_text
from eqt_cli.extensions.network.steps import network_of

onnx = pytest.importorskip("onnx", reason="needs the extra network")
FLOAT, HALF, BOOL = (getattr(onnx.TensorProto, kind) for kind in ("FLOAT", "FLOAT16", "BOOL"))
N, H, M = 5, 4, 3


def weights(*shape):
    return (0.5 * np.random.default_rng([*shape, 1]).standard_normal(shape)).astype(np.float32)


def node(op, of, out="y", **options):
    return onnx.helper.make_node(op, of.split(" "), out.split(), **options)


def model(nodes, arrays=None, states=None, outputs=None, **more):
    """A network of x, and of states by name, with their shapes."""
    make = onnx.helper
    infos = [
        [make.make_tensor_value_info(name, FLOAT, shape) for name, shape in shapes.items()]
        for shapes in ({"x": [1, N]} | (states or {}), outputs or {"y": [1, M]})
    ]
    numbers = {"W": weights(M, N), "b": weights(M)} | (arrays or {})
    tensors = [onnx.numpy_helper.from_array(values, name) for name, values in numbers.items()]
    graph = make.make_graph(nodes, "policy", *infos, tensors)
    opset = make.make_opsetid("", more.get("opset", 20))
    return make.make_model(graph, opset_imports=[opset], ir_version=10)


PLAIN = node("Gemm", "x W b", "a", transB=1)


def after(*nodes, **arrays):
    return model([PLAIN, *nodes], arrays)


def ints(*values):
    return np.array(values, np.int64)


def recurrent(op, *, layout=0, carried=True, more=(), **options):
    """Recurrent units, whose states go in and out as PyTorch writes it."""
    gates = {"GRU": 3, "LSTM": 4, "RNN": 1}[op]
    arrays = {
        "R": weights(1, gates * H, H),
        "V": weights(M, H),
        "c": weights(M),
        "at": ints(layout),
    }
    arrays |= {"I": weights(1, gates * H, N), "B": weights(1, 2 * gates * H), "flat": ints(1, H)}
    arrays |= {"k": np.float32(0.7)}
    letters = ("h", "c")[: 1 + (op == "LSTM")] if carried else ()
    states = " ".join(["", *(f"{k}_in" for k in letters)]) if letters else ""
    outs = "Y " + " ".join(f"{k}_raw" for k in ("h", "c")[: 1 + (op == "LSTM")])
    nodes = [
        node("Unsqueeze", "x at", "s"),
        node(op, f"s I R B {states}".rstrip(), outs, hidden_size=H, layout=layout, **options),
        node("Reshape", "h_raw flat", "q"),
        node("Gemm", "q V c", "y", transB=1),
        *(more or [node("Identity", f"{k}_raw", f"{k}_out") for k in letters]),
    ]
    shapes = {f"{k}_in": [1, 1, H] for k in letters}
    outputs = {"y": [1, M]} | {f"{k}_out": [1, 1, H] for k in letters}
    return model(nodes, arrays, shapes, outputs)


def half():
    arrays = {"W": weights(M, N).astype(np.float16), "b": weights(M).astype(np.float16)}
    cast = [node("Cast", "x", "z", to=HALF), node("Gemm", "z W b", "v", transB=1)]
    return model([*cast, node("Tanh", "v", "t"), node("Cast", "t", "y", to=FLOAT)], arrays)


CASES = {
    "a state in and out": lambda: recurrent("GRU", linear_before_reset=1),
    "reset before the product": lambda: recurrent("GRU"),
    "no state: zero at each call": lambda: recurrent("GRU", carried=False, linear_before_reset=1),
    "two states": lambda: recurrent("LSTM"),
    "plain units": lambda: recurrent("RNN", direction="forward"),
    "a state that is scaled and clipped": lambda: recurrent(
        "GRU",
        more=[
            node("Neg", "k", "low"),
            node("Mul", "h_raw k", "h_scaled"),
            node("Clip", "h_scaled low k", "h_out"),
        ],
    ),
    "a cast, and the identity of a constant": lambda: after(
        node("Cast", "a", "e", to=FLOAT),
        node("Identity", "k", "kk"),
        node("Add", "e kk", "g"),
        node("Tanh", "g"),
        k=weights(M),
    ),
    "constants are folded": lambda: after(
        node("Gemm", "k W b", "v", transB=1), node("Sub", "a v"), k=weights(1, N)
    ),
    "an output that is not asked for": lambda: model(
        [PLAIN, node("Tanh", "a"), node("RandomNormalLike", "a", "noise")],
        outputs={"y": [1, M], "noise": [1, M]},
    ),
    "split, negated": lambda: model(
        [
            node("Gemm", "x V", "a", transB=1),
            node("Split", "a", "y log", axis=-1, num_outputs=2),
            node("Neg", "log", "unused"),
        ],
        {"V": weights(2 * M, N)},
    ),
    "slices and a row": lambda: model(
        [
            node("Slice", "x from to last", "p"),
            node("Gather", "x row", "r", axis=1),
            node("Concat", "p r", "c", axis=1),
            node("Gemm", "c W b", transB=1),
        ],
        {"from": ints(1), "to": ints(N), "last": ints(1), "row": ints(0)},
    ),
    "a row transposed": lambda: model(
        [
            node("Transpose", "x", "t", perm=[1, 0]),
            node("MatMul", "W t", "c"),
            node("Reshape", "c s"),
        ],
        {"s": ints(1, M)},
    ),
    "einsum": lambda: model([node("Einsum", "x W", equation="bi,oi->bo")]),
    "one dimension": lambda: model(
        [node("Squeeze", "x zero", "v"), node("MatMul", "W v", "u"), node("Unsqueeze", "u zero")],
        {"zero": ints(0)},
    ),
    "where and greater": lambda: after(
        node("Greater", "a b", "c"), node("Where", "c a b"), b2=weights(M)
    ),
    "largest, least and powers": lambda: after(
        node("Max", "a low", "e"), node("Min", "e high", "f"), node("Pow", "f three"),
        low=-np.abs(weights(M)), high=np.abs(weights(M)), three=np.float32(3),
    ),
    "layer normalisation": lambda: after(
        node("LayerNormalization", "a s o", "e"), node("Tanh", "e"), s=1 + weights(M), o=weights(M)
    ),
    "batch normalisation": lambda: after(
        node("BatchNormalization", "a s o m v"),
        s=1 + weights(M), o=weights(M), m=weights(M), v=1 + np.abs(weights(M)),
    ),
    "softmax": lambda: after(node("Softmax", "a", axis=-1)),
    "a history": lambda: model(
        [node("Reshape", "x s", "h"), node("Conv", "h K", "k"), node("Flatten", "k", axis=1)],
        {"s": ints(1, 1, N), "K": weights(1, 1, 3)},
    ),
    "float16": half,
    **{
        op: lambda op=op: after(node(op, "a"))
        for op in (
            *("Abs", "Sin", "Exp", "Softplus", "Selu", "Celu", "Gelu", "Mish", "HardSigmoid"),
            *("HardSwish", "Softsign", "Erf", "Sign", "Atan"),
        )
    },
    "PRelu": lambda: after(node("PRelu", "a b")),
}  # fmt: skip
QUICK = ("a state in and out", "layer normalisation", "slices and a row", "where and greater")


def apart(made, network, periods=20):
    """The largest difference of commands from onnx's, whose states go on by their names."""
    evaluator = onnx.reference.ReferenceEvaluator(made)
    names = [each.name for each in made.graph.output]
    held = {
        each.name: np.zeros([d.dim_value for d in each.type.tensor_type.shape.dim], np.float32)
        for each in made.graph.input
        if each.name != "x"
    }
    states, command = np.array([[*network.initial, 0.0]]), np.empty((1, network.commands))
    function, worst = function_of(bare_source(Emitted(network))), 0.0
    for row in np.random.default_rng(4).standard_normal((periods, N)).astype(np.float32):
        wanted = [n for n in names if n != "noise"]
        answers = dict(zip(wanted, evaluator.run(wanted, {"x": row[None], **held}), strict=True))
        call(function, states, row.astype(float)[None], command)
        worst = max(worst, np.nanmax(np.abs(command[0] - np.ravel(answers["y"]).astype(float))))
        held = {name: answers[name.replace("_in", "_out")] for name in held}
    return worst


@pytest.mark.filterwarnings("ignore::eqt_cli.base.errors.EqtWarning")
@pytest.mark.parametrize(
    "case", [in_ci("compiles a network each", case, unless=case in QUICK) for case in CASES]
)
def test_a_file_is_computed_as_onnx_does(tmp_path, case):
    path, made = tmp_path / "policy.onnx", CASES[case]()
    onnx.checker.check_model(made)
    onnx.save(made, path)
    limit = 2e-3 if case == "float16" else 2e-6  # onnx rounds to half or single precision
    assert apart(made, network_of(network_text(path), path.name)) < limit


# Weights in a second file -------------------------------------------------------------------------


def saved_beside(path, location="policy.onnx.data"):
    made = after(node("Tanh", "a"))
    onnx.save_model(made, path, save_as_external_data=True, location=location, size_threshold=0)
    return after(node("Tanh", "a"))


def test_weights_beside_the_network_are_read(tmp_path):
    made = saved_beside(tmp_path / "policy.onnx")
    text = network_text(tmp_path / "policy.onnx")
    assert apart(made, network_of(text, "policy.onnx")) < 1e-6


def elsewhere(path, location):
    made = onnx.load(path, load_external_data=False)
    for tensor in made.graph.initializer:
        next(each for each in tensor.external_data if each.key == "location").value = location
    path.write_bytes(made.SerializeToString())


@pytest.mark.parametrize(
    ("location", "said"),
    [
        (
            "../policy.onnx.data",
            "the weights W are in '../policy.onnx.data'; expected a file next to",
        ),
        ("/etc/passwd", "the weights W are in '/etc/passwd'; expected a file next to the network"),
        ("gone.data", "the weights W are in gone.data, which must be next to it ("),
        ("link.data", "the weights W are in 'link.data'; expected a file next to the network"),
    ],
)
def test_weights_elsewhere_are_refused_with_what_writes_one_file(tmp_path, location, said):
    path = tmp_path / "policy.onnx"
    saved_beside(path)
    elsewhere(path, location)
    (tmp_path / "link.data").symlink_to("policy.onnx.data")
    message = error_of(network_text, path, kind=InputError)
    assert said in message
    assert "onnx.save(onnx.load('policy.onnx'), 'whole.onnx')" in message


@pytest.mark.parametrize("offset", ["-4", "first"])
def test_weights_at_no_whole_number_are_refused(tmp_path, offset):
    path = tmp_path / "policy.onnx"
    saved_beside(path)
    made = onnx.load(path, load_external_data=False)
    for entry in made.graph.initializer[0].external_data:
        if entry.key == "offset":
            entry.value = offset
    path.write_bytes(made.SerializeToString())
    said = error_of(network_text, path, kind=InputError)
    assert f"has weights W from byte {offset}, " in said


# Memory -------------------------------------------------------------------------------------------


def two_states():
    """States of one shape, whose names do not tell which is which."""
    nodes = [
        PLAIN,
        node("Add", "p q", "s"),
        node("Add", "a s", "y"),
        node("Tanh", "y", "first"),
        node("Neg", "p", "second"),
    ]
    shapes = {"p": [1, M], "q": [1, M]}
    return model(nodes, None, shapes, {"y": [1, M], "first": [1, M], "second": [1, M]})


def test_memory_is_told_where_names_tell_it_and_asked_for_where_they_do_not(tmp_path):
    path = tmp_path / "policy.onnx"
    onnx.save(recurrent("LSTM"), path)
    with pytest.warns(EqtWarning, match="its memory is {h_in: h_out, c_in: c_out}, by names"):
        network_text(path)
    onnx.save(two_states(), path)
    text = network_text(path)
    said = error_of(network_of, text, path.name, kind=InputError)
    assert "which output is p [1, 3] a period later? Say so, as in memory: {p: first}" in said
    assert "outputs besides the first: first [1, 3], second [1, 3]" in said
    for pairs, wrong in (
        ({"p": "y"}, "expected one input and an output besides the memory, got x, q and first"),
        ({"z": "first"}, "memory: has no input z; its inputs are x, p, q"),
        ({"p": "gone", "q": "first"}, "memory: has no output gone; its outputs are y, first"),
    ):
        assert wrong in error_of(network_of, text, path.name, tuple(pairs.items()), kind=InputError)
    network = network_of(text, path.name, (("q", "first"), ("p", "second")))
    states, y = np.zeros((1, 7)), np.empty((1, M))
    p, q = np.zeros(M), np.zeros(M)
    for row in np.random.default_rng(2).standard_normal((5, N)):
        call(function_of(bare_source(Emitted(network))), states, row[None], y)
        wanted = weights(M, N) @ row + weights(M) + p + q
        np.testing.assert_allclose(y[0], wanted, atol=1e-12)
        p, q = -p, np.tanh(wanted)


@pytest.mark.filterwarnings("default::eqt_cli.base.errors.EqtWarning")
def test_half_precision_is_told(tmp_path):
    onnx.save(half(), tmp_path / "h.onnx")
    with pytest.warns(EqtWarning, match="h.onnx: its weights are of 16 bits; eqt computes with"):
        network_text(tmp_path / "h.onnx")


# What is refused ----------------------------------------------------------------------------------

REFUSED = {
    "drawn": (
        lambda: after(node("RandomNormalLike", "a", "r"), node("Add", "a r")),
        "has RandomNormalLike, which eqt does not compute: a policy that draws its commands; ",
    ),
    "a choice": (
        lambda: after(node("ArgMax", "a")),
        "has ArgMax, which eqt does not compute: a choice among commands; export a network of real",
    ),
    "attention": (
        lambda: after(node("Transpose", "a", "t"), node("MatMul", "t a")),
        "has MatMul of two computed arrays, as attention has, which eqt does not compute",
    ),
    "constant": (
        lambda: model([node("Identity", "W")]),
        "has the constant output y, which depends on nothing",
    ),
    "too large": (
        lambda: model(
            [node("Expand", "W big", "e"), node("ReduceSum", "e", "s"), node("Add", "x s")],
            {"big": ints(10**6, M, N)},
        ),
        "it makes 15,000,000 numbers, and 4,000,000 are allowed",
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", REFUSED)
def test_what_is_not_computed_is_said_with_a_remedy(tmp_path, kind):
    made, said = REFUSED[kind]
    (tmp_path / "policy.onnx").write_bytes(made().SerializeToString())
    message = error_of(network_text, tmp_path / "policy.onnx", kind=InputError)
    assert message.startswith("policy.onnx: ")
    assert said in message
