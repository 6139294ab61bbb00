"""`eqt show`: what a result holds."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eqt_cli.cli import completion, options

if TYPE_CHECKING:
    from eqt_cli.execution.unfinished import Unfinished
    from eqt_cli.results.result import Result


def show(
    result: options.Result,
    config: Annotated[
        bool, typer.Option("--config", metavar="", help="Print the resolved configuration.")
    ] = False,
    plugins: Annotated[
        bool, typer.Option("--plugins", metavar="", help="Print the stored plugin sources.")
    ] = False,
    variables: Annotated[
        bool, typer.Option("--variables", metavar="", help="List the variables.")
    ] = False,
    failed: Annotated[
        bool, typer.Option("--failed", metavar="", help="List every failed run.")
    ] = False,
    table: Annotated[
        bool,
        typer.Option("--table", metavar="", help="Print every run with its metrics, one row each."),
    ] = False,
    format_: Annotated[
        str | None,
        typer.Option(
            "--format",
            metavar="NAME",
            autocompletion=completion.words("csv", "jsonl"),
            help="Of the table: csv or jsonl; default: csv.",
        ),
    ] = None,
    point: options.Point = None,
    json: options.Json = False,
) -> None:
    """Summarise a result: what was run, where, and what came out."""
    from eqt_cli.core.errors import EqtError
    from eqt_cli.execution.unfinished import unfinished

    if format_ and not table:
        raise EqtError("--format: is of --table; --json prints the rest for programs")
    asked = ((config, _config), (plugins, _plugins), (variables, _variables), (failed, _failed))
    view = next((view for wanted, view in asked if wanted), None)
    found = None if view or table else unfinished(result)
    if found is not None:
        _print_unfinished(result, found, json)
        return

    from eqt_cli.cli.run_table import print_run_table
    from eqt_cli.results.result import open_result

    if json and table:
        raise EqtError("--json: a table has no such form; use --format jsonl, a document per row")
    with open_result(result, point) as results:
        if table:
            print_run_table(results, format_ or "csv")
        else:
            (view or _summary)(results, json)


def _print_unfinished(path: Path, found: Unfinished, json: bool) -> None:
    from dataclasses import asdict

    from eqt_cli.cli.output import duration, print_json

    if json:
        print_json({"path": str(path), **asdict(found), "remaining_s": found.remaining})
        return
    share = 100 * found.done / found.runs
    print(f"{found.name}, unfinished  ({path})")
    print(f"begun    {found.begun}")
    print(f"done     {found.done} of {found.runs} runs ({share:.1f} %)")
    print(f"failed   {found.failed}")
    if found.writer is None:
        print("running  no; the same eqt run or eqt sweep continues")
    else:
        by = f" by process {found.writer['pid']} on {found.writer['host']}" if found.writer else ""
        print(f"running  yes{by}")
    if found.rate is not None:
        print(f"rate     {found.rate:.1f} runs/s")
    if found.remaining is not None:
        print(f"left     about {duration(found.remaining)}")


def _document(results: Result) -> dict[str, object]:
    from eqt_cli.config import yaml_source

    return {
        "path": str(results.path),
        "title": results.attributes["title"],
        "digest": results.attributes["digest"],
        "config": yaml_source.load(str(results.attributes["config"]), "config").data,
        "provenance": results.provenance,
        "dimensions": dict(results.dimensions),
        "variables": {
            name: {"dims": list(results.dims(name)), "units": results.units(name)}
            for name in results.names
        },
        "controllers": results.headline(),
    }


def _summary(results: Result, as_json: bool) -> None:
    from eqt_cli.cli.output import print_json
    from eqt_cli.cli.summary import print_accuracy, print_failures, print_headline
    from eqt_cli.config import yaml_source
    from eqt_cli.config.signal_path import signal_path
    from eqt_cli.execution.provenance import OTHERS, differences

    if as_json:
        print_json(_document(results))
        return
    origin = results.provenance
    packages = ", ".join(f"{name} {origin[name]}" for name in ("eqt", "python", "numpy", "scipy"))
    sizes = ", ".join(f"{name} {size}" for name, size in results.dimensions.items())
    print(f"{results.attributes['title']} on {results.attributes['group']}  ({results.path})")
    print(f"run      {origin['started']} with {packages}")
    for other in origin.get(OTHERS, ()):
        print(f"also     {other['started']} with {differences(other, origin)}")
    print(f"digest   {str(results.attributes['digest'])[:16]}")
    path = signal_path(yaml_source.load(str(results.attributes["config"]), "config").data)
    if path:
        print(f"loop     {path}")
    print(f"sizes    {sizes}\n")
    print_headline(results)
    print()
    print_accuracy(results)
    if results.status.any():
        print_failures(results)


def _config(results: Result, as_json: bool) -> None:
    from eqt_cli.cli.output import print_json
    from eqt_cli.config import yaml_source

    text = str(results.attributes["config"])
    if as_json:
        print_json(yaml_source.load(text, "config").data)
    else:
        print(text, end="")


def _variables(results: Result, as_json: bool) -> None:
    from eqt_cli.cli.output import print_json, table

    header = ["variable", "dimensions", "units", "meaning"]
    found = [
        (name, results.dims(name), results.units(name), results.long_name(name))
        for name in results.names
    ]
    if as_json:
        print_json([dict(zip(header, row, strict=True)) for row in found])
    else:
        rows = [[name, ", ".join(dims), units, meaning] for name, dims, units, meaning in found]
        print(table(header, rows))


def _failed(results: Result, as_json: bool) -> None:
    from eqt_cli.cli.output import print_json, say

    failures = results.failures
    messages = results.messages(failures) if len(failures) else []
    places = [tuple(where) for where in failures.tolist()]
    if as_json:
        dims, labels = results.dims("status"), results.labels
        print_json(
            [
                dict(zip(dims, where, strict=True))
                | {"controller": labels[where[-2]], "status": int(results.status[where])}
                | {"message": message}
                for where, message in zip(places, messages, strict=True)
            ]
        )
        return
    if not places:
        say("no run failed")
    for where, message in zip(places, messages, strict=True):
        print(f"{results.place(where)}: {message}")


def _plugins(results: Result, as_json: bool) -> None:
    from eqt_cli.cli.output import print_json, say
    from eqt_cli.config import yaml_source

    sources = yaml_source.load(str(results.attributes["plugins"]), "plugins").data
    if as_json:
        print_json(sources)
        return
    if not sources:
        say("no plugins")
    for path, source in sources.items():
        print(f"# {path}\n{source}", end="" if source.endswith("\n") else "\n")
