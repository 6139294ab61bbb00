"""Paths in the colours of their errors, and the bar that says what a colour means."""

from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure as Drawing

from eqt_cli.base.arrays import Array
from eqt_cli.figures import layout
from eqt_cli.figures.labels import in_words

_LINE, _BEHIND = 1.4, 0.3
"""Line width, pt, and the share of colour in what is on the far side of the sphere."""
_SPREAD = 20.0
"""Ratio of large errors to small ones from which the colours are logarithmic."""
_COLOURS = "plasma"
_DARK, _LIGHT = 0.0, 0.85
"""Shares of the colours that are seen on white."""


def shades_of(errors: Sequence[Array]) -> ScalarMappable:
    """Return the colours of errors: from 0, or logarithmic where most of them differ much.

    Errors of less than one in twenty samples share the colour at the lower end.
    """
    seen = np.concatenate([np.ravel(values) for values in errors])
    seen = seen[np.isfinite(seen)]
    low, high = np.quantile(seen, [0.05, 0.95])
    most = max(float(seen.max()), np.finfo(float).tiny)
    is_log = low > 0 and high > _SPREAD * low
    norm = LogNorm(float(low), most) if is_log else Normalize(0.0, most)
    colours = matplotlib.colormaps[_COLOURS](np.linspace(_DARK, _LIGHT, 256))
    return ScalarMappable(norm, ListedColormap(colours))


def draw_by_error(
    axes: Axes, eye: Array, paths: Array, errors: Array, shades: ScalarMappable, view: str
) -> None:
    """Draw paths ``(runs, samples, 3)`` in pieces, each in the colour of the error at its middle.

    On the sphere, the far side is pale.
    """
    for path, error in zip(paths, errors, strict=True):
        seen = path @ eye.T
        pieces = np.stack([seen[:-1, :2], seen[1:, :2]], axis=1)
        colours = shades.to_rgba((error[:-1] + error[1:]) / 2)
        if view == "sphere":
            white = np.where(seen[1:, 2:] >= 0, 0.0, 1.0 - _BEHIND)
            colours[:, :3] += white * (1.0 - colours[:, :3])
            nearer = np.argsort(white[:, 0] == 0.0, kind="stable")  # drawn over the far side
            pieces, colours = pieces[nearer], colours[nearer]
        look = LineCollection(
            list(pieces), colors=colours, linewidths=_LINE, zorder=2, label=layout.NO_NUMBERS
        )
        look.set_capstyle("round")
        axes.add_collection(look, autolim=False)


def add_bar(drawing: Drawing, panels: Sequence[Axes], shades: ScalarMappable, unit: str) -> None:
    """Add the bar of the colours beside all panels; without a unit, of angles."""
    words = "distance from the reference" if unit else "angle to the reference"
    is_log = isinstance(shades.norm, LogNorm)
    bar = drawing.colorbar(shades, ax=list(panels), extend="min" if is_log else "neither")
    bar.set_label(in_words(words, unit or "deg"))
    bar.ax.set_label(layout.COLOUR_SCALE)
