"""`eqt show`: what a result holds."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eqt_cli.cli import options

if TYPE_CHECKING:
    from eqt_cli.store.reader import Results


def show(
    result: Annotated[
        Path, typer.Argument(metavar="RESULT", help="Result folder, or its results.h5.")
    ],
    config: Annotated[
        bool, typer.Option("--config", help="Print the resolved configuration.")
    ] = False,
    plugins: Annotated[
        bool, typer.Option("--plugins", help="Print the stored plugin sources.")
    ] = False,
    variables: Annotated[bool, typer.Option("--variables", help="List the variables.")] = False,
    failed: Annotated[bool, typer.Option("--failed", help="List every failed run.")] = False,
    json: options.Json = False,
) -> None:
    """Summarise a result: what was run, where, and what came out."""
    from eqt_cli.cli.output import print_json
    from eqt_cli.store.reader import open_results

    with open_results(result) as results:
        if config:
            print(results.attributes["config"], end="")
        elif plugins:
            _print_plugins(results)
        elif json:
            print_json(_document(results))
        elif variables:
            _print_variables(results)
        elif failed:
            _print_failed(results)
        else:
            _print_summary(results)


def _document(results: Results) -> dict[str, object]:
    import json
    from dataclasses import asdict

    from eqt_cli.analysis.headline import headline
    from eqt_cli.experiment import yaml_source

    return {
        "path": str(results.path),
        "title": results.attributes["title"],
        "digest": results.attributes["digest"],
        "config": yaml_source.load(str(results.attributes["config"]), "config").data,
        "provenance": json.loads(str(results.attributes["provenance"])),
        "dimensions": dict(results.dimensions),
        "variables": {
            name: {"dims": list(results.dims(name)), "units": _units(results, name)}
            for name in results.names
        },
        "controllers": [asdict(row) for row in headline(results)],
    }


def _units(results: Results, name: str) -> str:
    return "" if name == "message" else results.units(name)


def _print_summary(results: Results) -> None:
    import json

    from eqt_cli.cli.summary import print_accuracy, print_failures, print_headline

    origin = json.loads(str(results.attributes["provenance"]))
    packages = ", ".join(f"{name} {origin[name]}" for name in ("eqt", "python", "numpy", "scipy"))
    sizes = ", ".join(f"{name} {size}" for name, size in results.dimensions.items())
    print(f"{results.attributes['title']} on {results.attributes['group']}  ({results.path})")
    print(f"run      {origin['started']} with {packages}")
    print(f"digest   {str(results.attributes['digest'])[:16]}")
    print(f"sizes    {sizes}\n")
    print_headline(results)
    print()
    print_accuracy(results)
    if results["status"].any():
        print_failures(results)


def _print_variables(results: Results) -> None:
    from eqt_cli.cli.output import table

    rows = [
        [name, ", ".join(results.dims(name)), _units(results, name), results.long_name(name)]
        for name in results.names
    ]
    print(table(["variable", "dimensions", "units", "meaning"], rows))


def _print_failed(results: Results) -> None:
    import numpy as np

    from eqt_cli.cli.output import say

    status, messages = results["status"], results["message"]
    if not status.any():
        say("no run failed")
    labels = results.coordinate("controller")
    for controller, run in np.argwhere(status):
        print(f"{labels[controller]} run {run}: {messages[controller, run]}")


def _print_plugins(results: Results) -> None:
    from eqt_cli.cli.output import say
    from eqt_cli.experiment import yaml_source

    sources = yaml_source.load(str(results.attributes["plugins"]), "plugins").data
    if not sources:
        say("no plugins")
    for path, source in sources.items():
        print(f"# {path}\n{source}", end="" if source.endswith("\n") else "\n")
