"""Pre-flight of a study, after that of its experiments (`eqt_cli.config.preflight`, 1 to 4).

5. `check_resources`: its runs must not all be one, its largest part must fit into the memory, and
   its files on the disk.
6. `rehearse`: begins the study as a run would, with two runs of every law. What does so for a run
   puts them together and, for `config check`, solves them; no result is stored.
7. `estimate`: times the first part of some points, for `--dry-run`.
"""

import math
import os
import shutil
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import prod
from pathlib import Path

import numpy as np

from eqt_cli.base.arrays import Array, distinct, norm
from eqt_cli.base.errors import ConfigError, InputError, Problems
from eqt_cli.config.experiment import check_starts
from eqt_cli.config.preflight import TOGETHER, trial
from eqt_cli.config.remarks import check_steps
from eqt_cli.config.study import Study
from eqt_cli.engines.engine import Compiled, Problem
from eqt_cli.loop.closed_loop import parts_of
from eqt_cli.results.quantity import ValuePer
from eqt_cli.runs.batches import Batch, batches, by_kind
from eqt_cli.runs.compute_part import compute_part, shared_reference
from eqt_cli.runs.executors import Executor, TaskContext
from eqt_cli.runs.folder import bytes_of, coordinates, quantities

# Begins a study with two runs of every law --------------------------------------------------------


MOST_SECONDS = 3.0
"""Of one core, for all laws; those that are left then are named."""

ALONE = 1e-8
"""Relative: what the rates of a run may change by where others are beside it. Sums of another
length are rounded in another way, and differences of nearly equal numbers enlarge that, as does a
root near 0: they may also change as by such a change of all states."""


def rehearse(study: Study, *, solves: bool = False) -> list[str]:
    """Refuse a loop of which no run ends, and what fails in the first runs of laws together.

    That is an exception, a shape, or a plugin that mixes runs.

    Parameters
    ----------
    solves
        Whether to begin the runs of all laws, and not only where a part is the user's own. This
        finds also what gives no number, or cannot be compiled.

    Returns
    -------
    list of str
        The laws that were not tried since those before them took too long, in words.

    Raises
    ------
    ConfigError
        If there is one.
    """
    loops, problems = study.base.loops, Problems(study.base.document.place)
    check_steps(study.base, problems)
    problems.raise_if_any()
    if not (solves or any(part.is_foreign for loop in loops.values() for part in parts_of(loop))):
        return []
    started, left = time.process_time(), dict.fromkeys(loops)
    for group in _first_runs(study):
        if time.process_time() - started > MOST_SECONDS:
            break
        label, first = group[0]
        parts = parts_of(first.problem.loop, list(loops).index(label))
        with trial(parts, problems, TOGETHER) as tried:
            problem = Problem.joined([batch.problem for _, batch in group])
            rates = _rates(problem)
            if solves:
                for name, values in problem.loop.layout.split(rates).items():
                    if len(lost := values[~np.isfinite(values)]):
                        raise InputError(
                            f"{tried.name} gives no number at the start: the rate of "
                            f"{name.replace('_', ' ')} is {lost[0]:g}"
                        )
            if not getattr(problem.loop.controller, "in_order", False):  # whose states count
                _require_alone(problem, rates, tried.name)
            if solves:
                first.engine.rehearse(problem)
        for label, _ in group:
            left.pop(label, None)
    problems.raise_if_any()
    those = f"the laws before took more than {MOST_SECONDS:g} s"
    return [f"not tried: {', '.join(left)}; {those}"] if left else []


def _first_runs(study: Study) -> Iterator[list[tuple[str, Batch]]]:
    """Yield the first two runs of every law, and the first of the last point, by structure.

    So the numbers of a law come as ``(runs, 1)``, and two instances of a law are solved as one.
    """
    for index in sorted({0, len(study.shapes) - 1}):
        piece = study.piece(index)
        runs = piece.plan.runs
        yield from by_kind(piece, distinct([0, min(1, runs - 1), (len(piece) - 1) * runs]))


def _require_alone(problem: Problem, rates: Array, law: str) -> None:
    """Raise an `InputError` if a rate depends on other runs."""
    alone = [_rates(problem.select(slice(k, k + 1)))[0] for k in range(problem.runs)]
    change = norm(rates - np.array(alone))
    moved = ALONE * norm(problem.states)[:, None] * np.cos(np.arange(len(rates[0])))
    near = replace(problem, states=problem.states + moved)
    if (change > ALONE * (1 + norm(rates)) + norm(_rates(near) - rates)).any():
        raise InputError(
            f"{law} mixes runs: the rates of a run change by {change.max():.2g} when it is solved "
            "with others; sum over the last axis only, as the functions of eqt_cli.extend do"
        )


def _rates(problem: Problem) -> Array:
    """The vector field at the start, ``(runs, n)``, behind what a sampled law does there."""
    loop, states = problem.begun
    return loop.vector_field(float(problem.times[0]), states)


# Estimates the wall time of a study, its size on the disk, and the memory that it needs -----------


MOST_PIECES = 3
"""Largest number of pieces (points of one shape) whose runs are timed."""

PART_OVERHEAD = 5_000
"""Least overhead of the file of a part, bytes; 6 to 7 kB were measured."""

MOST_TIMED = 200
"""Largest number of points whose runs are timed; to build each takes some milliseconds."""

PROBE_SECONDS = 5.0
"""About the longest time that an estimate takes, besides compiling laws, s."""

