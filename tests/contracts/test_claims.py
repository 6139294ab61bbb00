"""What every set of claims must be, whoever wrote it."""

import numpy as np
import pytest

from eqt_cli import api
from eqt_cli.controllers import controllers

CONFIG = {
    "group": "SO3",
    "inertia": [2, 1, 3],
    "gains": {"kp": 1.0, "kd": 0.5},
    "reference": {"torque": ["cos(t)", "sin(t)", "0"]},
    "controllers": ["eqt"],
    "initial": {"pose": "haar", "velocity": "normal"},
    "ensemble": {"runs": 5, "seed": 1},
    "time": {"duration": 6.0, "samples": 13},
    "solver": {"rtol": 1e-5, "cross_check": 0},
}


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("claims")
    return api.run(api.load_experiment(CONFIG, {"name": "claims"}), folder / "out")


def rows(claim_class):
    return [row for claim in claim_class.claims for row in claim.rows]


def test_it_says_who_claims_what(claim_class):
    assert claim_class.source
    assert all(claim.says and claim.rows for claim in claim_class.claims)


def test_its_laws_are_known(claim_class):
    assert {kind for row in rows(claim_class) for kind in row.kinds} <= set(controllers.names())


def test_its_measures_are_known(claim_class, result):
    for measure in {row.measure for row in rows(claim_class)}:
        assert api.compare(result, metrics=[measure]).levels


def test_bounds_and_windows_are_numbers(claim_class):
    for row in rows(claim_class):
        if hasattr(row, "bound"):
            assert np.isfinite(row.bound)
            assert row.statement
        else:
            assert row.lesser != row.greater
