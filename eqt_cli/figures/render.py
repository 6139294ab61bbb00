"""The files of one figure: its drawing, equal byte for byte, and the numbers behind its curves."""

import json
import logging
import os
import re
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args
from xml.sax.saxutils import unescape

import numpy as np
from matplotlib import font_manager, rc_context, rcParams, textpath
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection, PolyCollection, QuadMesh
from matplotlib.figure import Figure as Drawing

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError, Problems, suggestion
from eqt_cli.base.files import write_all
from eqt_cli.base.option_types import validated
from eqt_cli.base.registry import summary
from eqt_cli.base.version import __version__
from eqt_cli.figures.figure import Figure, figures
from eqt_cli.figures.layout import COLOUR_SCALE, NO_NUMBERS
from eqt_cli.figures.shown import DesiredMotion, names
from eqt_cli.figures.style import ENLARGED, HOUSE, Style, house_style, sentence, width_of
from eqt_cli.results.result import Result

Format = Literal["pdf", "svg", "png", "tiff"]

_DATE = "SOURCE_DATE_EPOCH"

_SIZE = re.compile(r'(?<= )(width|height)="([0-9.]+)pt"')
"""Width or height in an SVG file; those of the whole picture come first."""

_TEXT = re.compile(r'<text (style="font-size: ([\d.]+)px; font-family: ([^;"]*)[^>]*)>([^<]*)<')
"""A text in an SVG file, with its size, fonts and letters; of formulas, none."""

_LEFTWARD = re.compile("[\u0590-\u08ff](?:[^A-Za-z]*[\u0590-\u08ff])?")
"""Letters from right to left, with what is between them."""

_MAKER = f"eqt {__version__}"
_SOFTWARE = 305
"""Tag of the program that wrote a TIFF file."""

logging.getLogger("fontTools").setLevel(logging.ERROR)  # it remarks on dates in Matplotlib's fonts


def format_of(path: Path) -> Format:
    """Return the format of the file of a picture.

    Raises
    ------
    EqtError
        For another kind of file.
    """
    format: Format | None = next((x for x in get_args(Format) if path.suffix == f".{x}"), None)
    if format is None:
        raise EqtError(f"--figure {path}: expected a file that ends in .pdf, .svg, .png or .tiff")
    return format


def encode(
    drawing: Drawing,
    format: Format,
    title: str = "",
    description: str = "",
    style: Style = HOUSE,
    *,
    letters: Literal["none", "path"] = "none",
) -> bytes:
    """Return the content of a file of a drawing, in its style; its panels are frozen already.

    The content holds no date and no random name. With the letters `path`, those of an SVG are
    curves, for a reader who may lack the fonts.
    """
    buffer = BytesIO()
    times = ENLARGED[style.width]
    more: dict[str, Any] = {"metadata": _metadata(format, title, description)}
    # Without the layout of the style, for which Matplotlib draws everything twice.
    arranged = rc_context({"figure.constrained_layout.use": False, "svg.fonttype": letters})
    with house_style(style), arranged, _without_date():
        drawing.set_layout_engine(None)
        if format in ("png", "tiff"):
            dots = drawing.dpi if rcParams["savefig.dpi"] == "figure" else rcParams["savefig.dpi"]
            more |= {"dpi": times * dots, "pil_kwargs": {"dpi": (dots, dots)}}
        if format == "tiff":
            del more["metadata"]
            more["pil_kwargs"] |= {"compression": "tiff_lzw", "tiffinfo": {_SOFTWARE: _MAKER}}
        drawing.savefig(buffer, format=format, **more)
    if format != "svg":
        return buffer.getvalue()
    text = _TEXT.sub(_as_wide, buffer.getvalue().decode())
    return _SIZE.sub(lambda x: f'{x[1]}="{times * float(x[2]):g}pt"', text, count=2).encode()


def _as_wide(text: re.Match[str]) -> str:
    """Return a text as wide in a reader's fonts as in ours, and its order from left to right."""
    font = font_manager.FontProperties(family=text[3].split("'")[1::2], size=float(text[2]))
    width = textpath.text_to_path.get_text_width_height_descent(unescape(text[4]), font, False)[0]
    adjusted = f'textLength="{width:g}" lengthAdjust="spacingAndGlyphs"'
    return f"<text {adjusted} {text[1]}>" + _LEFTWARD.sub("\u2068\\g<0>\u2069", text[4]) + "<"


@contextmanager
def _without_date() -> Iterator[None]:
    """Hide the build date variable, which Matplotlib reads even if a file is to hold no date."""
    date = os.environ.pop(_DATE, None)
    try:
        yield
    finally:
        if date is not None:
            os.environ[_DATE] = date


