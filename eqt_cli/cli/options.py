"""Options: their types, their texts, and how help pages show them.

The texts of options of a single command are in its docstring. Those of several are:

Options
-------
Experiment
    --set KEY=VALUE  Override a key of the configuration, such as gains.kp=2. Repeatable.
    --trust-plugins  Execute the plugins that a result, or a result folder, contains. Those of a
        YAML configuration are always executed.
Result
    --out DIR  Result folder.
    --force  Start over. Removes only what eqt wrote to the folder.
    --rerun-failed  Compute only the failed runs again, also with other `solver` settings.
    --grow  Keep what the folder holds, and compute the points, laws and runs that it lacks.
What to show
    --controller LAW  Show only this law. Repeatable.
    --point K  Point of a sweep, counted from 0.
    --unit UNIT  Unit of all quantities of its dimension, such as 'mN m' or deg/s, or of one:
        mean_attitude_error=arcsec. Repeatable.
    --measured FILE  Recording to compare the run with.
    --mapping FILE  YAML file with columns, units, frames and times of the recording, as in
        reference.mapping.
    --log-format NAME  Format of the recording: csv, tum or euroc.
Output
    --json  Print one JSON document.
    --quiet  Print errors only.
    --verbose  Print every row.
Computing
    --workers N  Number of cores to use. Default: all.
    --engine NAME  auto (native where it can be used, else solve_ivp) or another engine (`eqt list
        engines`). Same as --set solver.engine=NAME.
    --executor NAME  auto, serial, threads or local; parsl:FILE.py or dask:ADDRESS for other
        machines; NAME:KEY=VALUE with options of it (`eqt list executors`). Default: auto.
    --shard I/N  Compute only share I of N. `eqt pack` joins the shares.
    --dry-run  Print the points, runs and expected time only.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import wraps
from inspect import Parameter, Signature, cleandoc, signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_type_hints

import typer
from typer.core import TyperArgument, TyperCommand, TyperGroup

from eqt_cli.base.errors import EqtError
from eqt_cli.cli import completion
from eqt_cli.cli.output import be_quiet, documents_alone, say

if TYPE_CHECKING:
    from eqt_cli.config.document import Document
    from eqt_cli.config.study import Study


def example(command: str, arguments: str) -> str:
    """Return the last line of a help page: a command that can be typed."""
    return f"Example: {command} {arguments}"


def _without_types(parameters: list[Any]) -> None:
    """Omit the types that typer prints for arguments and for options without a value.

    The option ``--help`` joins the last group.
    """
    for parameter in parameters:
        if isinstance(parameter, TyperArgument):
            # Set on the argument, not on typer's class; older versions ignore it.
            parameter.display_type_rich = lambda ctx: None  # type: ignore[method-assign]  # hides it
        elif parameter.metavar is None and parameter.is_flag:
            parameter.metavar = ""
        if parameter.name == "help" and len(parameters) > 1:
            parameter.rich_help_panel = parameters[-2].rich_help_panel


_ROW = re.compile(r" +(--\S+) ?(\S*)  (\S.*)")


def _described(table: str) -> dict[str, dict[str, Any]]:
    """Return group, metavar and text of each option, ``    --seed N  Random seed.``, by group."""
    rows: dict[str, dict[str, Any]] = {}
    group = name = ""
    for line in table.splitlines():
        if row := _ROW.fullmatch(line):
            name = row[1]
            rows[name] = {"rich_help_panel": group, "metavar": row[2], "help": row[3]}
        elif line.startswith(" "):
            rows[name]["help"] += f" {line.strip()}"
        else:
            group = line
    return rows


_HEADING = "\n\nOptions\n-------\n"
_SHARED = _described((__doc__ or "").partition(_HEADING)[2])


def option(name: str, *letters: str, names: str | Sequence[str] | None = None, **more: Any) -> Any:
    """Return an option, whose text is in the docstring of this module, or of the command.

    Parameters
    ----------
    known
        Words that complete its value or, as the name of a kind, the components that do.
    """
    if names is not None:
        more["autocompletion"] = lambda incomplete: completion.words(names, incomplete)
    return typer.Option(name, *letters, **_SHARED.get(name, {}), **more)


class Command(TyperCommand):
    """A command whose help page shows options in groups and no Python types."""

    def __init__(self, *args: Any, params: list[Any], help: str | None, **more: Any) -> None:
        """Give the options the texts in the docstring of the command."""
        help, _, table = (help or "").partition(_HEADING)
        texts = _described(table)
        for parameter in params:
            vars(parameter).update(texts.get(parameter.opts[0], {}))
        super().__init__(*args, params=params, help=help, **more)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the options, and refuse numbers that are not finite.

        Raises
        ------
        EqtError
            If a number is not finite.
        """
        left = super().parse_args(ctx, args)
        for parameter in self.params:
            argument = ctx.params.get(parameter.name)
            for value in argument if isinstance(argument, list | tuple) else [argument]:
                if isinstance(value, float) and not math.isfinite(value):
                    raise EqtError(f"{parameter.opts[0]}: expected a number, got {value}")
        return left

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Print the help page, with paragraphs that fill the width."""
        _without_types(self.get_params(ctx))
        paragraphs = cleandoc(self.help or "").split("\n\n")
        self.help = "\n\n".join(" ".join(words.split()) for words in paragraphs)
        super().format_help(ctx, formatter)

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return the ``Usage`` line: braces only where there is a choice.

        Arguments accepted only to be refused in words are left out.
        """
        shown = [one for one in self.get_params(ctx) if not getattr(one, "hidden", False)]
        pieces = [piece for one in shown for piece in one.get_usage_pieces(ctx)]
        return ["[OPTIONS]", *(x if "|" in x else re.sub("[{}]", "", x) for x in pieces)]


