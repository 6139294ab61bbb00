"""`eqt report`: a result as one HTML page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eqt_cli.cli.shared import options
from eqt_cli.cli.shared.output import option, print_found, say
from eqt_cli.core.errors import EqtError


def report(
    result: options.Result,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="The page; default: RESULT/report.html."),
    ] = None,
    figure: Annotated[list[str] | None, options.figure("Figure to show; may be repeated.")] = None,
    point: options.Point = None,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
) -> None:
    """Write one self-contained HTML page: figures, comparison, certificates, every run."""
    from eqt_cli import api

    def unverified(error: EqtError) -> None:
        reason = f"the result could not be verified: {error.told(option)}"
        say(f"the page has no certificates; {reason}")

    path = api.write_report(
        result,
        out,
        figures=figure or (),
        point=point,
        trust_plugins=trust_plugins,
        workers=options.cores(),
        note=say,
        unverified=unverified,
    )
    size = path.stat().st_size
    text = f"report   {path}  ({size / 1e6:.1f} MB)"
    print_found({"report": str(path), "bytes": size}, text, json=json)
