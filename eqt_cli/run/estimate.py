"""What a study will cost: the time that its first part takes, and the size of its file."""

from __future__ import annotations

import time
from dataclasses import dataclass
from math import prod

from eqt_cli.experiment.study import Study
from eqt_cli.results.quantities import coordinates
from eqt_cli.results.quantity import Per
from eqt_cli.run.compute import REFERENCE_STATES, compute_part, reference_table
from eqt_cli.run.executors import Executor, Ways
from eqt_cli.run.frame import Form

MOST_PIECES = 5
"""Of points that differ in shape, so many are measured."""

TEXT_BYTES = 16
"""Of a reference to a string in HDF5."""


@dataclass(frozen=True)
class Estimate:
    """Expected cost.

    Attributes
    ----------
    seconds
        Wall time, s.
    workers
        How many of them will be at work.
    size
        Of the result file, bytes.
    """

    seconds: float
    workers: int
    size: int


def estimate(study: Study, executor: Executor) -> Estimate:
    """Compute the first part of a piece, without keeping it, and scale; of some pieces."""
    plans, count = study.plans, len(study.shapes)
    measured = sorted({k * (count - 1) // max(MOST_PIECES - 1, 1) for k in range(MOST_PIECES)})
    threads = executor.threads_for(len(plans)) if study.base.engine.threads else 1
    runs = sum(plans.plans[index].total for index in measured)
    seconds = sum(_run(study.piece(k), threads) * plans.plans[k].total for k in measured)
    parts, each = len(plans), seconds / runs * plans.total / len(plans)
    workers = executor.at_once(parts, each) * threads
    return Estimate(executor.wall_time(parts, each), workers, result_size(study))


def _run(study: Study, threads: int) -> float:
    """How long a run of the first part takes, s; computed twice if that is quick."""
    shared = None
    if not study.desired_varies:
        shared = reference_table(study).variables[REFERENCE_STATES].data[0]
    seconds = 0.0
    for _ in range(2):  # the first time may include a compilation
        started = time.perf_counter()
        compute_part(study, study.plan.part(0), shared, Ways(threads=threads))
        seconds = time.perf_counter() - started
        if seconds > 1.0:
            break
    return seconds / len(study.plan.part(0))


def result_size(study: Study) -> int:
    """Bytes of the variables of the result file."""
    if not study.is_ragged:
        return sum(_sizes(study, single=False).values())
    pieces = [study.piece(index) for index in range(len(study.shapes))]
    within = sum(sum(_sizes(piece, single=True).values()) * len(piece) for piece in pieces)
    return within + sum(_sizes(piece, single=False)[Per.RUN] for piece in pieces)


def _sizes(study: Study, *, single: bool) -> dict[Per, int]:
    """Bytes of each kind of variable; of a `single` point, which has all of its own, or of all."""
    form, plan = Form(study), study.plan
    found = coordinates(study.base, study.kept)
    sizes = {name: len(variable.data) for name, variable in found.items()}
    points = 1 if single else len(study)
    leading = {
        Per.RUN: points * plan.runs * plan.controllers,
        Per.TRAJECTORY: points * study.kept * plan.controllers,
        Per.INITIAL: (points if study.initial_varies else 1) * plan.runs,
        Per.DESIRED: points if study.desired_varies else 1,
    }
    return {
        per: sum(
            leading[per]
            * prod(sizes[dim] for dim in entry.dims)
            * (entry.dtype.itemsize if entry.dtype else TEXT_BYTES)
            for entry in form.of(per)
        )
        for per in Per
    }
