"""A small experiment whose laws are tuned within a second."""

from copy import deepcopy

import numpy as np
import pytest
from small_experiment import mapping

from eqt_cli import api
from eqt_cli.extensions.search import training
from eqt_cli.results.result import Result

SMALL = mapping(
    name="small",
    controllers=["eqt", {"kind": "family", "gyroscopic": 1.0}],
    ensemble={"runs": 2, "seed": 1},
    time={"duration": 0.5, "samples": 6},
    solver={"rtol": 1.0e-6, "cross_check": 0, "error_estimate": False},
    tune={
        "over": {"gains.kp": {"log": [0.1, 10]}, "controllers[1].gyroscopic": [0, 2]},
        "objective": "mean_pose_error",
        "budget": 8,
        "samples": 1,
        "confirm": {"runs": 6, "seed": 9},
    },
)


class Stored(Result):
    """A result made up of numbers of one law, ``(points, runs)``."""

    horizon, attributes = 10.0, {}

    def __init__(self, status, **numbers):
        self.numbers = {name: np.array(each, float)[:, None] for name, each in numbers.items()}
        self.status = np.array(status)[:, None]
        self.metrics = list(numbers)

    def has(self, name):
        return False

    def metric(self, name, controller=None):
        settled = name == "settled"  # told by another, as a real result does
        found = np.isfinite(self.numbers["settling_time"]) if settled else self.numbers[name]
        return np.where(self.status == 0, found, np.nan)


@pytest.fixture
def stored():
    return Stored


@pytest.fixture(scope="session")
def searched(tmp_path_factory):
    """A search to its end, and its folder; to be read only."""
    folder = tmp_path_factory.mktemp("searched") / "t"
    return api.tune(deepcopy(SMALL), folder), folder


@pytest.fixture
def small():
    """The configuration, to be changed."""
    return {**SMALL, "tune": dict(SMALL["tune"])}


@pytest.fixture(scope="module")
def searched_twice(tmp_path_factory):
    """A tuning of two laws on two training samples, after one on the first of them."""
    folder = tmp_path_factory.mktemp("twice") / "t"
    few = {"budget": 5, "confirm": {"runs": 3, "seed": 9}, "over": {"gains.kp": [0.5, 5]}}
    tune = SMALL["tune"] | few
    first = api.tune(SMALL | {"tune": tune}, folder).record
    with pytest.MonkeyPatch.context() as patch:
        tried = []
        computed = training.computed
        patch.setattr(
            training, "computed", lambda s, *a, **k: tried.extend(s) or computed(s, *a, **k)
        )
        record = api.tune(SMALL | {"tune": tune | {"samples": 2}}, folder).record
    # A further sample computes no earlier one anew.
    assert {study.base.config.ensemble.seed for study in tried} == {2}
    assert first["laws"][0]["searches"][0]["values"] == record["laws"][0]["searches"][0]["values"]
    return folder, record
