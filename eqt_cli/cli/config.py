"""`eqt config` and `eqt log`: configurations, and recordings of a motion."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eqt_cli.cli.shared import completion, options, output
from eqt_cli.cli.shared.options import Command, Group, example
from eqt_cli.config import shipped
from eqt_cli.core.errors import ConfigError, EqtError, Problems
from eqt_cli.core.files import new_file, refusals

if TYPE_CHECKING:
    from eqt_cli.experiment.study import Study
    from eqt_cli.logs.check import LogCheck


MOST_CHECKED = 300
"""Maximum number of points of a sweep that are checked, spread over all of them."""

app = typer.Typer(
    cls=Group,
    help="Write, check and describe configurations.",
    epilog=example("eqt config", "keys gains.kp"),
    no_args_is_help=True,
)


@app.command("new", cls=Command, epilog=example("eqt config new", "mine.yaml --from paper"))
def new(
    file: Annotated[
        Path | None,
        typer.Argument(metavar="FILE", help="File to write, or - for stdout. Default: NAME.yaml."),
    ] = None,
    source: Annotated[str, options.option("--from", autocompletion=completion.shipped)] = "paper",
    quiet: options.Quiet = False,
) -> None:
    """Create a configuration of your own from a shipped one.

    Options
    -------
    Experiment
        --from NAME  Shipped configuration to start from.
    """
    text = shipped.text(source)
    if file == Path("-"):
        output.print_verbatim(text)
        return
    file = file or Path(f"{source}.yaml")
    with refusals(file, "written"):
        file.parent.mkdir(parents=True, exist_ok=True)
        try:
            new_file(file, text.encode())
        except FileExistsError:
            raise EqtError(f"{file}: already exists; give another name, or remove it") from None
    output.print_text(str(file))
    output.say(f"next: eqt run {file}")


@app.command("check", cls=Command, epilog=example("eqt config check", "mine.yaml --set gains.kp=2"))
def check(
    config: Annotated[
        Path, typer.Argument(metavar="CONFIG", help="YAML configuration, or a result.")
    ],
    set_: options.Set = None,
    resolved: Annotated[bool, options.option("--resolved")] = False,
    most_torque: Annotated[float | None, options.option("--most-torque")] = None,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Check a configuration, and its reference over the whole horizon, without running it.

    It executes the plugins of a YAML configuration, and those of a result only on request.

    Options
    -------
    Output
        --resolved  Print the configuration with all defaults.
    Experiment
        --most-torque TORQUE  Report an error if the reference needs a larger torque.
    """
    from eqt_cli.config.yaml_source import dump
    from eqt_cli.execution.cost import check_resources
    from eqt_cli.execution.rehearsal import rehearse
    from eqt_cli.experiment.horizon import (
        check_reference,
        reference_over_horizon,
        remarks,
        wheels_needed,
    )
    from eqt_cli.experiment.read_study import study

    source = options.source_of(config, set_)
    try:
        checked = study(source, trust_plugins=trust_plugins, most_checked=MOST_CHECKED)
        check_resources(checked, Path("results") / checked.name, most_shapes=MOST_CHECKED)
        problems = Problems(source.place)
        shown = reference_over_horizon(checked.base)
        jumps = check_reference(shown, most_torque, problems.at("reference"))
        problems.raise_if_any()
        untried = rehearse(checked, problems)
        problems.raise_if_any()
        if source.data.get("tune"):
            from eqt_cli.tuning.tune import Search

            Search.read(source, trust_plugins=trust_plugins)
        if source.data.get("worst"):
            from eqt_cli.tuning.worst import WorstSearch

            WorstSearch.read(source, trust_plugins=trust_plugins)
    except ConfigError as error:
        if not json:
            raise
        output.print_json(_document(config, output.problem_records(error.problems)))
        raise typer.Exit(error.exit_code) from error
    if resolved:
        output.print_source(checked.resolved, dump(checked.resolved), json=json)
        return
    experiment = checked.base
    for remark in remarks(experiment, shown):
        output.warn(remark)
    if not json:
        output.say(f"{config}: valid")
    if len(checked) > MOST_CHECKED and not json:
        output.say(
            f"{config}: {MOST_CHECKED} of its {len(checked)} points were checked; a run checks all"
        )
    text = (
        f"{experiment.name}: {experiment.group.name}, "
        + (f"{len(checked)} points × " if checked.sweep else "")
        + f"{output.count_of(len(experiment.loops), 'controller')} × "
        f"{output.count_of(experiment.config.ensemble.runs, 'run')}, "
        f"{experiment.config.time.duration:g} s, engine {experiment.engine.name}"
    )
    wheels = wheels_needed(experiment, shown)
    needed = [] if wheels is None else [f"wheels need up to {wheels.in_words}, by the reference"]
    text = "\n".join([text, *needed, *(f"reference: {jump}" for jump in jumps), *untried])
    output.print_found(_document(config, [], checked), text, json=json)


