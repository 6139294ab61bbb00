"""The statement of a validation: checked before runs, stored with them, and said of a result."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import norm
from eqt_cli.base.errors import Problems
from eqt_cli.base.files import read_record
from eqt_cli.base.reporting import TextTable
from eqt_cli.base.store_reader import ResultFile
from eqt_cli.config.document import Document
from eqt_cli.config.experiment import Experiment
from eqt_cli.config.study import Study
from eqt_cli.extensions.flights.validation import digest_of_model
from eqt_cli.results.result import Result
from eqt_cli.runs.compute_part import solve_references

STORED = "flights"
"""Attribute of a result with the statement."""

FASTER = 1.1
"""Mean speed of a reference over that of the fastest flight, from which nothing is stated."""


def _record(document: Document) -> tuple[str, dict[str, Any] | None]:
    """Return the name of the file, and what it holds; None if eqt did not write it."""
    name = str(document.data.get("validation") or "")
    if not name:
        return "", None
    try:
        return name, read_record(document.home.folder / name, "answer", "digest", "line", "speed")
    except OSError:
        return name, None


@purposes.checks_of_an_experiment
def check(experiment: Experiment, problems: Problems) -> None:
    """Note a file that is missing, or that is of another plant or other laws."""
    if experiment.document.home.is_result:
        return
    name, record = _record(experiment.document)
    if not name:
        return
    here = problems.at("validation")
    if record is None:
        here.add(f"expected a file that eqt validate --out wrote, got '{name}'")
    elif record["digest"] != digest_of_model(experiment.document):
        here.add(
            f"{name} is of another plant or of other laws, so that it says nothing of these; run "
            "eqt validate with this model, or remove this key"
        )


@purposes.errors_of_a_result
def stored(study: Study) -> dict[str, Any]:
    """Return the statement as an attribute of a result, if its reference is no faster."""
    _, record = _record(study.base.document)
    if record is None:
        return {}
    fastest, line = record["speed"], str(record["line"])
    poses = solve_references(study, np.array([0]))["desired_pose"][0]
    if isinstance(fastest, float) and np.isfinite(fastest) and poses.shape[-1] == 4:
        path = norm(np.diff(poses[:, :3, 3], axis=0)).sum()
        speed = float(path / (study.base.times[-1] - study.base.times[0]))
        if speed > FASTER * fastest:
            line = f"flights say nothing of {speed:.2g} m/s: they were at most {fastest:.2g} m/s"
    return {STORED: line}


@purposes.remarks_on_a_result
def remarks(result: ResultFile) -> Iterator[str]:
    """Yield what flights said of the laws and the plant of a result."""
    if line := result.attributes.get(STORED):
        yield str(line)


@purposes.answers_of_a_result
def answers(result: Result) -> tuple[dict[str, Any], list[TextTable]]:
    """Return for programs what flights said, or that none did."""
    return {"confirmed": str(result.attributes.get(STORED, "none"))}, []
