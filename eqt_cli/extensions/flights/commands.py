"""`eqt replay`, `eqt fit` and `eqt log compare`: what flights say of a model and of each other."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eqt_cli.base import purposes
from eqt_cli.base.errors import EqtError
from eqt_cli.cli import options, output
from eqt_cli.cli.compare import Gate, Undecided
from eqt_cli.cli.options import Command, example
from eqt_cli.cli.output import laid_out, print_findings, say
from eqt_cli.cli.tables import as_csv, as_latex

if TYPE_CHECKING:
    from eqt_cli.config.document import Document

from eqt_cli.extensions.logs.error_options import FORMATS, QUANTITIES, Errors

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
        --measured FILE  Recording with poses and wrenches, or a list of flights.
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
    from eqt_cli.extensions.flights.prediction import growth_table

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
        --measured FILE  Recording with poses and wrenches, or a list of flights.
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
    from eqt_cli.extensions.flights.plant_fit import fit_tables

    if "=" in over:
        key = over.partition("=")[0].strip()
        raise EqtError(f"--over: expected keys without values, such as '{key}', got '{over}'")
    keys = [key.strip() for key in over.split(",") if key.strip()]
    fitted = api.fit(model.document(config), measured, keys, **vars(recorded), out=model.out)
    numbers, residuals = map(laid_out, fit_tables(fitted))
    findings = plain_data({k: v for k, v in vars(fitted).items() if k != "document"})
    print_findings(findings, numbers, "", residuals, "", str(fitted.config), json=model.json)


@dataclass(frozen=True)
class Confronted:
    """What is compared, and to which flights the model is fitted first."""

    metric: Annotated[str | None, options.option("--metric", names=QUANTITIES)] = None
    lap: Annotated[float | None, options.option("--lap", min=0.0)] = None
    least: Annotated[float, options.option("--least", min=0.0)] = 0.05
    over: Annotated[str | None, options.option("--over")] = None
    hold_out: Annotated[
        str, options.option("--hold-out", names=("setting", "law", "condition", "day"))
    ] = "setting"
    predictions: Annotated[Path | None, options.option("--predictions")] = None
    mapping: options.Mapping = None


def validate(
    flights: Annotated[Path, typer.Argument(metavar="FLIGHTS", help="A list of flights.")],
    of_model: Annotated[Path, options.option("--model")],
    what: Confronted,
    model: Model,
) -> None:
    """Confront predictions of a model with flights, and with rules that need no simulation.

    Each flight is flown again in simulation: its law, along its own setpoints, from its own start.
    The answer is which share of pairs of settings both order likewise, and whether that is more
    than the best rule gives.

    Options
    -------
    Experiment
        --model FILE  Configuration of the vehicle, with the laws of the list by their labels.
        --metric NAME  position or attitude. Default: the first that flights have.
        --lap S  Time of a lap, s; the first is left out. Default: after which setpoints repeat.
        --least X  Least predicted difference of two settings, as a share.
        --over KEYS  Parameters of the plant that are fitted to other flights, as in eqt fit.
        --hold-out NAME  What these others do not have: setting, law, condition or day.
        --predictions FILE  Write the predictions and stop, before you look at the errors; if the
            file is there, compare, and refuse other predictions.
        --mapping FILE  YAML file with columns, units, frames and times, as in reference.mapping.
    Result
        --out DIR  Folder for validation.json, which the key validation of a configuration names.
    """
    from eqt_cli import api
    from eqt_cli.base.option_types import plain_data
    from eqt_cli.extensions.flights.validation import tables

    keys = [key.strip() for key in (what.over or "").split(",") if key.strip()]
    how = {**vars(what), "over": keys, "out": model.out}
    outcome = api.validate(flights, model.document(of_model), **how)
    if outcome is None:
        print_findings(
            {"predictions": str(what.predictions)},
            "predictions written, nothing "
            f"compared: keep {what.predictions}, and run the command again",
            json=model.json,
        )
        return
    blank = [""] if outcome.agreement.notes or outcome.notes else []
    nulls, groups = map(laid_out, tables(outcome))
    pieces: Any = (
        outcome.headline,
        "",
        nulls,
        "",
        groups,
        *blank,
        *outcome.agreement.notes,
        *outcome.notes,
    )
    print_findings(plain_data(outcome.document), *pieces, json=model.json)
    if model.out is not None:
        say(f"statement in {model.out}/validation.json, for the key validation of a configuration")


# `eqt log compare` -------------------------------------------------------------------------------


TWO_SIDES = "new1.ulg new2.ulg --against old1.ulg old2.ulg"
Form = StrEnum("Form", "TEXT CSV LATEX")


@purposes.commands_of_log
def add_to(app: typer.Typer) -> None:
    """Add the command to the group `eqt log`."""
    epilog = example("eqt log compare", TWO_SIDES)
    app.command("compare", cls=_Against, epilog=epilog)(options.spread(compare_flights))
    of_plan = example("eqt log plan", "--effect 0.1 --spread 0.3")
    app.command("plan", cls=Command, epilog=of_plan)(options.spread(plan_flights))
    epilog = example("eqt log identify", "flown.csv --mapping log.yaml")
    app.command("identify", cls=Command, epilog=epilog)(identify_law)


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
    law: Annotated[str, options.option("--law")] = ""
    pair: Annotated[bool, options.option("--pair")] = False
    duplicates: Annotated[bool, options.option("--duplicates")] = False
    within: Annotated[str | None, options.option("--within")] = None
    period: Annotated[float | None, options.option("--period", min=0.0)] = None
    metrics: Annotated[list[str] | None, options.option("--metric", names=QUANTITIES)] = None
    of: Annotated[str, options.option("--of", names=("rms", "median", "largest"))] = "rms"
    negligible: Annotated[float, options.option("--negligible", min=0.0)] = 0.05
    all_parameters: Annotated[bool, options.option("--all-parameters")] = False
    sequential: Annotated[bool, options.option("--sequential")] = False
    normal: Annotated[bool, options.option("--normal")] = False
    model: Annotated[Path | None, options.option("--model")] = None
    by: Annotated[str | None, options.option("--by")] = None
    second: Annotated[Path | None, options.option("--second")] = None
    mapping: Annotated[Path | None, options.option("--mapping")] = None


def compare_flights(
    files: Annotated[
        list[Path], typer.Argument(metavar="A", help="Flights, their folder or list.")
    ],
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
        --against FILE  Flights with the other setting, all files that follow, or their folder; of a
            list of flights, the law of B. Repeatable. Without it, two folders are before and after.
        --law NAME  The law of A in a list of flights. Default: the other one of two.
        --pair  The first file belongs to the first one of --against, and so on; of a list, those
            with the same pair.
        --duplicates  Include recordings of one flight that stand twice.
        --within ORDER  Compare laps of a single file, whose order is such as ABABAB, by --period.
        --period S  Length of a lap, s; the laps of a flight are averaged.
        --metric NAME  position, velocity, attitude or rates. Repeatable. Default: all.
        --of NAME  Size of the errors of a flight: rms, median or largest.
        --negligible X  Relative difference that counts as none.
        --all-parameters  Compare also parameters that an autopilot writes itself, such as CAL_*.
        --sequential  Give an answer that holds at every look, so that you may fly until it is
            decided. Flights are in the order flown.
        --normal  With --sequential: assume normal logarithms of errors.
        --model FILE  Table with columns file and predicted: the error of each flight by a model,
            flown by one law; less differs by chance then.
        --by COLUMN  Of a list of flights: compare all laws with B, in each condition of this column
            and over all.
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
        --out DIR  Folder for the figure flights (with --by, forest), for the looks at these
            flights, and for the errors of all files, which are used again.
    Output
        --format NAME  text, csv with a row per flight or, with --by, per cell, and then latex.
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
    if what.by is not None:
        _print_conditions(files, chosen, vars(how) | span, fail_on, format_, json=json)
        return
    if format_ is Form.LATEX:
        raise EqtError("--format latex belongs to --by; add it, or print text or csv")
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


def _print_conditions(
    files: list[Path],
    chosen: dict[str, Any],
    how: dict[str, Any],
    fail_on: Any,
    format_: Form,
    *,
    json: bool,
) -> None:
    """Print all laws of a list against one, by conditions."""
    from eqt_cli import api

    against = chosen.pop("against", None) or [Path("none")]
    usual = vars(Comparing())
    other = [name for name in ALONE if chosen.pop(name, usual[name]) != usual[name]]
    other += ["fail_on"] if fail_on else []
    if other or len(files) != 1 or len(against) != 1:
        named = ", ".join(f"--{name.replace('_', '-')}" for name in other)
        leave = f"leave out {named}" if named else "name one list, and one law by --against"
        raise EqtError(f"--by compares all laws of a list with one law in each condition; {leave}")
    table = api.compare_conditions(files[0], f"{against[0]}", **chosen, **how)
    if json:
        output.print_json(table.document)
    elif format_ is Form.CSV:
        output.print_verbatim(as_csv(table.records))
    elif format_ is Form.LATEX:
        output.print_verbatim(as_latex(table.table()))
    else:
        output.print_text(laid_out(table.table()))


ALONE = "law", "pair", "within", "all_parameters", "sequential", "normal", "model"
"""Options that compare two laws alone."""


# `eqt log plan` ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Pilot:
    """What is known before the flights of a comparison."""

    pilot: Annotated[Path | None, options.option("--pilot")] = None
    spread: Annotated[float | None, options.option("--spread")] = None
    metric: Annotated[str, options.option("--metric", names=QUANTITIES)] = "position"
    of: Annotated[str, options.option("--of", names=("rms", "median", "largest"))] = "rms"
    period: Annotated[float, options.option("--period", min=0.0)] = 0.0
    model: Annotated[Path | None, options.option("--model")] = None
    second: Annotated[Path | None, options.option("--second")] = None
    mapping: Annotated[Path | None, options.option("--mapping")] = None


def plan_flights(
    effect: Annotated[float, options.option("--effect")],
    what: Pilot,
    log_format: options.LogFormat = "csv",
    *,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Print how many flights show a difference: planned or with looks, in pairs or not.

    Pilot flights say how much errors differ from flight to flight, and whether they drift.

    Options
    -------
    Experiment
        --effect X  Relative difference to be found, such as 0.1 for 10 %.
        --pilot FILE  List of flights of one law or more, in the order flown, or their folder.
        --spread X  Standard deviation of the logarithms of errors, in place of pilot flights.
        --metric NAME  position, velocity, attitude or rates.
        --of NAME  Size of the errors of a flight: rms, median or largest.
        --period S  Length of a lap, s; the laps of a flight are averaged.
        --model FILE  Table with columns file and predicted: the error of each flight by a model.
        --second FILE  Desired motion of all flights. Default: the setpoints in their files.
        --mapping FILE  YAML file with columns, units, frames and times, as in reference.mapping.
    """
    from eqt_cli import api
    from eqt_cli.extensions.flights.planning import record_of

    plan = api.plan_flights(effect, **vars(what), format=log_format)
    print_findings(record_of(plan), laid_out(plan.table()), json=json)


