"""The tree of commands."""

import os
import sys
from collections.abc import Callable
from typing import Annotated, Any

import typer

from eqt_cli.cli import (
    animate,
    compare,
    config,
    diff,
    docs,
    export,
    fit,
    listing,
    log,
    margins,
    pack,
    plot,
    report,
    run,
    show,
    sweep,
    tune,
    verify,
    worst,
)
from eqt_cli.cli.shared.help import COMPUTE, LOOK_UP, READ, Command, Group
from eqt_cli.cli.shared.streams import drop_stdout
from eqt_cli.core.version import __version__

MOST_COLUMNS = 1000
"""Of the terminal: who lays out lines fills all of their width with spaces."""


class _Commands(Group):
    """The commands, whose output somebody may stop reading."""

    def main(self, *args: Any, **extra: Any) -> Any:
        """Run a command, for a terminal of a width that can be."""
        columns = os.environ.get("COLUMNS", "")
        if columns.isdecimal() and (len(columns) > 9 or int(columns) > MOST_COLUMNS):
            os.environ["COLUMNS"] = str(MOST_COLUMNS)
        return super().main(*args, **extra)

    def invoke(self, ctx: Any) -> Any:
        try:
            try:
                return super().invoke(ctx)
            finally:
                sys.stdout.flush()
        except BrokenPipeError as error:  # whoever read our output has gone, as `head` does
            # What is left to write at the end of the process must not fail again.
            drop_stdout()
            raise typer.Exit(getattr(error.__context__, "exit_code", 0)) from None


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


def _add(name: str, command: Callable[..., None], group: str) -> None:
    app.command(name, cls=Command, rich_help_panel=group)(command)


_add("run", run.run, COMPUTE)
_add("sweep", sweep.sweep, COMPUTE)
_add("tune", tune.tune, COMPUTE)
_add("worst", worst.worst, COMPUTE)
_add("replay", fit.replay, COMPUTE)
_add("fit", fit.fit, COMPUTE)
_add("pack", pack.pack, COMPUTE)
_add("export", export.export, COMPUTE)
_add("show", show.show, READ)
_add("compare", compare.compare, READ)
_add("diff", diff.diff, READ)
_add("verify", verify.verify, READ)
_add("margins", margins.margins, READ)
_add("plot", plot.plot, READ)
_add("animate", animate.animate, READ)
_add("report", report.report, READ)
app.add_typer(config.app, name="config", rich_help_panel=LOOK_UP)
app.add_typer(log.app, name="log", rich_help_panel=LOOK_UP)
_add("list", listing.list_components, LOOK_UP)
_add("docs", docs.docs, LOOK_UP)
