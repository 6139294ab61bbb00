"""One experiment from configuration to result folder."""

from __future__ import annotations

import json
import time
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.experiment.build import Experiment
from eqt_cli.experiment.cross_check import CrossCheck
from eqt_cli.experiment.folder import ResultFolder
from eqt_cli.experiment.provenance import provenance
from eqt_cli.experiment.run import Progress, simulate
from eqt_cli.experiment.source import ConfigSource
from eqt_cli.experiment.yaml_source import dump
from eqt_cli.store.variables import Table
from eqt_cli.store.writer import write


@dataclass(frozen=True)
class Outcome:
    """What `execute` did.

    Attributes
    ----------
    folder
        Where the result is.
    was_complete
        The folder held this experiment's finished result already; nothing was run.
    removed
        What `force` removed.
    runs, failed
        Runs over all controllers, and those with a status other than 0.
    seconds
        Wall time of simulation and writing, s.
    """

    folder: ResultFolder
    was_complete: bool
    removed: list[str]
    runs: int
    failed: int
    seconds: dict[str, float]


def execute(
    experiment: Experiment,
    source: ConfigSource,
    out: Path,
    *,
    force: bool = False,
    progress: Progress = lambda runs: None,
    workers: int = 1,
) -> Outcome:
    """Run an experiment and write its folder; a finished result of the same one is kept.

    Raises
    ------
    EqtError
        If the folder holds something else, or cannot be written.
    """
    folder = ResultFolder(out)
    runs = experiment.config.ensemble.runs * len(experiment.loops)
    if not force and folder.is_complete(experiment):
        failed = int((folder.manifest or {}).get("failed", 0))
        return Outcome(folder, True, [], runs, failed, {})
    started = time.perf_counter()
    manifest = _manifest(experiment, source)
    removed = folder.claim(experiment, manifest, force)
    simulated = simulate(experiment, progress, workers)
    table, check = simulated.table, simulated.check
    integrated = time.perf_counter()
    failed = int(np.count_nonzero(table.variables["status"].data))
    compression = experiment.config.store.compression
    write(
        folder.results,
        _described(table, experiment, manifest, check),
        compression="gzip" if compression == "gzip" else None,
    )
    seconds = {
        "simulation": round(integrated - started, 3),
        "writing": round(time.perf_counter() - integrated, 3),
    }
    finished = datetime.now(UTC).isoformat(timespec="seconds")
    ending = {"finished": finished, "seconds": seconds, "failed": failed}
    folder.finish(manifest | ending)
    return Outcome(folder, False, removed, runs, failed, seconds)


def _manifest(experiment: Experiment, source: ConfigSource) -> dict[str, Any]:
    return {
        "name": experiment.name,
        "digest": experiment.digest,
        "runs": experiment.config.ensemble.runs,
        "controllers": list(experiment.loops),
        "config": experiment.numeric_config,
        "provenance": provenance(source.folder),
    }


def _described(
    table: Table, experiment: Experiment, manifest: dict[str, Any], check: CrossCheck | None
) -> Table:
    """The table with all that is needed to understand it and to run it again."""
    attributes = {
        "title": experiment.name,
        "config": dump(experiment.resolved),
        "plugins": dump(experiment.plugins),
        "digest": experiment.digest,
        "group": experiment.group.name,
        "provenance": json.dumps(manifest["provenance"], ensure_ascii=False),
        "source": "Hampsey, van Goor, Banavar, Mahony (2025), arXiv 2511.18800",
    }
    checked = {} if check is None else {f"cross_check_{k}": v for k, v in asdict(check).items()}
    return Table(table.variables, table.coordinates, {**table.attributes, **attributes, **checked})
