"""`eqt plot`: figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eqt_cli.base.errors import EqtError, suggestion
from eqt_cli.base.files import YAML
from eqt_cli.cli import completion, options
from eqt_cli.cli.output import print_findings, say

if TYPE_CHECKING:
    from eqt_cli.api import Shown
    from eqt_cli.results.result import Result

_WITHOUT = {
    "panels": "{} has no panels to choose from",
    "start": "{} has no time axis",
    "end": "{} has no time axis",
    "degrees": "{} has no angles to show in degrees",
}
"""Reasons why a figure lacks an option."""


def _list(wish: bool) -> None:
    """Print all figures, if this is wished, and exit."""
    if wish:
        from eqt_cli.cli.lookup import list_components

        list_components(["figures"])
        raise typer.Exit


def plot(
    result: Annotated[
        list[Path],
        typer.Argument(
            metavar="RESULT",
            help="Result folder, or the results.h5 in it. Several results are drawn in one figure. "
            "A configuration gives a figure of its reference.",
        ),
    ],
    figure: Annotated[list[str] | None, options.option("--figure", names="figures")] = None,
    list_: Annotated[bool, options.option("--list", is_eager=True, callback=_list)] = False,
    set_: options.Set = None,
    option: Annotated[
        list[str] | None, options.option("--option", autocompletion=completion.figure_options)
    ] = None,
    format_: Annotated[
        list[str] | None, options.option("--format", names="pdf svg png tiff json".split())
    ] = None,
    width: Annotated[str, options.option("--width", names=("column", "page", "slide"))] = "column",
    dpi: Annotated[float | None, options.option("--dpi", min=10, max=2400)] = None,
    controller: options.Controllers = None,
    panel: Annotated[
        list[str] | None, options.option("--panel", autocompletion=completion.panels)
    ] = None,
    start: Annotated[float | None, options.option("--from")] = None,
    end: Annotated[float | None, options.option("--to")] = None,
    title: Annotated[list[str] | None, options.option("--title")] = None,
    colour: Annotated[list[str] | None, options.option("--colour")] = None,
    degrees: Annotated[bool, options.option("--degrees")] = False,
    unit: options.Units = None,
    style: Annotated[list[str] | None, options.option("--style")] = None,
    out: options.Out = None,
    point: Annotated[list[int] | None, options.option("--point")] = None,
    measured: options.Measured = None,
    mapping: options.Mapping = None,
    log_format: options.LogFormat = "csv",
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Draw figures of results, or the reference of a configuration, as PDF, SVG and PNG.

    Options
    -------
    What to show
        --figure NAME  Figure to draw. Repeatable. Default: path where there are positions, summary,
            pose and commands; sweep, forest or worst of a sweep; reference for a CONFIG;
            measured with --measured.
        --list  Print the figures, a sentence each, and exit.
        --panel NAME  Draw only this panel, such as pose_error. Repeatable.
        --from S  Start of the time axis in seconds.
        --to S  End of the time axis in seconds.
        --point K  Point of a sweep, counted from 0. Repeatable: one figure shows all of them.
    Looks
        --option KEY=VALUE  Option of a figure: log=true for all that have it, runs.log=true for
            one. `eqt list figures` shows the options.
        --width NAME  column (3.5 in), page (7.16 in), slide (13.3 in, 18 pt), or a length such
            as '84 mm'.
        --title NAME=TEXT  Name of a law or metric in the figure, such as eqt=ours.
            Repeatable.
        --colour LAW=COLOUR  Colour of a law, such as eqt=black or 'gt=#D9600A'. Repeatable.
        --degrees  Show attitudes and their errors in degrees.
        --style NAME|FILE  Matplotlib style sheet, applied after eqt's own. Repeatable; the last
            wins.
    Result
        --format NAME  pdf, svg, png, tiff, or json for the numbers. Repeatable. Default: pdf,
            svg and png.
        --dpi N  Dots per inch of png and tiff. Default: 300, unless a style says otherwise.
        --out DIR  Output folder. Default: RESULT/figures, or figures/NAME for a CONFIG.
    """
    from eqt_cli import api
    from eqt_cli.figures.render import FORMATS

    # A path that does not exist is reported where it is opened.
    if len(result) > 1 and out is None and all(map(Path.exists, result)):
        raise EqtError("figures of several results need an output folder; add --out DIR")
    if measured is None:
        options.require_measured(mapping, log_format)
    default = ["measured"] if measured else None
    alone = len(result) == 1 and not panel
    names = figure or default or _default(result[0], point, alone=alone, remark=not json)
    shown = [_ready(one, set_, trust_plugins) for one in result]
    flags: dict[str, tuple[str, Any]] = {
        "--controller": ("controllers", controller),
        "--colour": ("colours", options.pairs("--colour", colour, "LAW=COLOUR") or None),
        "--panel": ("panels", panel),
        "--from": ("start", start),
        "--to": ("end", end),
        "--degrees": ("degrees", degrees or None),
    }
    figures = _options(names, option or (), flags)
    files = api.plot(
        shown,
        figures,
        out,
        formats=format_ or FORMATS,
        width=width,
        dpi=dpi,
        titles=options.pairs("--title", title),
        style=style or (),
        point=point,
        measured=measured,
        mapping=mapping,
        log_format=log_format,
        units=unit or (),
        trust_plugins=trust_plugins,
    )
    lines = [f"figure   {first}{also}" for first, also in _by_figure(files).items()]
    print_findings({"figures": list(map(str, files))}, "\n".join(lines), json=json)


