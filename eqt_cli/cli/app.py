"""The tree of commands."""

import os
import sys
from collections.abc import Callable
from typing import Annotated, Any

import typer

from eqt_cli.cli import (
    animate,
    cite,
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
from eqt_cli.cli.shared.help import COMPUTE, LOOK_UP, READ, Command, Group, example
from eqt_cli.cli.shared.streams import drop_stdout
from eqt_cli.cli.shared.usage import in_words
from eqt_cli.core.version import __version__

MOST_COLUMNS = 1000
"""Maximum width assumed of the terminal, since lines are padded with spaces to their width."""


class _Commands(Group):
    """The commands; a reader may close their output early."""

    def main(self, *args: Any, **extra: Any) -> Any:
        """Run a command, with the width of the terminal limited to a plausible one."""
        columns = os.environ.get("COLUMNS", "")
        if columns.isdecimal() and (len(columns) > 9 or int(columns) > MOST_COLUMNS):
            os.environ["COLUMNS"] = str(MOST_COLUMNS)
        return super().main(*args, **extra)

    def make_context(self, *args: Any, **extra: Any) -> Any:
        """Read the options of eqt itself."""
        with in_words():
            return super().make_context(*args, **extra)

    def invoke(self, ctx: Any) -> Any:
        try:
            try:
                with in_words():
                    return super().invoke(ctx)
            finally:
                sys.stdout.flush()
        except BrokenPipeError as error:  # the reader of our output has left, as `head` does
            # Writing the rest at the end of the process must not fail again.
            drop_stdout()
            raise typer.Exit(getattr(error.__context__, "exit_code", 0)) from None


app = typer.Typer(
    name="eqt",
    cls=_Commands,
    help="Experiments with equivariant tracking control on matrix Lie groups: from YAML to figure.",
    epilog=example("eqt", "run configs/paper.yaml"),
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


def _add(name: str, command: Callable[..., None], group: str, arguments: str) -> None:
    """Add a command, with arguments for the example in its help."""
    epilog = example(f"eqt {name}", arguments)
    app.command(name, cls=Command, rich_help_panel=group, epilog=epilog)(command)


_add("run", run.run, COMPUTE, "configs/paper.yaml --set gains.kp=2")
_add("sweep", sweep.sweep, COMPUTE, "configs/paper.yaml --grid gains.kp=1,2")
_add("tune", tune.tune, COMPUTE, "configs/tune_paper.yaml")
_add("worst", worst.worst, COMPUTE, "late.yaml --fail-above 0.2")
_add("replay", fit.replay, COMPUTE, "model.yaml --measured flown.csv")
_add("fit", fit.fit, COMPUTE, "model.yaml --measured flown.csv --over plant.inertia")
_add("pack", pack.pack, COMPUTE, "results/sweep_gains")
_add("export", export.export, COMPUTE, "configs/paper.yaml --controller eqt --out law")
_add("show", show.show, READ, "results/paper --failed")
_add("compare", compare.compare, READ, "results/paper --metric mean_torque")
_add("diff", diff.diff, READ, "results/paper results/again")
_add("verify", verify.verify, READ, "configs/paper.yaml")
_add("margins", margins.margins, READ, "configs/paper.yaml")
_add("plot", plot.plot, READ, "results/paper --figure torque --format pdf")
_add("animate", animate.animate, READ, "results/paper --run 1 --format gif")
_add("report", report.report, READ, "results/paper --out report.html")
_add("cite", cite.cite, READ, "results/paper > refs.bib")
app.add_typer(config.app, name="config", rich_help_panel=LOOK_UP)
app.add_typer(log.app, name="log", rich_help_panel=LOOK_UP)
_add("list", listing.list_components, LOOK_UP, "controllers")
_add("docs", docs.docs, LOOK_UP, "--address")
