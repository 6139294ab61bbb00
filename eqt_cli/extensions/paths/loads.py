"""Which share of its limit each of many thrusters or wheels takes: a map over time per law."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Drawing
from matplotlib.patches import Patch

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array
from eqt_cli.figures import layout
from eqt_cli.figures.figure import MOST, ShownRuns, first_laws
from eqt_cli.figures.labels import free_text
from eqt_cli.figures.style import Width, ink, mixed, size_of_type
from eqt_cli.figures.time_figures import LEAST_SHADE, NEAR, stretches

_LEVELS = (0.1, 0.25, 0.5, 1 - NEAR)
"""Shares of a limit from which a bar has the next shade; below the first, there is none."""
_SHADES = (0.25, 0.5, 0.8)
"""Shares of colour in the bars below a limit."""
_WORDS = ("10–25 %", "25–50 %", "50–100 % of a limit", "at a limit")
_BINS = 150
"""Most parts of the time, each of which shows the largest share in it."""
_TALL, _AROUND = 0.8, 0.3
"""Height of a bar, where rows are 1 apart; height of the title and numbers of a panel, in."""
_LONGEST, _LEAST_NAME = 18, 5.6
"""Most characters of a name, and least size of its type, pt."""


@purposes.figure_of_loads
def draw_loads(
    runs: ShownRuns, width: Width, members: Mapping[str, int], signal: str, run: int
) -> Drawing:
    """Draw a panel per law, with a row for each member.

    Parameters
    ----------
    members
        Position of each thruster or wheel in the signal, by name.
    signal, run
        ``thrust`` or ``wheel_momentum``, and the number of the run.
    """
    laws = first_laws(runs, 2 * MOST[width])
    columns = max(-(-len(laws) // MOST["column"]), 1 if width == "column" else 2)
    mosaic = layout.rows_of([e.label for e in laws], min(columns, len(laws)))
    drawing, panels = layout.sheet(width, mosaic, runs.span, runs.unit("time"))
    room = 72 * (drawing.get_figheight() / len(mosaic) - _AROUND) / len(members)
    shades = [mixed(laws[0].look.colour, ink(0), share) for share in _SHADES] + [ink()]
    limits = []
    for e in laws:
        axes, places = panels[e.label], list(members.values())
        values = runs.of_run(signal, e, run)[:, places]
        ends = runs.limits(e, run, signal)
        assert ends is not None  # else each member has a curve
        limits.append([end[places] for end in ends])
        shares = _shares(values, *limits[-1])
        levels = np.digitize(shares, _LEVELS)
        starts = np.unique(np.linspace(0, len(values), _BINS, endpoint=False).astype(int))
        times, levels = runs.times(e)[starts], np.maximum.reduceat(levels, starts)
        least = LEAST_SHADE * (runs.span[1] - runs.span[0]) / 2
        for number, colour in enumerate(shades, start=1):
            for row, of_member in enumerate(levels.T):
                ends_at_limit = stretches(times, of_member == number)
                wide = least if number == len(shades) else 0.0
                bars = [(start, max(end - start, wide)) for start, end in ends_at_limit]
                look: dict[str, Any] = {
                    "facecolor": colour,
                    "linewidth": 0,
                    "label": layout.NO_NUMBERS,
                }
                axes.broken_barh(bars, (row - _TALL / 2, _TALL), **look)
        axes.set_yticks(range(len(places)), [free_text(name, _LONGEST) for name in members])
        axes.set_ylim(len(places) - 0.5, -0.5)
        size = min(size_of_type("ytick.labelsize"), max(_LEAST_NAME, 0.9 * room))
        axes.tick_params(axis="y", length=0, labelsize=size)
        for row, most in enumerate(100 * shares.max(axis=0)):
            place: dict[str, Any] = {"xycoords": ("axes fraction", "data"), "va": "center"}
            axes.annotate(f"{most:.0f} %", (1.08, row), ha="right", fontsize=size, **place)
        axes.grid(visible=False, axis="y")
        layout.open_frame(axes)
        layout.add_title(axes, e.title)
    layout.hide_inner_scales(panels, mosaic)
    patches = [Patch(facecolor=colour, linewidth=0) for colour in shades]
    layout.add_legend(drawing, patches, _WORDS)
    low, high = (_span(np.array([of_law[k] for of_law in limits])) for k in (0, 1))
    between = f"limits {low} and {high} {runs.unit(signal)}; numbers: largest share"
    runs.remarks.append(f"Run {run}; {between}.")
    runs.note = ", ".join(filter(None, [f"run {run}", between, runs.note]))
    words = signal.replace("_", " ")
    drawing.set_label(f"Share of its limit that each {words} takes in one run, a panel per law.")
    return drawing


def _shares(values: Array, low: Array, high: Array) -> Array:
    """Return the share of the limit on their side that values ``(samples, members)`` take."""
    ends = np.where(values < 0, low, high)
    return np.divide(values, ends, out=np.zeros_like(values), where=(ends != 0) & (values != 0))


def _span(ends: Array) -> str:
    """Return a limit in words, or the range of several."""
    words = [f"{end:.3g}".replace("-", "−") for end in (ends.min(), ends.max())]
    return words[0] if words[0] == words[1] else " to ".join(words)
