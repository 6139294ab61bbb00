"""`eqt replay`, `eqt fit` and `eqt log`: recordings."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import asdict, dataclass
from enum import StrEnum
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eqt_cli.base.errors import EqtError
from eqt_cli.base.reporting import significant
from eqt_cli.cli import options, output
from eqt_cli.cli.compare import Gate, Undecided
from eqt_cli.cli.options import Command, Group, example
from eqt_cli.cli.output import laid_out, print_findings, say
from eqt_cli.cli.tables import as_csv
from eqt_cli.extensions.recordings import FORMATS_BY_SUFFIX

if TYPE_CHECKING:
    from eqt_cli.config.document import Document
    from eqt_cli.extensions.recordings.logs import LogCheck

Measured = Annotated[Path, options.option("--measured")]


@dataclass(frozen=True)
class Recorded:
    """How a recording and the wrench in it are read."""

    mapping: options.Mapping = None
    format: options.LogFormat = "csv"
    hold: Annotated[str, options.option("--hold", names=("zero", "linear"))] = "zero"
    delay: Annotated[float, options.option("--delay")] = 0.0
    horizon: Annotated[float | None, options.option("--horizon")] = None


@dataclass(frozen=True)
class Model:
    """The changes of the model, the folder of the outcome, and what is printed."""

    set_: options.Set = None
    engine: options.Engine = None
    out: options.Out = None
    trust_plugins: options.TrustPlugins = False
    json: options.Json = False
    quiet: options.Quiet = False

    def document(self, config: Path) -> Document:
        """Return the configuration with the changes, not yet checked."""
        trusted = self.trust_plugins
        return options.document_of(config, self.set_, self.engine, trust_plugins=trusted)


def replay(
    config: options.Config,
    measured: Measured,
    recorded: Recorded,
    windows: Annotated[int, options.option("--windows", min=1)] = 50,
    *,
    model: Model,
) -> None:
    """Replay a recorded wrench and print the prediction error against the horizon.

    Each window starts at a recorded state. The control laws of the configuration are not used.

    Options
    -------
    Experiment
        --measured FILE  Recording with poses and wrenches.
        --hold NAME  The wrench between two rows: zero holds the earlier one, as an autopilot
            does; linear interpolates.
        --delay S  Delay with which the wrench was recorded, s.
        --horizon S  Length of a window, s. Default: a tenth of the recording.
        --windows N  Largest number of windows.
    Result
        --out DIR  Folder for the figure replay.
    """
    from eqt_cli import api
    from eqt_cli.base.option_types import plain_data
    from eqt_cli.extensions.recordings.prediction import growth_table

    how = {**vars(recorded), "windows": windows, "out": model.out}
    growth = api.replay(model.document(config), measured, **how)
    print_findings(plain_data(growth), laid_out(growth_table(growth)), json=model.json)
    if model.out is not None:
        say(f"figure in {model.out}")


def fit(
    config: options.Config,
    measured: Measured,
    over: Annotated[str, options.option("--over")],
    recorded: Recorded,
    model: Model,
) -> None:
    """Estimate parameters of the plant from a recording, with 95 % intervals.

    The configuration with the fitted numbers is written to results/NAME-fitted/fitted.yaml.

    Options
    -------
    Experiment
        --measured FILE  Recording with poses and wrenches.
        --hold NAME  The wrench between two rows: zero holds the earlier one, as an autopilot
            does; linear interpolates.
        --delay S  Delay with which the wrench was recorded, s.
        --over KEYS  Parameters of the plant to estimate, separated by commas, such as
            plant.inertia.relative,plant.forces[0].linear; delay is the delay of the wrench.
        --horizon S  Length of a window, s. Default: a twentieth of the recording.
    Result
        --out DIR  Folder for fitted.yaml.
    """
    from eqt_cli import api
    from eqt_cli.base.option_types import plain_data
    from eqt_cli.extensions.recordings.plant_fit import fit_tables

    if "=" in over:
        key = over.partition("=")[0].strip()
        raise EqtError(f"--over: expected keys without values, such as '{key}', got '{over}'")
    keys = [key.strip() for key in over.split(",") if key.strip()]
    fitted = api.fit(model.document(config), measured, keys, **vars(recorded), out=model.out)
    numbers, residuals = map(laid_out, fit_tables(fitted))
    findings = plain_data({k: v for k, v in vars(fitted).items() if k != "document"})
    print_findings(findings, numbers, "", residuals, "", str(fitted.config), json=model.json)


# `eqt log` ----------------------------------------------------------------------------------------


FORMATS = "csv", "tum", "euroc"
QUANTITIES = "position", "velocity", "attitude", "rates"
ASSOCIATIONS = "linear", "nearest", "held"
ALIGNMENTS = "rigid", "similarity", "yaw", "origin"

TWO_SIDES = "new1.ulg new2.ulg --against old1.ulg old2.ulg"
Form = StrEnum("Form", "TEXT CSV")
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
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help=f"Table, or log: {', '.join(FORMATS_BY_SUFFIX)}.")
    ],
    mapping: Annotated[Path | None, options.option("--mapping")] = None,
    format_: Annotated[str, options.option("--format", names=FORMATS)] = "csv",
    group: Annotated[str | None, options.option("--group")] = None,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Show what a recording contains; exit 2 if it cannot be used.

    It lists the topics and columns with their meaning, the units, the rate, gaps, inconsistencies,
    and the mapping used.

    Options
    -------
    Experiment
        --mapping FILE  YAML file with columns, units, frames and times, as in reference.mapping.
        --format NAME  csv, tum or euroc. Default: by the first row.
        --group NAME  Group of the poses. Default: the one that fits the columns.
    """
    from eqt_cli import api

    checked = api.check_log(file, mapping, format=format_, group=group)
    if json:
        output.print_json(asdict(checked) | {"mapping": checked.mapping})
    else:
        _print_log(checked)
    if checked.problems:
        raise typer.Exit(2)


