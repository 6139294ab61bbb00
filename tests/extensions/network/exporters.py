"""Policies as exporters of this year write them, each against onnxruntime over 20 periods.

Run by hand, outside continuous integration, in an environment with eqt and

    torch==2.14.1 onnx==1.23.2 onnxscript==0.7.2 onnxruntime==1.32.0 stable-baselines3==2.9.2
    rsl-rl-lib==5.5.1 skrl==2.1.1 jax==0.10.2 jax2onnx==0.17.1 flax==0.12.8 equinox==0.13.8
    keras==3.15.1 scikit-learn skl2onnx==1.20.0

    python tests/extensions/network/exporters.py > tests/extensions/network/exporters.md
"""

import logging
import os
import sys
import tempfile
import warnings
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout, suppress
from functools import partial
from io import StringIO
from pathlib import Path

import numpy as np

os.environ["KERAS_BACKEND"] = "torch"
os.environ["JAX_PLATFORMS"] = "cpu"
N, M, PERIODS = 12, 4, 20
CASES: dict[str, Callable[[Path], object]] = {}


LIMITS = {"float16": 5e-3, "sine layer": 5e-6}
"""Where onnxruntime itself rounds more: to half precision, and the phase 30 x of a sine."""


# PyTorch, by both of its exporters ----------------------------------------------------------------


def export(module, path, dynamo, *more, **names):
    import torch

    module = module.eval()
    kinds = next((p.dtype for p in module.parameters()), torch.float32)
    inputs = (torch.zeros(1, N, dtype=kinds), *more)
    torch.onnx.export(module, inputs, str(path), dynamo=dynamo, verbose=False, **names)


