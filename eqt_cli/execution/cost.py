"""Estimates the wall time of a study, its size on the disk, and the memory that it needs."""

import os
import shutil
import time
from dataclasses import dataclass
from math import prod
from pathlib import Path

from eqt_cli.closed_loop.signals import THRUSTER
from eqt_cli.core.errors import ConfigError, InputProblem
from eqt_cli.execution.compute_part import compute_part, shared_reference
from eqt_cli.execution.executors import Executor, TaskContext
from eqt_cli.execution.result_layout import Layout
from eqt_cli.experiment.study import Study
from eqt_cli.results.quantity import ValuePer
from eqt_cli.results.quantity_table import quantities

MOST_PIECES = 5
"""Largest number of pieces (points of one shape) whose runs are timed."""

PART_OVERHEAD = 10_000
"""Least overhead of the file of a part, bytes; 10 to 18 kB were measured."""

COMPILE_SECONDS = 5.0
"""Longest expected time to compile a law, s."""

COPIES = 3
"""Least number of copies of states and signals in memory at once; 3 to 13 were measured."""


@dataclass(frozen=True)
class Estimate:
    """Expected cost of a study.

    Attributes
    ----------
    seconds
        Wall time, s.
    workers
        Number of workers.
    size
        Size of the result file, bytes.
    """

    seconds: float
    workers: int
    size: int


def estimate(study: Study, executor: Executor) -> Estimate:
    """Time the first part of some pieces without storing it, and extrapolate."""
    plans, count = study.plans, len(study.shapes)
    measured = sorted({k * (count - 1) // max(MOST_PIECES - 1, 1) for k in range(MOST_PIECES)})
    threads = executor.threads_for(len(plans)) if study.base.engine.threads else 1
    runs = sum(plans.plans[index].total for index in measured)
    seconds = sum(_time_per_run(study.piece(k), threads) * plans.plans[k].total for k in measured)
    parts, each = len(plans), seconds / runs * plans.total / len(plans)
    workers = executor.at_once(parts, each) * threads
    return Estimate(executor.wall_time(parts, each), workers, result_size(study))


def _time_per_run(study: Study, threads: int) -> float:
    """Return the time per run of the first part, s."""
    shared = None if study.desired_varies else shared_reference(study)
    seconds = 0.0
    for _ in range(2):  # twice, because the first time may include a compilation
        started = time.perf_counter()
        compute_part(study, study.plan.part(0), shared, TaskContext(lambda runs: None, threads))
        seconds = time.perf_counter() - started
        if seconds > COMPILE_SECONDS:
            break
    return seconds / len(study.plan.part(0))


def result_size(study: Study) -> int:
    """Return the size of the variables of the result file, bytes."""
    layouts = [Layout(study.piece(index)) for index in range(len(study.shapes))]
    if not study.is_ragged:
        return layouts[0].size(layouts[0].blanks())
    return sum(
        layout.size(layout.blanks(layout.of(ValuePer.RUN)))
        + len(layout.study) * layout.size(layout.blanks(single=True))
        for layout in layouts
    )


def parts_size(study: Study) -> int:
    """Return the size of the files of all parts, which exist until the result is packed, bytes."""
    return sum(_parts_bytes(study.piece(index)) for index in range(len(study.shapes)))


def _parts_bytes(study: Study) -> int:
    layout, base = Layout(study), study.base
    samples = base.config.time.samples
    redone = min(base.solver.judgement.cross_check, study.plan.entries)
    states = redone * samples * sum(loop.state_length for loop in base.loops.values())
    return layout.size(layout.blanks()) + 8 * states + PART_OVERHEAD * len(study.plan)


def check_resources(study: Study, folder: Path, missing: float = 1.0) -> None:
    """Check that the study fits into the memory and on the disk.

    Parameters
    ----------
    folder
        The result folder, which need not exist yet.
    missing
        Share of the runs that are still to be computed.

    Raises
    ------
    ConfigError
        With the key to change, the required size and the available size.
    """
    check_memory(study)
    result, parts = result_size(study), parts_size(study) * missing
    needed, free = result + parts, _free_disk(folder)
    if needed > free:
        _refuse(
            study,
            ("ensemble", "runs"),
            f"{size(needed)} are needed on the disk ({size(result)} for the result, {size(parts)} "
            f"for the parts from which it is packed), and {folder} has {size(free)} left; "
            "take fewer runs, fewer samples, or store.trajectories: none",
        )


def check_memory(study: Study) -> None:
    """Check that the largest part of a study fits into the memory.

    Raises
    ------
    ConfigError
        With the key to change, the required size and the available size.
    """
    memory = _memory()
    pieces = (study.piece(index) for index in range(len(study.shapes)))
    needed = max(_part_memory(piece) for piece in pieces)
    if memory is not None and needed > memory:
        _refuse(
            study,
            ("time", "samples"),
            f"a part of the runs takes at least {size(needed)} of memory at once, and this "
            f"machine has {size(memory)}; take fewer samples",
        )


def _part_memory(study: Study) -> int:
    """Return the bytes of the states, signals and measurement errors of the largest part."""
    base, plan = study.base, study.plan
    G, states = base.group, max(loop.state_length for loop in base.loops.values())
    vehicle = next(iter(base.loops.values())).vehicle
    thrusters = len(vehicle.thruster_names)
    sizes = {"axis": G.dimension, "row": G.size, "col": G.size, THRUSTER: thrusters}
    signals = sum(
        prod(sizes.get(dim, 1) for dim in entry.dims)
        for entry in quantities(base, study.vehicles)
        if entry.per is ValuePer.TRAJECTORY
    )
    runs = len(plan.part(0))
    errors = 0
    if vehicle.control is not None and vehicle.measures:
        instants = base.config.time.duration / vehicle.control.period
        errors = int(8 * runs * instants * (G.size**2 + G.dimension))
    return COPIES * 8 * runs * base.config.time.samples * (states + signals) + errors


def _memory() -> int | None:
    """Return the bytes of this machine's memory; None if unknown."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return None


def _free_disk(folder: Path) -> int:
    """Return the free bytes on the disk of a folder that need not exist yet."""
    existing = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    return shutil.disk_usage(existing).free


def size(count: float) -> str:
    """Format a number of bytes in a suitable unit."""
    for unit in ("B", "kB", "MB", "GB"):
        if count < 1000:
            return f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.3g} TB"


def _refuse(study: Study, path: tuple[str, ...], message: str) -> None:
    raise ConfigError([InputProblem(".".join(path), message, study.source.place(path))])
