"""The plant in JAX that trains the network of examples/learned is that of its experiment."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
import yaml

import eqt_cli

pytest.importorskip("gymnasium", reason="needs the extra gym")
LEARNED = Path(__file__).parents[3] / "examples" / "learned"
CURVE, RUNS, SUBSTEPS = 3, 5, 20


def loaded(name):
    spec = importlib.util.spec_from_file_location(f"learned_{name}", LEARNED / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def environment():
    """The flights of the network on one curve."""
    config = yaml.safe_load((LEARNED / "flights.yaml").read_text(encoding="utf-8"))
    del config["sweep"], config["metrics"]
    config["plugins"] = [str(LEARNED / "learned.py")]
    config["controllers"] = [config["controllers"][-1] | {"kind": "network"}]
    for section in (config["reference"], *config["initial"].values()):
        section["curve"] = CURVE
    return eqt_cli.gym.make(config, num_envs=RUNS, episodes=RUNS, dtype=np.float64)


@pytest.mark.ci("compiles in JAX, where that is installed")
def test_the_training_in_jax_moves_and_observes_as_the_environment_does():
    """At 20 steps a period; the training takes one, which is up to 5 mm off in 10 s."""
    jax = pytest.importorskip("jax", reason="examples/learned is trained in JAX")
    jax.config.update("jax_enable_x64", True)
    train, reference = loaded("train"), loaded("learned").Lissajous(CURVE)
    names = "amplitude", "frequency", "phase", "centre"
    curve = [np.tile(getattr(reference, name)[:, None], RUNS) for name in names]
    env = environment()
    moved = jax.jit(train.moved, static_argnums=2)
    observed = env.reset(options={"runs": np.arange(RUNS)})[0]
    poses, velocities = env.exactly("pose"), env.exactly("velocity")
    R = poses[:, :3, :3].transpose(1, 2, 0)
    v = train.product(R, velocities[:, 3:].T)
    state = poses[:, :3, 3].T, R, v, velocities[:, :3].T
    random = np.random.default_rng(0)
    for k in range(50):
        theirs = train.observed(curve, k * train.PERIOD, state).T
        assert observed == pytest.approx(np.asarray(theirs), abs=1e-7), k
        outputs = random.uniform(-0.2, 0.2, (RUNS, 4)) - [0.3, 0, 0, 0]
        wrench = train.MOST * np.concatenate([(outputs.T[:1] + 1) / 2, outputs.T[1:]])
        state = moved(state, wrench, SUBSTEPS)
        observed = env.step(outputs)[0]
    # Runge-Kutta of order 4 with steps of 1 ms; 7e-11 m was measured.
    assert env.exactly("pose")[:, :3, 3].T == pytest.approx(np.asarray(state[0]), abs=1e-7)
