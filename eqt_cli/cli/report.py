"""`eqt report`: a result as one HTML page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eqt_cli.cli import completion, options


def report(
    result: Annotated[
        Path, typer.Argument(metavar="RESULT", help="Result folder, or its results.h5.")
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="The page; default: RESULT/report.html."),
    ] = None,
    figure: Annotated[
        list[str] | None,
        typer.Option(
            "--figure",
            metavar="NAME",
            autocompletion=completion.names("figures"),
            help="Figure to show; may be repeated.",
        ),
    ] = None,
    point: options.Point = None,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
) -> None:
    """Write one self-contained HTML page: figures, comparison, certificates, every run."""
    from eqt_cli.analysis.verification import verify_stored
    from eqt_cli.cli.output import print_json, say
    from eqt_cli.core.errors import EqtError
    from eqt_cli.plots.save import check_targets, write
    from eqt_cli.report import report as make_page
    from eqt_cli.report.figures import named
    from eqt_cli.results.result import open_result, point_folder

    with open_result(result, point) as results:
        within = Path() if point is None else point_folder(point)
        path = out or results.path.parent / within / "report.html"
        check_targets([path])
        shown = named(figure) if figure else None
        say("checking the paper's statements and drawing the figures takes some seconds")
        try:
            rows, unverified = [], ""
            if "point" not in results.dimensions:
                rows = verify_stored(
                    results, trust_plugins=trust_plugins, workers=options.cores()
                ).rows
        except EqtError as error:
            rows, unverified = [], f"The result could not be verified: {error}"
            say(f"the page has no certificates; {unverified[0].lower()}{unverified[1:]}")
        page = make_page(results, shown, rows, unverified).encode()
    write({path: page})
    if json:
        print_json({"report": str(path), "bytes": len(page)})
    else:
        print(f"report   {path}  ({len(page) / 1e6:.1f} MB)")
