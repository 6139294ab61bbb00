"""Draws figures of results and experiments, or checks the numbers behind them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eqt_cli.api.checking_logs import read_measured
from eqt_cli.api.loading import at_point, load_experiment
from eqt_cli.api.paths import ResultPath
from eqt_cli.core.errors import EqtError, EqtWarning
from eqt_cli.core.files import YAML
from eqt_cli.core.reporting import reporter, step
from eqt_cli.execution.folder import FIGURES
from eqt_cli.experiment.experiment import Experiment
from eqt_cli.experiment.study import Study
from eqt_cli.logs.recording import Recording
from eqt_cli.results.result import Result, open_result, point_folder

if TYPE_CHECKING:
    from eqt_cli.analysis.certificates.base import Row
    from eqt_cli.plots.kept_numbers import Check

Note = Callable[[str], None]


Shown = ResultPath | Study
"""What figures are drawn of: a result, or an experiment as a YAML file or loaded."""


def plot(
    result: Shown | Sequence[Shown],
    figure: str | Mapping[str, Mapping[str, Any]] | None = None,
    out: str | os.PathLike[str] | None = None,
    *,
    formats: Sequence[str] = ("pdf", "svg", "png"),
    width: str = "column",
    options: Mapping[str, Any] | None = None,
    style: Sequence[str] = (),
    tex: bool = False,
    point: int | Sequence[int] | None = None,
    measured: str | os.PathLike[str] | None = None,
    mapping: str | os.PathLike[str] | Mapping[str, Any] | None = None,
    log_format: str = "csv",
    trust_plugins: bool = False,
    workers: int = 1,
) -> list[Path]:
    """Draw a figure of a result, or one of several, and write it as files.

    Parameters
    ----------
    result
        The result folder, or the file in it; several to draw them in one figure. Or a YAML
        configuration or a `Study`, of which the figures that need no run are drawn.
    figure
        Its name, as ``eqt list figures`` shows them; or several, with the options of each. If not
        given, ``paper``, of a configuration ``reference``, and with a recording ``measured``.
    out
        The folder; ``figures`` in that of the first result if not given, and ``figures/<name>`` for
        a configuration.
    formats
        ``pdf``, ``svg``, ``png``, or ``json`` for the numbers.
    width
        ``column`` (3.5 in) or ``page`` (7.16 in).
    options
        Of the figure, as ``{"log": True}``.
    style
        Matplotlib style sheets to lay over eqt's own.
    tex
        Let LaTeX set the text.
    point
        Of a sweep, counted from 0; several to draw them in one figure.
    measured, mapping, log_format
        A recording to show beside a run, as of `check_log`.
    trust_plugins
        Execute plugin sources that are stored in the result, where the figure shows certificates.
    workers
        Cores to use, where the figure shows certificates.

    Returns
    -------
    list of Path
        The files, one per figure and format.

    Raises
    ------
    EqtError
        If there is no such result, figure or option, or the result lacks what it shows.

    Examples
    --------
    >>> [file.name for file in eqt_cli.plot("results/paper", "torque", formats=["pdf", "svg"])]
    ['torque.pdf', 'torque.svg']
    """
    from eqt_cli.plots.base import Alongside, OfCertificates
    from eqt_cli.plots.drawing.style import Style
    from eqt_cli.plots.figures import figures
    from eqt_cli.plots.render import DRAWN, render
    from eqt_cli.plots.save import check_targets

    with _opened(result, point) as opened:
        first = opened[0]
        figure = figure or (
            "measured" if measured else "paper" if isinstance(first, Result) else "reference"
        )
        wanted = {figure: options or {}} if isinstance(figure, str) else figure
        within = Path(FIGURES) if point is None else point_folder(*_points(point))
        if out is not None:
            home = folder = Path(out)
        elif isinstance(first, Result):
            home, folder = first.path.parent, first.path.parent / within
        else:
            home = folder = Path(FIGURES, first.name)
        targets = [folder / f"{name}.{format}" for name in wanted for format in formats]
        check_targets(targets, home)
        beside = (
            None if measured is None else _recording(first, wanted, measured, mapping, log_format)
        )
        rows: list[Row] = []
        of_certificates = any(issubclass(figures.get(name), OfCertificates) for name in wanted)
        if of_certificates and isinstance(first, Result):
            from eqt_cli.analysis.verification import verify_stored

            rows = verify_stored(first, trust_plugins=trust_plugins, workers=workers).rows
        look = Style(tuple(style), tex)
        files = []
        with step(DRAWN, len(wanted)):
            for name, given in wanted.items():
                files += render(
                    opened,
                    name,
                    folder,
                    formats,
                    width,
                    given,
                    style=look,
                    alongside=Alongside(rows, beside),
                )
                reporter().advance(1)
        return files


def check_figures(
    result: Shown | Sequence[Shown],
    figures: Mapping[str, Mapping[str, Any]],
    folder: str | os.PathLike[str],
    *,
    point: int | Sequence[int] | None = None,
    measured: str | os.PathLike[str] | None = None,
    mapping: str | os.PathLike[str] | Mapping[str, Any] | None = None,
    log_format: str = "csv",
) -> dict[str, Check]:
    """Compare the numbers behind figures with those that `plot` has written as ``json``.

    Parameters
    ----------
    result, point, measured, mapping, log_format
        As of `plot`.
    figures
        Their names, with the options of each.
    folder
        Where the numbers are.

    Returns
    -------
    dict of str to Check
        What differs, by figure.

    Raises
    ------
    EqtError
        If there is no such result, figure, option or file.

    Examples
    --------
    >>> files = eqt_cli.plot("results/paper", "torque", formats=["json"])
    >>> checks = eqt_cli.check_figures("results/paper", {"torque": {}}, files[0].parent)
    >>> checks["torque"].differences
    []
    """
    from eqt_cli.plots.base import Alongside
    from eqt_cli.plots.render import check

    with _opened(result, point) as opened:
        beside = (
            None
            if measured is None
            else _recording(opened[0], figures, measured, mapping, log_format)
        )
        kept, alongside = Path(folder), Alongside(measured=beside)
        return {
            name: check(opened, name, kept, given, alongside) for name, given in figures.items()
        }


def _recording(
    shown: Result | Experiment,
    wanted: Iterable[str],
    measured: str | os.PathLike[str],
    mapping: str | os.PathLike[str] | Mapping[str, Any] | None,
    kind: str,
) -> Recording:
    """A recording on the group of what is shown, for a figure that shows one."""
    from eqt_cli.plots.base import OfMeasured, figures

    if not any(issubclass(figures.get(name), OfMeasured) for name in wanted):
        raise EqtError("measured: no figure that is drawn shows a recording; 'measured' does")
    if shown.group is None:
        raise EqtError(f"measured: group '{shown.group_name}' of a plugin is not known here")
    found = read_measured(measured, shown.group, mapping, kind)
    for note in found.notes:
        reporter().remark(EqtWarning(f"{found.name}: {note}"))
    return found


@contextmanager
def _opened(
    result: Shown | Sequence[Shown], point: int | Sequence[int] | None
) -> Iterator[list[Result | Experiment]]:
    """All chosen points of all results, or of configurations that have not been run."""
    given: list[Shown]
    given = [result] if isinstance(result, str | os.PathLike | Study) else list(result)
    if not given:
        raise EqtError("result: expected a result or several, got none")
    points = _points(point) or [None]
    with ExitStack() as stack:
        yield [_shown(one, number, stack) for one in given for number in points]


def _shown(one: Shown, point: int | None, stack: ExitStack) -> Result | Experiment:
    if not isinstance(one, Study):
        if Path(one).suffix not in YAML:
            return stack.enter_context(open_result(Path(one), point))
        one = load_experiment(one)
    return at_point(one, point)


def _points(point: int | Sequence[int] | None) -> list[Any]:
    return [point] if isinstance(point, int) else list(point or ())