def torch_modules():
    import torch
    from torch import nn

    torch.manual_seed(3)

    def around(*middle):
        return nn.Sequential(nn.Linear(N, 16), *middle, nn.Linear(16, M))

    activations = [
        *(nn.ReLU, nn.LeakyReLU, nn.ELU, nn.SELU, nn.CELU, nn.GELU, nn.SiLU, nn.Mish, nn.Hardtanh),
        *(nn.Hardsigmoid, nn.Hardswish, nn.Softplus, nn.Softsign, nn.Tanh, nn.Tanhshrink),
        *(nn.Softshrink, nn.Hardshrink, nn.LogSigmoid, nn.Sigmoid, nn.ReLU6, nn.PReLU, nn.Dropout),
    ]
    modules = {kind.__name__: around(kind()) for kind in activations}
    modules |= {
        "GELU tanh": around(nn.GELU(approximate="tanh")),
        "Threshold": around(nn.Threshold(0.1, 0.3)),
        "LayerNorm": around(nn.LayerNorm(16), nn.Tanh()),
        "RMSNorm": around(nn.RMSNorm(16), nn.Tanh()),
        "BatchNorm1d": around(nn.BatchNorm1d(16), nn.Tanh()),
        "GroupNorm": around(nn.GroupNorm(4, 16), nn.Tanh()),
        "Softmax": around(nn.Softmax(dim=-1)),
        "Flatten": around(nn.Unflatten(1, (4, 4)), nn.Flatten()),
        "Conv1d of a history": nn.Sequential(
            nn.Unflatten(1, (3, 4)), nn.Conv1d(3, 8, 2), nn.ReLU(), nn.Flatten(), nn.Linear(24, M)
        ),
        "float16": around(nn.Tanh()).half(),
        "float64": around(nn.Tanh()).double(),
        "64-64": nn.Sequential(
            nn.Linear(N, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, M)
        ),
    }

    def of(name, forward, **parts):
        class Policy(nn.Module):
            def __init__(self):
                super().__init__()
                for key, value in parts.items():
                    if isinstance(value, nn.Module):
                        setattr(self, key, value)
                    else:
                        self.register_buffer(key, value)

            def forward(self, x):
                return forward(self, x)

        modules[name] = Policy()

    net = partial(around, nn.Tanh())
    ones = torch.linspace(0.5, 1.5, N)
    of(
        "residual",
        lambda s, x: s.b(torch.tanh(s.a(x)) + s.c(x)),
        a=nn.Linear(N, 8),
        b=nn.Linear(8, M),
        c=nn.Linear(N, 8),
    )
    of(
        "normalised observation",
        lambda s, x: s.f(((x - s.m) / torch.sqrt(s.v + 1e-5)).clamp(-5, 5)),
        f=net(),
        m=0.1 * ones,
        v=ones,
    )
    of("clamp by vectors", lambda s, x: torch.clamp(s.f(x), -s.h, s.h), f=net(), h=ones[:M])
    of("mean and log sigma", lambda s, x: s.f(x).chunk(2, dim=-1), f=nn.Linear(N, 2 * M))
    of(
        "parts of the input",
        lambda s, x: s.f(x[:, 3:9]) + s.g(x[:, :3]),
        f=nn.Linear(6, M),
        g=nn.Linear(3, M),
    )
    of("actor and critic", lambda s, x: (s.f(x), s.g(x)), f=net(), g=nn.Linear(N, 1))
    of("less its value at 0", lambda s, x: s.f(x) - s.f(torch.zeros_like(x)), f=net())
    of("u = -K x", lambda s, x: -(x @ s.K.T), K=torch.randn(M, N))
    of("-net(x)", lambda s, x: -s.f(x), f=net())
    of(
        "shared biases",
        lambda s, x: s.b(torch.tanh(s.a(x) + s.z)) + s.z[:M],
        a=nn.Linear(N, 8),
        b=nn.Linear(8, M),
        z=torch.zeros(8),
    )
    of(
        "mixture of experts",
        lambda s, x: (torch.softmax(s.g(x), -1)[..., None] * s.f(x).reshape(-1, 3, M)).sum(1),
        g=nn.Linear(N, 3),
        f=nn.Linear(N, 3 * M),
    )
    of("unit vector", lambda s, x: s.f(x / x.norm(dim=-1, keepdim=True)), f=net())
    of("sine layer", lambda s, x: s.b(torch.sin(30 * s.a(x))), a=nn.Linear(N, 8), b=nn.Linear(8, M))
    of("exp and log", lambda s, x: torch.log1p(torch.exp(s.f(x))), f=net())
    of("powers", lambda s, x: s.f(x) ** 3 + s.f(x).abs() ** 1.5, f=net())
    of("where", lambda s, x: torch.where(x[:, :1] > 0, s.f(x), s.g(x)), f=net(), g=net())
    of(
        "largest and least",
        lambda s, x: torch.minimum(s.f(x), s.g(x)) + s.f(x).max(dim=-1, keepdim=True).values,
        f=net(),
        g=net(),
    )
    of(
        "roll, stack, transpose",
        lambda s, x: s.f(torch.stack([x, x.roll(1, -1)], -1).transpose(1, 2).reshape(-1, 2 * N)),
        f=nn.Linear(2 * N, M),
    )
    of("einsum", lambda s, x: torch.einsum("bi,oi->bo", x, s.K), K=torch.randn(M, N))
    of(
        "mean of three",
        lambda s, x: torch.stack([s.f(x), s.g(x), s.h(x)]).mean(0),
        f=net(),
        g=net(),
        h=net(),
    )
    of(
        "attention over parts",
        lambda s, x: s.f(
            torch.softmax(x.reshape(-1, 3, 4) @ x.reshape(-1, 3, 4).transpose(1, 2), -1).flatten(1)
        ),
        f=nn.Linear(9, M),
    )
    of("drawn commands", lambda s, x: s.f(x) + torch.randn_like(x[:, :M]), f=net())
    of("a choice", lambda s, x: s.f(x).argmax(-1), f=net())
    return modules


def torch_recurrent():
    import torch
    from torch import nn

    torch.manual_seed(4)
    H, modules = 8, {}

    class Layers(nn.Module):
        def __init__(self, kind, layers=1, batch_first=False, carried=True, **more):
            super().__init__()
            self.core = kind(N, H, num_layers=layers, batch_first=batch_first, **more)
            self.head, self.axis, self.carried = nn.Linear(H, M), int(batch_first), carried

        def forward(self, x, *state):
            if not self.carried:
                return self.head(self.core(x.unsqueeze(self.axis))[0].squeeze(self.axis))
            state = state if len(state) == 2 else state[0]
            out, after = self.core(x.unsqueeze(self.axis), state)
            after = after if isinstance(after, tuple) else (after,)
            return (self.head(out.squeeze(self.axis)), *after)

    class Cell(nn.Module):
        def __init__(self, kind, change=lambda h: h):
            super().__init__()
            self.core, self.head, self.change = kind(N, H), nn.Linear(H, M), change

        def forward(self, x, *state):
            after = self.core(x, state if len(state) == 2 else state[0])
            after = after if isinstance(after, tuple) else (after,)
            return (self.head(after[0]), *map(self.change, after))

    for kind, count in ((nn.GRU, 1), (nn.LSTM, 2), (nn.RNN, 1)):
        for layers in (1, 2):
            states = [torch.zeros(layers, 1, H)] * count
            name = f"{kind.__name__} of {layers}"
            modules[name] = Layers(kind, layers), states
            modules[f"{name}, batch first"] = Layers(kind, layers, batch_first=True), states
        modules[f"{kind.__name__} without a state"] = Layers(kind, carried=False), []
    modules["RNN of relu"] = Layers(nn.RNN, nonlinearity="relu"), [torch.zeros(1, 1, H)]
    for kind, count in ((nn.GRUCell, 1), (nn.LSTMCell, 2), (nn.RNNCell, 1)):
        modules[kind.__name__] = Cell(kind), [torch.zeros(1, H)] * count
    half = [torch.zeros(1, H)]
    modules["GRUCell, clipped"] = Cell(nn.GRUCell, lambda h: h.clamp(-0.2, 0.2)), half
    modules["GRUCell, scaled"] = Cell(nn.GRUCell, lambda h: 0.9 * h), half
    return modules