@dataclass(frozen=True)
class Errors:
    """Which motions are compared, when and how, and the folder of the outcome."""

    second_mapping: Annotated[Path | None, options.option("--second-mapping")] = None
    second_format: Annotated[str | None, options.option("--second-format", names=FORMATS)] = None
    topic: Annotated[str | None, options.option("--topic")] = None
    setpoint: Annotated[str | None, options.option("--setpoint")] = None
    association: Annotated[str, options.option("--association", names=ASSOCIATIONS)] = "linear"
    align: Annotated[str | None, options.option("--align", names=ALIGNMENTS)] = None
    relative: Annotated[str | None, options.option("--relative")] = None
    begin: Annotated[str | None, options.option("--begin")] = None
    end: Annotated[str | None, options.option("--end")] = None
    disarmed: Annotated[bool, options.option("--disarmed")] = False
    out: options.Out = None


@log_app.command("errors", cls=Command, epilog=example("eqt log errors", "flown.ulg"))
@options.spread
def log_errors(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Recording, as for eqt log check.")],
    second: Annotated[Path | None, typer.Argument(metavar="SECOND", help="Desired motion.")] = None,
    mapping: Annotated[Path | None, options.option("--mapping")] = None,
    format_: Annotated[str, options.option("--format", names=FORMATS)] = "csv",
    *,
    how: Errors,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Evaluate the errors from the setpoints: position, velocity, attitude and rates.

    The smoother of measurement and setpoints is interpolated to the instants of the other.

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
        --out DIR  Folder for the figure errors, and CSV of the errors over time.
    """
    from eqt_cli import api
    from eqt_cli.extensions.recordings.logs import error_table

    span = {"begin": how.begin or "-inf", "end": how.end or "inf"}
    errors = api.log_errors(file, second, mapping, format=format_, **vars(how) | span)
    sizes = [one._asdict() for one in errors.sizes]
    document = {"headline": errors.headline, "topics": errors.topics, "sizes": sizes}
    document["notes"] = errors.notes
    print_findings(document, laid_out(error_table(errors)), json=json)
    if how.out is not None:
        say(f"figure and CSV in {how.out}")


class _Against(Command):
    """A command whose option --against takes all files that follow it."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Repeat the option before each of these files."""
        at = args.index("--against") + 1 if "--against" in args else len(args)
        files = list(takewhile(lambda word: not word.startswith("-"), args[at:]))
        repeated = [word for file in files[1:] for word in ("--against", file)]
        return super().parse_args(
            ctx, [*args[:at], *files[:1], *repeated, *args[at + len(files) :]]
        )


@dataclass(frozen=True)
class Comparing:
    """Which flights or laps belong together, and what is compared."""

    against: Annotated[list[Path] | None, options.option("--against")] = None
    pair: Annotated[bool, options.option("--pair")] = False
    within: Annotated[str | None, options.option("--within")] = None
    period: Annotated[float | None, options.option("--period", min=0.0)] = None
    metrics: Annotated[list[str] | None, options.option("--metric", names=QUANTITIES)] = None
    of: Annotated[str, options.option("--of", names=("rms", "median", "largest"))] = "rms"
    negligible: Annotated[float, options.option("--negligible", min=0.0)] = 0.05
    all_parameters: Annotated[bool, options.option("--all-parameters")] = False
    second: Annotated[Path | None, options.option("--second")] = None
    mapping: Annotated[Path | None, options.option("--mapping")] = None


@log_app.command("compare", cls=_Against, epilog=example("eqt log compare", TWO_SIDES))
@options.spread
def compare_flights(
    files: Annotated[list[Path], typer.Argument(metavar="A", help="Flights, or their folder.")],
    what: Comparing,
    log_format: options.LogFormat = "csv",
    *,
    how: Errors,
    rules: Annotated[Gate, {"law", "same"}],
    format_: Annotated[Form, options.option("--format")] = Form.TEXT,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Compare the errors of flights with one setting, A, against those with another, B.

    It prints what else differs, such as parameters in the logs, and for each quantity the ratio of
    the errors, with its interval. A flight counts once, however many laps it has.

    Options
    -------
    What to show
        --against FILE  Flights with the other setting, all files that follow, or their folder.
            Repeatable.
        --pair  The first file belongs to the first one of --against, and so on.
        --within ORDER  Compare laps of a single file, whose order is such as ABABAB, by --period.
        --period S  Length of a lap, s; the laps of a flight are averaged.
        --metric NAME  position, velocity, attitude or rates. Repeatable. Default: all.
        --of NAME  Size of the errors of a flight: rms, median or largest.
        --negligible X  Relative difference that counts as none.
        --all-parameters  Compare also parameters that an autopilot writes itself, such as CAL_*.
    Experiment
        --second FILE  Desired motion of all flights. Default: the setpoints in their files.
        --second-mapping FILE  Mapping of the desired motion. Default: that of the flights.
        --second-format NAME  Format of the desired motion. Default: that of the flights.
        --mapping FILE  YAML file with columns, units, frames and times, as in reference.mapping.
        --topic NAME  Topic of the measurement. Default: the first that a file has.
        --setpoint NAME  Topic of the setpoints, or desired for those values of ArduPilot in place
            of its targets. Default: the first that a file has.
        --association NAME  Measurement at the instants: linear, nearest (within 0.01 s) or held.
        --align NAME  Move the measured positions first: rigid, similarity, yaw or origin.
        --relative N  Compare the motions over N instants in place of the poses, or over metres of
            the desired path, such as 5m.
        --begin S  First time to compare, s: 12.5 by the clock of a file, +5 from its first row.
        --end S  Last time to compare, as --begin.
        --disarmed  Compare also times while the vehicle was disarmed.
    Result
        --out DIR  Folder for the figure flights.
    Output
        --format NAME  text, or csv with a row per flight.
    Two settings
        --fail-on RULE  What must not be: 'position worse by 10 %', or worse (by the words of the
            comparison). Repeatable.
        --undecided WORD  fail or pass, where a rule is not shown to hold.
    """
    from eqt_cli import api
    from eqt_cli.analysis.gate import outcome

    fail_on, is_open = rules.arguments(files[0])["fail_on"], rules.undecided is Undecided.PASS
    span = {"begin": how.begin or "-inf", "end": how.end or "inf", "format": log_format}
    chosen: Any = {name: value for name, value in vars(what).items() if value is not None}
    both = api.compare_flights(files, **chosen, **vars(how) | span, fail_on=fail_on or ())
    passes, record, lines = outcome(both.findings, undecided=is_open)
    lines = [*lines, ""] if fail_on else []
    with suppress(BrokenPipeError):  # the exit code is also for those whose reader has left
        if json:
            output.print_json(({"gate": record} if fail_on else {}) | both.document)
        elif format_ is Form.CSV:
            output.print_verbatim(as_csv([flight.record for flight in both.flights]))
        else:
            blank = [""] if both.premises else []
            ratios, flights = map(laid_out, both.tables())
            output.print_text(*lines, *both.premises, *blank, ratios, "", flights)
    if not passes:
        raise typer.Exit(4)


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
