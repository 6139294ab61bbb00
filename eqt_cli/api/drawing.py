"""Draws figures."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from eqt_cli.api.loading import ResultPath, experiment_at, loops_of, open_at, require_list
from eqt_cli.base import purposes
from eqt_cli.base.errors import EqtError, EqtWarning, Problems, suggestion
from eqt_cli.base.extensions import function_for
from eqt_cli.base.files import FIGURES, YAML, check_targets
from eqt_cli.base.reporting import reporter, step
from eqt_cli.components.groups import known_group
from eqt_cli.results.result import Result, point_folder, rename

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

    from eqt_cli.config.experiment import Experiment
    from eqt_cli.config.study import Study
    from eqt_cli.figures.shown import DesiredMotion

Shown: TypeAlias = "ResultPath | Study"
"""A result to draw, or an experiment, loaded or as a YAML file."""


def plot(
    result: Shown | Sequence[Shown],
    figure: str | Mapping[str, Mapping[str, Any]] | None = None,
    out: str | os.PathLike[str] | None = None,
    *,
    formats: Sequence[str] = ("pdf", "svg", "png"),
    width: str = "column",
    dpi: float | None = None,
    options: Mapping[str, Any] | None = None,
    titles: Mapping[str, str] | None = None,
    style: Sequence[str] = (),
    point: int | Sequence[int] | None = None,
    measured: str | os.PathLike[str] | None = None,
    mapping: str | os.PathLike[str] | Mapping[str, Any] | None = None,
    log_format: str = "csv",
    trust_plugins: bool = False,
    units: Sequence[str] = (),
) -> list[Path]:
    """Draw one or several figures of one or several results, and write them to files.

    Parameters
    ----------
    result
        The result folder, or the file in it; several results share one figure. A YAML configuration
        or a `Study` works for figures that need no runs.
    figure
        Name of the figure, as ``eqt list figures`` shows it, or a mapping from names to options.
        Default: ``summary``, of the paper's experiment ``paper``; ``reference`` for a
        configuration; ``measured`` with a recording.
    out
        Output folder. Default: ``figures`` in the folder of the first result, or ``figures/<name>``
        for a configuration.
    formats
        ``pdf``, ``svg``, ``png``, ``tiff``, or ``json`` for the numbers.
    width
        ``column`` (3.5 in), ``page`` (7.16 in), ``slide`` (13.3 in, 18 pt), or a length such as
        ``84 mm``.
    dpi
        Dots per inch of ``png`` and ``tiff``. Default: 300, or those of `style`.
    options
        Options of the figure, as ``{"controllers": ["eqt", "gt"], "start": 0, "end": 5}``.
    titles
        Names of laws and quantities in the figure, by label and name, as
        ``{"eqt": "ours", "mean_pose_error": "tracking error"}``.
    style
        Matplotlib style sheets, applied after eqt's style.
    point
        Point of a sweep, counted from 0; several points share one figure.
    measured, mapping, log_format
        A recording to show with a run, as for `check_log`.
    trust_plugins
        Whether to execute plugin sources that are stored in a result. They may define
        figures.
    units
        Units of quantities, as for `compare`.

    Returns
    -------
    list of Path
        The written files, one per figure and format, and the captions.

    Raises
    ------
    EqtError
        If a result, figure or option does not exist, or the result lacks data for the figure.

    Examples
    --------
    >>> [file.name for file in eqt_cli.plot("results/paper", "torque", formats=["pdf", "svg"])]
    ['torque.pdf', 'torque.svg', 'torque-caption.tex']
    """
    from eqt_cli.figures.figure import figures
    from eqt_cli.figures.render import DRAWN, first_figure, render
    from eqt_cli.figures.style import Style

    with _opened(result, point, units, titles or {}, trust_plugins=trust_plugins) as opened:
        first = opened[0]
        figure = figure or ("measured" if measured else first_figure(first))
        wanted = {figure: options or {}} if isinstance(figure, str) else figure
        home, folder = folders(first, out, point)
        require_list("formats", formats)
        targets = [folder / f"{name}.{format}" for name in wanted for format in formats]
        targets += [folder / f"{name}-caption.tex" for name in wanted]
        check_targets(targets, home)
        beside, files = None, []
        if measured is not None:
            if not any(figures.get(name).shows_recording for name in wanted):
                raise EqtError(
                    "measured: no figure that is drawn shows a recording; 'measured' does"
                )
            name = first.group_name if isinstance(first, Result) else ""
            group = known_group(name) if isinstance(first, Result) else first.group
            if group is None:
                raise EqtError(f"measured: group '{name}' of a plugin is not known here")
            beside = function_for(purposes.plot_measured)(measured, group, mapping, log_format)
            for note in beside.notes:
                reporter().remark(EqtWarning(f"{beside.name}: {note}"))
        with step(DRAWN, len(wanted)):
            for name, options in wanted.items():
                files += render(
                    opened,
                    name,
                    folder,
                    formats,
                    width,
                    options,
                    style=Style(tuple(style), dpi=dpi),
                    measured=beside,
                )
                reporter().advance(1)
        return files


def figure(
    result: Shown | Sequence[Shown],
    name: str,
    *,
    width: str = "column",
    options: Mapping[str, Any] | None = None,
    titles: Mapping[str, str] | None = None,
    style: Sequence[str] = (),
    point: int | Sequence[int] | None = None,
    units: Sequence[str] = (),
    trust_plugins: bool = False,
    axes: Any = None,
) -> Drawing:
    """Draw a figure of one or several results to edit it; saving is yours.

    Parameters
    ----------
    result, width, options, titles, style, point, units, trust_plugins
        As for `plot`.
    name
        Name of the figure, as ``eqt list figures`` shows it.
    axes
        Matplotlib axes of your own to draw into: one, an array in the order of the panels, or a
        mapping from names of panels. Each has its labels, the first the legend, the last the
        remarks below it; letters and layout are yours.

    Returns
    -------
    matplotlib.figure.Figure
        Its panels, ``figure.axes``, have names, ``axes.get_label()``. With `axes`, their figure.

    Raises
    ------
    EqtError
        As for `plot`.

    Examples
    --------
    >>> figure = eqt_cli.figure("results/paper", "paper")
    >>> panels = {axes.get_label(): axes for axes in figure.axes}
    >>> _ = panels["torque_norm"].axhline(0.5, color="black")
    >>> figure.savefig("edited.pdf")
    """
    from eqt_cli.figures.render import figure_from
    from eqt_cli.figures.style import Style, width_of

    wanted, (of_width, inches) = figure_from(name, options or {}), width_of(width)
    sheets = Style(tuple(style), width=of_width, inches=inches)
    with _opened(result, point, units, titles or {}, trust_plugins=trust_plugins) as opened:
        return wanted.draw(opened, of_width, style=sheets, axes=axes)


def _rename(shown: Sequence[Result | DesiredMotion], titles: Mapping[str, str]) -> None:
    """Call laws and quantities otherwise in figures.

    Raises
    ------
    EqtError
        If none of the results has a law or quantity of some name.
    """
    results = [result for result in shown if isinstance(result, Result)]
    unknown = [set(rename(result, titles)) for result in results] or [set(titles)]
    for name in titles:
        if all(name in names for names in unknown):
            labels = [label for result in results for label in result.labels]
            hint = suggestion(name, labels) or f"; there are: {', '.join(dict.fromkeys(labels))}"
            raise EqtError(f"titles: '{name}' is neither a controller nor a metric{hint}")


@contextmanager
def _opened(
    result: Shown | Sequence[Shown],
    point: int | Sequence[int] | None,
    units: Sequence[str],
    titles: Mapping[str, str],
    *,
    trust_plugins: bool,
) -> Iterator[list[Result | DesiredMotion]]:
    """Open the chosen points of all results as they are to be shown, or build configurations."""
    listed: list[Any] = [result]
    if isinstance(result, Sequence) and not isinstance(result, str):
        listed = list(result)
    if not listed:
        raise EqtError("result: expected one or more results, got none")
    points = _points(point) or [None]
    with ExitStack() as stack:
        opened: list[Result | DesiredMotion] = []
        for shown, number in product(listed, points):
            if isinstance(shown, str | os.PathLike) and Path(shown).suffix not in YAML:
                file = stack.enter_context(open_at(Path(shown), number))
                if trust_plugins:
                    load_plugins(file)
                opened.append(file.in_units(units))
            else:
                opened.append(desired_motion(experiment_at(shown, number)))
        if units and not any(isinstance(shown, Result) for shown in opened):
            raise EqtError("--unit: applies to results; a reference keeps its own units")
        _rename(opened, titles)
        yield opened


def desired_motion(experiment: Experiment) -> DesiredMotion:
    """Return the reference of an experiment, with remarks on it."""
    from eqt_cli.engines.horizon import check_reference
    from eqt_cli.figures.shown import DesiredMotion

    desired, problems = experiment.reference_over_horizon(), Problems(lambda path: "")
    jumps = check_reference(desired, None, problems)
    return DesiredMotion(
        experiment.name,
        experiment.document.path,
        experiment.digest,
        experiment.group,
        (desired.times, desired.pose, desired.velocity, desired.torque),
        [*(problem.message for problem in problems), *jumps],
    )


def folders(
    shown: Result | DesiredMotion,
    out: str | os.PathLike[str] | None,
    point: int | Sequence[int] | None,
) -> tuple[Path, Path]:
    """Return the folder in which eqt writes, and the folder of the figures in it."""
    if out is not None:
        return Path(out), Path(out)
    if not isinstance(shown, Result):
        return Path(FIGURES, shown.name), Path(FIGURES, shown.name)
    within = Path(FIGURES) if point is None else point_folder(*_points(point))
    return shown.path.parent, shown.path.parent / within


def load_plugins(result: Result) -> None:
    """Execute the plugins in a trusted result."""
    from eqt_cli.config.document import load_stored_plugins

    load_stored_plugins(result)
    result.loops_of = partial(loops_of, trust_plugins=True)


def _points(point: int | Sequence[int] | None) -> list[Any]:
    return [point] if isinstance(point, int) else list(point or ())
