"""Writes the report of a result: figures, comparison and certificates on one page."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from eqt_cli.analysis.certificates.base import Row
from eqt_cli.analysis.verification import verify_stored
from eqt_cli.api.loading import ResultPath
from eqt_cli.config.named_files import load_stored_plugins
from eqt_cli.core.errors import EqtError, EqtWarning
from eqt_cli.core.files import check_targets, write_all
from eqt_cli.core.reporting import reporter
from eqt_cli.execution.folder import REPORT
from eqt_cli.results.result import open_result, point_folder

QUICK = "The certificates were left out (--quick); `eqt verify` computes them."
"""What a quick page says in place of certificates."""


def write_report(
    result: ResultPath,
    out: str | os.PathLike[str] | None = None,
    *,
    figures: Sequence[str] = (),
    author: str = "",
    notes: str = "",
    title: str = "",
    date: str = "",
    point: int | None = None,
    trust_plugins: bool = False,
    workers: int = 1,
    quick: bool = False,
    units: Sequence[str] = (),
) -> Path:
    """Write the report of a result: one HTML page with figures, comparison and certificates.

    Parameters
    ----------
    result
        The result folder, or the file in it.
    out
        The page. Default: ``report.html`` in the result folder.
    figures
        Names of the figures to show; a default selection if empty.
    author, notes
        Texts at the top of the page. Blank lines separate paragraphs of the notes.
    title, date
        Title and date of the page. Default: the name of the experiment and the day of its run.
    point
        Point of a sweep, counted from 0.
    trust_plugins
        Whether to execute plugin sources that are stored in the result. Otherwise the page of a
        result with plugins has no certificates, and says why.
    workers
        Number of cores to use.
    quick
        Whether to leave out the certificates, for which some runs are integrated again.
    units
        Units of quantities, as for `compare`.

    Returns
    -------
    Path
        The written page, which needs no network.

    Raises
    ------
    EqtError
        If the result or a figure does not exist, or the page cannot be written.

    Examples
    --------
    >>> eqt_cli.write_report("results/paper", author="Ada Lovelace").name
    'report.html'
    """
    from eqt_cli.report import report
    from eqt_cli.report.figures import named

    with open_result(Path(result), point) as opened:
        within = Path() if point is None else point_folder(point)
        home = opened.path.parent if out is None else Path(out).parent
        path = home / within / REPORT if out is None else Path(out)
        check_targets([path], home)  # fails before the work, not after it
        if trust_plugins:
            load_stored_plugins(opened)
        shown = opened.in_units(units)
        wanted = named(figures) if figures else None
        rows: list[Row] = []
        reason = QUICK if quick and not opened.is_sweep else ""
        if not (quick or opened.is_sweep):
            try:
                rows = verify_stored(opened, trust_plugins=trust_plugins, workers=workers).rows
            except EqtError as error:
                reason = f"The result could not be verified: {error}"
                why = "the page has no certificates; the result could not be verified: "
                why += str(error.args[0])
                reporter().remark(EqtWarning(why, *error.remedies, lines=error.lines))
        page = report(shown, wanted, rows, reason, author, notes, title, date)
    write_all({path: page.encode()}, home)
    return path
