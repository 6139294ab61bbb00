"""`eqt report`: a result as one HTML page."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eqt_cli.cli import options

if TYPE_CHECKING:
    from eqt_cli.analysis.certificates import Row
    from eqt_cli.store.reader import Results


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
        typer.Option("--figure", metavar="NAME", help="Figure to show; may be repeated."),
    ] = None,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
) -> None:
    """Write one self-contained HTML page: figures, comparison, certificates, every run."""
    from eqt_cli.cli.output import print_json
    from eqt_cli.plots.save import write
    from eqt_cli.report import report as make_page
    from eqt_cli.report.figures import DEFAULT, named
    from eqt_cli.store.reader import open_results

    with open_results(result) as results:
        rows, unverified = _certificates(results, trust_plugins)
        shown = named(figure) if figure else DEFAULT
        page = make_page(results, shown, rows, unverified).encode()
        path = out or results.path.parent / "report.html"
    write({path: page})
    if json:
        print_json({"report": str(path), "bytes": len(page)})
    else:
        print(f"report   {path}  ({len(page) / 1e6:.1f} MB)")


def _certificates(results: Results, trust_plugins: bool) -> tuple[list[Row], str]:
    """What the verification of a result finds, or why it cannot be verified."""
    from eqt_cli.core.errors import EqtError
    from eqt_cli.experiment.build import build
    from eqt_cli.experiment.source import read_config
    from eqt_cli.experiment.verify import verify_results

    if "point" in results.dimensions:  # which the report refuses
        return [], ""
    try:
        experiment = build(read_config(results.path), trust_plugins=trust_plugins)
        return verify_results(experiment, results, options.cores()).rows, ""
    except EqtError as error:
        return [], f"The result could not be verified: {error}"
