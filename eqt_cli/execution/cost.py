"""What a study costs: the time that it takes, its size on the disk, and the memory it needs."""

from __future__ import annotations

import os
import shutil
import time
from dataclasses import dataclass
from math import prod
from pathlib import Path

from eqt_cli.core.errors import ConfigError, InputProblem
from eqt_cli.execution.compute import REFERENCE_STATES, compute_part, reference_table
from eqt_cli.execution.executors import Executor, TaskContext
from eqt_cli.execution.result_layout import Layout
from eqt_cli.experiment.study import Study
from eqt_cli.results.quantities import coordinates, quantities
from eqt_cli.results.quantity import Per

MOST_PIECES = 5
"""Of points that differ in shape, so many are measured."""

TEXT_BYTES = 16
"""Of a reference to a string in HDF5."""

COPIES = 3
"""Of states and signals that a part holds at once at the least: 3 to 13 were measured."""


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
        compute_part(study, study.plan.part(0), shared, TaskContext(threads=threads))
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
    layout, plan = Layout(study), study.plan
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
            for entry in layout.of(per)
        )
        for per in Per
    }


def check_resources(study: Study, folder: Path) -> None:
    """Refuse what cannot fit.

    Parameters
    ----------
    folder
        Where the result is to be; it may not be there yet.

    Raises
    ------
    ConfigError
        With the key to change, what is needed, and what there is.
    """
    check_memory(study)
    needed, free = result_size(study), _free_disk(folder)
    if needed > free:
        _refuse(
            study,
            ("ensemble", "runs"),
            f"the result takes {_size(needed)} on the disk, and {folder} has {_size(free)} left; "
            "take fewer runs, fewer samples, or store.trajectories: none",
        )


def check_memory(study: Study) -> None:
    """Refuse a study of which a single part does not fit into the memory.

    Raises
    ------
    ConfigError
        With the key to change, what is needed, and what there is.
    """
    there = _memory()
    pieces = (study.piece(index) for index in range(len(study.shapes)))
    needed = max(_of_a_part(piece) for piece in pieces)
    if there is not None and needed > there:
        _refuse(
            study,
            ("time", "samples"),
            f"a part of the runs takes at least {_size(needed)} of memory at once, and this "
            f"machine has {_size(there)}; take fewer samples",
        )


def _of_a_part(study: Study) -> int:
    """Bytes of the states and signals of the largest part."""
    base, plan = study.base, study.plan
    G, states = base.group, max(loop.state_length for loop in base.loops.values())
    sizes = {"axis": G.dimension, "row": G.size, "col": G.size}
    signals = sum(
        prod(sizes.get(dim, 1) for dim in entry.dims)
        for entry in quantities(base)
        if entry.per is Per.TRAJECTORY
    )
    runs = len(plan.part(0))
    return COPIES * 8 * runs * base.config.time.samples * (states + signals)


def _memory() -> int | None:
    """Bytes of this machine's memory; None where that is not known."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return None


def _free_disk(folder: Path) -> int:
    """Bytes left where a folder is, or will be."""
    there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    return shutil.disk_usage(there).free


def _size(size: int) -> str:
    unit, divisor = ("TB", 10**12) if size >= 10**12 else ("GB", 10**9)
    return f"{size / divisor:.3g} {unit}"


def _refuse(study: Study, path: tuple[str, ...], message: str) -> None:
    raise ConfigError([InputProblem(".".join(path), message, study.source.place(path))])
