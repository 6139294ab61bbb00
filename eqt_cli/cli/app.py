"""The tree of commands."""

from __future__ import annotations

from typing import Annotated

import typer

from eqt_cli import __version__
from eqt_cli.cli import config, listing, plot, run, show

app = typer.Typer(
    name="eqt",
    help="Experiments with equivariant tracking control on matrix Lie groups: from YAML to figure.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"eqt {__version__}")
        raise typer.Exit


@app.callback()
def main(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_version, is_eager=True, help="Print the version."),
    ] = False,
) -> None:
    """Experiments with equivariant tracking control on matrix Lie groups: from YAML to figure."""


app.command("run")(run.run)
app.command("plot")(plot.plot)
app.command("show")(show.show)
app.command("list")(listing.list_components)
app.add_typer(config.app, name="config")
