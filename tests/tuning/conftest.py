"""A small experiment whose laws are tuned within a second."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest

from eqt_cli import api
from eqt_cli.tuning.generations import Found

SMALL: dict[str, Any] = {
    "name": "small",
    "group": "SO3",
    "inertia": [2, 1, 3],
    "gains": {"kp": 1.0, "kd": 0.5},
    "reference": {"torque": ["cos(t)", "sin(t)", "0"]},
    "controllers": ["eqt", {"kind": "family", "gyroscopic": 1.0}],
    "initial": {"pose": "haar", "velocity": "normal"},
    "ensemble": {"runs": 2, "seed": 1},
    "time": {"duration": 0.5, "samples": 6},
    "solver": {"rtol": 1.0e-6, "cross_check": 0, "error_estimate": False},
    "tune": {
        "over": {"gains.kp": {"log": [0.1, 10]}, "controllers[1].gyroscopic": [0, 2]},
        "objective": "mean_pose_error",
        "budget": 2,
        "population": 5,
        "seeds": 1,
        "confirm": {"runs": 6, "seed": 9},
    },
}


@pytest.fixture(scope="session")
def searched(tmp_path_factory: pytest.TempPathFactory) -> tuple[Found, Path]:
    """A search to its end, and its folder; to be read only."""
    folder = tmp_path_factory.mktemp("searched") / "t"
    return api.tune(deepcopy(SMALL), folder), folder


@pytest.fixture
def small() -> dict[str, Any]:
    """The configuration, to be changed."""
    return {**SMALL, "tune": dict(SMALL["tune"])}


@pytest.fixture(scope="module")
def searched_twice(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """A tuning of two laws with two search seeds, after one with the first of them."""
    folder = tmp_path_factory.mktemp("twice") / "t"
    few = {"budget": 1, "confirm": {"runs": 3, "seed": 9}, "over": {"gains.kp": [0.5, 5]}}
    tune: dict[str, Any] = SMALL["tune"] | few
    api.tune(SMALL | {"tune": tune}, folder)
    first = folder / "generations/eqt/seed-0/000/results.h5"
    before = first.stat().st_mtime_ns
    record = api.tune(SMALL | {"tune": tune | {"seeds": 2}}, folder).record
    assert first.stat().st_mtime_ns == before  # a further search computes no earlier one anew
    return folder, record
