"""Train the network of flights.yaml, by back-propagation through the motion of the quadrotor.

It needs JAX and ONNX, which eqt does not: pip install jax onnx. Seeds are fixed; another machine
rounds otherwise, and finds other weights that fly alike.

    python train.py --out network.onnx
"""

from __future__ import annotations

import argparse
import time
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

MASS, GRAVITY = 0.8, 9.81
INERTIA = np.array([[3063.0, 4.0, 0.0], [4.0, 1720.0, 28.0], [0.0, 28.0, 4585.0]]) * 1e-6
INVERSE = np.linalg.inv(INERTIA)
MOST = np.array([3 * MASS * GRAVITY, 0.5, 0.5, 0.025])[:, None]  # thrust, N, and torques, N m
PERIOD, STEPS = 0.02, 500
AHEAD = 0.04, 0.08, 0.12, 0.16, 0.2  # s, of the position
LATER = 0.2  # s, of the yaw
SIZES = (45, 64, 64, 4)

# All arrays have an axis more, their last: the flights. This is much faster than small matrices.

# The flights: Lissajous curves of position and yaw, and starts near them --------------------------


def draw(key: Any, runs: int) -> tuple[Any, Any]:
    """Return curves, and states at t = 0: p, R, v in space, ω in the body."""
    keys = iter(jax.random.split(key, 8))

    def uniform(*ends: float) -> Any:
        shape = len(ends), runs
        return np.array(ends)[:, None] * jax.random.uniform(next(keys), shape, minval=-1.0)

    curve = (
        uniform(2.0, 2.0, 2.0, 2.0),
        uniform(3.0, 3.0, 3.0, 2.0),
        uniform(np.pi, np.pi, np.pi, np.pi),
        uniform(0.5, 0.5, 0.5, np.pi),
    )
    now, rate = course(curve, 0.0)
    R = about_vertical(now[3] + uniform(np.pi)[0])
    p, v = now[:3] + uniform(0.5, 0.5, 0.5), rate[:3] + uniform(0.1, 0.1, 0.1)
    return curve, (p, R, v, uniform(0.1, 0.1, 0.1))


def course(curve: Any, t: Any) -> tuple[Any, Any]:
    """Return position and yaw, and their rates, ``(4, runs)``."""
    amplitude, frequency, phase, centre = curve
    angle = frequency * t + phase
    return amplitude * jnp.sin(angle) + centre, amplitude * frequency * jnp.cos(angle)


def about_vertical(yaw: Any) -> Any:
    """Return the rotation by an angle about the vertical."""
    c, s, o = jnp.cos(yaw), jnp.sin(yaw), jnp.zeros_like(yaw)
    return jnp.stack([jnp.stack(row) for row in ([c, -s, o], [s, c, o], [o, o, o + 1])])


def product(A: Any, B: Any) -> Any:
    """Return the product of matrices, or of a matrix and a vector."""
    columns = (A[:, k] if B.ndim == 2 else A[:, k, None] for k in range(3))
    return sum(column * B[k] for k, column in enumerate(columns))


def cross(a: Any, b: Any) -> Any:
    """Return a × b."""
    i, j = [1, 2, 0], [2, 0, 1]
    return jnp.stack([a[k] * b[m] - a[m] * b[k] for k, m in zip(i, j, strict=True)])


# The quadrotor ------------------------------------------------------------------------------------


def rate_of(state: Any, wrench: Any) -> Any:
    """Return the rate of a state under thrust and torques."""
    _, R, v, w = state
    turn = INVERSE @ (wrench[1:] - cross(w, INERTIA @ w))
    R_dot = cross(R.swapaxes(0, 1), jnp.broadcast_to(w[:, None], R.shape)).swapaxes(0, 1)
    fall = np.array([0.0, 0.0, GRAVITY])[:, None]
    return v, R_dot, wrench[0] / MASS * R[:, 2] - fall, turn


def moved(state: Any, wrench: Any, substeps: int = 1) -> Any:
    """Return the state a control period later, by Runge-Kutta of order 4."""
    h = PERIOD / substeps

    def add(s: Any, k: Any, step: float) -> Any:
        return tuple(x + step * y for x, y in zip(s, k, strict=True))

    for _ in range(substeps):
        a = rate_of(state, wrench)
        b = rate_of(add(state, a, h / 2), wrench)
        c = rate_of(add(state, b, h / 2), wrench)
        d = rate_of(add(state, c, h), wrench)
        for k, weight in ((a, 1), (b, 2), (c, 2), (d, 1)):
            state = add(state, k, weight * h / 6)
    p, R, v, w = state
    back = 1.5 * np.eye(3)[..., None] - 0.5 * product(R.swapaxes(0, 1), R)
    return p, product(R, back), v, w  # R stays a rotation


