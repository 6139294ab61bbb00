"""`eqt log`: recordings of a motion."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eqt_cli.cli.shared import completion, options
from eqt_cli.cli.shared.options import Command, Group, example
from eqt_cli.cli.shared.output import complain, print_json, print_text, table

if TYPE_CHECKING:
    from eqt_cli.logs.check import LogCheck

MOST_GAPS = 5
"""Maximum number of gaps that are listed; further gaps are counted."""

app = typer.Typer(
    cls=Group,
    help="Look at recordings of a motion.",
    epilog=example("eqt log", "check flown.csv"),
    no_args_is_help=True,
)


@app.callback()
def log() -> None:
    """Look at recordings of a motion."""


@app.command("check", cls=Command, epilog=example("eqt log check", "flown.csv"))
def check(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="Recording: CSV, TUM, EuRoC or PX4 (.ulg).")
    ],
    mapping: Annotated[Path | None, options.option("--mapping")] = None,
    format_: Annotated[
        str, options.option("--format", autocompletion=completion.words("csv", "tum", "euroc"))
    ] = "csv",
    group: Annotated[str | None, options.option("--group")] = None,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Say what a recording holds; exit 2 if it cannot be used.

    It names each column and what it is taken for, the units, the rate, the gaps, and what does not
    fit together.

    Options
    -------
    Experiment
        --mapping FILE  YAML file with columns, units, frames and times, as in reference.mapping.
        --format NAME  csv, tum or euroc. Default: csv.
        --group NAME  Group of the poses. Default: what fits the columns.
    """
    from eqt_cli import api

    found = api.check_log(file, mapping, format=format_, group=group)
    if json:
        print_json(asdict(found))
    else:
        _print(found)
    if found.problems:
        raise typer.Exit(2)


def _print(found: LogCheck) -> None:
    rows = [
        [one.heading, one.name or "-", one.use, f"{one.unit}{' (assumed)' * one.assumed}" or "-"]
        for one in found.columns
    ]
    print_text(table(["column", "name", "use", "unit"], rows), "")
    lines = [
        f"poses     {found.group}, format {found.format}",
        f"rows      {found.rows}, from {found.begin:.9g} to {found.end:.9g} s",
        f"rate      {found.rate:.4g} Hz",
        f"gaps      {_gaps(found)}",
    ]
    if found.norms:
        lines.append("norms     {:.6g} to {:.6g} of quaternions".format(*found.norms))
    print_text("\n".join(lines))
    print_text(*(f"note      {note}" for note in found.notes))
    for problem in found.problems:
        complain(problem)


def _gaps(found: LogCheck) -> str:
    listed = [f"{length:.4g} s after {begin:.6g} s" for begin, length in found.gaps[:MOST_GAPS]]
    more = len(found.gaps) - len(listed)
    also = f", and {more} more" if more else ""
    return f"{len(found.gaps)}: {', '.join(listed)}{also}" if listed else "none"
