"""The variables of a result: what each means, its unit, and what it has one value for."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum, auto
from typing import Any

import numpy as np

from eqt_cli.closed_loop.signals import Signal, signals
from eqt_cli.engines import Status
from eqt_cli.experiment.build import Experiment
from eqt_cli.results.metrics import EARLY_WINDOW, METRICS, unit_in
from eqt_cli.store.variables import Variable

STATUS_MEANINGS = "; ".join(f"{status.value} {status.name.lower()}" for status in Status)


class Per(Enum):
    """What a variable has one entry for, before its own dimensions."""

    TRAJECTORY = auto()
    """Every run of every controller whose trajectory is kept; the first of its dims is time."""
    DESIRED = auto()
    """The experiment, or the point of a sweep; the first of its dims is time."""
    INITIAL = auto()
    """Every initial state, which the controllers share."""
    RUN = auto()
    """Every run of every controller."""


@dataclass(frozen=True)
class Quantity:
    """One variable of a result.

    Attributes
    ----------
    dims
        Its dimensions beyond those that `per` stands for.
    dtype
        None for text.
    """

    name: str
    per: Per
    dims: tuple[str, ...]
    dtype: np.dtype[Any] | None
    attributes: dict[str, Any]


DESIRED = {"desired_pose": "pose", "desired_velocity": "velocity", "desired_torque": "torque"}
"""What is stored of the reference, and the signal that each is like."""

_FLOAT, _INT = np.dtype("f8"), np.dtype("i8")


def quantities(experiment: Experiment) -> list[Quantity]:
    """Every variable of a result, in the order of the file."""
    found = signals(experiment.group)
    return [*_over_time(found), *_initial(found), *_per_run(experiment, found)]


def _over_time(found: list[Signal]) -> Iterator[Quantity]:
    for signal in found:
        attributes = {"units": signal.units, "long_name": signal.long_name}
        yield Quantity(signal.name, Per.TRAJECTORY, ("time", *signal.dims), _FLOAT, attributes)
    by_name = {signal.name: signal for signal in found}
    for name, like in DESIRED.items():
        attributes = {
            "units": by_name[like].units,
            "long_name": name.replace("_", " ") + ", from a solve of its own",
        }
        yield Quantity(name, Per.DESIRED, ("time", *by_name[like].dims), _FLOAT, attributes)


def _initial(found: list[Signal]) -> Iterator[Quantity]:
    units = {signal.name: signal.units for signal in found}
    pose = "pose at the start, same for all controllers"
    for name, dims, like, long_name in (
        ("initial_pose", ("row", "col"), "pose", pose),
        ("initial_velocity", ("axis",), "velocity", "body velocity at the start"),
    ):
        attributes = {"units": units[like], "long_name": long_name}
        yield Quantity(name, Per.INITIAL, dims, _FLOAT, attributes)


def _per_run(experiment: Experiment, found: list[Signal]) -> Iterator[Quantity]:
    units = {signal.name: signal.units for signal in found}
    extra: dict[str, dict[str, Any]] = {
        "early_torque": {"window_s": EARLY_WINDOW},
        "settling_time": {"threshold": experiment.config.settling_threshold},
    }
    described: list[tuple[str, np.dtype[Any], str, str]] = [
        (metric.name, _FLOAT, unit_in(metric.units, units[metric.signal]), metric.long_name)
        for metric in METRICS
    ]
    described += [
        ("steps", _INT, "1", "work of the solver, as its engine counts it"),
        ("group_drift", _FLOAT, "1", "largest distance from the group"),
        ("energy_residual", _FLOAT, "1", "largest |L + W - L(0)| / max(L(0), 1 J)"),
        (
            "unstable_distance",
            _FLOAT,
            units["pose"],
            "smallest ||Q_E - Qc||_F, Qc critical points other than I",
        ),
        (
            "error_estimate",
            _FLOAT,
            "mixed",
            "largest max(||dQ||_F, ||dV||) against a tighter solve",
        ),
        (
            "reference_residual",
            _FLOAT,
            "mixed",
            "distance of the run's own reference to desired_pose, desired_velocity",
        ),
        ("status", np.dtype("i4"), "1", "end of the run"),
    ]
    extra["status"] = {"meanings": STATUS_MEANINGS}
    for name, dtype, unit, long_name in described:
        attributes = {"units": unit, "long_name": long_name, **extra.get(name, {})}
        yield Quantity(name, Per.RUN, (), dtype, attributes)
    yield Quantity("message", Per.RUN, (), None, {"long_name": "why the run failed"})


def coordinates(experiment: Experiment, kept: int) -> dict[str, Variable]:
    """What the positions along the dimensions mean; `kept` runs keep their trajectories."""

    def counted(dim: str, size: int, long_name: str) -> Variable:
        return Variable((dim,), np.arange(size), {"units": "1", "long_name": long_name})

    group, runs = experiment.group, experiment.config.ensemble.runs
    found = {
        "controller": Variable(
            ("controller",),
            np.array(list(experiment.loops), dtype=object),
            {"long_name": "control law"},
        ),
        "run": counted("run", runs, "run, with its own initial state"),
        "time": Variable(
            ("time",),
            experiment.times[:: experiment.config.store.decimate],
            {"units": "s", "long_name": "time"},
        ),
        "row": counted("row", group.size, "row of a pose matrix"),
        "col": counted("col", group.size, "column of a pose matrix"),
        "axis": Variable(
            ("axis",),
            np.array(group.axis_names, dtype=object),
            {"long_name": "algebra coordinate"},
        ),
    }
    if 0 < kept < runs:
        found["stored_run"] = counted("stored_run", kept, "run whose trajectory is stored")
    return found
