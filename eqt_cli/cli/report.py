"""`eqt report` and `eqt cite`: a result as one HTML page, and references to cite with it."""

from pathlib import Path
from typing import Annotated

import typer

from eqt_cli.cli.shared import completion, options
from eqt_cli.cli.shared.output import print_found, print_source


def report(
    result: options.Result,
    more: options.MoreResults = None,
    out: Annotated[Path | None, options.option("--out")] = None,
    figure: Annotated[
        list[str] | None, options.option("--figure", autocompletion=completion.names("figures"))
    ] = None,
    title: Annotated[str, options.option("--title")] = "",
    author: Annotated[str, options.option("--author")] = "",
    date: Annotated[str, options.option("--date")] = "",
    notes: Annotated[Path | None, options.option("--notes")] = None,
    quick: Annotated[bool, options.option("--quick")] = False,
    point: options.Point = None,
    unit: options.Units = None,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
) -> None:
    """Write one self-contained HTML page: figures, comparison, certificates, every run.

    Options
    -------
    Result
        --out FILE  File to write. Default: RESULT/report.html.
        --title TEXT  Title. Default: that of the experiment.
        --author NAME  Author, named at the top of the page.
        --date TEXT  Date. Default: the day of the run.
        --notes FILE  Text file shown at the top of the page.
    What to show
        --figure NAME  Figure to show. Repeatable.
        --quick  Leave out the certificates, for which some runs are integrated again.
    """
    from eqt_cli import api
    from eqt_cli.core.files import text_of

    result = options.only_result("report", [result, *(more or ())])

    text = text_of(notes, "write the notes there first") if notes else ""
    path = api.write_report(
        result,
        out,
        figures=figure or (),
        title=title,
        author=author,
        date=date,
        notes=text,
        point=point,
        trust_plugins=trust_plugins,
        workers=options.cores(),
        quick=quick,
        units=unit or (),
    )
    size = path.stat().st_size
    text = f"report   {path}  ({size / 1e6:.1f} MB)"
    print_found({"report": str(path), "bytes": size}, text, json=json)


def cite(
    result: Annotated[
        Path | None,
        typer.Argument(
            metavar="RESULT",
            help="Result folder, or the results.h5 in it. Default: the paper and eqt only.",
        ),
    ] = None,
    json: options.Json = False,
) -> None:
    """Print BibTeX entries of the paper, of eqt, and of the laws that a result used."""
    from eqt_cli import api

    entries = api.cite(result)
    print_source({"bibtex": entries.split("\n\n")}, entries, json=json)
