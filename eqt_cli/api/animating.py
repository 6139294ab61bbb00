"""Animates a run of a result."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from eqt_cli.api.paths import ResultPath
from eqt_cli.config.plugins import load_stored_plugins
from eqt_cli.config.source import source_of
from eqt_cli.core.errors import ComponentError, EqtError, Remedy
from eqt_cli.execution.folder import FIGURES
from eqt_cli.results.result import open_result, point_folder


def animate(
    result: ResultPath,
    run: int = 0,
    controllers: Sequence[str] = (),
    out: str | os.PathLike[str] | None = None,
    *,
    formats: Sequence[str] = ("gif", "html"),
    seconds: float = 8.0,
    point: int | None = None,
    trust_plugins: bool = False,
) -> list[Path]:
    """Animate a run: the bodies in the frame of the reference, the error and the torque.

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
    formats
        ``gif``, or ``html`` for a page.
    seconds
        Duration of the GIF, s.
    point
        Point of a sweep, counted from 0.
    trust_plugins
        Whether to execute plugin sources that are stored in the result.

    Returns
    -------
    list of Path
        The written files, one per format.

    Raises
    ------
    EqtError
        If the result, the run or a controller does not exist, or the group has no body to show.

    Examples
    --------
    >>> [file.name for file in eqt_cli.animate("results/paper", run=1, formats=["html"])]
    ['run1.html']
    """
    from eqt_cli.plots.animation.gif import gif
    from eqt_cli.plots.animation.motion import motion
    from eqt_cli.plots.save import check_targets, write
    from eqt_cli.report.animation import animation

    contents = {}
    with open_result(Path(result), point) as opened:
        if trust_plugins:
            load_stored_plugins(opened)
        try:
            motion(opened, run, controllers)  # checks first that the run can be shown
        except ComponentError as error:
            if trust_plugins or not source_of(opened).stored_plugins:
                raise
            text = f"{error}; the result holds plugins, which are executed only on request"
            advice = "read them with `eqt show --plugins`, then add {}"
            raise EqtError(text, Remedy(advice, "trust_plugins")) from error
        within = Path(FIGURES) if point is None else point_folder(point)
        home = opened.path.parent if out is None else Path(out)
        folder = home / within if out is None else home
        paths = {format: folder / f"run{run}.{format}" for format in formats}
        check_targets(paths.values(), home)
        for format, path in paths.items():
            if format == "html":
                contents[path] = animation(opened, run, controllers).encode()
            else:
                contents[path] = gif(opened, run, controllers, seconds=seconds)
    write(contents, home)
    return list(contents)
