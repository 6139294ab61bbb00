"""`eqt docs`: open the documentation."""

from __future__ import annotations

import webbrowser
from importlib.metadata import PackageNotFoundError, metadata
from pathlib import Path
from typing import Annotated

import typer

from eqt_cli.cli.shared import options
from eqt_cli.cli.shared.output import print_found, say
from eqt_cli.core.errors import EqtError

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
    found = _address()
    if not address and not json and not webbrowser.open(found):
        say("no browser could be opened; the documentation is at:")
    print_found({"documentation": found}, found, json=json)


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
