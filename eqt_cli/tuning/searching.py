"""From a search to its folder: the generations of all laws, and the runs that judge the outcome."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from eqt_cli.core.reporting import RUNS_DONE, step
from eqt_cli.execution.lock import LOCK, locked
from eqt_cli.execution.run_study import Execution
from eqt_cli.tuning.folder import SearchFolder
from eqt_cli.tuning.generations import Computing
from eqt_cli.tuning.searches import Searches

S = TypeVar("S", bound=Searches[Any])

Conclude = Callable[[S, SearchFolder, Computing], tuple[Execution, dict[str, Any]]]
"""Searches for every law; gives the runs that judge the outcome, and what the record says of it."""


@dataclass(frozen=True)
class Found:
    """What a search has found that has come to its end.

    Attributes
    ----------
    search
        What for.
    judged
        The result in its folder: of the runs by which the outcome is judged.
    record
        What was found, as plain data, as the folder has it.
    """

    search: Searches[Any]
    judged: Execution
    record: dict[str, Any]


def carry_out(
    search: S, out: Path, conclude: Conclude[S], do: Computing, *, force: bool = False
) -> Found:
    """Search in a folder; generations that are there are not computed again.

    Parameters
    ----------
    force
        Start over.

    Raises
    ------
    EqtError
        If the folder holds something else, is in use, or cannot be written.
    """
    folder = SearchFolder(out, search.kind)
    folder.check(search)
    with locked(out, name=f"{LOCK}-{search.kind.command}"):
        folder.claim(search, force)
        with step(RUNS_DONE, search.all_runs):
            judged, outcome = conclude(search, folder, do)
        record = search.settings | outcome
        folder.write_record(record)
    return Found(search, judged, record)