# The network: what it observes, as `observes` in flights.yaml says, and its commands --------------


def observed(curve: Any, t: Any, state: Any) -> Any:
    """Return the inputs of the network, ``(45, runs)``."""
    p, R, v, w = state
    back = R.swapaxes(0, 1)
    now, rate = course(curve, t)
    relative = product(about_vertical(-now[3]), R)
    later = product(about_vertical(-course(curve, t + LATER)[0][3]), R)
    return jnp.concatenate(
        [
            product(back, p - now[:3]),
            0.5 * product(back, v - rate[:3]),
            relative.reshape(9, -1),
            0.2 * w,
            0.2 * (w - R[2] * rate[3]),
            *(product(back, p - course(curve, t + s)[0][:3]) for s in AHEAD),
            later.reshape(9, -1),
        ]
    )


def begun(key: Any) -> list[tuple[Any, Any]]:
    """Return weights and biases at the start: it hovers."""
    layers = []
    for m, n in pairwise(SIZES):
        key, used = jax.random.split(key)
        layers.append((jax.random.normal(used, (n, m)) / np.sqrt(m), jnp.zeros((n, 1))))
    W, _ = layers[-1]
    layers[-1] = 0.02 * W, jnp.array([[np.arctanh(-1 / 3)], [0.0], [0.0], [0.0]])
    return layers


def commanded(layers: Any, x: Any) -> Any:
    """Return thrust and torques."""
    for W, b in layers:
        x = jnp.tanh(W @ x + b)
    return MOST * jnp.concatenate([(x[:1] + 1) / 2, x[1:]])


# The objective ------------------------------------------------------------------------------------


def errors(curve: Any, t: Any, state: Any) -> tuple[Any, Any, Any, Any]:
    """Return ‖p − p_d‖, the yaw error by the second body axis, ‖v − v_d‖ and ‖ω − ω_d‖."""
    p, R, v, w = state
    now, rate = course(curve, t)
    c, s = jnp.cos(now[3]), jnp.sin(now[3])
    yaw = jnp.arctan2(jnp.abs(c * R[0, 1] + s * R[1, 1]), c * R[1, 1] - s * R[0, 1])
    return size(p - now[:3]), yaw, size(v - rate[:3]), size(w - R[2] * rate[3])


def size(x: Any) -> Any:
    """Return a norm that has a derivative at 0."""
    return jnp.sqrt(jnp.sum(x * x, axis=0) + 1e-12)


def reward(found: Any, delta: Any) -> Any:
    """Return the reward of the paper's code at an instant."""
    e, yaw, v, w = found
    return 15 * jnp.exp(-e * e / delta) - 4 * yaw - 0.05 * v - 0.01 * w


def flown(layers: Any, curve: Any, t: Any, state: Any, steps: int) -> tuple[Any, Any]:
    """Return the last states of flights, and the errors at all instants after the first."""

    def step(carry: Any, _: Any) -> Any:
        t, state = carry
        state = moved(state, commanded(layers, observed(curve, t, state)))
        return (t + PERIOD, state), errors(curve, t + PERIOD, state)

    (_, state), found = jax.lax.scan(step, (t, state), None, steps)
    return state, found


@partial(jax.jit, static_argnums=3)
def judged(layers: Any, curve: Any, state: Any, steps: int) -> Any:
    """Return the errors of whole flights, ``(steps, runs)`` each."""
    return flown(layers, curve, jnp.zeros(curve[0].shape[1]), state, steps)[1]


# The training -------------------------------------------------------------------------------------


