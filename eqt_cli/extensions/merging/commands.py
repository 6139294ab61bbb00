"""`eqt config show`: a configuration as it is read, with the origin of every value."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eqt_cli.base import purposes
from eqt_cli.base.errors import KeyPath, dotted
from eqt_cli.cli import options, output
from eqt_cli.cli.options import Command, example

if TYPE_CHECKING:
    from eqt_cli.config.document import Document

WIDTH = 48
"""Column of the origins; longer lines have theirs two spaces behind them."""


@purposes.commands_of_config
def add_to(app: typer.Typer) -> None:
    """Add the command to the group `eqt config`."""
    app.command("show", cls=Command, epilog=example("eqt config show", "configs/paper.yaml"))(show)


def show(
    config: Annotated[
        Path, typer.Argument(metavar="CONFIG", help="YAML configuration, or a result.")
    ],
    set_: options.Set = None,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Print a configuration with all that it extends, and where each value is written.

    Values are as they are written; `config check --resolved` prints them with all defaults.
    """
    document = options.document_of(config, set_)
    lines = list(_lines(document, document.data, ()))
    origins = {dotted(path): place for path, _, place in lines if place}
    answer = {"config": str(config), "data": document.data, "origins": origins}
    text = "\n".join(f"{text:{WIDTH}}  # {place}" if place else text for _, text, place in lines)
    output.print_source(answer, text, json=json)


def _lines(
    document: Document, data: dict[str, Any], path: KeyPath
) -> Iterator[tuple[KeyPath, str, str]]:
    """Yield the lines of a mapping as YAML, each of a value with its path and its origin."""
    from eqt_cli.base.yaml_source import dump  # slow to import

    margin = "  " * len(path)
    for key, value in data.items():
        at = (*path, key)
        first, *more = dump({key: value}).splitlines()
        if isinstance(value, dict) and len(_places(document, value, at)) > 1:
            yield at, margin + first, ""
            yield from _lines(document, value, at)
        else:
            written = at[:1] in document.changes or at[:1] in document.source.paths
            yield at, margin + first, document.place(at) if written else "the file's name"
            yield from ((at, margin + line, "") for line in more)


def _places(document: Document, value: Any, path: KeyPath) -> set[str]:
    """Return the files and options in which a value is written."""
    places = {document.place(path).partition(":")[0]}
    inner: Any = ()
    if isinstance(value, dict | list):
        inner = value.items() if isinstance(value, dict) else enumerate(value)
    for step, child in inner:
        places |= _places(document, child, (*path, step))
    return places
