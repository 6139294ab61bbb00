"""Writes the page of a result, with its figures, comparison and certificates."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from eqt_cli.analysis.certificates.base import Row
from eqt_cli.analysis.verification import verify_stored
from eqt_cli.api.paths import ResultPath
from eqt_cli.core.errors import EqtError, EqtWarning
from eqt_cli.core.reporting import reporter
from eqt_cli.execution.folder import REPORT
from eqt_cli.results.result import open_result, point_folder


def write_report(
    result: ResultPath,
    out: str | os.PathLike[str] | None = None,
    *,
    figures: Sequence[str] = (),
    author: str = "",
    notes: str = "",
    point: int | None = None,
    trust_plugins: bool = False,
    workers: int = 1,
) -> Path:
    """Write a result as one HTML page that needs no network: figures, comparison, certificates.

    Parameters
    ----------
    result
        The result folder, or the file in it.
    out
        The page; ``report.html`` in the result folder if not given.
    figures
        Names of those to show; a choice if empty.
    author, notes
        Shown at the top of the page; blank lines in the notes part paragraphs.
    point
        Of a sweep, counted from 0.
    trust_plugins
        Execute plugin sources that are stored in the result; without, a result with plugins gets a
        page without certificates, which says so.
    workers
        Cores to use.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    EqtError
        If there is no such result or figure, or the page cannot be written.

    Examples
    --------
    >>> eqt_cli.write_report("results/paper", author="Ada Lovelace").name
    'report.html'
    """
    from eqt_cli.plots.save import check_targets, write
    from eqt_cli.report import report
    from eqt_cli.report.figures import named

    with open_result(Path(result), point) as opened:
        within = Path() if point is None else point_folder(point)
        home = opened.path.parent if out is None else Path(out).parent
        path = home / within / REPORT if out is None else Path(out)
        check_targets([path], home)  # before the work, and not after it
        wanted = named(figures) if figures else None
        rows: list[Row] = []
        reason = ""
        if not opened.is_sweep:
            try:
                rows = verify_stored(opened, trust_plugins=trust_plugins, workers=workers).rows
            except EqtError as error:
                reason = f"The result could not be verified: {error}"
                why = "the page has no certificates; the result could not be verified: "
                why += str(error.args[0])
                reporter().remark(EqtWarning(why, *error.remedies, lines=error.lines))
        page = report(opened, wanted, rows, reason, author, notes)
    write({path: page.encode()}, home)
    return path