def states_of(count):
    pairs = [("h_in", "h_out"), ("c_in", "c_out")][:count]
    return {
        "input_names": ["x", *(a for a, _ in pairs)],
        "output_names": ["y", *(b for _, b in pairs)],
    }


def add_torch():
    for dynamo in (True, False):
        by = "torch" if dynamo else "torch, legacy"
        for name, module in torch_modules().items():
            CASES[f"{by}: {name}"] = partial(export, module, dynamo=dynamo)
        for name, (module, states) in torch_recurrent().items():

            def write(path, module=module, states=states, dynamo=dynamo):
                export(module, path, dynamo, *states, **states_of(len(states)))

            CASES[f"{by}: {name}"] = write
    import torch

    def unnamed(path):
        module, states = torch_recurrent()["GRU of 1"]
        export(module, path, True, *states)

    CASES["torch: GRU without names"] = unnamed
    CASES["torch: one file"] = lambda path: torch.onnx.export(
        torch_modules()["64-64"], (torch.zeros(1, N),), str(path), external_data=False
    )
    CASES["torch: any batch"] = lambda path: torch.onnx.export(
        torch_modules()["64-64"],
        (torch.zeros(2, N),),
        str(path),
        dynamic_shapes=({0: torch.export.Dim("batch")},),
    )


# Libraries of learning ----------------------------------------------------------------------------


def boxes():
    import gymnasium as gym

    class Task(gym.Env):
        observation_space = gym.spaces.Box(-1, 1, (N,), np.float32)
        action_space = gym.spaces.Box(-1, 1, (M,), np.float32)

        def reset(self, seed=None, options=None):
            return np.zeros(N, np.float32), {}

        def step(self, action):
            return np.zeros(N, np.float32), 0.0, False, False, {}

    return Task()


def stable_baselines(kind, dynamo, path):
    """As its page on exporting writes it."""
    import stable_baselines3
    import torch

    model = getattr(stable_baselines3, kind)("MlpPolicy", boxes(), device="cpu", seed=1)

    class Exported(torch.nn.Module):
        def __init__(self, policy):
            super().__init__()
            self.policy = policy

        def forward(self, x):
            return self.policy(x, deterministic=True)

    policy = model.policy if kind in ("PPO", "A2C") else model.policy.actor
    if kind in ("TD3", "DDPG"):
        export(policy.mu, path, dynamo)
    else:
        export(Exported(policy), path, dynamo)


def rsl_rl(kind, path):
    import torch
    from rsl_rl.models import MLPModel, RNNModel
    from tensordict import TensorDict

    torch.manual_seed(2)
    observed = TensorDict({"policy": torch.zeros(1, N)}, batch_size=[1])
    sets = {"actor": ["policy"]}
    more = {"hidden_dims": [16, 16], "obs_normalization": True}
    gaussian = {"class_name": "GaussianDistribution", "init_std": 1.0}
    if kind == "heteroscedastic":
        gaussian["class_name"] = "HeteroscedasticGaussianDistribution"
    if kind == "beta":
        gaussian = {"class_name": "BetaDistribution"}
    more["distribution_cfg"] = gaussian
    if kind in ("gru", "lstm"):
        model = RNNModel(observed, sets, "actor", M, rnn_type=kind, rnn_hidden_dim=8, **more)
    else:
        model = MLPModel(observed, sets, "actor", M, **more)
    exported = model.as_onnx(verbose=False).eval()
    torch.onnx.export(
        exported,
        exported.get_dummy_inputs(),
        str(path),
        input_names=exported.input_names,
        output_names=exported.output_names,
        dynamo=True,
    )


