"""Certificates of an experiment: of a configuration by a few runs, of a result by what it holds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from eqt_cli.analysis.certificates import (
    Row,
    Runs,
    Setting,
    Verdict,
    hypothesis_rows,
    identity_rows,
    sampled,
    trajectory_rows,
)
from eqt_cli.closed_loop import ClosedLoop, ErrorSystem
from eqt_cli.closed_loop.signals import compute
from eqt_cli.config.source import source_of
from eqt_cli.controllers.eqt import EqT
from eqt_cli.core.arrays import Array
from eqt_cli.core.blame import blamed
from eqt_cli.engines import Engine, Problem, Solution
from eqt_cli.ensemble.initial import draw_initial_states
from eqt_cli.ensemble.seeds import Stream, generator
from eqt_cli.experiment.build import Experiment, build
from eqt_cli.mechanics.semidirect import Semidirect
from eqt_cli.results.metrics import energy_residual
from eqt_cli.store.reader import Results

Progress = Callable[[float], None]

RUNS = 20
"""Runs per controller that a configuration is judged by, unless it has fewer."""

ERROR_SYSTEM_RUNS = 3
"""Runs per controller whose error system is integrated by itself."""


@dataclass(frozen=True)
class Verification:
    """What was found.

    Attributes
    ----------
    rows
        Identities, trajectories, hypotheses, each in the paper's order.
    runs, failed_runs
        Over all controllers.
    """

    rows: list[Row]
    runs: int
    failed_runs: int

    @property
    def failures(self) -> list[Row]:
        """The rows that refute a statement."""
        return [row for row in self.rows if row.verdict is Verdict.FAILS]


@blamed()
def verify_experiment(
    experiment: Experiment,
    runs: int = RUNS,
    progress: Progress = lambda runs: None,
    workers: int = 1,
) -> Verification:
    """Check every certificate, the trajectories on the first `runs` runs of each controller."""
    with threadpool_limits(1):
        return _Verifier(experiment, progress, workers).of_new_runs(runs)


@blamed()
def verify_stored(results: Results, *, trust_plugins: bool, workers: int = 1) -> Verification:
    """As `verify_results`, of the experiment that the result says it is.

    Raises
    ------
    EqtError
        If it cannot be built, as without its plugins.
    """
    experiment = build(source_of(results), trust_plugins=trust_plugins)
    return verify_results(experiment, results, workers)


def verify_results(experiment: Experiment, results: Results, workers: int = 1) -> Verification:
    """Check every certificate of the experiment, or the point, that a result holds.

    Trajectories are those that are stored.

    Raises
    ------
    EqtError
        If the result is a sweep's.
    """
    results.single("one experiment is verified")
    with threadpool_limits(1):
        return _Verifier(experiment, lambda runs: None, workers).of_stored_runs(results)


class _Verifier:
    def __init__(self, experiment: Experiment, progress: Progress, workers: int) -> None:
        self.experiment, self.progress, self.workers = experiment, progress, workers
        self.times = experiment.times

    def of_new_runs(self, most: int) -> Verification:
        count = min(most, self.experiment.config.ensemble.runs)
        engine = self._engine(count)
        runs = []
        for label, loop in self.experiment.loops.items():
            problem = self._problem(loop, count)
            solution = engine.solve(problem, self.progress, self.workers)
            runs.append(self._measured(label, loop, problem, solution, engine))
        Qd, Vd = self._desired(engine)
        return self._verification(runs, Qd, Vd)

    def of_stored_runs(self, results: Results) -> Verification:
        engine = self._engine(ERROR_SYSTEM_RUNS)
        runs = [
            self._stored(results, index, label, engine)
            for index, label in enumerate(self.experiment.loops)
        ]
        if results.has("desired_pose"):
            Qd, Vd = results["desired_pose"], results["desired_velocity"]
        else:  # of a sweep that keeps metrics only
            Qd, Vd = self._desired(engine)
        return self._verification(runs, Qd, Vd)

    def _verification(self, runs: list[Runs], Qd: Array, Vd: Array) -> Verification:
        loops = self.experiment.loops
        horizon = float(self.times[-1])
        finite = np.isfinite(Qd).all(axis=(-2, -1)) & np.isfinite(Vd).all(axis=-1)
        times = np.linspace(0.0, horizon, len(Qd))[finite]
        seed = self.experiment.config.ensemble.seed
        any_loop = replace(next(iter(loops.values())), controller=EqT())
        common = sampled("", any_loop, horizon, generator(seed, Stream.CERTIFICATES, 0))
        samples = [
            sampled(
                label,
                loop,
                horizon,
                generator(seed, Stream.CERTIFICATES, index),
                at_rest="track" not in loop.controller.tasks,
            )
            for index, (label, loop) in enumerate(loops.items(), start=1)
        ]
        rows = [
            *identity_rows(common, samples),
            *trajectory_rows(runs),
            *hypothesis_rows(Setting(loops, times, Qd[finite], Vd[finite])),
        ]
        failed = sum(each.failed for each in runs)
        return Verification(rows, sum(each.count for each in runs) + failed, failed)

    def _measured(
        self, label: str, loop: ClosedLoop, problem: Problem, solution: Solution, engine: Engine
    ) -> Runs:
        good = solution.status == 0
        states = solution.states[good]
        few = min(ERROR_SYSTEM_RUNS, len(states))
        return Runs(
            label=label,
            claims_decrease=loop.claims_decrease,
            rtol=engine.rtol,
            threshold=self.experiment.config.settling_threshold,
            times=self.times,
            **self._signals(loop, states),
            error_system=self._error_system(loop, states[:few], engine),
            failed=int(np.count_nonzero(~good)),
        )

    def _signals(self, loop: ClosedLoop, states: Array) -> dict[str, Array]:
        """What is judged of the good runs; where there are none, no law is asked."""
        if not len(states):
            names = ("energy_residual", "group_drift", "final_pose_error", "final_velocity_error")
            none = {name: np.empty(0) for name in names}
            return none | {"lyapunov": np.empty((0, len(self.times)))}
        signals = compute(loop, self.times, states)
        L = signals["lyapunov"]
        return {
            "lyapunov": L,
            "energy_residual": energy_residual(L, signals["energy_balance"]),
            "group_drift": loop.group.drift(signals["pose"]).max(axis=-1),
            "final_pose_error": signals["pose_error"][:, -1],
            "final_velocity_error": signals["velocity_error"][:, -1],
        }

    def _stored(self, results: Results, index: int, label: str, engine: Engine) -> Runs:
        loop = self.experiment.loops[label]
        good = results.read("status", controller=index) == 0
        problem = self._problem(loop, min(ERROR_SYSTEM_RUNS, len(good)))
        again = engine.solve(problem, self.progress, self.workers)
        metrics = {
            name: results.read(name, controller=index)[good]
            for name in (
                "energy_residual",
                "group_drift",
                "final_pose_error",
                "final_velocity_error",
            )
        }
        L = None
        if results.has("lyapunov"):
            kept = results.read("lyapunov", controller=index)
            L = kept[good[: len(kept)]]
        return Runs(
            label=label,
            claims_decrease=loop.claims_decrease,
            rtol=engine.rtol,
            threshold=self.experiment.config.settling_threshold,
            times=results["time"],
            lyapunov=L,
            **metrics,
            error_system=self._error_system(loop, again.states[again.status == 0], engine),
            failed=int(np.count_nonzero(~good)),
        )

    def _error_system(self, loop: ClosedLoop, states: Array, engine: Engine) -> float | None:
        """The largest difference of E, integrated by itself, to that of the closed loop."""
        if not len(states):
            return None
        system = ErrorSystem.of(loop)
        problem = Problem(system, system.state_from(states[:, 0], 0.0), self.times)
        solution = engine.solve(problem, lambda runs: None, self.workers)
        s = loop.tracking(self.times, states)
        expected = Semidirect(loop.group).error((s.Q, s.P), (s.Qd, s.Pd))
        with np.errstate(all="ignore"):
            return max(
                float(np.abs(one - other).max() / max(1.0, np.abs(other).max()))
                for one, other in zip(system.error(solution.states), expected, strict=True)
            )

    def _desired(self, engine: Engine) -> tuple[Array, Array]:
        """The reference by itself: a closed loop that starts on it and stays there."""
        loop = replace(next(iter(self.experiment.loops.values())), controller=EqT())
        Qd, Vd = self.experiment.initial_pose[None], self.experiment.initial_velocity[None]
        problem = Problem(loop, loop.initial_state(Qd, Vd, Qd, Vd), self.times)
        s = loop.tracking(self.times, engine.solve(problem, lambda runs: None).states[0])
        return s.Qd, s.Vd

    def _problem(self, loop: ClosedLoop, runs: int) -> Problem:
        experiment = self.experiment
        Q, V = draw_initial_states(
            experiment.group,
            experiment.poses,
            experiment.velocities,
            Qd=experiment.initial_pose,
            Vd=experiment.initial_velocity,
            seed=experiment.config.ensemble.seed,
            runs=range(runs),
        )
        Qd, Vd = experiment.initial_pose, experiment.initial_velocity
        return Problem(loop, loop.initial_state(Q, V, Qd, Vd), self.times)

    def _engine(self, runs: int) -> Engine:
        loop = next(iter(self.experiment.loops.values()))
        total = runs * len(self.experiment.loops)
        return self.experiment.engine.sized(total, loop.state_length)
