"""Animates runs, and writes reports."""

import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from eqt_cli.api.drawing import folders, load_plugins
from eqt_cli.api.loading import ResultPath, open_at
from eqt_cli.base import purposes
from eqt_cli.base.errors import ComponentError, EqtError, EqtWarning, Remedy
from eqt_cli.base.extensions import function_for, functions_for
from eqt_cli.base.files import REPORT, check_targets, write_all
from eqt_cli.base.reporting import reporter
from eqt_cli.base.yaml_source import load
from eqt_cli.results.result import point_folder


def animate(
    result: ResultPath,
    run: int = 0,
    controllers: Sequence[str] = (),
    out: str | os.PathLike[str] | None = None,
    *,
    seconds: float = 8.0,
    point: int | None = None,
    trust_plugins: bool = False,
) -> Path:
    """Animate a run as a GIF: the bodies in the frame of the reference, the error and the torque.

    Parameters
    ----------
    result
        The result folder, or the file in it.
    run
        Number of the run, counted from 0.
    controllers
        Labels of the controllers to show; all if empty.
    out
        Output folder. Default: ``figures`` in the result folder.
    seconds
        Duration of the GIF, s.
    point
        Point of a sweep, counted from 0.
    trust_plugins
        Whether to execute plugin sources that are stored in the result.

    Returns
    -------
    Path
        The written file.

    Raises
    ------
    EqtError
        If the result, the run or a controller does not exist, or the group has no body to show.

    Examples
    --------
    >>> eqt_cli.animate("results/paper", run=1, seconds=1).name
    'run1.gif'
    """
    from eqt_cli.extensions.report.scenes import gif, motion

    with open_at(Path(result), point) as opened:
        if trust_plugins:
            load_plugins(opened)
        try:
            motion(opened, run, controllers)  # checks first that the run can be shown
        except ComponentError as error:
            if trust_plugins or not load(str(opened.attributes["plugins"]), "plugins").data:
                raise
            text = f"{error}; the result holds plugins, which are executed only on request"
            advice = "read them with `eqt show --plugins`, then add {}"
            raise EqtError(text, Remedy(advice, "trust_plugins")) from error
        home, folder = folders(opened, out, point)
        path = folder / f"run{run}.gif"
        check_targets([path], home)
        picture = gif(opened, run, controllers, seconds=seconds)
    write_all({path: picture}, home)
    return path


QUICK = "The certificates were left out (--quick); `eqt verify` computes them."
"""What a quick page says in place of certificates."""


def report(
    result: ResultPath,
    out: str | os.PathLike[str] | None = None,
    *,
    figures: Sequence[str] = (),
    against: str = "",
    author: str = "",
    notes: str = "",
    title: str = "",
    date: str = "",
    point: int | None = None,
    trust_plugins: bool = False,
    workers: int = 1,
    quick: bool = False,
    live: bool = False,
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
    against
        Label or title of the controller with which the others are compared; the first if empty.
    author, notes
        Texts at the top of the page. Blank lines separate paragraphs of the notes.
    title, date
        Title and date of the page. Default: the first sentence of the comment at the top of the
        configuration, or the name of the experiment, and the day of its run.
    point
        Point of a sweep, counted from 0.
    trust_plugins
        Whether to execute plugin sources that are stored in the result. Otherwise the page of a
        result with plugins has no certificates, and says why.
    workers
        Number of cores to use.
    quick
        Whether to leave out the certificates, for which some runs are integrated again.
    live
        Whether the page begins with sliders that run the experiment again, as those of `live`.
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
    >>> eqt_cli.report("results/paper", author="Ada Lovelace").name
    'report.html'
    """
    from eqt_cli.extensions.report import document

    with open_at(Path(result), point) as opened:
        within = Path() if point is None else point_folder(point)
        home = opened.path.parent if out is None else Path(out).parent
        path = home / within / REPORT if out is None else Path(out)
        check_targets([path], home)  # fails before the work, not after it
        if trust_plugins:
            load_plugins(opened)
        shown = opened.in_units(units)
        wanted = document.named(figures) if figures else None
        certificates: dict[str, Any] = {}
        reason = QUICK if quick and not opened.is_sweep else ""
        if not (quick or opened.is_sweep):
            try:  # their tables by their names in the template: `certificates` and `doubts`
                for certificates_of in functions_for(purposes.certificates_of_a_report):
                    certificates |= certificates_of(opened, trust_plugins, workers)
            except EqtError as error:
                reason = f"The result could not be verified: {error}"
                why = "the page has no certificates; the result could not be verified: "
                why += str(error.args[0])
                reporter().remark(EqtWarning(why, *error.remedies, lines=error.lines))
        with suppress(EqtError):  # plugins that nobody trusts, of which the certificates tell
            for diagram_of in functions_for(purposes.diagram_of_a_report):
                certificates["drawing"] = diagram_of(opened, trust_plugins)
        if against and opened.is_sweep:
            raise EqtError("--against: applies to one experiment; choose a point with --point")
        part = function_for(purposes.report_live)(opened, trust_plugins) if live else None
        base = shown.labels[shown.position_of(against)] if against else ""
        page = document.report(
            shown, wanted, certificates, reason, author, notes, title, date, base, part
        )
    write_all({path: page.encode()}, home)
    return path
