"""`eqt pack`: one result file from the parts computed by the shards of a job array."""

from pathlib import Path
from typing import Annotated

import typer

from eqt_cli.cli.shared import options
from eqt_cli.cli.shared.run_and_report import report


def pack(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="Result folder to which all shards wrote.")
    ],
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
) -> None:
    """Join the parts of all shards to one results.h5."""
    from eqt_cli import api

    report(api.pack(folder, trust_plugins=trust_plugins), json=json)
