"""`eqt cite`: references to cite."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eqt_cli.cli import options
from eqt_cli.cli.output import print_source


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