def skrl(path):
    import torch
    from skrl.models.torch import GaussianMixin, Model

    class Policy(GaussianMixin, Model):
        def __init__(self):
            Model.__init__(self, observation_space=N, action_space=M, device="cpu")
            GaussianMixin.__init__(self)
            self.net = torch.nn.Sequential(
                torch.nn.Linear(N, 16), torch.nn.ELU(), torch.nn.Linear(16, M)
            )

        def forward(self, x):
            return self.net(x)

        def compute(self, inputs, role=""):
            return self.net(inputs["states"]), {}

    export(Policy(), path, True)


def jax_models():
    import equinox as eqx
    import flax.linen as linen
    import jax
    import jax.numpy as jnp
    from flax import nnx

    keys = jax.random.split(jax.random.PRNGKey(0), 4)
    mlp = eqx.nn.MLP(N, M, 16, 2, activation=jax.nn.tanh, key=keys[0])
    gru, lstm = eqx.nn.GRUCell(N, 8, key=keys[1]), eqx.nn.LSTMCell(N, 8, key=keys[2])
    K = jax.random.normal(keys[3], (M, N))

    class Dense(linen.Module):
        @linen.compact
        def __call__(self, x):
            return linen.Dense(M)(linen.swish(linen.LayerNorm()(linen.Dense(16)(x))))

    dense = Dense()
    params = dense.init(keys[0], jnp.zeros((1, N)))
    layered = nnx.Sequential(
        nnx.Linear(N, 16, rngs=nnx.Rngs(0)), jax.nn.gelu, nnx.Linear(16, M, rngs=nnx.Rngs(1))
    )
    head = jax.random.normal(keys[3], (M, 8))
    return {
        "jax: u = -K x": (lambda x: -K @ x, [(N,)]),
        "jax: tanh net": (lambda x: jnp.tanh(x @ K.T), [(1, N)]),
        "equinox: MLP": (mlp, [(N,)]),
        "equinox: GRUCell": (lambda x, h: (head @ gru(x, h), gru(x, h)), [(N,), (8,)]),
        "equinox: LSTMCell": (
            lambda x, h, c: (head @ lstm(x, (h, c))[0], *lstm(x, (h, c))),
            [(N,), (8,), (8,)],
        ),
        "flax: linen": (lambda x: dense.apply(params, x), [(1, N)]),
        "flax: nnx": (layered, [(1, N)]),
    }


def jax2onnx(name, path):
    import onnx
    from jax2onnx import to_onnx

    function, shapes = jax_models()[name]
    onnx.save(to_onnx(function, shapes), path)


def keras_model(kind, path):
    import keras

    keras.utils.set_random_seed(1)
    layers = keras.layers
    middle = {
        "relu": [layers.Dense(16, "relu")],
        "swish and normalisation": [
            layers.Dense(16),
            layers.BatchNormalization(),
            layers.Activation("swish"),
        ],
        "gelu and layer norm": [layers.Dense(16, "gelu"), layers.LayerNormalization()],
    }[kind]
    model = keras.Sequential([keras.Input((N,)), *middle, layers.Dense(M, "tanh")])
    model(np.zeros((1, N), np.float32))
    model.export(str(path), format="onnx", verbose=False)


def scikit(kind, path):
    from skl2onnx import to_onnx
    from sklearn.decomposition import PCA
    from sklearn.linear_model import LinearRegression, Ridge
    from sklearn.neural_network import MLPRegressor
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import MinMaxScaler, StandardScaler

    random = np.random.default_rng(0)
    X, Y = random.standard_normal((200, N)), random.standard_normal((200, M))
    model = {
        "linear": LinearRegression(),
        "ridge": make_pipeline(StandardScaler(), Ridge()),
        "tanh": MLPRegressor(hidden_layer_sizes=(16,), activation="tanh", max_iter=50),
        "relu": make_pipeline(
            MinMaxScaler(), MLPRegressor(hidden_layer_sizes=(16, 16), max_iter=50)
        ),
        "logistic": MLPRegressor(hidden_layer_sizes=(16,), activation="logistic", max_iter=50),
        "components": make_pipeline(PCA(6), LinearRegression()),
    }[kind].fit(X, Y)
    path.write_bytes(to_onnx(model, X[:1].astype(np.float32)).SerializeToString())


