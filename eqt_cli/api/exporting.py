"""Exports laws as C files into a folder."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from eqt_cli.analysis.evidence.program_error import ARITHMETICS
from eqt_cli.api.loading import Configuration, experiment_at
from eqt_cli.core.errors import EqtError
from eqt_cli.core.files import check_targets, write_all
from eqt_cli.experiment.study import Study
from eqt_cli.exporting.files import files
from eqt_cli.exporting.laws import ExportedLaw, exported
from eqt_cli.exporting.readme import NAME, Footprint, measured, readme


@dataclass(frozen=True)
class ExportedFiles:
    """The files of an export.

    Attributes
    ----------
    folder
        Output folder.
    files
        Names of the files.
    laws
        A record for each law: ``label``, ``name``, ``real``, number of ``operations``, number of
        checked ``states``, error ``bound`` of each torque, number of ``singular`` states and the
        ``singular_bound`` of each torque there, and bytes of ``flash`` and ``stack`` on a
        Cortex-M4, which are None if no compiler was found.
    """

    folder: Path
    files: list[str]
    laws: list[dict[str, object]]


def export(
    target: Study | Configuration,
    out: str | os.PathLike[str] | None = None,
    *,
    controllers: str | Sequence[str] = (),
    real: Literal["double", "float"] = "double",
    reference: bool = False,
    point: int | None = None,
    trust_plugins: bool = False,
    workers: int = 1,
) -> ExportedFiles:
    """Export control laws as C code for a vehicle: header, source, a test program and a README.

    Parameters
    ----------
    target
        A `Study` from `load_experiment`, or a configuration as `load_experiment` takes it.
    out
        Output folder. Default: ``exported/NAME``.
    controllers
        Labels of the laws; all if empty.
    real
        Type of all numbers in C.
    reference
        Whether to export the reference too, which must be in closed form.
    point
        Point of a sweep, counted from 0. Default: the first.
    trust_plugins
        Whether to execute plugin sources that are stored in a result file.
    workers
        Number of cores for the runs that provide states for the checks.

    Returns
    -------
    ExportedFiles
        The written files, with operation counts, error bounds and sizes.

    Raises
    ------
    EqtError
        If a law cannot be written as C, or the folder is not writable.

    Examples
    --------
    >>> found = eqt_cli.export("configs/paper.yaml", "flight", controllers="eqt", real="float")
    >>> found.files
    ['eqt.h', 'eqt.c', 'eqt_check.c', 'README.md']
    """
    if real not in ARITHMETICS:
        raise EqtError(f"real: expected {' or '.join(ARITHMETICS)}, got {real!r}")
    experiment = experiment_at(target, point, trust_plugins=trust_plugins)
    folder = Path(out) if out is not None else Path("exported", experiment.name)
    check_targets([folder / NAME], folder)  # fails before the work, not after it
    labels = [controllers] if isinstance(controllers, str) else controllers
    laws = exported(experiment, labels, ARITHMETICS[real], reference=reference, workers=workers)
    texts: dict[str, str] = {}
    costs: dict[str, Footprint | None] = {}
    for law in laws:
        own = files(law)
        costs[law.label] = measured(law.name, own)
        texts |= own
    texts[NAME] = readme(laws, costs)
    write_all({folder / name: text.encode() for name, text in texts.items()}, folder)
    return ExportedFiles(folder, list(texts), [_record(law, costs) for law in laws])


def _record(law: ExportedLaw, costs: Mapping[str, Footprint | None]) -> dict[str, object]:
    cost = costs[law.label]
    return {
        "label": law.label,
        "name": law.name,
        "real": law.by.name,
        "operations": law.program.step.operations,
        "states": law.states.count,
        "bound": law.torque_bound.tolist(),
        "singular": int(np.count_nonzero(law.singular)),
        "singular_bound": law.singular_bound.tolist(),
        "flash": cost.flash if cost else None,
        "stack": cost.stack if cost else None,
    }