FIRST_SHARE, GROWING = 1e-3, 8
"""Share of the horizon that is timed first, and by how much it grows."""

COPIES = 3
"""Least number of copies of states and signals in memory at once; 3 to 13 were measured."""


@dataclass(frozen=True)
class ExpectedCost:
    """Expected cost of a study.

    Attributes
    ----------
    seconds
        Wall time, s; None where a moment of the horizon took longer than the probe may.
    workers
        Number of workers.
    size
        Size of the result file, bytes.
    """

    seconds: float | None
    workers: int
    size: int


def estimate(study: Study, executor: Executor, most_seconds: float = PROBE_SECONDS) -> ExpectedCost:
    """Time the first part of some pieces without storing it, and extrapolate.

    Parameters
    ----------
    most_seconds
        About the longest time to take. If the whole horizon takes longer, its beginning is timed.
    """
    plans, count = study.plans, len(study.shapes)
    measured = sorted({k * (count - 1) // max(MOST_PIECES - 1, 1) for k in range(MOST_PIECES)})
    threads = executor.threads_for(len(plans)) if isinstance(study.base.engine, Compiled) else 1
    runs = sum(plans.plans[index].total for index in measured)
    share, parts, timed = most_seconds / len(measured), len(plans), 0.0
    size = result_size(study)
    for index in measured:
        per_run = _time_per_run(study.piece(index), threads, share)
        if per_run is None:
            return ExpectedCost(None, executor.at_once(parts, most_seconds) * threads, size)
        timed += per_run * plans.plans[index].total
    seconds = timed / runs * plans.total / parts
    at_once = executor.at_once(parts, seconds)
    return ExpectedCost(math.ceil(parts / max(at_once, 1)) * seconds, at_once * threads, size)


def _time_per_run(study: Study, threads: int, most_seconds: float) -> float | None:
    """Return the time per run of the first part, s; None if a moment of it takes too long.

    Longer and longer beginnings of the horizon are integrated; the whole part is computed only if
    there is time.
    """
    whole, label = study.plan.part(0), next(iter(study.base.loops))
    part = replace(whole, stop=min(whole.stop, MOST_TIMED * whole.runs))
    clock = time.process_time  # which does not count the compiler of laws
    ends, share = clock() + PROBE_SECONDS, FIRST_SHARE

    def within(runs: float) -> None:
        if clock() > ends:
            raise TimeoutError

    def solve() -> float:
        started = time.monotonic()
        for batch in problems:
            beginning = batch.problem.times[0] + [0.0, share * np.ptp(batch.problem.times)]
            batch.engine.solve(replace(batch.problem, times=beginning), threads, within)
        return time.monotonic() - started

    solves, seconds, before, earlier = 1 + study.base.solver.estimates_errors, None, 0.0, 0.0
    try:
        problems = list(batches(study, label, np.arange(part.start, part.stop)))
        solve()  # compiles laws, which is not timed
        clock, ends = time.monotonic, time.monotonic() + most_seconds
        while True:
            took = solve()
            # The difference leaves out what every solve takes at its start. So there are two, but
            # for a second of over 4 times the first: then the first is right within a factor 2.4.
            rate = max(took - earlier, 0.0) / (share - before)
            seconds = solves * (took + (1 - share) * rate)
            ends = ends if before else max(ends, clock() + 4 * took)
            if share == 1.0 or (before and clock() + took + (GROWING - 1) * share * rate > ends):
                break
            share, before, earlier = min(1.0, GROWING * share), share, took
        if clock() + 2 * seconds <= ends:
            shared = None if study.desired_varies else shared_reference(study)
            for _ in range(2):  # twice, because the first time may include a compilation
                started = time.monotonic()
                compute_part(study, part, shared, TaskContext(within, threads))
                seconds = time.monotonic() - started
    except TimeoutError:
        pass
    return None if seconds is None else seconds / len(part)


def result_size(study: Study) -> int:
    """Return the size of the variables of the result files, bytes."""
    total = sum(map(bytes_of, study.pieces))
    if study.is_ragged:  # whose numbers per run are in two files
        total += sum(bytes_of(piece, ValuePer.RUN) for piece in study.pieces)
    return total


def parts_size(study: Study) -> int:
    """Return the size of the files of all parts, which exist until the result is packed, bytes."""
    total = 0
    for piece in study.pieces:
        base = piece.base
        redone = min(base.solver.judgement.cross_check, piece.plan.entries)
        numbers = sum(loop.state_length for loop in base.loops.values())
        states = redone * base.config.time.samples * numbers
        total += bytes_of(piece) + 8 * states + PART_OVERHEAD * len(piece.plan)
    return total


def check_resources(study: Study, folder: Path, missing: float = 1.0) -> None:
    """Check that runs differ, and that the study fits into the memory and on the disk.

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
    problems = Problems(study.base.document.place)
    for piece in study.pieces:
        check_starts(piece.base, problems)
    problems.raise_if_any()
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
    needed = max(map(_part_memory, study.pieces))
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
    vehicle = base.loop.vehicle
    sizes = {dim: along.size for dim, along in coordinates(base, 1).items()} | {"time": 1}
    signals = sum(
        prod(sizes.get(dim, 0) for dim in entry.dims)
        for entry in quantities(base, study.vehicles)
        if entry.per is ValuePer.TRAJECTORY
    )
    runs = len(plan.part(0))
    errors = 0
    if vehicle.control is not None and vehicle.measures:
        instants = base.config.time.duration / vehicle.control.tick
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
    raise ConfigError([study.document.problem(path, message)])
