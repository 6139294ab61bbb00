"""Carries out a search in its folder."""

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
"""Searches for every law; returns the runs that judge the outcome, and the outcome's record."""


@dataclass(frozen=True)
class Found:
    """The outcome of a finished search.

    Attributes
    ----------
    search
        The search.
    judged
        Result of the runs that judge the outcome.
    record
        The record of the search, as its folder holds it.
    """

    search: Searches[Any]
    judged: Execution
    record: dict[str, Any]


def carry_out(
    search: S, out: Path, conclude: Conclude[S], do: Computing, *, force: bool = False
) -> Found:
    """Carry out a search in a folder, reusing the generations that it already holds.

    Parameters
    ----------
    force
        Whether to start over.

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
