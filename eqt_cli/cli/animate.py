"""`eqt animate`: one run of a result as a moving picture."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

from eqt_cli.cli.shared import options
from eqt_cli.cli.shared.output import print_found


class AnimationFormat(StrEnum):
    """Formats of the files written."""

    GIF = "gif"
    HTML = "html"


def animate(
    result: options.Result,
    run: Annotated[int, options.option("--run")] = 0,
    controller: options.Controllers = None,
    format: Annotated[list[AnimationFormat] | None, options.option("--format")] = None,
    seconds: Annotated[float, options.option("--seconds", min=0.2, max=120)] = 8.0,
    out: Annotated[Path | None, options.option("--out", parser=options.folder)] = None,
    point: options.Point = None,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Show one run as a moving picture: bodies, tracking error and torque over time.

    Options
    -------
    What to show
        --run K  Run, counted from 0.
    Result
        --format NAME  gif or html. Repeatable. Default: both.
        --seconds S  Duration of the GIF in seconds.
        --out DIR  Output folder. Default: RESULT/figures.
    """
    from eqt_cli import api

    files = api.animate(
        result,
        run,
        controller or (),
        out,
        formats=list(dict.fromkeys(format or AnimationFormat)),
        seconds=seconds,
        point=point,
        trust_plugins=trust_plugins,
    )
    sizes = {file: f"{file.stat().st_size / 1e6:.1f} MB" for file in files}
    text = "\n".join(f"animation  {file}  ({size})" for file, size in sizes.items())
    print_found({"files": list(map(str, files))}, text, json=json)
