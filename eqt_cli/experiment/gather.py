"""The arrays of a result while its runs come in, and their meaning in the file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from eqt_cli.analysis.metrics import EARLY_WINDOW, METRICS
from eqt_cli.closed_loop.signals import signals
from eqt_cli.core.arrays import Array
from eqt_cli.engines import Solution, Status
from eqt_cli.experiment.build import Experiment
from eqt_cli.store.variables import Table, Variable

STATUS_MEANINGS = "; ".join(f"{status.value} {status.name.lower()}" for status in Status)


@dataclass(frozen=True)
class Chunk:
    """What became of some runs of one controller."""

    runs: slice
    solution: Solution
    signals: dict[str, Array]
    metrics: dict[str, Array]


class Gathered:
    """Everything that is kept of an experiment's runs.

    Trajectories of the runs that the `store` section asks for, and metrics of every run.
    """

    def __init__(self, experiment: Experiment) -> None:
        config, group = experiment.config, experiment.group
        self.experiment = experiment
        self.labels = list(experiment.loops)
        self.runs = config.ensemble.runs
        self.kept_runs = _kept(config.store.trajectories, self.runs)
        self.samples = slice(None, None, config.store.decimate)
        self.times = experiment.times[self.samples]
        self.sizes = {"row": group.size, "col": group.size, "axis": group.dimension}
        self.signals = signals(group)
        shape = (len(self.labels), self.kept_runs, len(self.times))
        self.trajectories = {
            signal.name: np.full((*shape, *(self.sizes[dim] for dim in signal.dims)), np.nan)
            for signal in self.signals
            if self.kept_runs
        }
        self.per_run: dict[str, Array] = {}
        self.status = np.zeros((len(self.labels), self.runs), dtype=np.int32)
        self.messages = np.full((len(self.labels), self.runs), "", dtype=object)

    def add(self, controller: int, chunk: Chunk) -> None:
        """Keep what is asked for of some runs of one controller."""
        kept = slice(chunk.runs.start, min(chunk.runs.stop, self.kept_runs))
        count = max(0, kept.stop - kept.start)
        for name, values in self.trajectories.items():
            if count:
                values[controller, kept] = chunk.signals[name][:count, self.samples]
        for name, found in chunk.metrics.items():
            if name not in self.per_run:
                shape = (len(self.labels), self.runs)
                self.per_run[name] = np.zeros(shape, dtype=found.dtype)
            self.per_run[name][controller, chunk.runs] = found
        self.status[controller, chunk.runs] = chunk.solution.status
        self.messages[controller, chunk.runs] = chunk.solution.messages

    def table(self, Q: Array, V: Array, desired: dict[str, Array]) -> Table:
        """Everything with its dimensions, units and long names, ready to be written."""
        return Table(
            {
                **self._trajectory_variables(),
                **self._desired_variables(desired),
                **self._initial_variables(Q, V),
                **self._run_variables(),
            },
            self._coordinates(),
        )

    def _trajectory_variables(self) -> dict[str, Variable]:
        # Some trajectories of many have a run dimension of their own, since `run` counts them all.
        run = "run" if self.kept_runs == self.runs else "stored_run"
        return {
            signal.name: Variable(
                ("controller", run, "time", *signal.dims),
                self.trajectories[signal.name],
                {"units": signal.units, "long_name": signal.long_name},
            )
            for signal in self.signals
            if signal.name in self.trajectories
        }

    def _desired_variables(self, desired: dict[str, Array]) -> dict[str, Variable]:
        by_name = {signal.name: signal for signal in self.signals}
        return {
            name: Variable(
                ("time", *by_name[name.removeprefix("desired_")].dims),
                values[self.samples],
                {
                    "units": by_name[name.removeprefix("desired_")].units,
                    "long_name": name.replace("_", " ") + ", from a solve of its own",
                },
            )
            for name, values in desired.items()
        }

    def _initial_variables(self, Q: Array, V: Array) -> dict[str, Variable]:
        units = {signal.name: signal.units for signal in self.signals}
        return {
            "initial_pose": Variable(
                ("run", "row", "col"),
                Q,
                {
                    "units": units["pose"],
                    "long_name": "pose at the start, same for all controllers",
                },
            ),
            "initial_velocity": Variable(
                ("run", "axis"),
                V,
                {"units": units["velocity"], "long_name": "body velocity at the start"},
            ),
        }

    def _run_variables(self) -> dict[str, Variable]:
        units = {signal.name: signal.units for signal in self.signals}
        described: dict[str, dict[str, Any]] = {
            metric.name: {
                "units": _in_units(metric.units, units[metric.signal]),
                "long_name": metric.long_name,
            }
            for metric in METRICS
        }
        described |= {
            "steps": {"units": "1", "long_name": "work of the solver, as its engine counts it"},
            "group_drift": {"units": "1", "long_name": "largest distance from the group"},
            "energy_residual": {
                "units": "1",
                "long_name": "largest |L + W - L(0)| / max(L(0), 1 J)",
            },
            "unstable_distance": {
                "units": units["pose"],
                "long_name": "smallest ||Q_E - Qc||_F, Qc critical points other than I",
            },
            "error_estimate": {
                "units": "mixed",
                "long_name": "largest max(||dQ||_F, ||dV||) against a tighter solve",
            },
        }
        described["reference_residual"] = {
            "units": "mixed",
            "long_name": "distance of the run's own reference to desired_pose, desired_velocity",
        }
        described["early_torque"]["window_s"] = EARLY_WINDOW
        described["settling_time"]["threshold"] = self.experiment.config.settling_threshold
        dims = ("controller", "run")
        run_variables = {
            name: Variable(dims, values, described[name]) for name, values in self.per_run.items()
        }
        status = {"units": "1", "long_name": "end of the run", "meanings": STATUS_MEANINGS}
        return {
            **run_variables,
            "status": Variable(dims, self.status, status),
            "message": Variable(dims, self.messages, {"long_name": "why the run failed"}),
        }

    def _coordinates(self) -> dict[str, Variable]:
        def counted(dim: str, size: int, long_name: str) -> Variable:
            return Variable((dim,), np.arange(size), {"units": "1", "long_name": long_name})

        coordinates = {
            "controller": Variable(
                ("controller",), np.array(self.labels, dtype=object), {"long_name": "control law"}
            ),
            "run": counted("run", self.runs, "run, with its own initial state"),
            "time": Variable(("time",), self.times, {"units": "s", "long_name": "time"}),
            "row": counted("row", self.sizes["row"], "row of a pose matrix"),
            "col": counted("col", self.sizes["col"], "column of a pose matrix"),
            "axis": Variable(
                ("axis",),
                np.array(self.experiment.group.axis_names, dtype=object),
                {"long_name": "algebra coordinate"},
            ),
        }
        if 0 < self.kept_runs < self.runs:
            coordinates["stored_run"] = counted(
                "stored_run", self.kept_runs, "run whose trajectory is stored"
            )
        return coordinates


def _kept(trajectories: str | int, runs: int) -> int:
    """How many runs of each controller keep their trajectories."""
    if isinstance(trajectories, int):
        return min(trajectories, runs)
    return runs if trajectories == "all" else 0


def _in_units(pattern: str, unit: str) -> str:
    return "mixed" if unit == "mixed" and "{}" in pattern else pattern.format(unit)
