"""`eqt log`: what recordings contain, and the tracking errors in them."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eqt_cli.base import purposes
from eqt_cli.base.extensions import functions_for, shipped
from eqt_cli.base.files import CONFIG_MARK, write_all
from eqt_cli.base.reporting import significant
from eqt_cli.cli import options, output
from eqt_cli.cli.options import Command, Group, example
from eqt_cli.cli.output import count_of, laid_out, print_findings, say
from eqt_cli.cli.tables import as_csv
from eqt_cli.extensions.logs import FORMATS_BY_SUFFIX
from eqt_cli.extensions.logs.error_options import FORMATS, Errors

if TYPE_CHECKING:
    from eqt_cli.extensions.logs.log_check import LogCheck

FILES = f"Table, log ({', '.join(FORMATS_BY_SUFFIX)}), folder or list of flights."

MOST_GAPS = 5
"""Maximum number of gaps that are listed; further gaps are counted."""

log_app = typer.Typer(
    cls=Group,
    help="Check recordings of a motion, and evaluate tracking errors in them.",
    epilog=example("eqt log", "check flown.csv"),
    no_args_is_help=True,
)


@log_app.callback()
def log() -> None:
    """Check recordings of a motion, and evaluate tracking errors in them."""


@log_app.command("check", cls=Command, epilog=example("eqt log check", "flown.csv"))
def check_log(
    file: Annotated[Path, typer.Argument(metavar="FILE", help=FILES)],
    mapping: Annotated[Path | None, options.option("--mapping")] = None,
    format_: Annotated[str, options.option("--format", names=FORMATS)] = "csv",
    group: Annotated[str | None, options.option("--group")] = None,
    out: Annotated[Path | None, options.option("--out")] = None,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Show what a recording contains; exit 2 if it cannot be used.

    It lists the topics and columns with their meaning, the units, the rate, gaps, inconsistencies,
    and the mapping used. Of a folder, or of a list of flights, it prints a line for each recording,
    and which of them stand twice.

    Options
    -------
    Experiment
        --mapping FILE  YAML file with columns, units, frames and times, as in reference.mapping.
        --format NAME  csv, tum or euroc. Default: by the first row.
        --group NAME  Group of the poses. Default: the one that fits the columns.
    Result
        --out FILE  List of the flights to write, such as flights.csv.
    """
    from eqt_cli import api
    from eqt_cli.extensions.logs.first_bytes import format_of
    from eqt_cli.extensions.logs.flight_list import is_list

    if out is not None or is_list(file) or (file.is_dir() and not format_of(file)):
        _check_flights(file, mapping, format_, out, json)
        return
    checked = api.check_log(file, mapping, format=format_, group=group)
    if json:
        output.print_json(asdict(checked) | {"mapping": checked.mapping})
    else:
        _print_log(checked)
    if checked.problems:
        raise typer.Exit(2)


