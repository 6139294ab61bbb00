"""Numbers behind the curves of a drawing; it knows no single figure and no file format."""

import re
import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection, PolyCollection, QuadMesh
from matplotlib.figure import Figure as Drawing

from eqt_cli.core.arrays import Array
from eqt_cli.plots.drawing.layout import COLOUR_SCALE, NO_NUMBERS

MOST_SAMPLES = 101
"""Most samples that are kept of a curve: the first, the last, and others evenly between."""

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
    kept = []
    named = [text for axes in drawing.axes if (text := plain(axes.get_xlabel()))]
    up = ""
    for number, axes in enumerate(drawing.axes, start=1):
        across = plain(axes.get_xlabel()) or (named[-1] if named else "")
        up = plain(axes.get_ylabel()) or up
        panel = str(axes.get_label()) or f"panel {number}"
        if panel == COLOUR_SCALE:
            continue
        for name, x, y in _shown(axes):
            chosen = _kept(len(x))
            kept.append(Curve(panel, name, across, up, x[chosen], y[chosen]))
    return kept


def plain(label: str) -> str:
    r"""Strip a label of typesetting: ``‖τ‖ (N m)`` for ``$\|\tau\|$ $(\mathrm{N\,m})$``."""
    words = label.replace(r"\|", "‖").replace(r"\,", " ")
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
        x, y = map(_numbers, line.get_data(orig=False))
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


def _kept(count: int) -> Array:
    step = max(1, -(-(count - 1) // (MOST_SAMPLES - 1)))
    return np.unique(np.append(np.arange(0, count, step), count - 1))