class Group(TyperGroup):
    """A group of commands whose help page shows no Python types."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Print the help page."""
        _without_types(self.get_params(ctx))
        super().format_help(ctx, formatter)


MOST_SHOWN = 60
"""Maximum number of characters of a value that messages repeat."""


def placed(option: str, texts: Sequence[str] | None) -> dict[str, str]:
    """Map places in messages, such as ``--set gains.kp=2``, to values of a repeated option."""
    by_place: dict[str, str] = {}
    for text in texts or ():
        key, _, _ = text.partition("=")
        place = f"{option} {text if len(text) <= MOST_SHOWN else f'{key}=…'}"
        while place in by_place:
            place += " (again)"
        by_place[place] = text
    return by_place


def overrides(set_: Sequence[str] | None, engine: str | None = None) -> dict[str, str]:
    """Return the changes of a configuration by ``--set`` and ``--engine``."""
    changes = placed("--set", set_)
    if engine is not None:
        changes["--engine"] = f"solver.engine={engine}"
    return changes


def document_of(
    config: Path,
    set_: Sequence[str] | None,
    engine: str | None = None,
    *,
    trust_plugins: bool = False,
) -> Document:
    """Return a configuration with the changes by these options, not yet checked."""
    from eqt_cli.config.document import read_config

    return read_config(config, overrides(set_, engine), trust_plugins)


def study_at(document: Document, point: int | None, doing: str) -> Study:
    """Check a configuration without its sweep, or at a point of it.

    Parameters
    ----------
    doing
        What the command does without the sweep, for the remark on it: ``exported without``.
    """
    from eqt_cli.config.study import config_at, study, without_sweep

    if point is None and document.data.get("sweep"):
        say(f"{document.path}: {doing} its sweep; choose one of its points with --point")
    return study(without_sweep(document) if point is None else config_at(document, point))


def pairs(option: str, texts: Sequence[str] | None, expected: str = "NAME=TEXT") -> dict[str, str]:
    """Parse the values ``NAME=TEXT`` of a repeated option.

    Raises
    ------
    EqtError
        If a value has no name or no text.
    """
    parsed = {}
    for text in texts or ():
        name, _, value = (piece.strip() for piece in text.partition("="))
        if not (name and value):
            raise EqtError(f"{option}: expected {expected}, got '{text}'")
        parsed[name] = value
    return parsed


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