# `eqt log identify` ------------------------------------------------------------------------------


def identify_law(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE", help="Flights of one law, a folder or list.")
    ],
    mapping: Annotated[Path | None, options.option("--mapping")] = None,
    format_: Annotated[str, options.option("--format", names=FORMATS)] = "csv",
    law: Annotated[str, options.option("--law")] = "",
    period: Annotated[float, options.option("--period", min=0.0)] = 0.0,
    mass: Annotated[float, options.option("--mass", min=0.0)] = 0.0,
    second: Annotated[Path | None, options.option("--second")] = None,
    begin: Annotated[str | None, options.option("--begin")] = None,
    end: Annotated[str | None, options.option("--end")] = None,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Identify the law that flew: its terms, gains and delay, from state, setpoints and commands.

    A position loop commands an acceleration, or a thrust with an attitude setpoint; an attitude
    loop a torque. Each gain has a 95 % interval, or is not identifiable from this motion.

    Options
    -------
    Experiment
        --mapping FILE  YAML file with columns, commands, units, frames and times.
        --format NAME  csv, tum or euroc. Default: by the first row.
        --law NAME  The law in a list of flights of several ones.
        --period S  Length of a lap, s: other laps then remove noise that is correlated in time.
        --mass KG  Mass by which a thrust in N is divided. Default: gains are in N.
        --second FILE  Desired motion. Default: the setpoints in the files.
        --begin S  First time, s: 12.5 by the clock of a file, +5 from its first row.
        --end S  Last time, as --begin.
    """
    from eqt_cli import api

    span: Any = {"begin": begin or "-inf", "end": end or "inf", "second": second}
    more: Any = {"law": law, "period": period, "mass": mass, "format": format_}
    laws = api.identify_law(files, mapping, **more, **span)
    pieces = [piece for table in laws.tables() for piece in ("", laid_out(table))]
    notes = ["", *laws.notes] if laws.notes else []
    print_findings(laws.document, *laws.headlines(), *pieces, *notes, json=json)
