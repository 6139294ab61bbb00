"""Options that several commands share."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from eqt_cli.cli.shared import completion
from eqt_cli.core.errors import EqtError


def placed(option: str, texts: Sequence[str] | None) -> dict[str, str]:
    """What a repeated option was given, by the places that messages name: ``--set[0]``."""
    return {f"{option}[{index}]": text for index, text in enumerate(texts or ())}


def overrides(set_: Sequence[str] | None, engine: str | None = None) -> dict[str, str]:
    """What ``--set`` and ``--engine`` change of a configuration."""
    chosen = {} if engine is None else {"--engine": f"solver.engine={engine}"}
    return placed("--set", set_) | chosen


def folder(text: str) -> Path:
    """A folder that is given by name; an empty name, as of an unset variable, is a mistake.

    Raises
    ------
    EqtError
        If it is empty.
    """
    if not text.strip():
        raise EqtError("--out: expected the name of a folder, got ''")
    return Path(text)


def out(help: str) -> Any:
    """The option ``--out`` for a folder."""
    return typer.Option("--out", metavar="DIR", parser=folder, help=help)


def flag(*names: str, help: str) -> Any:
    """An option without a value."""
    return typer.Option(*names, metavar="", help=help)


def named(option: str, complete: completion.Complete, help: str) -> Any:
    """An option that takes a name, of those that a shell completes."""
    return typer.Option(option, metavar="NAME", autocompletion=complete, help=help)


def figure(help: str) -> Any:
    """The option ``--figure``."""
    return named("--figure", completion.names("figures"), help)


Config = Annotated[
    Path, typer.Argument(metavar="CONFIG", help="YAML configuration, or a result to run again.")
]
Result = Annotated[Path, typer.Argument(metavar="RESULT", help="Result folder, or its results.h5.")]
Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        autocompletion=completion.settings,
        help="Override a key of the configuration, as gains.kp=2; may be repeated.",
    ),
]
Out = Annotated[Path | None, out("Result folder.")]
Json = Annotated[bool, flag("--json", help="Print one JSON document.")]
Quiet = Annotated[bool, flag("--quiet", "-q", help="Print results only.")]
Workers = Annotated[
    int | None,
    typer.Option("--workers", min=1, metavar="N", help="Most cores to use; default: all."),
]
Engine = Annotated[
    str | None, named("--engine", completion.names("engines"), "Engine, as solver.engine.")
]
ExecutorName = Annotated[
    str | None,
    named(
        "--executor",
        completion.names("executors"),
        "auto, serial, threads, local or dask; default: what suits the engine.",
    ),
]
Scheduler = Annotated[
    str | None,
    typer.Option("--scheduler", metavar="ADDRESS", help="Dask scheduler, as tcp://host:8786."),
]
ShardOf = Annotated[
    str | None,
    typer.Option(
        "--shard", metavar="I/N", help="Compute the I-th of N shares only; eqt pack joins them."
    ),
]
Point = Annotated[
    int | None, typer.Option("--point", metavar="K", help="One point of a sweep, counted from 0.")
]
Force = Annotated[bool, flag("--force", help="Start over, removing what eqt wrote there.")]
RerunFailed = Annotated[
    bool, flag("--rerun-failed", help="Compute only those runs again that failed.")
]
TrustPlugins = Annotated[
    bool, flag("--trust-plugins", help="Execute plugin sources stored in a result file.")
]


def cores() -> int:
    """The number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