Config = Annotated[
    Path, typer.Argument(metavar="CONFIG", help="YAML configuration, or a result to run again.")
]
Result = Annotated[
    Path, typer.Argument(metavar="RESULT", help="Result folder, or the results.h5 in it.")
]
Set = Annotated[list[str] | None, option("--set", autocompletion=completion.settings)]
Out = Annotated[Path | None, option("--out", parser=folder)]
Controllers = Annotated[list[str] | None, option("--controller", autocompletion=completion.laws)]


def _documents_alone(ctx: typer.Context, json: bool) -> bool:
    """Apply ``--json``: what others print is no part of the document."""
    if json:
        # A command whose other options are wrong never closes its own context.
        ctx.find_root().with_resource(documents_alone())
    return json


Json = Annotated[bool, option("--json", callback=_documents_alone)]
Quiet = Annotated[bool, option("--quiet", "-q", callback=be_quiet)]
Verbose = Annotated[bool, option("--verbose", "-v")]
Workers = Annotated[int | None, option("--workers", min=1)]
Engine = Annotated[str | None, option("--engine", names="engines")]
ExecutorName = Annotated[str | None, option("--executor", names="executors")]
ShardOf = Annotated[str | None, option("--shard")]
Point = Annotated[int | None, option("--point")]
Units = Annotated[list[str] | None, option("--unit")]
Measured = Annotated[Path | None, option("--measured")]
Mapping = Annotated[Path | None, option("--mapping")]
LogFormat = Annotated[str, option("--log-format", names=("csv", "tum", "euroc"))]
DryRun = Annotated[bool, option("--dry-run")]
TrustPlugins = Annotated[bool, option("--trust-plugins")]


# Options of all commands that compute: a command takes a group of them as one parameter ----------


@dataclass(frozen=True)
class Setup:
    """The experiment, the folder of its result, and what computes it."""

    out: Out = None
    set_: Set = None
    engine: Engine = None
    workers: Workers = None
    executor: ExecutorName = None

    def document(self, config: Path, handling: Handling) -> Document:
        """Return the configuration with the changes by these options, not yet checked."""
        trusted = handling.trust_plugins
        return document_of(config, self.set_, self.engine, trust_plugins=trusted)


@dataclass(frozen=True)
class Handling:
    """Which runs are computed, whether plugins are trusted, and what is printed."""

    shard: ShardOf = None
    force: Annotated[bool, option("--force")] = False
    rerun_failed: Annotated[bool, option("--rerun-failed")] = False
    grow: Annotated[bool, option("--grow")] = False
    trust_plugins: TrustPlugins = False
    json: Json = False
    quiet: Quiet = False


HandlingOfSearch = Annotated[Handling, {"shard", "rerun_failed", "grow"}]
"""The group without some of its options, which have their defaults."""


def spread(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command with the options of a group in the place of the group."""
    hints, groups = get_type_hints(command, include_extras=True), dict[str, tuple[Any, list[str]]]()
    listed: list[Parameter] = []
    for name, parameter in signature(command).parameters.items():
        group, *left_out = get_args(hints[name]) or [hints[name]]
        if not is_dataclass(group):
            listed.append(parameter.replace(annotation=hints[name]))
            continue
        shown = [field for field in fields(group) if field.name not in set().union(*left_out)]
        groups[name] = group, [field.name for field in shown]
        types = get_type_hints(group, include_extras=True)
        for field in shown:
            listed.append(
                Parameter(
                    field.name, parameter.kind, default=field.default, annotation=types[field.name]
                )
            )

    @wraps(command)
    def with_groups(**values: Any) -> None:
        for name, (group, names) in groups.items():
            values[name] = group(**{option: values.pop(option) for option in names})
        command(**values)

    with_groups.__signature__ = Signature(listed)  # type: ignore[attr-defined]  # typer reads it
    return with_groups


def require_measured(mapping: Path | None, kind: str, run: int = 0) -> None:
    """Refuse options of a recording if no recording is given."""
    options = {"--mapping": mapping, "--log-format": kind != "csv", "--run": run}
    for name in (name for name, value in options.items() if value):
        raise EqtError(f"{name} applies to recordings only; add --measured FILE")


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
