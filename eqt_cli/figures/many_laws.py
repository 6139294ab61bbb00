"""A panel for each of many laws: its median before those of the others, sorted by the error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure as Drawing
from matplotlib.lines import Line2D

from eqt_cli.base.arrays import Array
from eqt_cli.base.reporting import significant
from eqt_cli.figures import layout
from eqt_cli.figures.cells import scale_log, spans_decade
from eqt_cli.figures.figure import ShownRuns
from eqt_cli.figures.layout import FAR, NO_NUMBERS, diverging
from eqt_cli.figures.shown import Ensemble
from eqt_cli.figures.style import Width, ink

_COLUMNS: dict[Width, int] = {"column": 3, "page": 5, "slide": 6}
_GREY = 0.25
"""Share of ink in the medians of the other laws."""
_LIMIT = 0.7
"""Share of ink in the dashes of a limit."""
_SETTLED = "thin dashes: threshold of settled"
_MOST_SAMPLES = 100
"""About how many samples of a grey median are drawn: all of many laws would fill a page of HTML."""
_CLOSING = 0.1
"""Share of the horizon over which the values are averaged that sort the laws."""
_BULK = 0.25
"""Share of the laws below whose closing values a logarithmic scale may end."""


def draw_laws(
    runs: ShownRuns,
    width: Width,
    signal: str,
    *,
    degrees: bool = False,
    log: bool | None = None,
    values: Mapping[str, Array] | None = None,
) -> Drawing:
    """Draw the median and quartiles over runs of a signal, a panel for each law.

    The medians of the other laws are grey. Panels are sorted by the mean of the median: of an error
    over the last tenth of the horizon, of a torque over all of it. The scale, one for all panels,
    shows the bulk of the laws; a law that leaves it has the value at which it ends.

    Parameters
    ----------
    signal
        A norm that `ShownRuns.errors` takes; empty for the pose error, on SE(n) the angle of the
        attitude error and the distance. The label of the scale of `values`.
    degrees
        The angle of the attitude error, in degrees, of the pose error.
    log
        Logarithmic scale. Default: for errors whose medians span more than a decade.
    values : of (runs, samples)
        What to draw of each law, by label, instead of a stored signal.
    """
    signals = [
        signal + part if signal else runs.drawn_signal(f"pose_error{part}") for part in runs.parts
    ]
    signals = [signal] if values is not None else signals
    drawn = dict[str, dict[str, Array]]()
    for name in signals:
        of = values or {e.label: runs.errors(name, e, degrees=degrees) for e in runs.shown}
        drawn[name] = {law: np.quantile(x, (0.5, 0.25, 0.75), axis=0) for law, x in of.items()}
    is_torque = signal == "torque_norm"
    share, first = 1.0 if is_torque else _CLOSING, drawn[signals[0]]
    order = by_late_mean({label: of[0] for label, of in first.items()}, share)
    laws = {e.label: e for e in runs.shown}
    rows = int(layout.TALLEST[width] / layout.LOWEST_PANEL) // len(signals)
    columns = min(max(_COLUMNS[width], -(-len(order) // rows)), _COLUMNS[width] + 1)
    places: layout.Mosaic = []
    for name in signals:
        of_part = [f"{name} of {label}" for label in order]
        places += layout.rows_of(of_part, min(len(order), columns))
    drawing, panels = layout.sheet(width, places, runs.span, runs.unit("time"))
    for name in signals:
        column = [panels[f"{name} of {label}"] for label in order]
        layout.share_scale(column)
        for label, axes in zip(order, column, strict=True):
            _draw(axes, runs, laws[label], drawn[name], runs.shown[0].look.colour)
        middles = [drawn[name][label][0] for label in order]
        is_log = not is_torque and spans_decade(np.concatenate(middles)) if log is None else log
        error = runs.solver_error(name, np.concatenate(middles), degrees=degrees)
        _bound(column, middles, error, log=is_log)
        layout.hide_inner_scales(panels, places)
        left = [row[0] for row in places if row[0].startswith(f"{name} of ")]
        label = signal if values is not None else runs.error_label(name, degrees=degrees)
        panels[left[(len(left) - 1) // 2]].set_ylabel(label)
    differ = any(not np.array_equal(*of[1:]) for of in drawn[signals[0]].values())
    names = ["the law: median, quartiles", "the others: medians"]
    colours = runs.shown[0].look.colour, ink(_GREY)
    handles = [Line2D([], [], color=colour) for colour in colours]
    layout.add_legend(drawing, handles, names if differ else ["the law", "the others"])
    by = "mean" if is_torque else "closing error"
    by += f", {runs.count()}" if values is None else ""
    by += ", * gains not matched" if any(map(_mark, runs.shown)) else ""
    runs.remarks.append(f"Sorted by {by}.")
    runs.note = ", ".join(filter(None, [f"sorted by {by}", runs.note]))
    for name in signals:
        mark_settled(runs, name, [panels[f"{name} of {label}"] for label in order], degrees)
    what = "Median and quartiles over runs" if differ else "One curve"
    drawing.set_label(f"{what}, a panel for each law; grey: the others.")
    return drawing


def by_late_mean(middles: Mapping[str, Array], share: float = _CLOSING) -> list[str]:
    """Return the labels of laws, that with the least mean over the last share of time first."""
    return sorted(middles, key=lambda label: _late_mean(middles[label], share))


def limit_look() -> dict[str, Any]:
    """Return the look of a limit."""
    return {"color": ink(_LIMIT), "linewidth": 0.6, "linestyle": (0, (6, 2)), "zorder": 1.5}


def mark_settled(runs: ShownRuns, signal: str, panels: Sequence[Axes], degrees: bool) -> None:
    """Draw the error below which a run is settled, and say so, where a scale reaches it."""
    below = runs.settled_below(signal, degrees=degrees)
    for axes in panels:
        low, high = axes.get_ylim()
        if low < below < high:
            across = axes.get_yaxis_transform()
            ends = [[(0, below), (1, below)]]
            line = LineCollection(ends, transform=across, label=NO_NUMBERS, **limit_look())
            axes.add_collection(line, autolim=False)
            if _SETTLED not in runs.note:
                runs.remarks.append(f"{_SETTLED[0].upper()}{_SETTLED[1:]}.")
                runs.note = ", ".join(filter(None, [runs.note, _SETTLED]))


def _late_mean(middle: Array, share: float) -> float:
    """Return the mean over the last share of the samples."""
    return float(middle[-max(1, round(share * len(middle))) :].mean())


def _draw(
    axes: Axes, runs: ShownRuns, law: Ensemble, drawn: Mapping[str, Array], colour: str
) -> None:
    """Draw the curves of a panel, with the name of its law."""
    thin = max(1, len(runs.times(law)) // _MOST_SAMPLES)
    others = [
        np.column_stack([runs.times(e), drawn[e.label][0]])[::thin]
        for e in runs.shown
        if e is not law
    ]
    grey = LineCollection(others, colors=ink(_GREY), linewidths=0.5, zorder=1.4, label=NO_NUMBERS)
    axes.add_collection(grey, autolim=False)
    times, (middle, low, high) = runs.times(law), drawn[law.label]
    axes.plot(times, middle, color=colour, label=law.label, linewidth=1.2)
    if not np.array_equal(low, high):
        axes.fill_between(times, low, high, label=law.label, **layout.band_look(colour))
    layout.open_frame(axes)
    layout.add_title(axes, law.title + _mark(law), at_right=True)


def _mark(law: Ensemble) -> str:
    """Return the mark of a law whose gains are not matched with those of the others."""
    return "*" if law.law in law.results.described.not_matched else ""


def _bound(panels: Sequence[Axes], middles: Sequence[Array], error: float, *, log: bool) -> None:
    """Set the one scale by the bulk of the laws, and say where the others end."""
    curves = dict(zip(map(str, range(len(panels))), middles, strict=True))
    far = diverging(curves)
    near = [curve for name, curve in curves.items() if name not in far]
    top, bottom = 1.05 * max(float(curve.max()) for curve in near), 0.0
    if log and any((curve > 0).any() for curve in near):
        ends = [_late_mean(curve, _CLOSING) for curve in near]
        bottom = min(max(float(np.quantile(ends, _BULK)) / FAR, error), top / FAR)
        scale_log(panels[0], "y", np.array([bottom, top]))
    panels[0].set_ylim(bottom, top * FAR if far else top)
    look: dict[str, Any] = {"xycoords": "axes fraction", "fontsize": "small"}
    for axes, (name, curve) in zip(panels, curves.items(), strict=True):
        if name in far:
            axes.annotate("diverges", (0.97, 0.95), ha="right", va="top", **look)
        elif curve[-1] < bottom:
            last = significant(float(curve[-1]), 1).replace("e-0", "e−")
            axes.annotate(f"to {last}", (0.03, 0.05), va="bottom", **look)
