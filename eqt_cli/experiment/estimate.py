"""What a study will cost: the time that its first part takes, and the size of its file."""

from __future__ import annotations

import time
from dataclasses import dataclass
from math import prod

from eqt_cli.ensemble.executors import Executor, Ways
from eqt_cli.experiment.compute import REFERENCE_STATES, compute_part, reference_table
from eqt_cli.experiment.describe import Per, coordinates, quantities
from eqt_cli.experiment.study import Study

TEXT_BYTES = 16
"""Of a reference to a string in HDF5."""


@dataclass(frozen=True)
class Estimate:
    """Expected cost.

    Attributes
    ----------
    seconds
        Wall time, s.
    size
        Of the result file, bytes.
    """

    seconds: float
    size: int


def estimate(study: Study, executor: Executor) -> Estimate:
    """Compute the first part, twice if it is quick, without keeping it, and scale."""
    shared = None
    if not study.desired_varies:
        shared = reference_table(study).variables[REFERENCE_STATES].data[0]
    seconds = 0.0
    for _ in range(2):  # the first time may include a compilation
        started = time.perf_counter()
        compute_part(study, study.plan.part(0), shared, Ways())
        seconds = time.perf_counter() - started
        if seconds > 1.0:
            break
    parts = len(study.plan)
    return Estimate(seconds * parts / min(executor.workers, parts), result_size(study))


def result_size(study: Study) -> int:
    """Bytes of the variables of the result file."""
    plan, points = study.plan, len(study)
    found = coordinates(study.base, study.kept)
    sizes = {name: len(variable.data) for name, variable in found.items()}
    desired = (points if study.desired_varies else 1) if study.keeps_desired else 0
    leading = {
        Per.RUN: plan.total,
        Per.TRAJECTORY: points * study.kept * plan.controllers,
        Per.INITIAL: plan.entries if study.initial_varies else plan.runs,
        Per.DESIRED: desired,
    }
    return sum(
        leading[entry.per]
        * prod(sizes[dim] for dim in entry.dims)
        * (entry.dtype.itemsize if entry.dtype else TEXT_BYTES)
        for entry in quantities(study.base)
    )