def _document(
    path: Path, problems: list[dict[str, str]], study: Study | None = None
) -> dict[str, Any]:
    """Return the findings of `check` for programs: an editor, or continuous integration."""
    record: dict[str, Any] = {"config": str(path), "fine": not problems, "problems": problems}
    if study is None:
        return record
    config = study.base.config
    return record | {
        "name": study.name,
        "group": study.base.group.name,
        "points": len(study),
        "controllers": list(study.base.loops),
        "runs": config.ensemble.runs,
        "duration": config.time.duration,
        "engine": study.base.engine.name,
    }


@app.command("keys", cls=Command, epilog=example("eqt config keys", "gains.kp"))
def keys(
    key: Annotated[
        str | None,
        typer.Argument(
            metavar="KEY",
            autocompletion=completion.keys,
            help="A key such as gains.kp, or a section such as gains. Default: all.",
        ),
    ] = None,
    json: options.Json = False,
) -> None:
    """Describe the keys of a configuration: value, default and meaning."""
    from eqt_cli.config.json_schema import json_schema, keys_of, within

    listed = keys_of(json_schema())
    if key is not None:
        listed = within(listed, key)
    rows = [[text.replace("`", "") for text in asdict(each).values()] for each in listed]
    output.print_records(["key", "value", "default", "meaning"], rows, json=json)


@app.command("schema", cls=Command, epilog=example("eqt config schema", "> eqt.schema.json"))
def schema() -> None:
    """Print the JSON schema of configurations, which editors use for completion and checks."""
    from eqt_cli.config.json_schema import json_schema

    output.print_json(json_schema())


# Recordings ---------------------------------------------------------------------------------------


MOST_GAPS = 5
"""Maximum number of gaps that are listed; further gaps are counted."""

log_app = typer.Typer(
    cls=Group,
    help="Look at recordings of a motion.",
    epilog=example("eqt log", "check flown.csv"),
    no_args_is_help=True,
)


@log_app.callback()
def log() -> None:
    """Look at recordings of a motion."""


@log_app.command("check", cls=Command, epilog=example("eqt log check", "flown.csv"))
def check_log(
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

    checked = api.check_log(file, mapping, format=format_, group=group)
    if json:
        output.print_json(asdict(checked))
    else:
        _print_log(checked)
    if checked.problems:
        raise typer.Exit(2)


def _print_log(checked: LogCheck) -> None:
    rows = [
        [one.heading, one.name or "-", one.use, f"{one.unit}{' (assumed)' * one.assumed}" or "-"]
        for one in checked.columns
    ]
    output.print_text(output.table(["column", "name", "use", "unit"], rows), "")
    lines = [
        f"poses     {checked.group}, format {checked.format}",
        f"rows      {checked.rows}, from {checked.begin:.9g} to {checked.end:.9g} s",
        f"rate      {checked.rate:.4g} Hz",
        f"gaps      {_gaps(checked)}",
    ]
    if checked.norms:
        lines.append("norms     {:.6g} to {:.6g} of quaternions".format(*checked.norms))
    output.print_text("\n".join(lines))
    output.print_text(*(f"note      {note}" for note in checked.notes))
    for problem in checked.problems:
        output.complain(problem)


def _gaps(checked: LogCheck) -> str:
    listed = [f"{length:.4g} s after {begin:.6g} s" for begin, length in checked.gaps[:MOST_GAPS]]
    more = len(checked.gaps) - len(listed)
    also = f", and {more} more" if more else ""
    return f"{len(checked.gaps)}: {', '.join(listed)}{also}" if listed else "none"
