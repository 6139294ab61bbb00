"""The weights of a regulator are keys of `tune`, `worst` and sweeps."""

from copy import deepcopy

import numpy as np
import pytest

import eqt_cli
from eqt_cli import api

J = [2.0, 1.0, 3.0]
CONFIG = {
    "name": "weights",
    "group": "SO3",
    "inertia": J,
    "gains": {"kp": 1.0, "kd": 1.0},
    "reference": {"kind": "constant"},
    "controllers": [{"kind": "lqr", "weights": {"pose": 1, "velocity": [1, 1, 1]}}, "eqt"],
    "initial": {"pose": {"kind": "angle", "angle": 1.0}},
    "ensemble": {"runs": 2, "seed": 1},
    "time": {"duration": 4.0, "samples": 21},
    "solver": {"rtol": 1.0e-6, "cross_check": 0},
}
WEIGHT, VELOCITY = "controllers[0].weights.pose", "controllers[0].weights.velocity[0:3]"
TUNE = {
    "over": {WEIGHT: {"log": [0.1, 100]}, "gains.kp": [0.5, 2]},
    "objective": "mean_pose_error",
    "budget": 5,
    "samples": 1,
    "confirm": {"runs": 2, "seed": 9},
}


def gain_of(config):
    return eqt_cli.load_experiment(config).experiment(0).loops["lqr"].controller.regulator.gain


def test_a_swept_weight_designs_new_gains_at_every_point():
    """k_ε = √q and k_e² = 1 + 2 k_ε J at rest, for unit weights of e and u."""
    config = CONFIG | {"sweep": [{"grid": {WEIGHT: [1, 4, 9]}}]}
    loaded = eqt_cli.load_experiment(config)
    for k, stiffness in enumerate((1.0, 2.0, 3.0)):
        gain = loaded.experiment(k).loops["lqr"].controller.regulator.gain
        damping = np.diag(np.sqrt(1 + 2 * stiffness * np.array(J)))
        np.testing.assert_allclose(gain, np.hstack([stiffness * np.eye(3), damping]), atol=1e-10)


@pytest.mark.ci("searches to the end")
def test_a_law_that_reads_no_gains_is_not_tuned_over_them(tmp_path):
    """And the winner is the point with the largest weight, because nothing bounds its torque."""
    found = api.tune(deepcopy(CONFIG | {"tune": TUNE}), tmp_path / "t")
    lqr, eqt = found.record["laws"]
    assert [*lqr["over"]] == [WEIGHT] and [*eqt["over"]] == ["gains.kp"]
    [winner] = lqr["winners"]
    weight = winner["values"][WEIGHT]
    assert weight > 10  # of five points, one in each fifth of three decades
    tuned = gain_of(tmp_path / "t/tuned/lqr.yaml")
    np.testing.assert_allclose(tuned[:, :3], np.sqrt(weight) * np.eye(3), rtol=1e-9, atol=1e-9)


@pytest.mark.ci("searches to the end")
def test_a_law_is_tuned_without_gains(tmp_path):
    laws = {"controllers": CONFIG["controllers"][:1]}
    config = {**CONFIG, **laws, "tune": TUNE | {"over": {WEIGHT: [1, 4]}}}
    del config["gains"]
    [law] = api.tune(deepcopy(config), tmp_path / "t").record["laws"]
    weight = law["winners"][0]["values"][WEIGHT]
    stiffness = gain_of(tmp_path / "t/tuned/lqr.yaml")[:, :3]
    np.testing.assert_allclose(stiffness, np.sqrt(weight) * np.eye(3), rtol=1e-9, atol=1e-9)


@pytest.mark.ci("searches to the end")
def test_the_worst_weights_are_searched(tmp_path):
    worst = {
        "over": {WEIGHT: [0.5, 2], VELOCITY: [0.5, 2]},
        "objective": "mean_pose_error",
        "budget": 1,
        "population": 5,
        "seeds": 1,
        "profile": {"points": 2},
    }
    config = {**CONFIG, "controllers": CONFIG["controllers"][:1], "worst": worst}
    found = api.worst(deepcopy(config), tmp_path / "w")
    [law] = found.record["laws"]
    assert [*law["over"]] == [WEIGHT, VELOCITY]
    assert 0.5 <= law["values"][WEIGHT] < 1  # of five points, one in each fifth; less pulls less
    assert 0.5 <= law["values"][VELOCITY] <= 2
