"""What a study costs: the time that it takes, its size on the disk, and the memory it needs."""

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
"""Of points that differ in shape, so many are measured."""

PART_OVERHEAD = 10_000
"""Bytes of the file of a part beside its arrays, at the least: 10 to 18 kB were measured."""

COMPILING = 5.0
"""s, that the compilation of a law takes at the most."""

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
    """How long a run of the first part takes, s; computed twice, unless that takes long."""
    shared = None if study.desired_varies else shared_reference(study)
    seconds = 0.0
    for _ in range(2):  # the first time may include a compilation
        started = time.perf_counter()
        compute_part(study, study.plan.part(0), shared, TaskContext(lambda runs: None, threads))
        seconds = time.perf_counter() - started
        if seconds > COMPILING:
            break
    return seconds / len(study.plan.part(0))


def result_size(study: Study) -> int:
    """Bytes of the variables of the result file."""
    layouts = [Layout(study.piece(index)) for index in range(len(study.shapes))]
    if not study.is_ragged:
        return layouts[0].size(layouts[0].blanks())
    return sum(
        layout.size(layout.blanks(layout.of(ValuePer.RUN)))
        + len(layout.study) * layout.size(layout.blanks(single=True))
        for layout in layouts
    )


def parts_size(study: Study) -> int:
    """Bytes of the files of all parts, which stay until the result file is written."""
    return sum(_of_all_parts(study.piece(index)) for index in range(len(study.shapes)))


def _of_all_parts(study: Study) -> int:
    layout, base = Layout(study), study.base
    samples = base.config.time.samples
    redone = min(base.solver.judgement.cross_check, study.plan.entries)
    states = redone * samples * sum(loop.state_length for loop in base.loops.values())
    return layout.size(layout.blanks()) + 8 * states + PART_OVERHEAD * len(study.plan)


def check_resources(study: Study, folder: Path, missing: float = 1.0) -> None:
    """Refuse what cannot fit.

    Parameters
    ----------
    folder
        Where the result is to be; it may not be there yet.
    missing
        The share of the runs that are not in the folder yet.

    Raises
    ------
    ConfigError
        With the key to change, what is needed, and what there is.
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
            f"a part of the runs takes at least {size(needed)} of memory at once, and this "
            f"machine has {size(there)}; take fewer samples",
        )


def _of_a_part(study: Study) -> int:
    """Bytes of the states, signals and errors of measurement of the largest part."""
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
    told = 0
    if vehicle.control is not None and vehicle.measures:
        instants = base.config.time.duration / vehicle.control.period
        told = int(8 * runs * instants * (G.size**2 + G.dimension))
    return COPIES * 8 * runs * base.config.time.samples * (states + signals) + told


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


def size(count: float) -> str:
    """A number of bytes in the unit that suits it."""
    for unit in ("B", "kB", "MB", "GB"):
        if count < 1000:
            return f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.3g} TB"


def _refuse(study: Study, path: tuple[str, ...], message: str) -> None:
    raise ConfigError([InputProblem(".".join(path), message, study.source.place(path))])
