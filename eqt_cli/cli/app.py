"""The tree of commands."""

from __future__ import annotations

import os
import sys
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from eqt_cli.cli import (
    animate,
    compare,
    config,
    listing,
    pack,
    plot,
    report,
    run,
    show,
    sweep,
    tune,
    verify,
)
from eqt_cli.core.errors import InterruptedRun
from eqt_cli.core.interruptions import exit_code
from eqt_cli.core.version import __version__

INTERRUPTED = "interrupted; run the same command again"


class _Commands(TyperGroup):
    """The commands; typer's own answers to signals differ from version to version."""

    def invoke(self, ctx: Any) -> Any:
        try:
            try:
                return super().invoke(ctx)
            finally:
                sys.stdout.flush()
        except BrokenPipeError as error:  # whoever read our output has gone, as `head` does
            # What is left to write at the end of the process must not fail again.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            raise typer.Exit(getattr(error.__context__, "exit_code", 0)) from None
        except KeyboardInterrupt as error:
            # Not for typer, whose own answers differ from version to version.
            raise InterruptedRun(INTERRUPTED, exit_code(error)) from None


app = typer.Typer(
    name="eqt",
    cls=_Commands,
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
        typer.Option(
            "--version", metavar="", callback=_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    """Experiments with equivariant tracking control on matrix Lie groups: from YAML to figure."""


app.command("run")(run.run)
app.command("sweep")(sweep.sweep)
app.command("tune")(tune.tune)
app.command("pack")(pack.pack)
app.command("plot")(plot.plot)
app.command("compare")(compare.compare)
app.command("verify")(verify.verify)
app.command("report")(report.report)
app.command("animate")(animate.animate)
app.command("show")(show.show)
app.command("list")(listing.list_components)
app.add_typer(config.app, name="config")
