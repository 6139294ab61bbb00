"""`eqt animate`: one run of a result as a moving picture."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from eqt_cli.cli import options

AS_PLUGIN = (
    "the result holds plugins, which are executed only on request; read them with `eqt show "
    "--plugins`, then add --trust-plugins"
)


class Format(StrEnum):
    """Files that are written."""

    GIF = "gif"
    HTML = "html"


def animate(
    result: Annotated[
        Path, typer.Argument(metavar="RESULT", help="Result folder, or its results.h5.")
    ],
    run: Annotated[
        int, typer.Option("--run", metavar="K", help="Number of the run, counted from 0.")
    ] = 0,
    controller: Annotated[
        list[str] | None,
        typer.Option("--controller", metavar="LABEL", help="Show this one only; may be repeated."),
    ] = None,
    format: Annotated[
        list[Format] | None,
        typer.Option("--format", help="What to write; may be repeated; default: both."),
    ] = None,
    seconds: Annotated[
        float, typer.Option("--seconds", min=0.2, max=120, help="How long the GIF lasts.")
    ] = 8.0,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="DIR",
            parser=options.folder,
            help="Folder; default: RESULT/figures.",
        ),
    ] = None,
    point: options.Point = None,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Show one run: bodies against the reference frame, error and torque as they go."""
    from eqt_cli.cli.output import print_json, say
    from eqt_cli.config.plugins import load_stored_plugins
    from eqt_cli.config.source import source_of
    from eqt_cli.core.errors import ComponentError, EqtError
    from eqt_cli.plots.animation.gif import gif
    from eqt_cli.plots.animation.motion import motion
    from eqt_cli.plots.save import check_targets, write
    from eqt_cli.report.animation import animation
    from eqt_cli.results.result import open_result, point_folder

    wanted = dict.fromkeys(format or Format)
    contents = {}
    within = Path("figures") if point is None else point_folder(point)
    with open_result(result, point) as results:
        if trust_plugins:
            load_stored_plugins(results)
        try:
            motion(results, run, controller or ())  # what cannot be shown is said before all else
        except ComponentError as error:
            if trust_plugins or not source_of(results).stored_plugins:
                raise
            raise EqtError(f"{error}; {AS_PLUGIN}") from error
        folder = out or results.path.parent / within
        paths = {one: folder / f"run{run}.{one}" for one in wanted}
        check_targets(paths.values())
        for one, path in paths.items():
            if one is Format.HTML:
                contents[path] = animation(results, run, controller or ()).encode()
            else:
                if not quiet:
                    say("drawing the pictures of the GIF takes some seconds")
                contents[path] = gif(results, run, controller or (), seconds=seconds)
    write(contents)
    if json:
        print_json({"files": [str(path) for path in contents]})
    else:
        for path, content in contents.items():
            print(f"animation  {path}  ({len(content) / 1e6:.1f} MB)")
