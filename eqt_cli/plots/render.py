"""Rendering of results to the files of one figure; it knows no single figure."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args

from eqt_cli.core.errors import EqtError, suggestion
from eqt_cli.core.problems import Problems
from eqt_cli.core.registry import summary
from eqt_cli.core.validation import option_names, validated
from eqt_cli.experiment.experiment import Experiment
from eqt_cli.plots import kept_numbers
from eqt_cli.plots.base import NOTHING, Alongside, Figure, OfCertificates
from eqt_cli.plots.curve_data import curves
from eqt_cli.plots.drawing.latex import sentence
from eqt_cli.plots.drawing.style import HOUSE, WIDTHS, Style
from eqt_cli.plots.figures import figures
from eqt_cli.plots.kept_numbers import Check
from eqt_cli.plots.save import Format, encode, write
from eqt_cli.plots.shown.controllers import names
from eqt_cli.results.result import Result

Choice = TypeVar("Choice", bound=str)

FORMATS: tuple[Format, ...] = get_args(Format)
DRAWN = "figures drawn"
"""Name of the progress count of figures."""
NUMBERS: Literal["json"] = "json"
"""Format of the numbers behind the curves, instead of a picture."""


def render(
    results: Sequence[Result | Experiment],
    figure_name: str,
    folder: Path,
    formats: Sequence[str] = FORMATS,
    width: str = "column",
    options: Mapping[str, Any] | None = None,
    *,
    style: Style = HOUSE,
    alongside: Alongside = NOTHING,
    caption: bool = False,
) -> list[Path]:
    """Draw one figure of results and write it as ``<folder>/<figure_name>.<format>``.

    Nothing is written unless every format could be drawn.

    Parameters
    ----------
    results
        Open results to show side by side; or an experiment, for figures without runs.
    figure_name
        Name of a figure in `eqt_cli.plots.figures`.
    width
        One ``column`` of a journal (3.5 in), the ``page`` (7.16 in) or a ``slide`` (13.3 in).
    options
        Fields of the figure to set, as data from a configuration or a command line.
    style
        Style of the figure.
    alongside
        Data that some figures show beside the results.
    caption
        Whether to write the remarks to ``<folder>/<figure_name>-caption.tex``, and not below the
        panels.

    Returns
    -------
    list of Path
        The files, in the order of `formats`; then the caption's.

    Raises
    ------
    EqtError
        If there is no such figure, option, format or width, the style is wrong or needs a LaTeX
        that does not work, the result lacks what the figure shows, or the files cannot be written.
    """
    figure = figure_from(figure_name, options or {})
    wanted = [_one_of("format", given, (*FORMATS, NUMBERS)) for given in formats]
    of_width = _one_of("width", width, list(WIDTHS))
    style = replace(style, width=of_width)
    style.prepare([format for format in wanted if format != NUMBERS])
    told: list[str] = []
    drawing = figure.draw(
        results,
        of_width,
        style=style,
        alongside=alongside,
        arranged=set(wanted) != {NUMBERS},
        captions=told if caption else None,
    )
    title = f"{', '.join(_names(results))}: {figure.name}"
    digests = ", ".join(map(_digest, results))
    description = f"{summary(type(figure))} Experiment {digests}"
    files = {
        folder / f"{figure.name}.{format}": kept_numbers.to_json(curves(drawing))
        if format == NUMBERS
        else encode(drawing, format, title, description, style)
        for format in wanted
    }
    if caption:
        files[folder / caption_name(figure.name)] = as_caption(told, title)
    write(files, folder)
    return list(files)


def caption_name(figure: str) -> str:
    """Return the file name of the caption of a figure."""
    return f"{figure}-caption.tex"


def as_caption(remarks: Sequence[str], title: str) -> bytes:
    r"""Return remarks as sentences to ``\input`` in a ``\caption``, under a titled comment."""
    return f"% caption by eqt: {title}\n{' '.join(map(sentence, remarks))}%\n".encode()


def check(
    results: Sequence[Result | Experiment],
    figure_name: str,
    folder: Path,
    options: Mapping[str, Any] | None = None,
    alongside: Alongside = NOTHING,
) -> Check:
    """Compare the numbers behind the curves of a figure with ``<folder>/<figure_name>.json``.

    Raises
    ------
    EqtError
        If there is no such figure or option, the result lacks what the figure shows, its numbers
        are rounding errors, or there is no such file, which `render` writes as format ``json``.
    """
    figure = figure_from(figure_name, options or {})
    if isinstance(figure, OfCertificates):
        raise EqtError(
            f"figure '{figure.name}' shows rounding errors, which differ from machine to machine; "
            "`eqt verify` checks them against their bounds"
        )
    expected = kept_numbers.read(folder / f"{figure.name}.{NUMBERS}")
    drawing = figure.draw(results, alongside=alongside, arranged=False)
    return kept_numbers.compare(curves(drawing), expected)


def _names(shown: Sequence[Result | Experiment]) -> list[str]:
    results = [one for one in shown if isinstance(one, Result)]
    return names(results) + [one.name for one in shown if isinstance(one, Experiment)]


def _digest(one: Result | Experiment) -> str:
    return one.digest if isinstance(one, Experiment) else str(one.attributes.get("digest", ""))


def options_of(name: str) -> list[str]:
    """Return the names of the options of a figure.

    Raises
    ------
    ComponentError
        If there is no such figure.
    """
    return option_names(figures.get(name))


def figure_from(name: str, options: Mapping[str, Any]) -> Figure[Any]:
    """Return the figure of this name with these options.

    Raises
    ------
    EqtError
        If there is no such figure or option, or the value of an option is invalid.
    """
    problems = Problems(lambda path: f"figure '{name}'")
    figure: Figure[Any] | None = validated(figures.get(name), options, problems)
    problems.raise_if_any()
    assert figure is not None  # no problems were found
    return figure


def _one_of(what: str, given: str, known: Sequence[Choice]) -> Choice:
    """Return the given word if it is known; else raise an error."""
    for word in known:
        if word == given:
            return word
    hint = suggestion(given, known) or ";"
    raise EqtError(f"unknown {what} '{given}'{hint} known: {', '.join(known)}")
