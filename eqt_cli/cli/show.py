"""`eqt show` and `eqt results`: the contents of a result, and the results in a folder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eqt_cli.base import purposes
from eqt_cli.base.errors import EqtError, suggestion
from eqt_cli.base.extensions import function_for
from eqt_cli.base.files import FILE_NAME
from eqt_cli.cli import options, output

if TYPE_CHECKING:
    from eqt_cli.results.result import Result
    from eqt_cli.runs.part_files import Unfinished

UNKNOWN = "at an unknown time"
TABLES, FORMATS = ("metrics", "unsettled"), ("csv", "jsonl", "parquet")


def show(
    result: Annotated[
        Path,
        typer.Argument(
            metavar="RESULT",
            help="Result folder, or the results.h5 in it; for --diagram also a configuration.",
        ),
    ],
    config: Annotated[bool, options.option("--config")] = False,
    diagram: Annotated[bool, options.option("--diagram")] = False,
    plugins: Annotated[bool, options.option("--plugins")] = False,
    variables: Annotated[bool, options.option("--variables")] = False,
    failed: Annotated[bool, options.option("--failed")] = False,
    failures: Annotated[bool, options.option("--failures")] = False,
    table: Annotated[str | None, options.option("--table", names=TABLES)] = None,
    format_: Annotated[str | None, options.option("--format", names=FORMATS)] = None,
    export: Annotated[Path | None, options.option("--export")] = None,
    controller: options.Controllers = None,
    run: Annotated[int | None, options.option("--run")] = None,
    point: options.Point = None,
    unit: options.Units = None,
    out: Annotated[Path | None, options.option("--out")] = None,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
) -> None:
    """Summarise a result: the experiment, its versions, and the main numbers.

    Options
    -------
    What to show
        --config  Print the resolved configuration.
        --diagram  Draw the loop of a configuration or a result as blocks, with what differs between
            its laws: as text, or by --out as a picture.
        --plugins  Print the stored plugin sources.
        --variables  List the variables.
        --failed  List all failed runs.
        --failures  Say where laws fail: which drawn numbers tell their bad runs from the others.
        --table NAME  Print a table, one row per run: metrics of every run, or unsettled, the
            initial states of runs that did not settle, as initial.file takes them.
    A run as a file
        --export FILE  Write a run for other programs: .csv, .tum (evo), .mat, or .mcap (Foxglove,
            PlotJuggler, Rerun, ros2 bag play), which holds all laws and the reference.
        --controller NAME  Law in the file, or reference. Default: the first one. Repeatable for
            .mcap. Of --run and --failures: one of their laws. Default: all.
        --run K  Number of the run. Without --export, what it drew and how it ended.
    Output
        --format NAME  Format of --table: csv, jsonl or parquet. Default: csv.
        --out FILE  File of --diagram: .svg or .html.
    """
    if diagram or out:
        if not diagram:
            raise EqtError("--out: applies to --diagram only; print the rest to a file by > FILE")
        function_for(purposes.show_diagram)(result, out, point, trust_plugins)
        return
    laws, is_of_runs = controller or [], failures or run is not None
    if laws and not (export or is_of_runs):
        raise EqtError("--controller: applies to --export, --run and --failures only")
    views = (
        (config, _config),
        (plugins, _plugins),
        (variables, _variables),
        (failed, _failed),
        (failures, partial(_failures, laws)),
        (run is not None and not export, partial(_run, run or 0, laws)),
    )
    view = next((view for flag, view in views if flag), None)
    if export and (table or json or view):
        raise EqtError("--export: writes a file and prints no table; leave the other options out")
    if result.is_dir() and not (result / FILE_NAME).exists() and not (view or table or export):
        from eqt_cli.runs.part_files import unfinished

        if state := unfinished(result):
            _unfinished(result, state, json)
            return

    from eqt_cli.api.loading import open_at
    from eqt_cli.cli.result_tables import print_table

    _check_table(table, format_, json)
    with open_at(result, point) as opened:
        results = opened.in_units(unit or ())
        if export:
            function_for(purposes.show_export)(opened, export, laws, run or 0)
            output.say(f"run {run or 0} is in {export}")
        elif table:
            print_table(results, table, format_ or FORMATS[0])
        else:
            (view or _summary)(results, json)


def _check_table(table: str | None, format_: str | None, json: bool) -> None:
    if format_ and not table:
        raise EqtError("--format: applies to --table only; --json prints the rest for programs")
    if json and table:
        raise EqtError(
            "--json: is not available for a table; use --format jsonl, one document per row"
        )
    _check_known("table", table, TABLES)
    _check_known("format", format_, FORMATS)


def _check_known(option: str, value: str | None, names: Sequence[str]) -> None:
    if value and value not in names:
        hint = suggestion(value, names) or f"; known: {', '.join(names)}"
        raise EqtError(f"--{option}: unknown {option} '{value}'{hint}")


def _unfinished(path: Path, state: Unfinished, json: bool) -> None:
    share = 100 * state.done / state.runs
    running = "no; the same eqt run or eqt sweep continues"
    if state.writer is not None:
        by = f" by process {state.writer['pid']} on {state.writer['host']}" if state.writer else ""
        running = f"yes{by}"
    lines = [
        f"{state.name}, unfinished  ({path})",
        f"begun    {state.begun}",
        f"done     {state.done} of {state.runs} runs ({share:.1f} %)",
        f"failed   {state.failed}",
        f"running  {running}",
    ]
    if state.rate is not None:
        lines.append(f"rate     {state.rate:.1f} runs/s")
    if state.remaining is not None:
        lines.append(f"left     about {output.duration(state.remaining)}")
    document = {"path": str(path), **asdict(state), "remaining_s": state.remaining}
    output.print_findings(document, "\n".join(lines), json=json)


def _summary(results: Result, json: bool) -> None:
    from eqt_cli.base.version import OTHERS, VERSIONS, differences
    from eqt_cli.cli.result_tables import outcome_record, print_outcome
    from eqt_cli.results.conclusion import answers_of, conclusion_of

    if json:
        document = {
            "path": str(results.path),
            "title": results.attributes["title"],
            "digest": results.attributes["digest"],
            "config": _stored(results, "config"),
            "provenance": results.provenance,
            "remarks": results.described.remarks,
            "dimensions": dict(results.dimensions),
            "variables": {
                name: {"dims": list(results.dims(name)), "units": results.units(name)}
                for name in results.names
            },
            **outcome_record(results),
            **conclusion_of(results).document(),
        }
        output.print_json(document)
        return
    origin = results.provenance
    packages = ", ".join(f"{name} {origin[name]}" for name in VERSIONS if name in origin)
    path = results.described.signal_path
    heading = [
        f"{results.title} on {results.group_name}  ({results.path})",
        f"run      {str(origin.get('started', UNKNOWN)).replace('+00:00', ' UTC')} with {packages}",
        *(
            f"also     {other.get('started', UNKNOWN)} with {differences(other, origin)}"
            for other in origin.get(OTHERS, ())
        ),
        f"digest   {str(results.attributes['digest'])[:16]}",
        *([f"loop     {path}", ""] if path else [""]),
    ]
    if shown := [output.laid_out(table) for table in conclusion_of(results).tables()]:
        shown = [*map(output.laid_out, answers_of(results)[1]), *shown]
        output.print_text(*heading, *(piece for table in shown for piece in (table, "")))
    else:
        print_outcome(results, heading)
    if remarked := output.remarked(results):
        output.print_text(*(f"remark   {text}" for text in remarked))


def _failures(laws: list[str], results: Result, json: bool) -> None:
    function_for(purposes.show_failures)(results, laws, json=json)


def _run(run: int, laws: list[str], results: Result, json: bool) -> None:
    function_for(purposes.show_run)(results, run, laws, json=json)


def _config(results: Result, json: bool) -> None:
    text = str(results.attributes["config"])
    output.print_source(_stored(results, "config"), text, json=json)


def _variables(results: Result, json: bool) -> None:
    rows = [(x, results.dims(x), results.units(x), results.long_name(x)) for x in results.names]
    output.print_records(["variable", "dimensions", "units", "meaning"], rows, json=json)


def _failed(results: Result, json: bool) -> None:
    failures = results.failures
    messages = results.messages(failures) if len(failures) else []
    document, lines = [], []
    for where, message in zip(map(tuple, failures.tolist()), messages, strict=True):
        place = dict(zip(results.dims("status"), where, strict=True))
        place |= {"controller": results.labels[where[-2]], "status": int(results.status[where])}
        document.append({**place, "message": message})
        lines.append(f"{results.place(where)}: {message}")
    output.print_findings(document, "\n".join(lines), json=json, nothing="no run failed")


def _plugins(results: Result, json: bool) -> None:
    sources = _stored(results, "plugins")
    lines = [f"# {path}\n{source}" for path, source in sources.items()]
    text = "\n".join(line.removesuffix("\n") for line in lines)
    output.print_source(sources, text, json=json, nothing="no plugins")


def _stored(results: Result, name: str) -> Any:
    """Return the content of an attribute of the file, parsed as YAML."""
    from eqt_cli.base import yaml_source

    return yaml_source.load(str(results.attributes[name]), f"{results.path}[{name}]").data


# `eqt results`: the results in a folder -----------------------------------------------------------


def results(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="Folder that holds result folders.")
    ] = Path("results"),
    json: options.Json = False,
) -> None:
    """List the results in a folder, the newest first: laws, runs and mean errors."""
    from eqt_cli.base.reporting import Block, TextTable

    if not folder.is_dir():
        raise EqtError(f"{folder}: expected a folder; `eqt run CONFIG` makes results/NAME")
    paths = list(folder.rglob(FILE_NAME))
    whole = {path.parent for path in paths}  # generations of a search lie inside its result
    dated = [_listed(path) for path in paths if not whole & {*path.parent.parents}]
    records = [record for _, record in sorted(dated, key=lambda pair: pair[0], reverse=True)]
    rows = [[str(cell) for cell in record.values()] for record in records]
    header = ["result", "begun, UTC", "laws", "runs", "headline"]
    text = output.laid_out(TextTable("results", "", header, [Block("", rows)], [], (header[1],)))
    pieces = [text] if rows else []
    output.print_findings(records, *pieces, json=json, nothing=f"{folder}: no results")


def _listed(path: Path) -> tuple[str, dict[str, Any]]:
    """Return when a result was begun, and a line about it, also if it cannot be read."""
    from eqt_cli.base.reporting import significant
    from eqt_cli.results.result import open_result
    from eqt_cli.results.summary import compared_first, headline, unit_in_words

    record = {"result": str(path.parent), "begun": "", "laws": "", "runs": "", "headline": ""}
    begun = ""
    try:
        with open_result(path) as result:
            begun = str(result.provenance.get("started", ""))
            record["begun"] = begun[:16].replace("T", " ")
            record["laws"] = ", ".join(result.titles)
            points = f"{result.dimensions['point']} points × " if result.is_sweep else ""
            record["runs"] = f"{points}{result.runs}"
            if not result.is_sweep:
                for name in compared_first(result)[:1]:
                    means = ", ".join(significant(row[name]) for row in headline(result))
                    words = f"{result.quantity(name).plain} {means} {unit_in_words(result, name)}"
                    record["headline"] = words.rstrip()
    except EqtError as error:
        record["headline"] = str(error).removeprefix(f"{path}: ")
    return begun, record
