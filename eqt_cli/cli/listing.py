"""`eqt list` and `eqt docs`: the available components, and the documentation."""

from __future__ import annotations

import webbrowser
from importlib.metadata import PackageNotFoundError, metadata
from pathlib import Path
from typing import Annotated, Any

import typer

from eqt_cli.cli.shared import completion, options
from eqt_cli.cli.shared.output import print_found, say
from eqt_cli.config import shipped
from eqt_cli.config.catalogue import KINDS, registry
from eqt_cli.core.errors import EqtError, suggestion
from eqt_cli.core.registry import load_plugin, summary

MOST_BESIDE = 24
"""Longest name with its summary beside it; below longer names the summary can be wrapped."""


def list_components(
    kind: Annotated[
        str | None,
        typer.Argument(
            metavar="KIND",
            help=f"{', '.join(KINDS)}, devices or configs.",
            autocompletion=completion.words(*KINDS, "devices", "configs"),
        ),
    ] = None,
    plugin: Annotated[
        list[Path] | None,
        typer.Option("--plugin", metavar="FILE", help="Load a plugin file first. Repeatable."),
    ] = None,
    json: options.Json = False,
) -> None:
    """Count the components of each kind, and list them with their options."""
    kinds = [*KINDS, "configs"]
    if kind is not None and kind not in [*kinds, "devices"]:
        hint = suggestion(kind, kinds) or f"; known: {', '.join(kinds)}"
        raise EqtError(f"unknown kind '{kind}'{hint}")
    if plugin:
        for name in KINDS:
            registry(name)  # a plugin may define any kind
    for path in plugin or ():
        load_plugin(path)
    listed = {name: _described(name) for name in ([kind] if kind else kinds)}
    print_found(listed, _text(listed), json=json)


def _described(kind: str) -> list[dict[str, Any]]:
    from eqt_cli.core.option_types import has_options, option_names

    if kind == "devices":
        from eqt_cli.engines.native.devices import devices

        return [
            {
                "name": f"opencl:{each.number}",
                "summary": f"{each.name}, {each.driver}, {each.memory / 2**30:.1f} GiB"
                + "".join(f"; lacks {what}" for what in each.lacks),
                "options": [],
            }
            for each in devices()
        ]
    if kind == "configs":
        return [{"name": config, "summary": "", "options": []} for config in shipped.names()]
    return [
        {
            "name": component.name,
            "summary": summary(component),
            "options": option_names(component) if has_options(component) else [],
        }
        for component in registry(kind).all()
    ]


def _text(listed: dict[str, list[dict[str, Any]]]) -> str:
    blocks = [_counted(listed)] if len(listed) > 1 else []
    for kind, entries in listed.items():
        width = max((len(entry["name"]) for entry in entries), default=0)
        lines = [kind]
        between = "  " if width <= MOST_BESIDE else "\n      "
        width = width if width <= MOST_BESIDE else 0
        for entry in entries:
            lines.append(f"  {entry['name']:<{width}}{between}{entry['summary']}".rstrip())
            if entry["options"]:
                lines.append(f"  {'':<{width}}  options: {', '.join(entry['options'])}")
        blocks.append("\n".join(lines))
    return "\n\n".join(blocks)


def _counted(listed: dict[str, list[dict[str, Any]]]) -> str:
    """Return the kinds, with the number of components of each."""
    width = max(map(len, listed))
    lines = [f"  {kind:<{width}}  {len(entries):>3}" for kind, entries in listed.items()]
    return "\n".join(["kinds, and how many of each; `eqt list KIND` shows one kind", *lines])


CHECKOUT = Path(__file__).parents[2]
"""Root of the repository that eqt runs from; else the folder of the installed packages."""

DISTRIBUTION = "eqt-cli"


def docs(
    address: Annotated[
        bool, typer.Option("--address", metavar="", help="Print the address; open nothing.")
    ] = False,
    json: options.Json = False,
) -> None:
    """Open the documentation in a browser: pages built by make docs, or those online."""
    pages = _address()
    if not address and not json and not webbrowser.open(pages):
        say("no browser could be opened; the documentation is at:")
    print_found({"documentation": pages}, pages, json=json)


def _address() -> str:
    """Return the address of the pages built here, or of those online."""
    built = CHECKOUT / "build" / "docs" / "index.html"
    if built.exists():
        return built.as_uri()
    if online := _online():
        return online
    text = CHECKOUT / "docs" / "index.md"
    if text.exists():
        raise EqtError(f"the documentation is not built; run make docs, or read {text}")
    raise EqtError(
        "the documentation is not installed; it is in the folder docs of the eqt repository"
    )


def _online() -> str:
    """Return the address in the metadata of the distribution; empty if there is none."""
    try:
        entries = metadata(DISTRIBUTION).get_all("Project-URL") or []
    except PackageNotFoundError:
        return ""
    named = (entry.partition(", ") for entry in entries)
    return next((url for name, _, url in named if name == "Documentation"), "")
