"""Tasks of the suite by their names, for trainings: ``eqt-suite-2/quad_att``."""

from __future__ import annotations

from collections.abc import Mapping

from eqt_cli.base import purposes
from eqt_cli.base.errors import EqtError, KeyPath
from eqt_cli.config.document import Document
from eqt_cli.extensions.suite.tasks import VERSION, chosen_tasks

REPEATED = 100
"""The seed of the first training sample of `eqt suite repeat` is so much larger."""


@purposes.task_by_name
def task_by_name(
    name: str,
) -> tuple[Document, KeyPath, str, Mapping[str, float], Mapping[str, int]]:
    """Return a task with GT, the place of that law, the objective, the bound, and the seeds.

    Raises
    ------
    EqtError
        If this version of eqt has no such task, or no network can stand in the place of its law.
    """
    suite, _, short = name.partition("/")
    if suite != VERSION:
        raise EqtError(
            f"{name}: this eqt judges by {VERSION}, whose tasks are others; name {VERSION}/{short}"
        )
    task = chosen_tasks([short])[short]
    if len(task.place) > 2:
        others = ", ".join(x for x, other in chosen_tasks([]).items() if len(other.place) == 2)
        raise EqtError(
            f"{name}: tunes the attitude law within a cascade, and a network is no such law; name "
            f"one of {others}"
        )
    search, seeds = task.section.search, {"suite.judge.seed": task.section.judge.seed}
    for sample in range(search.samples):
        for more in (0, REPEATED):
            seeds[f"suite.search.seed + {sample + more}"] = search.seed + sample + more
    return task.document, task.place, task.section.objective, task.section.equal, seeds
