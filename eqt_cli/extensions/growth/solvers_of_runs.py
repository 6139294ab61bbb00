"""Which runs of a result were computed with other settings of the solver; all readers say so."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from typing import Any, NamedTuple

from eqt_cli.base import purposes
from eqt_cli.base.reporting import count_of
from eqt_cli.base.store_reader import ResultFile

SETTINGS = "solver_of_runs"
"""Attribute of a result: runs that were computed with other settings of the solver, in JSON."""


class Setting(NamedTuple):
    """Settings of the solver, and the runs that were computed with them.

    Attributes
    ----------
    solver
        The settings that differ from those of the experiment, by key.
    runs
        Law, point and number of each run.
    """

    solver: dict[str, Any]
    runs: list[tuple[str, int, int]]

    @property
    def words(self) -> str:
        """The settings as in overrides."""
        return ", ".join(f"solver.{key}={json.dumps(value)}" for key, value in self.solver.items())


def settings_of(result: ResultFile) -> list[Setting]:
    """Return the other settings of the solver with which runs of a result were computed.

    Raises
    ------
    ResultError
        If the attribute holds something else.
    """
    try:
        listed = [
            Setting(
                {str(key): x for key, x in entry["solver"].items()},
                [(str(law), int(point), int(run)) for law, point, run in entry["runs"]],
            )
            for entry in json.loads(str(result.attributes.get(SETTINGS, "[]")))
        ]
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError):
        raise result.refusal(f"its attribute '{SETTINGS}' does not hold runs") from None
    return listed


@purposes.remarks_on_a_result
def remarks(result: ResultFile) -> Iterator[str]:
    """Yield which runs of a result were computed with other settings of the solver."""
    for setting in settings_of(result):
        counts = Counter(label for label, *_ in setting.runs)
        of = ", ".join(f"{count} of {label}" for label, count in counts.items())
        runs = count_of(len(setting.runs), "run")
        yield f"{runs} ({of}) failed at first, and were computed with {setting.words}"