@log_app.command("errors", cls=Command, epilog=example("eqt log errors", "flown.ulg"))
@options.spread
def log_errors(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Recording, or list of flights.")],
    second: Annotated[Path | None, typer.Argument(metavar="SECOND", help="Desired motion.")] = None,
    mapping: Annotated[Path | None, options.option("--mapping")] = None,
    format_: Annotated[str, options.option("--format", names=FORMATS)] = "csv",
    *,
    how: Errors,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Evaluate the errors from the setpoints: position, velocity, attitude and rates.

    The smoother of measurement and setpoints is interpolated to the instants of the other. Of a
    list of flights, a row for each is printed.

    Options
    -------
    Experiment
        --mapping FILE  YAML file with columns, units, frames and times, as in reference.mapping.
        --format NAME  csv, tum or euroc. Default: by the first row.
        --topic NAME  Topic of the measurement. Default: the first that the file has.
        --setpoint NAME  Topic of the setpoints, or desired for those values of ArduPilot in place
            of its targets. Default: the first that the file has.
        --association NAME  Measurement at the instants: linear, nearest (within 0.01 s) or held.
        --second-mapping FILE  Mapping of SECOND. Default: that of FILE.
        --second-format NAME  Format of SECOND. Default: that of FILE.
        --align NAME  Move the measured positions first: rigid, similarity (both by Umeyama), yaw
            (rigid, about z only) or origin (by the first pose).
        --relative N  Compare the motions over N instants in place of the poses, or over metres of
            the desired path, such as 5m.
        --begin S  First time to compare, s: 12.5 by the clock of the files, +5 from the first row.
        --end S  Last time to compare, as --begin.
        --disarmed  Compare also times while the vehicle was disarmed.
    Result
        --out DIR  Folder for the figure errors, and CSV of the errors over time; of a list, for
            its table, errors.csv.
    """
    from eqt_cli import api
    from eqt_cli.extensions.logs.flight_list import is_list, read_list
    from eqt_cli.extensions.logs.logs import error_table
    from eqt_cli.extensions.logs.many import errors_of_flights

    span = {"begin": how.begin or "-inf", "end": how.end or "inf"}
    if is_list(file):
        every: Any = {"mapping": mapping, "format": format_, "second": second}
        several = errors_of_flights(read_list(file), **vars(how) | span | every | {"out": None})
        document = {"flights": several.rows, "notes": several.notes}
        print_findings(document, laid_out(several.table()), json=json)
        if how.out is not None:
            path = how.out / "errors.csv"
            content = CONFIG_MARK.format("log") + as_csv(several.rows) + "\n"
            write_all({path: content.encode()}, how.out)
            say(f"errors of all flights in {path}")
        return
    errors = api.log_errors(file, second, mapping, format=format_, **vars(how) | span)
    sizes = [one._asdict() for one in errors.sizes]
    document = {"headline": errors.headline, "topics": errors.topics, "sizes": sizes}
    document["notes"] = errors.notes
    print_findings(document, laid_out(error_table(errors)), json=json)
    if how.out is not None:
        say(f"figure and CSV in {how.out}")


def _check_flights(
    file: Path, mapping: Path | None, format_: str, out: Path | None, json: bool
) -> None:
    """Print a line for each flight; exit 2 if one cannot be used."""
    from eqt_cli import api

    check = api.check_flights(file, mapping, format=format_, out=out)
    print_findings({"flights": [x.record for x in check.lines]}, laid_out(check.table()), json=json)
    problems = [line.problem for line in check.lines if line.problem]
    for problem in problems:
        output.complain(problem, "error")
    if out is not None:
        say(f"{len(check.usable)} of {count_of(len(check.lines), 'flight')} in {out}")
    if problems:
        raise typer.Exit(2)


def _print_log(checked: LogCheck) -> None:
    if checked.left_out:
        output.print_text(checked.left_out, "")
    if checked.topics:
        topics = [[*r[:2], f"{r[2]}", significant(r[3]), f"{r[4]}"] for r in checked.topics]
        output.print_text(output.table(["topic", "use", "rows", "rate, Hz", "gaps"], topics), "")
    rows = [
        [
            one.heading,
            one.name or "-",
            one.use,
            f"{one.unit}{' (assumed)' if one.assumed else ''}" or "-",
        ]
        for one in checked.columns
    ]
    output.print_text(output.table(["column", "name", "use", "unit"], rows), "")
    gaps = [f"{length:.4g} s after {begin:.13g} s" for begin, length in checked.gaps[:MOST_GAPS]]
    if len(checked.gaps) > MOST_GAPS:
        gaps.append(f"and {len(checked.gaps) - MOST_GAPS} more")
    lines = [
        f"poses     {checked.group}, format {checked.format}",
        f"rows      {checked.rows}, from {checked.begin:.13g} to {checked.end:.13g} s",
        f"rate      {checked.rate:.4g} Hz",
        f"gaps      {f'{len(checked.gaps)}: ' if gaps else 'none'}{', '.join(gaps)}",
        f"mapping   {checked.mapping}",
    ]
    if checked.norms:
        lines.append("norms     {:.6g} to {:.6g} of quaternions".format(*checked.norms))
    output.print_text("\n".join(lines))
    output.print_text(*(f"note      {note}" for note in checked.notes))
    for problem in checked.problems:
        output.complain(problem, "error")


for add_to in functions_for(purposes.commands_of_log, among=shipped()):
    add_to(log_app)
