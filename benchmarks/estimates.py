"""What an estimator costs: CPU time of a run and of an instant, by kind, engine and vehicle."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.cases import CONFIGS
from benchmarks.measure import fastest
from eqt_cli.components.estimators import estimators
from eqt_cli.config.document import read_config
from eqt_cli.config.study import study
from eqt_cli.engines.choice import unavailable
from eqt_cli.engines.engine import engines
from eqt_cli.runs.batches import batches

CASES = ("satellite_estimated", "se3_bluerov2_estimated")
"""On SO(3) and SE(3)."""

LAW = "lee2010"
RUNS = {"native": 32, "solve_ivp": 32}
"""Runs by which each engine is timed."""

NONE = "none"
"""Where the law reads the measurements."""


@dataclass(frozen=True)
class EstimatorTime:
    """One kind of estimator under one engine, compiled before.

    Attributes
    ----------
    cpu
        Of a run, the least of several, s.
    instants
        Of a run, at which the law is evaluated.
    """

    case: str
    engine: str
    kind: str
    cpu: float
    instants: int
    runs: int

    @property
    def microseconds(self) -> float:
        """Per instant."""
        return 1e6 * self.cpu / self.instants


def estimator_times(repeats: int = 3, runs: int | None = None) -> Iterator[EstimatorTime]:
    """Every kind under every engine that is here, on every case."""
    for case in CASES:
        for engine, count in RUNS.items():
            if unavailable(engines.get(engine)) is not None:
                continue
            for kind in (NONE, *estimators.names()):
                own = "null" if kind == NONE else f"{{kind: {kind}}}"
                overrides = ["tune=null", f"estimator={own}", f"solver.engine={engine}"]
                found = study(read_config(CONFIGS / f"{case}.yaml", overrides))
                [batch] = batches(found, LAW, np.arange(runs or count))
                solve, problem = batch.engine.solve, batch.problem
                solve(problem.select(slice(0, 1)))  # compiles
                _, _, cpu, _ = fastest(lambda solve=solve, problem=problem: solve(problem), repeats)
                yield EstimatorTime(
                    case, engine, kind, cpu / problem.runs, problem.control_instants, problem.runs
                )
