"""`eqt pack`: one result file from the parts computed by the shards of a job array."""

from pathlib import Path
from typing import Annotated

import typer

from eqt_cli.cli.shared import options
from eqt_cli.cli.shared.output import say
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

    done = api.pack(folder, trust_plugins=trust_plugins)
    if done.was_complete:
        say(f"{folder} already holds the complete result; there is nothing to pack")
    report(done, json=json)
