"""The picture of a budget: a bar for each source, alone and with the others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from eqt_cli.base.files import write_all
from eqt_cli.extensions.budget.tables import WORDS, BudgetInWords
from eqt_cli.figures.labels import free_text
from eqt_cli.figures.layout import add_legend, blank_sheet, freeze
from eqt_cli.figures.render import encode, format_of
from eqt_cli.figures.style import house_style, ink, line_style

_ROW = 0.2
"""Height of a row, in."""


def draw(said: BudgetInWords, path: Path) -> None:
    """Draw the budget of each law in a panel of its own, in a pdf, svg or png.

    Raises
    ------
    EqtError
        For another kind of file, or one that cannot be written.
    """
    format = format_of(path)
    budget = said.budget
    unit, scale = said.unit, said.scale
    with house_style():
        rows = max(len(law.rows) for law in budget.laws) + 1
        names = [[law.label] for law in budget.laws]
        drawing, panels = blank_sheet("page", names, _ROW * rows + 0.5)
        for k, law in enumerate(budget.laws):
            axes, shown = panels[law.label], law.rows
            look = line_style(k)
            places = np.arange(len(shown))
            alone = scale * np.array([row.alone[:3] for row in shown])
            axes.barh(places, alone[:, 0], height=0.6, color=look["color"], alpha=0.5)
            for place, (_, low, high) in zip(places, alone, strict=True):
                axes.plot([low, high], [place, place], color=ink(), lw=0.9)
            beside = [(p, row.beside.value) for p, row in enumerate(shown) if row.beside]
            if beside:
                at, values = np.array(beside).T
                axes.plot(scale * values, at, "D", mfc="none", mec=ink(), ms=3.5, lw=0)
            total = scale * law.total.value
            ends = [*alone.ravel(), *(scale * value for _, value in beside), total, 0.0]
            axes.set_xlim(min(ends) - 0.04 * np.ptp(ends), max(ends) + 0.04 * np.ptp(ends))
            axes.axvline(total, color=ink(0.6), lw=0.9, ls="--")
            axes.axvline(0.0, color=ink(0.4), lw=0.5)
            words = [f"{row.source.words}  {row.source.key}".rstrip() for row in shown]
            axes.set_yticks(places, [free_text(text, 60) for text in words])
            axes.set_ylim(len(shown) - 0.5, -0.5)
            axes.set_xlabel(f"root mean square of the {WORDS[budget.error]} ({unit})")
            if len(budget.laws) > 1:
                axes.set_title(free_text(law.title, 40))
        handles = [
            Patch(color=line_style(0)["color"], alpha=0.5),
            Line2D([], [], color=ink(), marker="D", mfc="none", ms=3.5, lw=0),
            Line2D([], [], color=ink(0.6), ls="--", lw=0.9),
        ]
        add_legend(drawing, handles, ["alone", "goes if it is left out", "all sources"])
        freeze(drawing)
        content = encode(drawing, format, f"Error budget of {budget.name}")
    write_all({path: content}, path.parent)
