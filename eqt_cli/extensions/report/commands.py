"""`eqt animate` and `eqt report`: one run as a moving picture, and a result as one HTML page."""

from pathlib import Path
from typing import Annotated

import typer

from eqt_cli.base.errors import EqtError
from eqt_cli.base.files import text_of
from eqt_cli.cli import completion, options
from eqt_cli.cli.output import print_findings


def animate(
    result: options.Result,
    run: Annotated[int, options.option("--run")] = 0,
    controller: options.Controllers = None,
    seconds: Annotated[float, options.option("--seconds", min=0.2, max=120)] = 8.0,
    out: options.Out = None,
    point: options.Point = None,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Animate one run as a GIF: bodies, tracking error and torque over time.

    Options
    -------
    What to show
        --run K  Run, counted from 0.
    Result
        --seconds S  Duration of the GIF in seconds.
        --out DIR  Output folder. Default: RESULT/figures.
    """
    from eqt_cli import api

    path = api.animate(
        result,
        run,
        controller or (),
        out,
        seconds=seconds,
        point=point,
        trust_plugins=trust_plugins,
    )
    text = f"animation  {path}  ({path.stat().st_size / 1e6:.1f} MB)"
    print_findings({"files": [str(path)]}, text, json=json)


def report(
    result: options.Result,
    # Surplus results, accepted so that the command can say what to do instead.
    more: Annotated[list[Path] | None, typer.Argument(metavar="", hidden=True)] = None,
    out: Annotated[Path | None, options.option("--out")] = None,
    figure: Annotated[list[str] | None, options.option("--figure", names="figures")] = None,
    against: Annotated[str, options.option("--against", autocompletion=completion.laws)] = "",
    title: Annotated[str, options.option("--title")] = "",
    author: Annotated[str, options.option("--author")] = "",
    date: Annotated[str, options.option("--date")] = "",
    notes: Annotated[Path | None, options.option("--notes")] = None,
    quick: Annotated[bool, options.option("--quick")] = False,
    live: Annotated[bool, options.option("--live")] = False,
    point: options.Point = None,
    unit: options.Units = None,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Write one self-contained HTML page: figures, comparison, certificates, every run.

    Options
    -------
    Result
        --out FILE  File to write. Default: RESULT/report.html.
        --title TEXT  Title. Default: the first sentence of the configuration's first comment.
        --author NAME  Author, named at the top of the page.
        --date TEXT  Date. Default: the day of the run.
        --notes FILE  Text file shown at the top of the page.
    What to show
        --figure NAME  Figure to show. Repeatable.
        --against LAW  Compare with this law instead of the first.
        --quick  Leave out the certificates, for which some runs are integrated again.
        --live  Begin with sliders that run the experiment again in the browser, as `eqt live`.
    """
    from eqt_cli import api

    if more:
        both = " ".join(map(str, [result, *more]))
        raise EqtError(
            f"report takes one result; `eqt compare` compares two, and `eqt plot {both}` draws all "
            "in one figure"
        )

    text = text_of(notes, "write the notes there first") if notes else ""
    path = api.report(
        result,
        out,
        figures=figure or (),
        against=against,
        title=title,
        author=author,
        date=date,
        notes=text,
        point=point,
        trust_plugins=trust_plugins,
        workers=options.cores(),
        quick=quick,
        live=live,
        units=unit or (),
    )
    size = path.stat().st_size
    text = f"report   {path}  ({size / 1e6:.1f} MB)"
    print_findings({"report": str(path), "bytes": size}, text, json=json)
