"""`eqt cite`: references to cite with a result."""

from pathlib import Path
from typing import Annotated

import typer

from eqt_cli.cli.shared import options
from eqt_cli.cli.shared.output import print_json, print_verbatim


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
    if json:
        print_json({"bibtex": entries.split("\n\n")})
    else:
        print_verbatim(entries)