def _metadata(format: Format, title: str, description: str) -> dict[str, str | None]:
    title, description = (  # without control characters, which XML cannot hold
        "".join(letter if letter.isprintable() else " " for letter in text)
        for text in (title, description)
    )
    if format == "pdf":
        return {"Title": title, "Subject": description, "Creator": _MAKER, "CreationDate": None}
    if format == "svg":
        return {"Title": title, "Description": description, "Creator": _MAKER, "Date": None}
    return {"Title": title, "Description": description, "Software": _MAKER}


MOST_SAMPLES = 101
"""Most samples that are kept of a curve: the first, the last, and others evenly between."""

DIGITS = 9
"""Significant digits that a file keeps."""

_UNNAMED = re.compile(r"_child\d+")
"""Matplotlib's labels of unnamed curves."""


@dataclass(frozen=True)
class Curve:
    """Numbers of one curve.

    Attributes
    ----------
    panel
        Name of its panel, unique in the figure.
    name
        Name of the curve, unique in the panel.
    across, up
        Labels of the scales with their units, in plain text.
    x, y : (samples,)
        Numbers in these units; at most `MOST_SAMPLES`.
    """

    panel: str
    name: str
    across: str
    up: str
    x: Array
    y: Array


def curves(drawing: Drawing) -> list[Curve]:
    """Return lines, edges of bands, points and maps, panel by panel.

    Only the lowest panels name the time axis, and the leftmost the vertical one; the other panels
    take the names from there.
    """
    curves_of = []
    named = [text for axes in drawing.axes if (text := plain(axes.get_xlabel()))]
    up = ""
    for number, axes in enumerate(drawing.axes, start=1):
        across = plain(axes.get_xlabel()) or (named[-1] if named else "")
        up = plain(axes.get_ylabel()) or up
        panel = str(axes.get_label()) or f"panel {number}"
        if panel == COLOUR_SCALE:
            continue
        formatters = (axis.get_major_formatter() for axis in (axes.xaxis, axes.yaxis))
        wide, tall = (getattr(numbers, "factor", 1.0) for numbers in formatters)
        for name, x, y in _shown(axes):
            every = max(1, -(-(len(x) - 1) // (MOST_SAMPLES - 1)))
            chosen = np.unique(np.append(np.arange(0, len(x), every), len(x) - 1))
            curves_of.append(Curve(panel, name, across, up, wide * x[chosen], tall * y[chosen]))
    return curves_of


def plain(label: str) -> str:
    r"""Strip a label of typesetting: ``‖τ‖ (N m)`` for ``$\|\tau\|$ $(\mathrm{N\,m})$``."""
    words = label.replace(r"\|", "‖").replace(r"\,", " ").replace("\n", " ")
    return re.sub(r"[${}\\]", "", re.sub(r"\\([a-z]+)(?: (?=\w))?", _letter, words))


def _letter(command: re.Match[str]) -> str:
    r"""Return the Greek letter of a command such as ``\tau``; empty for commands of fonts."""
    name = command[1].upper().replace("LAMBDA", "LAMDA")
    try:
        return unicodedata.lookup(f"GREEK SMALL LETTER {name}")
    except KeyError:
        return ""


def _shown(axes: Axes) -> Iterator[tuple[str, Array, Array]]:
    """Yield name and numbers of everything drawn in a panel."""
    for index, line in enumerate(axes.lines, start=1):
        if line.get_label() == NO_NUMBERS:
            continue
        # Also of samples that are masked since they lie below a logarithmic scale.
        x, y = line.get_xdata(orig=False), np.ma.getdata(line.get_ydata())
        x, y = map(_numbers, (x, y))
        yield _name(line.get_label(), f"line {index}"), x, y
    for index, shape in enumerate(axes.collections, start=1):
        if shape.get_label() == NO_NUMBERS:
            continue
        name = _name(shape.get_label(), f"{index}")
        if isinstance(shape, QuadMesh):
            cells = _numbers(shape.get_array()).ravel()
            yield f"cells {name}", np.arange(len(cells)), cells
        elif isinstance(shape, PathCollection):
            points = _numbers(shape.get_offsets())
            yield f"points {name}", points[:, 0], points[:, 1]
        elif isinstance(shape, PolyCollection):
            corners = np.concatenate([_numbers(path.vertices) for path in shape.get_paths()])
            corners = corners[np.argsort(corners[:, 0], kind="stable")]
            x, first = np.unique(corners[:, 0], return_index=True)
            y = corners[:, 1]
            yield f"lower edge {name}", x, np.minimum.reduceat(y, first)
            yield f"upper edge {name}", x, np.maximum.reduceat(y, first)


def _name(label: object, otherwise: str) -> str:
    return otherwise if not label or _UNNAMED.fullmatch(str(label)) else str(label)


def _numbers(values: object) -> Array:
    """Return numbers, with NaN where Matplotlib masks them."""
    return np.ma.filled(np.ma.asarray(values, dtype=float), np.nan)


def to_json(curves: Sequence[Curve]) -> bytes:
    """Return the content of a file, a line per name and list of numbers for readable diffs."""
    return b"[\n" + b",\n".join(_record(curve).encode() for curve in curves) + b"\n]\n"


def _record(curve: Curve) -> str:
    names = ("panel", "name", "across", "up")
    texts = [f'"{k}": {json.dumps(getattr(curve, k), ensure_ascii=False)}' for k in names]
    numbers = [f'"{k}": [{", ".join(map(_text, getattr(curve, k)))}]' for k in ("x", "y")]
    return "{" + ",\n ".join([*texts, *numbers]) + "}"


def _text(value: float) -> str:
    return f"{value:.{DIGITS}g}" if np.isfinite(value) else "null"


Choice = TypeVar("Choice", bound=str)

FORMATS: tuple[Format, ...] = ("pdf", "svg", "png")
"""Formats of a picture that nobody asked for by name."""
DRAWN = "figures drawn"
"""Name of the progress count of figures."""
NUMBERS: Literal["json"] = "json"
"""Format of the numbers behind the curves, instead of a picture."""


def render(
    results: Sequence[Result | DesiredMotion],
    figure_name: str,
    folder: Path,
    formats: Sequence[str] = FORMATS,
    width: str = "column",
    options: Mapping[str, Any] | None = None,
    *,
    style: Style = HOUSE,
    measured: Any = None,
) -> list[Path]:
    """Draw one figure of results and write it as ``<folder>/<figure_name>.<format>``.

    On a slide, remarks stand below the panels; else in ``<folder>/<figure_name>-caption.tex`` and
    in the metadata.

    Nothing is written unless every format could be drawn.

    Parameters
    ----------
    results
        Open results to show side by side; or a reference, for figures without runs.
    figure_name
        Name of a figure in `eqt_cli.figures.figure`.
    width
        One ``column`` of a journal (3.5 in), the ``page`` (7.16 in) or a ``slide`` (13.3 in).
    options
        Fields of the figure to set, as data from a configuration or a command line.
    style
        Style of the figure.
    measured
        A recording on the group of the results, which some figures show beside them.

    Returns
    -------
    list of Path
        The files, in the order of `formats`; then the caption's.

    Raises
    ------
    EqtError
        If there is no such figure, option, format or width, the style is wrong, the result lacks
        what the figure shows, or the files cannot be written.
    """
    figure = figure_from(figure_name, options or {})
    wanted = [one_of("format", name, (*get_args(Format), NUMBERS)) for name in formats]
    of_width, inches = width_of(width)
    style = replace(style, width=of_width, inches=inches)
    captions: list[str] = []
    drawing = figure.draw(
        results,
        of_width,
        style=style,
        measured=measured,
        arranged=set(wanted) != {NUMBERS},
        captions=None if of_width == "slide" else captions,
    )
    of_results = names([x for x in results if isinstance(x, Result)])
    of_motions = [x.name for x in results if isinstance(x, DesiredMotion)]
    title = f"{', '.join([*of_results, *of_motions])}: {figure.name}"
    digests = ", ".join(
        x.digest if isinstance(x, DesiredMotion) else str(x.attributes.get("digest", ""))
        for x in results
    )
    said = map(plain, [str(drawing.get_label()) or summary(type(figure)), *captions])
    description = f"{' '.join(said)} Experiment {digests}"
    files = {
        folder / f"{figure.name}.{format}": to_json(curves(drawing))
        if format == NUMBERS
        else encode(drawing, format, title, description, style)
        for format in wanted
    }
    if captions and {*wanted} != {NUMBERS}:
        # Sentences to `\input` in a `\caption`.
        text = f"% caption by eqt: {title}\n{' '.join(map(sentence, captions))}%\n"
        files[folder / f"{figure.name}-caption.tex"] = text.encode()
    write_all(files, folder)
    return list(files)


def first_figure(shown: Result | DesiredMotion) -> str:
    """Return the figure to draw first: of the experiment `paper`, that of the paper."""
    default = "reference" if isinstance(shown, DesiredMotion) else "summary"
    return "paper" if isinstance(shown, Result) and shown.title == "paper" else default


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


def one_of(what: str, name: str, words: Sequence[Choice]) -> Choice:
    """Return the given word if it is known; else raise an error."""
    for word in words:
        if word == name:
            return word
    hint = suggestion(name, words) or ";"
    raise EqtError(f"unknown {what} '{name}'{hint} known: {', '.join(words)}")