def add_libraries():
    for kind in ("PPO", "A2C", "SAC", "TD3", "DDPG"):
        for dynamo in (True, False):
            by = "stable-baselines3" + ("" if dynamo else ", legacy")
            CASES[f"{by}: {kind}"] = partial(stable_baselines, kind, dynamo)
    for kind in ("gaussian", "heteroscedastic", "beta", "gru", "lstm"):
        CASES[f"rsl_rl: {kind}"] = partial(rsl_rl, kind)
    CASES["skrl: gaussian"] = skrl
    for name in jax_models():
        CASES[name] = partial(jax2onnx, name)
    for kind in ("relu", "swish and normalisation", "gelu and layer norm"):
        CASES[f"keras: {kind}"] = partial(keras_model, kind)
    for kind in ("linear", "ridge", "tanh", "relu", "logistic", "components"):
        CASES[f"skl2onnx: {kind}"] = partial(scikit, kind)


# Each against onnxruntime -------------------------------------------------------------------------


def compared(path):
    """The largest difference over some periods, and the largest command."""
    import onnxruntime

    from eqt_cli.base.errors import InputError
    from eqt_cli.extensions.network.network import Emitted, bare_source, call, function_of
    from eqt_cli.extensions.network.reader import network_text
    from eqt_cli.extensions.network.steps import network_of

    session = onnxruntime.InferenceSession(str(path))
    inputs, outputs = session.get_inputs(), [each.name for each in session.get_outputs()]
    text, how = network_text(path), ""
    try:
        network = network_of(text, path.name)
    except InputError:  # as its message says
        names = [each.name for each in inputs[1:]]
        network = network_of(text, path.name, tuple(zip(names, outputs[1:], strict=False)))
        how = ", with `memory`"
    function = function_of(bare_source(Emitted(network)))
    kinds = {"tensor(float16)": np.float16, "tensor(double)": np.float64}
    kind = kinds.get(inputs[0].type, np.float32)
    shape = [n if isinstance(n, int) else 1 for n in inputs[0].shape]
    state = {
        each.name: np.zeros([n if isinstance(n, int) else 1 for n in each.shape], kind)
        for each in inputs[1:]
    }
    states = np.array([[*network.initial, 0.0]])
    command, worst, largest = np.empty((1, network.commands)), 0.0, 0.0
    for x in np.random.default_rng(6).standard_normal((PERIODS, N)):
        x = x.astype(kind)
        answers = dict(
            zip(outputs, session.run(None, {inputs[0].name: x.reshape(shape)} | state), strict=True)
        )
        call(function, states, x.astype(float)[None], command)
        wanted = np.ravel(answers[outputs[0]]).astype(float)
        worst = max(worst, float(np.abs(command[0] - wanted).max()))
        largest = max(largest, float(np.abs(wanted).max()))
        state = dict(zip(state, (answers[name] for name in outputs[1:]), strict=False))
    return worst, largest, how


def main(names):
    from eqt_cli.base.errors import EqtError

    logging.disable(logging.WARNING)
    warnings.simplefilter("ignore")
    add_torch()
    add_libraries()
    rows, counts = [], {"flies": 0, "refused": 0, "wrong": 0, "not written": 0}
    for name, write in CASES.items():
        if names and not any(part in name for part in names):
            continue
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "policy.onnx"
            try:
                with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
                    write(path)
            except Exception as error:
                how, said = "not written", f"{type(error).__name__}: {str(error).splitlines()[0]}"
            else:
                try:
                    worst, largest, more = compared(path)
                    limit = LIMITS.get(name.rpartition(": ")[2], 1e-6) * max(1.0, largest)
                    how = "flies" if worst < limit else "wrong"
                    said = f"{worst:.1e} of {largest:.2g}{more}"
                except EqtError as error:
                    how, said = "refused", str(error.args[0]).removeprefix("policy.onnx: ")
        counts[how] += 1
        rows.append(f"| {name} | {how} | {said[:230]} |")
        print(rows[-1], file=sys.stderr, flush=True)
    print("# Policies as exporters write them\n")
    print(", ".join(f"{number} {how}" for how, number in counts.items()), end=".\n\n")
    print("| written by | eqt | largest difference from onnxruntime, or why not |\n|---|---|---|")
    print("\n".join(rows))


if __name__ == "__main__":
    with suppress(KeyboardInterrupt):
        main(sys.argv[1:])
