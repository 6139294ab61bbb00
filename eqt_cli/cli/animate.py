"""`eqt animate`: one run of a result as a moving picture."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from eqt_cli.cli.shared import options
from eqt_cli.cli.shared.output import print_found, say


class Format(StrEnum):
    """Files that are written."""

    GIF = "gif"
    HTML = "html"


def animate(
    result: options.Result,
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
    out: Annotated[Path | None, options.out("Folder; default: RESULT/figures.")] = None,
    point: options.Point = None,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Show one run: bodies against the reference frame, error and torque as they go."""
    from eqt_cli import api

    files = api.animate(
        result,
        run,
        controller or (),
        out,
        formats=list(dict.fromkeys(format or Format)),
        seconds=seconds,
        point=point,
        trust_plugins=trust_plugins,
        note=(lambda text: None) if quiet else say,
    )
    sizes = {file: f"{file.stat().st_size / 1e6:.1f} MB" for file in files}
    text = "\n".join(f"animation  {file}  ({size})" for file, size in sizes.items())
    print_found({"files": list(map(str, files))}, text, json=json)
