"""`eqt report`: a result as one HTML page."""

from pathlib import Path
from typing import Annotated

from eqt_cli.cli.shared import options
from eqt_cli.cli.shared.help import RESULT
from eqt_cli.cli.shared.output import option, print_found, say
from eqt_cli.cli.shared.progress import progress
from eqt_cli.core.errors import EqtError


def report(
    result: options.Result,
    more: options.MoreResults = None,
    out: Annotated[
        Path | None,
        options.valued("--out", "FILE", "File to write. Default: RESULT/report.html.", RESULT),
    ] = None,
    figure: Annotated[list[str] | None, options.figure("Figure to show. Repeatable.")] = None,
    author: Annotated[
        str,
        options.valued("--author", "NAME", "Author, named at the top of the page.", RESULT),
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

    def unverified(error: EqtError) -> None:
        reason = f"the result could not be verified: {error.told(option)}"
        say(f"the page has no certificates; {reason}")

    text = text_of(notes, "write the notes there first") if notes else ""
    with progress(0) as advance:
        path = api.write_report(
            result,
            out,
            figures=figure or (),
            author=author,
            notes=text,
            point=point,
            trust_plugins=trust_plugins,
            workers=options.cores(),
            note=say,
            progress=advance,
            stage=advance.begin,
            unverified=unverified,
        )
    size = path.stat().st_size
    text = f"report   {path}  ({size / 1e6:.1f} MB)"
    print_found({"report": str(path), "bytes": size}, text, json=json)
