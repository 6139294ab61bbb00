"""Runs that end at the limit of steps."""

import warnings

import numpy as np
import pytest

import eqt_cli
from eqt_cli.api.loading import open_at
from eqt_cli.base.errors import EqtWarning
from eqt_cli.extensions.proofs.step_limits import remarks


@pytest.mark.ci("runs a loop until it fails")
@pytest.mark.parametrize(("delay", "said"), [(4, "unstable"), (0, "decay")])
def test_a_limit_of_steps_comes_with_the_growth_of_small_errors(tmp_path, delay, said):
    config = {
        "group": "SO3",
        "inertia": [1, 1.2, 1.5],
        "gains": {"kp": 8.0, "kd": 6.0},
        "controllers": ["eqt"],
        "reference": {"kind": "constant", "velocity": [0.3, 0.1, 0]},
        "control": {"period": 0.1, "delay": delay},
        "initial": {"pose": {"kind": "exp_normal", "std": 0.3}},
        "ensemble": {"runs": 1},
        "time": {"duration": 30, "samples": 5},
        "solver": {"engine": "solve_ivp", "max_steps": 900, "cross_check": 0},
    }
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore", EqtWarning)
        eqt_cli.run(config, out=tmp_path / "limited")
    with open_at(tmp_path / "limited") as result:
        (line,) = remarks(result)
    assert "eqt ended at solver.max_steps" in line
    assert said in line
