"""A small table that has everything a result has."""

import numpy as np
import pytest
from made_up import Table

from eqt_cli.base.store_writer import Variable

RUNS = ("controller", "run")


@pytest.fixture(scope="session")
def table():
    rng = np.random.default_rng(1)
    return Table(
        variables={
            "torque": Variable(
                (*RUNS, "time", "axis"),
                rng.standard_normal((2, 5, 11, 3)),
                {"units": "N m", "long_name": "control torque τ"},
            ),
            "settling_time": Variable(RUNS, np.full((2, 5), np.nan), {"units": "s", "band": 0.05}),
            "status": Variable(RUNS, np.arange(10).reshape(2, 5)),
            "message": Variable(RUNS, np.array([["", "ok", "‖Q‖ = ∞", "a", "b"]] * 2)),
            "reference_drift": Variable((), np.array(1e-15)),
        },
        coordinates={
            "controller": Variable(("controller",), np.array(["eqt", "gt"])),
            "time": Variable(("time",), np.linspace(0.0, 1.0, 11), {"units": "s"}),
        },
        attributes={"config": "name: paper\n", "seed": 2025, "wall_time": 1.5},
    )
