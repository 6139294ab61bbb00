"""Whether a study fits into this machine's memory and onto the disk, before it is begun."""

from __future__ import annotations

import os
import shutil
from math import prod
from pathlib import Path

from eqt_cli.core.errors import ConfigError, InputProblem
from eqt_cli.experiment.study import Study
from eqt_cli.results.quantities import Per, quantities
from eqt_cli.run.estimate import result_size

COPIES = 3
"""Of states and signals that a part holds at once at the least: 3 to 13 were measured."""


def check_room(study: Study, folder: Path) -> None:
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
    G, states = base.group, next(iter(base.loops.values())).state_length
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
