"""`eqt report`: a result as one HTML page."""

from pathlib import Path
from typing import Annotated

from eqt_cli.cli.shared import options
from eqt_cli.cli.shared.help import RESULT
from eqt_cli.cli.shared.output import print_found


def report(
    result: options.Result,
    more: options.MoreResults = None,
    out: Annotated[
        Path | None,
        options.valued("--out", "FILE", "File to write. Default: RESULT/report.html.", RESULT),
    ] = None,
    figure: Annotated[list[str] | None, options.figure("Figure to show. Repeatable.")] = None,
    title: Annotated[
        str,
        options.valued("--title", "TEXT", "Title. Default: that of the experiment.", RESULT),
    ] = "",
    author: Annotated[
        str,
        options.valued("--author", "NAME", "Author, named at the top of the page.", RESULT),
    ] = "",
    date: Annotated[
        str,
        options.valued("--date", "TEXT", "Date. Default: the day of the run.", RESULT),
    ] = "",
    notes: Annotated[
        Path | None,
        options.valued("--notes", "FILE", "Text file shown at the top of the page.", RESULT),
    ] = None,
    point: options.Point = None,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
) -> None:
    """Write one self-contained HTML page: figures, comparison, certificates, every run."""
    from eqt_cli import api
    from eqt_cli.core.files import text_of

    result = options.the_one("report", [result, *(more or ())])

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
    )
    size = path.stat().st_size
    text = f"report   {path}  ({size / 1e6:.1f} MB)"
    print_found({"report": str(path), "bytes": size}, text, json=json)
