"""Options that several commands share."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from eqt_cli.cli.shared import completion
from eqt_cli.cli.shared.help import COMPUTING, EXPERIMENT, OUTPUT, RESULT, SELECTION
from eqt_cli.cli.shared.output import be_quiet
from eqt_cli.core.errors import EqtError

MOST_SHOWN = 60
"""Maximum number of characters of a value that messages repeat."""


def placed(option: str, texts: Sequence[str] | None) -> dict[str, str]:
    """Map places in messages, such as ``--set gains.kp=2``, to values of a repeated option."""
    found: dict[str, str] = {}
    for text in texts or ():
        key, _, _ = text.partition("=")
        place = f"{option} {text if len(text) <= MOST_SHOWN else f'{key}=…'}"
        while place in found:
            place += " (again)"
        found[place] = text
    return found


def overrides(set_: Sequence[str] | None, engine: str | None = None) -> dict[str, str]:
    """Return the changes of a configuration by ``--set`` and ``--engine``."""
    chosen = {} if engine is None else {"--engine": f"solver.engine={engine}"}
    return placed("--set", set_) | chosen


def pairs(option: str, texts: Sequence[str] | None) -> dict[str, str]:
    """Parse the values ``NAME=TEXT`` of a repeated option.

    Raises
    ------
    EqtError
        If a value has no name or no text.
    """
    found = {}
    for text in texts or ():
        name, _, value = (piece.strip() for piece in text.partition("="))
        if not (name and value):
            raise EqtError(f"{option}: expected NAME=TEXT, got '{text}'")
        found[name] = value
    return found


def the_one(command: str, results: Sequence[Path], does: str = "") -> Path:
    """Return the single result of a command.

    Raises
    ------
    EqtError
        If several were given; the message says how to compare them.
    """
    if len(results) == 1:
        return results[0]
    both = "both" if len(results) == 2 else "all"
    raise EqtError(
        f"{command} takes one result{does}; got {len(results)}. To compare across experiments, put "
        "the laws in one configuration, as entries of `controllers` with labels and gains of "
        f"their own. To draw {both} in one figure: `eqt plot {' '.join(map(str, results))} --out "
        f"figures/{both}`"
    )


def folder(text: str) -> Path:
    """Return a folder by its name; an empty name, as from an unset variable, is refused.

    Raises
    ------
    EqtError
        If the name is empty.
    """
    if not text.strip():
        raise EqtError("--out: expected the name of a folder, got ''")
    return Path(text)


def out(help: str, metavar: str = "DIR") -> Any:
    """Return the option ``--out`` for a folder."""
    return valued("--out", metavar, help, RESULT, parser=folder)


def flag(option: str, help: str, group: str, *letters: str, **more: Any) -> Any:
    """Return an option without a value, with optional letters, in a group of the help page."""
    return valued(option, "", help, group, *letters, **more)


def valued(option: str, metavar: str, help: str, group: str, *letters: str, **more: Any) -> Any:
    """Return an option with a value, which the help calls `metavar`; see `flag`."""
    return typer.Option(option, *letters, metavar=metavar, help=help, rich_help_panel=group, **more)


def named(option: str, complete: completion.Complete, help: str, group: str) -> Any:
    """Return an option that takes a name, which a shell completes."""
    return valued(option, "NAME", help, group, autocompletion=complete)


def figure(help: str) -> Any:
    """Return the option ``--figure``."""
    return named("--figure", completion.names("figures"), help, SELECTION)


Config = Annotated[
    Path, typer.Argument(metavar="CONFIG", help="YAML configuration, or a result to run again.")
]
Result = Annotated[
    Path, typer.Argument(metavar="RESULT", help="Result folder, or the results.h5 in it.")
]
MoreResults = Annotated[list[Path] | None, typer.Argument(metavar="", hidden=True)]
"""Surplus results, accepted so that the command can say what to do instead."""
Set = Annotated[
    list[str] | None,
    valued(
        "--set",
        "KEY=VALUE",
        "Override a key of the configuration, such as gains.kp=2. Repeatable.",
        EXPERIMENT,
        autocompletion=completion.settings,
    ),
]
Out = Annotated[Path | None, out("Result folder.")]
Controllers = Annotated[
    list[str] | None,
    valued("--controller", "LAW", "Show only this controller. Repeatable.", SELECTION),
]
Json = Annotated[bool, flag("--json", "Print one JSON document.", OUTPUT)]
Quiet = Annotated[bool, flag("--quiet", "Print errors only.", OUTPUT, "-q", callback=be_quiet)]
Verbose = Annotated[bool, flag("--verbose", "Print every row.", OUTPUT, "-v")]
Workers = Annotated[
    int | None,
    valued("--workers", "N", "Number of cores to use. Default: all.", COMPUTING, min=1),
]
Engine = Annotated[
    str | None,
    named("--engine", completion.names("engines"), "Same as --set solver.engine=NAME.", COMPUTING),
]
ExecutorName = Annotated[
    str | None,
    named(
        "--executor",
        completion.names("executors"),
        "auto, serial, threads, local or dask, or NAME:KEY=VALUE with options of it (`eqt list "
        "executors`). Default: auto, or dask with --scheduler.",
        COMPUTING,
    ),
]
Scheduler = Annotated[
    str | None,
    valued(
        "--scheduler", "ADDRESS", "Address of a Dask scheduler, such as tcp://host:8786.", COMPUTING
    ),
]
ShardOf = Annotated[
    str | None,
    valued("--shard", "I/N", "Compute only share I of N. `eqt pack` joins the shares.", COMPUTING),
]
Point = Annotated[
    int | None,
    valued("--point", "K", "Point of a sweep, counted from 0.", SELECTION),
]
Measured = Annotated[
    Path | None,
    valued("--measured", "FILE", "Recording to compare the run with.", SELECTION),
]
Mapping = Annotated[
    Path | None,
    valued(
        "--mapping",
        "FILE",
        "YAML file with columns, units, frames and times of the recording, as in "
        "reference.mapping.",
        SELECTION,
    ),
]
LogFormat = Annotated[
    str,
    named(
        "--log-format",
        completion.words("csv", "tum", "euroc"),
        "Format of the recording: csv, tum or euroc.",
        SELECTION,
    ),
]
DryRun = Annotated[
    bool, flag("--dry-run", "Print the points, runs and expected time only.", COMPUTING)
]
Force = Annotated[
    bool,
    flag("--force", "Start over. Removes only what eqt wrote to the folder.", RESULT),
]
RerunFailed = Annotated[bool, flag("--rerun-failed", "Compute only the failed runs again.", RESULT)]
TrustPlugins = Annotated[
    bool,
    flag(
        "--trust-plugins",
        "Execute the plugins that a result, or a result folder, contains. Those of a YAML "
        "configuration are always executed.",
        EXPERIMENT,
    ),
]


def require_measured(mapping: Path | None, kind: str, run: int = 0) -> None:
    """Refuse options of a recording if no recording is given."""
    given = {"--mapping": mapping, "--log-format": kind != "csv", "--run": run}
    for name in (name for name, value in given.items() if value):
        raise EqtError(f"{name} is of a recording; add --measured FILE")


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