def _by_figure(files: Sequence[Path]) -> dict[Path, str]:
    """Return the first file of each figure, and the endings of the others in brackets."""
    first: dict[str, Path] = {}
    others: dict[Path, list[str]] = {}
    for file in files:
        name = file.stem.removesuffix("-caption")
        one = first.setdefault(str(file.with_name(name)), file)
        endings = others.setdefault(one, [])
        if file != one:
            endings.append(file.name.removeprefix(name))
    return {file: f" ({', '.join(ends)})" if ends else "" for file, ends in others.items()}


def _ready(path: Path, set_: list[str] | None, trust_plugins: bool) -> Shown:
    """Return the study or result to draw, with its plugins loaded, since they may define figures.

    It is a study for a configuration, with the changes by ``--set``, and the path for a result.
    """
    if path.suffix in YAML:
        from eqt_cli.config.study import study

        return study(options.document_of(path, set_))
    if set_:
        raise EqtError(f"--set changes configurations, and {path} is a result")
    if trust_plugins:
        from eqt_cli.config.document import load_stored_plugins
        from eqt_cli.results.result import open_result

        with open_result(path) as result:
            load_stored_plugins(result)
    return path


def _default(result: Path, point: Sequence[int] | None, *, alone: bool, remark: bool) -> list[str]:
    """Return the figures to draw by default, of a result `alone` all that answer first."""
    from eqt_cli.figures.shown import are_choices
    from eqt_cli.results.conclusion import conclusion_of, side_by_side
    from eqt_cli.results.result import open_result

    if result.suffix in YAML:
        return ["reference"]
    if point:
        return ["summary"]
    with open_result(result) as results:
        if not results.is_sweep:
            return _of_one(results) if alone else ["summary"]
        if plotted := conclusion_of(results).plotted:
            return [*plotted]
        if side_by_side(results):
            return ["forest"]
        swept = results.swept_keys
        choices = ["pareto"] if are_choices(swept) else []
    if 1 <= len(swept) <= 2:
        return ["sweep", *choices]
    keys = ", ".join(one.key for one in swept)
    if not choices:
        raise EqtError(
            f"no figure shows {len(swept)} swept keys at once ({keys}); choose points with --point"
        )
    if swept and remark:
        say(
            f"figure 'sweep' shows at most two swept keys, and this result has {len(swept)} "
            f"({keys}); drew 'pareto' instead; --point draws one point"
        )
    return choices


def _of_one(result: Result) -> list[str]:
    """Return the figures to draw by default of one experiment: where it went, errors, commands."""
    from eqt_cli.components.groups import known_group, moving_parts
    from eqt_cli.figures.figure import figures
    from eqt_cli.figures.render import first_figure

    numbers, errors = result.stored_runs, list(dict.fromkeys([first_figure(result), "summary"]))
    if not (len(numbers) and numbers[0] == 0 and result.good[:, 0].all() and len(result.times) > 1):
        return errors
    group = known_group(result.group_name)
    _, moving = moving_parts(group) if group else (None, None)
    placed = moving is not None and moving.dimension > 1
    commanded = ["commands"] if result.has("command") else []
    names = ["path", *errors, "pose"] if placed and "path" in figures.names() else errors
    return [*names, *commanded]


def _options(
    names: Sequence[str], texts: Sequence[str], flags: Mapping[str, tuple[str, Any]]
) -> dict[str, dict[str, Any]]:
    """Return the options of each figure from ``KEY=VALUE``, ``FIGURE.KEY=VALUE`` and `flags`.

    Each flag sets an option, given as name and value, of all figures that have it.
    """
    from eqt_cli.base.option_types import option_names
    from eqt_cli.base.yaml_source import parse_value
    from eqt_cli.figures.figure import figures

    options_of = {name: option_names(figures.get(name)) for name in names}
    by_figure: dict[str, dict[str, Any]] = {name: {} for name in names}
    for flag, (key, wish) in flags.items():
        takers = [name for name in options_of if key in options_of[name]]
        if wish is not None and not takers:
            raise EqtError(f"{flag}: {_WITHOUT[key].format(' and '.join(options_of))}")
        if wish is not None:
            for name in takers:
                by_figure[name][key] = wish
    for index, text in enumerate(texts):
        place = f"--option[{index}]"
        left, equals, right = text.partition("=")
        if not equals:
            raise EqtError(f"{place}: expected KEY=VALUE, got '{text}'")
        figure, _, key = left.strip().rpartition(".")
        value = parse_value(right, place)
        if figure and figure not in options_of:
            hint = suggestion(figure, options_of) or f"; drawn are: {', '.join(options_of)}"
            raise EqtError(f"{place}: figure '{figure}' is not drawn{hint}")
        takers = [figure] if figure else [name for name in options_of if key in options_of[name]]
        if not takers and len(options_of) > 1:
            keys = list(
                dict.fromkeys(option for options in options_of.values() for option in options)
            )
            hint = suggestion(key, keys) or f"; they have: {', '.join(keys)}"
            raise EqtError(f"{place}: none of {', '.join(options_of)} has an option '{key}'{hint}")
        for name in takers or options_of:
            by_figure[name][key] = value
    return by_figure