def trained(args: argparse.Namespace) -> Any:
    """Return the layers after a number of updates, by Adam."""
    key = jax.random.PRNGKey(args.seed)
    key, used = jax.random.split(key)
    layers, runs, window = begun(used), args.runs, args.window
    checked = draw(jax.random.PRNGKey(10_000), 500)

    def loss(layers: Any, curve: Any, t: Any, state: Any, share: Any) -> Any:
        delta = 0.8 * 0.125 ** jnp.minimum(2 * share, 1.0)  # from 0.8 to 0.1
        far = 2.0 * jnp.maximum(0.0, 1 - 4 * share)
        state, found = flown(layers, curve, t, state, window)
        score = reward(found, delta) - far * jnp.minimum(found[0], 5.0)
        kept = jnp.where(found[0].max(0) < 5, 1.0, 0.3)
        size_now = found[0][-1] + 0.1 * found[3][-1]
        return -jnp.mean(kept * score), (state, size_now)

    @jax.jit
    def update(carry: Any, k: Any) -> Any:
        layers, first, second, curve, t, state, key = carry
        share = k / args.updates
        (value, (after, far)), slope = jax.value_and_grad(loss, has_aux=True)(
            layers, curve, t, state, share
        )
        norm = jnp.sqrt(sum(jnp.sum(g * g) for g in jax.tree.leaves(slope)))
        good = jnp.isfinite(norm)
        slope = jax.tree.map(
            lambda g: jnp.where(good, g * jnp.minimum(1.0, 1.0 / (norm + 1e-9)), 0.0), slope
        )
        step = args.rate * 0.5 * (1 + jnp.cos(jnp.pi * share))
        first = jax.tree.map(lambda m, g: 0.9 * m + 0.1 * g, first, slope)
        second = jax.tree.map(lambda m, g: 0.99 * m + 0.01 * g * g, second, slope)
        b, c = 1 - 0.9 ** (k + 1), 1 - 0.99 ** (k + 1)
        layers = jax.tree.map(
            lambda x, m, s: x - step * (m / b) / (jnp.sqrt(s / c) + 1e-8), layers, first, second
        )
        t = t + window * PERIOD
        key, one = jax.random.split(key)
        fresh, begin = draw(one, runs)
        over = (t > STEPS * PERIOD - 1e-6) | ~(far < 5.0)

        def chosen(new: Any, old: Any) -> Any:
            return jnp.where(over, new, old)

        curve, state = jax.tree.map(chosen, (fresh, begin), (curve, after))
        return (layers, first, second, curve, jnp.where(over, 0.0, t), state, key), value

    key, one = jax.random.split(key)
    curve, state = draw(one, runs)
    t = window * PERIOD * jnp.floor(jnp.arange(runs) % (STEPS // window))
    none = jax.tree.map(jnp.zeros_like, layers)
    carry = layers, none, none, curve, t, state, key
    began = time.time()
    for k in range(args.updates):
        carry, value = update(carry, float(k))
        if (k + 1) % args.report == 0 or k + 1 == args.updates:
            found = judged(carry[0], *checked, STEPS)
            of_run = np.nan_to_num(np.asarray(reward(found, 0.1).mean(0)), nan=-99.0)
            last = np.asarray(found[0][-100:].mean(0))
            print(
                f"{k + 1} updates, {time.time() - began:.0f} s: loss {value:.2f}; "
                f"median reward {np.median(of_run):.3f}, "
                f"steady error {np.nanmedian(last):.4f} m, lost {(~(last < 0.5)).mean():.3f}",
                flush=True,
            )
    simulated = args.updates * runs * window * PERIOD
    print(f"{simulated:,.0f} simulated seconds in {time.time() - began:.0f} s")
    return carry[0]


def written(layers: Any, path: Path) -> None:
    """Write the network as ONNX: Gemm and Tanh."""
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    nodes, constants, name = [], [], "x"
    for k, (W, b) in enumerate(layers):
        for letter, values in (("W", W), ("b", b[:, 0])):
            values = np.asarray(values, dtype=np.float32)
            constants.append(numpy_helper.from_array(values, f"{letter}{k}"))
        nodes.append(helper.make_node("Gemm", [name, f"W{k}", f"b{k}"], [f"z{k}"], transB=1))
        nodes.append(helper.make_node("Tanh", [f"z{k}"], [f"h{k}"]))
        name = f"h{k}"
    ends = [
        helper.make_tensor_value_info(each, TensorProto.FLOAT, [1, n])
        for each, n in (("x", SIZES[0]), (name, SIZES[-1]))
    ]
    graph = helper.make_graph(nodes, "learned", ends[:1], ends[1:], constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model)
    onnx.save(model, path)


def main() -> None:
    """Train, and write the network."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("network.onnx"))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--runs", type=int, default=256, help="flights side by side")
    parser.add_argument("--window", type=int, default=50, help="control periods of an update")
    parser.add_argument("--updates", type=int, default=3000)
    parser.add_argument("--rate", type=float, default=3e-3, help="largest step of Adam")
    parser.add_argument("--report", type=int, default=250)
    args = parser.parse_args()
    written(trained(args), args.out)


if __name__ == "__main__":
    main()
