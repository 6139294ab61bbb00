"""The forest of the suite: a panel for each task, a row for each law, its ratio to GT."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import NullFormatter, ScalarFormatter

from eqt_cli.base.errors import EqtError
from eqt_cli.base.files import write_all
from eqt_cli.extensions.suite.archive import Archive
from eqt_cli.extensions.suite.tasks import REFERENCE
from eqt_cli.extensions.suite.verdicts import TaskVerdict
from eqt_cli.figures.labels import free_text
from eqt_cli.figures.layout import blank_sheet, freeze
from eqt_cli.figures.render import encode, format_of
from eqt_cli.figures.style import house_style, ink

_ROW, _AROUND = 0.13, 0.55
"""Height of a row, and of what is around the rows of a panel, in."""

_COLUMNS = 3

MOST_TICKS = 5
"""Largest number of marked ratios of a panel."""

_TICKS = (
    (0.8, 0.9, 1.0, 1.1, 1.2),
    (0.2, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0),
    (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0),
    (0.01, 0.1, 1.0, 10.0, 100.0),
)
"""Ratios that are marked, the closest first."""


def forest(of_tasks: Sequence[TaskVerdict], archive: Archive, path: Path) -> None:
    """Draw the ratios of all laws by task, the new laws in the last rows.

    Raises
    ------
    EqtError
        For another kind of file, or one that cannot be written.
    """
    format = format_of(path)
    names = list(dict.fromkeys(judgement.task for judgement in of_tasks))
    if not names:
        raise EqtError("there is no law to draw; the archive has no GT")
    laws = [
        x
        for x in archive.laws
        if x != REFERENCE and any(judgement.law == x for judgement in of_tasks)
    ]
    columns = min(_COLUMNS, len(names))
    rows = [names[k : k + columns] for k in range(0, len(names), columns)]
    mosaic = [[*row, *["."] * (columns - len(row))] for row in rows]
    with house_style():
        drawing, panels = blank_sheet("page", mosaic, _ROW * len(laws) + _AROUND)
        for name in names:
            axes = panels[name]
            axes.axvline(1, color=ink(0.5), linewidth=0.6, label="GT")
            for place, law in enumerate(laws):
                judgement = next((x for x in of_tasks if (x.law, x.task) == (law, name)), None)
                if judgement is not None:
                    _draw(axes, place, judgement, archive.laws[law].title)
            axes.set_xscale("log")
            axes.xaxis.set_major_formatter(ScalarFormatter())
            axes.xaxis.set_minor_formatter(NullFormatter())
            _set_range(axes, [x for x in of_tasks if x.task == name])
            is_first = any(name == row[0] for row in rows)
            titles = [free_text(archive.laws[law].title, 24) for law in laws]
            axes.set_yticks(np.arange(len(laws)), titles if is_first else [""] * len(laws))
            axes.set_ylim(len(laws) - 0.4, -0.6)
            axes.grid(axis="y", visible=False)
            axes.tick_params(axis="y", length=0)
            axes.set_title(free_text(name, 40))
            if name in rows[-1]:
                axes.set_xlabel("mean error, ratio to GT")
        freeze(drawing)
        content = encode(drawing, format, "Laws against GT by task")
    write_all({path: content}, path.parent)


def _draw(panel: Axes, place: int, judgement: TaskVerdict, title: str) -> None:
    ratio = judgement.ratio
    if ratio is None:
        panel.text(
            0.5,
            place,
            judgement.failure or "fails",
            transform=panel.get_yaxis_transform(),
            ha="center",
            va="center",
            color=ink(0.6),
        )
        return
    if math.isfinite(ratio.low):
        panel.plot([ratio.low, ratio.high], [place] * 2, color=ink(0.8), lw=0.9)
    is_open = judgement.verdict == "undecided"
    panel.plot(
        [ratio.value],
        [place],
        "D",
        ms=3,
        color=ink(0.8),
        mfc=ink(0) if is_open else ink(0.8),
        label=title,
    )


def _set_range(axes: Axes, rows: Sequence[TaskVerdict]) -> None:
    ends = [1.0]
    for judgement in rows:
        if judgement.ratio is not None:
            ends += [
                x for x in (judgement.ratio.low, judgement.ratio.high) if math.isfinite(x) and x > 0
            ]
    low, high = min(ends) / 1.1, max(ends) * 1.1
    axes.set_xlim(low, high)
    for places in _TICKS:
        ticks = [x for x in places if low < x < high]
        if len(ticks) <= MOST_TICKS and places[0] <= low * 2 and high <= 2 * places[-1]:
            break
    axes.set_xticks(ticks)
